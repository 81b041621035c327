//! How still the runs begin that begin at rest.
//!
//! A vehicle that waited stands still; one let go by hand, or not yet settled, drifts. A drift of 0.1 mm/s does
//! the work of a small constant force or of a tether's slack for as long as the vehicle coasts, so how much of it
//! is allowed decides what can be told apart. Runs are taken to stand still; where that leaves the rates
//! wanting, they share one sd, the likeliest (type-II maximum likelihood, MacKay 1992).

use nalgebra::{DMatrix, DVector};

use super::descent::{Linear, Linearised};
use super::fit::{Fit, Posed};
use super::setting::Setting;
use super::weights::Weights;
use hydroline_identify::uncertainty::covariance;

/// A run begins at rest but for the tolerance drifted in this time \[s\]: the most that is allowed.
const DRIFT_S: f64 = 2.0;
/// Standing still over the most: it drifts a thirtieth of the tolerance in a minute.
const STILL: f64 = 1e-3;
/// Steps of the sd in between.
const STEPS: i32 = 24;
/// Share of the likeliest sd's evidence below which one says nothing.
const NEGLIGIBLE: f64 = 1e-3;
/// Log evidence that an sd must gain over standing still to be believed at all: one more number.
pub const WORTH: f64 = 3.0;

/// The most a run that begins at rest may drift, as sd \[m/s, rad/s\].
pub fn most(tolerance: f64) -> f64 {
    tolerance / DRIFT_S
}

/// Standing still, as sd \[m/s, rad/s\].
pub fn still(tolerance: f64) -> f64 {
    STILL * most(tolerance)
}

/// From the most down to standing still.
fn sds(tolerance: f64) -> impl Iterator<Item = f64> {
    (0..=STEPS).map(move |k| most(tolerance) * STILL.powf(f64::from(k) / f64::from(STEPS)))
}

/// Places of the rates at the start, among the unknowns of a fit with `globals` numbers before them, of the runs
/// that begin at rest.
pub fn places(setting: &Setting, globals: usize) -> Vec<usize> {
    let tracks = setting.tracks.iter().enumerate();
    tracks
        .filter(|(_, t)| !t.starts_under_way(setting.tolerance))
        .map(|(run, _)| globals + 2 * run + 1)
        .collect()
}

/// What the data say of the rates at the start, all other unknowns free to follow.
#[derive(Debug)]
pub struct Rates {
    /// Second derivatives of the cost.
    own: DMatrix<f64>,
    /// The same times the best rates.
    toward: DVector<f64>,
}

impl Rates {
    /// From second derivatives with respect to all unknowns, without what is believed of the rates, which
    /// are at `places`, and the best `rates` under that. `None` without rates, or where the data do not hold the other
    /// unknowns.
    pub fn new(normal: &DMatrix<f64>, places: &[usize], rates: &[f64]) -> Option<Rates> {
        let (own, _) = reduced(normal, &DVector::zeros(normal.nrows()), places)?;
        let toward = &own * DVector::from_column_slice(rates);
        Some(Rates { own, toward })
    }

    /// From a fit's derivatives under what is believed of the rates at `places`, by a Newton step from where it is:
    /// held still to a thousandth of a millimetre per second, what is left of its gradient is as large as what the
    /// data pull by.
    fn of(linear: &Linear, at: &[f64], places: &[usize], believed: f64) -> Option<Rates> {
        let (hessian, gradient) = believing(linear, at, places, -believed);
        let (own, pull) = reduced(&hessian, &gradient, places)?;
        let at = DVector::from_iterator(places.len(), places.iter().map(|k| at[*k]));
        Some(Rates {
            toward: &own * &at - pull,
            own,
        })
    }

    /// Log evidence of rates spread by this, up to what all spreads share.
    fn evidence(&self, sd: f64) -> f64 {
        let p = 1.0 / (sd * sd);
        let mut both = self.own.clone();
        for i in 0..both.nrows() {
            both[(i, i)] += p;
        }
        let Some(cholesky) = both.cholesky() else {
            return f64::NEG_INFINITY;
        };
        let log_det: f64 = cholesky.l().diagonal().iter().map(|d| d.ln()).sum();
        0.5 * self.own.nrows() as f64 * p.ln() - log_det
            + 0.5 * self.toward.dot(&cholesky.solve(&self.toward))
    }

    /// The sd to go on with: the likeliest where that is worth a number, else standing still.
    pub fn believed(&self, tolerance: f64) -> f64 {
        match self.likeliest(tolerance) {
            (sd, gain) if gain > WORTH => sd,
            _ => still(tolerance),
        }
    }

    /// The likeliest sd from standing still to the most, and the log evidence that it gains over standing still.
    fn likeliest(&self, tolerance: f64) -> (f64, f64) {
        let alone = self.evidence(still(tolerance));
        sds(tolerance)
            .map(|sd| (sd, self.evidence(sd) - alone))
            .fold((still(tolerance), 0.0), |best, now| {
                if now.1 > best.1 { now } else { best }
            })
    }
}

/// What not knowing how still the runs begin adds to the variance of each unknown of a fit: over all sds by their
/// evidence, the mean square change of its best value and the change of its variance. Infinite where some sd leaves
/// it open.
pub fn spread(setting: &Setting, weights: &Weights, fit: &Fit) -> Vec<f64> {
    let n = fit.at.len();
    let places = places(setting, fit.globals(setting).len());
    let tolerance = setting.tolerance;
    let believed = weights.rest_precision(tolerance);
    let posed = Posed::new(setting, weights, &fit.set);
    let Ok(linear) = posed.linearise(&fit.at) else {
        return vec![0.0; n];
    };
    let Some(rates) = Rates::of(&linear, &fit.at, &places, believed) else {
        return vec![0.0; n];
    };
    let own = covariance(&linear.hessian);
    let home = &own * &linear.gradient;
    let top = rates.evidence(rates.likeliest(tolerance).0);
    let (mut total, mut more) = (0.0, vec![0.0; n]);
    for sd in sds(tolerance) {
        let share = (rates.evidence(sd) - top).exp();
        if share < NEGLIGIBLE {
            continue;
        }
        let change = sd.powi(-2) - believed;
        let (hessian, gradient) = believing(&linear, &fit.at, &places, change);
        let wider = covariance(&hessian);
        let moved = &wider * gradient - &home;
        total += share;
        for k in 0..n {
            let by = moved[k].powi(2) + wider[(k, k)] - own[(k, k)];
            more[k] += share * if by.is_nan() { f64::INFINITY } else { by };
        }
    }
    more.iter()
        .map(|m| (m / f64::max(total, NEGLIGIBLE)).max(0.0))
        .collect()
}

/// Second derivatives and gradient where the precision of the rates at `places` is another by `change`.
fn believing(
    linear: &Linear,
    at: &[f64],
    places: &[usize],
    change: f64,
) -> (DMatrix<f64>, DVector<f64>) {
    let (mut hessian, mut gradient) = (linear.hessian.clone(), linear.gradient.clone());
    for k in places {
        hessian[(*k, *k)] += change;
        gradient[*k] += change * at[*k];
    }
    (hessian, gradient)
}

/// Second derivatives and gradient with respect to some unknowns, all others free to follow.
pub(super) fn reduced(
    normal: &DMatrix<f64>,
    gradient: &DVector<f64>,
    places: &[usize],
) -> Option<(DMatrix<f64>, DVector<f64>)> {
    if places.is_empty() || normal.iter().any(|v| !v.is_finite()) {
        return None;
    }
    let others: Vec<usize> = (0..normal.nrows())
        .filter(|i| !places.contains(i))
        .collect();
    let part =
        |a: &[usize], b: &[usize]| DMatrix::from_fn(a.len(), b.len(), |i, j| normal[(a[i], b[j])]);
    // Unknowns of any size, and some that nothing tells.
    let scale: Vec<f64> = others
        .iter()
        .map(|i| 1.0 / normal[(*i, *i)].max(1e-300).sqrt())
        .collect();
    let mut inner = part(&others, &others);
    let mut cross = part(&others, places);
    let mut rest = DVector::from_fn(others.len(), |i, _| gradient[others[i]] * scale[i]);
    rest.iter_mut()
        .filter(|v| !v.is_finite())
        .for_each(|v| *v = 0.0);
    for i in 0..others.len() {
        for j in 0..others.len() {
            inner[(i, j)] *= scale[i] * scale[j];
        }
        inner[(i, i)] += 1e-10;
        cross.row_mut(i).scale_mut(scale[i]);
    }
    let inner = inner.cholesky()?;
    let made = part(places, places) - cross.tr_mul(&inner.solve(&cross));
    let own = DVector::from_fn(places.len(), |i, _| gradient[places[i]]);
    let pull = own - cross.tr_mul(&inner.solve(&rest));
    Some((0.5 * (&made + made.transpose()), pull))
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOLERANCE: f64 = 2e-3;

    /// Four runs, each rate known to 0.1 mm/s, beside an unknown that all share.
    fn normal() -> DMatrix<f64> {
        let mut h = DMatrix::identity(5, 5) * 1e8;
        h[(4, 4)] = 4.0;
        for i in 0..4 {
            h[(i, 4)] = 1e3;
            h[(4, i)] = 1e3;
        }
        h
    }

    fn likeliest(normal: &DMatrix<f64>, rates: &[f64]) -> (f64, f64) {
        Rates::new(normal, &[0, 1, 2, 3], rates)
            .unwrap()
            .likeliest(TOLERANCE)
    }

    #[test]
    fn runs_that_begin_at_rest_are_believed_to() {
        let (sd, gain) = likeliest(&normal(), &[5e-5, -4e-5, 2e-5, -6e-5]);
        assert!(sd < 3e-5 && gain < WORTH, "{sd} {gain}");
    }

    #[test]
    fn runs_that_drift_are_let_drift() {
        let (sd, gain) = likeliest(&normal(), &[8e-4, -5e-4, 9e-4, -7e-4]);
        assert!(
            (5e-4..=1e-3).contains(&sd) && gain > 10.0 * WORTH,
            "{sd} {gain}"
        );
    }

    #[test]
    fn rates_that_nothing_tells_are_none() {
        let (_, gain) = likeliest(&(normal() * 1e-9), &[8e-4, -5e-4, 9e-4, -7e-4]);
        assert!(gain < 1e-3, "{gain}");
        assert!(Rates::new(&normal(), &[], &[]).is_none());
    }

    /// Held still or let drift, begun at rest or far from it, a fit says the same of its rates.
    #[test]
    fn a_fit_tells_its_rates_whatever_was_believed() {
        use crate::testing::{setting, surge};
        let setting = setting(&[surge(0, &[]), surge(1, &[])]);
        let free = Weights::first(&setting.tracks);
        let held = free.clone().at_rest(Some(still(setting.tolerance)));
        let told = |weights: &Weights, rate: f64| {
            let posed = Posed::new(&setting, weights, &[]);
            let mut from = posed.start();
            for k in places(&setting, 3) {
                from[k] = rate;
            }
            let fit = posed.fit(from).unwrap();
            let linear = posed.linearise(&fit.at).unwrap();
            let believed = weights.rest_precision(setting.tolerance);
            let rates = Rates::of(&linear, &fit.at, &places(&setting, 3), believed).unwrap();
            let known = rates.own.clone().cholesky().unwrap().solve(&rates.toward);
            (known, rates.likeliest(setting.tolerance).1)
        };
        let (rates, gain) = told(&free, 0.0);
        for (other, worth) in [told(&held, 0.0), told(&held, 1e-3), told(&free, 1e-3)] {
            assert!(
                (&other - &rates).amax() < 2e-6 && (worth - gain).abs() < 0.1,
                "{other} {rates} {worth} {gain}"
            );
        }
    }

    /// Against the same fit made under each sd: what its mass may be is as wide as they say together.
    #[test]
    fn not_knowing_how_still_widens_as_fits_under_each_sd_do() {
        use crate::testing::{setting, surge};
        let setting = setting(&[surge(0, &[]), surge(1, &[])]);
        let free = Weights::first(&setting.tracks);
        let tolerance = setting.tolerance;
        let under = |sd: f64| {
            let weights = free.clone().at_rest(Some(sd));
            let posed = Posed::new(&setting, &weights, &[]);
            posed.fit(posed.start()).unwrap()
        };
        let fit = under(still(tolerance));
        let held = free.clone().at_rest(Some(still(tolerance)));
        let widened = spread(&setting, &held, &fit);
        let (mut total, mut more) = (0.0, 0.0);
        for sd in sds(tolerance) {
            let other = under(sd);
            // Laplace, as Posed has it, with the rates' prior.
            let share =
                (other.log_evidence - fit.log_evidence - 2.0 * (sd / still(tolerance)).ln()).exp();
            total += share;
            more += share
                * ((other.at[0] - fit.at[0]).powi(2) + other.covariance()[(0, 0)]
                    - fit.covariance()[(0, 0)]);
        }
        let ratio = widened[0] / (more / total);
        assert!((0.8..1.25).contains(&ratio), "{ratio}");
    }
}
