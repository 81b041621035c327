//! Parameters, noise and outliers in turns until none of them moves the others.

use super::{IdentifyError, Options};
use crate::forward::Forward;
use crate::lm;
use crate::problem::{Objective, Problem, from};
use crate::uncertainty::covariance;
use hydroline_core::run::RestNoise;
use hydroline_numerics::apart::not_apart;
use hydroline_numerics::noise::{Noise, Series, mask};
use hydroline_numerics::statistics::{Correlogram, LAGS, Whiteness, difference_sd, variance_above};
use nalgebra::DMatrix;
use std::collections::BTreeSet;

/// sd over the rig's size above which a coefficient is held.
const HOLD_ABOVE: f64 = 2.0;
/// p below which residuals are called not white, over all runs and slots of a fit together.
pub(super) const NOT_WHITE: f64 = 1e-3;
/// Decrease of half the sum of squares that a step of a refit between two holdings must bring.
const REFIT_ENOUGH: f64 = 0.1;

/// A fit under way: parameters, noise and outliers in turns.
pub(super) struct Fit<'f> {
    pub(super) forward: &'f dyn Forward,
    pub(super) problem: Problem<'f>,
    pub(super) measured_noise: Option<Vec<Option<RestNoise>>>,
    /// Slots whose residuals agree with the noise at rest: both together are its measurement.
    agreed: Vec<bool>,
    /// Residuals of each run and slot beside the noise at rest, where that was compared.
    pub(super) beside_rest: Vec<Vec<Option<Whiteness>>>,
    /// Per slot the probability that residuals are as large by chance as they are beside the noise at rest.
    pub(super) level_p: Vec<Option<f64>>,
    /// Per slot residuals over the noise at rest, where they are larger than it; else 1.
    pub(super) louder: Vec<f64>,
    /// Residual variance over the noise at rest as measured, where some of it was enlarged since.
    pub(super) ratio_at_rest: Option<f64>,
    /// Per run the time of its first load \[s\], where what was before measured the noise.
    opening_s: Vec<Option<f64>>,
    pub(super) name: String,
    pub(super) noises: Vec<Noise>,
    pub(super) outliers: Vec<f64>,
    pub(super) at: Vec<f64>,
    pub(super) held: Vec<bool>,
    pub(super) objective_value: f64,
    pub(super) evaluations: usize,
    pub(super) converged: bool,
    pub(super) notes: Vec<String>,
}

impl<'f> Fit<'f> {
    pub(super) fn new(
        forward: &'f dyn Forward,
        measured_noise: Option<Vec<Option<RestNoise>>>,
        opening_s: Vec<Option<f64>>,
        name: String,
    ) -> Result<Self, IdentifyError> {
        let slots = forward.slots().len();
        let first_sd = |slot: usize| -> f64 {
            let sds: Vec<f64> = (0..forward.runs())
                .map(|run| {
                    let v: Vec<f64> = forward
                        .measured(run)
                        .iter()
                        .skip(slot)
                        .step_by(slots)
                        .copied()
                        .filter(|v| v.is_finite())
                        .collect();
                    difference_sd(&v)
                })
                .filter(|sd| *sd > 0.0)
                .collect();
            let largest = sds.iter().copied().fold(0.0, f64::max);
            if largest > 0.0 { largest } else { 1e-6 }
        };
        let sds: Vec<f64> = (0..slots).map(first_sd).collect();
        let mut problem = Problem::new(forward, &sds);
        let noises: Vec<Noise> = sds.into_iter().map(Noise::white).collect();
        let apart = standing_apart(forward);
        if apart.iter().flatten().any(|a| !a.is_empty()) {
            problem.set_noise(&noises, |run, slot, k| !apart[run][slot].contains(&k));
        }
        let free = problem.free().len();
        if problem.samples() < 2 * free {
            return Err(IdentifyError::TooFew {
                samples: problem.samples(),
                free,
                dof: name,
            });
        }
        let at = problem.start();
        Ok(Fit {
            forward,
            held: vec![false; at.len()],
            problem,
            measured_noise,
            agreed: vec![false; slots],
            beside_rest: Vec::new(),
            level_p: vec![None; slots],
            louder: vec![1.0; slots],
            ratio_at_rest: None,
            opening_s,
            name,
            noises,
            outliers: vec![0.0; slots],
            at,
            objective_value: f64::NAN,
            evaluations: 0,
            converged: false,
            notes: Vec::new(),
        })
    }

    /// Search with white weights, then noise and parameters in turns.
    pub(super) fn search(&mut self, options: &Options<'_>) -> Result<(), IdentifyError> {
        let found = options
            .method
            .minimise(&self.problem, options.objective, options.seed)?;
        (
            self.at,
            self.objective_value,
            self.evaluations,
            self.converged,
        ) = (
            found.parameters,
            found.objective,
            found.evaluations,
            found.converged,
        );
        self.reweigh()?;
        if options.objective != Objective::LeastSquares || options.method.name() != "lm" {
            // The estimate is the method's own; only its spread comes from the least squares.
            self.enlarge()?;
            return Ok(());
        }
        self.hold_unexcited()?;
        self.settle()?;
        self.agree()?;
        if self.agreed.contains(&true) {
            self.settle()?;
        }
        if self.enlarge()? {
            self.settle()?;
        }
        Ok(())
    }

    /// Parameters beside the noise and the noise beside the parameters, until neither moves the other.
    fn settle(&mut self) -> Result<(), IdentifyError> {
        for _ in 0..5 {
            let found = lm::least_squares(&self.problem, self.at.clone(), &self.held)?;
            self.evaluations += found.evaluations;
            let sds = self.sds()?;
            let moved = found
                .parameters
                .iter()
                .zip(&self.at)
                .zip(&sds)
                .any(|((a, b), sd)| (a - b).abs() > 0.02 * sd);
            self.at = found.parameters;
            self.converged = found.converged;
            self.objective_value = found.objective;
            if !moved {
                break;
            }
            self.reweigh()?;
        }
        Ok(())
    }

    /// Noise and outliers from the residuals, or from rest with outliers from the residuals.
    fn reweigh(&mut self) -> Result<(), IdentifyError> {
        let beside = |slot: usize| match self.measured_at_rest(slot) {
            Some(rest) if self.agreed[slot] => rest.stretches.as_slice(),
            _ => &[],
        };
        let (found, mut used) =
            self.problem
                .noise_of_residuals(&self.at, beside, &self.opening_s)?;
        let slots = self.forward.slots().len();
        for slot in 0..slots {
            let alone = self.measured_at_rest(slot).filter(|_| !self.agreed[slot]);
            if let Some(noise) = alone.map(|n| n.noise) {
                self.noises[slot] = noise.times(self.louder[slot]);
                let residuals: Result<Vec<_>, _> = (0..self.forward.runs())
                    .map(|r| self.problem.weighed_residuals(r, &self.at))
                    .collect();
                let residuals = residuals?;
                let views: Vec<Series<'_>> = residuals
                    .iter()
                    .enumerate()
                    .map(|(r, v)| Series {
                        times_s: self.forward.times_s(r),
                        values: &v[slot],
                        jacobian: None,
                    })
                    .collect();
                for (run, flags) in mask(&views, noise).into_iter().enumerate() {
                    used[run][slot] = flags;
                }
            } else if let Some(noise) = found[slot] {
                self.noises[slot] = noise;
            }
            let (mut kept, mut present) = (0usize, 0usize);
            for (run, used) in used.iter().enumerate() {
                kept += used[slot].iter().filter(|u| **u).count();
                present += self
                    .forward
                    .measured(run)
                    .iter()
                    .skip(slot)
                    .step_by(slots)
                    .filter(|v| v.is_finite())
                    .count();
            }
            self.outliers[slot] = 1.0 - kept as f64 / present.max(1) as f64;
        }
        self.problem
            .set_noise(&self.noises, |run, slot, k| used[run][slot][k]);
        Ok(())
    }

    /// The noise of a slot that was measured at rest, if it was, and its outliers.
    pub(super) fn measured_at_rest(&self, slot: usize) -> Option<&RestNoise> {
        self.measured_noise.as_ref()?.get(slot)?.as_ref()
    }

    /// Where residuals are louder than the noise at rest, slot by slot, the noise is as loud as they: a misfit
    /// in one channel neither hides behind quiet ones nor makes intervals narrower than they are. Returns
    /// whether a slot was.
    fn enlarge(&mut self) -> Result<bool, IdentifyError> {
        let share = self.freedom() / self.problem.samples().max(1) as f64;
        let runs = self.forward.runs();
        let whitened: Result<Vec<_>, _> = (0..runs)
            .map(|run| self.problem.whitened(run, &self.at))
            .collect();
        let whitened = whitened?;
        let slots = self.louder.len();
        for slot in 0..slots {
            let Some(rest) = self.measured_at_rest(slot).filter(|_| !self.agreed[slot]) else {
                continue;
            };
            let at_rest = rest.left.as_ref().map_or(0, |left| left.samples);
            let by_run = whitened.iter().enumerate();
            let driven = by_run.flat_map(|(run, slots)| self.driven(run, slot, &slots[slot]));
            let (sum, count) = driven
                .filter(|v| v.is_finite())
                .fold((0.0, 0usize), |(s, n), v| (s + v * v, n + 1));
            let freedom = (share * count as f64).max(1.0);
            let ratio = sum / freedom;
            if ratio > 1.0 {
                self.louder[slot] = ratio.sqrt();
            }
            if self.level_p[slot].is_none() {
                // Figures without samples are taken as exact.
                self.level_p[slot] = Some(match at_rest {
                    0 => 0.0,
                    n => variance_above(ratio, freedom, n as f64),
                });
            }
        }
        if self.louder.iter().all(|l| *l == 1.0) {
            return Ok(false);
        }
        self.ratio_at_rest = Some(self.variance()?.0);
        self.reweigh()?;
        Ok(true)
    }

    /// Finds the slots whose residuals have the level and the colour of the noise at rest. There the residuals,
    /// often many more samples, measure the noise too: what twenty seconds leave open of its colour would
    /// make intervals too narrow in one experiment and too wide in the next.
    ///
    /// The test takes the noise that both together show out of both: only what is then nearly white on either side
    /// has the scatter that the test assumes, and under one and the same noise it is. Leaves the weights as found.
    fn agree(&mut self) -> Result<(), IdentifyError> {
        let runs = self.forward.runs();
        let slots = self.agreed.len();
        let testable = |fit: &Self, slot: usize| {
            fit.measured_at_rest(slot)
                .is_some_and(|rest| !rest.stretches.is_empty())
        };
        self.agreed = (0..slots).map(|slot| testable(self, slot)).collect();
        if !self.agreed.contains(&true) {
            return Ok(());
        }
        self.reweigh()?;
        let whitened: Result<Vec<_>, _> = (0..runs)
            .map(|run| self.problem.whitened(run, &self.at))
            .collect();
        let whitened = whitened?;
        let threshold = self.threshold();
        // Each slot pays for its share of what was fitted.
        let share = self.freedom() / self.problem.samples().max(1) as f64;
        let mut tests = vec![vec![None; slots]; runs];
        let mut levels = vec![None; slots];
        for slot in 0..slots {
            if !self.agreed[slot] {
                continue;
            }
            let rest = self.measured_at_rest(slot);
            let Some(left) = rest.and_then(|r| r.left_of(self.noises[slot])) else {
                self.agreed[slot] = false;
                continue;
            };
            let own = |run: usize| self.driven(run, slot, &whitened[run][slot]);
            for (run, tests) in tests.iter_mut().enumerate() {
                tests[slot] = Correlogram::of(&[own(run)], LAGS).and_then(|c| c.against(&left));
            }
            let all = (0..runs).flat_map(own).filter(|v| v.is_finite());
            let (sum, count) = all.fold((0.0, 0usize), |(s, n), v| (s + v * v, n + 1));
            let freedom = (share * count as f64).max(1.0);
            let ratio = sum / freedom / left.variance;
            let at_rest = left.samples as f64;
            let (above, below) = (
                variance_above(ratio, freedom, at_rest),
                variance_above(1.0 / ratio, at_rest, freedom),
            );
            levels[slot] = Some(above);
            let colour = tests.iter().filter_map(|t| t[slot]);
            self.agreed[slot] = colour.into_iter().all(|w| w.p_value >= threshold)
                && above.min(below) >= NOT_WHITE / slots as f64;
        }
        self.level_p = levels;
        self.beside_rest = tests;
        self.reweigh()
    }

    /// Filtered residuals of a run and slot, NaN where a sample does not count.
    pub(super) fn innovations(&self, run: usize, slot: usize, filtered: &[f64]) -> Vec<f64> {
        let filter = &self.problem.whiteners()[run][slot];
        filtered
            .iter()
            .enumerate()
            .map(|(k, v)| if filter.counts(k) { *v } else { f64::NAN })
            .collect()
    }

    /// The same without what measured the noise: a stretch at rest beside itself agrees with anything.
    pub(super) fn driven(&self, run: usize, slot: usize, filtered: &[f64]) -> Vec<f64> {
        let opening_s = self.opening_s[run].filter(|_| self.measured_at_rest(slot).is_some());
        let innovations = self.innovations(run, slot, filtered);
        from(self.forward.times_s(run), &innovations, opening_s)
    }

    /// The noise of a slot: as measured at rest, if it was and residuals are louder.
    pub(super) fn noise_of(&self, slot: usize) -> Noise {
        self.noises[slot].times(1.0 / self.louder[slot])
    }

    /// p below which one of this fit's tests is a finding: the smallest of many is small by chance (Bonferroni).
    pub(super) fn threshold(&self) -> f64 {
        let slots = self.forward.slots().len();
        let measured = (0..slots).filter(|slot| self.is_measured(*slot)).count();
        NOT_WHITE / (self.forward.runs() * measured).max(1) as f64
    }

    /// Whether any run measured this slot; a model of rates has its position as a slot all the same.
    pub(super) fn is_measured(&self, slot: usize) -> bool {
        let slots = self.forward.slots().len();
        (0..self.forward.runs()).any(|run| {
            let values = self.forward.measured(run).iter().skip(slot).step_by(slots);
            values.into_iter().any(|v| v.is_finite())
        })
    }

    fn sds(&self) -> Result<Vec<f64>, IdentifyError> {
        Ok(sds(&self.problem.normal(&self.at)?.hessian, &self.held))
    }

    /// Coefficients of a DOF at rest stay at the rig's value from the beginning, whatever searches.
    pub(super) fn hold_resting(&mut self, resting: impl Fn(usize) -> bool) {
        for i in (0..self.forward.globals().len()).filter(|i| resting(*i)) {
            self.held[i] = true;
            self.problem.pin(i);
            self.note_held(i);
        }
    }

    fn note_held(&mut self, i: usize) {
        let free = &self.forward.globals()[i];
        self.notes.push(format!(
            "{}: these runs do not move it; kept at the rig's {:.4}",
            free.name, free.start
        ));
    }

    /// Coefficients that the runs do not move go back to the rig's value and stay there.
    fn hold_unexcited(&mut self) -> Result<(), IdentifyError> {
        let (at, held) = (&mut self.at, &mut self.held);
        let (now, evaluations) = hold_undetermined(&self.problem, at, held, HOLD_ABOVE)?;
        self.evaluations += evaluations;
        for i in now {
            self.note_held(i);
        }
        Ok(())
    }

    /// Samples that count less what was fitted to them.
    pub(super) fn freedom(&self) -> f64 {
        (self.problem.samples() as f64 - self.problem.free().len() as f64).max(1.0)
    }

    /// Residual variance per degree of freedom of the whitened residuals.
    pub(super) fn variance(&self) -> Result<(f64, f64), IdentifyError> {
        let freedom = self.freedom();
        Ok((2.0 * self.problem.normal(&self.at)?.cost / freedom, freedom))
    }
}

/// Samples of each run and slot that stand apart from their neighbours whatever the model. A fit that begins with them is drawn
/// away, and what it leaves then passes for noise, by which nothing is determined.
fn standing_apart(forward: &dyn Forward) -> Vec<Vec<BTreeSet<usize>>> {
    let slots = forward.slots().len();
    let of = |run: usize, slot: usize| {
        let values = forward.measured(run).iter().skip(slot).step_by(slots);
        let seen: Vec<(usize, f64)> = values
            .copied()
            .enumerate()
            .filter(|v| v.1.is_finite())
            .collect();
        let times_s: Vec<f64> = seen.iter().map(|(k, _)| forward.times_s(run)[*k]).collect();
        let values: Vec<f64> = seen.iter().map(|v| v.1).collect();
        let used = not_apart(&times_s, &values);
        let apart = seen.iter().zip(used).filter(|(_, used)| !used);
        apart.map(|((k, _), _)| *k).collect()
    };
    (0..forward.runs())
        .map(|run| (0..slots).map(|slot| of(run, slot)).collect())
        .collect()
}

/// J^T J of what is free beside what is held; 1 on the diagonal of the held.
pub(super) fn beside(hessian: &DMatrix<f64>, held: &[bool]) -> DMatrix<f64> {
    let n = hessian.nrows();
    DMatrix::from_fn(n, n, |i, j| match (i == j, held[i] || held[j]) {
        (_, false) => hessian[(i, j)],
        (true, true) => 1.0,
        (false, true) => 0.0,
    })
}

/// sds of what is free, with the held ones known.
fn sds(hessian: &DMatrix<f64>, held: &[bool]) -> Vec<f64> {
    covariance(&beside(hessian, held))
        .diagonal()
        .iter()
        .map(|v| v.sqrt())
        .collect()
}

/// Holds at the rig's value, one after the other, the coefficient that is known worst for its size,
/// while its sd is above `share` of that size. Each one held may determine others: where only a
/// common factor of mass and damping is open, holding one of them is enough.
///
/// Returns which were held now, in their order, and the evaluations of the refits between them.
pub(super) fn hold_undetermined(
    problem: &Problem<'_>,
    at: &mut Vec<f64>,
    held: &mut [bool],
    share: f64,
) -> Result<(Vec<usize>, usize), IdentifyError> {
    let globals = problem.forward().globals();
    let (mut now, mut evaluations) = (Vec::new(), 0);
    let mut hessian = problem.normal(at)?.hessian;
    loop {
        let sds = sds(&hessian, held);
        let mut worst: Option<(usize, f64)> = None;
        for (i, free) in globals.iter().enumerate().filter(|(i, _)| !held[*i]) {
            // A rig that knows no number gives no size either: what may lie within the search range then. (The
            // uncertainty about 0 is nearly twice that: what is as open as this would end on its bound instead.)
            let size = match free.start {
                0.0 => (free.high - free.low) / 12f64.sqrt(),
                said => said,
            };
            let relative = if sds[i].is_finite() {
                sds[i] / size.abs().max(1e-9)
            } else {
                f64::INFINITY
            };
            // Of equals the first: the mass rather than the damping.
            if relative > share && worst.is_none_or(|(_, before)| relative > 1.01 * before) {
                worst = Some((i, relative));
            }
        }
        let Some((i, _)) = worst else {
            return Ok((now, evaluations));
        };
        held[i] = true;
        at[i] = globals[i].start;
        now.push(i);
        let refit = lm::descend(problem, at.clone(), held, REFIT_ENOUGH).or_else(|_| {
            // Values fitted beside the old one may not even stay finite beside the new one.
            for (value, free) in at.iter_mut().zip(globals) {
                *value = free.start;
            }
            lm::descend(problem, at.clone(), held, REFIT_ENOUGH)
        });
        let (found, normal) = refit?;
        evaluations += found.evaluations;
        *at = found.parameters;
        hessian = normal.hessian;
    }
}
