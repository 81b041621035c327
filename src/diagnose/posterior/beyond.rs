//! What effects too small to be in any set that was fitted may still do to the numbers of the best one.
//!
//! In a tank every effect is there at once, most of them small (physics.md). One that the data neither show
//! nor exclude moves what is fitted: by how much is a part of what is not known (Hoeting et al. 1999). So each
//! is taken with its odds, its size integrated over its prior, linearised at the best set.

use std::collections::BTreeMap;

use nalgebra::DVector;
use rayon::prelude::*;

use crate::bank::outside;
use crate::fit::{Fit, INCLUSION, Posed};
use crate::search::{LEAST_GAIN, Search};
use crate::weight::own_span;

/// Share of a response's information outside of what is fitted, below which it is a blind spot's.
const OWN_SHARE: f64 = 1e-6;
/// Points at which a size is integrated.
const POINTS: usize = 240;
/// Smallest size asked, over the largest.
const SMALLEST: f64 = 1e-4;

/// What may be beyond a set, and how far it would move what is in it.
#[derive(Debug, Clone, Default)]
pub struct Beyond {
    /// Mean square change of each unknown of the set. The expected change itself is left out: near twins (a delay,
    /// a lag) each claim the same residual, and their changes would add up.
    pub variance: Vec<f64>,
}

/// Odds and mean square of one response's multiple.
struct Moments {
    evidence: f64,
    square: f64,
}

/// Likelihood exp(-product a - energy a^2 / 2) times the prior of sizes, integrated over 0 < a <= most.
fn moments(product: f64, energy: f64, most: f64, density: impl Fn(f64) -> f64) -> Moments {
    let ratio = (1.0 / SMALLEST).powf(1.0 / POINTS as f64);
    let (mut zero, mut two) = (0.0, 0.0);
    let mut a = SMALLEST * most;
    for _ in 0..POINTS {
        let next = a * ratio;
        let middle = 0.5 * (a + next);
        let likelihood = (-product * middle - 0.5 * energy * middle * middle).exp();
        let mass = density(middle) * likelihood * (next - a);
        zero += mass;
        two += mass * middle * middle;
        a = next;
    }
    Moments {
        evidence: zero,
        square: two / zero.max(1e-300),
    }
}

impl Beyond {
    /// Of candidates with which the set was not fitted.
    pub fn of(search: &Search<'_>, fit: &Fit) -> Option<Beyond> {
        let setting = search.setting;
        let posed = Posed::new(setting, &search.weights, &fit.set);
        let jacobian = posed.jacobian(&fit.at);
        let covariance = fit.covariance();
        if covariance.iter().any(|v| !v.is_finite()) {
            return None;
        }
        let residual = search.weights.stack(fit.residuals(setting));
        let own = own_span(setting, fit);
        let fitted = |candidate: usize| {
            let mut larger = fit.set.clone();
            larger.insert(fit.set.partition_point(|c| *c < candidate), candidate);
            search.get(&larger).is_some()
        };
        // One response with its odds (prior of the effect left out) and what its unit does to each unknown.
        let found: Vec<(usize, Moments, DVector<f64>)> = search
            .bank()
            .par_iter()
            .zip(search.white())
            .filter_map(|(response, white)| {
                let candidate = &setting.vocabulary[response.candidate];
                let size = candidate.size?;
                let first = candidate.info.parameters.first()?;
                let unit = (candidate.starts[response.start][0] - size.nothing).abs();
                // A limit does nothing in proportion to its size.
                if fit.set.contains(&response.candidate)
                    || search.blind.contains(&response.candidate)
                    || first.bounds_load
                    || unit <= 0.0
                    || fitted(response.candidate)
                {
                    return None;
                }
                let along = jacobian.tr_mul(white);
                let moved = -(&covariance * &along);
                let energy = white.norm_squared() + along.dot(&moved);
                if energy < OWN_SHARE * white.norm_squared() || !energy.is_finite() {
                    return None;
                }
                // Heavier than what matters it would be another explanation.
                let left = outside(&own, &response.column);
                let weight = left.norm() / (left.len().max(1) as f64).sqrt();
                let matters = setting.tolerance / weight.max(1e-300);
                let most = (size.largest / unit).min(matters);
                let density = |a: f64| {
                    unit / size.largest * size.log_prior(size.nothing + a * unit, 0.0).exp()
                };
                let product = white.dot(&residual);
                // What promises more was fitted with the set, and judged there.
                if product < 0.0 && 0.5 * product * product > LEAST_GAIN * energy {
                    return None;
                }
                let made = moments(product, energy, most, density);
                made.evidence
                    .is_finite()
                    .then_some((response.candidate, made, moved))
            })
            .collect();
        let mut by_candidate: BTreeMap<usize, Vec<(Moments, DVector<f64>)>> = BTreeMap::new();
        for (candidate, made, moved) in found {
            by_candidate
                .entry(candidate)
                .or_default()
                .push((made, moved));
        }
        let n = fit.at.len();
        let mut all = Beyond {
            variance: vec![0.0; n],
        };
        for of in by_candidate.values() {
            // Its other parameters (a period, a place) are anyone's guess: its starting points share the prior.
            let share = INCLUSION.exp() / of.len() as f64;
            let odds: f64 = of.iter().map(|(m, _)| share * m.evidence).sum();
            let there = 1.0 / (1.0 + odds);
            for k in 0..n {
                all.variance[k] += of
                    .iter()
                    .map(|(m, moved)| share * m.evidence * there * m.square * moved[k] * moved[k])
                    .sum::<f64>();
            }
        }
        Some(all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against the normal integral: a flat prior on a wide range, a likelihood well within it.
    #[test]
    fn moments_are_those_of_the_posterior() {
        let (mean, sd, most) = (0.5_f64, 0.05_f64, 2.0_f64);
        let energy = 1.0 / (sd * sd);
        let product = -mean * energy;
        let m = moments(product, energy, most, |_| 1.0 / most);
        let expected =
            (0.5 * mean * mean * energy).exp() * sd * std::f64::consts::TAU.sqrt() / most;
        assert!(
            (m.evidence / expected - 1.0).abs() < 0.02,
            "{}",
            m.evidence / expected
        );
        assert!((m.square / (mean * mean + sd * sd) - 1.0).abs() < 0.01);
    }

    /// Nothing measured: what is left is the prior.
    #[test]
    fn without_information_the_prior_stands() {
        let m = moments(0.0, 0.0, 1.0, |_| 1.0);
        assert!((m.evidence - 1.0).abs() < 1e-3 && (m.square - 1.0 / 3.0).abs() < 1e-3);
    }
}
