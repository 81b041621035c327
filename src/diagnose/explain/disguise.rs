//! A law that bends by the rate until little of it is left: a force of the rate.

use hydroline_sim::effect::Stage;
use rayon::prelude::*;

use super::covered::covered;
use super::elect::{foretold, foretold_where_known};
use super::grow::grow;
use super::look::measured_where_far;
use super::{Explanation, MISSES};
use crate::bank::{View, without};
use crate::family::{Acts, Variable, forces};
use crate::fit::{Fit, Posed};
use crate::search::Search;
use crate::setting::Track;

/// Part that a law must explain as it is, of what it explains bent.
///
/// Friction that is larger near rest (Stribeck) explains all but a thousandth without that; of a force at one speed a
/// drag explains half to four fifths.
const OWN: f64 = 0.9;
/// Log evidence by which the force may be behind, at most and of what the law explains bent: its knots lie otherwise.
/// What bends another way is further off.
const SAME: (f64, f64) = (30.0, 0.1);

/// A force of the rate in the place of a law that bends by the rate into something else, with what is found beside it:
/// as functions both are one, and the law's name would say nothing.
pub(super) fn unmasked(
    search: &Search<'_>,
    e: &Explanation,
    held: &[Track],
) -> Option<Explanation> {
    let (setting, tolerance) = (search.setting, search.setting.tolerance);
    let function = e.family.as_ref()?;
    let Acts::Bends(law) = function.family.acts else {
        return None;
    };
    let in_the_water = setting.vocabulary[law].info.stage == Stage::Hydrodynamics;
    if !in_the_water || function.family.variable.quantity() != Variable::Rate {
        return None;
    }
    let (others, own) = part_of_law(search, e, law)?;
    if own > OWN {
        return None;
    }
    let behind = SAME.0.min(SAME.1 * (others.cost - e.cost()));
    let noise = search.weights.noise.total_sd();
    let missed = foretold_where_known(search, e, held).map(|m| MISSES * m.max(noise));
    let view = View::new(setting, &search.weights, &others);
    let mut families = forces(setting, &others);
    measured_where_far(search, &others, &mut families);
    families.retain(|f| f.variable.quantity() == Variable::Rate);
    let found = families
        .into_par_iter()
        .filter_map(|f| f.fit(setting, &search.weights, &others, &view))
        .filter_map(|f| {
            f.close(
                setting,
                &search.weights,
                &others,
                search.weights.to_a_percent(),
            )
        })
        .map(|(joint, f)| Explanation::with(search, joint, f))
        .filter_map(|seed| grow(search, &seed, &others, e.log_evidence))
        .filter(|f| f.family_weight > tolerance && f.log_evidence > e.log_evidence - behind)
        // The law beside the force that it was bent into says nothing either.
        .filter(|f| !f.fit.set.contains(&law))
        .filter(|f| {
            let own = foretold(search, f, &covered(&[e, f], held));
            own.zip(missed).is_none_or(|(own, most)| own <= most)
        })
        .max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence));
    tracing::debug!(
        "{} explains {own:.2} of what it does bent: {:?} for {:.1}",
        setting.vocabulary[law].info.id,
        found
            .as_ref()
            .map(|f| (f.kind(), &f.fit.set, f.log_evidence)),
        e.log_evidence
    );
    found
}

/// The other members alone; and of what a law explains bent, in half chi-square beside them, the part that it
/// explains as it is.
fn part_of_law(search: &Search<'_>, e: &Explanation, law: usize) -> Option<(Fit, f64)> {
    let setting = search.setting;
    // From the numbers beside the bend; the search may know better ones.
    let fit = |set: &[usize], at: Vec<f64>| {
        let made = Posed::new(setting, &search.weights, set).fit(at).ok();
        made.iter()
            .chain(search.get(set))
            .filter(|f| f.cost.is_finite())
            .min_by(|a, b| a.cost.total_cmp(&b.cost))
            .cloned()
    };
    let member = e.fit.set.iter().position(|c| *c == law)?;
    let (set, at) = without(setting, &e.fit, member);
    let (others, straight) = (fit(&set, at)?, fit(&e.fit.set, e.fit.at.clone())?);
    let bent = others.cost - e.cost();
    let part = (others.cost - straight.cost) / bent;
    (bent > 0.0 && part.is_finite()).then_some((others, part))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::bank::joined;
    use crate::family::bends;
    use crate::testing::{candidate, forced, setting};
    use hydroline_identify::data::Run;

    /// Judges one effect whose law bends by the rate.
    fn bent(runs: &[Run], (id, size): (&str, f64), judge: impl Fn(&Search<'_>, &Explanation)) {
        let own = setting(runs);
        let law = candidate(&own, id);
        let mut search = Search::new(&own, &|_| {});
        search.nothing();
        let nothing = search.get(&[]).unwrap().clone();
        search.fit(vec![joined(&own, &nothing, law, &[size])]);
        let single = search.finished(&[law]).unwrap();
        let view = View::new(&own, &search.weights, &single);
        let mut families = bends(&own, &single, &[law]);
        measured_where_far(&search, &single, &mut families);
        let effort = search.weights.to_a_percent();
        let made = families
            .iter()
            .filter(|f| f.variable.quantity() == Variable::Rate)
            .filter_map(|f| f.fit(&own, &search.weights, &single, &view))
            .filter_map(|f| f.close(&own, &search.weights, &single, effort))
            .max_by(|a, b| a.0.log_evidence.total_cmp(&b.0.log_evidence));
        let (joint, function) = made.unwrap();
        let made = Explanation::with(&search, joint, function);
        judge(&search, &made);
    }

    #[test]
    fn a_drag_bent_to_a_force_at_one_speed_is_that_force() {
        let runs = [0, 1, 2].map(|k| forced(k, |u| 0.5 * (-((u - 0.08) / 0.02).powi(2)).exp()));
        bent(&runs, ("cubic_damping", 100.0), |search, drag| {
            let force = unmasked(search, drag, &[]).unwrap();
            assert!(force.unnamed() && force.fit.set.is_empty());
            assert!(force.family_weight > search.setting.tolerance);
            assert_eq!(force.kind(), Some((Acts::Force, Variable::Rate)));
        });
    }

    #[test]
    fn a_friction_that_varies_with_the_speed_stays_one() {
        // Stribeck: two fifths more near rest.
        let stribeck =
            |u: f64| -0.5 * (1.0 + 0.4 * (-(u / 0.02).powi(2)).exp()) * (u / 0.004).tanh();
        let runs = [0, 1, 2].map(|k| forced(k, stribeck));
        bent(&runs, ("coulomb_friction", 0.4), |search, friction| {
            assert!(unmasked(search, friction, &[]).is_none());
        });
    }
}
