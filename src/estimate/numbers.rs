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
use super::over_noise::{NORMAL_95, OverNoise, acting};

/// A direction whose information is below this share of the largest (after scaling every number to unit information) is rounding.
const RANK: f64 = 1e-11;

/// Values of a mode with what is known of them: the vehicle's own numbers first, then each run's start.
pub(crate) struct Numbers {
    pub values: Vec<f64>,
    /// Means over what is open of the noise and the random force; within what the model can have.
    pub means: Vec<f64>,
    /// Natural number by the scaled one.
    pub slopes: Vec<f64>,
    /// Posterior covariance about the means, over the same; of what is held as the rig knows it.
    pub covariance: DMatrix<f64>,
    /// Ends of each number's 95 % interval about its mean over its sd: noise and force are a mixture.
    pub ends: Vec<[f64; 2]>,
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

/// Means, covariance and ends over what is open of the noises and the random forces.
struct OverNoises {
    means: Vec<f64>,
    covariance: DMatrix<f64>,
    ends: Vec<[f64; 2]>,
}

/// Of a mode with these values and covariance; `whole` = the information there, `open` = the normal equations of DOFs whose noise is open.
fn over_noises(
    (values, at_mode): (Vec<f64>, &DMatrix<f64>),
    whole: &DMatrix<f64>,
    open: &[(usize, Normal)],
    natural: impl Fn(Normal) -> Normal + Sync,
    (fitted, all): (&Fitted, &[Simulated]),
) -> OverNoises {
    let mut made = OverNoises {
        ends: vec![[-NORMAL_95, NORMAL_95]; values.len()],
        means: values,
        covariance: at_mode.clone(),
    };
    let body = &fitted.problem.body;
    let is_held = |i: &usize| fitted.is_held(&body.own[*i]);
    let held: Vec<usize> = (0..body.own.len()).filter(is_held).collect();
    // Largest change of each number's variance by one DOF: its distribution is that number's.
    let mut most = vec![0.0; at_mode.nrows()];
    for (dof, chosen) in open {
        let over = OverNoise {
            problem: &fitted.problem,
            all: acting(all, *dof),
            dof: *dof,
            whole,
            held: &held,
            natural: &natural,
        };
        let cell = fitted.fit.cells.misfit[*dof];
        let Some(change) = over.change((cell, chosen), at_mode) else {
            continue;
        };
        for i in 0..most.len() {
            let share = (change.covariance[(i, i)] / at_mode[(i, i)]).abs();
            if share > most[i] {
                (most[i], made.ends[i]) = (share, change.ends[i]);
            }
            if change.mean[i].is_finite() {
                made.means[i] += change.mean[i];
            }
        }
        // Directions of which nobody knows anything stay so.
        made.covariance.zip_apply(&change.covariance, |m, c| {
            if m.is_finite() && c.is_finite() {
                *m += c;
            }
        });
    }
    // No farther than the model goes: the error is then about the limit.
    for (i, (own, (low, high))) in body.own.iter().zip(body.bounds(&[])).enumerate() {
        let limits = [own.natural(low).0, own.natural(high).0];
        let within = made.means[i].clamp(limits[0].min(limits[1]), limits[0].max(limits[1]));
        made.covariance[(i, i)] += (within - made.means[i]).powi(2);
        made.means[i] = within;
    }
    made
}

impl Numbers {
    /// Of a fit, over what is open of its noise and random force; `None` where its motion is not finite.
    pub fn of(fitted: &Fitted, rig: &Rig) -> Option<Numbers> {
        Numbers::made(fitted, rig, fitted.problem.noises.has_force)
    }

    /// Of a fit under the noise and the random force that it has.
    pub fn at_mode(fitted: &Fitted, rig: &Rig) -> Option<Numbers> {
        Numbers::made(fitted, rig, false)
    }

    fn made(fitted: &Fitted, rig: &Rig, is_open: bool) -> Option<Numbers> {
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
        let values: Vec<f64> = natural.iter().map(|v| v.0).collect();
        let mode = (values.clone(), &at_mode);
        let open = if is_open { &by_dof[..] } else { &[] };
        let over = over_noises(mode, &whole, open, to_natural, (fitted, &all));
        let of_data = by_dof
            .into_iter()
            .map(|(d, normal)| (d, normal.information));
        let by_dof = of_data.collect();
        Some(Numbers {
            values,
            means: over.means,
            slopes,
            covariance: over.covariance,
            ends: over.ends,
            at_mode,
            beside_held: covariance(&beside),
            by_dof,
        })
    }
}
