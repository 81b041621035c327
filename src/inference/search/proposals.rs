//! Models to be fitted beside one: additions, tables, what is left of it, and exchanges.

use super::{Job, Search};
use crate::fit::{Effort, Fit};
use crate::predicted_gain::PredictedGain;

impl Search<'_> {
    /// Additions to be fitted: what explains one DOF's residual is alike, and must not crowd out the others.
    fn proposed<'p>(&self, fit: &Fit, gains: &'p [PredictedGain]) -> Vec<&'p PredictedGain> {
        let most = match fit.terms.is_empty() {
            true => self.options.first_additions,
            false => self.options.additions,
        };

        let dof = |p: &PredictedGain| self.problem.body.candidates[p.candidate].dof();
        let worth = |p: &&PredictedGain| p.instead.is_none() && p.gain > self.options.least_gain;
        let all: Vec<&PredictedGain> = gains.iter().filter(worth).collect();
        let (first, others) = all.split_at(self.options.foremost.min(all.len()));
        let mut chosen = first.to_vec();
        let mut left = Vec::new();
        for p in others {
            if chosen.iter().all(|c| dof(c) != dof(p)) {
                chosen.push(p);
            } else {
                left.push(*p);
            }
        }
        chosen.extend(left);
        chosen.truncate(most);
        chosen
    }

    pub(super) fn expand(&mut self, fit: Fit) {
        let fit = &self.sharpened(fit);
        self.expanded.insert(fit.terms.clone());
        let gains = self.problem.predicted_gains(fit);
        let mut jobs: Vec<Job> = Vec::new();
        let mut add = |job: Job| {
            if !self.models.contains_key(&job.0) {
                jobs.push(job);
            }
        };
        for p in self.proposed(fit, &gains) {
            let (terms, point) = self.problem.with(fit, p.candidate, &p.numbers);
            add((terms, point, fit.cells.clone()));
        }
        let tables = self
            .problem
            .tables(fit, &self.followed_by_laws())
            .into_iter();
        for p in tables
            .filter(|p| p.gain > self.options.least_gain)
            .take(self.options.tables)
        {
            let nothing = vec![0.0; self.problem.body.candidates[p.candidate].scales.len()];
            let (terms, point) = self.problem.with(fit, p.candidate, &nothing);
            add((terms, point, p.cells));
        }
        for member in 0..fit.terms.len() {
            let (terms, point) = self.problem.without(fit, member);
            add((terms.clone(), point.clone(), fit.cells.clone()));
            let instead: Vec<&PredictedGain> =
                gains.iter().filter(|p| p.instead == Some(member)).collect();
            for p in instead
                .into_iter()
                .filter(|p| p.gain > self.options.least_gain)
                .take(self.options.exchanges)
            {
                let smaller = Fit {
                    terms: terms.clone(),
                    point: point.clone(),
                    ..fit.clone()
                };
                let (terms, point) = self.problem.with(&smaller, p.candidate, &p.numbers);
                add((terms, point, fit.cells.clone()));
            }
            // A force along a covariate may be a known law that is only nearly the library's: both at once, for the law
            // alone may be worse by far than the force.
            let mut laws = self.problem.nearly(fit.terms[member]);
            laws.retain(|(effect, _)| !fit.terms.contains(effect));
            let place = |effect: &usize| {
                let mut of = gains.iter().filter(|p| p.instead == Some(member));
                of.position(|p| p.candidate == *effect)
            };
            laws.sort_by_key(|(effect, _)| place(effect).unwrap_or(usize::MAX));
            for (effect, trend) in laws.into_iter().take(self.options.laws) {
                let predicted = gains
                    .iter()
                    .find(|p| p.instead == Some(member) && p.candidate == effect);
                let start = self.problem.body.candidates[effect].starts.first();
                let Some(numbers) = predicted.map(|p| &p.numbers).or(start) else {
                    continue;
                };
                let mut made = Fit {
                    terms: terms.clone(),
                    point: point.clone(),
                    ..fit.clone()
                };
                let nothing = vec![0.0; self.problem.body.candidates[trend].scales.len()];
                for (candidate, numbers) in [(effect, numbers), (trend, &nothing)] {
                    (made.terms, made.point) = self.problem.with(&made, candidate, numbers);
                }
                add((made.terms, made.point, fit.cells.clone()));
            }
        }
        self.fit_in_time(jobs, Effort::default());
    }
}
