//! Samples that stand apart from their neighbours: no model is asked.

use crate::statistics::robust_sd;

/// Robust sd from the cubic through its neighbours beyond which a sample may be an outlier.
const APART_SD: f64 = 6.0;
/// Without an outlier its neighbours fit each other at least this much better.
const ISOLATED: f64 = 0.5;

/// Distance of sample `present[i]` from the cubic through its four present neighbours.
fn apart(times_s: &[f64], values: &[f64], present: &[usize], i: usize) -> f64 {
    if i < 2 || i + 2 >= present.len() {
        return 0.0;
    }
    let around = [
        present[i - 2],
        present[i - 1],
        present[i + 1],
        present[i + 2],
    ];
    let t = times_s[present[i]];
    // Lagrange's weights.
    let expected: f64 = around
        .iter()
        .map(|a| {
            let weight: f64 = around
                .iter()
                .filter(|b| *b != a)
                .map(|b| (t - times_s[*b]) / (times_s[*a] - times_s[*b]))
                .product();
            weight * values[*a]
        })
        .sum();
    (values[present[i]] - expected).abs()
}

/// Samples that are no outliers. An outlier lies beyond six robust sd of the cubic through its
/// neighbours AND is isolated: without it (or a pair) the neighbours fit each other. Where motion is
/// rougher than a cubic, at a reversal under friction, they do not, and nothing is left out.
pub fn not_apart(times_s: &[f64], values: &[f64]) -> Vec<bool> {
    let n = values.len();
    let mut used = vec![true; n];
    let mut motion = vec![false; n];
    for _ in 0..6 {
        let present: Vec<usize> = (0..n).filter(|k| used[*k]).collect();
        let sizes: Vec<f64> = (0..present.len())
            .map(|i| apart(times_s, values, &present, i))
            .collect();
        let limit = APART_SD * robust_sd(&sizes);
        let beyond: Vec<usize> = (0..present.len())
            .filter(|&i| {
                let around = &sizes[i.saturating_sub(2)..(i + 3).min(sizes.len())];
                limit > 0.0
                    && sizes[i] > limit
                    && !motion[present[i]]
                    && around.iter().all(|v| sizes[i] >= *v)
            })
            .collect();
        if beyond.is_empty() {
            break;
        }
        let rest: Vec<usize> = (0..present.len())
            .filter(|i| beyond.binary_search(i).is_err())
            .map(|i| present[i])
            .collect();
        for i in beyond {
            let sample = present[i];
            let bar = limit.max(ISOLATED * sizes[i]);
            // Misfit of those around it among themselves without some of them.
            let beside =
                [sample.saturating_sub(11), sample + 12].map(|k| rest.partition_point(|r| *r < k));
            let misfit = |without: &[usize]| {
                let mut near: Vec<usize> = rest[beside[0]..beside[1]]
                    .iter()
                    .copied()
                    .chain([sample])
                    .filter(|k| !without.contains(k))
                    .collect();
                near.sort_unstable();
                let at = near.partition_point(|k| *k < sample);
                (at.saturating_sub(3)..(at + 3).min(near.len()))
                    .map(|j| apart(times_s, values, &near, j))
                    .fold(0.0, f64::max)
            };
            // Alone, or a pair: with a neighbour, or the two beside it (which throw it off most).
            let beside = |by: isize| present.get(i.wrapping_add_signed(by)).copied();
            let pairs = [(0, 0), (0, 1), (-1, 0), (1, 2), (-2, -1)];
            let found = pairs
                .into_iter()
                .filter_map(|(a, b)| Some([beside(a)?, beside(b)?]))
                .find(|pair| misfit(pair) < bar);
            if let Some(pair) = found {
                pair.into_iter().for_each(|k| used[k] = false);
            } else {
                motion[sample] = true;
            }
        }
    }
    used
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_apart_is_left_out_and_a_kink_is_not() {
        let times: Vec<f64> = (0..300).map(|k| 0.04 * f64::from(k)).collect();
        // Deterministic roughness of 0.1 mm over a start from rest.
        let mut values: Vec<f64> = times
            .iter()
            .enumerate()
            .map(|(k, t)| {
                1e-4 * ((k * 7919 % 101) as f64 / 50.0 - 1.0) + 0.05 * (t - 4.0).max(0.0).powi(2)
            })
            .collect();
        values[50] += 0.004;
        values[51] += 0.004;
        values[200] -= 0.01;
        let used = not_apart(&times, &values);
        assert!(!used[50] || !used[51]);
        assert!(!used[200]);
        assert!(used.iter().filter(|u| !**u).count() <= 6);
        assert!(used[98..104].iter().all(|u| *u));
    }

    /// A carriage that is thrown about by its drive between quiet stretches: shaken, but no outlier.
    #[test]
    fn shaken_motion_is_no_outlier_and_many_outliers_are() {
        let times: Vec<f64> = (0..600).map(|k| 0.04 * f64::from(k)).collect();
        let shake = |k: usize| (k * 7919 % 101) as f64 / 50.0 - 1.0;
        let shaken: Vec<f64> = times
            .iter()
            .enumerate()
            .map(|(k, t)| {
                let shaking = if (k / 60) % 5 == 4 { 2e-3 } else { 0.0 };
                1e-5 * shake(k) + shaking * (17.0 * t).sin() + 0.1 * (0.5 * t).sin()
            })
            .collect();
        let left_out = not_apart(&times, &shaken).iter().filter(|u| !**u).count();
        assert!(left_out <= 6, "{left_out}");
        let struck: Vec<f64> = times
            .iter()
            .enumerate()
            .map(|(k, t)| {
                let hit = if k * 31 % 257 % 8 == 3 {
                    0.2 * shake(k + 7)
                } else {
                    0.0
                };
                1.5e-4 * shake(k) + hit + 0.1 * (0.5 * t).sin()
            })
            .collect();
        let left_out = not_apart(&times, &struck).iter().filter(|u| !**u).count();
        assert!(left_out > 36, "{left_out}");
    }
}
