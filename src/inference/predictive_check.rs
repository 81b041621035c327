//! Runs held out against the band that a fitted model states for them.
//!
//! A prediction misses by the instruments' noise, by what the model's numbers leave open and by the random force where one is
//! stated, less what the fit of the run's start takes up. These errors are correlated over seconds, so that no table has how large
//! their rms over a run may be: errors are drawn as the model states them, and what was measured is held against the draws. Some
//! hundred draws do not reach a tail of a thousandth; there the mean square is taken for a multiple of chi-square with their mean
//! and variance.
//! References: Box 1980 (predictive check); Satterthwaite 1946 (multiple of chi-square).

use hydroline_core::run::{Channel, PerChannel};
use hydroline_numerics::statistics::chi2_above;
use hydroline_numerics::{cancel, parallel};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn, SymmetricEigen};
use rand::{SeedableRng, rngs::StdRng};
use rand_distr::{Distribution, StandardNormal};

use super::filter::{Filter, Force, draw};
use super::fit::{Fit, Problem};
use super::hyper::with_force;
use super::predicted_gain::dot;
use super::recording::Recorded;
use super::summary::Rms;

/// Errors drawn of each run: the variance of their mean square is then known to some 15 %.
const DRAWS: usize = 200;
/// Seed of the draws, the same for each run: neither the order nor the number of runs changes what is said of one.
const SEED: u64 = 63;
/// Spread of a channel's noise from one run to the next (sd of the logarithm): light, distance and water differ, and the runs
/// fitted show the noise to some per cent.
const NOISE_LN: f64 = 0.1;
/// Shortest correlation time of a noise \[s\]: below it samples are independent.
const SHORTEST_S: f64 = 1e-6;

/// A channel of a run that a model has not seen, beside the band that it states.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Checked {
    /// Place of the run among the problem's.
    pub run: usize,
    /// Channel that was measured.
    pub channel: Channel,
    /// rms of measured minus predicted \[SI\].
    pub rms: f64,
    /// rms to expect of the errors that the model states \[SI\].
    pub band: f64,
    /// Probability of an rms as large under these errors.
    pub p_value: f64,
}

/// A root of a covariance; `None` where one of its numbers is not finite.
fn root_of(covariance: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    if covariance.iter().any(|v| !v.is_finite()) {
        return None;
    }
    let symmetric = (covariance + covariance.transpose()) * 0.5;
    let eigen = SymmetricEigen::new(symmetric);
    let sd = eigen.eigenvalues.map(|v| v.max(0.0).sqrt());
    Some(&eigen.eigenvectors * DMatrix::from_diagonal(&sd))
}

/// Probability of a mean square as large, by those drawn: their share that is as large, and behind the largest of them a multiple
/// of chi-square with their mean and variance.
fn probability_of(square: f64, drawn: &[f64]) -> f64 {
    let count = drawn.len() as f64;
    let mean = drawn.iter().sum::<f64>() / count;
    let squares = drawn.iter().map(|q| (q - mean).powi(2));
    let variance = squares.sum::<f64>() / (count - 1.0);
    let share = drawn.iter().filter(|q| **q >= square).count() as f64 / count;
    // Draws that do not vary have no tail.
    if variance.is_nan() || variance <= 0.0 {
        return share;
    }
    let freedom = 2.0 * mean * mean / variance;
    chi2_above(square * freedom / mean, freedom).max(share)
}

/// Columns of a run's start through the filter of a DOF.
struct Whitened {
    dof: usize,
    filter: Filter,
    /// Per number of the start; `None` where it does nothing in this DOF.
    columns: Vec<Option<Vec<[f64; 2]>>>,
}

/// Fit of a run's start, linearised: it takes up a part of any error.
struct Start {
    /// Derivatives of the channels by each number of the start.
    columns: Vec<Vec<PerChannel<f64>>>,
    whitened: Vec<Whitened>,
    /// Root of the information of these numbers.
    root: Cholesky<f64, Dyn>,
}

impl Start {
    /// Start of the only run of a problem; the last numbers of `point` are its own.
    fn new(
        part: &Problem,
        terms: &[usize],
        point: &[f64],
        columns: Vec<Vec<PerChannel<f64>>>,
    ) -> Option<Start> {
        let count = columns.len();
        let mut information = DMatrix::<f64>::zeros(count, count);
        let mut whitened = Vec::new();
        for &dof in &part.body.dofs {
            let filters = with_force(&part.body, &part.noises, dof, Force::NONE);
            let filter = filters.into_iter().next()?;
            let through = columns.iter().map(|c| part.white_column(dof, c, &filter));
            let through: Vec<Option<Vec<[f64; 2]>>> = through.collect();
            for (i, a) in through.iter().enumerate() {
                for (j, b) in through.iter().enumerate() {
                    if let (Some(a), Some(b)) = (a, b) {
                        information[(i, j)] += dot(a, b);
                    }
                }
            }
            whitened.push(Whitened {
                dof,
                filter,
                columns: through,
            });
        }
        let first = point.len().checked_sub(count)?;
        let mut gradient = DVector::<f64>::zeros(count);
        let number_prior = part.number_prior(terms);
        number_prior.add_starts(first, point, &mut information, &mut gradient);
        Some(Start {
            root: Cholesky::new(information)?,
            columns,
            whitened,
        })
    }

    /// Takes out of an error what another start would have done.
    fn take_up(&self, error: &mut [PerChannel<f64>]) {
        let mut gradient = DVector::<f64>::zeros(self.columns.len());
        for white in &self.whitened {
            let both = Channel::of(white.dof);
            let mut series: Vec<[f64; 2]> = error.iter().map(|e| both.map(|c| e[c])).collect();
            white.filter.apply(&mut series);
            for (i, column) in white.columns.iter().enumerate() {
                if let Some(column) = column {
                    gradient[i] += dot(column, &series);
                }
            }
        }
        let moved = self.root.solve(&gradient);
        for (i, column) in self.columns.iter().enumerate() {
            for (value, slope) in error.iter_mut().zip(column) {
                *value = PerChannel::from_fn(|c| value[c] - moved[i] * slope[c]);
            }
        }
    }
}

/// Errors that a model states of its prediction of a run.
struct Stated<'a> {
    /// Problem of this run alone.
    part: &'a Problem,
    run: &'a Recorded,
    /// Samples that count, per channel.
    used: &'a [PerChannel<bool>],
    /// Channels of which any sample counts.
    channels: Vec<Channel>,
    /// Derivatives by the numbers that were found elsewhere, each with its place among them.
    known: Vec<(usize, Vec<PerChannel<f64>>)>,
    /// Root of the covariance of these numbers.
    root: DMatrix<f64>,
    start: Start,
    /// Random forces by their DOFs.
    forces: Vec<(usize, Force)>,
    /// rms of what the prediction leaves.
    left: Rms,
}

impl<'a> Stated<'a> {
    /// Errors of the only run of a problem; `None` where the model gives no finite motion.
    fn new(part: &'a Problem, fit: &Fit, stated: &[bool; 6]) -> Option<Stated<'a>> {
        let run = part.body.recording.runs.first()?;
        let used = part.noises.used.first()?.as_slice();
        let point = part.with_starts(&fit.terms, &fit.point)?;
        let simulated = part.simulate(&fit.terms, &point)?.into_iter().next()?;
        let globals = part.body.start_places(&fit.terms)[0];
        let left = part.left_of(std::slice::from_ref(&simulated.values));
        let (mut known, mut starts) = (Vec::new(), Vec::new());
        for (place, column) in simulated.columns {
            if place < globals {
                known.push((place, column));
            } else {
                starts.push(column);
            }
        }
        let covariance = fit.covariance.view((0, 0), (globals, globals));
        let measured = |c: &Channel| {
            let any = used.iter().any(|u| u[*c]);
            any && part.noises.channels[*c].is_some()
        };
        let forces = part.body.dofs.iter().filter(|d| stated[**d]);
        let forces = forces.map(|d| (*d, part.worth.force(*d, fit.cells.misfit[*d])));
        Some(Stated {
            channels: Channel::ALL.into_iter().filter(measured).collect(),
            root: root_of(&covariance.into_owned())?,
            start: Start::new(part, &fit.terms, &point, starts)?,
            forces: forces.filter(|f| f.1.sd_mps2 > 0.0).collect(),
            part,
            run,
            used,
            known,
            left,
        })
    }

    /// Adds a realisation of a channel's noise.
    fn add_noise(
        &self,
        channel: Channel,
        error: &mut [PerChannel<f64>],
        normal: &mut impl FnMut() -> f64,
    ) {
        let Some(noise) = self.part.noises.channels[channel] else {
            return;
        };
        let size = (NOISE_LN * normal()).exp();
        let mut colour = noise.coloured_sd * normal();
        let mut last_s = self.run.times_s.first().copied().unwrap_or(0.0);
        for (value, t_s) in error.iter_mut().zip(&self.run.times_s) {
            let gap_s = (t_s - last_s).max(0.0);
            last_s = *t_s;
            let decay = (-gap_s / noise.correlation_s.max(SHORTEST_S)).exp();
            let fresh = (1.0 - decay * decay).max(0.0).sqrt();
            colour = decay * colour + fresh * noise.coloured_sd * normal();
            value[channel] += size * (noise.white_sd * normal() + colour);
        }
    }

    /// A realisation of the error, as it is after the fit of the run's start.
    fn draw(&self, rng: &mut StdRng) -> Vec<PerChannel<f64>> {
        let mut normal = || -> f64 { StandardNormal.sample(rng) };
        let mut error = vec![PerChannel::splat(0.0); self.run.times_s.len()];
        let standard: Vec<f64> = (0..self.root.ncols()).map(|_| normal()).collect();
        let off = &self.root * DVector::from_vec(standard);
        for (place, column) in &self.known {
            let by = off[*place];
            for (value, slope) in error.iter_mut().zip(column) {
                for c in &self.channels {
                    value[*c] += by * slope[*c];
                }
            }
        }
        for (dof, force) in &self.forces {
            let response = self.part.body.responses[*dof];
            let (times_s, start_s) = (&self.run.times_s, self.run.start_s);
            let moved = draw(times_s, start_s, response, force.correlation_s, &mut normal);
            for (value, pair) in error.iter_mut().zip(moved) {
                for (c, v) in Channel::of(*dof).into_iter().zip(pair) {
                    value[c] += force.sd_mps2 * v;
                }
            }
        }
        for c in &self.channels {
            self.add_noise(*c, &mut error, &mut normal);
        }
        self.start.take_up(&mut error);
        error
    }

    /// Mean square of an error over the samples that count, channel by channel.
    fn mean_squares(&self, error: &[PerChannel<f64>]) -> Vec<f64> {
        let of = |c: &Channel| {
            let counting = error.iter().zip(self.used).filter(|(_, u)| u[*c]);
            let squares = counting.map(|(e, _)| e[*c].powi(2));
            let (sum, count) = squares.fold((0.0, 0.0), |s, v| (s.0 + v, s.1 + 1.0));
            sum / f64::max(count, 1.0)
        };
        self.channels.iter().map(of).collect()
    }

    /// What was measured against what was drawn, channel by channel.
    fn check(&self, run: usize) -> Vec<Checked> {
        let mut rng = StdRng::seed_from_u64(SEED);
        let drawn: Vec<Vec<f64>> = (0..DRAWS)
            .map(|_| {
                cancel::check();
                self.mean_squares(&self.draw(&mut rng))
            })
            .collect();
        let of = |(k, channel): (usize, &Channel)| {
            let squares: Vec<f64> = drawn.iter().map(|d| d[k]).collect();
            let mean = squares.iter().sum::<f64>() / squares.len() as f64;
            let rms = self.left[*channel];
            Checked {
                run,
                channel: *channel,
                rms,
                band: mean.sqrt(),
                p_value: probability_of(rms * rms, &squares),
            }
        };
        self.channels.iter().enumerate().map(of).collect()
    }
}

impl Problem {
    /// Every measured channel of every run against the band that a model states for it.
    ///
    /// `forces` = DOFs whose random force is part of what is stated; in the others it widens no band. Runs of which the model gives
    /// no finite motion are missing.
    pub fn predictive_check(&self, fit: &Fit, forces: &[bool; 6]) -> Vec<Checked> {
        let runs = self.body.recording.runs.len();
        let each = parallel::map(runs, |run| {
            let part = self.only(&[run]);
            let stated = Stated::new(&part, fit, forces);
            stated.map_or_else(Vec::new, |s| s.check(run))
        });
        each.into_iter().flatten().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::Effort;
    use crate::hyper::{Cell, Cells};
    use crate::prior::PriorTable;
    use crate::tests::fixtures::{Tank, entry};
    use hydroline_core::run::Run;
    use rand_distr::ChiSquared;

    /// Beyond the draws the tail is that of chi-square, within them their own share.
    #[test]
    fn a_tail_goes_on_behind_the_largest_draw() {
        let mut rng = StdRng::seed_from_u64(1);
        let chi = ChiSquared::new(6.0).unwrap();
        let drawn: Vec<f64> = (0..DRAWS).map(|_| chi.sample(&mut rng) / 6.0).collect();
        let median = probability_of(0.891, &drawn);
        assert!((median - 0.5).abs() < 0.1, "{median}");
        // 22.458 / 6: one in a thousand.
        let rare = probability_of(3.743, &drawn);
        assert!((1e-4..1.1e-2).contains(&rare), "{rare}");
        assert!(probability_of(25.0, &drawn) < 1e-12);
        assert_eq!(probability_of(1.0, &[2.0; 5]), 1.0);
    }

    /// Three of four runs fitted by the vehicle alone, and the fourth against its band.
    fn fourth(runs: &[Run], tank: &Tank) -> Vec<Checked> {
        let prior = PriorTable::default();
        let problem = Problem::new(&runs[..3], &tank.rig, &[0], prior).unwrap();
        let begin = problem.body.begin();
        let none = Cells::of([Cell::default(); 6]);
        let fit = problem.fit(&[], &begin, none, Effort::default()).unwrap();
        let over = problem.over(&runs[3..], &tank.rig).unwrap();
        let over = over.without_outliers(&fit);
        over.predictive_check(&fit, &[false; 6])
    }

    fn short() -> Tank {
        Tank {
            seconds: 12.0,
            hz: 12.5,
            ..Tank::new(&[0], vec![])
        }
    }

    /// The same law holds in the run held out: one in a hundred of such runs is beyond its band.
    #[test]
    fn a_run_of_the_same_vehicle_lies_within_its_band() {
        let tank = short();
        let mut beyond = 0;
        for seed in 0..8 {
            let all = fourth(&tank.runs(4, seed), &tank);
            let x = all.iter().find(|c| c.channel == Channel::X).unwrap();
            assert!((0.3..2.5).contains(&(x.rms / x.band)), "{seed}: {x:?}");
            beyond += usize::from(x.p_value < 0.01);
        }
        assert!(beyond <= 1, "{beyond} of 8");
    }

    /// A run held out at eleven times its noise had no word.
    #[test]
    fn a_run_in_which_a_current_flows_is_beyond_its_band() {
        let tank = short();
        for seed in 0..3 {
            let mut runs = tank.runs(4, seed);
            let flowing = Tank {
                effects: vec![entry("current", &[("vx_mps", 0.02)], &[])],
                ..short()
            };
            // The same seed draws the same vehicle and loads.
            runs[3] = flowing.runs(4, seed).remove(3);
            let all = fourth(&runs, &tank);
            let x = all.iter().find(|c| c.channel == Channel::X).unwrap();
            assert!(x.p_value < 1e-4 && x.rms > 3.0 * x.band, "{seed}: {x:?}");
        }
    }
}
