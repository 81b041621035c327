//! Models that hold an effect of a size that no such vehicle shows: a contradiction, and no explanation.

use std::collections::BTreeMap;

use super::body::Body;
use super::fit::Fit;
use super::posterior::Posterior;
use super::search::Found;
use super::term::{Candidate, Kind};

/// Distance from nothing, over that of the plausible range's far end, beyond which an effect is not offered.
const NOT_OFFERED: f64 = 10.0;
/// Probability of the models that hold it from which an effect that is not offered is reported.
const REPORTED: f64 = 0.05;

/// An effect of an implausible size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Implausible {
    /// Candidate, by index.
    pub candidate: usize,
    /// First number of the effect, in the likeliest of these models \[SI\].
    pub value: f64,
    /// Range in which that is plausible \[SI\].
    pub plausible: (f64, f64),
    /// Probability of these models, had they been offered.
    pub probability: f64,
}

impl Body {
    /// Plausible range of an effect's first number; `None` of a table, of a limit on the load, and where no load of its DOF
    /// is known.
    fn plausible(&self, c: &Candidate) -> Option<(f64, f64)> {
        let (sized, own) = (c.parameters.first()?, c.info.parameters.first()?);
        if c.kind != Kind::Effect || own.bounds_load {
            return None;
        }
        let dof = c.dof().or(self.dofs.first().copied()).unwrap_or(0);
        let (low, high) = self.bearable.plausible(own, dof)?;
        Some((low.min(sized.plausible.0), high.max(sized.plausible.1)))
    }

    /// Effects of a model that are not offered at the size that they have there.
    fn not_offered(&self, fit: &Fit) -> Vec<Implausible> {
        let natural = self.natural(&fit.terms, &fit.point);
        let each = fit.terms.iter().zip(self.places(&fit.terms));
        each.filter_map(|(&candidate, at)| {
            let c = &self.candidates[candidate];
            let plausible = self.plausible(c)?;
            let value = natural.get(at)?.0;
            let from_nothing = |v: f64| (v - c.nothing).abs();
            let far = from_nothing(plausible.0).max(from_nothing(plausible.1));
            (from_nothing(value) > NOT_OFFERED * far).then_some(Implausible {
                candidate,
                value,
                plausible,
                probability: 0.0,
            })
        })
        .collect()
    }
}

impl Found {
    /// Takes the models out that hold an effect of an implausible size, never the vehicle alone, and gives these effects,
    /// likeliest first.
    pub fn take_implausible(&mut self) -> Vec<Implausible> {
        let body = &self.problem.body;
        let each = self
            .models
            .iter()
            .map(|(t, fit)| (t.clone(), body.not_offered(fit)));
        let odd: BTreeMap<Vec<usize>, Vec<Implausible>> =
            each.filter(|o| !o.1.is_empty()).collect();
        if odd.is_empty() {
            return Vec::new();
        }
        let mut made: Vec<Implausible> = Vec::new();
        // Likeliest first: of each effect the first size stays.
        for (terms, probability) in Posterior::new(self).models {
            for one in odd.get(&terms).into_iter().flatten() {
                match made.iter_mut().find(|m| m.candidate == one.candidate) {
                    Some(known) => known.probability += probability,
                    None => made.push(Implausible {
                        probability,
                        ..*one
                    }),
                }
            }
        }
        self.models.retain(|terms, _| !odd.contains_key(terms));
        made.retain(|m| m.probability >= REPORTED);
        made.sort_by(|a, b| b.probability.total_cmp(&a.probability));
        made
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::{Effort, Problem};
    use crate::hyper::{Cell, Cells};
    use crate::limit::Account;
    use crate::prior::PriorTable;
    use crate::tests::fixtures::Tank;

    /// A lag of 13 s was named.
    #[test]
    fn an_effect_of_an_implausible_size_is_taken_out_and_reported() {
        let tank = Tank {
            seconds: 12.0,
            ..Tank::new(&[0], vec![])
        };
        let runs = tank.runs(1, 3);
        let problem = Problem::new(&runs, &tank.rig, &[0], PriorTable::default()).unwrap();
        let cells = Cells::of([Cell::default(); 6]);
        let begin = problem.body.begin();
        let alone = problem.fit(&[], &begin, cells, Effort::DEFAULT).unwrap();
        let all = &problem.body.candidates;
        let lag = all.iter().position(|c| c.name() == "thruster_lag surge");
        let lag = lag.unwrap();
        let model = |lag_s: f64, ln_score: f64| {
            let scaled = problem.body.candidates[lag].scales[0].scaled(lag_s);
            let mut fit = alone.clone();
            fit.point.insert(problem.body.own.len(), scaled);
            fit.terms = vec![lag];
            fit.ln_score = ln_score;
            fit
        };
        let found = |fit: Fit| Found {
            problem: problem.clone(),
            models: BTreeMap::from([(Vec::new(), alone.clone()), (fit.terms.clone(), fit)]),
            fits: 2,
            given_up: Vec::new(),
            account: Account::default(),
        };
        let likely = alone.ln_score + 5.0;
        let mut sound = found(model(2.0, likely));
        assert!(sound.take_implausible().is_empty());
        assert_eq!(sound.models.len(), 2);
        let mut odd = found(model(13.0, likely));
        let taken = odd.take_implausible();
        assert_eq!(taken.len(), 1);
        assert_eq!(taken[0].candidate, lag);
        assert!((taken[0].value - 13.0).abs() < 1e-9);
        assert_eq!(taken[0].plausible, (0.05, 0.5));
        assert!(taken[0].probability > 0.99);
        assert_eq!(odd.models.keys().next(), Some(&Vec::new()));
        assert_eq!(odd.models.len(), 1);
        // Of a model that nobody would have believed nothing is said.
        let mut unlikely = found(model(13.0, alone.ln_score - 9.0));
        assert!(unlikely.take_implausible().is_empty());
        assert_eq!(unlikely.models.len(), 1);
    }
}
