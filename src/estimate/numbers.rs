//! A mode in natural numbers: values, information and covariance.
//!
//! Information is taken by the natural numbers, not by their logarithms: of damping that is as good as none the runs say how large it
//! may be, while its logarithm is known to nobody. Rounding decides what the runs say nothing of (Golub and Van Loan, section 8.1).

use hydroline_inference::body::{Own, Simulated};
use hydroline_inference::fit::Normal;
use hydroline_inference::prior::Density;
use hydroline_numerics::information::Covariance;
use hydroline_rigs::Rig;
use nalgebra::DMatrix;

use super::fitted::Fitted;

/// A direction whose information is below this share of the largest (after scaling every number to unit information) is rounding.
const RANK: f64 = 1e-11;

/// Probability of a cell of the random force below which its share of the covariance is not asked for: 60 of them are a tenth.
const LEAST: f64 = 2e-3;

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
fn prior_information(own: &Own, scaled: f64, density: &Density, fitted: &Fitted, rig: &Rig) -> f64 {
    if let Some(c) = own.coefficient().filter(|_| fitted.is_held(own)) {
        return c.prior_sd(rig).max(1e-9).powi(-2);
    }
    match fitted.problem.body.prior.is_flat() {
        true => 0.0,
        false => density.step(scaled).1 / own.unit().powi(2),
    }
}

/// Covariance of an information.
fn covariance(of: &DMatrix<f64>) -> DMatrix<f64> {
    Covariance::of_information(of, RANK).with_infinities()
}

/// Covariance over all cells of the random forces (law of total covariance), from that at the mode on; `whole` = the information there.
fn over_forces(
    at_mode: &DMatrix<f64>,
    whole: &DMatrix<f64>,
    by_dof: &[(usize, Normal)],
    natural: impl Fn(Normal) -> Normal,
    (fitted, all): (&Fitted, &[Simulated]),
) -> DMatrix<f64> {
    let (problem, fit) = (&fitted.problem, &fitted.fit);
    let mut made = at_mode.clone();
    for (dof, cells) in &fit.forces {
        let Some((_, chosen)) = by_dof.iter().find(|(d, _)| d == dof) else {
            continue;
        };
        for (cell, probability) in cells {
            if *probability <= LEAST || *cell == fit.cells.misfit[*dof] {
                continue;
            }
            let other = natural(problem.normal(all, *dof, *cell, whole.nrows()));
            let there = covariance(&(whole + (other.information - &chosen.information)));
            let away = &there * (other.gradient - &chosen.gradient);
            let change = there - at_mode + &away * away.transpose();
            // Directions of which nobody knows anything stay so.
            made.zip_apply(&change, |m, c| {
                if m.is_finite() && c.is_finite() {
                    *m += probability * c;
                }
            });
        }
    }
    made
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
        let to_natural = |mut normal: Normal| {
            for i in 0..n {
                normal.gradient[i] /= slopes[i];
                for j in 0..n {
                    normal.information[(i, j)] /= slopes[i] * slopes[j];
                }
            }
            normal
        };
        let of_dof = |d: &usize| {
            let normal = problem.normal(&all, *d, fit.cells.misfit[*d], n);
            (*d, to_natural(normal))
        };
        let by_dof: Vec<(usize, Normal)> = body.dofs.iter().map(of_dof).collect();
        let mut data = DMatrix::<f64>::zeros(n, n);
        for (_, normal) in &by_dof {
            data += &normal.information;
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
            whole[(i, i)] += prior_information(o, fit.point[i], &densities[i], fitted, rig);
        }
        let mut beside = data;
        for i in (0..own).filter(|i| fitted.is_held(&body.own[*i])) {
            beside.row_mut(i).fill(0.0);
            beside.column_mut(i).fill(0.0);
            beside[(i, i)] = 1.0;
        }
        let at_mode = covariance(&whole);
        let covariance_of_all = over_forces(&at_mode, &whole, &by_dof, to_natural, (fitted, &all));
        let of_data = by_dof
            .into_iter()
            .map(|(d, normal)| (d, normal.information));
        let by_dof = of_data.collect();
        Some(Numbers {
            values: natural.iter().map(|v| v.0).collect(),
            slopes,
            covariance: covariance_of_all,
            at_mode,
            beside_held: covariance(&beside),
            by_dof,
        })
    }
}
