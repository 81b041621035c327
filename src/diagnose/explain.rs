//! From the best sets to an explanation: is a law only inexact, or is something unnamed at work?
//!
//! A law that is not quite the vocabulary's leaves residuals that other effects mend: the search
//! then invents small ones. So the best set is challenged (`look`): would a free bend of a heavy
//! effect's law, the same mechanism a second time (two stages, two springs, two modes), or a free
//! force, do with better evidence? And beside such a function the set is searched again (`beside`).

mod beside;
mod look;

use std::collections::BTreeMap;

use super::bank::without;
use super::family::{Acts, FamilyFit, Variable};
use super::fit::Fit;
use super::search::Search;
use super::weight::{weight_beyond, weights};
use beside::{beside, squeezed};

pub use look::{Care, look};

/// Single effects tried beside an unnamed force.
const SINGLES: usize = 2;
/// Functions, of different kinds, beside which the set is searched again.
const GROWN: usize = 2;
/// A function this far below the best explanation before its set is searched again has no chance.
const TOO_LATE: f64 = 2000.0;
/// An explanation with one mechanism less whose heavy law is inexact may be this much worse in log
/// evidence: invent nothing.
const SPARING: f64 = 4.0;

/// A set, and what is left beside it.
#[derive(Debug, Clone)]
pub struct Explanation {
    /// The set, fitted.
    pub fit: Fit,
    /// Weight of each member \[m, rad\].
    pub weights: Vec<f64>,
    /// A free function that gains beside it.
    pub family: Option<FamilyFit>,
    /// Without such a function: the member (candidate) that acts twice, with the fit of both.
    pub twice: Option<(usize, Fit)>,
    /// Weight of the function's response \[m, rad\].
    pub family_weight: f64,
    /// Log evidence of both.
    pub log_evidence: f64,
    /// Members (candidates) with what the best explanation without them lacks in log evidence.
    pub needed: Vec<(usize, f64)>,
}

impl Explanation {
    /// A set as it is.
    fn plain(search: &Search<'_>, fit: &Fit) -> Explanation {
        Explanation {
            fit: fit.clone(),
            weights: weights(search.setting, fit),
            family: None,
            twice: None,
            family_weight: 0.0,
            log_evidence: fit.log_evidence,
            needed: Vec::new(),
        }
    }

    /// A set fitted together with a function.
    fn with(search: &Search<'_>, joint: Fit, family: FamilyFit) -> Explanation {
        Explanation {
            family_weight: weight_beyond(search.setting, &joint, &family.response),
            family: Some(family),
            ..Explanation::plain(search, &joint)
        }
    }

    /// What its function acts on, and of what.
    fn kind(&self) -> Option<(Acts, Variable)> {
        self.family
            .as_ref()
            .map(|f| (f.family.acts, f.family.variable))
    }

    /// The member (candidate index) whose law bends.
    pub fn bent(&self) -> Option<usize> {
        if let Some((candidate, _)) = &self.twice {
            return Some(*candidate);
        }
        match self.family.as_ref()?.family.acts {
            Acts::Bends(candidate) => Some(candidate),
            Acts::Force => None,
        }
    }

    /// Whether an unnamed force is part of it.
    pub fn unnamed(&self) -> bool {
        self.family
            .as_ref()
            .is_some_and(|f| f.family.acts == Acts::Force)
    }
}

/// The best explanation: sets from the search, sets grown beside a free function, and sets with
/// members taken out, each with its best free function.
pub fn explain(search: &mut Search<'_>) -> Option<Explanation> {
    let first = search.best()?.clone();
    let mut best = look(search, &first, Care::Above(f64::NEG_INFINITY));
    if best.fit.set.len() < 2 && best.family.is_none() && best.twice.is_none() {
        // Nothing is left, and nothing to take away: what the search named stands on its own.
        return Some(best);
    }
    let mut tried: BTreeMap<Vec<usize>, Explanation> =
        BTreeMap::from([(first.set.clone(), best.clone())]);
    challenge(search, &best, &mut tried);
    let mut seeds: Vec<Explanation> = tried
        .values()
        .filter(|e| e.family.is_some())
        .cloned()
        .collect();
    if let Some(other) = tried
        .values()
        .max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))
        .filter(|o| o.log_evidence > best.log_evidence)
    {
        best = other.clone();
    }
    // Nothing at all, and the heaviest alone, beside a free function: the search may have needed
    // several effects to imitate one that it has no name for.
    seeds.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
    let mut kinds = Vec::new();
    seeds.retain(|s| {
        let new = !kinds.contains(&s.kind()) && s.log_evidence > best.log_evidence - TOO_LATE;
        kinds.push(s.kind());
        new
    });
    let mut grown_best = false;
    for seed in seeds.iter().take(GROWN) {
        let grown = grow(search, seed);
        if grown.log_evidence > best.log_evidence - sparing(&grown, &best) {
            best = grown;
            grown_best = true;
        }
    }
    if best.unnamed()
        && search.stopped_early()
        && let Some(job) = squeezed(search, &best)
    {
        // What the search gave up as hopeless the vocabulary may yet explain.
        search.fit(vec![job.clone()]);
        if let Some(named) = search.finished(&job.0) {
            let seen = look(search, &named, Care::Above(best.log_evidence));
            tracing::debug!(
                "squeezed to {:?}: {:.1} for {:.1}",
                job.0,
                seen.log_evidence,
                best.log_evidence
            );
            if seen.log_evidence > best.log_evidence {
                best = seen;
                grown_best = false;
            }
        }
    }
    if best.unnamed() && grown_best {
        // Beside the set as it is now another function may be the better one.
        if let Some(plain) = alone(search, &best.fit) {
            let again = look(search, &plain, Care::Above(best.log_evidence));
            if again.log_evidence > best.log_evidence && again.kind() != best.kind() {
                best = grow(search, &again);
            }
            if let Some(family) = &mut best.family {
                family.gain = best.log_evidence - plain.log_evidence;
            }
        }
    }
    if !grown_best {
        best = reduce(search, best, &mut tried);
    }
    // A free force too light to matter is no reason to speak of something unnamed, nor to take from
    // the named effects what they explain: the best explanation without one stands.
    if best.unnamed() && best.family_weight <= search.setting.tolerance {
        let named = tried
            .into_values()
            .filter(|e| !e.unnamed())
            .chain([Explanation::plain(search, &first)])
            .max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence));
        return named;
    }
    Some(best)
}

/// Looks at nothing at all, at the heaviest alone and, where a force seems unnamed, at the best singles.
fn challenge(
    search: &Search<'_>,
    best: &Explanation,
    tried: &mut BTreeMap<Vec<usize>, Explanation>,
) {
    let heaviest = best
        .fit
        .set
        .iter()
        .zip(&best.weights)
        .max_by(|a, b| a.1.total_cmp(b.1))
        .map(|(c, _)| vec![*c]);
    let mut sets: Vec<Vec<usize>> = heaviest.into_iter().collect();
    if best.family.is_some() || best.twice.is_some() {
        sets.push(Vec::new());
    }
    if best.unnamed() {
        // Beside an unnamed force another single effect may be right than without it.
        let singles = search.ranked();
        let singles = singles.iter().filter(|f| f.set.len() == 1);
        sets.extend(singles.take(SINGLES).map(|f| f.set.clone()));
    }
    for set in sets {
        if tried.contains_key(&set) {
            continue;
        }
        if let Some(fit) = search.get(&set) {
            let seen = look(search, fit, Care::Above(f64::NEG_INFINITY));
            tried.insert(set, seen);
        }
    }
}

/// A seed's set searched again beside its function, and the function made sharper where that pays.
fn grow(search: &Search<'_>, seed: &Explanation) -> Explanation {
    let grown = beside(search, seed);
    let Some(family) = grown.family.clone() else {
        return grown;
    };
    let knots = family.family.knots.len();
    let (joint, family) = FamilyFit::sharpen(
        search.setting,
        &search.weights,
        &grown.fit,
        (grown.fit.clone(), family),
    );
    if family.family.knots.len() == knots {
        return grown;
    }
    beside(search, &Explanation::with(search, joint, family))
}

/// What a bent law with fewer mechanisms may be worse than a plain set.
fn sparing(other: &Explanation, best: &Explanation) -> f64 {
    let fewer = other.fit.set.len() < best.fit.set.len();
    if fewer && other.bent().is_some() && best.bent().is_none() && !best.unnamed() {
        SPARING
    } else {
        0.0
    }
}

/// A set's own fit, without any function.
fn alone(search: &mut Search<'_>, like: &Fit) -> Option<Fit> {
    if search.get(&like.set).is_none() {
        search.fit(vec![(like.set.clone(), like.at.clone())]);
    }
    search.finished(&like.set)
}

/// Members taken out as long as what is left explains more beside its best function.
fn reduce(
    search: &mut Search<'_>,
    mut best: Explanation,
    tried: &mut BTreeMap<Vec<usize>, Explanation>,
) -> Explanation {
    for _ in 0..8 {
        // Without the function's help: a plain set is the parent of its parts.
        search.reduce(std::slice::from_ref(&best.fit.set));
        let mut better: Option<Explanation> = None;
        let mut needed = Vec::new();
        for member in 0..best.fit.set.len() {
            let candidate = best.fit.set[member];
            let (smaller, _) = without(search.setting, &best.fit, member);
            let Some(fit) = search.get(&smaller).cloned() else {
                continue;
            };
            let least = Care::Above(best.log_evidence - SPARING);
            let other = tried
                .entry(smaller)
                .or_insert_with(|| look(search, &fit, least))
                .clone();
            needed.push((candidate, best.log_evidence - other.log_evidence));
            let bar = better
                .as_ref()
                .map_or(best.log_evidence - sparing(&other, &best), |b| b.log_evidence);
            if other.log_evidence > bar {
                better = Some(other);
            }
        }
        match better {
            Some(next) => best = next,
            None => {
                best.needed = needed;
                break;
            }
        }
    }
    best
}
