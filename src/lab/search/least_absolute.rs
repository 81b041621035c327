//! The sum of absolute residuals.
//!
//! A sequence of linear L1 problems (Osborne and Watson 1971), each solved by iteratively reweighted least squares
//! and finished on the vertex it points to.

use hydroline_numerics::cholesky::{JITTER, ScaledCholesky};
use nalgebra::{DMatrix, DVector};

use super::forward::ForwardError;
use super::method::Solution;
use super::problem::{Objective, Problem};

/// Linear problems at most.
const L1_ITERATIONS_MAX: usize = 40;

/// A sequence of linear L1 problems from a least-squares solution.
pub(super) fn least_absolute(
    problem: &Problem<'_>,
    start: Solution,
) -> Result<Solution, ForwardError> {
    let free = problem.free();
    let p = free.len();
    let mut at = start.parameters;
    let mut evaluations = start.evaluations + 1;
    let mut objective = problem.objective(Objective::SumOfAbsolute, &at);
    let mut converged = false;
    for _ in 0..L1_ITERATIONS_MAX {
        let blocks: Result<Vec<_>, _> = (0..problem.forward().runs())
            .map(|run| problem.linearised(Objective::SumOfAbsolute, run, &at))
            .collect();
        let blocks = blocks?;
        evaluations += 1;
        let rows: usize = blocks.iter().map(|(r, _)| r.len()).sum();
        let mut residual = DVector::zeros(rows);
        let mut jacobian = DMatrix::zeros(rows, p);
        let mut first = 0;
        for (run, (r, j)) in blocks.iter().enumerate() {
            residual.rows_mut(first, r.len()).copy_from(r);
            for (local, column) in problem.columns(run).into_iter().enumerate() {
                jacobian
                    .view_mut((first, column), (r.len(), 1))
                    .copy_from(&j.column(local));
            }
            first += r.len();
        }
        let step = linear_l1(&jacobian, &residual);
        let mut share = 1.0;
        let mut improved = None;
        for _ in 0..12 {
            let trial: Vec<f64> = (0..p)
                .map(|i| (at[i] + share * step[i]).clamp(free[i].low, free[i].high))
                .collect();
            let value = problem.objective(Objective::SumOfAbsolute, &trial);
            evaluations += 1;
            if value < objective {
                improved = Some((trial, value));
                break;
            }
            share *= 0.4;
        }
        let Some((next, value)) = improved else {
            converged = true;
            break;
        };
        let gain = objective - value;
        (at, objective) = (next, value);
        if gain <= 1e-14 * objective {
            converged = true;
            break;
        }
    }
    Ok(Solution {
        parameters: at,
        objective,
        evaluations,
        converged,
        tries: 1,
    })
}

/// argmin over d of |r + J d|_1: reweighting, then simplex steps from the vertex it points to.
fn linear_l1(jacobian: &DMatrix<f64>, residual: &DVector<f64>) -> DVector<f64> {
    let p = jacobian.ncols();
    let scale: Vec<f64> = (0..p)
        .map(|i| jacobian.column(i).norm())
        .map(|n| if n > 0.0 { 1.0 / n } else { 0.0 })
        .collect();
    let scaled = DMatrix::from_fn(jacobian.nrows(), p, |r, c| jacobian[(r, c)] * scale[c]);
    let size = |d: &DVector<f64>| (residual + &scaled * d).lp_norm(1);
    let level = residual.lp_norm(1) / residual.len().max(1) as f64;
    let mut step = DVector::zeros(p);
    let mut best = (size(&step), step.clone());
    let mut floor = level.max(f64::MIN_POSITIVE);
    for _ in 0..60 {
        let now = residual + &scaled * &step;
        let mut normal = DMatrix::<f64>::zeros(p, p);
        let mut right = DVector::zeros(p);
        for (row, value) in now.iter().enumerate() {
            let weight = 1.0 / value.abs().max(floor);
            let j = scaled.row(row).transpose();
            normal.ger(weight, &j, &j, 1.0);
            right.axpy(-weight * residual[row], &j, 1.0);
        }
        let Some(next) = ScaledCholesky::new(&normal, JITTER).map(|c| c.solve(&right)) else {
            break;
        };
        step = next;
        let value = size(&step);
        if value < best.0 {
            best = (value, step.clone());
        }
        floor = (floor * 0.6).max(1e-10 * level);
    }
    vertex_descent(&scaled, residual, &mut best);
    DVector::from_fn(p, |i, _| best.1[i] * scale[i])
}

/// At the optimum of a linear L1 problem p residuals vanish: exchange them one by one while that helps
/// (Barrodale and Roberts 1973; the line search is a weighted median).
fn vertex_descent(
    jacobian: &DMatrix<f64>,
    residual: &DVector<f64>,
    best: &mut (f64, DVector<f64>),
) {
    let p = jacobian.ncols();
    let n = residual.len();
    for _ in 0..50 {
        let now = residual + jacobian * &best.1;
        let mut order: Vec<usize> = (0..n).filter(|i| jacobian.row(*i).norm() > 0.0).collect();
        order.sort_by(|a, b| now[*a].abs().total_cmp(&now[*b].abs()));
        // The p smallest residuals whose rows are independent.
        let mut chosen: Vec<usize> = Vec::new();
        let mut basis: Vec<DVector<f64>> = Vec::new();
        for row in order {
            let mut v = jacobian.row(row).transpose();
            let norm = v.norm();
            for b in &basis {
                let along = v.dot(b);
                v.axpy(-along, b, 1.0);
            }
            if v.norm() > 1e-9 * norm {
                basis.push(v.normalize());
                chosen.push(row);
            }
            if chosen.len() == p {
                break;
            }
        }
        if chosen.len() < p {
            return;
        }
        let square = DMatrix::from_fn(p, p, |r, c| jacobian[(chosen[r], c)]);
        let Some(inverse) = square.try_inverse() else {
            return;
        };
        let target = DVector::from_fn(p, |r, _| -residual[chosen[r]]);
        let vertex = &inverse * target;
        let at_vertex = (residual + jacobian * &vertex).lp_norm(1);
        let mut improved = false;
        if at_vertex < best.0 {
            *best = (at_vertex, vertex.clone());
            improved = true;
        }
        // Edges of the vertex: let one of the chosen residuals go, keep the others at zero.
        for c in 0..p {
            let direction = inverse.column(c).into_owned();
            let slopes = jacobian * &direction;
            let base = residual + jacobian * &vertex;
            let mut kinks: Vec<(f64, f64)> = (0..n)
                .filter(|i| slopes[*i].abs() > 1e-300)
                .map(|i| (-base[i] / slopes[i], slopes[i].abs()))
                .collect();
            kinks.sort_by(|a, b| a.0.total_cmp(&b.0));
            let half = 0.5 * kinks.iter().map(|k| k.1).sum::<f64>();
            let mut sum = 0.0;
            let Some(kink) = kinks.iter().find(|k| {
                sum += k.1;
                sum >= half
            }) else {
                continue;
            };
            let there = &vertex + direction * kink.0;
            let value = (residual + jacobian * &there).lp_norm(1);
            if value < best.0 {
                *best = (value, there);
                improved = true;
            }
        }
        if !improved {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A line through points with outliers: the L1 optimum goes through two points exactly;
    /// the reference tries all pairs.
    #[test]
    fn the_linear_l1_step_finds_the_best_vertex() {
        let n = 23;
        let x: Vec<f64> = (0..n).map(|i| i as f64 * 0.7).collect();
        let y: Vec<f64> = (0..n)
            .map(|i| {
                1.0 + 0.5 * x[i]
                    + ((i * 7919) % 13) as f64 * 0.1
                    + if i % 9 == 0 { 20.0 } else { 0.0 }
            })
            .collect();
        let jacobian = DMatrix::from_fn(n, 2, |r, c| if c == 0 { 1.0 } else { x[r] });
        let residual = DVector::from_fn(n, |r, _| -y[r]);
        let step = linear_l1(&jacobian, &residual);
        let cost = |a: f64, b: f64| (0..n).map(|i| (a + b * x[i] - y[i]).abs()).sum::<f64>();
        let mut best = f64::INFINITY;
        for i in 0..n {
            for j in 0..i {
                let b = (y[i] - y[j]) / (x[i] - x[j]);
                best = best.min(cost(y[i] - b * x[i], b));
            }
        }
        assert!(
            cost(step[0], step[1]) <= best * (1.0 + 1e-12),
            "{} {best}",
            cost(step[0], step[1])
        );
    }
}
