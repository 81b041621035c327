//! Effects that are there together and of which the data show only the sum: they count once.
//!
//! A lag and a delay move a slow vehicle alike. Whether the data show that both are there is asked of the ideal
//! observer, never of what was found: the sets of a case are the same for whoever is judged.

use nalgebra::DVector;

use super::thresholds::{SCORED_M, SPLIT};
use crate::case::{Case, Truth};
use crate::error::ProveError;
use crate::observer::Ideal;
use hydroline_numerics::span::rms;

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

impl Sum {
    pub(super) fn holds(&self, effect: &str) -> bool {
        self.effects.iter().any(|e| e == effect)
    }
}

/// By how much two effects move alike: the cosine of what each leaves, 0 where one leaves nothing.
fn alike(one: &DVector<f64>, other: &DVector<f64>) -> f64 {
    let cosine = one.dot(other) / (one.norm() * other.norm());
    if cosine.is_nan() { 0.0 } else { cosine }
}

/// The sets of a case whose laws are all the library's; of those with a member over [`SCORED_M`].
pub(super) fn sums(case: &Case, ideal: &Ideal) -> Result<Vec<Sum>, ProveError> {
    let key = &case.key;
    let scale = key.tank.scale(&key.runs)?;
    let each = key.truth.iter().map(|t| {
        let left = scale.left_of_m(&[t.effect.as_str()])?;
        Ok((t, left))
    });
    let each: Vec<(&Truth, DVector<f64>)> = each.collect::<Result<_, ProveError>>()?;
    let mut made: Vec<Sum> = Vec::new();
    for (carrier, own) in &each {
        let free = |t: &Truth| !made.iter().any(|s| s.holds(&t.effect));
        if !free(carrier) {
            continue;
        }
        let mut others: Vec<&Truth> = Vec::new();
        for (other, left) in &each {
            if other.effect == carrier.effect || !free(other) || alike(own, left) < ALIKE {
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
        let effects: Vec<&str> = std::iter::once(*carrier)
            .chain(others)
            .map(|t| t.effect.as_str())
            .collect();
        made.push(Sum {
            weight_m: rms(&scale.left_of_m(&effects)?),
            effects: effects.into_iter().map(str::to_owned).collect(),
        });
    }
    Ok(made)
}
