//! The fit: how many of the lens' parameters the nodes pay for is decided by their evidence.
//!
//! Every parameter that the data do not need costs variance: with nodes good to 0.2 px the largest
//! error of 16 parameters over the sheet is half as large again as that of 8. So four models of growing
//! freedom are fitted, each is weighed by its marginal likelihood (Laplace's approximation; MacKay 1992)
//!
//! ln Z = −½ (χ² + penalty) − ½ ln det(JᵀJ + P⁻¹) − Σ ln σ_prior,
//!
//! and parameters and covariance are averages over the four, spread between them included
//! (Hoeting et al. 1999): where nodes do not discriminate two models, the covariance grows.

use hydroline_numerics::least_squares::{LeastSquares, Normal, Options, Scaling, minimise};
use nalgebra::{Const, Matrix2, SMatrix, SVector, Vector2};

use super::lens::{self, PARAMETERS};
use super::reweight;
use crate::map::lm::LmError;

type Square = SMatrix<f64, PARAMETERS, PARAMETERS>;
type Vector = SVector<f64, PARAMETERS>;

/// Standard deviations of the priors on k₁ k₂ k₃ p₁ p₂ c_x c_y κ (scaled units). A plane
/// seen once cannot distinguish a decentred lens from a shifted centre; priors decide.
/// With a board that fills half the field they allow k₁ = 1, k₂ = 0.7, k₃ = 0.3, p = 0.01 in
/// units of the focal length, far beyond real lenses; κ = 0.01 a port at an eighth of the distance.
const PRIOR_SD: [f64; 8] = [0.3, 0.05, 0.005, 0.005, 0.005, 0.2, 0.2, 0.01];

/// Terms with a prior that each model has: none, a lens, a lens and its port, all.
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
    // Nodes are as good as the fullest model shows them, not as good as their stated sds.
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

/// Options of a model's fit: a gain of 1e-5 of χ² is what the evidence of two models would notice by 0.002. The unknowns are
/// scaled already (plane and image have unit size), and priors hold what nodes do not see.
const SEARCH: Options = Options {
    iterations_max: 200,
    decrease_relative: 1e-5,
    scaling: Scaling::AsGiven,
    jitter: 0.0,
    ..crate::map::lm::SEARCH
};

/// A step below this in every (scaled) parameter is rounding.
const NEGLIGIBLE: f64 = 1e-12;

fn solve(
    start: [f64; PARAMETERS],
    pairs: &[Pair],
    weights: &[f64],
    model: &[bool; 8],
) -> Result<Solved, LmError> {
    let mut problem = Problem {
        pairs,
        weights,
        model,
    };
    let start = std::array::from_fn(|k| if problem.has(k) { start[k] } else { 0.0 });
    let found = minimise(&mut problem, start, &SEARCH)?;
    if !found.ended.converged() {
        return Err(LmError::NoMinimum {
            iterations: found.iterations,
            cost: 2.0 * found.normal.cost,
        });
    }
    Ok(Solved {
        x: found.at,
        normal: found.normal.hessian,
        residuals: found.evaluated.residuals,
        penalty: found.evaluated.penalty,
    })
}

struct Problem<'a> {
    pairs: &'a [Pair],
    weights: &'a [f64],
    model: &'a [bool; 8],
}

#[derive(Default)]
struct Evaluated {
    /// Whitened residuals.
    residuals: Vec<f64>,
    /// Σ (x/σ_prior)².
    penalty: f64,
}

impl Problem<'_> {
    fn has(&self, k: usize) -> bool {
        k < 8 || self.model[k - 8]
    }

    /// Information of the prior on a parameter.
    fn prior(&self, k: usize) -> f64 {
        if k >= 8 && self.model[k - 8] {
            PRIOR_SD[k - 8].powi(-2)
        } else {
            0.0
        }
    }
}

impl LeastSquares<Const<PARAMETERS>> for Problem<'_> {
    type Point = [f64; PARAMETERS];
    type Evaluated = Evaluated;
    type Error = LmError;

    fn cost(&mut self, x: &[f64; PARAMETERS], out: &mut Evaluated) -> Option<f64> {
        out.residuals.resize(2 * self.pairs.len(), 0.0);
        let mut cost = 0.0;
        let nodes = self.pairs.iter().zip(self.weights);
        for ((pair, w), e) in nodes.zip(out.residuals.chunks_exact_mut(2)) {
            let p = lens::project(x, pair.plane)?;
            let r = pair.whitener * (Vector2::from(p) - pair.image) * *w;
            e.copy_from_slice(r.as_slice());
            cost += r.norm_squared();
        }
        out.penalty = (8..PARAMETERS).map(|k| self.prior(k) * x[k] * x[k]).sum();
        let cost = 0.5 * (cost + out.penalty);
        cost.is_finite().then_some(cost)
    }

    fn begin(&mut self, x: &[f64; PARAMETERS], out: &mut Evaluated) -> Result<(), LmError> {
        self.cost(x, out).map(drop).ok_or(LmError::NotFinite)
    }

    fn linearise(
        &mut self,
        x: &[f64; PARAMETERS],
        evaluated: &Evaluated,
    ) -> Result<Normal<Const<PARAMETERS>>, LmError> {
        let mut hessian = Square::zeros();
        let mut gradient = Vector::zeros();
        let mut cost = 0.0;
        let nodes = self.pairs.iter().zip(self.weights);
        for ((pair, w), e) in nodes.zip(evaluated.residuals.chunks_exact(2)) {
            let seen = lens::see(x, pair.plane).ok_or(LmError::NotFinite)?;
            let j = pair.whitener * seen.by_parameters * *w;
            cost += Vector2::new(e[0], e[1]).norm_squared();
            for (row, e) in [(j.row(0), e[0]), (j.row(1), e[1])] {
                for i in 0..PARAMETERS {
                    for k in 0..=i {
                        hessian[(i, k)] += row[i] * row[k];
                    }
                    gradient[i] += row[i] * e;
                }
            }
        }
        for i in 0..PARAMETERS {
            for k in 0..i {
                if !(self.has(i) && self.has(k)) {
                    hessian[(i, k)] = 0.0;
                }
                hessian[(k, i)] = hessian[(i, k)];
            }
            hessian[(i, i)] += self.prior(i);
            gradient[i] += self.prior(i) * x[i];
            if !self.has(i) {
                hessian[(i, i)] = 1.0;
                gradient[i] = 0.0;
            }
        }
        Ok(Normal {
            cost: 0.5 * (cost + evaluated.penalty),
            gradient,
            hessian,
        })
    }

    fn moved(&self, x: &[f64; PARAMETERS], step: &Vector) -> Option<[f64; PARAMETERS]> {
        Some(std::array::from_fn(|k| x[k] + step[k]))
    }

    fn negligible(&self, _: &[f64; PARAMETERS], _: &[f64; PARAMETERS], step: &Vector) -> bool {
        step.amax() < NEGLIGIBLE
    }
}
