//! What the likeliest explanation has, beside laws that bend.

use super::Explanation;
use super::beside::beside;
use crate::search::Search;

/// Laws that bend asked with what the likeliest explanation has, at most.
const CROSSED: usize = 3;

/// Laws that bend, each with what the likeliest explanation has beside another one and with the numbers it has there: what
/// is found beside one (a limit just below the largest load) no start leads to beside another.
pub(super) fn crossed(search: &Search<'_>, contenders: &[Explanation]) -> Vec<Explanation> {
    let by_evidence =
        |a: &&Explanation, b: &&Explanation| a.log_evidence.total_cmp(&b.log_evidence);
    let Some(top) = contenders.iter().max_by(by_evidence) else {
        return Vec::new();
    };
    let mut others: Vec<&Explanation> = contenders
        .iter()
        .filter(|e| e.family.is_some() && e.bent().is_some() && e.kind() != top.kind())
        .filter(|e| e.log_evidence > top.log_evidence - super::LAW_OUT_OF_REACH)
        .collect();
    others.sort_by(|a, b| by_evidence(b, a));
    let mut seen = Vec::new();
    others.retain(|e| {
        let new = !seen.contains(&e.kind());
        seen.push(e.kind());
        new
    });
    others
        .into_iter()
        .take(CROSSED)
        .filter_map(|e| {
            let found = beside(search, e, &top.fit, top.log_evidence);
            tracing::debug!(
                "with what {:?} has: {:?} {:.1} for {:.1}",
                top.fit.set,
                found.fit.set,
                found.log_evidence,
                e.log_evidence
            );
            (found.log_evidence > e.log_evidence).then_some(found)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bank::{View, joined};
    use crate::family::{Variable, bends};
    use crate::testing::{candidate, searched, setting, surge};

    #[test]
    fn a_bent_law_is_asked_with_what_the_likeliest_has_beside_another() {
        let effects: [(&str, &[(&str, f64)]); 2] = [
            ("coulomb_friction", &[("f_n", 0.4)]),
            ("thruster_saturation", &[("limit_n", 7.95)]),
        ];
        let own = setting(&[surge(0, &effects), surge(1, &effects), surge(2, &effects)]);
        let (friction, limit) = (
            candidate(&own, "coulomb_friction"),
            candidate(&own, "thruster_saturation"),
        );
        let mut search = searched(&own);
        let single = search.finished(&[friction]).unwrap();
        search.fit(vec![joined(&own, &single, limit, &[7.94])]);
        let mut both = [friction, limit];
        both.sort_unstable();
        let both = search.finished(&both).unwrap();
        let top = Explanation::plain(&search, &both);
        let view = View::new(&own, &search.weights, &single);
        let law = bends(&own, &single, &[friction])
            .into_iter()
            .find(|f| f.variable == Variable::SinceEdge)
            .and_then(|f| f.fit(&own, &search.weights, &single, &view))
            .unwrap();
        let bent = Explanation::with(&search, single, law);
        assert_eq!(bent.bent(), Some(friction));
        let found = crossed(&search, &[bent.clone(), top.clone()]);
        assert_eq!(found.len(), 1);
        assert!(found[0].fit.set.contains(&limit) && found[0].bent() == Some(friction));
        assert!(found[0].log_evidence > bent.log_evidence + 10.0);
        let at = found[0].fit.set.iter().position(|c| *c == limit).unwrap();
        let limit_n = found[0].fit.member(&own, at)[0];
        assert!((limit_n - 7.95).abs() < 0.03, "{limit_n}");
        // What is out of reach is not asked, and one by itself has nothing to be given.
        let far = Explanation {
            log_evidence: top.log_evidence - 2.0 * super::super::LAW_OUT_OF_REACH,
            ..bent.clone()
        };
        assert!(crossed(&search, &[far, top]).is_empty());
        assert!(crossed(&search, &[bent]).is_empty());
    }
}
