//! A mode in natural numbers: values, information and covariance.
//!
//! Information is taken by the natural numbers, not by their logarithms: of damping that is as good as none the runs say how large it
//! may be, while its logarithm is known to nobody. Rounding decides what the runs say nothing of (Golub and Van Loan, section 8.1).

use hydroline_inference::body::Own;
use hydroline_numerics::information::Covariance;
use hydroline_rigs::Rig;
use nalgebra::DMatrix;

use super::fitted::Fitted;

/// A direction whose information is below this share of the largest (after scaling every number to unit information) is rounding.
const RANK: f64 = 1e-11;

/// Probability of a cell of the random force below which its share of the covariance is not asked for: 60 of them are a tenth.
const LEAST: f64 = 2e-3;

/// Another cell of a DOF's random force.
struct OtherForce {
    probability: f64,
    /// Information that it has more than the one chosen.
    more: DMatrix<f64>,
    /// Gradient of the cost where the numbers are; a column.
    pull: DMatrix<f64>,
}

/// Values of a mode with what is known of them: the vehicle's own numbers first, then each run's start.
pub(crate) struct Numbers {
    pub values: Vec<f64>,
    /// Natural number by the scaled one.
    pub slopes: Vec<f64>,
    /// Posterior covariance, over all cells of the random force by their probabilities (law of total covariance, the mode under another
    /// cell one Newton step away); of what is held as the rig knows it.
    pub covariance: DMatrix<f64>,
    /// The same under the chosen cells alone: what a change of the data or of a number held does to the mode.
    pub at_mode: DMatrix<f64>,
    /// The same with what is held known, and without the priors of coefficients: what the runs say.
    pub beside_held: DMatrix<f64>,
    /// Information of the data by DOF.
    pub by_dof: Vec<(usize, DMatrix<f64>)>,
}

/// Prior information of one of the vehicle's numbers, by the number itself.
fn prior_information(own: &Own, scaled: f64, fitted: &Fitted, rig: &Rig) -> f64 {
    if let Some(c) = own.coefficient().filter(|_| fitted.is_held(own)) {
        return c.prior_sd(rig).max(1e-9).powi(-2);
    }
    let prior = &fitted.problem.body.prior;
    let densities = fitted.problem.body.densities(&[]);
    let place = fitted.problem.body.own.iter().position(|o| o == own);
    let density = place.and_then(|i| densities.get(i));
    match density.filter(|_| !prior.is_flat()) {
        Some(d) => d.step(scaled).1 / own.unit().powi(2),
        None => 0.0,
    }
}

impl Numbers {
    /// Of a fit; `None` where its motion is not finite.
    pub fn of(fitted: &Fitted, rig: &Rig) -> Option<Numbers> {
        let (problem, fit) = (&fitted.problem, &fitted.fit);
        let body = &problem.body;
        let all = problem.simulate(&[], &fit.point)?;
        let natural = body.natural(&[], &fit.point);
        let slopes: Vec<f64> = natural.iter().map(|v| v.1).collect();
        let n = fit.point.len();
        let by_dof: Vec<(usize, DMatrix<f64>)> = body
            .dofs
            .iter()
            .map(|d| {
                let of = problem
                    .normal(&all, *d, fit.cells.misfit[*d], n)
                    .information;
                let by = |i: usize, j: usize| of[(i, j)] / (slopes[i] * slopes[j]);
                (*d, DMatrix::from_fn(n, n, by))
            })
            .collect();
        let mut data = DMatrix::<f64>::zeros(n, n);
        for (_, information) in &by_dof {
            data += information;
        }
        let own = body.own.len();
        let densities = body.densities(&[]);
        if !body.prior.is_flat() {
            for i in own..n {
                data[(i, i)] += densities[i].step(fit.point[i]).1;
            }
        }
        // What a joining says of a clock was measured, as the motion was.
        for (i, o) in body.own.iter().enumerate().filter(|(_, o)| o.is_clock()) {
            data[(i, i)] += o.unit().powi(-2);
        }
        let mut whole = data.clone();
        for (i, o) in body.own.iter().enumerate().filter(|(_, o)| !o.is_clock()) {
            whole[(i, i)] += prior_information(o, fit.point[i], fitted, rig);
        }
        let mut beside = data;
        for i in (0..own).filter(|i| fitted.is_held(&body.own[*i])) {
            beside.row_mut(i).fill(0.0);
            beside.column_mut(i).fill(0.0);
            beside[(i, i)] = 1.0;
        }
        let covariance = |of: &DMatrix<f64>| Covariance::of_information(of, RANK).with_infinities();
        let other_forces = || -> Vec<OtherForce> {
            let all = &all;
            let slopes = &slopes;
            let each = fit.forces.iter().flat_map(|(d, cells)| {
                let chosen = problem.normal(all, *d, fit.cells.misfit[*d], n);
                let others = cells
                    .iter()
                    .filter(|c| c.1 > LEAST && c.0 != fit.cells.misfit[*d]);
                let made: Vec<_> = others
                    .map(|(cell, probability)| {
                        let other = problem.normal(all, *d, *cell, n);
                        let by = |i: usize, j: usize| {
                            (other.information[(i, j)] - chosen.information[(i, j)])
                                / (slopes[i] * slopes[j])
                        };
                        let pull =
                            |i: usize, _| (other.gradient[i] - chosen.gradient[i]) / slopes[i];
                        OtherForce {
                            probability: *probability,
                            more: DMatrix::from_fn(n, n, by),
                            pull: DMatrix::from_fn(n, 1, pull),
                        }
                    })
                    .collect();
                made
            });
            each.collect()
        };
        let covariance_of_all = |whole: &DMatrix<f64>| {
            let here = covariance(whole);
            let mut made = here.clone();
            for other in other_forces() {
                let there = covariance(&(whole + &other.more));
                let away = &there * &other.pull;
                let change = &there - &here + &away * away.transpose();
                // Directions of which nobody knows anything stay so.
                made.zip_apply(&change, |m, c| {
                    if m.is_finite() && c.is_finite() {
                        *m += other.probability * c;
                    }
                });
            }
            made
        };
        let covariance_whole = covariance_of_all(&whole);
        Some(Numbers {
            values: natural.iter().map(|v| v.0).collect(),
            slopes: slopes.clone(),
            covariance: covariance_whole,
            at_mode: covariance(&whole),
            beside_held: covariance(&beside),
            by_dof,
        })
    }
}
