//! The vehicle alone by plain least squares, with the means of `identify`: its models, its Levenberg-Marquardt, no priors.
//!
//! Every channel counts in units of what it leaves, as it does for `before`; outliers are those that the key knows.

use std::collections::BTreeMap;

use hydroline_core::run::{Channel, Run};
use hydroline_diagnose::verdict::Verdict;
use hydroline_identify::IdentifyError;
use hydroline_identify::axis::Axis;
use hydroline_identify::coupled::Coupled;
use hydroline_identify::data::Start;
use hydroline_identify::forward::Forward;
use hydroline_identify::lm::{LevenbergMarquardt, least_squares};
use hydroline_identify::method::Method;
use hydroline_identify::parameter::Coefficient;
use hydroline_identify::problem::{Objective, Problem};
use hydroline_numerics::noise::Noise;
use hydroline_rigs::{Rig, Vehicle};

use super::base::Base;

/// Fits, each with the noise that the one before left.
const ROUNDS: usize = 8;
/// Change of a misfit's logarithm below which its noise stays.
const SAME: f64 = 1e-3;
/// Stamps are read to a nanosecond \[s\].
const SAME_STAMP_S: f64 = 1e-6;

/// A fit under way.
struct Plain<'a> {
    problem: Problem<'a>,
    forward: &'a dyn Forward,
    /// Per run and sample: x is an outlier.
    is_outlier: Vec<Vec<bool>>,
}

/// Whether a sample counts, of a slot by its name.
fn is_used(slot: &str, is_outlier: bool) -> bool {
    slot != Channel::X.name() || !is_outlier
}

impl Plain<'_> {
    /// rms that a point leaves, slot by slot; NaN where nothing is measured.
    fn left(&self, at: &[f64]) -> Result<Vec<f64>, IdentifyError> {
        let slots = self.forward.slots().len();
        let mut sums = vec![(0.0, 0usize); slots];
        for run in 0..self.forward.runs() {
            for (slot, series) in self.problem.raw_residuals(run, at)?.iter().enumerate() {
                let name = &self.forward.slots()[slot];
                for (v, is_outlier) in series.iter().zip(&self.is_outlier[run]) {
                    if v.is_finite() && is_used(name, *is_outlier) {
                        sums[slot].0 += v * v;
                        sums[slot].1 += 1;
                    }
                }
            }
        }
        let rms = |(sum, count): (f64, usize)| match count {
            0 => f64::NAN,
            n => (sum / n as f64).sqrt(),
        };
        Ok(sums.into_iter().map(rms).collect())
    }

    /// Weighs every slot with white noise as large as what it leaves.
    fn weigh(&mut self, left: &[f64]) {
        let noises: Vec<Noise> = left
            .iter()
            .map(|sd| Noise::white(if *sd > 0.0 { *sd } else { 1.0 }))
            .collect();
        let (forward, is_outlier) = (self.forward, &self.is_outlier);
        self.problem.set_noise(&noises, |run, slot, k| {
            is_used(&forward.slots()[slot], is_outlier[run][k])
        });
    }

    /// Fits, from these weights on: rms by slot.
    fn fitted(mut self, mut left: Vec<f64>) -> Result<Vec<f64>, IdentifyError> {
        self.weigh(&left);
        let search = LevenbergMarquardt { starts: 1 };
        let mut at = search
            .minimise(&self.problem, Objective::LeastSquares, 1)?
            .parameters;
        let held = vec![false; at.len()];
        for _ in 0..ROUNDS {
            let now = self.left(&at)?;
            let changes = now.iter().zip(&left).map(|(a, b)| (a / b).ln().abs());
            let change = changes.filter(|c| c.is_finite()).fold(0.0, f64::max);
            left = now;
            if change < SAME {
                break;
            }
            self.weigh(&left);
            at = least_squares(&self.problem, at, &held)?.parameters;
        }
        Ok(left)
    }
}

/// Coefficients that a diagnosis fits of the vehicle alone.
fn coefficients(verdict: &Verdict) -> Vec<Coefficient> {
    let keys = verdict.parameters.before.keys();
    keys.filter_map(|k| Coefficient::find(k)).collect()
}

/// rms that the vehicle alone leaves by plain least squares, channel by channel; the same coefficients are free as for the diagnosis.
/// With several channels there is more than one minimum: begun from the vehicle as it is and from what the diagnosis found, the one that
/// leaves least counts, all channels together.
///
/// # Errors
/// [`IdentifyError`].
pub fn left(base: &Base, verdict: &Verdict) -> Result<BTreeMap<String, f64>, IdentifyError> {
    let free = coefficients(verdict);
    let mut found = base.vehicle.clone();
    for c in &free {
        if let Some(value) = verdict.parameters.before.get(c.key()) {
            c.put(&mut found, value.value);
        }
    }
    let before = &verdict.fit.train.before;
    let own = left_from(base, &free, &base.vehicle, &BTreeMap::new())?;
    let theirs = left_from(base, &free, &found, before)?;
    // As the logarithm of the likelihood has it; NaN = not measured.
    let size = |left: &BTreeMap<String, f64>| -> f64 {
        let logarithms = left.values().map(|v| v.ln());
        logarithms.filter(|v| v.is_finite()).sum()
    };
    Ok(match size(&theirs) < size(&own) {
        true => theirs,
        false => own,
    })
}

/// The same from a vehicle and from weights on: rms by channel, those at the start where they are not given.
fn left_from(
    base: &Base,
    free: &[Coefficient],
    from: &Vehicle,
    weights: &BTreeMap<String, f64>,
) -> Result<BTreeMap<String, f64>, IdentifyError> {
    // A rig that is off by a factor has the minimum outside of its search's ranges.
    let rig = Rig {
        vehicle: from.clone(),
        physics: Vec::new(),
        ..base.rig.clone()
    };
    let runs: Vec<Run> = base.given.iter().map(|g| g.source.run.clone()).collect();
    let is_one = free.iter().all(|c| c.dof == free[0].dof);
    let forward: Box<dyn Forward> = match free.first() {
        Some(first) if is_one => {
            Box::new(Axis::new(&runs, &rig.vehicle, first.dof, free, Start::Free))
        }
        _ => Box::new(Coupled::new(&runs, &rig, free, Start::Free, false)?),
    };
    let is_outlier = base.given.iter().enumerate().map(|(run, given)| {
        let times_s = forward.times_s(run).iter();
        let of = |t: &f64| {
            let mut outliers_s = given.outliers_s.iter();
            outliers_s.any(|o| (o - t).abs() < SAME_STAMP_S)
        };
        times_s.map(of).collect()
    });
    let plain = Plain {
        is_outlier: is_outlier.collect(),
        problem: Problem::new(forward.as_ref(), &vec![1.0; forward.slots().len()]),
        forward: forward.as_ref(),
    };
    let at_start = plain.left(&plain.problem.start())?;
    let pairs = forward.slots().iter().zip(at_start);
    let first = pairs.map(|(slot, rms)| weights.get(slot).copied().unwrap_or(rms));
    let left = plain.fitted(first.collect())?;
    Ok(forward.slots().iter().cloned().zip(left).collect())
}
