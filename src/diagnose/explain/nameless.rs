//! Names that foretell nothing.
//!
//! Enough effects together follow any motion: of a force that none of them is, seven leave noise in the runs fitted, and
//! nothing gained in any other run.

use super::covered::covered;
use super::elect::{foretold, held_to_account};
use super::grow::grow;
use super::look::kinds;
use super::{CLEARLY, Explanation, FAR_FROM_FORETOLD, KINDS, LAW_OUT_OF_REACH, at_best};
use crate::predict::held_out;
use crate::search::Search;
use crate::setting::Track;

/// Whether what is named foretells nothing of runs that go where the fitted ones went, beyond what these leave open of
/// its numbers: it imitates something.
fn foretells_nothing(search: &Search<'_>, e: &Explanation, held: &[Track]) -> bool {
    let known = covered(&[e], held);
    let nothing = search
        .get(&[])
        .and_then(|f| held_out(search.setting, &known, f, search.weights.noise));
    foretold(search, e, &known)
        .zip(nothing)
        .is_some_and(|(own, nothing)| {
            own > FAR_FROM_FORETOLD * at_best(search, e, &known) && own > CLEARLY * nothing
        })
}

/// In the place of names that foretell nothing, the likeliest force without one that matters, is as likely by the runs
/// fitted and is not refuted itself: of those found, else beside nothing.
pub(super) fn without_a_name<'a>(
    search: &Search<'_>,
    best: &Explanation,
    found: impl Iterator<Item = &'a Explanation>,
    held: &[Track],
) -> Option<Explanation> {
    if best.unnamed() || best.by_prediction || !foretells_nothing(search, best, held) {
        return None;
    }
    let matters = |e: &Explanation| e.unnamed() && e.family_weight > search.setting.tolerance;
    let likeliest = |all: &mut dyn Iterator<Item = &Explanation>| {
        all.filter(|e| matters(e) && e.log_evidence > best.log_evidence - LAW_OUT_OF_REACH)
            .filter(|e| !foretells_nothing(search, e, held))
            .map(|e| held_to_account(search, e.clone(), held))
            .filter(matters)
            .max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))
    };
    let free = likeliest(&mut { found }).or_else(|| {
        let seeds = kinds(search, search.get(&[])?, KINDS);
        let grow = |seed| grow(search, seed, &best.fit, best.log_evidence);
        let grown: Vec<Explanation> = seeds.iter().filter_map(grow).collect();
        likeliest(&mut grown.iter())
    });
    tracing::debug!(
        "{:?} foretells nothing: {:?}",
        best.fit.set,
        free.as_ref()
            .map(|f| (f.kind(), &f.fit.set, f.log_evidence))
    );
    free
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::bank::joined;
    use crate::family::Variable;
    use crate::setting::COEFFICIENTS;
    use crate::testing::{candidate, pulled, searched, setting, surge};

    const FRICTION: [(&str, &[(&str, f64)]); 1] = [("coulomb_friction", &[("f_n", 0.4)])];

    #[test]
    fn names_that_foretell_nothing_give_way_to_a_force_without_one() {
        let pull = |k, from_s: f64| pulled(k, &[], Some((from_s, from_s + 1.8, -0.9)));
        let own = setting(&[pull(0, 8.3), pull(1, 7.4)]);
        let seiche = candidate(&own, "seiche");
        let mut search = searched(&own);
        let mut single = search.finished(&[seiche]).unwrap();
        // As large as effects are that cancel each other in the runs fitted.
        single.at[COEFFICIENTS] *= 5.0;
        let named = Explanation::plain(&search, &single);
        // In another run nobody pulls.
        let held = setting(&[surge(2, &[])]).tracks;
        assert!(foretells_nothing(&search, &named, &held));
        let free = without_a_name(&search, &named, std::iter::empty(), &held).unwrap();
        assert!(free.unnamed() && free.family_weight > own.tolerance);
        assert_eq!(free.kind().unwrap().1, Variable::TimeEach);
        // Nothing held out, nothing asked.
        assert!(without_a_name(&search, &named, std::iter::empty(), &[]).is_none());
    }

    #[test]
    fn a_right_name_stays_where_a_run_held_out_has_something_of_its_own() {
        let own = setting(&[surge(0, &FRICTION), surge(1, &FRICTION)]);
        let friction = candidate(&own, "coulomb_friction");
        let mut search = Search::new(&own, &|_| {});
        search.nothing();
        let nothing = search.get(&[]).unwrap().clone();
        search.fit(vec![joined(&own, &nothing, friction, &[0.4])]);
        let single = search.finished(&[friction]).unwrap();
        let named = Explanation::plain(&search, &single);
        let alike = setting(&[surge(2, &FRICTION)]).tracks;
        assert!(!foretells_nothing(&search, &named, &alike));
        let pushed = setting(&[pulled(2, &FRICTION, Some((7.1, 10.9, 3.0)))]).tracks;
        assert!(foretells_nothing(&search, &named, &pushed));
        assert!(without_a_name(&search, &named, std::iter::empty(), &pushed).is_none());
    }
}
