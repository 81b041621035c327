//! A period or a place has minima of its own: those of a set's members are looked for once more, all else as it is.

use super::Search;
use crate::bank::{Promise, View, begin, joined, motion, responses_of, whitened, without};
use crate::candidate::{Candidate, share};
use crate::fit::{Fit, is_phase};

/// Other starts fitted per member.
const TRIED: usize = 3;
/// Of a parameter's plausible range: what another start differs by in one of those that are no size.
const APART: f64 = 0.1;

/// Whether two starts differ in a period or a place; a phase follows by itself.
fn apart(c: &Candidate, a: &[f64], b: &[f64]) -> bool {
    let numbers = c.info.parameters.iter().zip(a.iter().zip(b));
    numbers
        .skip(1)
        .filter(|(p, _)| !is_phase(p))
        .any(|(p, (a, b))| (share(p, *a) - share(p, *b)).abs() > APART)
}

impl Search<'_> {
    /// Fits a set again from other periods and places of each member, those that promise most; the lowest stays.
    pub(super) fn elsewhere(&mut self, best: &Fit) {
        let setting = self.setting;
        let mut jobs = Vec::new();
        for (member, candidate) in best.set.iter().enumerate() {
            let c = &setting.vocabulary[*candidate];
            if c.info.parameters.len() < 2 {
                continue;
            }
            let mut known: Vec<Vec<f64>> = vec![best.member(setting, member).to_vec()];
            let (set, at) = without(setting, best, member);
            let gap = Fit {
                set,
                at,
                ..best.clone()
            };
            let there = responses_of(setting, &gap, *candidate);
            let white: Vec<_> = there
                .iter()
                .map(|r| whitened(setting, &self.weights, &r.column))
                .collect();
            let view = View::new(setting, &self.weights, &gap);
            let found: Vec<Promise> = view
                .promises(&there, &white, &gap.set)
                .into_iter()
                .flatten()
                .collect();
            for p in found {
                let start = &c.starts[p.start];
                if known.len() > TRIED || !known.iter().all(|k| apart(c, start, k)) {
                    continue;
                }
                known.push(start.clone());
                let point = begin(setting, &gap, &there, &p, &|set, globals, starts| {
                    motion(setting, set, globals, starts)
                });
                jobs.push(joined(setting, &gap, *candidate, &point));
            }
        }
        self.fit(jobs);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::Posed;
    use crate::search::Search;
    use crate::testing::{candidate, setting, surge};

    /// A seiche that came to the wrong period stays there until it is looked for elsewhere.
    #[test]
    fn a_period_that_is_a_minimum_of_its_own_is_left() {
        let sway: &[(&str, f64)] = &[("amp_mps", 0.004), ("period_s", 4.0), ("phase_rad", 0.5)];
        let runs = [surge(0, &[("seiche", sway)]), surge(1, &[("seiche", sway)])];
        let setting = setting(&runs);
        let mut search = Search::new(&setting, &|_| {});
        search.nothing();
        let seiche = candidate(&setting, "seiche");
        let nothing = search.get(&[]).unwrap().clone();
        let period = |fit: &Fit| fit.member(&setting, 0)[1];
        let set = vec![seiche];
        let from = |period_s: f64| {
            let at = joined(&setting, &nothing, seiche, &[0.002, period_s, 0.0]).1;
            Posed::new(&setting, &search.weights, &set).fit(at).unwrap()
        };
        let others = [2.2, 2.7, 6.5, 9.0, 13.0, 18.0].map(from);
        let stuck = others
            .into_iter()
            .max_by(|a, b| a.cost.total_cmp(&b.cost))
            .unwrap();
        search.fits.insert(set.clone(), stuck.clone());
        search.elsewhere(&stuck);
        let found = search.finished(&set).unwrap();
        assert!(found.cost < 0.2 * stuck.cost);
        assert!(
            (period(&found) / 4.0 - 1.0).abs() < 0.01,
            "{}",
            period(&found)
        );
    }
}
