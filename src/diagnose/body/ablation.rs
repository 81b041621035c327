//! Gain of each effect: the likeliest model built up again, one effect after the other.

use hydroline_inference::fit::{Effort, Fit};
use hydroline_inference::summary::Rms;
use hydroline_inference::term::Kind;

use super::found::{Judged, relative};
use crate::verdict::AblationStep;

impl Judged<'_> {
    /// Whether there is anything to build up: two effects that matter, or more.
    pub fn is_built_up(&self) -> bool {
        self.heavy(self.best).len() > 1 && self.predicted_already().is_some()
    }

    /// The vehicle alone, then with each effect that matters, each time the one that predicts best; all numbers fitted
    /// together. Empty where fewer than two matter.
    pub fn ablation(&self) -> Vec<AblationStep> {
        let heavy: Vec<usize> = self.heavy(self.best).into_iter().collect();
        if heavy.len() < 2 {
            return Vec::new();
        }
        let Some((alone, _)) = self.predicted_already() else {
            return Vec::new();
        };
        let mut made = vec![self.step(String::new(), &self.alone, &alone)];
        let mut last = self.alone.clone();
        let mut open = heavy;
        while !open.is_empty() {
            let tried = open.iter().enumerate().filter_map(|(place, added)| {
                let mut with: Vec<usize> = last.terms.clone();
                with.extend(self.with_its_own(*added));
                let fit = self.part(&with)?;
                let held = self.predicted_by(&fit)?;
                Some((place, fit, held))
            });
            let better = tried.min_by(|a, b| self.size(&a.2).total_cmp(&self.size(&b.2)));
            let Some((place, fit, held)) = better else {
                return Vec::new();
            };
            made.push(self.step(self.id(open.remove(place)), &fit, &held));
            last = fit;
        }
        made
    }

    fn step(&self, effect: String, fit: &Fit, held: &Rms) -> AblationStep {
        AblationStep {
            effect,
            train: self.found.problem.left(&fit.terms, &fit.point).by_name(),
            predicted: held.by_name(),
        }
    }

    /// Errors of the vehicle alone and of the likeliest model on the runs held out or, without any, on each run by the others.
    fn predicted_already(&self) -> Option<(Rms, Rms)> {
        let held = self.held.as_ref().map(|(_, predicted)| predicted);
        Some(held.or(self.one_run_out.as_ref())?.rms)
    }

    /// A member of the likeliest model with what varies with it; a force stands for every table and
    /// form of its DOF.
    fn with_its_own(&self, term: usize) -> Vec<usize> {
        let all = &self.found.problem.body.candidates;
        let of = |t: &&usize| {
            let unnamed = all[term].unnamed_in();
            **t == term
                || all[**t].kind == Kind::Trend { of: term }
                || unnamed.is_some() && all[**t].unnamed_in() == unnamed
        };
        self.best.terms.iter().filter(of).copied().collect()
    }

    /// The likeliest model with only these of its members, fitted.
    pub fn part(&self, keep: &[usize]) -> Option<Fit> {
        let problem = &self.found.problem;
        let mut made = self.best.clone();
        for member in (0..self.best.terms.len()).rev() {
            // A trend goes with its effect.
            let there = made.terms.get(member).copied();
            if there.is_some_and(|t| !keep.contains(&t)) {
                (made.terms, made.point) = problem.without(&made, member);
            }
        }
        if let Some(known) = self.found.models.get(&made.terms) {
            return Some(known.clone());
        }
        problem.fit(&made.terms, &made.point, made.cells, Effort::default())
    }

    /// rms of the runs held out under a model, or of each run by the others.
    fn predicted_by(&self, fit: &Fit) -> Option<Rms> {
        if fit.terms == self.best.terms {
            return Some(self.predicted_already()?.1);
        }
        match &self.held {
            Some((over, _)) => Some(over.left_of(&over.predict(fit)?.values)),
            None => {
                let problem = &self.found.problem;
                Some(problem.left_of(&problem.one_run_out(fit)?.values))
            }
        }
    }

    fn size(&self, rms: &Rms) -> f64 {
        relative(rms, &self.found.problem.body.tolerance)
    }
}
