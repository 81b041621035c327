//! A small dense Levenberg–Marquardt for the fits of this crate (5 to 20 parameters,
//! some hundred residuals), with the covariance of what it found.
//!
//! Marquardt's damping scales with the diagonal of JᵀJ, so parameters may differ by
//! orders of magnitude; the Jacobian is central differences with a step per
//! parameter that the caller knows (he knows the parameter's size).

use nalgebra::{DMatrix, DVector};

/// Why a fit failed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LmError {
    /// Fewer residuals than parameters.
    #[error("{residuals} residuals cannot fix {parameters} parameters; more nodes are needed")]
    Underdetermined {
        /// Residuals offered.
        residuals: usize,
        /// Parameters asked for.
        parameters: usize,
    },
    /// The start already gives infinite or undefined residuals.
    #[error(
        "the model is not finite at the start of the fit; the nodes do not look like a board seen from outside its plane"
    )]
    NotFinite,
    /// The steps ran out.
    #[error("no minimum after {iterations} steps (cost {cost:.3e})")]
    NoMinimum {
        /// Steps made.
        iterations: usize,
        /// Sum of squares reached.
        cost: f64,
    },
}

/// What a fit found.
#[derive(Debug, Clone)]
pub struct LmFit {
    /// Parameters at the minimum.
    pub parameters: DVector<f64>,
    /// (JᵀJ)⁺: the covariance when residuals are in units of their standard deviation.
    pub covariance: DMatrix<f64>,
    /// Residuals at the minimum.
    pub residuals: DVector<f64>,
    /// Sum of squared residuals.
    pub cost: f64,
    /// Steps made.
    pub iterations: usize,
}

/// Minimises the sum of squares of `count` residuals over the parameters.
///
/// `residuals(x, out)` fills `out` (length `count`) and returns false where the model
/// is undefined; such a step is refused. `steps` are half widths of the central
/// differences, one per parameter.
///
/// # Errors
/// [`LmError`]; never panics on numbers that are not finite.
pub fn minimise(
    start: &[f64],
    steps: &[f64],
    count: usize,
    mut residuals: impl FnMut(&[f64], &mut [f64]) -> bool,
) -> Result<LmFit, LmError> {
    const MAX_STEPS: usize = 500;
    let n = start.len();
    if count < n {
        return Err(LmError::Underdetermined {
            residuals: count,
            parameters: n,
        });
    }
    let mut x = DVector::from_column_slice(start);
    let mut r = DVector::zeros(count);
    if !(residuals(x.as_slice(), r.as_mut_slice()) && r.iter().all(|v| v.is_finite())) {
        return Err(LmError::NotFinite);
    }
    let mut cost = r.norm_squared();
    let (mut plus, mut minus) = (DVector::zeros(count), DVector::zeros(count));
    let mut jacobian = DMatrix::zeros(count, n);
    let mut lambda = 1e-3;
    let mut iterations = 0;
    let mut settled = false;
    let mut flat = 0;
    loop {
        for k in 0..n {
            let centre = x[k];
            x[k] = centre + steps[k];
            let up = residuals(x.as_slice(), plus.as_mut_slice());
            x[k] = centre - steps[k];
            let down = residuals(x.as_slice(), minus.as_mut_slice());
            x[k] = centre;
            // At the border of the model's domain one side is enough.
            for i in 0..count {
                jacobian[(i, k)] = match (up, down) {
                    (true, true) => (plus[i] - minus[i]) / (2.0 * steps[k]),
                    (true, false) => (plus[i] - r[i]) / steps[k],
                    (false, true) => (r[i] - minus[i]) / steps[k],
                    (false, false) => 0.0,
                };
            }
        }
        if jacobian.iter().any(|v| !v.is_finite()) {
            return Err(LmError::NotFinite);
        }
        let normal = jacobian.tr_mul(&jacobian);
        if settled || iterations >= MAX_STEPS {
            return if settled {
                Ok(LmFit {
                    parameters: x,
                    covariance: pseudo_inverse(&normal),
                    residuals: r,
                    cost,
                    iterations,
                })
            } else {
                Err(LmError::NoMinimum { iterations, cost })
            };
        }
        let gradient = jacobian.tr_mul(&r);
        let mut improved = false;
        while lambda < 1e12 {
            let mut damped = normal.clone();
            for k in 0..n {
                damped[(k, k)] += lambda * normal[(k, k)].max(1e-300);
            }
            let Some(step) = damped.cholesky().map(|c| c.solve(&(-&gradient))) else {
                lambda *= 4.0;
                continue;
            };
            let trial = &x + &step;
            let fine = residuals(trial.as_slice(), plus.as_mut_slice());
            let trial_cost = plus.norm_squared();
            if fine && trial_cost.is_finite() && trial_cost <= cost {
                let small = (0..n).all(|k| step[k].abs() <= 1e-3 * steps[k]);
                // Twice in a row a change that no statistics would notice: a valley of
                // parameters that the data hardly tell apart has no other end.
                flat = if cost - trial_cost <= 1e-6 * cost {
                    flat + 1
                } else {
                    0
                };
                settled = small || flat >= 2;
                x = trial;
                std::mem::swap(&mut r, &mut plus);
                cost = trial_cost;
                lambda = (lambda * 0.05).max(1e-12);
                improved = true;
                break;
            }
            lambda *= 4.0;
        }
        iterations += 1;
        // No step downhill at any damping: this is the minimum to rounding.
        settled |= !improved;
        if settled {
            lambda = lambda.min(1.0);
        }
    }
}

/// Inverse of a normal matrix after scaling its diagonal to one; directions that the
/// data do not see at all (relative eigenvalue < 1e-13) get no variance rather than
/// an overflow: the caller's priors are there to prevent them.
pub(crate) fn pseudo_inverse(normal: &DMatrix<f64>) -> DMatrix<f64> {
    let n = normal.nrows();
    let scale = DVector::from_fn(n, |k, _| {
        let d = normal[(k, k)];
        if d > 0.0 { 1.0 / d.sqrt() } else { 0.0 }
    });
    let scaled = DMatrix::from_fn(n, n, |i, k| normal[(i, k)] * scale[i] * scale[k]);
    let eigen = scaled.symmetric_eigen();
    let largest = eigen.eigenvalues.amax();
    let mut inverse = DMatrix::zeros(n, n);
    for (k, &value) in eigen.eigenvalues.iter().enumerate() {
        if value > 1e-13 * largest {
            let v = eigen.eigenvectors.column(k);
            inverse += v * v.transpose() / value;
        }
    }
    DMatrix::from_fn(n, n, |i, k| inverse[(i, k)] * scale[i] * scale[k])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rosenbrock_from_the_classic_start() {
        let fit = minimise(&[-1.2, 1.0], &[1e-6, 1e-6], 2, |x, r| {
            r[0] = 10.0 * (x[1] - x[0] * x[0]);
            r[1] = 1.0 - x[0];
            true
        })
        .unwrap();
        assert!((fit.parameters[0] - 1.0).abs() < 1e-8);
        assert!((fit.parameters[1] - 1.0).abs() < 1e-8);
    }

    #[test]
    fn covariance_of_a_straight_line_is_the_textbook_one() {
        // y = a + b t at t = 0..9, unit noise: var b = 1 / Σ(t - mean)² = 1 / 82.5.
        let fit = minimise(&[0.0, 0.0], &[1e-4, 1e-4], 10, |x, r| {
            for (i, out) in r.iter_mut().enumerate() {
                *out = x[0] + x[1] * i as f64 - 3.0;
            }
            true
        })
        .unwrap();
        assert!((fit.covariance[(1, 1)] - 1.0 / 82.5).abs() < 1e-9);
        assert!((fit.covariance[(0, 0)] - (0.1 + 4.5 * 4.5 / 82.5)).abs() < 1e-9);
    }

    #[test]
    fn says_what_is_wrong() {
        let few = minimise(&[0.0; 3], &[1.0; 3], 2, |_, _| true);
        assert!(matches!(
            few,
            Err(LmError::Underdetermined {
                residuals: 2,
                parameters: 3
            })
        ));
        let nan = minimise(&[0.0], &[1.0], 1, |_, r| {
            r[0] = f64::NAN;
            true
        });
        assert_eq!(nan.unwrap_err(), LmError::NotFinite);
    }
}
