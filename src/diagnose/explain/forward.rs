//! Where no law is exact: effects one by one (or two at once), by what each gains in prediction.
//!
//! There likelihoods compare errors of laws, and the most likely set is a long one that mends them. So the
//! runs held out decide: an effect stays where they are predicted better by more than the errors vary.

use std::collections::BTreeSet;

use super::Explanation;
use super::windows::{Windows, pieces};
use crate::bank::without;
use crate::fit::Fit;
use crate::predict::{BETTER_T, Prediction, predicted};
use crate::search::Search;
use crate::setting::{COEFFICIENTS, Track};

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
/// rms of the runs held out with an effect over that without it from which it is worth its place: it takes away nearly
/// half of the squared error. Where no law is exact, mending a law with another one gains a tenth or two.
const WORTH: f64 = 0.75;
/// The same over whole runs, of what was judged in windows.
const WORTH_ON_THE_WHOLE: f64 = 0.97;
/// The same from which an effect is told to gain in the place of another one.
pub(crate) const GAINS: f64 = 0.9;
/// Without a member over with it, up to which it is not.
const AS_WELL: f64 = 1.01;

/// A fit with what it predicts.
type Judged = (Fit, Prediction);

/// What predictions are asked of.
struct Judge {
    windows: Windows,
    /// Runs held out, or windows of them.
    held: Vec<Track>,
    /// Runs held out, whole.
    whole: Vec<Track>,
    /// Sets are fitted and predict in windows: what nothing takes back to its place runs off over a whole run, by
    /// what adds up and not by what is large.
    in_windows: bool,
}

impl Judge {
    /// What sets predict that were fitted in windows, each beside its fit there.
    fn judged(&self, search: &mut Search<'_>, fits: &[Fit]) -> Vec<(Judged, Fit)> {
        if !self.in_windows {
            let jobs = fits.iter().map(|f| self.windows.whole(search, f)).collect();
            search.fit_all(jobs);
        }
        fits.iter()
            .filter_map(|seen| {
                let fit = if self.in_windows {
                    seen
                } else {
                    search.get(&seen.set)?
                };
                let made = predicted(search.setting, &self.held, fit, search.weights.noise)?;
                made.rms
                    .is_finite()
                    .then(|| ((fit.clone(), made), seen.clone()))
            })
            .collect()
    }

    /// Whether a set predicts better than another, in windows and on the whole: what only mends a law for a second, and
    /// over a run is worth nothing, is not missing.
    fn worth(&self, search: &Search<'_>, new: &Judged, old: &Judged) -> bool {
        let better = |new: &Prediction, old: &Prediction, share: f64| {
            new.rms < share * old.rms && new.better_than(old) > BETTER_T
        };
        let whole = |fit: &Fit| predicted(search.setting, &self.whole, fit, search.weights.noise);
        better(&new.1, &old.1, WORTH)
            && (!self.in_windows
                || whole(&new.0)
                    .zip(whole(&old.0))
                    .is_some_and(|(new, old)| better(&new, &old, WORTH_ON_THE_WHOLE)))
    }

    /// Of sets that predict the one that does so best, if it predicts better than another one.
    fn best(
        &self,
        search: &Search<'_>,
        mut seen: Vec<(Judged, Fit)>,
        than: &Judged,
    ) -> Option<(Judged, Fit)> {
        // From the best on: whether one is worth it takes predictions of whole runs.
        seen.sort_by(|a, b| a.0.1.rms.total_cmp(&b.0.1.rms));
        seen.into_iter().find(|f| self.worth(search, &f.0, than))
    }
}

/// Those of sets fitted in windows, best first, that are asked to predict.
fn first(grown: &[Fit]) -> &[Fit] {
    &grown[..grown.len().min(WHOLE)]
}

/// The set that predicts, grown from nothing; `None` where nothing can be predicted.
pub fn forward(search: &mut Search<'_>, held: &[Track]) -> Option<Explanation> {
    let in_windows = !search.setting.is_restored();
    let judge = Judge {
        windows: Windows::of(search),
        held: if in_windows {
            pieces(held)
        } else {
            held.to_vec()
        },
        whole: held.to_vec(),
        in_windows,
    };
    let windows = &judge.windows;
    let nothing = search.finished(&[])?;
    let mut seen = windows.fit(&[], nothing.globals(search.setting))?;
    search.fit_all(vec![windows.whole(search, &seen)]);
    let (mut now, _) = judge.judged(search, std::slice::from_ref(&seen)).pop()?;
    let mut also = BTreeSet::new();
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
        let mut distinct = BTreeSet::new();
        pairs.retain(|f| distinct.insert(f.set.clone()));
        let seen_singles = judge.judged(search, first(&singles));
        let gaining = seen_singles
            .iter()
            .filter(|f| f.0.1.rms < GAINS * now.1.rms);
        also.extend(
            gaining.filter_map(|f| f.1.set.iter().copied().find(|c| !now.0.set.contains(c))),
        );
        let single = judge.best(search, seen_singles, &now);
        let seen_pairs = judge.judged(search, first(&pairs));
        let pair = judge.best(search, seen_pairs, &now);
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
        now = thinned(search, &judge, better);
        seen = if now.0.set == grown {
            from
        } else if let Some(fit) = windows.fit(&now.0.set, now.0.globals(search.setting)) {
            fit
        } else {
            break;
        };
    }
    search.fit_all(vec![windows.whole(search, &seen)]);
    let whole = search.finished(&now.0.set);
    let fit = whole.or((!in_windows).then_some(now.0))?;
    also.retain(|c| !fit.set.contains(c));
    Some(Explanation {
        by_prediction: true,
        also: also.into_iter().collect(),
        ..Explanation::plain(search, &fit)
    })
}

/// Members taken out as long as the runs are predicted as well without them: one that came early may do
/// nothing beside those that came later.
fn thinned(search: &mut Search<'_>, judge: &Judge, mut now: Judged) -> Judged {
    while now.0.set.len() > 1 {
        let smaller: Vec<Fit> = (0..now.0.set.len())
            .map(|m| without(search.setting, &now.0, m))
            .filter_map(|(set, at)| {
                let globals = &at[..COEFFICIENTS + search.setting.parameters(&set)];
                judge.windows.fit(&set, globals)
            })
            .collect();
        let smaller = judge
            .judged(search, &smaller)
            .into_iter()
            .min_by(|a, b| a.0.1.rms.total_cmp(&b.0.1.rms))
            .map(|(judged, _)| judged)
            .filter(|s| s.1.rms <= AS_WELL * now.1.rms);
        match smaller {
            Some(s) => now = s,
            None => break,
        }
    }
    now
}
