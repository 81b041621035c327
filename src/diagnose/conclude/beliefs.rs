//! What was believed before the search, and might have been believed otherwise: searched under both, compared by
//! the evidence of all of it.
//!
//! A small effect that the set lacks looks like noise as slow as the runs, or like a drift that they share at
//! their start; once it is taken for that, nothing is left by which it could be found.

use super::found;
use crate::choosing::Choosing;
use crate::explain::{Explanation, covered};
use crate::family::Acts;
use crate::rest::{WORTH, places, still};
use crate::search::Search;
use crate::setting::Track;
use crate::weights::{Weights, in_both};

/// Searches once more under the least noise that was seen where the noise found is slow, then from rest where
/// the runs were let drift at their start; the likeliest explanation, and the search it came from.
pub fn likeliest<'a>(
    mut search: Search<'a>,
    mut best: Explanation,
    choosing: &[Track],
) -> (Search<'a>, Explanation) {
    // Where no law is exact, errors of laws are larger than all of this.
    if best.by_prediction {
        return (search, best);
    }
    let setting = search.setting;
    if let Some(other) = search.under_less_noise() {
        (search.progress)("the same under less noise");
        (search, best) = better((search, best), other, choosing, "less noise", WORTH);
    }
    let begins = !places(setting, 0).is_empty();
    if begins && search.weights.rest_sd != Some(still(setting.tolerance)) {
        (search.progress)("the same from rest");
        let other = Search::still(setting, search.progress);
        // That runs drift is one more number.
        (search, best) = better((search, best), other, choosing, "from rest", -WORTH);
    }
    (search, best)
}

/// The likelier of an explanation and the one that another search finds, which must gain this.
fn better<'a>(
    mut kept: (Search<'a>, Explanation),
    mut other: Search<'a>,
    choosing: &[Track],
    belief: &str,
    by: f64,
) -> (Search<'a>, Explanation) {
    other.nothing();
    let made = found(&mut other, choosing);
    kept.0.looked += other.looked;
    other.looked = kept.0.looked;
    let Some(made) = made.filter(|e| !e.by_prediction) else {
        return kept;
    };
    // A free force does the work of slow noise and of drifts; whether it is one was asked on the way.
    let free = |e: &Explanation| {
        let of = e.family.as_ref();
        of.is_some_and(|f| f.family.acts == Acts::Force)
    };
    if free(&made) && !free(&kept.1) {
        return kept;
    }
    // Of the samples that count under both.
    let used = in_both(&kept.0.weights.used, &other.weights.used);
    let (told, others) = told((&kept.0, &kept.1), (&other, &made), choosing);
    let (first, second) = (
        evidence(&kept.0, &kept.1, &used) + told,
        evidence(&other, &made, &used) + others,
    );
    tracing::debug!(
        "{belief}: {:?} {second:.1} for {:?} {first:.1}",
        made.fit.set,
        kept.1.fit.set
    );
    if second > first + by {
        (other, made)
    } else {
        kept
    }
}

/// What the runs held out that choose say for each, given the runs fitted, of the samples that count under both; nothing where
/// one of them cannot be asked.
fn told(
    kept: (&Search<'_>, &Explanation),
    other: (&Search<'_>, &Explanation),
    held: &[Track],
) -> (f64, f64) {
    let setting = kept.0.setting;
    // What is left of a function beyond its range is nobody's.
    let held = covered(&[kept.1, other.1], held);
    if held.is_empty() {
        return (0.0, 0.0);
    }
    let like =
        |of: (&Search<'_>, &Explanation)| Choosing::like(setting, &of.0.weights, &held, &of.1.fit);
    let used = in_both(like(kept).used(), like(other).used());
    if used.len() != held.len() {
        return (0.0, 0.0);
    }
    let asked = |of: (&Search<'_>, &Explanation)| {
        let weights = &of.0.weights;
        let choosing = Choosing::new(setting, weights, &held, used.clone()).with(&kept.0.shown);
        Some((of.1.told(of.0, &choosing)?, of.1.foretells(of.0, &choosing)))
    };
    match asked(kept).zip(asked(other)) {
        Some(((first, a), (second, b))) if a || b => (first, second),
        _ => (0.0, 0.0),
    }
}

/// Log evidence of an explanation with that of its noise and of its rates at the start.
fn evidence(search: &Search<'_>, of: &Explanation, used: &[Vec<bool>]) -> f64 {
    let setting = search.setting;
    let weights = Weights::new(&setting.tracks, search.weights.noise, used.to_vec());
    let left = of.residuals(search);
    let cost = |w: &Weights| 0.5 * w.stack(left.clone()).norm_squared();
    let begins = places(setting, 0).len() as f64;
    let believed = search.weights.rest_precision(setting.tolerance);
    of.log_evidence - (cost(&weights) - cost(&search.weights)) - 0.5 * weights.log_variance()
        + 0.5 * begins * believed.ln()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{setting, surge};

    #[test]
    fn runs_held_out_tell_between_beliefs_where_one_of_them_foretells_them() {
        let effects: [(&str, &[(&str, f64)]); 1] = [("coulomb_friction", &[("f_n", 0.5)])];
        let own = setting(&[surge(0, &effects), surge(1, &effects)]);
        let held = setting(&[surge(2, &effects)]).tracks;
        let mut search = Search::still(&own, &|_| {});
        search.nothing();
        let empty = search.get(&[]).unwrap().clone();
        let right = found(&mut search, &[]).unwrap();
        assert!(!right.fit.set.is_empty());
        let wrong = Explanation {
            fit: empty,
            weights: Vec::new(),
            family: None,
            twice: None,
            ..right.clone()
        };
        let (first, second) = told((&search, &right), (&search, &wrong), &held);
        assert!(first > second + 10.0, "{first} {second}");
        // Whichever comes first.
        assert_eq!(
            told((&search, &wrong), (&search, &right), &held),
            (second, first)
        );
        // Nobody is asked of runs that no explanation comes near, or of none.
        assert_eq!(
            told((&search, &wrong), (&search, &wrong), &held),
            (0.0, 0.0)
        );
        assert_eq!(told((&search, &right), (&search, &wrong), &[]), (0.0, 0.0));
    }
}
