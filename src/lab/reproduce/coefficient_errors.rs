//! Three coefficients, identified in each of many experiments, and their errors.

use hydroline_core::run::Run;
use hydroline_estimate::{ModelChoice, Options, identify};
use hydroline_identify::parameter::Coefficient;
use hydroline_numerics::parallel;
use hydroline_rigs::{Dof, Rig};

use super::ReproduceError;
use super::experiment::{Experiment, Seen};
use crate::search::axis::Start;
use crate::search::paper_fit::paper_fit;

/// Estimators of one experiment, in the order of their outcomes.
pub(super) const ESTIMATORS: [&str; 2] = ["paper", "joint"];

/// Outcomes of the experiments 1 to `seeds` under each of the `chosen` conditions, condition by condition.
pub(super) fn by_condition<C: Copy + Sync, O: Send>(
    chosen: &[C],
    seeds: u64,
    one: impl Fn(C, u64) -> Result<O, ReproduceError> + Sync,
) -> Result<Vec<(C, Vec<O>)>, ReproduceError> {
    let all: Vec<(C, u64)> = chosen
        .iter()
        .flat_map(|c| (1..=seeds).map(move |seed| (*c, seed)))
        .collect();
    let mut found = parallel::try_map_slice(&all, |(c, s)| one(*c, *s))?.into_iter();
    Ok(chosen
        .iter()
        .map(|c| (*c, (1..=seeds).map_while(|_| found.next()).collect()))
        .collect())
}

/// Estimate of coefficients from positions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Estimator {
    /// The paper's objective (Eq. 10), every start known.
    Paper,
    /// The likelihood of `identify`, from rest; the place at the start is free.
    Likelihood,
}

/// Three coefficients as one experiment identified them, in SI.
#[derive(Clone, Copy)]
pub(super) struct Identified {
    pub values: [f64; 3],
    pub sds: [f64; 3],
}

impl Identified {
    /// Identifies the coefficients of `dof` from one estimator's `positions` in the runs of an experiment.
    pub fn from_positions(
        dof: Dof,
        guess: &Rig,
        runs: &[Experiment; 2],
        seen: &[Seen],
        positions: impl Fn(&Seen) -> &Vec<f64>,
        estimator: Estimator,
    ) -> Result<Identified, ReproduceError> {
        let data: Vec<Run> = runs
            .iter()
            .zip(seen)
            .map(|(r, s)| r.run(s, positions(s)))
            .collect();
        if estimator == Estimator::Paper {
            let found = paper_fit(&data, &guess.vehicle, dof, Start::AtRestFromZero)?;
            return Ok(Identified {
                values: found.values,
                sds: found.sds,
            });
        }
        let options = Options {
            model: ModelChoice::Axis(dof),
            from_rest: true,
            cross_validate: false,
            budget: false,
            ..Options::default()
        };
        let found = identify(&data, guess, &options)?;
        let keys = Coefficient::of(dof).map(Coefficient::key);
        let sd = |k: &str| found.parameters.get(k).and_then(|p| p.sd);
        Ok(Identified {
            values: keys.map(|k| found.value(k).unwrap_or(f64::NAN)),
            sds: keys.map(|k| sd(k).unwrap_or(f64::NAN)),
        })
    }
}

/// Errors of the coefficients, each over all experiments.
pub(super) struct CoefficientErrors {
    /// Mean error \[% of the actual\].
    pub mean_percent: [f64; 3],
    pub rms_percent: [f64; 3],
    /// rms of the reported standard deviations \[%\].
    pub sd_percent: [f64; 3],
    /// Largest error in units of its own reported sd.
    pub worst_in_sd: [f64; 3],
}

impl CoefficientErrors {
    pub fn of(actual: [f64; 3], found: &[Identified]) -> CoefficientErrors {
        let n = found.len().max(1) as f64;
        let percent =
            |i: &Identified, k: usize| 100.0 * (i.values[k] - actual[k]) / actual[k].abs();
        let rms = |f: &dyn Fn(&Identified) -> f64| {
            (found.iter().map(|i| f(i).powi(2)).sum::<f64>() / n).sqrt()
        };
        let three = |f: &dyn Fn(usize) -> f64| -> [f64; 3] { std::array::from_fn(f) };
        CoefficientErrors {
            mean_percent: three(&|k| found.iter().map(|i| percent(i, k)).sum::<f64>() / n),
            rms_percent: three(&|k| rms(&|i| percent(i, k))),
            sd_percent: three(&|k| rms(&|i| 100.0 * i.sds[k] / actual[k])),
            worst_in_sd: three(&|k| {
                let in_sd = |i: &Identified| ((i.values[k] - actual[k]) / i.sds[k]).abs();
                found.iter().map(in_sd).fold(0.0, f64::max)
            }),
        }
    }
}
