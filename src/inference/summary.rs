//! Figures of a fitted model: residuals, weights of its effects, predictions of runs it has not seen.

use std::ops::Range;

use hydroline_core::run::{Channel, PerChannel, Run};
use hydroline_numerics::cholesky::{PROJECTION_JITTER, ScaledCholesky};
use hydroline_rigs::Rig;
use hydroline_sim::effect::EffectError;
use nalgebra::{DMatrix, DVector};

use super::body::{Body, Point};
use super::filter::Force;
use super::fit::{Fit, Problem};
use super::hyper::{Noises, with_force};
use super::noise::estimate;
use super::recording::Recording;
use super::term::Kind;

/// rms per channel; NaN = not measured or not of a DOF that moves.
pub type Rms = PerChannel<f64>;

/// Sums squares per channel.
#[derive(Debug, Default, Clone, Copy)]
struct Squares {
    sum: PerChannel<f64>,
    count: PerChannel<usize>,
}

impl Squares {
    fn add(&mut self, channel: Channel, value: f64) {
        self.sum[channel] += value * value;
        self.count[channel] += 1;
    }

    fn rms(&self) -> Rms {
        PerChannel::from_fn(|c| match self.count[c] {
            0 => f64::NAN,
            n => (self.sum[c] / n as f64).sqrt(),
        })
    }
}

impl Problem {
    /// rms of what a prediction leaves of the samples that count.
    pub fn left_of(&self, predicted: &[Vec<PerChannel<f64>>]) -> Rms {
        let mut squares = Squares::default();
        for (run, predicted) in predicted.iter().enumerate() {
            self.add_left(run, predicted, 0..predicted.len(), &mut squares);
        }
        squares.rms()
    }

    /// The same of each run.
    pub fn left_by_run(&self, predicted: &[Vec<PerChannel<f64>>]) -> Vec<Rms> {
        let runs = predicted.iter().enumerate();
        runs.map(|(run, predicted)| self.left_within(run, predicted, 0..predicted.len()))
            .collect()
    }

    /// The same of this many stretches of each run, within the samples that count.
    pub fn left_by_stretch(&self, predicted: &[Vec<PerChannel<f64>>], each: usize) -> Vec<Rms> {
        let mut made = Vec::new();
        for (run, predicted) in predicted.iter().enumerate() {
            let used = &self.noises.used[run];
            let counts = |used: &PerChannel<bool>| used.iter().any(|u| *u);
            let (Some(first), Some(last)) =
                (used.iter().position(counts), used.iter().rposition(counts))
            else {
                continue;
            };
            let edge = |i: usize| first + (last + 1 - first) * i / each;
            made.extend((0..each).map(|i| self.left_within(run, predicted, edge(i)..edge(i + 1))));
        }
        made
    }

    fn left_within(&self, run: usize, predicted: &[PerChannel<f64>], within: Range<usize>) -> Rms {
        let mut squares = Squares::default();
        self.add_left(run, predicted, within, &mut squares);
        squares.rms()
    }

    fn add_left(
        &self,
        run: usize,
        predicted: &[PerChannel<f64>],
        within: Range<usize>,
        squares: &mut Squares,
    ) {
        let r = &self.body.recording.runs[run];
        for (k, p) in within.clone().zip(&predicted[within]) {
            let m = r.measured(k);
            for c in Channel::ALL
                .into_iter()
                .filter(|c| self.noises.used[run][k][*c])
            {
                squares.add(c, m[c] - p[c]);
            }
        }
    }

    /// The same of a point.
    pub fn left(&self, terms: &[usize], point: &[f64]) -> Rms {
        self.left_of(&self.predicted(terms, point))
    }

    /// Motion of a model with the best change of all its numbers, to first order and by least squares, all channels in
    /// units of what matters, samples by the sd that their log says. A fit beside a random force lets the vehicle drift, for the force forgives it; what the
    /// instruments add is to be seen beside the motion that comes closest.
    pub fn closest(&self, terms: &[usize], point: &[f64]) -> Option<Vec<Vec<PerChannel<f64>>>> {
        let all = self.simulate(terms, point)?;
        let n = point.len();
        let mut square = DMatrix::<f64>::zeros(n, n);
        let mut right = DVector::<f64>::zeros(n);
        for (run, s) in all.iter().enumerate() {
            let r = &self.body.recording.runs[run];
            let used = &self.noises.used[run];
            let residual = |k: usize, c: Channel| r.measured(k)[c] - s.values[k][c];
            for c in Channel::ALL {
                let tolerance = self.body.tolerance[c];
                let counting: Vec<(usize, f64)> = (0..used.len())
                    .filter(|k| used[*k][c])
                    .map(|k| (k, (tolerance * r.sd_ratio_of(k, c, true)).powi(-2)))
                    .collect();
                let moving: Vec<&(usize, Vec<PerChannel<f64>>)> = s
                    .columns
                    .iter()
                    .filter(|(_, v)| v.iter().any(|v| v[c] != 0.0))
                    .collect();
                for (i, a) in &moving {
                    let by = counting.iter();
                    right[*i] += by.map(|(k, w)| w * a[*k][c] * residual(*k, c)).sum::<f64>();
                    for (j, b) in moving.iter().filter(|m| m.0 >= *i) {
                        let by = counting.iter();
                        square[(*j, *i)] += by.map(|(k, w)| w * a[*k][c] * b[*k][c]).sum::<f64>();
                    }
                }
            }
        }
        square.fill_upper_triangle_with_lower_triangle();
        let by = ScaledCholesky::new(&square, PROJECTION_JITTER)?.solve(&right);
        let moved = all.into_iter().map(|s| {
            let mut values = s.values;
            for (i, column) in &s.columns {
                for (value, slope) in values.iter_mut().zip(column) {
                    *value = PerChannel::from_fn(|c| value[c] + by[*i] * slope[c]);
                }
            }
            values
        });
        Some(moved.collect())
    }

    /// Weight of each effect of a model as reference/interfaces.md defines it: rms of [motion with it alone − motion with none], at
    /// the fitted vehicle, what the vehicle's own numbers can do taken out.
    pub fn weights(&self, fit: &Fit) -> Vec<Rms> {
        let alone = |keep: Option<usize>| -> (Vec<usize>, Point) {
            let mut made = fit.clone();
            // A trend stays with its effect.
            let of = |m: usize| match self.body.candidates[fit.terms[m]].kind {
                Kind::Trend { of } => fit.terms.iter().position(|t| *t == of),
                _ => Some(m),
            };
            let goes = |m: &usize| keep.is_none() || of(*m) != keep;
            for member in (0..fit.terms.len()).rev().filter(goes) {
                let (terms, point) = self.without(&made, member);
                (made.terms, made.point) = (terms, point);
            }
            (made.terms, made.point)
        };
        let (_, bare) = alone(None);
        let Some(all) = self.simulate(&[], &bare) else {
            return vec![PerChannel::NAN; fit.terms.len()];
        };
        let own = self.body.own.len();
        let channels: Vec<Channel> = Channel::ALL
            .into_iter()
            .filter(|c| self.noises.channels[*c].is_some())
            .collect();
        // All channels in units of what matters.
        let row = |state: &PerChannel<f64>| -> Vec<f64> {
            channels
                .iter()
                .map(|c| state[*c] / self.body.tolerance[*c])
                .collect()
        };
        let rows: usize = all.iter().map(|s| s.values.len() * channels.len()).sum();
        let mut derivatives = DMatrix::zeros(rows, own);
        let mut at = 0;
        for s in &all {
            for (i, column) in s.columns.iter().filter(|c| c.0 < own) {
                for (k, state) in column.iter().enumerate() {
                    for (j, v) in row(state).into_iter().enumerate() {
                        derivatives[(at + k * channels.len() + j, *i)] = v;
                    }
                }
            }
            at += s.values.len() * channels.len();
        }
        let root = ScaledCholesky::new(&derivatives.tr_mul(&derivatives), PROJECTION_JITTER);
        let weigh = |member: usize| -> Rms {
            let (terms, point) = alone(Some(member));
            let with = self.predicted(&terms, &point);
            let difference: Vec<f64> = with
                .iter()
                .zip(&all)
                .flat_map(|(a, b)| a.iter().zip(&b.values))
                .flat_map(|(a, b)| row(&PerChannel::from_fn(|c| a[c] - b[c])))
                .collect();
            let mut difference = DVector::from_vec(difference);
            if let Some(root) = &root {
                let part = root.solve(&derivatives.tr_mul(&difference));
                difference -= &derivatives * part;
            }
            let mut squares = Squares::default();
            for (i, v) in difference.iter().enumerate() {
                let c = channels[i % channels.len()];
                squares.add(c, v * self.body.tolerance[c]);
            }
            squares.rms()
        };
        (0..fit.terms.len()).map(weigh).collect()
    }

    /// The same problem with only some of its runs.
    #[must_use]
    pub fn only(&self, keep: &[usize]) -> Problem {
        let body = Body {
            recording: Recording {
                runs: keep
                    .iter()
                    .map(|i| self.body.recording.runs[*i].clone())
                    .collect(),
                channels: self.body.recording.channels,
                logged_sd: self.body.recording.logged_sd,
            },
            starts: keep.iter().map(|i| self.body.starts[*i].clone()).collect(),
            rest: keep.iter().map(|i| self.body.rest[*i]).collect(),
            inputs: keep.iter().map(|i| self.body.inputs[*i].clone()).collect(),
            lines: keep
                .iter()
                .filter_map(|i| self.body.lines.get(*i).copied())
                .collect(),
            ..self.body.clone()
        };
        Problem {
            worth: self.worth.clone(),
            noises: self
                .noises
                .over(keep.iter().map(|i| self.noises.used[*i].clone()).collect()),
            body,
        }
    }

    /// The same body over other runs, with the same noise and candidates.
    ///
    /// # Errors
    /// [`EffectError`] for a bad `[[physics]]` entry of the rig.
    pub fn over(&self, runs: &[Run], rig: &Rig) -> Result<Problem, EffectError> {
        let mut recording = Recording::new(runs, rig.tank.start_pose[5]);
        recording.refer_to(self.body.recording.logged_sd);
        let body = self.body.over(recording, rig)?;
        let used = body.recording.measured_of(&self.noises.channels);
        Ok(Problem {
            worth: self.worth.clone(),
            noises: self.noises.over(used),
            body,
        })
    }

    /// The same with outliers left out: what differs from its neighbours by more than the vehicle can follow, whatever moves
    /// it. What a model misses is none.
    #[must_use]
    pub fn without_outliers(mut self, fit: &Fit) -> Problem {
        if let Some(point) = self.with_starts(&fit.terms, &fit.point) {
            let predicted = self.predicted(&fit.terms, &point);
            self.noises.used = estimate(&self.body, &predicted, Some(&self.noises)).used;
        }
        self
    }

    /// Innovations of a fitted model over their sd, per run, DOF and channel, under the instruments' noise alone.
    pub fn innovations(&self, terms: &[usize], point: &[f64]) -> Vec<(usize, Vec<Vec<[f64; 2]>>)> {
        let predicted = self.predicted(terms, point);
        let instruments = Noises {
            floor_sd: PerChannel::splat(0.0),
            ..self.noises.clone()
        };
        self.body
            .dofs
            .iter()
            .map(|&d| {
                let filters = with_force(&self.body, &instruments, d, Force::NONE);
                let runs = predicted.iter().zip(&filters).enumerate();
                let white = runs.map(|(run, (v, f))| self.white_residual(run, d, v, f));
                (d, white.collect())
            })
            .collect()
    }
}
