//! Effects that the profiles show, as entries of the verdict and of the rig file.

use super::super::candidate::Candidate;
use super::super::fit::{Fitted, Free, Problem, State};
use super::super::model::Kind;
use super::super::search::{ANY_PX, ASTRAY_PX, Searched};
use super::CHANNELS;
use crate::verdict::{Effect, Law, Value};
use hydroline_rigs::{ParameterValue, PhysicsEntry, Rig};
use hydroline_sim::effect::EffectInfo;
use std::collections::BTreeMap;

/// Effects that do as well in the place of the best's effect `e`, all others as they are.
pub(super) fn instead(
    candidates: &[Candidate],
    best: &Fitted,
    tied: &[&Fitted],
    e: usize,
) -> Vec<String> {
    let rest = || best.effects.iter().filter(|o| **o != e);
    tied.iter()
        .filter(|t| t.effects.len() == best.effects.len() && !t.effects.contains(&e))
        .filter(|t| rest().all(|r| t.effects.contains(r)))
        .filter_map(|t| t.effects.iter().find(|o| !best.effects.contains(o)))
        .map(|o| candidates[*o].info.id.to_owned())
        .collect()
}

/// Weight of an effect in its heaviest channel, in units of the tolerance.
pub(super) fn heaviness(e: &Effect, rig: &Rig) -> f64 {
    e.weight
        .iter()
        .map(|(c, w)| w / tolerance(c, rig))
        .fold(0.0, f64::max)
}

fn tolerance(channel: &str, rig: &Rig) -> f64 {
    if channel.ends_with("_rad") {
        rig.tolerance.attitude_rad
    } else {
        rig.tolerance.position_m
    }
}

/// rms by which poses differ, per channel.
pub(super) fn shift(with: &State, without: &State) -> [f64; 6] {
    let pairs = || {
        with.poses
            .iter()
            .flatten()
            .zip(without.poses.iter().flatten())
    };
    let n = pairs().count().max(1) as f64;
    std::array::from_fn(|d| (pairs().map(|(a, b)| (a[d] - b[d]).powi(2)).sum::<f64>() / n).sqrt())
}

/// The best explanation's effect number `k`, candidate `e`.
pub(super) fn effect(
    problem: &Problem<'_>,
    candidates: &[Candidate],
    found: &Searched,
    best: &Fitted,
    k: usize,
    e: usize,
) -> Effect {
    let rest: Vec<usize> = best.effects.iter().copied().filter(|o| *o != e).collect();
    let without = found
        .all
        .iter()
        .find(|f| f.effects.len() == rest.len() && rest.iter().all(|r| f.effects.contains(r)));
    let moved = match without.filter(|f| f.rms_px(Kind::Row) < ASTRAY_PX) {
        Some(f) => shift(&best.state, &f.state),
        None => {
            // Without it the stripe is so far off that most of it would pass for stray: to begin
            // with, nothing is.
            let mut begin = best.state.clone();
            begin.numbers.remove(k);
            begin.floors = ANY_PX;
            let fit = problem.fit(candidates, &rest, begin, Free::All);
            fit.map_or([f64::NAN; 6], |f| shift(&best.state, &f.state))
        }
    };
    let info = candidates[e].info;
    let numbers = best.state.numbers.get(k).map_or(&[][..], Vec::as_slice);
    let sds = best.sds.get(k).map_or(&[][..], Vec::as_slice);
    described(problem.rig, info, numbers, sds, moved, found.probability(e))
}

pub(super) fn described(
    rig: &Rig,
    info: &EffectInfo,
    numbers: &[f64],
    sds: &[f64],
    moved: [f64; 6],
    probability: f64,
) -> Effect {
    let weight: BTreeMap<String, f64> = CHANNELS
        .iter()
        .zip(moved)
        .filter(|(_, w)| w.is_finite())
        .map(|(c, w)| ((*c).to_owned(), w))
        .collect();
    let notes = info
        .parameters
        .iter()
        .zip(numbers)
        .filter(|(p, v)| **v < p.plausible.0 || **v > p.plausible.1)
        .map(|(p, v)| {
            format!(
                "{} = {v:.5} lies outside of {} .. {}",
                p.name, p.plausible.0, p.plausible.1
            )
        })
        .collect();
    Effect {
        effect: info.id.to_owned(),
        words: BTreeMap::new(),
        dof: None,
        probability,
        established: probability >= crate::verdict::ESTABLISHED,
        matters: weight.iter().any(|(c, w)| *w > tolerance(c, rig)),
        weight,
        law: Law::Exact,
        law_exact_probability: None,
        law_note: None,
        or: Vec::new(),
        parameters: info
            .parameters
            .iter()
            .zip(numbers.iter().zip(sds))
            .map(|(p, (v, s))| {
                (
                    p.name.to_owned(),
                    Value {
                        value: *v,
                        sd: Some(*s).filter(|s| s.is_finite()),
                    },
                )
            })
            .collect(),
        notes,
    }
}

pub(super) fn entry(info: &EffectInfo, numbers: &[f64]) -> PhysicsEntry {
    PhysicsEntry {
        effect: info.id.to_owned(),
        parameters: info
            .parameters
            .iter()
            .zip(numbers)
            .map(|(p, v)| (p.name.to_owned(), ParameterValue::Number(*v)))
            .collect(),
    }
}
