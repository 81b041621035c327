//! Where no law is exact: effects one by one (or two at once), by what each gains in prediction.
//!
//! There likelihoods compare errors of laws, and the most likely set is a long one that mends them. So the
//! runs held out decide: an effect stays where they are predicted better by more than the errors vary.

use std::collections::BTreeSet;

use super::Explanation;
use super::windows::Windows;
use crate::diagnose::bank::without;
use crate::diagnose::fit::Fit;
use crate::diagnose::predict::{BETTER_T, Prediction, predicted};
use crate::diagnose::search::Search;
use crate::diagnose::setting::Track;

/// Most effects.
const MOST: usize = 6;
/// Additions fitted per step in windows, and of those the ones fitted to the whole runs.
const ADDED: usize = 12;
/// See [`ADDED`].
const WHOLE: usize = 6;
/// Of those the ones from which a second addition is tried, and additions of each.
const PAIRED: (usize, usize) = (3, 5);
/// rms of the runs held out with two effects more over that with one from which two are taken at once.
const BOTH: f64 = 0.7;
/// rms of the runs held out with an effect over that without it from which it is worth its place.
const WORTH: f64 = 0.97;
/// Without a member over with it, up to which it is not.
const AS_WELL: f64 = 1.01;

/// A fit with what it predicts.
type Judged = (Fit, Prediction);

/// The set that predicts, grown from nothing; `None` where nothing can be predicted.
pub fn forward(search: &mut Search<'_>, held: &[Track]) -> Option<Explanation> {
    let windows = Windows::of(search);
    let nothing = search.finished(&[])?;
    let mut seen = windows.fit(&[], nothing.globals(search.setting))?;
    search.fit_all(vec![windows.whole(search, &seen)]);
    let nothing = search.finished(&[])?;
    let mut now = judge(search, held, nothing)?;
    while now.0.set.len() < MOST {
        let blind = |c: usize| search.blind.contains(&c);
        let singles = windows.grow(&seen, blind, ADDED);
        let blind = |c: usize| search.blind.contains(&c);
        let mut pairs: Vec<Fit> = singles
            .iter()
            .take(PAIRED.0)
            .flat_map(|s| windows.grow(s, blind, PAIRED.1))
            .collect();
        pairs.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        let mut seen_pairs = BTreeSet::new();
        pairs.retain(|f| seen_pairs.insert(f.set.clone()));
        let single = best(search, held, &windows, &singles).filter(|s| worth(&s.0, &now));
        let pair = best(search, held, &windows, &pairs).filter(|s| worth(&s.0, &now));
        // One effect may do a little of the work of two that hide each other.
        let next = match (single, pair) {
            (Some(s), Some(p)) if p.0.1.rms < BOTH * s.0.1.rms => Some(p),
            (None, pair) => pair,
            (single, _) => single,
        };
        let Some((better, from)) = next else { break };
        tracing::debug!(
            "by prediction {:?}: {:.3e} for {:.3e}",
            better.0.set,
            better.1.rms,
            now.1.rms
        );
        let grown = better.0.set.clone();
        now = thinned(search, held, better);
        seen = if now.0.set == grown {
            from
        } else if let Some(fit) = windows.fit(&now.0.set, now.0.globals(search.setting)) {
            fit
        } else {
            break;
        };
    }
    let fit = search.finished(&now.0.set).unwrap_or(now.0);
    Some(Explanation {
        by_prediction: true,
        ..Explanation::plain(search, &fit)
    })
}

fn judge(search: &Search<'_>, held: &[Track], fit: Fit) -> Option<Judged> {
    let made = predicted(search.setting, held, &fit, search.weights.noise)?;
    made.rms.is_finite().then_some((fit, made))
}

fn worth(new: &Judged, old: &Judged) -> bool {
    new.1.rms < WORTH * old.1.rms && new.1.better_than(&old.1) > BETTER_T
}

/// Of sets fitted in windows the one that, fitted to the whole runs, predicts best, with its fit in windows.
fn best(
    search: &mut Search<'_>,
    held: &[Track],
    windows: &Windows,
    grown: &[Fit],
) -> Option<(Judged, Fit)> {
    let jobs = grown
        .iter()
        .take(WHOLE)
        .map(|f| windows.whole(search, f))
        .collect();
    search.fit_all(jobs);
    grown
        .iter()
        .take(WHOLE)
        .filter_map(|f| Some((judge(search, held, search.get(&f.set)?.clone())?, f.clone())))
        .min_by(|a, b| a.0.1.rms.total_cmp(&b.0.1.rms))
}

/// Members taken out as long as the runs are predicted as well without them: one that came early may do
/// nothing beside those that came later.
fn thinned(search: &mut Search<'_>, held: &[Track], mut now: Judged) -> Judged {
    while now.0.set.len() > 1 {
        let jobs: Vec<(Vec<usize>, Vec<f64>)> = (0..now.0.set.len())
            .map(|m| without(search.setting, &now.0, m))
            .collect();
        let sets: Vec<Vec<usize>> = jobs.iter().map(|j| j.0.clone()).collect();
        search.fit_all(jobs);
        let smaller = sets
            .iter()
            .filter_map(|s| judge(search, held, search.get(s)?.clone()))
            .min_by(|a, b| a.1.rms.total_cmp(&b.1.rms))
            .filter(|s| s.1.rms <= AS_WELL * now.1.rms);
        match smaller {
            Some(s) => now = s,
            None => break,
        }
    }
    now
}
