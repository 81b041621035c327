//! Forces that act somewhere and do nothing elsewhere: someone pulls for three seconds, something lies at one place.
//!
//! A Gaussian process expects as much everywhere. What acts for a while then pays for every knot at which nothing is, and
//! what its edges leave is taken up by effects that are not there.

use super::{Acts, Family, FamilyFit};
use crate::descent::Effort;
use crate::fit::Fit;
use crate::setting::Setting;
use crate::weights::Weights;

/// What is expected at a quiet knot, of what is expected at the others.
pub(super) const QUIET: f64 = 0.01;
/// An amplitude is there from this many of its sd on, and from this share of the largest one on.
const THERE: (f64, f64) = (3.0, 0.1);
/// Share of the knots at most within windows: what is more acts everywhere.
const MOST: f64 = 0.5;
/// Times that windows are chosen anew.
const ROUNDS: usize = 3;

impl Family {
    /// How much is expected at a knot, of the prior's sd.
    pub(super) fn expected_at(&self, knot: usize) -> f64 {
        match self.quiet.get(knot) {
            Some(true) => QUIET,
            _ => 1.0,
        }
    }

    /// Log of the choice of its windows: each begins and ends at one of the knots of its run.
    pub(super) fn choice(&self) -> f64 {
        if self.quiet.is_empty() {
            return 0.0;
        }
        let n = self.knots.len();
        let runs = 1 + (0..n).filter(|k| self.between_runs(*k)).count();
        let begins = |k: &usize| {
            let before = k.checked_sub(1);
            !self.quiet[*k] && before.is_none_or(|b| self.quiet[b] || self.between_runs(b))
        };
        let windows = (0..n).filter(begins).count() as f64;
        let each = n as f64 / runs as f64;
        windows * (0.5 * each * (each + 1.0)).ln()
    }
}

impl FamilyFit {
    /// A force with the knots quiet at which it does nothing; `None` where it acts nearly everywhere, or where no others
    /// are quiet than before.
    pub fn windowed(&self) -> Option<FamilyFit> {
        if self.family.acts != Acts::Force {
            return None;
        }
        let (a, n) = (&self.amplitudes, self.family.knots.len());
        let largest = a.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
        let there = |k: usize| a[k].abs() > THERE.0 * self.sds[k] && a[k].abs() > THERE.1 * largest;
        // With a knot on either side, at which it begins and ends.
        let quiet: Vec<bool> = (0..n)
            .map(|k| {
                let before = k > 0 && !self.family.between_runs(k - 1) && there(k - 1);
                let after = k + 1 < n && !self.family.between_runs(k) && there(k + 1);
                !(there(k) || before || after)
            })
            .collect();
        let loud = quiet.iter().filter(|q| !**q).count();
        let new = quiet != self.family.quiet;
        (new && loud > 0 && (loud as f64) < MOST * n as f64).then(|| FamilyFit {
            amplitudes: a
                .iter()
                .zip(&quiet)
                .map(|(a, q)| if *q { 0.0 } else { *a })
                .collect(),
            family: Family {
                quiet,
                ..self.family.clone()
            },
            ..self.clone()
        })
    }

    /// A refined force as one that acts in windows, as long as that is likelier; its knots denser there where that pays.
    pub fn in_windows(
        setting: &Setting,
        weights: &Weights,
        base: &Fit,
        mut found: (Fit, FamilyFit),
    ) -> (Fit, FamilyFit) {
        for _ in 0..ROUNDS {
            let from = Fit {
                at: found.0.at.clone(),
                ..base.clone()
            };
            let next = found
                .1
                .windowed()
                .and_then(|w| w.refine(setting, weights, &from, Effort::FULL))
                .map(|next| FamilyFit::smooth(setting, weights, next, Effort::FULL))
                .map(|next| FamilyFit::sharpen(setting, weights, base, next))
                .filter(|next| next.0.log_evidence > found.0.log_evidence);
            let Some(next) = next else { break };
            tracing::debug!(
                "in windows beside {:?}, by {:?}: {:.1} for {:.1}",
                base.set,
                found.1.family.variable,
                next.0.log_evidence,
                found.0.log_evidence
            );
            found = next;
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bank::View;
    use crate::family::kinds::BETWEEN_S;
    use crate::family::{Variable, forces};
    use crate::search::Search;
    use crate::testing::{hats, pulled, setting};

    /// Two runs of ten knots, laid end to end.
    fn flat() -> FamilyFit {
        let run = |first: f64| (0..10).map(move |k| first + f64::from(k));
        let knots = run(0.0).chain(run(9.0 + BETWEEN_S)).collect();
        hats(Acts::Force, Variable::TimeEach, knots, vec![0.01; 20], 0.02)
    }

    #[test]
    fn windows_reach_to_the_knots_around_what_acts_and_end_with_their_run() {
        let mut pull = flat();
        (pull.amplitudes[4], pull.amplitudes[9], pull.amplitudes[12]) = (1.0, -0.8, 0.9);
        let found = pull.windowed().unwrap();
        let loud: Vec<usize> = (0..20).filter(|k| !found.family.quiet[*k]).collect();
        // The ninth is the last of its run: the tenth is another run's first.
        assert_eq!(loud, [3, 4, 5, 8, 9, 11, 12, 13]);
        assert_eq!(found.amplitudes[4], 1.0);
        assert_eq!(found.amplitudes[0], 0.0);
        // Three windows, each of 55 that ten knots have.
        assert_eq!(pull.family.choice(), 0.0);
        assert!((found.family.choice() - 3.0 * 55f64.ln()).abs() < 1e-12);
        // Nothing new, nothing at all, nearly everywhere, a bend: no windows.
        assert!(found.windowed().is_none());
        assert!(flat().windowed().is_none());
        let mut all = pull.clone();
        all.amplitudes = vec![1.0; 20];
        assert!(all.windowed().is_none());
        pull.family.acts = Acts::Bends(0);
        assert!(pull.windowed().is_none());
    }

    #[test]
    fn a_pull_of_two_seconds_is_likelier_in_a_window() {
        let own = setting(&[
            pulled(0, &[], Some((8.3, 10.1, -0.9))),
            pulled(1, &[], Some((7.4, 9.3, -0.9))),
        ]);
        let mut search = Search::new(&own, &|_| {});
        search.nothing();
        let nothing = search.get(&[]).unwrap().clone();
        let view = View::new(&own, &search.weights, &nothing);
        let plain = forces(&own, &nothing)
            .into_iter()
            .find(|f| f.variable == Variable::TimeEach)
            .and_then(|f| f.fit(&own, &search.weights, &nothing, &view))
            .and_then(|f| f.close(&own, &search.weights, &nothing, Effort::FULL))
            .unwrap();
        let before = plain.0.log_evidence;
        let (joint, found) = FamilyFit::in_windows(&own, &search.weights, &nothing, plain);
        assert!(
            joint.log_evidence > before + 10.0,
            "{before} {}",
            joint.log_evidence
        );
        // Quiet knots do nothing, also as refined; the pull's impulse [N s] is there, in each run.
        let (knots, n) = (&found.family.knots, found.amplitudes.len());
        let impulse = |of: std::ops::Range<usize>| -> f64 {
            let mean = |k: usize| 0.5 * (found.amplitudes[k] + found.amplitudes[k + 1]);
            of.map(|k| (knots[k + 1] - knots[k]) * mean(k)).sum()
        };
        let first = (0..n).find(|k| found.family.between_runs(*k)).unwrap();
        let both = [impulse(0..first), impulse(first + 1..n - 1)];
        assert!((both[0] / (-0.9 * 1.8) - 1.0).abs() < 0.05, "{both:?}");
        assert!((both[1] / (-0.9 * 1.9) - 1.0).abs() < 0.05, "{both:?}");
        let most = |quiet: bool| {
            (0..found.amplitudes.len())
                .filter(|k| found.family.quiet[*k] == quiet)
                .map(|k| found.amplitudes[k].abs())
                .fold(0.0, f64::max)
        };
        assert!(most(true) < 0.05 * most(false));
        assert_eq!(found.family.quiet.len(), found.family.knots.len());
    }
}
