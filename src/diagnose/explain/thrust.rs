//! A free force of the load is what a thruster gives: a law with a corner in the load that needs one beside it is
//! another one than the vocabulary's (a round shoulder), and nothing is without a name.

use super::Explanation;
use super::look::{BELIEVED, MODEST};
use crate::bank::{View, joined};
use crate::descent::Effort;
use crate::family::Variable;
use crate::fit::{Fit, Posed};
use crate::search::Search;

/// A force of the load that matters as what the law of a thruster lacks: of the heaviest member with a corner in the load
/// or, where there is none, of one that joins it and leaves it less to do. As it is where no such law does the most of it.
pub fn of_a_thruster(search: &Search<'_>, found: Explanation) -> Explanation {
    let setting = search.setting;
    let of_load = found
        .kind()
        .is_some_and(|(_, v)| v.quantity() == Variable::Load);
    if !(found.unnamed() && of_load && found.family_weight > setting.tolerance) {
        return found;
    }
    if let Some(own) = most_of_it(search, &found) {
        return named(found, own);
    }
    let corners = (0..setting.vocabulary.len())
        .filter(|c| has_corner(search, *c) && !found.fit.set.contains(c));
    let other = corners
        .filter_map(|c| beside(search, &found, c))
        .filter(|(e, _)| e.log_evidence > found.log_evidence - BELIEVED)
        .max_by(|a, b| a.0.log_evidence.total_cmp(&b.0.log_evidence));
    match other {
        Some((e, candidate)) => named(e, candidate),
        None => found,
    }
}

fn named(found: Explanation, candidate: usize) -> Explanation {
    tracing::debug!("a force of the load is the law of {candidate}");
    Explanation {
        shoulder: Some(candidate),
        ..found
    }
}

fn has_corner(search: &Search<'_>, candidate: usize) -> bool {
    search.setting.vocabulary[candidate].info.parameters[0].corner
}

/// The heaviest member with a corner in the load, if the function does no more than a bend of its law may.
fn most_of_it(search: &Search<'_>, e: &Explanation) -> Option<usize> {
    e.fit
        .set
        .iter()
        .zip(&e.weights)
        .filter(|(c, w)| has_corner(search, **c) && e.family_weight <= MODEST * **w)
        .max_by(|a, b| a.1.total_cmp(b.1))
        .map(|(c, _)| *c)
}

/// The set with such a member, which takes what it can before the function does.
fn beside(
    search: &Search<'_>,
    found: &Explanation,
    candidate: usize,
) -> Option<(Explanation, usize)> {
    let (setting, weights) = (search.setting, &search.weights);
    let function = found.family.as_ref()?;
    let plain = setting.vocabulary[candidate]
        .starts
        .iter()
        .filter_map(|start| {
            let (set, at) = joined(setting, &found.fit, candidate, start);
            let posed = Posed::new(setting, weights, &set);
            posed.fit_with(at, weights.to_a_percent()).ok()
        })
        .filter(|f: &Fit| f.log_evidence.is_finite())
        .min_by(|a, b| a.cost.total_cmp(&b.cost))?;
    let view = View::new(setting, weights, &plain);
    let linear = function.family.fit(setting, weights, &plain, &view)?;
    let (joint, function) = linear.close(setting, weights, &plain, Effort::FULL)?;
    // One that only takes back what another one does is no law of a thruster.
    if search.blind.contains(&candidate) || !joint.confounded(setting).is_empty() {
        return None;
    }
    let e = Explanation::with(search, joint, function);
    tracing::debug!(
        "{candidate} beside a force of the load: {:.1}, weighs {:.5}, members {:.5?}",
        e.log_evidence,
        e.family_weight,
        e.weights
    );
    (most_of_it(search, &e) == Some(candidate)).then_some((e, candidate))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::family::forces;
    use crate::testing::{candidate, setting, surge};

    /// A limit with a round shoulder left a force of the load without a name beside it.
    #[test]
    fn a_force_of_the_load_beside_a_limit_is_the_limits_law() {
        let effects: [(&str, &[(&str, f64)]); 1] = [("thruster_saturation", &[("limit_n", 5.0)])];
        let own = setting(&[surge(0, &effects), surge(1, &effects)]);
        let limit = candidate(&own, "thruster_saturation");
        let mut search = Search::still(&own, &|_| {});
        search.nothing();
        search.singles();
        let fit = search.finished(&[limit]).unwrap();
        let view = View::new(&own, &search.weights, &fit);
        let all = forces(&own, &fit);
        let beside = |variable: Variable, share: f64| {
            let family = all.iter().find(|f| f.variable == variable).unwrap();
            let plain = Explanation::plain(&search, &fit);
            let family_weight = share * plain.weights[0];
            assert!(family_weight > own.tolerance);
            let found = Explanation {
                family: family.fit(&own, &search.weights, &fit, &view),
                family_weight,
                ..plain
            };
            assert!(found.unnamed() && found.bent().is_none());
            of_a_thruster(&search, found)
        };
        let law = beside(Variable::Load, 0.4);
        assert_eq!((law.unnamed(), law.bent()), (false, Some(limit)));
        let needed = super::super::needs(&search, &law);
        assert!(needed[0].1 > 10.0, "{needed:?}");
        // One that does more than a bend of its law may, and one of anything else, have no name.
        assert!(beside(Variable::Rate, 0.4).unnamed());
        assert!(beside(Variable::Load, 0.6).unnamed());
    }
}
