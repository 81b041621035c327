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

/// Values of a mode with what is known of them: the vehicle's own numbers first, then each run's start.
pub(crate) struct Numbers {
    pub values: Vec<f64>,
    /// Natural number by the scaled one.
    pub slopes: Vec<f64>,
    /// Posterior covariance; of what is held as the rig knows it.
    pub covariance: DMatrix<f64>,
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
        Some(Numbers {
            values: natural.iter().map(|v| v.0).collect(),
            slopes,
            covariance: covariance(&whole),
            beside_held: covariance(&beside),
            by_dof,
        })
    }
}
