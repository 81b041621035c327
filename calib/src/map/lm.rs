//! Fits of this crate (5 to 20 parameters, some hundred residuals): how they search, and the covariance of what
//! they found.

use hydroline_numerics::information::Covariance;
use hydroline_numerics::least_squares::{self, Damping, Differences, NotFinite, Options};
use nalgebra::{DMatrix, DVector};

/// Why a fit failed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum LmError {
    #[error("{residuals} residuals cannot fix {parameters} parameters; more nodes are needed")]
    Underdetermined { residuals: usize, parameters: usize },
    #[error(
        "the model is not finite at the start of the fit; the nodes do not look like a board seen from outside its plane"
    )]
    NotFinite,
    #[error("no minimum after {iterations} steps (cost {cost:.3e})")]
    NoMinimum { iterations: usize, cost: f64 },
}

impl From<NotFinite> for LmError {
    fn from(_: NotFinite) -> Self {
        LmError::NotFinite
    }
}

/// Result of a fit.
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

/// Directions with less information than this share of the largest are rounding; they get no variance: the
/// caller's priors are there to prevent them.
const RANK: f64 = 1e-13;

/// Options of the searches of this crate.
///
/// Cameras and lenses have curved, weakly observable directions (a shifted centre looks like a decentred lens, a focal length like a
/// distance): a rejected step was only a little too long, so damping rises slowly (4), and it falls fast (0.05)
/// because every step costs derivatives of some hundred nodes. Twice in a row a gain of a millionth of χ², that
/// no statistics would notice, ends the search: along such a direction the search has no other
/// end.
pub(crate) const SEARCH: Options = Options {
    damping: Some(Damping {
        accepted: 0.05,
        rejected: 4.0,
        outside: 4.0,
        ..Damping::DEFAULT
    }),
    iterations_max: 500,
    decrease_relative: 1e-6,
    ..Options::DEFAULT
};

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
    residuals: impl FnMut(&[f64], &mut [f64]) -> bool,
) -> Result<LmFit, LmError> {
    if count < start.len() {
        return Err(LmError::Underdetermined {
            residuals: count,
            parameters: start.len(),
        });
    }
    let mut problem = Differences::new(residuals, count, steps);
    let start = DVector::from_column_slice(start);
    let found = least_squares::minimise(&mut problem, start, &SEARCH)?;
    // Half the sum of squares is what the search minimises.
    let cost = 2.0 * found.normal.cost;
    if !found.ended.converged() {
        return Err(LmError::NoMinimum {
            iterations: found.iterations,
            cost,
        });
    }
    Ok(LmFit {
        parameters: found.at,
        covariance: Covariance::of_information(&found.normal.hessian, RANK).matrix,
        residuals: found.evaluated.into(),
        cost,
        iterations: found.iterations,
    })
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
