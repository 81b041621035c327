//! Logs of two clocks: a latency that the offset between them could be is not named.
//!
//! A command that acts later and a clock that is off by as much make the same motion. Where the offset was estimated from
//! that motion, every latency is in it already; where it was measured, a latency within its uncertainty may be none.

use hydroline_core::run::{Joined, Run};
use hydroline_rigs::Rig;

use crate::verdict::{Value, Verdict, Word};

/// Sds of the difference within which a latency may be the offset.
const SDS: f64 = 3.0;

/// Effects that are a fixed difference of time.
const LATENCIES: [&str; 2] = ["command_latency", "camera_latency"];
/// Effects that are differences of time, the parameter that says which, and how well the joining knows the same.
type Known = (&'static str, &'static str, fn(&Joined) -> f64);
const TIMES: [Known; 3] = [
    (LATENCIES[0], "delay_s", |j| j.offset_sd_s),
    (LATENCIES[1], "delay_s", |j| j.offset_sd_s),
    ("clock_drift", "drift_ppm", |j| j.drift_sd_ppm),
];

/// Whether a difference of time may be that of the joined clocks.
fn may_be_the_offset(value: Value, known_sd: f64, is_estimated: bool) -> bool {
    is_estimated
        || (known_sd > 0.0 && value.value.abs() <= SDS * known_sd.hypot(value.sd.unwrap_or(0.0)))
}

/// Takes such effects out of what the verdict names; their ids.
pub(crate) fn withhold(verdict: &mut Verdict, runs: &[Run]) -> Vec<&'static str> {
    // One run of one clock tells a latency from the others' offsets.
    let commanded = runs.iter().filter(|r| !r.commands.is_empty());
    let joined: Option<Vec<Joined>> = commanded.map(|r| r.joined).collect();
    let Some(joined) = joined.filter(|j| !j.is_empty()) else {
        return Vec::new();
    };
    let is_estimated = joined.iter().any(|j| j.is_estimated);
    let mut withheld = Vec::new();
    for (id, parameter, known) in TIMES {
        let known_sd = joined.iter().map(known).fold(0.0, f64::max);
        let found = verdict.effects.iter().find(|e| e.effect == id);
        let value = found.and_then(|e| e.parameters.get(parameter)).copied();
        let in_sets = verdict.equivalent.iter().flatten().any(|e| e == id);
        let may_be = match value {
            Some(value) => may_be_the_offset(value, known_sd, is_estimated),
            None => in_sets && (is_estimated || known_sd > 0.0),
        };
        if !may_be {
            continue;
        }
        withheld.push(id);
        let size = value.map_or(String::new(), |v| {
            format!(
                " of {parameter} = {:.4} (sd {:.4})",
                v.value,
                v.sd.unwrap_or(0.0)
            )
        });
        verdict.notes.push(if is_estimated {
            format!("a difference of time{size} between commands and motion is not named {id}: the offset of the joined logs was estimated from the same motion, and it may be that; measure the offset (join --offset-s, --offset-sd-s) to distinguish them")
        } else {
            format!("a difference of time{size} between commands and motion is not named {id}: it is within {SDS} sd of what the offset of the joined logs may be ({known_sd})")
        });
        verdict.cannot_show(id);
    }
    if withheld.is_empty() {
        if is_estimated {
            for id in LATENCIES {
                verdict.cannot_show(id);
            }
            verdict.notes.push("the offset of the joined logs was estimated from this motion and holds every latency: measure it (join --offset-s, --offset-sd-s) to know one".to_owned());
        }
        return withheld;
    }
    let out = |id: &String| withheld.contains(&id.as_str());
    verdict.effects.retain(|e| !out(&e.effect));
    verdict.candidates.retain(|c| !out(&c.effect));
    for set in &mut verdict.equivalent {
        set.retain(|e| !out(e));
    }
    let mut seen: Vec<Vec<String>> = Vec::new();
    verdict.equivalent.retain(|set| {
        let is_new = !seen.contains(set);
        seen.push(set.clone());
        is_new
    });
    for e in &mut verdict.effects {
        e.or.retain(|o| !withheld.contains(&o.as_str()));
    }
    let matters = verdict.effects.iter().any(|e| e.matters);
    if verdict.verdict == Word::Ambiguous && verdict.equivalent.len() == 1 {
        verdict.equivalent.clear();
        verdict.verdict = Word::Named;
    }
    if verdict.verdict == Word::Named && !matters {
        verdict.verdict = Word::None;
    }
    withheld
}

/// Takes them out of the rig that is written, unless it had them before.
pub(crate) fn take_out(withheld: &[&str], before: &Rig, rig: &mut Rig) {
    let had = |id: &str| before.physics.iter().any(|e| e.effect == id);
    rig.physics
        .retain(|e| had(&e.effect) || !withheld.contains(&e.effect.as_str()));
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::verdict::{Effect, Law};
    use hydroline_core::run::Command;

    fn found(delay_s: f64) -> Verdict {
        let effect = |id: &str, parameter: &str, value| Effect {
            effect: id.to_owned(),
            words: Default::default(),
            dof: None,
            probability: 1.0,
            established: true,
            weight: Default::default(),
            matters: true,
            law: Law::Exact,
            law_exact_probability: None,
            law_note: None,
            parameters: [(
                parameter.to_owned(),
                Value {
                    value,
                    sd: Some(0.002),
                },
            )]
            .into(),
            or: Vec::new(),
            notes: Vec::new(),
        };
        Verdict {
            verdict: Word::Named,
            effects: vec![
                effect("command_latency", "delay_s", delay_s),
                effect("tether_spring", "stiffness_npm", 2.0),
            ],
            ..Verdict::default()
        }
    }

    fn run(joined: Option<Joined>) -> Run {
        Run {
            commands: vec![Command {
                t_s: 0.0,
                wrench: [1.0; 6],
            }],
            joined,
            ..Run::default()
        }
    }

    #[test]
    fn a_latency_that_the_offset_could_be_is_not_named() {
        let joined = |is_estimated, offset_sd_s| {
            Some(Joined {
                is_estimated,
                offset_sd_s,
                drift_sd_ppm: 0.0,
            })
        };
        for (runs, named) in [
            (vec![run(None)], true),
            (vec![run(joined(true, 0.001))], false),
            (vec![run(joined(false, 0.0))], true),
            (vec![run(joined(false, 0.004))], true),
            (vec![run(joined(false, 0.03))], false),
            // Another run is of one clock.
            (vec![run(joined(true, 0.001)), run(None)], true),
        ] {
            let mut verdict = found(0.08);
            let withheld = withhold(&mut verdict, &runs);
            let is_named = verdict
                .effects
                .iter()
                .any(|e| e.effect == "command_latency");
            assert_eq!(is_named, named, "{:?}", runs[0].joined);
            assert_eq!(withheld.is_empty(), named);
            // An effect that is no difference of time stays.
            assert_eq!(verdict.verdict, Word::Named);
            assert!(verdict.effects.iter().any(|e| e.effect == "tether_spring"));
        }
    }
}
