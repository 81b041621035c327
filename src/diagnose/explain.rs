//! From the best sets to an explanation: is a law only inexact, or is something unnamed at work?
//!
//! A law that is not quite the vocabulary's leaves residuals that other effects mend: the search
//! then invents small ones. So each effect of the best set is challenged: would a free bend of a
//! heavy effect's law, the same mechanism a second time (two stages, two springs, two modes), or a
//! free force, do its work with better evidence?

use std::collections::BTreeMap;

use super::bank::{View, joined, motion, outside, whitened, without};
use super::family::{Acts, FamilyFit, bends, forces};
use super::fit::{Fit, Posed};
use super::search::Search;
use super::setting::COEFFICIENTS;
use super::weight::{weight_beyond, weights};

/// Log evidence that a free function must gain before it is believed.
const BELIEVED: f64 = 5.0;
/// Single effects tried beside an unnamed force.
const SINGLES: usize = 5;
/// Free functions refitted nonlinearly.
const REFINED: usize = 3;
/// Half chi-square per sample above which a fit is far from the noise, which leaves 0.5.
const FAR_FROM_NOISE: f64 = 2.0;
/// Log of the choice between one law and the same law twice.
const TWICE_PENALTY: f64 = 2.0;
/// An explanation with one mechanism less whose heavy law is inexact may be this much worse in log
/// evidence: invent nothing.
const SPARING: f64 = 4.0;
/// A second copy begins with this share of the first one's size.
const SPLIT: f64 = 0.35;
/// An effect whose weight is below this share of the heaviest is not asked whether its law bends.
const HEAVY_SHARE: f64 = 0.25;

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

/// A set with its best free function, if one is believed.
pub fn look(search: &Search<'_>, fit: &Fit) -> Explanation {
    let setting = search.setting;
    let view = View::new(setting, &search.weights, fit);
    let weights = weights(setting, fit);
    let heaviest = weights.iter().copied().fold(0.0, f64::max);
    let mut families = forces(setting, fit);
    if fit.cost > FAR_FROM_NOISE * search.weights.samples() as f64 {
        families.iter_mut().for_each(|f| f.measured = true);
    }
    let mut double: Option<(usize, Fit)> = None;
    for (member, (candidate, weight)) in fit.set.iter().zip(&weights).enumerate() {
        if *weight > setting.tolerance && *weight >= HEAVY_SHARE * heaviest {
            families.extend(bends(setting, fit, *candidate));
            if let Some(two) = twice(search, fit, &view, member).filter(|two| {
                double
                    .as_ref()
                    .is_none_or(|d| two.log_evidence > d.1.log_evidence)
            }) {
                double = Some((*candidate, two));
            }
        }
    }
    let double = double.filter(|d| d.1.log_evidence > fit.log_evidence + BELIEVED);
    let mut found: Vec<FamilyFit> = families
        .iter()
        .filter_map(|f| f.fit(setting, &search.weights, fit, &view))
        .filter(|f| f.gain > BELIEVED)
        .collect();
    found.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    // Large ones are not linear: the front runners are fitted again, together with the set.
    let refined: Option<(Fit, FamilyFit)> = found
        .iter()
        .take(REFINED)
        .filter_map(|f| f.close(setting, &search.weights, fit))
        .filter(|(_, f)| f.gain > BELIEVED)
        .max_by(|a, b| a.1.gain.total_cmp(&b.1.gain))
        .map(|best| FamilyFit::sharpen(setting, &search.weights, fit, best));
    tracing::debug!(
        "beside {:?}: {:?}",
        fit.set
            .iter()
            .map(|c| setting.vocabulary[*c].info.id)
            .collect::<Vec<_>>(),
        refined
            .as_ref()
            .map(|(_, f)| (f.family.acts, f.family.variable, f.gain))
    );
    let bar = refined
        .as_ref()
        .map_or(f64::NEG_INFINITY, |(joint, _)| joint.log_evidence);
    if let Some((candidate, two)) = double.filter(|d| d.1.log_evidence > bar) {
        tracing::debug!(
            "{} twice gains {:.1}",
            setting.vocabulary[candidate].info.id,
            two.log_evidence - fit.log_evidence
        );
        return Explanation {
            log_evidence: two.log_evidence,
            fit: fit.clone(),
            weights,
            family: None,
            twice: Some((candidate, two)),
            family_weight: 0.0,
            needed: Vec::new(),
        };
    }
    match refined {
        Some((joint, family)) => Explanation {
            twice: None,
            log_evidence: joint.log_evidence,
            family_weight: weight_beyond(setting, &joint, &family.response),
            weights: super::weight::weights(setting, &joint),
            fit: joint,
            family: Some(family),
            needed: Vec::new(),
        },
        None => Explanation {
            log_evidence: fit.log_evidence,
            fit: fit.clone(),
            weights,
            family: None,
            twice: None,
            family_weight: 0.0,
            needed: Vec::new(),
        },
    }
}

/// A set with one of its members a second time, its evidence less the choice.
fn twice(search: &Search<'_>, fit: &Fit, view: &View, member: usize) -> Option<Fit> {
    let setting = search.setting;
    let candidate = fit.set[member];
    let own = fit.member(setting, member).to_vec();
    let starts: Vec<(f64, f64)> = (0..setting.tracks.len())
        .map(|r| fit.start(setting, r))
        .collect();
    let plain = motion(setting, &fit.set, fit.globals(setting), &starts);
    // A share of the first one's size goes over to the copy, or the copy begins where it promises most.
    let mut split = own.clone();
    split[0] *= SPLIT;
    let mut begins: Vec<(f64, Vec<f64>, f64)> = vec![(f64::INFINITY, split, 1.0 - SPLIT)];
    if own.len() > 1 {
        begins.extend(setting.vocabulary[candidate].starts.iter().filter_map(|p| {
            let (set, at) = joined(setting, fit, candidate, p);
            let globals = &at[..COEFFICIENTS + setting.parameters(&set)];
            let moved = motion(setting, &set, globals, &starts) - &plain;
            let left = outside(&view.basis, &whitened(setting, &search.weights, &moved));
            let (product, energy) = (left.dot(&view.residual), left.norm_squared());
            (energy > 0.0 && product < 0.0)
                .then(|| (0.5 * product * product / energy, p.clone(), 1.0))
        }));
        begins.sort_by(|a, b| b.0.total_cmp(&a.0));
    }
    begins
        .into_iter()
        .take(2)
        .filter_map(|(_, copy, left)| {
            let (set, mut at) = joined(setting, fit, candidate, &copy);
            // The copy stands before the original.
            at[setting.places(&set)[member + 1]] *= left;
            let mut two = Posed::new(setting, &search.weights, &set).fit(at).ok()?;
            two.log_evidence -= TWICE_PENALTY;
            two.log_evidence.is_finite().then_some(two)
        })
        .max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))
}

/// The best explanation: sets from the search and sets with members taken out, each with its best free function.
pub fn explain(search: &mut Search<'_>) -> Option<Explanation> {
    let first = search.best()?.clone();
    let mut best = look(search, &first);
    if best.fit.set.len() < 2 && best.family.is_none() && best.twice.is_none() {
        // Nothing is left, and nothing to take away: what the search named stands on its own.
        return Some(best);
    }
    // Nothing at all, and the heaviest alone, beside a free function: the search may have needed
    // several effects to imitate one that it has no name for.
    let mut tried: BTreeMap<Vec<usize>, Explanation> =
        BTreeMap::from([(first.set.clone(), best.clone())]);
    let heaviest = best
        .fit
        .set
        .iter()
        .zip(&best.weights)
        .max_by(|a, b| a.1.total_cmp(b.1))
        .map(|(c, _)| vec![*c]);
    let mut challengers = if best.family.is_some() || best.twice.is_some() {
        vec![Some(Vec::new()), heaviest]
    } else {
        vec![heaviest]
    };
    if best.unnamed() {
        // Beside an unnamed force another single effect may be right than without it.
        let singles = search.ranked();
        let singles = singles.iter().filter(|f| f.set.len() == 1);
        challengers.extend(singles.take(SINGLES).map(|f| Some(f.set.clone())));
    }
    for set in challengers.into_iter().flatten() {
        if let Some(fit) = search.get(&set).cloned()
            && !tried.contains_key(&set)
        {
            let other = look(search, &fit);
            tried.insert(set, other.clone());
            if other.log_evidence > best.log_evidence {
                best = other;
            }
        }
    }
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
            let other = tried
                .entry(smaller)
                .or_insert_with(|| look(search, &fit))
                .clone();
            needed.push((candidate, best.log_evidence - other.log_evidence));
            let sparing = if other.bent().is_some() && best.bent().is_none() && !best.unnamed() {
                SPARING
            } else {
                0.0
            };
            let bar = better
                .as_ref()
                .map_or(best.log_evidence - sparing, |b| b.log_evidence);
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
    // A free force too light to matter is no reason to speak of something unnamed, nor to take from
    // the named effects what they explain: the best set stands as it is.
    if best.unnamed() && best.family_weight <= search.setting.tolerance {
        let weights = weights(search.setting, &first);
        return Some(Explanation {
            log_evidence: first.log_evidence,
            fit: first,
            weights,
            family: None,
            twice: None,
            family_weight: 0.0,
            needed: Vec::new(),
        });
    }
    Some(best)
}
