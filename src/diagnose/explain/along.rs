//! Runs held out fitted along with the others: what joins a set there.

use super::elect::HELD_SHOWS;
use crate::bank::joined;
use crate::fit::{Fit, Posed};
use crate::predict::predicted;
use crate::search::Search;
use crate::setting::{Setting, Track};
use crate::weights::Weights;

/// Additions looked at beside the set: what the runs held out show first may be one more effect.
const ADDED: usize = 4;
/// Times that one is taken.
const ROUNDS: usize = 2;
/// Half chi-square per sample above which no law comes near the noise, which leaves 0.5.
pub const FAR_FROM_NOISE: f64 = 2.0;
/// Half chi-square within which a fit is as good as another one of its set.
const AS_NEAR: f64 = 1.0;
/// Half chi-square that one must promise.
const LEAST_GAIN: f64 = 6.0;

/// The runs fitted and those held out.
pub fn all_runs(search: &Search<'_>, held: &[Track]) -> Setting {
    let fitted = search.setting;
    fitted.fitting(fitted.tracks.iter().chain(held).cloned().collect())
}

/// A set fitted to `all` runs and, of what promises to join it there, what does; `None` where it cannot be fitted.
/// Under the noise of the runs fitted, which are the first of all.
pub fn along<'a>(
    search: &Search<'a>,
    all: &'a Setting,
    first: &Fit,
) -> Option<(Search<'a>, Vec<usize>)> {
    let held = &all.tracks[search.setting.tracks.len()..];
    let mut used = search.weights.used.clone();
    used.extend(predicted(search.setting, held, first, search.weights.noise)?.kept());
    let mut along = Search::new(all, search.progress);
    along.weights =
        Weights::new(&all.tracks, search.weights.noise, used).at_rest(search.weights.rest_sd);
    // Behind the numbers of the set stand the runs' starts.
    let mut at = first.at.clone();
    for track in held {
        at.extend([track.measured.first().copied().unwrap_or(0.0), 0.0]);
    }
    along.fit_all(vec![(first.set.clone(), at)]);
    let mut set = first.set.clone();
    for _ in 0..ROUNDS {
        along.finished(&set)?;
        along.refresh(&set);
        along.extend(std::slice::from_ref(&set), ADDED, LEAST_GAIN);
        let best = along.best()?.set.clone();
        if best == set {
            break;
        }
        set = best;
    }
    Some((along, set))
}

/// What only the runs held out show beside a set: an effect that the runs fitted do not reach (a limit above their
/// loads), with its numbers and the log evidence that it gains there. What they can tell of joins the sets of the search.
pub fn shown(search: &mut Search<'_>, held: &[Track], first: &Fit) -> Vec<(usize, Vec<f64>, f64)> {
    if held.is_empty() {
        return Vec::new();
    }
    let all = all_runs(search, held);
    let found = {
        let Some((mut along, set)) = along(search, &all, first) else {
            return Vec::new();
        };
        let evidence = |along: &Search<'_>, set: &[usize]| along.get(set).map(|f| f.log_evidence);
        let (Some(before), Some(fit)) = (evidence(&along, &first.set), along.finished(&set)) else {
            return Vec::new();
        };
        let gain = fit.log_evidence - before;
        // Far from the noise one law's errors are mended by another.
        if gain < HELD_SHOWS || fit.cost > FAR_FROM_NOISE * along.weights.samples() as f64 {
            return Vec::new();
        }
        let new = fit.set.iter().enumerate();
        new.filter(|(_, c)| !first.set.contains(c))
            .map(|(member, c)| (*c, fit.member(&all, member).to_vec(), gain))
            .collect::<Vec<_>>()
    };
    let mut only = Vec::new();
    for (candidate, point, gain) in found {
        let (set, from) = joined(search.setting, first, candidate, &point);
        let Ok(fit) = Posed::new(search.setting, &search.weights, &set).fit(from) else {
            continue;
        };
        let confounded = fit.confounded(search.setting);
        if confounded.contains(&candidate) {
            only.push((candidate, point, gain));
            continue;
        }
        let sound = confounded.is_empty() && fit.log_evidence.is_finite();
        if sound
            && search
                .get(&set)
                .is_none_or(|old| fit.cost < old.cost + AS_NEAR)
        {
            // Where the runs fitted hardly tell a number, it begins where all runs have it.
            search.fits.insert(set, fit);
        }
    }
    only
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{candidate, setting, surge};

    /// What is shown, and whether the search has the limit by itself.
    fn with_a_limit_of(limit_n: f64) -> (Vec<(usize, Vec<f64>, f64)>, bool) {
        let numbers = [("limit_n", limit_n)];
        let effects: [(&str, &[(&str, f64)]); 1] = [("thruster_saturation", &numbers)];
        // Loads up to 6 N; 12 N.
        let own = setting(&[surge(0, &effects), surge(1, &effects)]);
        let held = setting(&[surge(4, &effects)]).tracks;
        let mut search = Search::still(&own, &|_| {});
        search.nothing();
        let first = search.get(&[]).unwrap().clone();
        let found = shown(&mut search, &held, &first);
        let set = [candidate(&own, "thruster_saturation")];
        (found, search.get(&set).is_some())
    }

    /// A limit above the loads of the runs fitted is only in the run held out; one below them joins the search.
    #[test]
    fn a_limit_that_only_the_run_held_out_reaches_is_shown_by_it() {
        let (found, own) = with_a_limit_of(9.0);
        assert_eq!(found.len(), 1, "{found:?}");
        let (_, numbers, gain) = &found[0];
        assert!((numbers[0] - 9.0).abs() < 0.2 && *gain > 50.0, "{found:?}");
        assert!(!own);
        let (found, own) = with_a_limit_of(5.0);
        assert!(found.is_empty() && own, "{found:?}");
        let (found, own) = with_a_limit_of(20.0);
        assert!(found.is_empty() && !own, "{found:?}");
    }
}
