//! Effects that are there together and of which the data show only the sum: they count once.
//!
//! A lag and a delay move a slow vehicle alike. Whether the data show that both are there is asked of the ideal
//! observer, never of what was found: the sets of a case are the same for whoever is judged.

use super::tally::SCORED_M;
use super::undecided::SPLIT;
use crate::prove::case::{Case, Truth};
use crate::prove::error::ProveError;
use crate::prove::observer::Ideal;

/// Cosine of what two effects leave in the motion from which on one moves as the other.
const ALIKE: f64 = 0.9;

/// A set of effects that the data cannot split.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Sum {
    /// There, all of them.
    pub(super) effects: Vec<String>,
    /// Weight together \[m\].
    pub(super) weight_m: f64,
}

/// The sets of a case whose laws are all the vocabulary's; of those with a member over [`SCORED_M`].
pub(super) fn sums(case: &Case, ideal: &Ideal) -> Result<Vec<Sum>, ProveError> {
    let key = &case.key;
    let scale = key.tank.scale(&key.runs)?;
    let mut made: Vec<Sum> = Vec::new();
    for carrier in &key.truth {
        let free = |t: &&Truth| t.effect != carrier.effect && free_of(&made, &t.effect);
        if !free_of(&made, &carrier.effect) {
            continue;
        }
        let mut others: Vec<&Truth> = Vec::new();
        for other in key.truth.iter().filter(free) {
            if scale.alike(&carrier.effect, &other.effect)? < ALIKE {
                continue;
            }
            others.push(other);
            // All of them at once: what two could each do without the other they cannot both.
            let ids: Vec<&str> = others.iter().map(|t| t.effect.as_str()).collect();
            if !ideal.worth(&ids).is_some_and(|w| w < SPLIT) {
                others.pop();
            }
        }
        let heavy = |t: &Truth| t.weight_m > SCORED_M;
        if others.is_empty() || !(heavy(carrier) || others.iter().any(|t| heavy(t))) {
            continue;
        }
        let effects: Vec<&str> = std::iter::once(carrier)
            .chain(others)
            .map(|t| t.effect.as_str())
            .collect();
        made.push(Sum {
            weight_m: scale.together_m(&effects)?,
            effects: effects.into_iter().map(str::to_owned).collect(),
        });
    }
    Ok(made)
}

fn free_of(made: &[Sum], effect: &str) -> bool {
    !made.iter().any(|s| s.effects.iter().any(|e| e == effect))
}
