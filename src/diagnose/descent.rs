//! Levenberg-Marquardt that asks for derivatives rarely, and stops early where no verdict hangs on it.
//!
//! Derivatives cost ten times a plain motion. After each exact step the same Jacobian serves for a
//! few more (chord steps, Kelley 1995, section 5.4), as long as they gain what they promise. A fit
//! that can no longer come near the best one stays rough: its cost is right to a percent.

use nalgebra::{DMatrix, DVector};

use hydroline_identify::forward::ForwardError;
use hydroline_numerics::least_squares::{self, Options};

/// Least that a scaled diagonal is raised by: sets may hold what the data do not tell apart.
const RIDGE: f64 = 1e-13;
/// What a solve adds to the diagonal besides damping.
const SOLVE: Options = Options {
    jitter: RIDGE,
    ..Options::DEFAULT
};
/// Exact linearisations at most.
const ROUNDS: usize = 40;
/// Chord steps behind one of them at most.
const CHORDS: usize = 6;
/// A chord step must gain this share of what it promises for another to follow.
const CHORD_GAIN: f64 = 0.3;
/// A fit that promises less than this (half chi-square) is at its minimum.
const ENOUGH: f64 = 0.01;
/// Share of the cost above the noise's own below which the rest of the way does not matter.
const ROUGH_SHARE: f64 = 0.01;
/// A fit whose promised end, five times overdone, lies above the limit stays rough.
const OVERDONE: f64 = 5.0;

/// A sum of squares with its linearisation taken run by run.
pub trait Linearised {
    /// Bounds per unknown.
    fn bounds(&self, i: usize) -> (f64, f64);
    /// Half the sum of squares, and what [`Linearised::gradient`] needs of the point.
    fn residuals(&self, at: &[f64]) -> (f64, Vec<Vec<f64>>);
    /// Cost, gradient, Hessian and Jacobians.
    ///
    /// # Errors
    /// [`ForwardError`] when the motion diverges.
    fn linearise(&self, at: &[f64]) -> Result<Linear, ForwardError>;
    /// Gradient at a point from its residuals with the Jacobians of another.
    fn gradient(
        &self,
        at: &[f64],
        residuals: &[Vec<f64>],
        jacobians: &[DMatrix<f64>],
    ) -> DVector<f64>;
}

/// A linearisation.
pub struct Linear {
    /// Half the sum of squares.
    pub cost: f64,
    /// Its gradient.
    pub gradient: DVector<f64>,
    /// Gauss-Newton's second derivatives.
    pub hessian: DMatrix<f64>,
    /// Per run.
    pub jacobians: Vec<DMatrix<f64>>,
}

/// A point downhill.
struct Lower {
    at: Vec<f64>,
    cost: f64,
    residuals: Vec<Vec<f64>>,
    /// What the step there promised.
    hoped: f64,
}

/// How far a fit must go.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Effort {
    /// Cost of pure noise.
    pub floor: f64,
    /// Cost above which a fit is of no interest but for its rank.
    pub limit: f64,
}

impl Effort {
    /// To the minimum.
    pub const FULL: Effort = Effort {
        floor: f64::INFINITY,
        limit: f64::INFINITY,
    };
}

/// Where a descent ended.
pub struct Descended {
    /// The unknowns.
    pub at: Vec<f64>,
    /// Half the sum of squares.
    pub cost: f64,
    /// Second derivatives there.
    pub hessian: DMatrix<f64>,
    /// Stopped before the minimum.
    pub rough: bool,
}

/// Down from a point.
///
/// # Errors
/// [`ForwardError`] when the motion diverges already at the start.
pub fn descend(
    problem: &impl Linearised,
    mut at: Vec<f64>,
    effort: Effort,
) -> Result<Descended, ForwardError> {
    let bound = |v: f64, i: usize| {
        let (low, high) = problem.bounds(i);
        v.clamp(low, high)
    };
    for (i, v) in at.iter_mut().enumerate() {
        *v = bound(*v, i);
    }
    let mut damping = 1e-4;
    let mut now = problem.linearise(&at)?;
    let mut rough = false;
    for round in 0..ROUNDS {
        let moves = free_to_move(problem, &at, &now.gradient);
        let plain = damped_step(&now.hessian, &now.gradient, &moves, 1e-12);
        let promised = promise(&now.hessian, &now.gradient, &plain);
        if moves.is_empty() || promised < ENOUGH {
            break;
        }
        // What is far from the noise need not be fine.
        let coarse = ROUGH_SHARE * (now.cost - 1.5 * effort.floor);
        if promised < coarse || (round >= 2 && now.cost - OVERDONE * promised > effort.limit) {
            rough = true;
            break;
        }
        let mut lower: Option<Lower> = None;
        while damping < 1e12 {
            let s = damped_step(&now.hessian, &now.gradient, &moves, damping);
            let trial: Vec<f64> = at
                .iter()
                .enumerate()
                .map(|(i, v)| bound(v + s[i], i))
                .collect();
            let (cost, residuals) = problem.residuals(&trial);
            if cost <= now.cost {
                lower = Some(Lower {
                    at: trial,
                    cost,
                    residuals,
                    hoped: promise(&now.hessian, &now.gradient, &s),
                });
                break;
            }
            damping *= 8.0;
        }
        let Some(Lower {
            at: mut there,
            mut cost,
            mut residuals,
            hoped,
        }) = lower
        else {
            // No step downhill is left: the minimum to rounding.
            break;
        };
        let mut share = (now.cost - cost) / hoped.max(1e-300);
        for _ in 0..CHORDS {
            if !(CHORD_GAIN..=2.0).contains(&share) {
                break;
            }
            let gradient = problem.gradient(&there, &residuals, &now.jacobians);
            let moves = free_to_move(problem, &there, &gradient);
            let s = damped_step(&now.hessian, &gradient, &moves, damping);
            let hoped = promise(&now.hessian, &gradient, &s);
            if hoped < 0.3 * ENOUGH.max(0.1 * coarse) {
                break;
            }
            let trial: Vec<f64> = there
                .iter()
                .enumerate()
                .map(|(i, v)| bound(v + s[i], i))
                .collect();
            let (next, r) = problem.residuals(&trial);
            if next.is_nan() || next >= cost {
                break;
            }
            share = (cost - next) / hoped;
            (there, cost, residuals) = (trial, next, r);
        }
        damping = (damping * 0.1).max(1e-12);
        at = there;
        let gained = now.cost - cost;
        now = problem.linearise(&at)?;
        if gained < 0.1 * ENOUGH {
            break;
        }
    }
    Ok(Descended {
        at,
        cost: now.cost,
        hessian: now.hessian,
        rough,
    })
}

/// Unknowns that are not on a bound they want to leave.
fn free_to_move(problem: &impl Linearised, at: &[f64], gradient: &DVector<f64>) -> Vec<usize> {
    (0..at.len())
        .filter(|&i| {
            let (low, high) = problem.bounds(i);
            !((at[i] <= low && gradient[i] > 0.0) || (at[i] >= high && gradient[i] < 0.0))
        })
        .collect()
}

/// What a step gains by the quadratic model.
fn promise(hessian: &DMatrix<f64>, gradient: &DVector<f64>, step: &DVector<f64>) -> f64 {
    -gradient.dot(step) - 0.5 * step.dot(&(hessian * step))
}

/// (H + damping diag H) step = -g over the unknowns that move; no step where that has no solution.
fn damped_step(
    hessian: &DMatrix<f64>,
    gradient: &DVector<f64>,
    moves: &[usize],
    damping: f64,
) -> DVector<f64> {
    let mut mask = DVector::from_element(gradient.len(), false);
    for i in moves {
        mask[*i] = true;
    }
    least_squares::damped_step(hessian, gradient, &mask, damping, &SOLVE)
        .unwrap_or_else(|| DVector::zeros(gradient.len()))
}
