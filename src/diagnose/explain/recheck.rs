//! The runs held out once more, fitted along: do they show that a law is not quite the vocabulary's?
//!
//! A soft deadband is a hard one wherever the runs fitted command much more than its width; the run that
//! does not, and is missed for it, says which law it is that fails. How well the explanation predicts is told
//! from before this.

use super::along::{FAR_FROM_NOISE, all_runs, along};
use super::look::{Care, INEXACT, look};
use crate::family::Acts;
use crate::fit::Fit;
use crate::search::Search;
use crate::setting::Track;

/// Log evidence that a function must gain in all runs together: no election stands behind it, and the best of two dozen bends
/// of an exact law gains three now and then. A second copy is one choice, which its evidence has paid for.
const LEAST_BEYOND: f64 = 5.0;

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
    let all = all_runs(search, held);
    let (mut along, set) = along(search, &all, first)?;
    let best = along.finished(&set)?;
    if best.cost > FAR_FROM_NOISE * along.weights.samples() as f64 {
        return None;
    }
    let seen = look(&along, &best, Care::Above(f64::NEG_INFINITY));
    let info = |c: usize| fitted.vocabulary[c].info;
    let gain = seen.log_evidence - best.log_evidence;
    let least = if seen.twice.is_some() {
        INEXACT
    } else {
        LEAST_BEYOND
    };
    if gain < least {
        return None;
    }
    match (&seen.twice, &seen.family) {
        (Some((c, _)), _) if first.set.contains(c) => Some(Recheck::Inexact(
            *c,
            format!(
                "with the runs held out it acts as {} would (log Bayes factor {gain:.1})",
                if info(*c).parameters[0].corner {
                    "many side by side"
                } else {
                    "two in a row"
                }
            ),
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
