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
use super::over_noise::OverNoise;

/// A direction whose information is below this share of the largest (after scaling every number to unit information) is rounding.
const RANK: f64 = 1e-11;

/// Values of a mode with what is known of them: the vehicle's own numbers first, then each run's start.
pub(crate) struct Numbers {
    pub values: Vec<f64>,
    /// Natural number by the scaled one.
    pub slopes: Vec<f64>,
    /// Posterior covariance over what is open of the noise and the random force; of what is held as the rig knows it.
    pub covariance: DMatrix<f64>,
    /// Half-width of each number's 95 % interval over that of a normal error of its sd: noise and force are a mixture.
    pub widths: Vec<f64>,
    /// The covariance under the chosen cells alone: what a change of the data or of a number held does to the mode.
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

/// Covariance over what is open of the noises and the random forces, from that at the mode on; `whole` = the information there.
fn over_noises(
    at_mode: &DMatrix<f64>,
    whole: &DMatrix<f64>,
    by_dof: &[(usize, Normal)],
    natural: impl Fn(Normal) -> Normal + Sync,
    (fitted, all): (&Fitted, &[Simulated]),
) -> (DMatrix<f64>, Vec<f64>) {
    let mut made = at_mode.clone();
    let mut widths = vec![1.0; at_mode.nrows()];
    if !fitted.problem.noises.has_force {
        return (made, widths);
    }
    // Largest change of each number's variance by one DOF: its distribution is that number's.
    let mut most = vec![0.0; at_mode.nrows()];
    let over = OverNoise {
        problem: &fitted.problem,
        all,
        whole,
        natural,
    };
    for (dof, chosen) in by_dof {
        let cell = fitted.fit.cells.misfit[*dof];
        let Some((change, width)) = over.change(*dof, (cell, chosen), at_mode) else {
            continue;
        };
        for i in 0..most.len() {
            let share = (change[(i, i)] / at_mode[(i, i)]).abs();
            if share > most[i] {
                (most[i], widths[i]) = (share, width[i]);
            }
        }
        // Directions of which nobody knows anything stay so.
        made.zip_apply(&change, |m, c| {
            if m.is_finite() && c.is_finite() {
                *m += c;
            }
        });
    }
    (made, widths)
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
        let (covariance_of_all, widths) =
            over_noises(&at_mode, &whole, &by_dof, to_natural, (fitted, &all));
        let of_data = by_dof
            .into_iter()
            .map(|(d, normal)| (d, normal.information));
        let by_dof = of_data.collect();
        Some(Numbers {
            values: natural.iter().map(|v| v.0).collect(),
            slopes,
            covariance: covariance_of_all,
            widths,
            at_mode,
            beside_held: covariance(&beside),
            by_dof,
        })
    }
}
