//! The heavy members of a set alone, one of them with a law that varies evenly.

use rayon::prelude::*;

use super::Explanation;
use super::look::closed;
use crate::bank::{View, without};
use crate::family::bends;
use crate::fit::{Fit, Posed};
use crate::search::Search;

/// Heavy members at most: what is there then is more than one law that is not quite the vocabulary's.
const HEAVY: usize = 3;

/// A set whose light members are left out, each of its heavy ones bent as a line along the tank or in the course of a log:
/// several light effects together do what one heavy law varies by (a battery that recovers), each gains beside the others,
/// and with them there the line gains nothing. From so far off a linear promise says little: none is asked for.
pub(super) fn evenly(search: &Search<'_>, best: &Fit, heavy: &[usize]) -> Vec<Explanation> {
    let setting = search.setting;
    let all_are = best.set.iter().all(|c| heavy.contains(c));
    if heavy.is_empty() || heavy.len() > HEAVY || all_are {
        return Vec::new();
    }
    let mut alone = best.clone();
    while let Some(light) = alone.set.iter().position(|c| !heavy.contains(c)) {
        let (set, at) = without(setting, &alone, light);
        alone = Fit { set, at, ..alone };
    }
    let effort = search.weights.to_a_percent();
    let posed = Posed::new(setting, &search.weights, &alone.set);
    let Some(alone) = posed.fit_with(alone.at, effort).ok() else {
        return Vec::new();
    };
    let view = View::new(setting, &search.weights, &alone);
    let mut lines = bends(setting, &alone, heavy);
    lines.retain(|f| f.straight());
    lines
        .par_iter()
        .filter_map(|line| closed(search, &alone, &view, line))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bank::joined;
    use crate::family::Variable;
    use crate::testing::{candidate, searched, setting, surge};

    #[test]
    fn heavy_members_are_bent_as_lines_without_the_light_ones() {
        let effects: [(&str, &[(&str, f64)]); 2] = [
            ("battery_sag", &[("sag", 0.08)]),
            ("coulomb_friction", &[("f_n", 0.03)]),
        ];
        let own = setting(&[surge(0, &effects), surge(1, &effects)]);
        let (battery, friction) = (
            candidate(&own, "battery_sag"),
            candidate(&own, "coulomb_friction"),
        );
        let mut search = searched(&own);
        let single = search.finished(&[battery]).unwrap();
        search.fit(vec![joined(&own, &single, friction, &[0.03])]);
        let mut both = [battery, friction];
        both.sort_unstable();
        let both = search.finished(&both).unwrap();
        let ways = |heavy: &[usize]| {
            let found = evenly(&search, &both, heavy);
            assert!(found.iter().all(|e| e.fit.set == heavy));
            found
                .iter()
                .map(|e| {
                    let family = &e.family.as_ref().unwrap().family;
                    assert!(family.straight() && e.bent() == Some(heavy[0]));
                    family.variable
                })
                .collect::<Vec<_>>()
        };
        // A thruster knows nothing of the tank; a friction may vary along it.
        assert_eq!(ways(&[battery]), [Variable::Time]);
        assert_eq!(ways(&[friction]), [Variable::Place, Variable::Time]);
        // Where nothing is light nothing is left out.
        assert!(ways(&both.set).is_empty());
        assert!(ways(&[]).is_empty());
    }
}
