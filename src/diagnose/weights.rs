//! How residuals are weighed: noise with its colour, the samples that count, and series laid end to end.

use nalgebra::{DMatrix, DVector};

use super::descent::Effort;
use super::rest;
use super::setting::{Setting, Track};
use hydroline_numerics::noise::{Noise, Series, Whitener, estimate};
use hydroline_numerics::statistics::{difference_sd, robust_sd};

/// Noise of a DOF's channel and which samples count; the same for every set that is compared.
#[derive(Debug, Clone)]
pub struct Weights {
    /// The noise.
    pub noise: Noise,
    /// `[run][sample]`: counts.
    pub used: Vec<Vec<bool>>,
    /// sd of the rate at the start of a run that begins at rest \[m/s, rad/s\]; `None` = the most there is.
    pub rest_sd: Option<f64>,
    whiteners: Vec<Whitener>,
}

impl Weights {
    /// Of this noise.
    pub fn new(tracks: &[Track], noise: Noise, used: Vec<Vec<bool>>) -> Weights {
        let whiteners = tracks
            .iter()
            .zip(&used)
            .map(|(t, u)| Whitener::new(&t.times_s, noise, |k| u[k]))
            .collect();
        Weights {
            noise,
            used,
            rest_sd: None,
            whiteners,
        }
    }

    /// The same for runs that begin as still as this.
    #[must_use]
    pub fn at_rest(self, rest_sd: Option<f64>) -> Weights {
        Weights { rest_sd, ..self }
    }

    /// Precision of what is believed of the rate at the start of a run that begins at rest \[s^2/m^2, s^2/rad^2\].
    pub fn rest_precision(&self, tolerance: f64) -> f64 {
        self.rest_sd
            .unwrap_or_else(|| rest::most(tolerance))
            .powi(-2)
    }

    /// White noise from third differences; a sample is left out where it stands apart from the cubic
    /// through its four neighbours: no model is asked.
    pub fn first(tracks: &[Track]) -> Weights {
        let sd = tracks
            .iter()
            .map(|t| difference_sd(&t.measured))
            .fold(0.0, f64::max);
        let used = tracks
            .iter()
            .map(|t| not_apart(&t.times_s, &t.measured))
            .collect();
        Weights::new(tracks, Noise::white(if sd > 0.0 { sd } else { 1e-6 }), used)
    }

    /// Whitens one run's series in place; what does not count becomes 0.
    pub fn whiten<'a>(&self, run: usize, series: impl Iterator<Item = &'a mut f64>) {
        self.whiteners[run].apply(series);
    }

    /// All runs' series whitened and laid end to end.
    pub fn stack(&self, mut series: Vec<Vec<f64>>) -> DVector<f64> {
        for (run, values) in series.iter_mut().enumerate() {
            self.whiten(run, values.iter_mut());
        }
        DVector::from_vec(series.into_iter().flatten().collect())
    }

    /// A fit to a percent of what lies above the noise, however far that is.
    pub fn to_a_percent(&self) -> Effort {
        Effort {
            floor: 0.5 * self.samples() as f64,
            limit: f64::INFINITY,
        }
    }

    /// Sum of the log variances of all samples that count, each given those before it.
    pub fn log_variance(&self) -> f64 {
        self.whiteners.iter().map(Whitener::log_variance).sum()
    }

    /// Samples that count.
    pub fn samples(&self) -> usize {
        self.used.iter().flatten().filter(|u| **u).count()
    }

    /// Share of samples left out.
    pub fn outliers(&self) -> f64 {
        let all: usize = self.used.iter().map(Vec::len).sum();
        1.0 - self.samples() as f64 / all.max(1) as f64
    }
}

/// Samples that count in both, run by run.
pub fn in_both(a: &[Vec<bool>], b: &[Vec<bool>]) -> Vec<Vec<bool>> {
    a.iter()
        .zip(b)
        .map(|(a, b)| a.iter().zip(b).map(|(x, y)| *x && *y).collect())
        .collect()
}

/// Robust sd from the cubic through its neighbours beyond which a sample may be an outlier.
const APART_SD: f64 = 6.0;
/// Without an outlier its neighbours fit each other at least this much better.
const ISOLATED: f64 = 0.5;

/// How far sample `present[i]` lies from the cubic through its four present neighbours.
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
fn not_apart(times_s: &[f64], values: &[f64]) -> Vec<bool> {
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
            let misfit = |without: &[usize]| {
                let mut near: Vec<usize> = rest
                    .iter()
                    .copied()
                    .chain([sample])
                    .filter(|k| !without.contains(k) && k.abs_diff(sample) < 12)
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

/// Noise of residuals from which `columns` (raw, runs end to end) have been fitted out.
///
/// Restricted likelihood: what the columns took of slow noise is put back.
pub fn noise_beyond(
    setting: &Setting,
    residuals: &[Vec<f64>],
    columns: &DMatrix<f64>,
) -> Option<(Noise, Vec<Vec<bool>>)> {
    let mut first = 0;
    let jacobians: Vec<DMatrix<f64>> = residuals
        .iter()
        .map(|r| {
            let rows = columns.rows(first, r.len()).into_owned();
            first += r.len();
            rows
        })
        .collect();
    let series: Vec<Series<'_>> = setting
        .tracks
        .iter()
        .zip(residuals)
        .zip(&jacobians)
        .map(|((t, r), j)| Series {
            times_s: &t.times_s,
            values: r,
            jacobian: Some(j),
        })
        .collect();
    estimate(&series)
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

    /// A carriage that is thrown about by its drive between quiet stretches: rough, but no outlier.
    #[test]
    fn rough_motion_is_no_outlier_and_many_outliers_are() {
        let times: Vec<f64> = (0..600).map(|k| 0.04 * f64::from(k)).collect();
        let rough = |k: usize| (k * 7919 % 101) as f64 / 50.0 - 1.0;
        let shaken: Vec<f64> = times
            .iter()
            .enumerate()
            .map(|(k, t)| {
                let shaking = if (k / 60) % 5 == 4 { 2e-3 } else { 0.0 };
                1e-5 * rough(k) + shaking * (17.0 * t).sin() + 0.1 * (0.5 * t).sin()
            })
            .collect();
        let left_out = not_apart(&times, &shaken).iter().filter(|u| !**u).count();
        assert!(left_out <= 6, "{left_out}");
        let struck: Vec<f64> = times
            .iter()
            .enumerate()
            .map(|(k, t)| {
                let hit = if k * 31 % 257 % 8 == 3 {
                    0.2 * rough(k + 7)
                } else {
                    0.0
                };
                1.5e-4 * rough(k) + hit + 0.1 * (0.5 * t).sin()
            })
            .collect();
        let left_out = not_apart(&times, &struck).iter().filter(|u| !**u).count();
        assert!(left_out > 36, "{left_out}");
    }
}
