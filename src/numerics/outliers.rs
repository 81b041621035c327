//! Outliers of a measurement, judged by the motion around them: no model is asked.
//!
//! [`crate::apart`] asks the same of residuals, by their noise over the whole series. A measurement moves: what is usual in
//! one stretch of it (a reversal, a stop, a hull rolled by hand) is not in another. So a sample is held against a parabola
//! through those around it, and against how far these are from it themselves.

use crate::statistics::{median, robust_sd};

/// Neighbours on either side that say how the motion goes on: a parabola has three numbers, and up to two of eight samples
/// may be outliers too (one in eight, in bad logs).
const SIDE: usize = 8;
/// Fewest on either side from which anything is said: else the parabola goes through them.
const SIDE_LEAST: usize = 3;
/// Largest group of outliers in a row; what stays away longer has moved, or is lost, and is no outlier.
const GROUP: usize = 3;
/// Neighbours' own deviation on the worse side beyond which a sample is an outlier. With 6 two in 10⁴ normal samples are, with 8
/// fewer than one in 10⁴; of a carriage whose position comes 8 ms late in one row of four 2.4 % and .9 %.
const LOCAL_SDS: f64 = 8.0;
/// Share of a side's neighbours, by the size of their residuals, whose largest is taken for its scale: with the median normal noise
/// makes 0.6 % of outliers, for eight residuals do not tell it well.
const SCALE_SHARE: f64 = 0.7;
/// sd of a normal distribution per size that this share of it stays within.
const SHARE_TO_SD: f64 = 0.964_849;
/// Quanta by which a coarse instrument strays: noise of .7 quanta leaves half of the values equal, hence a scale of 0, and six sd
/// of it are four.
const QUANTA: f64 = 4.0;
/// Share of second differences, the smallest first, whose largest is the quantum where the instrument is coarse: then nearly all are
/// whole quanta. Where it is not it is a fraction of the noise.
const QUANTUM_SHARE: f64 = 0.1;
/// Second differences below this share of the range are rounding.
const ROUNDING: f64 = 1e-9;
/// Stamps' jitter, in sd, that a sample may be early or late by.
const JITTER_SDS: f64 = 3.0;
/// Reweighted fits of the parabola: the sum of absolute residuals stands then to a few percent, which no limit asks for.
const ROUNDS: usize = 12;
/// Residual below which weights no longer grow, in median residuals.
const WEIGHT_FLOOR: f64 = 0.05;

/// Samples that are outliers. The times ascend, the values are finite.
///
/// An outlier stands in a group of at most three, farther from the parabola through its eight neighbours on either side (least
/// absolute residuals) than eight sd of these, on the worse side. It is never nearer than `floor` (what matters to nobody), four
/// quanta of the instrument, or the way made within the stamps' jitter.
pub fn outliers(times_s: &[f64], values: &[f64], floor: f64) -> Vec<bool> {
    let n = values.len().min(times_s.len());
    let mut found = vec![false; n];
    let series = Series::new(&times_s[..n], &values[..n], floor);
    if series.usual_s <= 0.0 {
        return found;
    }
    for i in series.suspects() {
        found[i] = series.is_beyond(i);
    }
    // A longer group has moved.
    let mut first = 0;
    while first < n {
        let group = found[first..].iter().take_while(|f| **f).count();
        if group > GROUP {
            found[first..first + group].fill(false);
        }
        first += group.max(1);
    }
    found
}

/// A channel with what its instrument and its stamps make of it.
struct Series<'a> {
    times_s: &'a [f64],
    values: &'a [f64],
    /// Usual distance of two stamps \[s\]; 0 of fewer than two.
    usual_s: f64,
    /// How far each step of the stamps is from a whole number of usual ones \[s\].
    off_s: Vec<f64>,
    /// Robust sd of these \[s\].
    jitter_s: f64,
    /// Deviation below which nothing is an outlier.
    least: f64,
}

impl<'a> Series<'a> {
    fn new(times_s: &'a [f64], values: &'a [f64], floor: f64) -> Series<'a> {
        let steps: Vec<f64> = times_s.windows(2).map(|w| w[1] - w[0]).collect();
        let usual_s = median(&mut steps.clone()).unwrap_or(0.0);
        let off = |step: &f64| (step - (step / usual_s).round().max(1.0) * usual_s).abs();
        let off_s: Vec<f64> = steps.iter().map(off).collect();
        Series {
            times_s,
            values,
            usual_s,
            jitter_s: robust_sd(&off_s),
            off_s,
            least: floor.max(QUANTA * quantum(values)),
        }
    }

    /// Samples near one that is off the line between its neighbours: all others are no outliers, and most are.
    fn suspects(&self) -> Vec<usize> {
        let n = self.values.len();
        let mut near = vec![false; n];
        for i in 1..n.saturating_sub(1) {
            let (t, v) = (self.times_s, self.values);
            let share = (t[i] - t[i - 1]) / (t[i + 1] - t[i - 1]);
            let line = v[i - 1] + share * (v[i + 1] - v[i - 1]);
            // At the edge of a group half of the deviation shows, or less where stamps are uneven.
            if (v[i] - line).abs() > 0.25 * self.least {
                near[i.saturating_sub(GROUP)..(i + GROUP + 1).min(n)].fill(true);
            }
        }
        (0..n).filter(|i| near[*i]).collect()
    }

    /// Whether a sample is farther from its neighbours' parabola than they and its limits allow.
    fn is_beyond(&self, i: usize) -> bool {
        let reach_s = 2.0 * SIDE as f64 * self.usual_s;
        let near = |k: &usize| (self.times_s[*k] - self.times_s[i]).abs() <= reach_s;
        let before: Vec<usize> = (i.saturating_sub(SIDE)..i).filter(near).collect();
        let after: Vec<usize> = (i + 1..(i + 1 + SIDE).min(self.values.len()))
            .filter(near)
            .collect();
        if before.len() < SIDE_LEAST || after.len() < SIDE_LEAST {
            return false;
        }
        let around: Vec<[f64; 2]> = before
            .iter()
            .chain(&after)
            .map(|k| {
                let t = (self.times_s[*k] - self.times_s[i]) / self.usual_s;
                // From the sample on, so that no digits are lost.
                [t / SIDE as f64, self.values[*k] - self.values[i]]
            })
            .collect();
        let Some((expected, residuals)) = parabola(&around) else {
            return false;
        };
        let (left, right) = residuals.split_at(before.len());
        let local = scale(left).max(scale(right));
        let limit = (LOCAL_SDS * local).max(self.least);
        expected.abs() > limit.max(JITTER_SDS * self.stray_s(i) * self.speed(&before, &after))
    }

    /// How early or late a sample may be: the log's jitter, or that of the steps beside it.
    fn stray_s(&self, i: usize) -> f64 {
        let beside = self.off_s[i.saturating_sub(1)..(i + 1).min(self.off_s.len())].iter();
        beside.fold(self.jitter_s, |most, off| most.max(*off))
    }

    /// Median speed of the neighbours.
    fn speed(&self, before: &[usize], after: &[usize]) -> f64 {
        let step = |w: &[usize]| {
            let way = self.values[w[1]] - self.values[w[0]];
            (way / (self.times_s[w[1]] - self.times_s[w[0]])).abs()
        };
        let all = before.windows(2).chain(after.windows(2)).map(step);
        median(&mut all.filter(|v| v.is_finite()).collect::<Vec<_>>()).unwrap_or(0.0)
    }
}

/// Step of a coarse instrument; of a fine one a fraction of its noise.
fn quantum(values: &[f64]) -> f64 {
    let (low, high) = crate::statistics::extent(values.iter().copied());
    let mut second: Vec<f64> = values
        .windows(3)
        .map(|w| (w[2] - 2.0 * w[1] + w[0]).abs())
        .filter(|v| *v > ROUNDING * (high - low))
        .collect();
    second.sort_by(f64::total_cmp);
    let at = (QUANTUM_SHARE * second.len() as f64) as usize;
    second.get(at).copied().unwrap_or(0.0)
}

/// Robust sd of a side's residuals.
fn scale(residuals: &[f64]) -> f64 {
    let mut sizes: Vec<f64> = residuals.iter().map(|r| r.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    let within = (SCALE_SHARE * sizes.len() as f64).ceil() as usize;
    let at = within.max(1) - 1;
    sizes.get(at).map_or(0.0, |size| size * SHARE_TO_SD)
}

/// Value at 0 of the parabola of least absolute residuals through (time, value), and the residuals.
///
/// Iteratively reweighted least squares; `None` where the points leave it open.
fn parabola(points: &[[f64; 2]]) -> Option<(f64, Vec<f64>)> {
    let mut weights = vec![1.0; points.len()];
    let mut made = None;
    for _ in 0..ROUNDS {
        let [a, b, c] = weighted(points, &weights)?;
        let residuals: Vec<f64> = points
            .iter()
            .map(|[t, v]| v - (a + t * (b + t * c)))
            .collect();
        let mut sizes: Vec<f64> = residuals.iter().map(|r| r.abs()).collect();
        let usual = median(&mut sizes).unwrap_or(0.0);
        let largest = sizes.last().copied().unwrap_or(0.0);
        let least = (WEIGHT_FLOOR * usual).max(f64::EPSILON * largest);
        for (w, r) in weights.iter_mut().zip(&residuals) {
            // One is the heaviest, so that sums stay finite.
            *w = least / r.abs().max(least);
        }
        made = Some((a, residuals));
        // All lie on it.
        if least <= 0.0 {
            break;
        }
    }
    made
}

/// Coefficients of the weighted parabola, by the normal equations (Cramer's rule).
fn weighted(points: &[[f64; 2]], weights: &[f64]) -> Option<[f64; 3]> {
    let (mut s, mut y) = ([0.0; 5], [0.0; 3]);
    for ([t, v], w) in points.iter().zip(weights) {
        let mut power = *w;
        for (k, sum) in s.iter_mut().enumerate() {
            *sum += power;
            if let Some(right) = y.get_mut(k) {
                *right += power * v;
            }
            power *= t;
        }
    }
    let rows = [[s[0], s[1], s[2]], [s[1], s[2], s[3]], [s[2], s[3], s[4]]];
    let whole = determinant(&rows);
    let of = |column: usize| {
        let mut changed = rows;
        for (row, right) in changed.iter_mut().zip(&y) {
            row[column] = *right;
        }
        determinant(&changed) / whole
    };
    let found = [of(0), of(1), of(2)];
    found.iter().all(|v| v.is_finite()).then_some(found)
}

fn determinant([a, b, c]: &[[f64; 3]; 3]) -> f64 {
    a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng, rngs::StdRng};
    use rand_distr::{Distribution, StandardNormal};

    const TOLERANCE_M: f64 = 2e-3;

    fn times(n: usize, rate_hz: f64) -> Vec<f64> {
        (0..n).map(|k| k as f64 / rate_hz).collect()
    }

    fn noise(rng: &mut StdRng) -> f64 {
        StandardNormal.sample(rng)
    }

    fn count(times_s: &[f64], values: &[f64], floor: f64) -> usize {
        outliers(times_s, values, floor)
            .iter()
            .filter(|o| **o)
            .count()
    }

    #[test]
    fn spikes_of_one_to_three_samples_are_found_and_nothing_beside_them() {
        let t = times(1500, 25.0);
        for size_m in [0.5, 10.0 * TOLERANCE_M, -10.0 * TOLERANCE_M] {
            for group in 1..=3 {
                let mut rng = StdRng::seed_from_u64(group as u64);
                let mut x: Vec<f64> = t
                    .iter()
                    .map(|t| 0.3 * (0.2 * t).sin() + 2e-4 * noise(&mut rng))
                    .collect();
                x[700..700 + group].iter_mut().for_each(|v| *v += size_m);
                let found = outliers(&t, &x, TOLERANCE_M);
                let at: Vec<usize> = (0..x.len()).filter(|k| found[*k]).collect();
                assert_eq!(at, (700..700 + group).collect::<Vec<_>>(), "{size_m}");
            }
        }
    }

    #[test]
    fn a_step_that_stays_is_no_outlier() {
        let t = times(400, 25.0);
        let x: Vec<f64> = t
            .iter()
            .map(|t| 0.1 * t + if *t > 8.0 { 0.5 } else { 0.0 })
            .collect();
        assert_eq!(count(&t, &x, TOLERANCE_M), 0);
    }

    /// 8.6 % of a drive's encoder, 6.9 % of a ship's yaw, 5.2 % of an ROV's were called outliers: quiet stretches and fast ones
    /// in one log, seen by an instrument finer than either.
    #[test]
    fn fast_stretches_between_quiet_ones_hold_no_outliers() {
        for (rate_hz, noise_m) in [(50.0, 3e-5), (200.0, 3e-5), (10.0, 1e-6)] {
            let t = times(2000, rate_hz);
            let mut rng = StdRng::seed_from_u64(3);
            // At rest, thrown about, at rest: every sixth part of the log.
            let x: Vec<f64> = t
                .iter()
                .enumerate()
                .map(|(k, t)| {
                    let shaken = if (k / 120) % 6 == 5 { 0.02 } else { 0.0 };
                    shaken * (9.0 * t).sin() + noise_m * noise(&mut rng)
                })
                .collect();
            assert_eq!(count(&t, &x, TOLERANCE_M), 0, "{rate_hz}");
        }
    }

    #[test]
    fn a_ball_that_bounces_at_23_mps_holds_no_outliers() {
        for rate_hz in [25.0, 100.0, 200.0] {
            let t = times(2000, rate_hz);
            let x: Vec<f64> = t
                .iter()
                .map(|t| 23.0 * ((t + 0.3).rem_euclid(2.0) - 1.0).abs())
                .collect();
            assert_eq!(count(&t, &x, TOLERANCE_M), 0, "{rate_hz}");
        }
    }

    #[test]
    fn late_stamps_and_coarse_steps_are_no_outliers() {
        // One stamp in fifty is written 20 ms late, at 1 m/s.
        let real_s = times(1000, 25.0);
        let late = |k: usize| if k % 50 == 7 { 0.02 } else { 0.0 };
        let t: Vec<f64> = real_s
            .iter()
            .enumerate()
            .map(|(k, t)| t + late(k))
            .collect();
        assert_eq!(count(&t, &real_s, TOLERANCE_M), 0);
        // A resolution of 10 mm, with noise of .3 of it.
        let mut rng = StdRng::seed_from_u64(5);
        let coarse: Vec<f64> = real_s
            .iter()
            .map(|t| (10.0 * (0.3 * t).sin() + 0.3 * noise(&mut rng)).round() * 0.01)
            .collect();
        assert_eq!(count(&real_s, &coarse, TOLERANCE_M), 0);
    }

    #[test]
    fn noise_of_any_size_is_no_outlier_and_one_sample_in_eight_that_is_shows() {
        let t = times(6000, 25.0);
        let mut rng = StdRng::seed_from_u64(7);
        let noisy: Vec<f64> = t
            .iter()
            .map(|t| 0.1 * (0.5 * t).sin() + 5e-3 * noise(&mut rng))
            .collect();
        assert!(count(&t, &noisy, 1e-4) < 6);
        let struck: Vec<f64> = t
            .iter()
            .map(|t| {
                let hit = rng.random::<f64>() < 0.125;
                let off = if hit {
                    0.4 * (rng.random::<f64>() - 0.5)
                } else {
                    0.0
                };
                0.5 * (0.3 * t).sin() + off + 1.5e-4 * noise(&mut rng)
            })
            .collect();
        let share = count(&t, &struck, TOLERANCE_M) as f64 / t.len() as f64;
        assert!((0.08..0.14).contains(&share), "{share}");
    }

    #[test]
    fn nothing_is_said_of_a_few_samples_or_equal_stamps() {
        assert!(outliers(&[], &[], 1.0).is_empty());
        assert_eq!(outliers(&[0.0, 0.1], &[0.0, 5.0], 1.0), [false; 2]);
        assert_eq!(count(&[1.0; 30], &[3.0; 30], 1.0), 0);
    }
}
