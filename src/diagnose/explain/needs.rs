//! What each member of an explanation is needed for: the best explanation without it, fitted.

use rayon::prelude::*;

use super::Explanation;
use super::look::TWICE_PENALTY;
use crate::bank::without;
use crate::descent::Effort;
use crate::family::Acts;
use crate::fit::{Fit, Posed};
use crate::search::Search;

/// A fit that would end this far above the explanation's cost is not followed: the member is needed.
const TOO_FAR: f64 = 60.0;

/// Log evidence that each member (candidate) is worth, the rest of the explanation as it is, and whether it is
/// only the linear bound of its size: a fit without it that failed says nothing.
pub fn needs(search: &Search<'_>, found: &Explanation) -> Vec<(usize, f64, bool)> {
    let bound = found.fit.sizes(search.setting);
    found
        .fit
        .set
        .par_iter()
        .enumerate()
        .map(|(member, candidate)| {
            // Without a law that lacks something a force of the load would do all of it.
            let asked = |c: usize| c == *candidate && found.shoulder != Some(c);
            let known = found.needed.iter().find(|(c, _)| asked(*c));
            match known
                .map(|k| k.1)
                .or_else(|| lacking(search, found, member))
            {
                Some(lacks) => (*candidate, lacks, false),
                None => (*candidate, bound[member], true),
            }
        })
        .collect()
}

/// What the explanation lacks in log evidence without a member, refitted; `None` where that fit fails.
fn lacking(search: &Search<'_>, found: &Explanation, member: usize) -> Option<f64> {
    let setting = search.setting;
    let candidate = found.fit.set[member];
    let effort = Effort {
        limit: found.fit.cost + TOO_FAR,
        ..search.weights.to_a_percent()
    };
    let plain = |set: Vec<usize>, at: Vec<f64>| {
        let fit = Posed::new(setting, &search.weights, &set).fit_with(at, effort);
        fit.ok().map(|f| f.log_evidence)
    };
    let (set, at) = without(setting, &found.fit, member);
    let rest = match (&found.twice, &found.family) {
        // Both copies of what acts twice; or another member, and the copies stay.
        (Some((double, two)), _) => {
            let mut now = two.clone();
            while let Some(m) = now.set.iter().position(|c| *c == candidate) {
                (now.set, now.at) = without(setting, &now, m);
            }
            let penalty = if candidate == *double {
                0.0
            } else {
                TWICE_PENALTY
            };
            plain(now.set, now.at)? - penalty
        }
        // A bend is nothing without what it bends.
        (None, Some(f))
            if f.family.acts != Acts::Bends(candidate) && found.shoulder != Some(candidate) =>
        {
            let from = Fit {
                set,
                at,
                ..found.fit.clone()
            };
            f.refine(setting, &search.weights, &from, effort)?
                .0
                .log_evidence
        }
        _ => plain(set, at)?,
    };
    let lacks = found.log_evidence - rest;
    lacks.is_finite().then_some(lacks)
}
