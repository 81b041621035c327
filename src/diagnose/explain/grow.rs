//! Explanations that grow: a function made sharper with what joins its set, straight where a line will do, again under
//! another noise, and without members that it does the work of.

use std::collections::BTreeMap;

use super::beside::beside;
use super::elect::{SPARING, held_to_account, sparing};
use super::look::{Care, look, modest};
use super::{
    ALL_BUT_NOISE, Explanation, LAW_OUT_OF_REACH, OUT_OF_REACH, PARTS, ROUNDS, WORTH_A_CLIMB,
};
use crate::bank::without;
use crate::descent::Effort;
use crate::family::FamilyFit;
use crate::fit::Fit;
use crate::search::Search;
use crate::setting::Track;

/// A seed's set searched again beside its function, and the function made sharper where that pays; `None` where what
/// bends a law is too large for that (`modest`), or the log evidence `bar` out of reach.
pub(super) fn grow(
    search: &Search<'_>,
    seed: &Explanation,
    also: &Fit,
    bar: f64,
) -> Option<Explanation> {
    let mut grown = beside(search, seed, also, bar);
    // More knots bring a force that begins sharply to the noise from far off, but no law that bends.
    let sharper_will_do =
        grown.bent().is_none() && grown.cost() > ALL_BUT_NOISE * search.weights.samples() as f64;
    let reach = match grown.bent() {
        Some(_) => LAW_OUT_OF_REACH,
        None => OUT_OF_REACH,
    };
    if grown.log_evidence < bar - reach && !sharper_will_do {
        return None;
    }
    if let Some(family) = grown.family.clone() {
        let pair = (grown.fit.clone(), family);
        let (joint, family) =
            FamilyFit::smooth(search.setting, &search.weights, pair, Effort::FULL);
        if joint.log_evidence > grown.log_evidence + WORTH_A_CLIMB {
            let smoother = Explanation::with(search, joint, family);
            grown = beside(search, &smoother, also, bar);
        }
    }
    if let Some(family) = grown.family.clone() {
        let knots = family.family.knots.len();
        let (joint, family) = FamilyFit::sharpen(
            search.setting,
            &search.weights,
            &grown.fit,
            (grown.fit.clone(), family),
        );
        if family.family.knots.len() != knots {
            let (joint, family) = FamilyFit::smooth(
                search.setting,
                &search.weights,
                (joint, family),
                Effort::FULL,
            );
            let sharper = Explanation::with(search, joint, family);
            grown = beside(search, &sharper, also, bar);
        }
    }
    if let Some(family) = grown.family.clone().filter(|_| grown.unnamed()) {
        let before = grown.log_evidence;
        let pair = (grown.fit.clone(), family);
        let (joint, family) =
            FamilyFit::in_windows(search.setting, &search.weights, &grown.fit, pair);
        if joint.log_evidence > before {
            let windows = Explanation::with(search, joint, family);
            grown = beside(search, &windows, also, bar);
        }
    }
    if let Some(line) = straightened(search, &grown, also, bar)
        && line.log_evidence > grown.log_evidence
    {
        grown = line;
    }
    let kept = grown
        .family
        .as_ref()
        .is_some_and(|f| modest(search.setting, &grown.fit, f));
    kept.then_some(grown)
}

/// A law that bends evenly along the tank or in the course of a log, with what joins it then: a curve takes up small
/// effects that a line leaves to be named.
pub(super) fn straightened(
    search: &Search<'_>,
    grown: &Explanation,
    also: &Fit,
    bar: f64,
) -> Option<Explanation> {
    let line = grown.family.as_ref()?.straightened()?;
    let (setting, weights) = (search.setting, &search.weights);
    let (joint, line) = line.refine(setting, weights, &grown.fit, Effort::FULL)?;
    let (joint, line) = FamilyFit::smooth(setting, weights, (joint, line), Effort::FULL);
    if joint.log_evidence < grown.log_evidence - LAW_OUT_OF_REACH {
        return None;
    }
    let found = beside(search, &Explanation::with(search, joint, line), also, bar);
    tracing::debug!(
        "as a line {:?}: {:.1} for {:.1}",
        found.fit.set,
        found.log_evidence,
        grown.log_evidence
    );
    Some(found)
}

/// The same explanation under another noise, with what joins it now; `None` unless it has an unnamed force that
/// matters and leaves only noise: sets without one have nothing to add.
pub fn renewed(
    search: &mut Search<'_>,
    found: &Explanation,
    held: &[Track],
) -> Option<Explanation> {
    let now = again(search, found)?;
    let grown = grow(search, &now, &found.fit, now.log_evidence)?;
    let mut grown = held_to_account(search, grown, held);
    let plain = search.alone(&grown.fit)?;
    if let Some(family) = &mut grown.family {
        family.gain = grown.log_evidence - plain.log_evidence;
    }
    let all = ALL_BUT_NOISE * search.weights.samples() as f64;
    let stands = grown.unnamed() && grown.cost() < all;
    (stands && grown.family_weight > search.setting.tolerance).then_some(grown)
}

/// An explanation with a function, fitted again under the search's present weights.
pub(super) fn again(search: &Search<'_>, found: &Explanation) -> Option<Explanation> {
    let function = found.family.as_ref()?;
    let (joint, function) =
        function.refine(search.setting, &search.weights, &found.fit, Effort::FULL)?;
    Some(Explanation::with(search, joint, function))
}

/// Members taken out as long as what is left explains more beside its best function.
pub(super) fn reduce(
    search: &mut Search<'_>,
    mut best: Explanation,
    tried: &mut BTreeMap<Vec<usize>, Explanation>,
) -> Explanation {
    // What is allowed for fewer effects is allowed once, not at every step.
    let start = best.clone();
    for _ in 0..ROUNDS {
        // Without the function's help: a plain set is the parent of its parts.
        search.reduce_below(std::slice::from_ref(&best.fit.set), f64::INFINITY);
        let mut better: Option<Explanation> = None;
        let mut needed = Vec::new();
        // The likeliest of them are looked at: a look at a large set costs more than all its parts' fits.
        let mut parts: Vec<(usize, Fit)> = (0..best.fit.set.len())
            .filter_map(|member| {
                let (smaller, _) = without(search.setting, &best.fit, member);
                Some((best.fit.set[member], search.get(&smaller)?.clone()))
            })
            .collect();
        parts.sort_by(|a, b| b.1.log_evidence.total_cmp(&a.1.log_evidence));
        for (candidate, fit) in parts.into_iter().take(PARTS) {
            let smaller = fit.set.clone();
            let least = Care::Above(best.log_evidence - SPARING);
            let other = tried
                .entry(smaller)
                .or_insert_with(|| look(search, &fit, least))
                .clone();
            needed.push((candidate, best.log_evidence - other.log_evidence));
            let bar = better
                .as_ref()
                .map_or(best.log_evidence - sparing(search, &other, &best), |b| {
                    b.log_evidence
                });
            let once = start.log_evidence - sparing(search, &other, &start);
            if other.log_evidence > bar.max(once) {
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
