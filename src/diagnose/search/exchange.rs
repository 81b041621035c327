//! The best set's members against all other candidates.

use super::super::bank::{View, joined, without};
use super::super::fit::Fit;
use super::{LEAST_GAIN, OTHER_MINIMUM, Search, WIDTH};
use std::collections::BTreeSet;

/// Candidates tried in the place of a member.
const REPLACED: usize = 3;
/// Promised gain below the best one's at which a candidate is still tried there.
const NEAR_TWIN: f64 = 12.0;

impl Search<'_> {
    /// Every member of the best set against every other candidate, with responses taken beside it.
    pub fn exchange(&mut self) {
        for _ in 0..3 {
            let Some(best) = self.best().cloned() else {
                return;
            };
            self.refresh(&best.set);
            self.reduce_below(std::slice::from_ref(&best.set), f64::INFINITY);
            let smaller: Vec<Vec<usize>> = (0..best.set.len())
                .map(|m| without(self.setting, &best, m).0)
                .collect();
            self.extend(&smaller, 4, LEAST_GAIN);
            self.extend(std::slice::from_ref(&best.set), WIDTH, LEAST_GAIN);
            self.replace(&best);
            self.rejoin(&best);
            self.elsewhere(&best);
            (self.progress)("exchange");
            let same = |b: &Fit| b.set == best.set && b.cost > best.cost - OTHER_MINIMUM;
            if self.best().is_some_and(same) {
                break;
            }
        }
    }

    /// What could stand in the place of each member, all else as it is: near twins are found so even
    /// where the set without the member, fitted, has drifted away.
    fn replace(&mut self, best: &Fit) {
        let mut jobs = Vec::new();
        let mut ways = BTreeSet::new();
        for member in 0..best.set.len() {
            let (set, at) = without(self.setting, best, member);
            let gap = Fit {
                set,
                at,
                ..best.clone()
            };
            let view = View::new(self.setting, &self.weights, &gap);
            let found = view.promises(&self.bank, &self.whitened, &gap.set);
            let own = best.set[member];
            let top = found.first().map_or(0.0, |l| l[0].gain);
            for list in found
                .iter()
                .filter(|l| l[0].candidate != own && !self.blind.contains(&l[0].candidate))
                .take_while(|l| l[0].gain > top - NEAR_TWIN - 0.02 * top)
                .take(REPLACED)
            {
                let point = self.begin(&gap, &list[0]);
                let job = joined(self.setting, &gap, list[0].candidate, &point);
                let change = top - list[0].gain;
                let way = Search::way(&job.0, best, list[0].start, change);
                if self.lacks(&way, best, Some(change)) {
                    ways.insert(way);
                    jobs.push(job);
                }
            }
        }
        self.ways.append(&mut ways);
        self.fit(jobs);
    }

    /// A member with several parameters may have come to do the work of two: each is taken out, a
    /// partner put in, and it joins again from wherever it then promises most.
    fn rejoin(&mut self, best: &Fit) {
        let mut jobs = Vec::new();
        for (member, candidate) in best.set.iter().enumerate() {
            if self.setting.vocabulary[*candidate].info.parameters.len() < 2 {
                continue;
            }
            let (smaller, _) = without(self.setting, best, member);
            let partners: Vec<Fit> = self
                .fits
                .values()
                .filter(|f| {
                    f.set.len() == best.set.len()
                        && !f.set.contains(candidate)
                        && smaller.iter().all(|c| f.set.contains(c))
                })
                .cloned()
                .collect();
            for fit in partners {
                let view = View::new(self.setting, &self.weights, &fit);
                let found = view.promises(&self.bank, &self.whitened, &fit.set);
                for p in found
                    .iter()
                    .flatten()
                    .filter(|p| p.candidate == *candidate)
                    .take(2)
                {
                    let point = self.begin(&fit, p);
                    jobs.push(joined(self.setting, &fit, p.candidate, &point));
                }
            }
        }
        self.fit(jobs);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{candidate, searched, setting, surge};

    /// One at a time a search ends where no single step gains: the wrong one of two must be exchanged.
    #[test]
    fn a_wrong_member_is_exchanged_for_the_right_one() {
        let effects: [(&str, &[(&str, f64)]); 2] = [
            ("coulomb_friction", &[("f_n", 0.4)]),
            ("thruster_saturation", &[("limit_n", 5.0)]),
        ];
        let own = setting(&[surge(0, &effects), surge(1, &effects), surge(2, &effects)]);
        let [friction, limit, wrong] =
            ["coulomb_friction", "thruster_saturation", "battery_sag"].map(|e| candidate(&own, e));
        let mut search = searched(&own);
        let single = search.finished(&[friction]).unwrap();
        let sag = search.finished(&[wrong]).unwrap().member(&own, 0).to_vec();
        search.fit(vec![joined(&own, &single, wrong, &sag)]);
        let mut pair = [friction, wrong];
        pair.sort_unstable();
        let before = search.get(&pair).unwrap().log_evidence;
        search.exchange();
        let best = search.best().unwrap();
        let mut right = [friction, limit];
        right.sort_unstable();
        assert!(right.iter().all(|c| best.set.contains(c)), "{:?}", best.set);
        assert!(best.log_evidence > before + 10.0);
        let member = best.set.iter().position(|c| *c == limit).unwrap();
        assert!((best.member(&own, member)[0] - 5.0).abs() < 0.3);
    }
}
