//! Marginals of the models visited, weighted by their scores.

use super::hyper::SIZES;
use super::search::Found;

/// Probability that a force of no known effect is worth more than the tolerance, from which it is said.
pub const UNNAMED: f64 = 0.5;

/// Probability that the random force of a DOF is worth more than the tolerance, beside one model.
pub fn above_tolerance(fit: &super::fit::Fit, dof: usize) -> f64 {
    let cells = fit.forces.iter().find(|s| s.0 == dof);
    cells.map_or(0.0, |cells| {
        // A cell reaches half-way to its neighbours: half of the tolerance's own lies above it.
        let above = |size: f64| match size {
            s if s > 1.0 => 1.0,
            1.0 => 0.5,
            _ => 0.0,
        };
        let each = cells.1.iter();
        each.map(|(cell, p)| p * above(SIZES[cell.size])).sum()
    })
}

/// A marginal of an effect.
#[derive(Debug, Clone, PartialEq)]
pub struct Marginal {
    /// Candidate, by index.
    pub candidate: usize,
    /// Probability that it is in the model.
    pub probability: f64,
}

/// The posterior.
#[derive(Debug, Clone, PartialEq)]
pub struct Posterior {
    /// (effects, probability) of every model visited, likeliest first.
    pub models: Vec<(Vec<usize>, f64)>,
    /// Every effect in any of them, likeliest first.
    pub effects: Vec<Marginal>,
    /// Per DOF that moves the probability that the random force is worth more than the tolerance.
    pub unnamed: Vec<(usize, f64)>,
}

/// Models visited, (terms, log score) each, as (terms, probability), likeliest first; and the marginal of each term in any of
/// them, likeliest first. The same at motion level and at image level.
pub fn marginals(scored: Vec<(Vec<usize>, f64)>) -> (Vec<(Vec<usize>, f64)>, Vec<Marginal>) {
    let best = scored.iter().map(|m| m.1).fold(f64::NEG_INFINITY, f64::max);
    let sum: f64 = scored.iter().map(|m| (m.1 - best).exp()).sum();
    let mut models: Vec<(Vec<usize>, f64)> = (scored.into_iter())
        .map(|(terms, score)| (terms, (score - best).exp() / sum))
        .collect();
    models.sort_by(|a, b| b.1.total_cmp(&a.1));
    let mut effects: Vec<Marginal> = Vec::new();
    for (terms, p) in &models {
        for t in terms {
            match effects.iter_mut().find(|e| e.candidate == *t) {
                Some(e) => e.probability += p,
                None => effects.push(Marginal {
                    candidate: *t,
                    probability: *p,
                }),
            }
        }
    }
    effects.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    (models, effects)
}

impl Posterior {
    /// Of what a search found.
    pub fn new(found: &Found) -> Posterior {
        let scored = found.models.values().map(|f| (f.terms.clone(), f.ln_score));
        let (models, effects) = marginals(scored.collect());
        let best = found.models.values().map(|f| f.ln_score);
        let best = best.fold(f64::NEG_INFINITY, f64::max);
        let sum: f64 = (found.models.values())
            .map(|f| (f.ln_score - best).exp())
            .sum();
        let share = |score: f64| (score - best).exp() / sum;
        let unnamed = found
            .problem
            .body
            .dofs
            .iter()
            .map(|d| {
                let of = |f: &super::fit::Fit| above_tolerance(f, *d);
                let all = found.models.values().map(|f| share(f.ln_score) * of(f));
                (*d, all.sum())
            })
            .collect();
        Posterior {
            models,
            effects,
            unnamed,
        }
    }
}
