//! Fits by the simulation error alone: no random force, and white noise as large as what the model misses.
//!
//! Under a random force of any size an instrument that is much better than the model says of accelerations only how they
//! scatter; what a law explains of the motion drowns in it. A person looks first for what explains most of the misfit.

use hydroline_core::run::{Channel, PerChannel};
use hydroline_numerics::noise::Noise;
use hydroline_numerics::{cancel, parallel};

use super::fit::{Effort, Fit, Problem};
use super::hyper::{Cell, Cells, Tables};
use super::prediction::Prediction;
use super::summary::Rms;

/// Fits, each with the noise that the one before left.
pub(super) const ROUNDS: usize = 6;
/// Change of a misfit's logarithm below which its noise stays.
const SAME_MISFIT: f64 = 0.05;
/// Lags over which the correlation of what is left is summed, as a share of a run.
const LAGS: f64 = 0.25;

/// Parts of a single run, each predicted by the others.
const PARTS: usize = 4;

/// Stretches of all runs together from which the standard error of a mean error is taken, at least: a mean over two runs has none
/// to speak of.
const STRETCHES: usize = 8;

/// Fits that know of no random force.
const BY_SQUARES: Effort = Effort {
    forces_held: true,
    rounds: 1,
    steps: 15,
    decrement: 0.1,
    ..Effort::DEFAULT
};

/// Stretches of each of so many runs.
pub(super) fn stretches_of_each(runs: usize) -> usize {
    STRETCHES.div_ceil(runs.max(1))
}

/// These tables, and no random force.
fn without_force(tables: &Tables) -> Cells {
    Cells {
        tables: tables.clone(),
        ..Cells::of([Cell::default(); 6])
    }
}

impl Problem {
    /// The same runs by instruments as coarse as this: white noise in every channel, where their own is less.
    #[must_use]
    pub fn coarse(&self, sd: &Rms) -> Problem {
        let mut made = self.clone();
        made.blur(sd, self);
        made
    }

    /// White noise of `sd` in every channel, where that of `sharp` is less.
    fn blur(&mut self, sd: &Rms, sharp: &Problem) {
        self.noises.channels = PerChannel::from_fn(|c| {
            sharp.noises.channels[c].map(|n| Noise {
                white_sd: sd[c].max(n.total_sd()),
                coloured_sd: 0.0,
                ..n
            })
        });
        self.noises.floor_sd = PerChannel::splat(0.0);
    }

    /// Least squares of the motion: the point at which a model leaves least, every channel in units of what it leaves there.
    /// `tables` = sizes of its tables. Scores of such fits compare models that were fitted under one noise only.
    pub fn least_squares(&self, terms: &[usize], start: &[f64], tables: &Tables) -> Option<Fit> {
        self.least_squares_within(ROUNDS, terms, start, tables)
    }

    /// The same with so many rounds of its noise at most.
    pub(super) fn least_squares_within(
        &self,
        rounds: usize,
        terms: &[usize],
        start: &[f64],
        tables: &Tables,
    ) -> Option<Fit> {
        let cells = without_force(tables);
        let has_table = terms.iter().any(|t| self.body.candidates[*t].is_table());
        let noise = |point: &[f64]| {
            let left = self.left(terms, point);
            let factor = match has_table {
                true => self.samples_for_one(terms, point).sqrt(),
                false => 1.0,
            };
            (left.map(|sd| sd * factor), factor)
        };
        let (mut left, mut factor) = noise(start);
        let mut coarse = self.coarse(&left);
        let mut made: Option<Fit> = None;
        for _ in 0..rounds {
            let from = made.as_ref().map_or(start, |f| &f.point);
            let effort = Effort {
                decrement: BY_SQUARES.decrement / (factor * factor),
                ..BY_SQUARES
            };
            let fit = coarse.fit(terms, from, cells.clone(), effort)?;
            let (now, by) = noise(&fit.point);
            let change = now.iter().zip(&left).map(|(a, b)| (a / b).ln().abs());
            let change = change.filter(|v| v.is_finite()).fold(0.0, f64::max);
            made = Some(fit);
            if change < SAME_MISFIT {
                break;
            }
            (left, factor) = (now, by);
            coarse.blur(&left, self);
        }
        made
    }

    /// Samples over independent ones of what a model leaves, in all channels: it scatters slowly, and under white noise as large as
    /// that a table would follow it.
    fn samples_for_one(&self, terms: &[usize], point: &[f64]) -> f64 {
        let (count, samples) = (self.independent_samples(terms, point), self.samples());
        let each = Channel::ALL.into_iter().filter(|c| count[*c].is_finite());
        let (samples, count) =
            each.fold((0.0, 0.0), |sum, c| (sum.0 + samples[c], sum.1 + count[c]));
        if count > 0.0 { samples / count } else { 1.0 }
    }

    /// Every run as the others predict it, all by least squares.
    pub fn one_run_out_by_squares(&self, fit: &Fit) -> Option<Prediction> {
        let each = parallel::map(self.body.recording.runs.len(), |out| {
            cancel::check();
            let (part, from) = self.without_run(fit, out);
            let made = part.least_squares(&fit.terms, &from, &fit.cells.tables)?;
            let sd = part.left(&made.terms, &made.point);
            self.only(&[out]).coarse(&sd).predict(&made)
        });
        let mut all = Prediction::default();
        for of in each {
            let of = of?;
            all.values.extend(of.values);
            all.sd.extend(of.sd);
        }
        Some(all)
    }

    /// rms that each stretch of each run leaves where the other runs predict it, all by least squares; of a single run the same
    /// of each of its parts, through which the motion goes on from what was before.
    pub fn left_by_others(&self, fit: &Fit) -> Option<Vec<Rms>> {
        match self.noises.used.as_slice() {
            [one] => self.left_by_other_parts(fit, one),
            _ => {
                let values = self.one_run_out_by_squares(fit)?.values;
                Some(self.left_by_stretch(&values, stretches_of_each(values.len())))
            }
        }
    }

    fn left_by_other_parts(&self, fit: &Fit, used: &[PerChannel<bool>]) -> Option<Vec<Rms>> {
        let each = parallel::map(PARTS, |part| {
            cancel::check();
            let within = part * used.len() / PARTS..(part + 1) * used.len() / PARTS;
            let only = |inside: bool| {
                let mut made = self.clone();
                for (k, used) in made.noises.used[0].iter_mut().enumerate() {
                    if within.contains(&k) != inside {
                        *used = PerChannel::splat(false);
                    }
                }
                made
            };
            let made = only(false).least_squares(&fit.terms, &fit.point, &fit.cells.tables)?;
            let inside = only(true);
            let predicted = inside.predicted(&made.terms, &made.point);
            Some(inside.left_by_stretch(&predicted, stretches_of_each(PARTS)))
        });
        let each: Option<Vec<Vec<Rms>>> = each.into_iter().collect();
        Some(each?.into_iter().flatten().collect())
    }

    /// Number of independent samples that each channel's residuals are worth, by the sum of their autocorrelations up to the
    /// first that is negative (initial positive sequence, Geyer 1992); NaN = not measured.
    pub fn independent_samples(&self, terms: &[usize], point: &[f64]) -> Rms {
        let predicted = self.predicted(terms, point);
        PerChannel::from_fn(|c| {
            if self.noises.channels[c].is_none() {
                return f64::NAN;
            }
            let mut count = 0.0;
            for (run, predicted) in predicted.iter().enumerate() {
                let r = &self.body.recording.runs[run];
                let used = &self.noises.used[run];
                let left: Vec<f64> = (0..used.len())
                    .filter(|k| used[*k][c])
                    .map(|k| r.measured(k)[c] - predicted[k][c])
                    .collect();
                let n = left.len();
                let power: f64 = left.iter().map(|v| v * v).sum();
                if power <= 0.0 {
                    continue;
                }
                let most = (LAGS * n as f64) as usize;
                let at = |lag: usize| -> f64 {
                    let pairs = left.iter().zip(&left[lag..]);
                    pairs.map(|(a, b)| a * b).sum::<f64>() / power
                };
                let positive = (1..most).map(at).take_while(|rho| *rho > 0.0);
                count += n as f64 / (1.0 + 2.0 * positive.sum::<f64>());
            }
            count
        })
    }

    /// Number of samples of each channel that count.
    pub fn samples(&self) -> Rms {
        PerChannel::from_fn(|c| {
            let all = self.noises.used.iter().flatten();
            all.filter(|u| u[c]).count() as f64
        })
    }

    /// Score of a model by the simulation error alone, under instruments that are this coarse; its numbers with the
    /// covariance that they leave.
    pub fn scored_by_squares(&self, fit: &Fit) -> Option<Fit> {
        let cells = without_force(&fit.cells.tables);
        self.fit(&fit.terms, &fit.point, cells, BY_SQUARES)
    }
}
