//! The paper's estimate of one DOF's coefficients: the minimum of its Eq. 10, and the sd that least squares give it there.

use super::axis::{Axis, Start};
use super::forward::{Forward, ForwardError};
use super::lm::LevenbergMarquardt;
use super::method::{Method, MethodError};
use super::problem::{Objective, Problem};
use hydroline_core::run::Run;
use hydroline_identify::parameter::Coefficient;
use hydroline_numerics::information::Covariance;
use hydroline_numerics::noise::{Series, estimate};
use hydroline_numerics::statistics::difference_sd;
use hydroline_rigs::{Dof, Vehicle};

/// Starting points.
const STARTS: usize = 3;
/// A direction whose information is below this share of the largest (at unit information of each parameter) is rounding.
const RANK: f64 = 1e-11;

/// Failure of the paper's fit.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum PaperFitError {
    #[error(transparent)]
    Method(#[from] MethodError),
    #[error(transparent)]
    Forward(#[from] ForwardError),
}

/// Coefficients of one DOF, SI.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PaperFit {
    /// Added mass, linear and quadratic damping.
    pub values: [f64; 3],
    /// sd of each by the residuals' noise and its colour; infinite where the runs say nothing.
    pub sds: [f64; 3],
}

/// Fits runs of one DOF by the paper's objective; samples count alike.
///
/// # Errors
/// [`PaperFitError`] where no start gives a finite motion.
pub fn paper_fit(
    runs: &[Run],
    vehicle: &Vehicle,
    dof: Dof,
    start: Start,
) -> Result<PaperFit, PaperFitError> {
    let axis = Axis::new(runs, vehicle, dof, &Coefficient::of(dof), start);
    let scatter = (0..axis.runs()).map(|run| {
        let measured = axis.measured(run).iter().copied();
        difference_sd(&measured.filter(|v| v.is_finite()).collect::<Vec<f64>>())
    });
    let sd = scatter.fold(1e-6, f64::max);
    let mut problem = Problem::new(&axis, &[sd]);
    let method = LevenbergMarquardt { starts: STARTS };
    let at = method
        .minimise(&problem, Objective::SumOfAbsolute, 1)?
        .parameters;
    let residuals: Result<Vec<_>, _> = (0..axis.runs())
        .map(|run| problem.raw_residuals(run, &at))
        .collect();
    let residuals = residuals?;
    let jacobians: Result<Vec<_>, _> = (0..axis.runs())
        .map(|run| problem.derivatives(run, &at))
        .collect();
    let jacobians = jacobians?;
    let series: Vec<Series<'_>> = residuals
        .iter()
        .zip(&jacobians)
        .enumerate()
        .map(|(run, (slots, jacobian))| Series {
            times_s: axis.times_s(run),
            values: &slots[0],
            jacobian: Some(jacobian),
        })
        .collect();
    if let Some((noise, used)) = estimate(&series) {
        problem.set_noise(&[noise], |run, _, k| used[run][k]);
    }
    let normal = problem.normal(&at)?;
    let freedom = (problem.samples() as f64 - at.len() as f64).max(1.0);
    let covariance = Covariance::of_information(&normal.hessian, RANK).with_infinities()
        * (2.0 * normal.cost / freedom);
    Ok(PaperFit {
        values: std::array::from_fn(|i| at[i]),
        sds: std::array::from_fn(|i| covariance[(i, i)].sqrt()),
    })
}
