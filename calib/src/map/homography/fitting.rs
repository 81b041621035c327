//! The fit: how many of the lens' parameters the nodes pay for is decided by their evidence.
//!
//! Every parameter that the data do not need costs variance: with nodes good to 0.2 px the largest
//! error of 16 parameters over the sheet is half as large again as that of 8. So four models of growing
//! freedom are fitted, each is weighed by its marginal likelihood (Laplace's approximation; MacKay 1992)
//!
//! ln Z = −½ (χ² + penalty) − ½ ln det(JᵀJ + P⁻¹) − Σ ln σ_prior,
//!
//! and parameters and covariance are averages over the four, spread between them included
//! (Hoeting et al. 1999): where nodes cannot tell two models apart, the covariance says so.

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};

use super::lens::{self, PARAMETERS};
use super::reweight;
use crate::map::lm::LmError;

type Square = SMatrix<f64, PARAMETERS, PARAMETERS>;
type Vector = SVector<f64, PARAMETERS>;

/// Standard deviations of the priors on k₁ k₂ k₃ p₁ p₂ c_x c_y κ (scaled units). A plane
/// seen once cannot tell a decentred lens from a shifted centre; priors decide.
/// With a board that fills half the field they allow k₁ = 1, k₂ = 0.7, k₃ = 0.3, p = 0.01 in
/// units of the focal length, far beyond real lenses; κ = 0.01 a port at an eighth of the distance.
const PRIOR_SD: [f64; 8] = [0.3, 0.05, 0.005, 0.005, 0.005, 0.2, 0.2, 0.01];

/// Which of them each model has: none, a lens, a lens and its port, all.
const MODELS: [[bool; 8]; 4] = [
    [false; 8],
    [true, false, false, false, false, false, false, true],
    [true, true, false, false, false, false, false, true],
    [true; 8],
];

/// A node, scaled, with what whitens its residual.
pub(super) struct Pair {
    pub plane: [f64; 2],
    pub image: Vector2<f64>,
    pub whitener: Matrix2<f64>,
}

/// What the fit found.
pub(super) struct Fitted {
    pub parameters: [f64; PARAMETERS],
    pub covariance: Square,
    pub noise_scale: f64,
}

/// One model at its minimum.
struct Solved {
    x: [f64; PARAMETERS],
    /// JᵀJ + P⁻¹, 1 on the diagonal for parameters it does not have.
    normal: Square,
    /// Whitened residuals.
    residuals: Vec<f64>,
    /// Σ (x/σ_prior)².
    penalty: f64,
}

/// Fits from the homography `start`.
pub(super) fn fit(start: [f64; PARAMETERS], pairs: &mut [Pair]) -> Result<Fitted, LmError> {
    let mut weights = vec![1.0; pairs.len()];
    let mut full = solve(start, pairs, &weights, &MODELS[3])?;
    for _ in 0..3 {
        if !reweight(&full.residuals, &mut weights) {
            break;
        }
        full = solve(full.x, pairs, &weights, &MODELS[3])?;
    }
    let chi2: f64 = full.residuals.iter().map(|r| r * r).sum();
    let free = (2 * pairs.len() - PARAMETERS) as f64;
    let noise_scale = (chi2 / free).sqrt().max(1.0);
    // Nodes are as good as the fullest model shows them, not as good as they say.
    for pair in pairs.iter_mut() {
        pair.whitener /= noise_scale;
    }
    let mut solved: Vec<(f64, Solved, &[bool; 8])> = Vec::with_capacity(MODELS.len());
    let mut from = start;
    for (k, model) in MODELS.iter().enumerate() {
        if k + 1 == MODELS.len() {
            from = full.x;
        }
        // Where perspective alone finds no minimum the lens is needed: the other models go on.
        let Ok(s) = solve(from, pairs, &weights, model) else {
            continue;
        };
        from = s.x;
        if let Some(z) = evidence(&s, model) {
            solved.push((z, s, model));
        }
    }
    let best = solved
        .iter()
        .map(|s| s.0)
        .max_by(f64::total_cmp)
        .unwrap_or(0.0);
    let mut total = 0.0;
    let mut mean = Vector::zeros();
    for (z, s, _) in &mut solved {
        *z = (*z - best).exp();
        total += *z;
        mean += Vector::from(s.x) * *z;
    }
    mean /= total;
    let mut covariance = Square::zeros();
    for (z, s, model) in &solved {
        let share = z / total;
        if share < 1e-9 {
            continue;
        }
        let mut c = s.normal.try_inverse().ok_or(LmError::NotFinite)?;
        for k in (0..8).filter(|&k| !model[k]) {
            c[(8 + k, 8 + k)] = 0.0;
        }
        let off = Vector::from(s.x) - mean;
        covariance += (c + off * off.transpose()) * share;
    }
    let sound = mean.iter().chain(covariance.iter()).all(|v| v.is_finite());
    if !sound {
        return Err(LmError::NotFinite);
    }
    Ok(Fitted {
        parameters: mean.into(),
        covariance,
        noise_scale,
    })
}

/// ln Z up to what all models share.
fn evidence(s: &Solved, model: &[bool; 8]) -> Option<f64> {
    let chi2: f64 = s.residuals.iter().map(|r| r * r).sum();
    let factor = s.normal.cholesky()?;
    let half_det: f64 = (0..PARAMETERS).map(|k| factor.l_dirty()[(k, k)].ln()).sum();
    let priors: f64 = (0..8).filter(|&k| model[k]).map(|k| PRIOR_SD[k].ln()).sum();
    Some(-0.5 * (chi2 + s.penalty) - half_det - priors)
}

/// Levenberg and Marquardt with the model's own derivatives.
fn solve(
    start: [f64; PARAMETERS],
    pairs: &[Pair],
    weights: &[f64],
    model: &[bool; 8],
) -> Result<Solved, LmError> {
    const MAX_STEPS: usize = 200;
    let has = |k: usize| k < 8 || model[k - 8];
    let prior = |k: usize| {
        if k >= 8 && model[k - 8] {
            PRIOR_SD[k - 8].powi(-2)
        } else {
            0.0
        }
    };
    let mut x = start;
    for (k, v) in x.iter_mut().enumerate() {
        if !has(k) {
            *v = 0.0;
        }
    }
    let cost_at = |x: &[f64; PARAMETERS], out: &mut [f64]| -> Option<(f64, f64)> {
        let mut cost = 0.0;
        for ((pair, w), e) in pairs.iter().zip(weights).zip(out.chunks_exact_mut(2)) {
            let p = lens::project(x, pair.plane)?;
            let r = pair.whitener * (Vector2::from(p) - pair.image) * *w;
            e.copy_from_slice(r.as_slice());
            cost += r.norm_squared();
        }
        let penalty: f64 = (8..PARAMETERS).map(|k| prior(k) * x[k] * x[k]).sum();
        (cost + penalty)
            .is_finite()
            .then_some((cost + penalty, penalty))
    };
    let mut residuals = vec![0.0; 2 * pairs.len()];
    let mut trial = residuals.clone();
    let (mut cost, mut penalty) = cost_at(&x, &mut residuals).ok_or(LmError::NotFinite)?;
    let mut lambda = 1e-3;
    let mut flat = 0;
    let mut settled = false;
    for step in 0..=MAX_STEPS {
        let mut normal = Square::zeros();
        let mut gradient = Vector::zeros();
        for ((pair, w), e) in pairs.iter().zip(weights).zip(residuals.chunks_exact(2)) {
            let seen = lens::see(&x, pair.plane).ok_or(LmError::NotFinite)?;
            let j = pair.whitener * seen.by_parameters * *w;
            for (row, e) in [(j.row(0), e[0]), (j.row(1), e[1])] {
                for i in 0..PARAMETERS {
                    for k in 0..=i {
                        normal[(i, k)] += row[i] * row[k];
                    }
                    gradient[i] += row[i] * e;
                }
            }
        }
        for i in 0..PARAMETERS {
            for k in 0..i {
                if !(has(i) && has(k)) {
                    normal[(i, k)] = 0.0;
                }
                normal[(k, i)] = normal[(i, k)];
            }
            normal[(i, i)] += prior(i);
            gradient[i] += prior(i) * x[i];
            if !has(i) {
                normal[(i, i)] = 1.0;
                gradient[i] = 0.0;
            }
        }
        if settled {
            return Ok(Solved {
                x,
                normal,
                residuals,
                penalty,
            });
        }
        if step == MAX_STEPS {
            break;
        }
        let mut improved = false;
        while lambda < 1e12 {
            let mut damped = normal;
            for k in 0..PARAMETERS {
                damped[(k, k)] *= 1.0 + lambda;
            }
            let Some(step) = damped.cholesky().map(|c| c.solve(&gradient)) else {
                lambda *= 4.0;
                continue;
            };
            let next: [f64; PARAMETERS] = std::array::from_fn(|k| x[k] - step[k]);
            match cost_at(&next, &mut trial) {
                Some((new, new_penalty)) if new <= cost => {
                    // Twice in a row a change that no statistics would notice: the valley in which
                    // a shifted centre looks like a decentred lens has no other end.
                    let little = cost - new <= 1e-5 * cost;
                    flat = if little { flat + 1 } else { 0 };
                    settled = flat >= 2 || step.amax() < 1e-12;
                    x = next;
                    std::mem::swap(&mut residuals, &mut trial);
                    (cost, penalty) = (new, new_penalty);
                    lambda = (lambda * 0.05).max(1e-12);
                    improved = true;
                    break;
                }
                _ => lambda *= 4.0,
            }
        }
        // No step downhill at any damping: this is the minimum to rounding.
        if !improved {
            settled = true;
            lambda = 1.0;
        }
    }
    Err(LmError::NoMinimum {
        iterations: MAX_STEPS,
        cost,
    })
}
