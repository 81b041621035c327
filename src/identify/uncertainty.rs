//! Covariance and profile likelihood.

use hydroline_numerics::information::Covariance;
use hydroline_numerics::statistics::t95;
use nalgebra::DMatrix;

use super::forward::ForwardError;
use super::lm::descend;
use super::problem::{Objective, Problem};

/// A direction whose information is below this share of the largest (after scaling every parameter
/// to unit information) is rounding: the parameters in it are not determined at all.
const RANK: f64 = 1e-11;

/// Inverse of J^T J; a parameter that takes part in a direction without information has an infinite variance.
pub fn covariance(hessian: &DMatrix<f64>) -> DMatrix<f64> {
    Covariance::of_information(hessian, RANK).with_infinities()
}

/// Evaluations that the profiles of one result may take together: a second or two of the coupled model.
pub const PROFILE_EVALUATIONS: usize = 1500;
/// Share of t that a point of the profile may be off: the interval's end is known to 1 %.
const END: f64 = 0.01;

/// Start of a profile: a parameter, and how the others move with it.
#[derive(Debug, Clone, Copy)]
pub struct Ridge<'a> {
    /// Index of the parameter.
    pub index: usize,
    /// Its sd beside what is held.
    pub sd: f64,
    /// How all parameters move with it in the linear approximation: its column of the covariance.
    pub column: &'a [f64],
    /// Whether each parameter is held.
    pub held: &'a [bool],
}

/// 95 % interval by profile likelihood: all other parameters refitted at each trial value, from where the linear
/// approximation sees them.
///
/// `variance` scales the cost (residual variance per degree of freedom). An end that reaches the
/// search range is that end of the range, and said to be open. Returns the evaluations it took too.
///
/// # Errors
/// [`ForwardError`] when the motion diverges along the way.
pub fn profile(
    problem: &Problem<'_>,
    at: &[f64],
    ridge: Ridge<'_>,
    variance: f64,
    freedom: f64,
) -> Result<(Profile, usize), ForwardError> {
    let Ridge {
        index,
        sd,
        column,
        held,
    } = ridge;
    let mut evaluations = 1;
    let wanted = t95(freedom);
    // z^2 = 2 (cost - least cost) / variance: an error of END in z is one of END t^2 in the cost. `descend` asks for
    // a thousandth more of it per unit of cost: of many samples an end would come out too near.
    let reached = problem.objective(Objective::LeastSquares, at);
    let enough = 0.2 * END * wanted * wanted * variance / (1.0 + 1e-3 * reached);
    let start = descend(problem, at.to_vec(), held, enough)?;
    evaluations += start.0.evaluations;
    let (at, cost) = (start.0.parameters, start.0.objective);
    let free = &problem.free()[index];
    let mut held = held.to_vec();
    held[index] = true;
    let slope: Vec<f64> = column.iter().map(|c| c / column[index]).collect();
    let mut end = |sign: f64| -> Result<(f64, bool), ForwardError> {
        let limit = if sign > 0.0 { free.high } else { free.low };
        let room = (limit - at[index]).abs();
        let mut warm = at.clone();
        let mut distance = |d: f64| -> Result<f64, ForwardError> {
            let by = at[index] + sign * d - warm[index];
            for (i, value) in warm.iter_mut().enumerate() {
                if i == index || !held[i] {
                    *value += by * slope[i];
                }
            }
            let (found, _) = descend(problem, warm.clone(), &held, enough)?;
            evaluations += found.evaluations;
            warm = found.parameters;
            Ok((2.0 * (found.objective - cost).max(0.0) / variance).sqrt())
        };
        let (mut inner, mut inner_z) = (0.0, 0.0);
        let mut trial = (wanted * sd).min(room);
        for _ in 0..12 {
            let z = distance(trial)?;
            if (z - wanted).abs() < END * wanted {
                // Nearly linear from here: the rest of the way is a line.
                return Ok((at[index] + sign * (trial * wanted / z).min(room), false));
            }
            if z < wanted {
                if trial >= room {
                    return Ok((limit, true));
                }
                (inner, inner_z) = (trial, z);
                let ratio = if z > 0.0 {
                    (wanted / z).clamp(1.01, 3.0)
                } else {
                    3.0
                };
                trial = (trial * ratio).min(room);
            } else {
                // z grows nearly linearly between the last point inside and this one.
                trial =
                    inner + (trial - inner) * ((wanted - inner_z) / (z - inner_z)).clamp(0.1, 0.99);
            }
        }
        Ok((at[index] + sign * trial, false))
    };
    let (low, low_open) = end(-1.0)?;
    let (high, high_open) = end(1.0)?;
    Ok((
        Profile {
            low,
            high,
            low_open,
            high_open,
        },
        evaluations,
    ))
}

/// Ends of a profile interval.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, schemars::JsonSchema)]
pub struct Profile {
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
    /// The lower end is the search range, not the data.
    pub low_open: bool,
    /// The upper end is the search range, not the data.
    pub high_open: bool,
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_numerics::information::correlation;

    #[test]
    fn a_direction_without_information_is_infinite_and_the_rest_is_not() {
        // Parameters 0 and 1 only as a sum; 2 alone; 3 not at all.
        let j = DMatrix::from_row_slice(
            3,
            4,
            &[1.0, 1.0, 0.0, 0.0, 2.0, 2.0, 0.0, 0.0, 0.0, 0.0, 4.0, 0.0],
        );
        let c = covariance(&(j.transpose() * &j));
        assert!(c[(0, 0)].is_infinite() && c[(1, 1)].is_infinite() && c[(3, 3)].is_infinite());
        assert!((c[(2, 2)] - 1.0 / 16.0).abs() < 1e-12);
    }

    #[test]
    fn a_regular_covariance_is_the_inverse() {
        let h = DMatrix::from_row_slice(2, 2, &[4e8, 1e3, 1e3, 9e-2]);
        let c = covariance(&h);
        assert!((h * &c - DMatrix::identity(2, 2)).norm() < 1e-6);
        assert!((correlation(&c)[(0, 1)] + 1e3 / (4e8f64 * 9e-2).sqrt()).abs() < 1e-9);
    }
}
