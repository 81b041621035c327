//! Cases of surge, sway and yaw at once.

use std::collections::BTreeMap;

use hydroline_core::run::{Channel, Command, PerChannel};
use hydroline_rigs::{Dof, ParameterValue, PhysicsEntry, Rig};
use rand::rngs::StdRng;

use super::make::{Beyond, HIDDEN, Held, HeldOutCase, Kind, LOADS, Place, TRIES, rms_between};
use super::surge::none;
use crate::benchmark::coupled::{self, CoupledCase, Measured, commands, motion};
use crate::benchmark::error::ProveError;
use crate::benchmark::magnitudes::between;

/// DOFs that are driven.
const DRIVEN: [Dof; 3] = [Dof::Surge, Dof::Sway, Dof::Yaw];
/// Least change of the run held out by the mechanism, over its noise: at three times the loads the coefficients of three DOFs leave some
/// ten noises open.
const SHOWN_COUPLED: f64 = 100.0;
/// Loads of a run inside, over those that are drawn for the runs fitted.
const INSIDE: f64 = 0.8;

/// Loads of some commands, DOF by DOF so many times as large.
fn times(mut all: Vec<Command>, factor: [f64; 6]) -> Vec<Command> {
    for c in &mut all {
        for (load, factor) in c.wrench.iter_mut().zip(factor) {
            *load *= factor;
        }
    }
    all
}

fn largest(all: &[Command]) -> [f64; 6] {
    all.iter().fold([0.0; 6], |m, c| {
        std::array::from_fn(|d| f64::max(m[d], c.wrench[d].abs()))
    })
}

fn held(measured: Measured) -> Held {
    let run = &measured.source.run;
    let noise = PerChannel::from_fn(|c| {
        let pairs = run.samples.iter().zip(&measured.motion);
        let sound = pairs.zip(&measured.is_outlier);
        let sound = sound.filter(|(_, out)| c != Channel::X || !**out);
        let squares = sound.map(|((s, m), _)| (s.values[c] - m[c]).powi(2));
        let (sum, count) = squares.fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
        (sum / f64::max(count, 1.0)).sqrt()
    });
    // What is not measured has no noise, and no truth that anyone is asked for.
    let seen = |m: &PerChannel<f64>| {
        PerChannel::from_fn(|c| if noise[c].is_finite() { m[c] } else { f64::NAN })
    };
    Held {
        truth: measured.motion.iter().map(seen).collect(),
        noise,
        source: measured.source,
    }
}

/// A mechanism that small loads do not show, in one DOF: a limit beyond them, or a drag that grows with the cube of the rate.
fn hidden(nth: usize, top: &[f64; 6], rng: &mut StdRng) -> (PhysicsEntry, String) {
    let dof = DRIVEN[nth / 2 % DRIVEN.len()];
    // As `drawn` has it: what resists per unit of a rate is as large in sway as in surge, and a twentieth in yaw.
    let damping = if dof == Dof::Yaw { 0.05 } else { 1.0 };
    let (effect, number, value) = match nth % 2 {
        0 => (
            "thruster_saturation",
            "limit_n",
            top[dof.index()] * between(rng, 1.1, 1.8),
        ),
        _ => (
            "cubic_damping",
            "d3",
            2000.0 * damping * 10f64.powf(between(rng, -2.5, -0.7)),
        ),
    };
    let made = PhysicsEntry {
        effect: effect.to_owned(),
        parameters: vec![
            (number.to_owned(), ParameterValue::Number(value)),
            (
                "dof".to_owned(),
                ParameterValue::Word(dof.name().to_owned()),
            ),
        ],
    };
    (made, format!("{effect} {}", dof.name()))
}

/// Largest difference of the runs fitted with and without a mechanism, over the tolerance; `None` where a motion is not finite.
fn shown_when_fitted(
    base: &CoupledCase,
    water: &Rig,
    fitted: &[Measured],
) -> Result<Option<f64>, ProveError> {
    let tolerance = base.rig.tolerance.channels();
    let mut most = 0.0_f64;
    for run in fitted {
        let samples = &run.source.run.samples;
        let stamps_s: Vec<f64> = samples.iter().map(|s| s.t_s).collect();
        let commands = &run.source.run.commands;
        let without = motion(&base.water, commands, &stamps_s)?;
        let Some((without, with)) = without.zip(motion(water, commands, &stamps_s)?) else {
            return Ok(None);
        };
        let off = rms_between(&without, &with);
        let is_measured = |c: Channel| samples.iter().any(|s| s.values[c].is_finite());
        let each = off.each().filter(|(c, _)| is_measured(*c));
        most = each.map(|(c, v)| v / tolerance[c]).fold(most, f64::max);
    }
    Ok(Some(most))
}

/// A run at three times the loads, of a vehicle with a mechanism that those fitted do not show.
pub(super) fn missed(place: &Place, rng: &mut StdRng) -> Result<HeldOutCase, ProveError> {
    let mut last = String::new();
    // An even number has no effects.
    let base = coupled::make(place.seed, 2 * place.nth)?;
    let plans: Vec<Vec<Command>> = base
        .sources
        .iter()
        .map(|s| s.run.commands.clone())
        .collect();
    let top = largest(&plans.concat());
    for _ in 0..TRIES {
        let (mechanism, name) = hidden(place.nth, &top, rng);
        let mut water = base.water.clone();
        water.physics.push(mechanism);
        let mut fitted = Vec::new();
        for (k, plan) in plans.iter().enumerate() {
            fitted.extend(base.record(&water, &format!("run{k}"), plan.clone(), rng)?);
        }
        let beyond = commands(rng);
        let own = largest(&beyond);
        let beyond = times(
            beyond,
            std::array::from_fn(|d| LOADS * top[d] / own[d].max(1e-9)),
        );
        let run = base.record(&water, "beyond", beyond, rng)?;
        let (Some(run), true) = (run, fitted.len() == plans.len()) else {
            last = "no finite motion".to_owned();
            continue;
        };
        let Some(when_fitted) = shown_when_fitted(&base, &water, &fitted)? else {
            last = "no finite motion".to_owned();
            continue;
        };
        let held = held(run);
        let shown = held
            .missed_by(&base.water, &BTreeMap::new(), true)?
            .over_noise;
        if when_fitted > HIDDEN || shown.is_some_and(|s| s < SHOWN_COUPLED) {
            last = format!(
                "{:.1} noises held out, {when_fitted:.2} tolerances fitted",
                shown.unwrap_or(f64::INFINITY)
            );
            continue;
        }
        return Ok(HeldOutCase {
            index: place.index,
            is_coupled: true,
            kind: Kind::Missed,
            beyond: Some(Beyond::Loads),
            there: vec![name],
            sources: fitted.into_iter().map(|m| m.source).collect(),
            held,
            rig: base.rig,
        });
    }
    Err(none(place, last))
}

/// A run within those fitted, of a vehicle as the coupled cases draw it.
pub(super) fn inside(place: &Place, rng: &mut StdRng) -> Result<HeldOutCase, ProveError> {
    // Without the rigs that are off by a factor: every fourth.
    let base = coupled::make(place.seed, place.nth + place.nth / 3)?;
    for _ in 0..TRIES {
        let plan = times(commands(rng), [INSIDE; 6]);
        let Some(run) = base.record(&base.water, "inside", plan, rng)? else {
            continue;
        };
        return Ok(HeldOutCase {
            index: place.index,
            is_coupled: true,
            kind: Kind::Inside,
            beyond: None,
            there: base.truth.iter().map(|t| t.name.clone()).collect(),
            held: held(run),
            sources: base.sources,
            rig: base.rig,
        });
    }
    Err(none(place, "no finite motion".to_owned()))
}
