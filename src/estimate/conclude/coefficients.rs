//! The coefficients with their intervals, and what is to be said of each.

use std::collections::BTreeMap;

use hydroline_identify::adopt::ZERO_WITHIN_SD;
use hydroline_identify::parameter::{Coefficient, Term};
use hydroline_identify::{Estimate, Identification, Profile};
use hydroline_numerics::information::correlation;
use hydroline_numerics::statistics::t95;
use hydroline_report::significant;
use nalgebra::DMatrix;

use super::{Concluding, UNEXCITED};
use crate::over_noise::NORMAL_95;
use crate::profiles::profiles;

/// Relative sd above which a coefficient is weakly determined: the interval comes from the profile.
const WEAK: f64 = 0.2;
/// Correlation with another coefficient above which the same holds.
const TIED: f64 = 0.95;
/// Share of its limit's distance at which a coefficient counts as being there.
const AT_LIMIT: f64 = 0.99;

/// A coefficient in a fit.
#[derive(Clone, Copy)]
struct Listed {
    coefficient: Coefficient,
    /// Place among the vehicle's numbers; `None` = it is none of them, since nothing moves it.
    place: Option<usize>,
    /// Of its value here, over what is open of the noise too.
    sd: f64,
    /// Kept at the rig's value, for the runs say nothing of it.
    is_held: bool,
}

impl Concluding<'_> {
    /// Adds every coefficient to a result; `block` = their covariance.
    pub(super) fn describe_coefficients(&self, block: &DMatrix<f64>, result: &mut Identification) {
        let samples = self.fitted.problem.samples();
        let samples: f64 = samples.iter().filter(|n| n.is_finite()).sum();
        let freedom = (samples - self.numbers.values.len() as f64).max(1.0);
        let quantile = t95(freedom);
        let mut profiles = self.weak(quantile, result);
        for (i, c) in self.asked.coefficients.iter().enumerate() {
            let place = self.place(*c);
            let of = Listed {
                coefficient: *c,
                place,
                sd: block[(i, i)].sqrt(),
                is_held: self.fitted.held.contains(c),
            };
            let profile = place.and_then(|p| profiles.remove(&p));
            let estimate = self.estimate(of, profile, quantile);
            result.notes.extend(self.note(of, &estimate));
            result.notes.extend(self.note_unknown(of, &estimate));
            result.parameters.insert(c.key().to_owned(), estimate);
        }
    }

    fn estimate(&self, of: Listed, profile: Option<Profile>, quantile: f64) -> Estimate {
        let Listed {
            coefficient: c,
            place,
            sd,
            is_held,
        } = of;
        let value = place.map_or(c.of_vehicle(&self.rig.vehicle), |p| self.numbers.means[p]);
        // Without priors, what is held is as uncertain as the rig says, and with it what hangs on it.
        let of_runs = match self.fitted.problem.body.prior.is_flat() {
            true => &self.numbers.covariance,
            false => &self.numbers.beside_held,
        };
        let by_runs = place.map_or(f64::INFINITY, |p| of_runs[(p, p)].sqrt());
        let size = value.abs().max(c.size(self.rig));
        // Noise and force are a mixture: its interval, over that of a normal error with its sd.
        let normal = [-NORMAL_95, NORMAL_95];
        let ends = place.map_or(normal, |p| self.numbers.ends[p]);
        let [below, above] = ends.map(|e| e.abs() / NORMAL_95);
        // A profile is that of the mode under the chosen noise and force: it gives the interval its shape.
        let profile = profile.zip(place).map(|(profile, p)| {
            let mode = self.numbers.values[p];
            let wider = sd / self.numbers.at_mode[(p, p)].sqrt();
            Profile {
                low: value + (profile.low - mode) * below * wider,
                high: value + (profile.high - mode) * above * wider,
                ..profile
            }
        });
        let finite = sd.is_finite().then_some(sd);
        Estimate {
            symbol: c.symbol().to_owned(),
            unit: c.unit().to_owned(),
            value,
            sd: finite,
            repeat_sd: None,
            combined_sd: None,
            u95: None,
            largest_share: None,
            low: profile
                .map(|p| p.low)
                .or(finite.map(|sd| value - quantile * below * sd)),
            high: profile
                .map(|p| p.high)
                .or(finite.map(|sd| value + quantile * above * sd)),
            profile,
            rig: c.of_vehicle(&self.rig.vehicle),
            excited: !is_held && by_runs.is_finite() && by_runs < UNEXCITED * size,
            // Damping as small as is looked is none: no limit, but what the runs say.
            at_bound: self.is_at_limit(of) && (c.term == Term::Added || value.abs() > size),
        }
    }

    /// Whether a coefficient ended where the search does.
    fn is_at_limit(&self, of: Listed) -> bool {
        let body = &self.fitted.problem.body;
        of.place.is_some_and(|p| {
            let (low, high) = body.bounds(&[])[p];
            let at = self.fitted.fit.point[p];
            let said = body.own[p].is_said();
            !of.is_held && (at >= AT_LIMIT * high || said && at <= AT_LIMIT * low)
        })
    }

    /// What is to be said of an estimate.
    fn note(&self, of: Listed, estimate: &Estimate) -> Option<String> {
        let (c, zero) = (of.coefficient, ZERO_WITHIN_SD * of.sd);
        let key = c.key();
        if of.place.is_none() || of.is_held {
            Some(format!(
                "{key}: these runs do not move it; kept at the rig's {:.4}",
                estimate.rig
            ))
        } else if !estimate.excited {
            Some(format!(
                "{key}: these runs hardly say anything of it beside what the rig says"
            ))
        } else if estimate.at_bound {
            Some(format!(
                "{key}: ended a hundredfold off the rig's {:.4}, which is as far as is looked; the interval is not to be trusted",
                estimate.rig
            ))
        } else if c.term != Term::Added && estimate.value.abs() < zero {
            Some(format!(
                "{key}: zero within ±{} {}, and these runs do show it: the vehicle may have no such drag",
                significant(zero),
                c.unit()
            ))
        } else {
            None
        }
    }

    /// What was taken for a coefficient that neither the runs nor the rig know.
    fn note_unknown(&self, of: Listed, estimate: &Estimate) -> Option<String> {
        let c = of.coefficient;
        let is_known = estimate.excited || estimate.rig != 0.0;
        if is_known || c.identified_sd(self.rig).is_some() {
            return None;
        }
        let own = &self.fitted.problem.body.own;
        let known = match of.place.filter(|_| !of.is_held) {
            Some(place) => own[place].unit().abs(),
            None => c.prior_sd(self.rig),
        };
        Some(format!(
            "{}: the rig file knows no number; taken as 0 +- {} {} (a vehicle of this mass) in the other intervals",
            c.key(),
            significant(known),
            c.unit()
        ))
    }

    /// Profiles of the coefficients that are weakly determined, by their places, the weakest first.
    fn weak(&self, quantile: f64, result: &mut Identification) -> BTreeMap<usize, Profile> {
        let own = &self.fitted.problem.body.own;
        let covariance = &self.numbers.covariance;
        let correlations = correlation(covariance);
        let share = |i: usize| covariance[(i, i)].sqrt() / self.numbers.values[i].abs();
        let tied = |i: usize| (0..own.len()).any(|j| j != i && correlations[(i, j)].abs() > TIED);
        let is_weak = |i: &usize| {
            let known = covariance[(*i, *i)].is_finite() && !self.fitted.is_held(&own[*i]);
            known && (share(*i) > WEAK || tied(*i))
        };
        let mut weak: Vec<usize> = (0..own.len()).filter(is_weak).collect();
        weak.sort_by(|a, b| share(*b).total_cmp(&share(*a)));
        let (found, fits) = profiles(self.fitted, self.numbers, &weak, quantile);
        result.fits += fits;
        let pairs = weak.iter().zip(&found);
        let linear: Vec<&str> = pairs
            .clone()
            .filter(|(_, p)| p.is_none())
            .map(|(i, _)| own[*i].name())
            .collect();
        if !linear.is_empty() {
            result.notes.push(format!(
                "{}: weakly determined too, but interval from the sd: the time for profiles was spent on those of the weaker ones",
                linear.join(", ")
            ));
        }
        pairs.filter_map(|(i, p)| Some((*i, (*p)?))).collect()
    }
}
