//! The runs held out once more, fitted along: do they show that a law is not quite the vocabulary's?
//!
//! A soft deadband is a hard one wherever the runs fitted command much more than its width; the run that
//! does not, and is missed for it, says which law it is that fails. How well the explanation predicts is told
//! from before this.

use super::look::{Care, look};
use crate::diagnose::family::Acts;
use crate::diagnose::fit::Fit;
use crate::diagnose::predict::predicted;
use crate::diagnose::search::Search;
use crate::diagnose::setting::Track;
use crate::diagnose::weights::Weights;

/// Additions looked at beside the set: what the runs held out show first may be one more effect.
const ADDED: usize = 4;
/// Times that one is taken.
const ROUNDS: usize = 2;
/// Half chi-square that one must promise.
const LEAST_GAIN: f64 = 6.0;

/// Log evidence that all runs together must gain: no election stands behind it, and the best of two dozen bends of an
/// exact law gains three now and then.
const LEAST_BEYOND: f64 = 5.0;
/// Half chi-square per sample above which no law comes near the noise, which leaves 0.5: every one would bend.
const FAR_FROM_NOISE: f64 = 2.0;

/// What all runs together say of a set that was found in some of them.
#[derive(Debug, Clone, PartialEq)]
pub enum Recheck {
    /// The law of this candidate is not quite the vocabulary's, in words.
    Inexact(usize, String),
    /// Something unnamed acts, in words.
    Unnamed(String),
}

/// Fits a set to all runs and looks for what bends its laws; `None` where they stand.
pub fn recheck(search: &Search<'_>, first: &Fit, held: &[Track]) -> Option<Recheck> {
    if held.is_empty() || first.set.is_empty() {
        return None;
    }
    let fitted = search.setting;
    let tracks: Vec<Track> = fitted.tracks.iter().chain(held).cloned().collect();
    let all = fitted.with_tracks(tracks);
    let mut used = search.weights.used.clone();
    used.extend(predicted(fitted, held, first, search.weights.noise)?.kept());
    let mut along = Search::new(&all, search.progress);
    along.weights =
        Weights::new(&all.tracks, search.weights.noise, used).at_rest(search.weights.rest_sd);
    along.blind = search.blind.clone();
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
    let best = along.finished(&set)?;
    if best.cost > FAR_FROM_NOISE * along.weights.samples() as f64 {
        return None;
    }
    let seen = look(&along, &best, Care::Above(f64::NEG_INFINITY));
    let info = |c: usize| fitted.vocabulary[c].info;
    let gain = seen.log_evidence - best.log_evidence;
    if gain < LEAST_BEYOND {
        return None;
    }
    match (&seen.twice, &seen.family) {
        (Some((c, _)), _) if first.set.contains(c) => Some(Recheck::Inexact(
            *c,
            format!("with the runs held out it acts twice (log Bayes factor {gain:.1})"),
        )),
        (None, Some(f)) => match f.family.acts {
            Acts::Bends(c) if first.set.contains(&c) => Some(Recheck::Inexact(
                c,
                format!(
                    "with the runs held out {} is not constant but depends on {} (log Bayes factor {gain:.1})",
                    info(c).parameters[0].name,
                    f.family.variable.name()
                ),
            )),
            Acts::Force if seen.family_weight > fitted.tolerance => {
                Some(Recheck::Unnamed(format!(
                    "the runs held out show a force that depends on {} and weighs {:.2e}, which the runs fitted do not",
                    f.family.variable.name(),
                    seen.family_weight
                )))
            }
            _ => None,
        },
        _ => None,
    }
}
