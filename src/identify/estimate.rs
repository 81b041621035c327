//! The whole way from runs to parameters with their uncertainty.

use std::collections::BTreeMap;

use hydroline_rigs::{Dof, Rig, VehicleModel};
use hydroline_sim::effect::EffectError;
use nalgebra::DMatrix;

use super::axis::Axis;
use super::blind::blind_spots;
use super::coupled::Coupled;
use super::data::{CHANNELS, Run, Start, is_still};
use super::forward::{Forward, ForwardError};
use super::lm::{self, LevenbergMarquardt};
use super::method::{Method, MethodError};
use super::noise::{Noise, Series, estimate as estimate_noise, mask};
use super::outcome::{
    CrossValidation, Estimate, Identification, Residuals, RunSummary, SlotNoise, Trace,
};
use super::parameter::Coefficient;
use super::problem::{Objective, Problem};
use super::statistics::{difference_sd, ljung_box, robust_sd, t95};
use super::uncertainty::{correlation, covariance, profile};

/// Which equations.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ModelChoice {
    /// One DOF when only one is driven (or, without commands, only one moves), else coupled.
    Auto,
    /// One DOF.
    Axis(Dof),
    /// The rig's model (`eq1` or `decoupled`), every measured DOF.
    Coupled,
}

/// How to identify.
pub struct Options<'a> {
    /// Equations.
    pub model: ModelChoice,
    /// Search.
    pub method: &'a dyn Method,
    /// What the search minimises.
    pub objective: Objective,
    /// Coefficients kept as the rig has them.
    pub fixed: Vec<Coefficient>,
    /// What is known of every run's start.
    pub start: Start,
    /// Leave-one-run-out.
    pub cross_validate: bool,
    /// Seed of random starts and searches.
    pub seed: u64,
}

impl Default for Options<'_> {
    fn default() -> Self {
        Options {
            model: ModelChoice::Auto,
            method: &LevenbergMarquardt { starts: 6 },
            objective: Objective::LeastSquares,
            fixed: Vec::new(),
            start: Start::Free,
            cross_validate: true,
            seed: 1,
        }
    }
}

/// Why nothing was identified.
#[derive(Debug, thiserror::Error)]
pub enum IdentifyError {
    /// Too few numbers.
    #[error(
        "{samples} usable samples for {free} unknowns in {dof}; give longer runs, or check that the channel is in the log (hydroline info)"
    )]
    TooFew {
        /// Samples.
        samples: usize,
        /// Unknowns.
        free: usize,
        /// DOF or model.
        dof: String,
    },
    /// No run but ones at rest.
    #[error("all {0} log(s) are at rest: they measure the noise; add runs that move")]
    OnlyStill(usize),
    /// Nothing given.
    #[error("no run given")]
    NoRun,
    /// The rig's effects.
    #[error(transparent)]
    Effect(#[from] EffectError),
    /// The search.
    #[error(transparent)]
    Method(#[from] MethodError),
    /// The motion.
    #[error(transparent)]
    Forward(#[from] ForwardError),
}

/// Relative sd above which a direction is weak: the interval comes from the profile.
const WEAK: f64 = 0.05;
/// sd over size above which a coefficient counts as not excited.
const UNEXCITED: f64 = 0.5;
/// p below which residuals are called not white.
const NOT_WHITE: f64 = 1e-3;
/// Lags of the whiteness test.
const LAGS: usize = 20;

/// Identifies from runs; runs at rest (no load, >= 20 s, no motion) measure the noise instead.
///
/// # Errors
/// [`IdentifyError`].
pub fn identify(
    runs: &[Run],
    rig: &Rig,
    options: &Options<'_>,
) -> Result<Identification, IdentifyError> {
    let tolerance = [rig.tolerance.position_m, rig.tolerance.attitude_rad];
    let (still, moving): (Vec<&Run>, Vec<&Run>) = runs.iter().partition(|r| is_still(r, tolerance));
    let moving: Vec<Run> = moving.into_iter().cloned().collect();
    if moving.is_empty() {
        return Err(if runs.is_empty() {
            IdentifyError::NoRun
        } else {
            IdentifyError::OnlyStill(runs.len())
        });
    }
    let still: Vec<Run> = still.into_iter().cloned().collect();
    let choice = match options.model {
        ModelChoice::Auto => choose(&moving, rig),
        given => given,
    };
    let (coefficients, dofs, name) = what_is_free(choice, &moving, rig, options);
    let make = |runs: &[Run], free: &[Coefficient]| -> Result<Box<dyn Forward>, IdentifyError> {
        Ok(match choice {
            ModelChoice::Axis(dof) if rig.physics.is_empty() => {
                Box::new(Axis::new(runs, &rig.vehicle, dof, free, options.start))
            }
            _ => Box::new(Coupled::new(runs, rig, free, options.start)?),
        })
    };
    let forward = make(&moving, &coefficients)?;
    let rest = if still.is_empty() {
        None
    } else {
        Some(make(&still, &coefficients)?)
    };
    let measured_noise = match rest.as_deref() {
        Some(rest) => Some(noise_at_rest(rest)),
        None => stored_noise(runs, forward.slots()),
    };
    let mut fit = Fit::new(forward.as_ref(), measured_noise, name)?;
    let resting: Vec<Dof> = dofs
        .iter()
        .copied()
        .filter(|d| rests(&moving, *d))
        .collect();
    for (i, c) in coefficients.iter().enumerate() {
        fit.held[i] = resting.contains(&c.dof);
    }
    fit.search(options)?;
    let mut result = fit.conclude(&moving, rig, &coefficients, options)?;
    for s in &still {
        result.notes.push(format!(
            "{}: at rest for {:.0} s, used as the measurement of the noise",
            s.name,
            s.end_s()
        ));
    }
    if options.cross_validate && moving.len() > 1 {
        result.cross_validation = cross_validate(&moving, &result, &fit, &make, &coefficients)?;
    }
    let undetermined: Vec<Coefficient> = coefficients
        .iter()
        .copied()
        .filter(|c| result.parameters.get(c.key()).is_some_and(|p| !p.excited))
        .collect();
    let restoring = dofs.iter().any(|d| matches!(d, Dof::Roll | Dof::Pitch));
    result.blind_spots = blind_spots(&moving, &dofs, &undetermined, restoring);
    Ok(result)
}

/// One DOF if only one is driven; without commands the one that moves most for its noise.
fn choose(runs: &[Run], rig: &Rig) -> ModelChoice {
    let driven: Vec<Dof> = Dof::ALL
        .into_iter()
        .filter(|d| {
            let all = runs.iter().fold([0.0_f64; 6], |m, r| {
                std::array::from_fn(|i| m[i].max(r.largest_wrench()[i]))
            });
            // Rounding of pulses leaves traces in the other components.
            all[d.index()] > 0.01 * all.iter().copied().fold(0.0, f64::max)
        })
        .collect();
    match driven.as_slice() {
        [one] => ModelChoice::Axis(*one),
        [] => {
            let moved = |i: usize| -> f64 {
                runs.iter()
                    .map(|r| {
                        let v: Vec<f64> = r
                            .samples
                            .iter()
                            .map(|s| s.values[i])
                            .filter(|v| v.is_finite())
                            .collect();
                        let (low, high) = v
                            .iter()
                            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| {
                                (l.min(*x), h.max(*x))
                            });
                        let unit = if i < 3 {
                            rig.tolerance.position_m
                        } else {
                            rig.tolerance.attitude_rad
                        };
                        if v.len() > 8 {
                            (high - low) / unit
                        } else {
                            0.0
                        }
                    })
                    .fold(0.0, f64::max)
            };
            let best = Dof::ALL
                .into_iter()
                .max_by(|a, b| moved(a.index()).total_cmp(&moved(b.index())));
            ModelChoice::Axis(best.unwrap_or(Dof::Surge))
        }
        _ => ModelChoice::Coupled,
    }
}

fn what_is_free(
    choice: ModelChoice,
    runs: &[Run],
    rig: &Rig,
    options: &Options<'_>,
) -> (Vec<Coefficient>, Vec<Dof>, String) {
    let dofs: Vec<Dof> = match choice {
        ModelChoice::Axis(dof) => vec![dof],
        _ => Dof::ALL
            .into_iter()
            .filter(|d| {
                runs.iter()
                    .any(|r| r.count(d.index()) + r.count(6 + d.index()) > 0)
            })
            .collect(),
    };
    let name = match choice {
        ModelChoice::Axis(dof) => dof.name().to_owned(),
        _ if rig.vehicle.model == VehicleModel::Eq1 => "eq1".to_owned(),
        _ => "decoupled".to_owned(),
    };
    let all = dofs
        .iter()
        .flat_map(|d| Coefficient::of(*d))
        .filter(|c| !options.fixed.contains(c))
        .collect();
    (all, dofs, name)
}

/// Whether a DOF neither is driven nor moves in any run beyond its noise: sinusoids fitted to noise
/// would pass for a well determined period. Slow noise may be three times what differences show.
fn rests(runs: &[Run], dof: Dof) -> bool {
    let i = dof.index();
    runs.iter().all(|r| {
        let values: Vec<f64> = r
            .samples
            .iter()
            .map(|s| s.values[i])
            .filter(|v| v.is_finite())
            .collect();
        let middle = super::statistics::median(&mut values.clone()).unwrap_or(0.0);
        let away: Vec<f64> = values.iter().map(|v| v - middle).collect();
        let quiet = robust_sd(&away) < 3.0 * difference_sd(&values);
        r.largest_wrench()[i] == 0.0 && (values.is_empty() || quiet) && r.count(6 + i) == 0
    })
}

/// Noise per slot that the logs carry from a stretch at rest: the first log that has a slot's channel.
/// Slots that are combinations of channels have none.
fn stored_noise(runs: &[Run], slots: &[String]) -> Option<Vec<Option<(Noise, f64)>>> {
    let of = |slot: &String| {
        runs.iter()
            .filter_map(|r| r.noise_at_rest.as_ref()?.get(slot))
            .map(|n| (n.noise, n.outliers))
            .find(|(noise, _)| noise.total_sd() > 0.0)
    };
    let found: Vec<Option<(Noise, f64)>> = slots.iter().map(of).collect();
    found.iter().any(Option::is_some).then_some(found)
}

/// Noise per slot of runs at rest: deviations from each run's median.
fn noise_at_rest(rest: &dyn Forward) -> Vec<Option<(Noise, f64)>> {
    let slots = rest.slots().len();
    (0..slots)
        .map(|slot| {
            let series: Vec<(Vec<f64>, Vec<f64>)> = (0..rest.runs())
                .map(|run| {
                    let values: Vec<f64> = rest
                        .measured(run)
                        .iter()
                        .skip(slot)
                        .step_by(slots)
                        .copied()
                        .collect();
                    let mut present: Vec<f64> =
                        values.iter().copied().filter(|v| v.is_finite()).collect();
                    let middle = super::statistics::median(&mut present).unwrap_or(0.0);
                    (
                        rest.times_s(run).to_vec(),
                        values.iter().map(|v| v - middle).collect(),
                    )
                })
                .collect();
            let views: Vec<Series<'_>> = series
                .iter()
                .map(|(t, v)| Series {
                    times_s: t,
                    values: v,
                    jacobian: None,
                })
                .collect();
            let (noise, used) = estimate_noise(&views)?;
            let kept = used.iter().flatten().filter(|u| **u).count() as f64;
            let present = views
                .iter()
                .flat_map(|s| s.values)
                .filter(|v| v.is_finite())
                .count() as f64;
            Some((noise, 1.0 - kept / present.max(1.0)))
        })
        .collect()
}

struct Fit<'f> {
    forward: &'f dyn Forward,
    problem: Problem<'f>,
    measured_noise: Option<Vec<Option<(Noise, f64)>>>,
    name: String,
    noises: Vec<Noise>,
    outliers: Vec<f64>,
    at: Vec<f64>,
    held: Vec<bool>,
    objective_value: f64,
    evaluations: usize,
    converged: bool,
    notes: Vec<String>,
}

impl<'f> Fit<'f> {
    fn new(
        forward: &'f dyn Forward,
        measured_noise: Option<Vec<Option<(Noise, f64)>>>,
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
        let problem = Problem::new(forward, &sds);
        let free = problem.free().len();
        if problem.samples() < 2 * free {
            return Err(IdentifyError::TooFew {
                samples: problem.samples(),
                free,
                dof: name,
            });
        }
        let at = problem.start();
        let noises = sds.into_iter().map(Noise::white).collect();
        Ok(Fit {
            forward,
            held: vec![false; at.len()],
            problem,
            measured_noise,
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
    fn search(&mut self, options: &Options<'_>) -> Result<(), IdentifyError> {
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
            return Ok(());
        }
        self.hold_unexcited()?;
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
        // Outliers may have led the first search astray: once more from where the weights are right.
        Ok(())
    }

    /// Noise and outliers from the residuals, or from rest with outliers from the residuals.
    fn reweigh(&mut self) -> Result<(), IdentifyError> {
        let (found, mut used) = self.problem.noise_of_residuals(&self.at)?;
        let slots = self.forward.slots().len();
        for slot in 0..slots {
            let at_rest = self
                .measured_noise
                .as_ref()
                .and_then(|m| m.get(slot).copied().flatten());
            if let Some((noise, _)) = at_rest {
                self.noises[slot] = noise;
                let residuals: Result<Vec<_>, _> = (0..self.forward.runs())
                    .map(|r| self.problem.raw_residuals(r, &self.at))
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

    fn sds(&self) -> Result<Vec<f64>, IdentifyError> {
        let normal = self.problem.normal(&self.at)?;
        Ok(covariance(&normal.hessian)
            .diagonal()
            .iter()
            .map(|v| v.sqrt())
            .collect())
    }

    /// Coefficients that the runs do not move go back to the rig's value and stay there.
    fn hold_unexcited(&mut self) -> Result<(), IdentifyError> {
        let sds = self.sds()?;
        for (i, free) in self.forward.globals().iter().enumerate() {
            let size = free.start.abs().max(1e-9);
            if self.held[i] || sds[i].is_nan() || sds[i] > 2.0 * size {
                self.held[i] = true;
                self.at[i] = free.start;
                self.notes.push(format!(
                    "{}: these runs do not move it; kept at the rig's {:.4}",
                    free.name, free.start
                ));
            }
        }
        Ok(())
    }

    /// Residual variance per degree of freedom of the whitened residuals.
    fn variance(&self) -> Result<(f64, f64), IdentifyError> {
        let freedom = (self.problem.samples() as f64 - self.problem.free().len() as f64).max(1.0);
        Ok((2.0 * self.problem.normal(&self.at)?.cost / freedom, freedom))
    }

    fn conclude(
        &mut self,
        runs: &[Run],
        rig: &Rig,
        coefficients: &[Coefficient],
        options: &Options<'_>,
    ) -> Result<Identification, IdentifyError> {
        let (variance, freedom) = self.variance()?;
        let mut normal = self.problem.normal(&self.at)?;
        for (i, held) in self.held.iter().enumerate() {
            if *held {
                // What is held is known no better than to its own size: carried into the others' intervals.
                normal.hessian[(i, i)] +=
                    1.0 / self.forward.globals()[i].start.abs().max(1e-9).powi(2);
            }
        }
        // Measured noise that is too small for the residuals does not make intervals narrower than they are.
        let scale = if self.measured_noise.is_some() {
            variance.max(1.0)
        } else {
            variance
        };
        let all = covariance(&normal.hessian) * scale;
        let count = coefficients.len();
        let block: DMatrix<f64> = all.view((0, 0), (count, count)).into_owned();
        let correlations = correlation(&block);
        let quantile = t95(freedom);
        let mut parameters = BTreeMap::new();
        for (i, c) in coefficients.iter().enumerate() {
            let free = &self.problem.free()[i];
            let value = self.at[i];
            let sd = block[(i, i)].sqrt();
            let excited = !self.held[i] && sd.is_finite() && sd < UNEXCITED * value.abs();
            let weak = sd.is_finite() && !self.held[i] && sd > WEAK * value.abs();
            let cheap = count <= 3;
            let profile = if weak
                && cheap
                && options.method.name() == "lm"
                && options.objective == Objective::LeastSquares
            {
                Some(profile(&self.problem, &self.at, i, sd, scale, freedom)?)
            } else {
                None
            };
            let ends = sd
                .is_finite()
                .then_some((value - quantile * sd, value + quantile * sd));
            let estimate = Estimate {
                symbol: c.symbol().to_owned(),
                unit: c.unit().to_owned(),
                value,
                sd: sd.is_finite().then_some(sd),
                low: profile.map(|p| p.low).or(ends.map(|e| e.0)),
                high: profile.map(|p| p.high).or(ends.map(|e| e.1)),
                profile,
                rig: c.of_vehicle(&rig.vehicle),
                excited,
                at_bound: !self.held[i] && (value <= free.low || value >= free.high),
            };
            if estimate.at_bound {
                self.notes.push(format!("{}: ended on its search range {:.4} .. {:.4}; the interval is not to be trusted", c.key(), free.low, free.high));
            } else if value > 0.0 && sd.is_finite() && value > 2.0 * sd {
                self.notes.push(format!("{}: {value:.4} is positive, which no hull has; something is missing from the model", c.key()));
            }
            parameters.insert(c.key().to_owned(), estimate);
        }
        let finite = |v: f64| v.is_finite().then_some(v);
        let mut result = Identification {
            model: self.name.clone(),
            method: options.method.name().to_owned(),
            objective: options.objective,
            objective_value: self.objective_value,
            evaluations: self.evaluations,
            converged: self.converged,
            parameters,
            order: coefficients.iter().map(|c| c.key().to_owned()).collect(),
            covariance: block
                .row_iter()
                .map(|r| r.iter().map(|v| finite(*v)).collect())
                .collect(),
            correlation: correlations
                .row_iter()
                .map(|r| r.iter().copied().collect())
                .collect(),
            noise: BTreeMap::new(),
            variance_ratio: variance,
            residuals: Vec::new(),
            misfit: Vec::new(),
            cross_validation: Vec::new(),
            blind_spots: Vec::new(),
            runs: Vec::new(),
            notes: self.notes.clone(),
            traces: Vec::new(),
        };
        self.describe_noise(&mut result);
        self.describe_runs(runs, &all, &mut result)?;
        self.describe_residuals(runs, &mut result)?;
        if !self.converged {
            result.notes.push("the search ended before it converged; give it another start (rig file) or --method cmaes".to_owned());
        }
        Ok(result)
    }

    fn describe_noise(&self, result: &mut Identification) {
        for (slot, name) in self.forward.slots().iter().enumerate() {
            let at_rest = self
                .measured_noise
                .as_ref()
                .and_then(|m| m.get(slot).copied().flatten())
                .is_some();
            let source = if at_rest {
                "measured at rest"
            } else {
                "residuals"
            };
            let noise = SlotNoise {
                noise: self.noises[slot],
                outliers: self.outliers[slot],
                source: source.to_owned(),
            };
            result.noise.insert(name.clone(), noise);
        }
        if self.measured_noise.is_none() {
            result.notes.push(
                "noise estimated from the residuals: what the model lacks counts as noise; a `still` run (>= 20 s at rest) measures it".to_owned(),
            );
        } else if result.variance_ratio > 1.2 {
            result.misfit.push(format!(
                "residuals are {:.1} times the noise measured at rest: the model lacks something",
                result.variance_ratio.sqrt()
            ));
        }
    }

    fn describe_runs(
        &self,
        runs: &[Run],
        all: &DMatrix<f64>,
        result: &mut Identification,
    ) -> Result<(), IdentifyError> {
        for (i, run) in runs.iter().enumerate() {
            let channels = self
                .forward
                .channels(i, &self.problem.of_run(i, &self.at))?;
            let columns = self.problem.columns(i);
            let start = self
                .forward
                .locals(i)
                .iter()
                .zip(columns.into_iter().skip(self.forward.globals().len()))
                .map(|(f, c)| {
                    let sd = all[(c, c)].sqrt();
                    let name = f
                        .name
                        .strip_prefix(&format!("{}.", run.name))
                        .unwrap_or(&f.name)
                        .to_owned();
                    (name, (self.at[c], sd.is_finite().then_some(sd)))
                })
                .collect();
            result.runs.push(RunSummary {
                name: run.name.clone(),
                samples: run.samples.len(),
                length_s: run.end_s(),
                rms: channels.iter().map(|c| (c.name.clone(), c.rms())).collect(),
                notes: run.notes.clone(),
                start,
            });
            for c in channels {
                result.traces.push(Trace {
                    run: run.name.clone(),
                    channel: c.name,
                    times_s: self.forward.times_s(i).to_vec(),
                    measured: c.measured,
                    fitted: c.predicted,
                });
            }
        }
        Ok(())
    }

    fn describe_residuals(
        &self,
        runs: &[Run],
        result: &mut Identification,
    ) -> Result<(), IdentifyError> {
        let mut worst: BTreeMap<String, (f64, String, f64, f64)> = BTreeMap::new();
        for (i, run) in runs.iter().enumerate() {
            let plain = self.problem.raw_residuals(i, &self.at)?;
            let filtered = self.problem.whitened(i, &self.at)?;
            for (slot, name) in self.forward.slots().iter().enumerate() {
                let filter = &self.problem.whiteners()[i][slot];
                let kept = |series: &[f64]| -> Vec<f64> {
                    series
                        .iter()
                        .enumerate()
                        .map(|(k, v)| if filter.counts(k) { *v } else { f64::NAN })
                        .collect()
                };
                let plain_kept = kept(&plain[slot]);
                let (sum, n) = plain_kept
                    .iter()
                    .filter(|v| v.is_finite())
                    .fold((0.0, 0usize), |(s, n), v| (s + v * v, n + 1));
                let entry = Residuals {
                    run: run.name.clone(),
                    slot: name.clone(),
                    rms: (sum / n.max(1) as f64).sqrt(),
                    plain: ljung_box(&plain_kept, LAGS),
                    filtered: ljung_box(&kept(&filtered[slot]), LAGS),
                };
                if let Some(w) = entry.plain.filter(|w| w.p_value < NOT_WHITE) {
                    let before = worst.get(name).map_or(f64::INFINITY, |w| w.0);
                    if w.p_value <= before {
                        worst.insert(
                            name.clone(),
                            (w.p_value, run.name.clone(), w.lag1, entry.rms),
                        );
                    }
                }
                result.residuals.push(entry);
            }
        }
        for (slot, (p, run, lag1, rms)) in worst {
            result.misfit.push(format!(
                "{slot}: residuals are far from white (worst run {run}: Ljung-Box p = {p:.1e}, neighbours correlate {lag1:.2}, rms {rms:.3e}); either the noise is coloured or the model lacks something: hydroline diagnose"
            ));
        }
        Ok(())
    }
}

type Make<'a> = dyn Fn(&[Run], &[Coefficient]) -> Result<Box<dyn Forward>, IdentifyError> + 'a;

/// Each run predicted with coefficients fitted to the others; only its own start is fitted to it.
fn cross_validate(
    runs: &[Run],
    full: &Identification,
    fit: &Fit<'_>,
    make: &Make<'_>,
    coefficients: &[Coefficient],
) -> Result<Vec<CrossValidation>, IdentifyError> {
    let globals = coefficients.len();
    let mut out = Vec::new();
    for left in 0..runs.len() {
        let others: Vec<Run> = runs
            .iter()
            .enumerate()
            .filter(|(i, _)| *i != left)
            .map(|(_, r)| r.clone())
            .collect();
        let training = make(&others, coefficients)?;
        let mut problem = Problem::new(training.as_ref(), &vec![1.0; training.slots().len()]);
        problem.set_noise(&fit.noises, |run, slot, k| {
            let original = run + usize::from(run >= left);
            fit.problem.whiteners()[original][slot].counts(k)
        });
        let mut start: Vec<f64> = fit.at[..globals].to_vec();
        for run in (0..runs.len()).filter(|r| *r != left) {
            start.extend(fit.problem.of_run(run, &fit.at).into_iter().skip(globals));
        }
        let mut held = vec![false; start.len()];
        held[..globals].copy_from_slice(&fit.held[..globals]);
        let trained = lm::least_squares(&problem, start, &held)?;
        let alone = make(std::slice::from_ref(&runs[left]), coefficients)?;
        let mut own = Problem::new(alone.as_ref(), &vec![1.0; alone.slots().len()]);
        own.set_noise(&fit.noises, |_, slot, k| {
            fit.problem.whiteners()[left][slot].counts(k)
        });
        let mut start = trained.parameters[..globals].to_vec();
        start.extend(fit.problem.of_run(left, &fit.at).into_iter().skip(globals));
        let held: Vec<bool> = (0..start.len()).map(|i| i < globals).collect();
        let predicted = lm::least_squares(&own, start, &held)?;
        let channels = alone.channels(0, &predicted.parameters)?;
        out.push(CrossValidation {
            run: runs[left].name.clone(),
            left_out: channels.iter().map(|c| (c.name.clone(), c.rms())).collect(),
            fitted: full
                .runs
                .get(left)
                .map(|r| r.rms.clone())
                .unwrap_or_default(),
        });
    }
    Ok(out)
}

/// Names of the measured channels of a run, for messages.
pub fn measured_channels(run: &Run) -> Vec<&'static str> {
    (0..12)
        .filter(|c| run.count(*c) > 0)
        .map(|c| CHANNELS[c])
        .collect()
}
