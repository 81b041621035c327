//! One coordinate as it moved: position and rate at every stamp, from noisy samples of either.
//!
//! Its jerk is white noise of a size that the samples say (maximum likelihood, the scale of the noise taken out), which makes
//! the estimate a smoothing spline; between stamps it is the polynomial of fifth order that the spline is. Smoothed in the
//! Bryson–Frazier form of Rauch, Tung and Striebel's result, which inverts nothing.
//! References: Rauch, Tung and Striebel 1965; Bierman 1973; Wahba 1978; Harvey 1989, section 3.4 (concentrated likelihood).

use hydroline_numerics::pattern;
use hydroline_numerics::statistics::{median, robust_sd};

/// Position, rate and acceleration.
pub type State = [f64; 3];
type Matrix = [[f64; 3]; 3];

/// Steps of the logarithm of the jerk's size in the first look, and what the search ends with.
const LOOK: f64 = 2.5;
const FINE: f64 = 0.05;
/// Where no jerk is fewer than one in this share of the noise over the whole series, and more than what joins all samples.
const SPAN_LN: f64 = 10.0;

/// A smoothed series.
#[derive(Debug, Clone, PartialEq)]
pub struct Smoothed {
    /// Stamps \[s\].
    pub times_s: Vec<f64>,
    /// State at each.
    pub states: Vec<State>,
}

/// sd of a series' fast part: of second differences, robust; `None` with too few of them, or where none differs.
pub fn fast_sd(values: impl Iterator<Item = f64>) -> Option<f64> {
    let seen: Vec<f64> = values.filter(|v| v.is_finite()).collect();
    let second: Vec<f64> = seen.windows(3).map(|w| w[0] - 2.0 * w[1] + w[2]).collect();
    let largest = second.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    if second.len() < 8 || largest == 0.0 {
        return None;
    }
    // Where most values repeat, a resolution coarser than the noise: a hundredth of the largest step.
    Some((robust_sd(&second) / 6f64.sqrt()).max(largest / 100.0))
}

/// Smooths samples (position, rate), NaN = missing; where only rates are measured, the position counts from `origin`.
///
/// `None` without two samples.
pub fn smooth(times_s: &[f64], samples: &[[f64; 2]], origin: f64) -> Option<Smoothed> {
    let counts = |c: usize| samples.iter().filter(|s| s[c].is_finite()).count();
    if counts(0) + counts(1) < 2 {
        return None;
    }
    let series = Series::new(times_s, samples, origin);
    let [low, high] = series.range_ln();
    let cost = |ln: f64| series.filter(ln.exp(), None);
    let looks = ((high - low) / LOOK).ceil().max(1.0) as usize;
    let mut best = (low, cost(low));
    for k in 1..=looks {
        let at = low + (high - low) * k as f64 / looks as f64;
        let c = cost(at);
        if c < best.1 {
            best = (at, c);
        }
    }
    // Towards less jerk first.
    let moved = |at: &f64, _: usize, by: f64| at - by;
    let options = pattern::Options {
        step: 0.5 * LOOK,
        finest: FINE,
        gain: 0.0,
    };
    let best = pattern::minimise(best.0, best.1, 1, &options, moved, |at| cost(*at));
    let mut passed = Vec::with_capacity(times_s.len());
    series.filter(best.0.exp(), Some(&mut passed));
    Some(Smoothed {
        times_s: times_s.to_vec(),
        states: smoothed(&passed),
    })
}

/// Samples with what the filter begins from.
struct Series<'a> {
    times_s: &'a [f64],
    samples: &'a [[f64; 2]],
    /// Variances of position and rate, up to a common scale.
    noise: [f64; 2],
    begin: State,
    begin_variance: State,
    interval_s: f64,
}

/// Record of a filter at one stamp, for the way back.
struct Passed {
    dt_s: f64,
    predicted: State,
    covariance: Matrix,
    /// Per channel: gain, innovation over its variance; `None` = missing.
    updates: [Option<([f64; 3], f64)>; 2],
}

impl<'a> Series<'a> {
    fn new(times_s: &'a [f64], samples: &'a [[f64; 2]], origin: f64) -> Series<'a> {
        let first = |c: usize| samples.iter().map(|s| s[c]).find(|v| v.is_finite());
        let extent = |c: usize| {
            let seen = samples.iter().map(|s| s[c]).filter(|v| v.is_finite());
            let (low, high) = seen.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
                (l.min(v), h.max(v))
            });
            if high > low { high - low } else { 1e-12 }
        };
        let mut gaps: Vec<f64> = times_s.windows(2).map(|w| w[1] - w[0]).collect();
        let interval_s = median(&mut gaps).unwrap_or(1.0).max(1e-6);
        let noise = [0, 1].map(|c| {
            fast_sd(samples.iter().map(|s| s[c]))
                .unwrap_or(1e-3 * extent(c))
                .powi(2)
        });
        let position = first(0);
        let mut steps: Vec<f64> = Vec::new();
        let seen: Vec<(f64, f64)> = times_s
            .iter()
            .zip(samples)
            .map(|(t, s)| (*t, s[0]))
            .filter(|(_, v)| v.is_finite())
            .collect();
        steps.extend(
            seen.windows(2)
                .map(|w| ((w[1].1 - w[0].1) / (w[1].0 - w[0].0).max(1e-6)).abs()),
        );
        steps.extend(samples.iter().map(|s| s[1].abs()).filter(|v| v.is_finite()));
        let fastest = steps.iter().fold(1e-12_f64, |m, v| m.max(*v));
        Series {
            times_s,
            samples,
            noise,
            begin: [position.unwrap_or(origin), first(1).unwrap_or(0.0), 0.0],
            begin_variance: [
                position.map_or(0.0, |_| extent(0).powi(2)),
                fastest.powi(2),
                (fastest / interval_s).powi(2),
            ],
            interval_s,
        }
    }

    /// Between a jerk that never follows the noise and one that follows every sample.
    fn range_ln(&self) -> [f64; 2] {
        let span_s = self.times_s.last().unwrap_or(&1.0) - self.times_s.first().unwrap_or(&0.0);
        let positions = self.samples.iter().any(|s| s[0].is_finite());
        let (noise, power) = if positions {
            (self.noise[0], 5.0)
        } else {
            (self.noise[1], 3.0)
        };
        let ln = |over_s: f64| noise.max(1e-300).ln() - power * over_s.max(1e-6).ln();
        [ln(span_s) - SPAN_LN, ln(self.interval_s) + SPAN_LN]
    }

    /// Minus twice the log likelihood, scale taken out, at a jerk of this spectral density; keeps its way in `passed`.
    fn filter(&self, jerk: f64, mut passed: Option<&mut Vec<Passed>>) -> f64 {
        let mut x = self.begin;
        let mut p: Matrix = [[0.0; 3]; 3];
        for (i, v) in self.begin_variance.iter().enumerate() {
            p[i][i] = *v;
        }
        let mut last_s = self.times_s.first().copied().unwrap_or(0.0);
        let (mut ln, mut energy, mut count) = (0.0, 0.0, 0.0);
        for (t_s, sample) in self.times_s.iter().zip(self.samples) {
            let dt_s = (t_s - last_s).max(0.0);
            last_s = *t_s;
            x = ahead(x, dt_s);
            p = spread(&p, dt_s, jerk);
            let mut step = Passed {
                dt_s,
                predicted: x,
                covariance: p,
                updates: [None; 2],
            };
            for c in 0..2 {
                if !sample[c].is_finite() {
                    continue;
                }
                let total = p[c][c] + self.noise[c];
                let innovation = sample[c] - x[c];
                let gain = [0, 1, 2].map(|i| p[i][c] / total);
                for i in 0..3 {
                    x[i] += gain[i] * innovation;
                }
                let row = p[c];
                for (i, g) in gain.iter().enumerate() {
                    for (j, v) in row.iter().enumerate() {
                        p[i][j] -= g * v;
                    }
                }
                for (i, j) in [(1, 0), (2, 0), (2, 1)] {
                    let mean = 0.5 * (p[i][j] + p[j][i]);
                    (p[i][j], p[j][i]) = (mean, mean);
                }
                for (i, row) in p.iter_mut().enumerate() {
                    row[i] = row[i].max(0.0);
                }
                ln += total.ln();
                energy += innovation * innovation / total;
                count += 1.0;
                step.updates[c] = Some((gain, innovation / total));
            }
            if let Some(all) = passed.as_deref_mut() {
                all.push(step);
            }
        }
        let made = ln + count * (energy / count).max(1e-300).ln();
        if made.is_finite() {
            made
        } else {
            f64::INFINITY
        }
    }
}

fn ahead(x: State, dt_s: f64) -> State {
    [
        x[0] + dt_s * (x[1] + 0.5 * dt_s * x[2]),
        x[1] + dt_s * x[2],
        x[2],
    ]
}

/// Covariance a while later, white jerk between.
fn spread(p: &Matrix, t: f64, jerk: f64) -> Matrix {
    let f: Matrix = [[1.0, t, 0.5 * t * t], [0.0, 1.0, t], [0.0, 0.0, 1.0]];
    let of = |a: &Matrix, b: &dyn Fn(usize, usize) -> f64| -> Matrix {
        std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| a[i][k] * b(k, j)).sum()))
    };
    let half = of(&f, &|k, j| p[k][j]);
    let moved = of(&half, &|k, j| f[j][k]);
    let (t2, t3) = (t * t, t * t * t);
    let q: Matrix = [
        [t2 * t3 / 20.0, t2 * t2 / 8.0, t3 / 6.0],
        [t2 * t2 / 8.0, t3 / 3.0, t2 / 2.0],
        [t3 / 6.0, t2 / 2.0, t],
    ];
    std::array::from_fn(|i| std::array::from_fn(|j| moved[i][j] + jerk * q[i][j]))
}

/// States given all samples, from a filter's way.
fn smoothed(passed: &[Passed]) -> Vec<State> {
    let mut adjoint = [0.0; 3];
    let mut made = Vec::with_capacity(passed.len());
    for step in passed.iter().rev() {
        for c in [1, 0] {
            if let Some((gain, pull)) = step.updates[c] {
                let along: f64 = gain.iter().zip(adjoint).map(|(g, a)| g * a).sum();
                adjoint[c] -= pull + along;
            }
        }
        made.push(std::array::from_fn(|i| {
            let by: f64 = (0..3).map(|j| step.covariance[i][j] * adjoint[j]).sum();
            step.predicted[i] - by
        }));
        let t = step.dt_s;
        adjoint = [
            adjoint[0],
            adjoint[1] + t * adjoint[0],
            adjoint[2] + t * adjoint[1] + 0.5 * t * t * adjoint[0],
        ];
    }
    made.reverse();
    made
}

impl Smoothed {
    /// The same value at all times.
    pub fn standing(times_s: &[f64], value: f64) -> Smoothed {
        Smoothed {
            times_s: times_s.to_vec(),
            states: vec![[value, 0.0, 0.0]; times_s.len()],
        }
    }

    /// State between stamps: the spline's own polynomial.
    pub fn at(&self, t_s: f64) -> State {
        let after = self.times_s.partition_point(|t| *t <= t_s);
        let (Some(k), Some(last)) = (after.checked_sub(1), self.states.last()) else {
            return self.states.first().map_or([0.0; 3], |s| [s[0], 0.0, 0.0]);
        };
        let (Some(a), Some(b)) = (self.states.get(k), self.states.get(k + 1)) else {
            return [last[0], 0.0, 0.0];
        };
        let (s, h) = (t_s - self.times_s[k], self.times_s[k + 1] - self.times_s[k]);
        // Misses of the state carried on from the beginning at the end, by powers of the way.
        let carried = ahead(*a, h);
        let (d0, d1, d2) = (
            b[0] - carried[0],
            (b[1] - carried[1]) * h,
            (b[2] - carried[2]) * h * h,
        );
        let c3 = 10.0 * d0 - 4.0 * d1 + 0.5 * d2;
        let c4 = -15.0 * d0 + 7.0 * d1 - d2;
        let c5 = 6.0 * d0 - 3.0 * d1 + 0.5 * d2;
        let z = s / h;
        let more = [
            z.powi(3) * (c3 + z * (c4 + z * c5)),
            z.powi(2) * (3.0 * c3 + z * (4.0 * c4 + z * 5.0 * c5)) / h,
            z * (6.0 * c3 + z * (12.0 * c4 + z * 20.0 * c5)) / (h * h),
        ];
        let here = ahead(*a, s);
        std::array::from_fn(|i| here[i] + more[i])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng, rngs::StdRng};
    use rand_distr::{Distribution, StandardNormal};

    fn truth(t: f64) -> State {
        let (w, v) = (0.7, 2.1);
        [
            0.4 * (w * t).sin() + 0.05 * (v * t).cos() + 0.1 * t,
            0.4 * w * (w * t).cos() - 0.05 * v * (v * t).sin() + 0.1,
            -0.4 * w * w * (w * t).sin() - 0.05 * v * v * (v * t).cos(),
        ]
    }

    fn rms(made: &Smoothed, part: usize, offset: f64) -> f64 {
        let each = made.times_s.iter().zip(&made.states);
        let sum: f64 = each
            .map(|(t, s)| (s[part] - truth(*t)[part] - offset).powi(2))
            .sum();
        (sum / made.states.len() as f64).sqrt()
    }

    fn sampled(sd: [f64; 2], keep: impl Fn(f64) -> bool) -> (Vec<f64>, Vec<[f64; 2]>) {
        let mut rng = StdRng::seed_from_u64(7);
        let mut t = 0.0;
        let times: Vec<f64> = (0..600)
            .map(|_| {
                t += 0.04 + 0.02 * rng.random::<f64>();
                t
            })
            .collect();
        let samples = times
            .iter()
            .map(|t| {
                let seen = truth(*t);
                [0, 1].map(|c| {
                    let normal: f64 = StandardNormal.sample(&mut rng);
                    let there = sd[c] > 0.0 && keep(*t);
                    if there {
                        seen[c] + sd[c] * normal
                    } else {
                        f64::NAN
                    }
                })
            })
            .collect();
        (times, samples)
    }

    #[test]
    fn positions_alone_give_both() {
        let (times, samples) = sampled([2e-3, 0.0], |_| true);
        let made = smooth(&times, &samples, 0.0).unwrap();
        assert!(rms(&made, 0, 0.0) < 8e-4, "{}", rms(&made, 0, 0.0));
        // A difference of neighbours would be off by 2e-3 * sqrt(2) / 0.05 s = 0.06.
        assert!(rms(&made, 1, 0.0) < 4e-3, "{}", rms(&made, 1, 0.0));
    }

    #[test]
    fn rates_alone_give_the_way_from_its_origin() {
        let (times, samples) = sampled([0.0, 5e-3], |_| true);
        let made = smooth(&times, &samples, 1.0).unwrap();
        assert!(rms(&made, 1, 0.0) < 2e-3, "{}", rms(&made, 1, 0.0));
        let offset = 1.0 - truth(times[0])[0];
        assert!(rms(&made, 0, offset) < 3e-3, "{}", rms(&made, 0, offset));
    }

    #[test]
    fn both_are_better_than_either_and_a_gap_is_bridged() {
        let out = |t: f64| !(12.0..13.0).contains(&t);
        let (times, both) = sampled([2e-3, 5e-3], out);
        let only = |c: usize| -> Vec<[f64; 2]> {
            both.iter()
                .map(|s| {
                    let mut one = [f64::NAN; 2];
                    one[c] = s[c];
                    one
                })
                .collect()
        };
        let made = smooth(&times, &both, 0.0).unwrap();
        let positions = smooth(&times, &only(0), 0.0).unwrap();
        assert!(rms(&made, 1, 0.0) < rms(&positions, 1, 0.0));
        assert!(rms(&made, 0, 0.0) < 1e-3, "{}", rms(&made, 0, 0.0));
        assert!((made.at(12.5)[0] - truth(12.5)[0]).abs() < 0.02);
    }

    #[test]
    fn exact_samples_stay_and_the_curve_between_is_smooth() {
        let times: Vec<f64> = (0..200).map(|k| 0.1 * f64::from(k)).collect();
        let samples: Vec<[f64; 2]> = times.iter().map(|t| [truth(*t)[0], f64::NAN]).collect();
        let made = smooth(&times, &samples, 0.0).unwrap();
        for k in 10..190 {
            let t = 0.1 * f64::from(k) + 0.037;
            let (got, real) = (made.at(t), truth(t));
            assert!((got[0] - real[0]).abs() < 1e-4, "{got:?} {real:?}");
            assert!((got[1] - real[1]).abs() < 3e-3, "{got:?} {real:?}");
        }
        let [before, after] = [made.at(9.9999999), made.at(10.0000001)];
        assert!((before[2] - after[2]).abs() < 1e-3);
        assert!(smooth(&times[..1], &samples[..1], 0.0).is_none());
    }
}
