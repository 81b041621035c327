//! The verdict by one likelihood over all DOFs (`hydroline_inference`): logs to posterior, posterior to words.
//!
//! All logs given are fitted, in any order: they are sorted by their content first, so that not even rounding depends on
//! it. Runs held out are predicted and not fitted.

mod ablation;
mod discrepancy;
mod earned;
mod effects;
mod found;
mod giving;
mod held_out;
mod implausible;
mod inputs;
pub mod next;
mod outside;
mod place;
mod posterior;
mod shown;
mod unearned;
mod words;
mod written;

use std::collections::BTreeMap;
use std::ops::ControlFlow;

use hydroline_rigs::{Dof, Rig};

use super::Beside;
use super::conclude::{DiagnoseError, Diagnosis, stopped_by_faults};
use super::joined;
use super::single_run_split::stretches;
use super::source::Source;
use super::verdict::{DataFault, NoiseFound, Verdict, Word};
use found::Judged;
use giving::Asking;
use hydroline_core::run::{Channel, Run};
use hydroline_identify::data::{is_still, memory_s, stretched};
use hydroline_inference::at_rest::AtRest;
use hydroline_inference::by_prediction::decide_by_prediction;
use hydroline_inference::closed::closed;
use hydroline_inference::fit::Problem;
use hydroline_inference::limit::Watch;
use hydroline_inference::posterior::Posterior;
use hydroline_inference::recording::Recording;
use hydroline_inference::search::Options;
use inputs::Inputs;
use unearned::take_out_unearned;

/// Faults of a channel that does not change.
const STANDING: [&str; 2] = ["dead_channel", "stuck_channel"];

/// Note where the simulation error decides.
const BY_SQUARES: &str = "decided by the simulation error: a random force or a table follows whatever laws leave of these runs; probabilities count as many samples as are independent";

/// Share of the time under a limit that the search of the models may take.
const SEARCH_SHARE: f64 = 0.6;

/// Work on the next run that a limit leaves open.
const NEXT_RUN: &str = "the plan of the next run";

/// Diagnoses logs against a rig; `held` are predicted only. Once the limit is over, what the verdict can do without is left open.
///
/// # Errors
/// [`DiagnoseError`].
pub fn diagnose(
    sources: &[Source],
    held: &[Source],
    rig: &Rig,
    beside: &Beside<'_>,
    watch: Watch<'_>,
) -> Result<Diagnosis, DiagnoseError> {
    let sources = &*Source::joined(sources);
    let still = [rig.tolerance.position_m, rig.tolerance.attitude_rad];
    let memory_s = memory_s(&rig.vehicle);
    let apart = |all: &[Source]| -> Vec<Run> {
        let runs = all.iter().flat_map(|s| s.run.stretches(memory_s));
        runs.collect()
    };
    let mut runs = apart(sources);
    // A model fitted to all of one recording has nothing left to predict: the recording's quarters are runs of their own.
    if let ([one], []) = (runs.as_slice(), held)
        && let Some(parts) = stretches(one)
    {
        runs = parts.into();
    }
    let (resting, moving): (Vec<Run>, Vec<Run>) =
        runs.into_iter().partition(|r| is_still(r, still));
    let mut runs = moving;
    runs.sort_by_key(|r| (r.start_ns, r.samples.len(), digest(r), r.name.clone()));
    let recording = Recording::new(&runs, rig.tank.start_pose[5]);
    let asked: Vec<usize> = (0..6)
        .filter(|d| beside.given.contains(&Dof::ALL[*d]) && recording.measures(*d))
        .collect();
    let mut dofs = recording.moving(&rig.tolerance.channels());
    // A fault in a channel that nothing is asked of stops nothing.
    let counts = |fault: &DataFault| {
        let channel = Channel::named(&fault.channel);
        channel.is_none_or(|c| {
            let dof = c.dof().index();
            // A given motion that is constant, for a while or throughout, is an input like any other.
            let is_given = asked.contains(&dof) && STANDING.contains(&fault.fault.as_str());
            dofs.contains(&dof) && !is_given
        })
    };
    let mut made = match stopped_by_faults(sources, held, rig, counts) {
        ControlFlow::Break(stopped) => return Ok(stopped),
        ControlFlow::Continue(going_on) => going_on,
    };
    dofs.retain(|d| !asked.contains(d));
    if dofs.is_empty() {
        // Samples may be too far apart to show any motion.
        let own: Vec<Run> = sources.iter().map(|s| s.run.clone()).collect();
        stretched(&own, rig)?;
        return Err(DiagnoseError::NothingMoves(sources.len()));
    }
    // Under a limit the decision by the simulation error and the predictions have their share.
    let search_watch = Watch {
        limit: watch.limit.earlier(SEARCH_SHARE),
        ..watch
    };
    let asking = Asking {
        runs: &runs,
        at_rest: AtRest::of(&resting, &runs, rig, &recording).least(),
        rig,
        watch: search_watch,
    };
    let found = asking.explained(&recording, &dofs, &asked)?;
    let (mut found, closed) = closed(found, Options::default(), search_watch);
    let mut not_offered = found.take_implausible();
    let held = apart(held);
    let over = match held.is_empty() {
        true => None,
        false => found.problem.over(&held, rig).ok(),
    };
    let is_by_squares = decide_by_prediction(&mut found, over.as_ref(), watch);
    let mut account = found.account.clone();
    account.did("search of the models");
    watch.tell("members that predict worse");
    let gone = take_out_unearned(&mut found, over.as_ref(), watch.limit);
    // What was fitted anew without a member may have another size.
    for more in found.take_implausible() {
        if not_offered.iter().all(|n| n.candidate != more.candidate) {
            not_offered.push(more);
        }
    }
    let posterior = Posterior::new(&found);
    watch.tell("predictions");
    let mut judged = Judged::new(&found, &posterior, &closed, &held, rig, watch.limit).ok_or(
        DiagnoseError::NoFit {
            dof: Dof::ALL[dofs[0]].name(),
        },
    )?;
    if judged.one_run_out.is_none() && found.problem.body.recording.runs.len() > 1 {
        account.leaves_open(watch.limit, "each run as the others predict it");
    }
    account.did("predictions");
    let inputs = Inputs::new(&found.problem.body, &asked);
    judged.unexplained.extend(inputs.unexplained());
    let verdict = &mut made.verdict;
    verdict.given = inputs.names();
    verdict.notes.extend(inputs.notes());
    verdict.sets_looked_at = found.fits;
    verdict.implausible = implausible::listed(&found.problem.body.candidates, &not_offered);
    let worse = gone.iter().map(|name| {
        format!("{name}: runs that were not fitted are predicted worse with it than without it: it is in no model")
    });
    verdict.notes.extend(worse);
    if is_by_squares {
        verdict.notes.push(BY_SQUARES.to_owned());
    }
    tell(verdict, &judged, &dofs);
    let notes = implausible::notes(&verdict.implausible);
    verdict.notes.extend(notes);
    if judged.is_built_up() && !account.leaves_open(watch.limit, "the effects one after the other")
    {
        verdict.ablation = judged.ablation();
    }
    made.shown = judged.shown();
    let limit = match beside.needs_plan {
        true => watch.limit.without_time(),
        false => watch.limit,
    };
    if !account.leaves_open(limit, NEXT_RUN) {
        watch.tell("next run");
        let (next, is_cut) = judged.next(rig, beside.calibration, limit);
        if is_cut {
            account.leaves_open(limit, NEXT_RUN);
        }
        if let Some((next, offers)) = next {
            verdict.next_experiment = Some(next);
            made.offers = offers;
        }
    }
    made.account = account;
    made.probability = judged.groups.first().map_or(1.0, |g| g.1);
    verdict.noise = noise_found(&found.problem);
    joined::tell(verdict, &runs, &found.problem.body, judged.best);
    verdict.sentence = words::sentence(verdict, &judged.against());
    made.by_motion = verdict.verdict;
    if verdict.verdict != Word::DataFault {
        judged.adopt(&mut made.rig);
    }
    Ok(made)
}

/// Writes the findings of the models into the verdict.
fn tell(verdict: &mut Verdict, judged: &Judged<'_>, dofs: &[usize]) {
    verdict.effects = judged.effects();
    verdict.candidates = judged.candidates();
    verdict.equivalent = judged.equivalent();
    verdict.unexplained.clone_from(&judged.unexplained);
    verdict.unnamed = dofs
        .iter()
        .map(|d| (Dof::ALL[*d].name().to_owned(), judged.unnamed_in(*d)))
        .collect();
    verdict.at_limit = judged.at_limit();
    verdict.leave_one_run_out = judged.leave_one_run_out();
    verdict.contradicted_by.clone_from(&judged.contradicted_by);
    verdict.verdict = judged.word();
    verdict.place = judged.place();
    verdict.notes.extend(judged.events());
    verdict.test = judged.test();
    let alone = judged.found.models.get(&Vec::new());
    verdict.vehicle_alone =
        alone.map_or_else(Default::default, |fit| judged.found.problem.model_test(fit));
    verdict.fit = judged.fit();
    verdict.parameters = judged.parameters();
    verdict.alternatives = judged.alternatives();
    verdict.posterior = judged.posterior_models();
    verdict.blind_spots = judged.blind_spots();
    verdict.notes.extend(judged.notes());
}

/// Noise of every channel, and the share of its samples that are outliers.
fn noise_found(problem: &Problem) -> BTreeMap<String, NoiseFound> {
    let mut made = BTreeMap::new();
    for (c, noise) in problem.noises.channels.each() {
        let Some(n) = noise else { continue };
        let flags = problem.noises.used.iter().zip(&problem.body.recording.runs);
        let (mut out, mut all) = (0usize, 0usize);
        for (used, r) in flags {
            for (k, u) in used.iter().enumerate() {
                let there = r.measured(k)[c].is_finite();
                all += usize::from(there);
                out += usize::from(there && !u[c]);
            }
        }
        let of = NoiseFound {
            sd: n.total_sd(),
            white_sd: n.white_sd,
            coloured_sd: n.coloured_sd,
            correlation_s: n.correlation_s,
            outliers: out as f64 / all.max(1) as f64,
        };
        made.insert(c.name().to_owned(), of);
    }
    made
}

/// A number of what was measured, so that the order of logs does not matter.
fn digest(run: &Run) -> u64 {
    let bits = run.samples.iter().flat_map(|s| s.values).map(f64::to_bits);
    bits.fold(0xcbf2_9ce4_8422_2325, |h, b| {
        (h ^ b).wrapping_mul(0x0100_0000_01b3)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_core::run::{Command, PerChannel, Sample};

    /// It said that no DOF moves, where `identify` said why.
    #[test]
    fn samples_that_are_all_far_apart_are_refused_with_the_reason() {
        let rig = Rig::builtin("lshpi").unwrap();
        let sample = |k: u32| Sample {
            t_s: 86_400.0 * f64::from(k),
            values: PerChannel::from_fn(|c| {
                if c == Channel::X {
                    0.1 * f64::from(k)
                } else {
                    f64::NAN
                }
            }),
            covariance: None,
        };
        let run = Run {
            name: "run".to_owned(),
            commands: vec![Command {
                t_s: 0.5,
                wrench: [8.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            }],
            samples: (0..40).map(sample).collect(),
            ..Run::default()
        };
        let source = Source {
            run,
            ..Source::default()
        };
        let watch = Watch::unlimited(&|_| ());
        let error = diagnose(&[source], &[], &rig, &Beside::default(), watch).unwrap_err();
        let reason = matches!(error, DiagnoseError::Runs(_));
        assert!(reason, "{error}");
    }
}
