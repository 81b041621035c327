//! Levenberg-Marquardt with exact sensitivities, bounds and several starts; L1 by reweighting.
//!
//! References: Nocedal and Wright, Numerical Optimization, 2nd ed., ch. 10; More 1978 (scaling);
//! for L1: Osborne and Watson 1971 (a sequence of linear L1 problems, each solved by
//! iteratively reweighted least squares and finished on the vertex it points to).

use nalgebra::{Cholesky, DMatrix, DVector};
use rand::{RngExt, SeedableRng, rngs::StdRng};

use super::forward::ForwardError;
use super::method::{Method, MethodError, Solution};
use super::parameter::Free;
use super::problem::{Normal, Objective, Problem};

/// The default method.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LevenbergMarquardt {
    /// Starting points: the rig's numbers first, then random ones within the bounds.
    pub starts: usize,
}

impl Default for LevenbergMarquardt {
    fn default() -> Self {
        Self { starts: 6 }
    }
}

const ITERATIONS_MAX: usize = 80;
const L1_ITERATIONS_MAX: usize = 40;
/// Least that a scaled diagonal is raised by, against rounding.
const RIDGE: f64 = 1e-15;
/// Relative decrease of the objective that ends a search.
const DECREASE: f64 = 1e-12;

impl Method for LevenbergMarquardt {
    fn name(&self) -> &'static str {
        "lm"
    }

    fn minimise(
        &self,
        problem: &Problem<'_>,
        objective: Objective,
        seed: u64,
    ) -> Result<Solution, MethodError> {
        if problem.free().is_empty() {
            return Err(MethodError::NothingFree);
        }
        let mut rng = StdRng::seed_from_u64(seed);
        let mut best: Option<Solution> = None;
        let mut failure = None;
        let mut evaluations = 0;
        let tries = self.starts.max(1);
        for attempt in 0..tries {
            let mut start = problem.start();
            if attempt > 0 {
                for (value, free) in start
                    .iter_mut()
                    .zip(problem.free())
                    .take(problem.forward().globals().len())
                {
                    // Halfway into the range: its far corners are no hulls.
                    let span = 0.5 * (free.high - free.low);
                    let centre = free.start.clamp(
                        free.low + 0.5 * span,
                        (free.high - 0.5 * span).max(free.low + 0.5 * span),
                    );
                    *value =
                        (centre + span * (rng.random::<f64>() - 0.5)).clamp(free.low, free.high);
                }
            }
            // L1 too: the starts are told apart by least squares, only the best one is reweighted.
            match from(problem, Objective::LeastSquares, start) {
                Ok(found) => {
                    evaluations += found.evaluations;
                    if best.as_ref().is_none_or(|b| found.objective < b.objective) {
                        best = Some(found);
                    }
                }
                Err(error) => failure = Some(error),
            }
        }
        match (best, failure) {
            (Some(best), _) if objective == Objective::SumOfAbsolute => {
                let before = best.evaluations;
                let found = least_absolute(problem, best).map_err(MethodError::NoStart)?;
                Ok(Solution {
                    evaluations: evaluations + found.evaluations - before,
                    tries,
                    ..found
                })
            }
            (Some(best), _) => Ok(Solution {
                evaluations,
                tries,
                ..best
            }),
            (None, Some(error)) => Err(MethodError::NoStart(error)),
            (None, None) => Err(MethodError::NothingFree),
        }
    }
}

/// One search from one point.
///
/// # Errors
/// [`ForwardError`] when the motion diverges already at the start.
pub fn from(
    problem: &Problem<'_>,
    objective: Objective,
    start: Vec<f64>,
) -> Result<Solution, ForwardError> {
    let held = vec![false; start.len()];
    let squares = least_squares(problem, start, &held)?;
    match objective {
        Objective::LeastSquares => Ok(squares),
        Objective::SumOfAbsolute => least_absolute(problem, squares),
    }
}

/// A sum of squares to be made small: anything with free numbers and normal equations.
pub trait Squares {
    /// Every free number with its bounds.
    fn free(&self) -> &[Free];
    /// Half the sum of squares; infinite where the motion diverges or a bound is left.
    fn cost(&self, at: &[f64]) -> f64;
    /// Normal equations.
    ///
    /// # Errors
    /// [`ForwardError`] when the motion diverges.
    fn normal(&self, at: &[f64]) -> Result<Normal, ForwardError>;
}

impl Squares for Problem<'_> {
    fn free(&self) -> &[Free] {
        Problem::free(self)
    }
    fn cost(&self, at: &[f64]) -> f64 {
        self.objective(Objective::LeastSquares, at)
    }
    fn normal(&self, at: &[f64]) -> Result<Normal, ForwardError> {
        Problem::normal(self, at)
    }
}

/// Least squares with some parameters held where they are.
///
/// # Errors
/// As [`from`].
pub fn least_squares(
    problem: &Problem<'_>,
    at: Vec<f64>,
    held: &[bool],
) -> Result<Solution, ForwardError> {
    Ok(descend(problem, at, held, 0.0)?.0)
}

/// Least squares of anything; ends when a step gains less than `enough` (and a thousandth of it per
/// unit of cost: a bad fit need not be fine), with `enough` = 0 less than 1e-12 of the cost twice.
/// Returns the normal equations at the end too.
///
/// # Errors
/// [`ForwardError`] when the motion diverges already at the start.
pub fn descend(
    problem: &impl Squares,
    mut at: Vec<f64>,
    held: &[bool],
    enough: f64,
) -> Result<(Solution, Normal), ForwardError> {
    let free = problem.free();
    for (value, f) in at.iter_mut().zip(free) {
        *value = value.clamp(f.low, f.high);
    }
    let mut normal = problem.normal(&at)?;
    let mut evaluations = 1;
    let mut damping = 1e-4;
    let mut converged = false;
    let mut small = 0;
    'outer: for _ in 0..ITERATIONS_MAX {
        // A parameter on its bound that wants out stays for this step.
        let moves: Vec<usize> = (0..at.len())
            .filter(|&i| {
                let down_and_out = at[i] <= free[i].low && normal.gradient[i] > 0.0;
                let up_and_out = at[i] >= free[i].high && normal.gradient[i] < 0.0;
                !(held[i] || down_and_out || up_and_out)
            })
            .collect();
        if moves.is_empty() {
            converged = true;
            break;
        }
        loop {
            let step = damped_step(&normal.hessian, &normal.gradient, &moves, damping, RIDGE);
            let trial: Vec<f64> = (0..at.len())
                .map(|i| (at[i] + step[i]).clamp(free[i].low, free[i].high))
                .collect();
            let cost = problem.cost(&trial);
            evaluations += 1;
            if cost <= normal.cost {
                let decrease = normal.cost - cost;
                let moved = trial
                    .iter()
                    .zip(&at)
                    .any(|(a, b)| (a - b).abs() > 1e-10 * (a.abs() + 1e-6));
                let threshold = (DECREASE * normal.cost.max(f64::MIN_POSITIVE))
                    .max(enough * (1.0 + 1e-3 * normal.cost));
                at = trial;
                small = if decrease <= threshold { small + 1 } else { 0 };
                damping = (damping * 0.1).max(1e-14);
                normal = problem.normal(&at)?;
                evaluations += 1;
                if small >= 2 || (small >= 1 && enough > 0.0) || !moved || normal.cost == 0.0 {
                    converged = true;
                    break 'outer;
                }
                break;
            }
            damping *= 8.0;
            if damping > 1e12 {
                // No step downhill is left: the minimum to rounding.
                converged = true;
                break 'outer;
            }
        }
    }
    let solution = Solution {
        parameters: at,
        objective: normal.cost,
        evaluations,
        converged,
        tries: 1,
    };
    Ok((solution, normal))
}

/// (H + damping diag H) step = -g over the moving parameters; `ridge` is what the diagonal, scaled to
/// one, gets on top in any case.
pub fn damped_step(
    hessian: &DMatrix<f64>,
    gradient: &DVector<f64>,
    moves: &[usize],
    damping: f64,
    ridge: f64,
) -> DVector<f64> {
    let n = moves.len();
    // Scaled to unit diagonal: coefficients differ by 10^4 in size.
    let scale: Vec<f64> = moves
        .iter()
        .map(|&i| hessian[(i, i)].sqrt())
        .map(|d| if d > 0.0 { 1.0 / d } else { 0.0 })
        .collect();
    let scaled = DMatrix::from_fn(n, n, |a, b| {
        let h = hessian[(moves[a], moves[b])] * scale[a] * scale[b];
        if a == b {
            if scale[a] > 0.0 {
                h + damping + ridge
            } else {
                1.0
            }
        } else {
            h
        }
    });
    let right = DVector::from_fn(n, |a, _| -gradient[moves[a]] * scale[a]);
    let mut step = DVector::zeros(gradient.len());
    if let Some(solved) = Cholesky::new(scaled).map(|c| c.solve(&right)) {
        for a in 0..n {
            step[moves[a]] = solved[a] * scale[a];
        }
    }
    step
}

/// Sequence of linear L1 problems from a least-squares solution.
fn least_absolute(problem: &Problem<'_>, start: Solution) -> Result<Solution, ForwardError> {
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
        let mut normal = DMatrix::<f64>::identity(p, p) * 1e-15;
        let mut right = DVector::zeros(p);
        for (row, value) in now.iter().enumerate() {
            let weight = 1.0 / value.abs().max(floor);
            let j = scaled.row(row).transpose();
            normal.ger(weight, &j, &j, 1.0);
            right.axpy(-weight * residual[row], &j, 1.0);
        }
        let trace = normal.trace() / p as f64;
        for i in 0..p {
            normal[(i, i)] += 1e-14 * trace;
        }
        let Some(next) = Cholesky::new(normal).map(|c| c.solve(&right)) else {
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
