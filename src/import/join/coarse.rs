//! Where about the offset is: mixtures of filtered loads stand for a vehicle that is not known.

use nalgebra::{DMatrix, DVector};

use super::problem::{DRIFT_UNIT, Problem, SHARED, Series};
use super::response::{COEFFICIENTS, Loads, simulate};

/// Samples that tell where about the offset is.
const COARSE_SAMPLES: usize = 400;
/// Offsets tried for that.
const COARSE_OFFSETS: usize = 20_000;
/// Steps between them \[s\].
const COARSE_STEP_S: f64 = 0.1;
/// Time constants of the loads' filters that stand for an unknown vehicle \[s\].
const FILTERS_S: [f64; 4] = [0.5, 2.0, 8.0, 40.0];

/// Filtered loads on an even grid of the commands' clock.
struct Filtered {
    step_s: f64,
    /// Per filter: velocity and way at each step.
    values: Vec<Vec<(f64, f64)>>,
}

impl Filtered {
    fn new(loads: &Loads, end_s: f64) -> Filtered {
        let step_s = (end_s / 50_000.0).max(0.02);
        let count = (end_s / step_s) as usize + 2;
        let times: Vec<f64> = (0..count).map(|k| k as f64 * step_s).collect();
        let of = |tau: &f64| {
            let c = [1.0 / tau, 1.0 / tau, 0.0, 0.0, 0.0, 0.0, 0.0];
            simulate(&c, loads, &times).unwrap_or_default()
        };
        Filtered {
            step_s,
            values: FILTERS_S.iter().map(of).collect(),
        }
    }

    fn at(&self, filter: usize, t_s: f64, is_way: bool) -> f64 {
        let own = &self.values[filter];
        let pick = |v: &(f64, f64)| if is_way { v.1 } else { v.0 };
        let place = t_s / self.step_s;
        if place <= 0.0 || own.is_empty() {
            return 0.0;
        }
        let k = place as usize;
        match (own.get(k), own.get(k + 1)) {
            (Some(a), Some(b)) => {
                let share = place - k as f64;
                pick(a) * (1.0 - share) + pick(b) * share
            }
            // Behind the last command its load goes on; the filters are near their end.
            _ => own.last().map_or(0.0, |l| {
                let beyond_s = t_s - (own.len() - 1) as f64 * self.step_s;
                if is_way { l.1 + l.0 * beyond_s } else { l.0 }
            }),
        }
    }
}

/// Share of a series that no mixture of filtered loads explains, at an offset.
fn unexplained(
    s: &Series,
    picked: &[usize],
    times_s: &[f64],
    filtered: &Filtered,
    offset_s: f64,
) -> f64 {
    let columns = FILTERS_S.len() + 1 + usize::from(s.is_way);
    let mut rows = Vec::with_capacity(picked.len() * columns);
    let mut right = Vec::with_capacity(picked.len());
    for k in picked.iter().filter(|k| s.values[**k].is_finite()) {
        let t = times_s[*k];
        rows.extend((0..FILTERS_S.len()).map(|f| filtered.at(f, t - offset_s, s.is_way)));
        rows.push(1.0);
        if s.is_way {
            rows.push(t);
        }
        right.push(s.values[*k]);
    }
    if right.len() < 2 * columns {
        return 1.0;
    }
    let a = DMatrix::from_row_slice(right.len(), columns, &rows);
    let y = DVector::from_vec(right);
    let mean = y.mean();
    let power: f64 = y.iter().map(|v| (v - mean).powi(2)).sum();
    let normal = a.tr_mul(&a);
    let weight = normal.trace().max(f64::MIN_POSITIVE) * 1e-12;
    let ridge = &normal + DMatrix::identity(columns, columns) * weight;
    let Some(factor) = ridge.cholesky() else {
        return 1.0;
    };
    let x = factor.solve(&a.tr_mul(&y));
    let rest = (&y - &a * x).norm_squared();
    if power > 0.0 {
        (rest / power).min(1.0)
    } else {
        1.0
    }
}

/// Where about the offset is within a range: (offset, what is left unexplained), best first.
pub(super) fn coarse(problem: &Problem, within_s: (f64, f64)) -> Vec<(f64, f64)> {
    let last = problem.times_s.last().copied().unwrap_or(0.0);
    let shorter = last.min(problem.end_s);
    // Half of the shorter must overlap.
    let low = (-(problem.end_s - 0.5 * shorter)).max(within_s.0);
    let high = (last - 0.5 * shorter).min(within_s.1);
    if high < low {
        return Vec::new();
    }
    let step = ((high - low) / COARSE_OFFSETS as f64).max(COARSE_STEP_S);
    let stride = problem.times_s.len().div_ceil(COARSE_SAMPLES).max(1);
    let picked: Vec<usize> = (0..problem.times_s.len()).step_by(stride).collect();
    let filtered: Vec<Filtered> = problem
        .dofs
        .iter()
        .map(|d| Filtered::new(&problem.loads[*d], problem.end_s + 1.0))
        .collect();
    let count = ((high - low) / step).max(0.0) as usize + 1;
    let costs: Vec<(f64, f64)> = (0..count)
        .map(|i| {
            let offset_s = low + i as f64 * step;
            let sum: f64 = problem
                .series
                .iter()
                .map(|s| {
                    let own = &filtered[s.dof];
                    unexplained(s, &picked, &problem.times_s, own, offset_s)
                        .max(1e-9)
                        .ln()
                })
                .sum();
            (offset_s, sum)
        })
        .collect();
    let mut minima: Vec<(f64, f64)> = (0..costs.len())
        .filter(|i| {
            let near = [i.checked_sub(1), Some(i + 1)];
            near.into_iter()
                .flatten()
                .filter_map(|j| costs.get(j))
                .all(|o| o.1 >= costs[*i].1)
        })
        .map(|i| costs[i])
        .collect();
    minima.sort_by(|a, b| a.1.total_cmp(&b.1));
    minima
}

/// Coefficients to begin with at an offset: a vehicle that answers within a few seconds.
pub(super) fn start(problem: &Problem, offset_s: f64, drift: f64) -> DVector<f64> {
    let n = SHARED + problem.dofs.len() * COEFFICIENTS;
    let mut at = DVector::zeros(n);
    at[0] = offset_s + drift * problem.middle_s;
    at[1] = drift / DRIFT_UNIT;
    for (place, dof) in problem.dofs.iter().enumerate() {
        let own = SHARED + place * COEFFICIENTS;
        let c = [1.0, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0];
        at.as_mut_slice()[own..own + COEFFICIENTS].copy_from_slice(&c);
        // Gain: the size of the answer to the load as it is.
        let loads: Loads = problem.loads[*dof]
            .iter()
            .map(|l| (l.0 + offset_s, l.1))
            .collect();
        let states = simulate(&c, &loads, &problem.times_s).unwrap_or_default();
        let Some(s) = problem.series.iter().rfind(|s| s.dof == place) else {
            continue;
        };
        let first = s
            .values
            .iter()
            .copied()
            .find(|v| v.is_finite())
            .unwrap_or(0.0);
        let (mut up, mut down) = (0.0, 0.0);
        for (value, state) in s.values.iter().zip(&states) {
            let own = if s.is_way { state.1 } else { state.0 };
            if value.is_finite() {
                up += (value - first) * own;
                down += own * own;
            }
        }
        if down > 0.0 {
            at[own] = up / down;
        }
        at[own + 5] = problem
            .series
            .iter()
            .find(|s| s.dof == place && s.is_way)
            .and_then(|s| s.values.iter().copied().find(|v| v.is_finite()))
            .unwrap_or(0.0);
    }
    at
}
