//! Named effects beside a free function: forward selection with removal, both fitted jointly.
//!
//! A set found without the function has effects in it that only imitate it, and lacks small ones
//! that it hid. So the set is searched again with the function in the model: additions by what they
//! promise outside of the span of set AND function, removals where a member is hardly known to differ
//! from nothing.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::DVector;
use rayon::prelude::*;

use super::Explanation;
use crate::bank::{
    ELSEWHERE, Motion, Promise, Response, begin, joined, responses_at, responses_by, whitened,
    without,
};
use crate::descent::Effort;
use crate::family::{Acts, FamilyFit, Joint};
use crate::fit::Fit;
use crate::search::Search;
use crate::setting::Setting;

/// Steps at most.
const STEPS: usize = 9;
/// Additions fitted per step.
const ADDED: usize = 5;
/// Half chi-square that an addition must promise.
const LEAST_GAIN: f64 = 3.0;
/// Half chi-square of a member's size above which taking it out is not tried.
pub(super) const SURELY_THERE: f64 = 12.0;
/// A fit that would end this far above the present one's cost is not followed.
const TOO_FAR: f64 = 40.0;
/// Log evidence that a step must gain.
const STEP_GAIN: f64 = 0.1;
/// The same beside a force in time, whose edges between two knots others would mend.
const STEP_GAIN_IN_TIME: f64 = 5.0;
/// The same as a share of the cost above the noise's own: where no law is exact there is always one more
/// that mends a little.
const STEP_SHARE: f64 = 0.05;
/// Half chi-square per sample that noise, not too well known, leaves at most.
const NOISE: f64 = 0.75;
/// Most effects beside a function.
const MOST: usize = 8;
/// Of what is lacking to the best explanation so far, the share that a step must gain.
const PACE: f64 = 0.15;
/// Lacking less than this a climb goes on at any pace.
const NEAR: f64 = 30.0;

/// Share of a function's prior sd that is left at each step when it is squeezed out.
const SQUEEZED: f64 = 0.3;
/// Such steps.
const SQUEEZES: usize = 4;

/// A set fitted together with a function.
type Pair = (Fit, FamilyFit);

/// A set with where its fit begins, and whether a member has joined it.
type Job = (Vec<usize>, Vec<f64>, bool);

/// What is known of a set with the function: `None` where the fit failed.
type Tried = BTreeMap<Vec<usize>, Option<Pair>>;

/// What candidates do to a motion that has the function in it.
struct Bank {
    responses: Vec<Response>,
    /// Whitened, and 0 in the rows of the function's prior.
    padded: Vec<DVector<f64>>,
}

impl Bank {
    fn of(search: &Search<'_>, (fit, function): &Pair) -> Bank {
        let setting = search.setting;
        let responses = responses_by(setting, fit, &|set, globals, starts| {
            function.motion(setting, set, globals, starts)
        });
        Bank::filled(search, function, responses)
    }

    fn filled(search: &Search<'_>, function: &FamilyFit, responses: Vec<Response>) -> Bank {
        let padded = responses
            .par_iter()
            .map(|r| {
                let w = whitened(search.setting, &search.weights, &r.column);
                let rows = w.len() + function.family.knots.len();
                w.resize_vertically(rows, 0.0)
            })
            .collect();
        Bank { responses, padded }
    }
}

/// The best set beside the function of `seed`, from the seed's set; given up where it will not come
/// near the log evidence `bar`. Members of `also` may join with the numbers they have there.
pub fn beside(search: &Search<'_>, seed: &Explanation, also: &Fit, bar: f64) -> Explanation {
    let Some(family) = seed.family.clone() else {
        return seed.clone();
    };
    let now = (seed.fit.clone(), family);
    let bank = Bank::of(search, &now);
    let (now, needed) = climb(search, &bank, now, also, bar);
    let mut found = Explanation::with(search, now.0, now.1);
    found.needed = needed;
    found
}

/// The function's prior made tighter step by step, so that named effects take over what they can do of
/// its work: a way to sets that no fit reaches from where the motion without them runs off to.
/// The set that is left, without the function.
pub fn squeezed(search: &Search<'_>, grown: &Explanation) -> Option<(Vec<usize>, Vec<f64>)> {
    let mut now = (grown.fit.clone(), grown.family.clone()?);
    let bank = Bank::of(search, &now);
    for _ in 0..SQUEEZES {
        now.1.prior.sd *= SQUEEZED;
        now = now.1.refine(
            search.setting,
            &search.weights,
            &now.0,
            search.weights.to_a_percent(),
        )?;
        now = climb(search, &bank, now, &grown.fit, f64::NEG_INFINITY).0;
    }
    Some((now.0.set, now.0.at))
}

/// Additions and removals until none is better; with what each member is needed for.
fn climb(
    search: &Search<'_>,
    bank: &Bank,
    mut now: Pair,
    also: &Fit,
    bar: f64,
) -> (Pair, Vec<(usize, f64)>) {
    let mut tried = Tried::new();
    let mut joined_before: BTreeSet<Vec<usize>> = BTreeSet::new();
    tried.insert(now.0.set.clone(), Some(now.clone()));
    for step in 0..STEPS {
        let removals = removals(search, &now);
        let mut jobs: Vec<Job> = removals
            .iter()
            .filter(|r| r.2 < SURELY_THERE)
            .map(|r| (r.1.0.clone(), r.1.1.clone(), false))
            .collect();
        if now.0.set.len() < MOST {
            jobs.extend(additions(search, bank, &now, also));
        }
        // What was left when another one went may have been stuck with the numbers it had then: it is tried once more as
        // one that joins.
        jobs.retain(|(set, _, joins)| match joins {
            true => !joined_before.contains(set),
            false => !tried.contains_key(set),
        });
        joined_before.extend(jobs.iter().filter(|j| j.2).map(|j| j.0.clone()));
        let effort = Effort {
            limit: now.0.cost + TOO_FAR,
            ..search.weights.to_a_percent()
        };
        let made: Vec<(Vec<usize>, Option<Pair>)> = jobs
            .into_par_iter()
            .map(|(set, at, _)| {
                let from = Fit {
                    set: set.clone(),
                    at,
                    ..now.0.clone()
                };
                let fitted = now
                    .1
                    .refine(search.setting, &search.weights, &from, effort)
                    .filter(|(joint, _)| joint.confounded(search.setting).is_empty());
                (set, fitted)
            })
            .collect();
        for (set, made) in made {
            let evidence = |p: &Option<Pair>| {
                p.as_ref()
                    .map_or(f64::NEG_INFINITY, |(joint, _)| joint.log_evidence)
            };
            if tried
                .get(&set)
                .is_none_or(|old| evidence(&made) > evidence(old))
            {
                tried.insert(set, made);
            }
        }
        let over = now.0.cost - NOISE * search.weights.samples() as f64;
        let own = if now.1.family.lasts() {
            STEP_GAIN
        } else {
            STEP_GAIN_IN_TIME
        };
        let least = own.max(STEP_SHARE * over);
        let best = tried
            .values()
            .flatten()
            .max_by(|a, b| a.0.log_evidence.total_cmp(&b.0.log_evidence))
            .filter(|(joint, _)| joint.log_evidence > now.0.log_evidence + least)
            .cloned();
        tracing::debug!(
            "beside a function, step {step}: {:?} {:.1} -> {:?}",
            names(search, &now.0.set),
            now.0.log_evidence,
            best.as_ref().map(|b| b.0.log_evidence)
        );
        let Some(better) = best else {
            let needed = removals
                .into_iter()
                .map(|(candidate, (set, _), sure)| {
                    let lacks = match tried.get(&set) {
                        Some(Some((joint, _))) => now.0.log_evidence - joint.log_evidence,
                        _ => sure,
                    };
                    (candidate, lacks)
                })
                .collect();
            return (now, needed);
        };
        let (gained, lacking) = (
            better.0.log_evidence - now.0.log_evidence,
            bar - better.0.log_evidence,
        );
        now = better;
        if too_slow(gained, lacking) {
            break;
        }
    }
    (now, Vec::new())
}

/// Whether a climb that gained this much in its last step will not make up for what it lacks.
pub(super) fn too_slow(gained: f64, lacking: f64) -> bool {
    lacking > NEAR && gained < PACE * lacking
}

fn names(search: &Search<'_>, set: &[usize]) -> Vec<&'static str> {
    set.iter()
        .map(|c| search.setting.vocabulary[*c].info.id)
        .collect()
}

/// A member's candidate, the set without it with where its fit begins, and half chi-square of the
/// member's size.
type Removal = (usize, (Vec<usize>, Vec<f64>), f64);

/// Each member taken out; not the one whose law is bent.
fn removals(search: &Search<'_>, now: &Pair) -> Vec<Removal> {
    let setting = search.setting;
    let (fit, function) = now;
    let sizes = fit.sizes(setting);
    (0..fit.set.len())
        .filter(|m| function.family.acts != Acts::Bends(fit.set[*m]))
        .map(|m| (fit.set[m], without(setting, fit, m), sizes[m]))
        .collect()
}

/// The most promising additions: from the bank's starting points, or with the numbers of `also`, where a period
/// or a place once found is not found from every start.
fn additions(search: &Search<'_>, bank: &Bank, (fit, function): &Pair, also: &Fit) -> Vec<Job> {
    let setting = search.setting;
    let motion: Motion<'_> = &|set, globals, starts| function.motion(setting, set, globals, starts);
    let at = function.unknowns(fit);
    let view = Joint::new(setting, &search.weights, fit, function).view(&at);
    let points = lacking(setting, fit, also);
    let there = responses_at(setting, fit, &points, motion);
    let there = Bank::filled(search, function, there);
    let mut found = view.promises(&bank.responses, &bank.padded, &fit.set);
    found.extend(view.promises(&there.responses, &there.padded, &fit.set));
    likeliest(search, found)
        .into_iter()
        .take(ADDED)
        .map(|p| {
            let point = known(&points, &p)
                .unwrap_or_else(|| begin(setting, fit, &bank.responses, &p, motion));
            let (set, at) = joined(setting, fit, p.candidate, &point);
            (set, at, true)
        })
        .collect()
}

/// The numbers from elsewhere of a promise that was made for them.
pub(super) fn known(points: &[(usize, &[f64])], promise: &Promise) -> Option<Vec<f64>> {
    let same = |k: &&(usize, &[f64])| promise.start == ELSEWHERE && k.0 == promise.candidate;
    points.iter().find(same).map(|k| k.1.to_vec())
}

/// The best promise of each candidate that is worth a fit, best first: from the starts, and with numbers from
/// elsewhere.
pub(super) fn likeliest(search: &Search<'_>, mut found: Vec<Vec<Promise>>) -> Vec<Promise> {
    found.sort_by(|a, b| b[0].gain.total_cmp(&a[0].gain));
    let mut best: Vec<Promise> = Vec::new();
    for p in found.into_iter().map(|l| l[0]) {
        let way = |p: &Promise| (p.candidate, p.start == ELSEWHERE);
        let new = best.iter().all(|b| way(b) != way(&p));
        if new && p.gain > LEAST_GAIN && !search.blind.contains(&p.candidate) {
            best.push(p);
        }
    }
    best
}

/// Effects of another fit that this one lacks, with the numbers they have there.
pub(super) fn lacking<'a>(setting: &Setting, fit: &Fit, other: &'a Fit) -> Vec<(usize, &'a [f64])> {
    (0..other.set.len())
        .filter(|m| !fit.set.contains(&other.set[*m]))
        .map(|m| (other.set[m], other.member(setting, m)))
        .collect()
}
