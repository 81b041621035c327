//! Noise and random force of one DOF, integrated out in innovations form.
//!
//! A model's residual in one DOF's channels (position and rate) is taken to be: white noise and an Ornstein–Uhlenbeck
//! process per channel (the instrument's), and the response of the DOF, linearised, to an Ornstein–Uhlenbeck force (what
//! the model misses). The state is [response, its rate, force as an acceleration, colour of position, colour of rate];
//! its Kalman filter turns a series into innovations over their sd. The filter is linear: residuals and the columns of a
//! Jacobian go through the same one.
//! Reference: Jazwinski 1970, ch. 7; Harvey 1989, section 3.4; Särkkä and Solin 2019, section 6.2 (discretisation).

use std::collections::BTreeMap;

use hydroline_numerics::noise::Noise;
use nalgebra::{SMatrix, SVector, SymmetricEigen};

/// Number of states.
const N: usize = 5;
/// Series that are filtered side by side.
const LANES: usize = 4;
/// Stamps' distances are taken alike within this share: a filter's covariance needs no more.
const GAP_DIGITS: f64 = 1e3;

/// Linearised response of a DOF to a force per unit of mass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Response {
    /// Damping rate \[1/s\].
    pub damping_ps: f64,
    /// Restoring rate \[1/s2\]: square of the natural angular frequency.
    pub stiffness_ps2: f64,
}

/// The random force of a DOF.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Force {
    /// Standard deviation of the acceleration that it gives \[m/s2, rad/s2\]; 0 = none.
    pub sd_mps2: f64,
    /// Correlation time \[s\].
    pub correlation_s: f64,
}

impl Force {
    /// No force.
    pub const NONE: Force = Force {
        sd_mps2: 0.0,
        correlation_s: 1.0,
    };
}

/// Noise of the instruments of position and rate of a DOF; `None` = not measured.
pub type Instruments = [Option<Noise>; 2];

#[derive(Debug, Clone, Copy)]
struct Update {
    /// 1 / sd of the innovation; 0 = missing or rejected.
    inverse_sd: f64,
    gain: [f64; N],
}

#[derive(Debug, Clone, Copy)]
struct Step {
    gap: usize,
    updates: [Update; 2],
}

/// A step of the covariance, for the question whether the next one is the same.
#[derive(Debug, Clone, Copy)]
struct Settling {
    gap: usize,
    ratios: [f64; 2],
    covariance: [[f64; N]; N],
    is_settled: bool,
    ln_variance: f64,
    used: usize,
}

/// Change of a covariance in one step, over its own size, that is rounding: at the slowest force 600 of them are left.
const SETTLED: f64 = 1e-13;

/// Whether a step changed nothing of a covariance.
fn is_same(before: &[[f64; N]; N], after: &[[f64; N]; N]) -> bool {
    (0..N).all(|i| {
        (0..N).all(|j| {
            let size = (after[i][i] * after[j][j]).sqrt();
            (after[i][j] - before[i][j]).abs() <= SETTLED * size
        })
    })
}

/// The whitening filter of one run's DOF.
#[derive(Debug, Clone)]
pub struct Filter {
    steps: Vec<Step>,
    /// Transition of response, rate and force (row-major), and decays of the two colours, per gap.
    gaps: Vec<([f64; 9], [f64; 2])>,
    /// Sum of the logs of the innovations' variances.
    pub ln_variance: f64,
    /// Samples that count, of both channels.
    pub used: usize,
}

/// Transition and noise of response, rate and force over `dt_s`, the force's sd being 1.
fn transition(response: Response, correlation_s: f64, dt_s: f64) -> ([f64; 9], [f64; 9]) {
    let Response {
        damping_ps: a,
        stiffness_ps2: b,
    } = response;
    let rate = 1.0 / correlation_s;
    #[rustfmt::skip]
    let drift = SMatrix::<f64, 3, 3>::new(
        0.0, 1.0, 0.0,
        -b, -a, 1.0,
        0.0, 0.0, -rate,
    );
    // Van Loan 1978: exp of [[-A, Q], [0, A']] holds both.
    let mut block = SMatrix::<f64, 6, 6>::zeros();
    block
        .fixed_view_mut::<3, 3>(0, 0)
        .copy_from(&(-drift * dt_s));
    block[(2, 5)] = 2.0 * rate * dt_s;
    block
        .fixed_view_mut::<3, 3>(3, 3)
        .copy_from(&(drift.transpose() * dt_s));
    let made = block.exp();
    let phi = made.fixed_view::<3, 3>(3, 3).transpose();
    let q = phi * made.fixed_view::<3, 3>(0, 3);
    let flat = |m: &SMatrix<f64, 3, 3>| std::array::from_fn(|i| m[(i / 3, i % 3)]);
    (flat(&phi), flat(&q))
}

/// A realisation of the response (position, rate) at each stamp to a force of sd 1; `normal` = standard normal numbers.
pub fn draw(
    times_s: &[f64],
    start_s: f64,
    response: Response,
    correlation_s: f64,
    normal: &mut impl FnMut() -> f64,
) -> Vec<[f64; 2]> {
    let mut x = SVector::<f64, 3>::new(0.0, 0.0, normal());
    let mut last_s = start_s;
    let mut known: BTreeMap<i64, (SMatrix<f64, 3, 3>, SMatrix<f64, 3, 3>)> = BTreeMap::new();
    times_s
        .iter()
        .map(|t| {
            let dt_s = (t - last_s).max(0.0);
            last_s = *t;
            let (phi, root) = known
                .entry((dt_s.max(1e-9).ln() * GAP_DIGITS).round() as i64)
                .or_insert_with(|| {
                    let (phi, q) = transition(response, correlation_s, dt_s);
                    let phi = SMatrix::from_row_slice(&phi);
                    (phi, square_root(&SMatrix::from_row_slice(&q)))
                });
            x = *phi * x + *root * SVector::<f64, 3>::new(normal(), normal(), normal());
            [x[0], x[1]]
        })
        .collect()
}

/// A root of a covariance, by its eigenvalues: over short gaps it is all but singular.
fn square_root(covariance: &SMatrix<f64, 3, 3>) -> SMatrix<f64, 3, 3> {
    let eigen = SymmetricEigen::new(0.5 * (covariance + covariance.transpose()));
    let sd = eigen.eigenvalues.map(|v| v.max(0.0).sqrt());
    eigen.eigenvectors * SMatrix::from_diagonal(&sd)
}

impl Filter {
    /// For samples at `times_s`, the response at rest at `start_s`; `sd_ratio(k, c)` = white sd of channel c at sample k over the
    /// instrument's, 0 = it does not count.
    pub fn new(
        times_s: &[f64],
        start_s: f64,
        response: Response,
        force: Force,
        instruments: &Instruments,
        sd_ratio: impl Fn(usize, usize) -> f64,
    ) -> Filter {
        let variance = force.sd_mps2.powi(2);
        let mut gaps: Vec<([f64; 9], [f64; 2])> = Vec::new();
        let mut noises: Vec<[f64; 9]> = Vec::new();
        let mut known: BTreeMap<i64, usize> = BTreeMap::new();
        let colour: [(f64, f64); 2] = std::array::from_fn(|c| {
            instruments[c].map_or((0.0, 1.0), |n| {
                (n.coloured_sd.powi(2), n.correlation_s.max(1e-6))
            })
        });
        let white: [f64; 2] =
            std::array::from_fn(|c| instruments[c].map_or(0.0, |n| n.white_sd.powi(2)));
        // Covariance of the state, symmetric.
        let mut p = [[0.0; N]; N];
        p[2][2] = variance;
        p[3][3] = colour[0].0;
        p[4][4] = colour[1].0;
        let mut last_s = start_s;
        let (mut ln_variance, mut count) = (0.0, 0);
        let mut steps: Vec<Step> = Vec::with_capacity(times_s.len());
        // Where gaps and noise stay as they are, so does the covariance in the end.
        let mut before: Option<Settling> = None;
        for (k, t_s) in times_s.iter().enumerate() {
            let dt_s = (t_s - last_s).max(0.0);
            last_s = *t_s;
            let key = (dt_s.max(1e-9).ln() * GAP_DIGITS).round() as i64;
            let gap = *known.entry(key).or_insert_with(|| {
                let (phi, q) = transition(response, force.correlation_s, dt_s);
                gaps.push((phi, colour.map(|(_, tau)| (-dt_s / tau).exp())));
                noises.push(q);
                gaps.len() - 1
            });
            let ratios = [0, 1].map(|c| sd_ratio(k, c));
            let alike = before.filter(|b| b.gap == gap && b.ratios == ratios);
            if let Some((settled, step)) = alike.filter(|b| b.is_settled).zip(steps.last().copied())
            {
                ln_variance += settled.ln_variance;
                count += settled.used;
                steps.push(step);
                continue;
            }
            let (ln_before, count_before) = (ln_variance, count);
            predict(&mut p, &gaps[gap], &noises[gap], variance, colour);
            let mut updates = [Update {
                inverse_sd: 0.0,
                gain: [0.0; N],
            }; 2];
            for c in 0..2 {
                let ratio = ratios[c];
                if instruments[c].is_none() || ratio <= 0.0 {
                    continue;
                }
                // Position sees response and its colour, rate the response's rate and its own.
                let (i, j) = (c, 3 + c);
                let column: [f64; N] = std::array::from_fn(|s| p[s][i] + p[s][j]);
                let total = column[i] + column[j] + white[c] * ratio * ratio;
                if total.is_nan() || total <= 0.0 {
                    continue;
                }
                let gain = column.map(|v| v / total);
                for (s, row) in p.iter_mut().enumerate() {
                    for (r, v) in row.iter_mut().enumerate() {
                        *v -= gain[s] * column[r];
                    }
                }
                updates[c] = Update {
                    inverse_sd: 1.0 / total.sqrt(),
                    gain,
                };
                ln_variance += total.ln();
                count += 1;
            }
            steps.push(Step { gap, updates });
            before = Some(Settling {
                gap,
                ratios,
                covariance: p,
                is_settled: alike.is_some_and(|b| is_same(&b.covariance, &p)),
                ln_variance: ln_variance - ln_before,
                used: count - count_before,
            });
        }
        Filter {
            steps,
            gaps,
            ln_variance,
            used: count,
        }
    }

    /// Filters (position, rate) pairs in place; what does not count becomes 0.
    pub fn apply(&self, series: &mut [[f64; 2]]) {
        self.lanes([series]);
    }

    /// The same of many series: [`LANES`] at a time, since each step waits for the one before.
    pub fn apply_all(&self, all: &mut [Vec<[f64; 2]>]) {
        for some in all.chunks_mut(LANES) {
            match some {
                [a, b, c, d] => self.lanes([a, b, c, d]),
                few => few.iter_mut().for_each(|one| self.apply(one)),
            }
        }
    }

    fn lanes<const L: usize>(&self, mut series: [&mut [[f64; 2]]; L]) {
        let mut x = [[0.0; L]; N];
        let length = series
            .iter()
            .map(|s| s.len())
            .fold(self.steps.len(), usize::min);
        for (k, step) in self.steps.iter().enumerate().take(length) {
            let (phi, decay) = &self.gaps[step.gap];
            let row = |i: usize| -> [f64; L] {
                let phi = &phi[3 * i..3 * i + 3];
                std::array::from_fn(|l| phi[0] * x[0][l] + phi[1] * x[1][l] + phi[2] * x[2][l])
            };
            let faded = |c: usize| x[3 + c].map(|v| decay[c] * v);
            x = [row(0), row(1), row(2), faded(0), faded(1)];
            for c in 0..2 {
                let update = &step.updates[c];
                if update.inverse_sd == 0.0 {
                    series.iter_mut().for_each(|s| s[k][c] = 0.0);
                    continue;
                }
                let innovation: [f64; L] =
                    std::array::from_fn(|l| series[l][k][c] - x[c][l] - x[3 + c][l]);
                for (state, gain) in x.iter_mut().zip(&update.gain) {
                    for (s, v) in state.iter_mut().zip(&innovation) {
                        *s += gain * v;
                    }
                }
                for (s, v) in series.iter_mut().zip(&innovation) {
                    s[k][c] = v * update.inverse_sd;
                }
            }
        }
    }
}

fn predict(
    p: &mut [[f64; N]; N],
    (phi, decay): &([f64; 9], [f64; 2]),
    q: &[f64; 9],
    variance: f64,
    colour: [(f64, f64); 2],
) {
    // Rows: response, rate and force move together, the colours each by itself.
    let mut moved = [[0.0; N]; N];
    for (r, row) in moved.iter_mut().enumerate() {
        for (c, v) in row.iter_mut().enumerate() {
            *v = if r < 3 {
                phi[3 * r] * p[0][c] + phi[3 * r + 1] * p[1][c] + phi[3 * r + 2] * p[2][c]
            } else {
                decay[r - 3] * p[r][c]
            };
        }
    }
    for (r, row) in p.iter_mut().enumerate() {
        for (c, v) in row.iter_mut().enumerate() {
            let m = &moved[r];
            *v = if c < 3 {
                phi[3 * c] * m[0] + phi[3 * c + 1] * m[1] + phi[3 * c + 2] * m[2]
            } else {
                decay[c - 3] * m[c]
            };
            if r < 3 && c < 3 {
                *v += variance * q[3 * r + c];
            }
        }
    }
    for c in 0..2 {
        p[3 + c][3 + c] += colour[c].0 * (1.0 - decay[c] * decay[c]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};
    use rand::{RngExt, SeedableRng, rngs::StdRng};

    /// Innovations and their variances are those of the dense covariance of all samples.
    #[test]
    fn the_filter_is_the_dense_covariance() {
        let mut rng = StdRng::seed_from_u64(4);
        let mut t = 0.0;
        let times: Vec<f64> = (0..40)
            .map(|_| {
                t += 0.04 + 0.2 * rng.random::<f64>();
                t
            })
            .collect();
        let response = Response {
            damping_ps: 0.4,
            stiffness_ps2: 1.7,
        };
        let force = Force {
            sd_mps2: 0.3,
            correlation_s: 0.8,
        };
        let noise = |w: f64| Noise {
            white_sd: w,
            coloured_sd: 0.7 * w,
            correlation_s: 0.5,
        };
        let instruments = [Some(noise(0.02)), Some(noise(0.05))];
        let used = |k: usize, c: usize| !(k % 7 == 3 && c == 0);
        // Every fifth position is three times as noisy.
        let ratio = |k: usize, c: usize| if k % 5 == 1 && c == 0 { 3.0 } else { 1.0 };
        let counted = |k: usize, c: usize| if used(k, c) { ratio(k, c) } else { 0.0 };
        let filter = Filter::new(&times, 0.0, response, force, &instruments, counted);
        // Dense: by the response to white noise on a fine grid of the driving process (Euler at 0.5 ms is good to 1e-3).
        let h = 5e-4;
        let steps = (times[39] / h).ceil() as usize + 1;
        let n = 80;
        // Linear response of each sample to each driving increment and to the initial force.
        let mut columns = DMatrix::<f64>::zeros(n, 1 + steps / 20 + 1);
        for column in 0..columns.ncols() {
            let mut x = [0.0, 0.0, if column == 0 { force.sd_mps2 } else { 0.0 }];
            let mut k = 0;
            for i in 0..=steps {
                let t = i as f64 * h;
                while k < 40 && times[k] <= t + 1e-12 {
                    columns[(2 * k, column)] = x[0];
                    columns[(2 * k + 1, column)] = x[1];
                    k += 1;
                }
                let kick = if column > 0 && i / 20 == column - 1 {
                    // 20 steps share one increment of sd sqrt(20 h).
                    force.sd_mps2 * (2.0 / force.correlation_s).sqrt() * (20.0 * h).sqrt() / 20.0
                } else {
                    0.0
                };
                let a = x[2] - response.damping_ps * x[1] - response.stiffness_ps2 * x[0];
                x = [
                    x[0] + h * x[1],
                    x[1] + h * a,
                    x[2] * (1.0 - h / force.correlation_s) + kick,
                ];
            }
        }
        let mut dense = &columns * columns.transpose();
        for k in 0..40 {
            for l in 0..40 {
                for c in 0..2 {
                    let w = instruments[c].unwrap();
                    let decay = (-(times[k] - times[l]).abs() / w.correlation_s).exp();
                    dense[(2 * k + c, 2 * l + c)] += w.coloured_sd.powi(2) * decay
                        + if k == l {
                            (ratio(k, c) * w.white_sd).powi(2)
                        } else {
                            0.0
                        };
                }
            }
        }
        let keep: Vec<usize> = (0..n).filter(|i| used(i / 2, i % 2)).collect();
        let part = DMatrix::from_fn(keep.len(), keep.len(), |i, j| dense[(keep[i], keep[j])]);
        let root = nalgebra::Cholesky::new(part).unwrap();
        let ln: f64 = root.l().diagonal().iter().map(|v| 2.0 * v.ln()).sum();
        assert!(
            (ln - filter.ln_variance).abs() < 0.05,
            "{ln} {}",
            filter.ln_variance
        );
        let mut series: Vec<[f64; 2]> = (0..40)
            .map(|_| [rng.random::<f64>(), rng.random::<f64>()])
            .collect();
        let values = DVector::from_iterator(keep.len(), keep.iter().map(|i| series[i / 2][i % 2]));
        let energy = values.dot(&root.solve(&values));
        filter.apply(&mut series);
        let ours: f64 = series.iter().flatten().map(|v| v * v).sum();
        assert!((energy / ours - 1.0).abs() < 2e-3, "{energy} {ours}");
        let drawn: Vec<f64> = (0..4000)
            .map(|_| {
                let mut normal = || -> f64 {
                    rand_distr::Distribution::sample(&rand_distr::StandardNormal, &mut rng)
                };
                draw(&times, 0.0, response, force.correlation_s, &mut normal)[39][0].powi(2)
            })
            .collect();
        let last = columns.row(78).norm_squared() / force.sd_mps2.powi(2);
        let mean = drawn.iter().sum::<f64>() / 4000.0;
        assert!((mean / last - 1.0).abs() < 0.1, "{mean} {last}");
    }
}
