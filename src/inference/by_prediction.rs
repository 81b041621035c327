//! Decision by the simulation error, where the likeliest model leaves a random force that matters, or follows what is left by
//! a table: the force says how accelerations scatter, and nothing of the motion.
//!
//! From the vehicle alone to what explains most of the simulation error, as a person looks first: no random force, noise of
//! the size of the misfit, which comes down as laws join; laws and pairs of laws, each of which has to predict the runs left
//! out. Where these laws predict better than the likeliest model does, they and their rivals are scored by the simulation
//! error alone, with as many samples as are independent (a coarsened posterior, Miller and Dunson 2019, JASA 114).

mod turns;

use std::collections::BTreeMap;

use hydroline_core::run::PerChannel;
use hydroline_numerics::{cancel, parallel};

use super::coarse::stretches_of_each;
use super::fit::{Fit, Problem};
use super::limit::Watch;
use super::posterior::{Posterior, UNNAMED, above_tolerance};
use super::search::Found;
use super::summary::Rms;
use super::term::Kind;
use turns::{Unseen, beside_each, pooled};

/// Work that a limit leaves open.
const BY_SQUARES: &str = "laws that explain most of the simulation error";

/// Whether the likeliest model may follow anything: a random force that matters, or a table.
fn swallows(problem: &Problem, best: &Fit) -> bool {
    let all = &problem.body.candidates;
    let mut dofs = problem.body.dofs.iter();
    dofs.any(|d| above_tolerance(best, *d) >= UNNAMED)
        || best.terms.iter().any(|t| all[*t].is_table())
}

/// Models by the simulation error in place of those found, where they predict better; `held` = runs held out. Whether they do.
pub fn decide_by_prediction(found: &mut Found, held: Option<&Problem>, watch: Watch<'_>) -> bool {
    let posterior = Posterior::new(found);
    let likeliest = posterior.models.first();
    let best = likeliest.and_then(|m| found.models.get(&m.0));
    let (Some(best), Some(alone)) = (best, found.models.get(&Vec::new())) else {
        return false;
    };
    let problem = &found.problem;
    if !swallows(problem, best) {
        return false;
    }
    if found.account.leaves_open(watch.limit, BY_SQUARES) {
        return false;
    }
    let Some((laws, mut all)) = problem.explained_most(alone, watch) else {
        return false;
    };
    found.account.leaves_open(watch.limit, BY_SQUARES);
    if laws.fit.terms.is_empty() {
        return false;
    }
    let rival = problem.least_squares(&best.terms, &best.point, &best.cells.tables);
    let beside = rival.as_ref().and_then(|r| problem.beside_tables(&laws, r));
    let chosen = problem.chosen(laws.clone(), beside, rival.as_ref(), held);
    let Some(decided_by) = chosen else {
        return false;
    };
    all.extend([laws.fit, decided_by.fit.clone()]);
    let Some((coarse, models)) = problem.coarsened(&decided_by, all, rival) else {
        return false;
    };
    found.fits += models.len();
    found.problem = coarse;
    found.models = models;
    true
}

impl Problem {
    /// What a model leaves of runs held out.
    fn left_of_held(&self, held: &Problem, fit: &Fit) -> Option<Vec<Rms>> {
        let coarse = held.coarse(&self.left(&fit.terms, &fit.point));
        let point = coarse.with_starts(&fit.terms, &fit.point)?;
        let predicted = held.predicted(&fit.terms, &point);
        Some(held.left_by_stretch(&predicted, stretches_of_each(predicted.len())))
    }

    /// Of laws, the same with tables beside them, and a rival, the one that predicts the runs that were not seen: those left out,
    /// and those held out where there are any; `None` = the rival. A table has to be better than laws by one standard
    /// error, for it has its place only where no laws predict as well; laws have to be better by that than a random force.
    fn chosen(
        &self,
        laws: Unseen,
        beside: Option<Unseen>,
        rival: Option<&Fit>,
        held: Option<&Problem>,
    ) -> Option<Unseen> {
        // Runs held out are often fewer than those left out, and like one of these: all count.
        let with_held = |mut errors: Vec<f64>, fit: &Fit| {
            if let Some(held) = held {
                errors.extend(self.scores(&self.left_of_held(held, fit)?));
            }
            Some(errors)
        };
        let of_laws = with_held(laws.errors.clone(), &laws.fit);
        let with_tables = beside
            .as_ref()
            .and_then(|of| with_held(of.errors.clone(), &of.fit));
        let is_better = |a: &[f64], b: &[f64]| {
            let (mean, se) = beside_each(a, b);
            mean + se < 0.0
        };
        let best = match (&of_laws, with_tables) {
            (Some(plain), Some(with)) if !is_better(&with, plain) => (laws, of_laws),
            (_, Some(with)) => (beside?, Some(with)),
            _ => (laws, of_laws),
        };
        let of_rival =
            rival.and_then(|rival| with_held(self.scores(&self.left_by_others(rival)?), rival));
        // A rival of which there is no finite motion predicts nothing.
        let (Some(rival), Some(of_rival)) = (rival, of_rival) else {
            return Some(best.0);
        };
        let of_best = best.1?;
        let (mean, se) = beside_each(&of_best, &of_rival);
        tracing::debug!(
            "{:?} against {:?} on runs not seen: {mean:.3} ({se:.3}) of {:.3}",
            self.names(&best.0.fit),
            self.names(rival),
            of_rival.iter().sum::<f64>() / of_rival.len().max(1) as f64
        );
        let is_table = |t: &usize| self.body.candidates[*t].is_table();
        let is_as_good = match rival.terms.iter().any(is_table) {
            true => mean <= se,
            false => mean + se < 0.0,
        };
        is_as_good.then_some(best.0)
    }

    /// Laws with the tables of a rival beside them, for what they leave; `None` = it has none.
    fn beside_tables(&self, laws: &Unseen, rival: &Fit) -> Option<Unseen> {
        let mut both = laws.fit.clone();
        for table in rival.terms.iter().copied() {
            let of = &self.body.candidates[table];
            let is_there = match of.kind {
                Kind::Trend { of } => both.terms.contains(&of),
                _ => true,
            };
            if of.is_table() && is_there {
                let nothing = vec![0.0; of.scales.len()];
                (both.terms, both.point) = self.with(&both, table, &nothing);
            }
        }
        if both.terms.len() == laws.fit.terms.len() {
            return None;
        }
        let fit = self.least_squares(&both.terms, &both.point, &rival.cells.tables)?;
        let made = self.unseen_by_squares(&self.coarse_of(fit))?;
        tracing::debug!(
            "{:.3} {:?} {:?} leaves {:?} of runs not seen",
            made.mean(),
            self.names(&made.fit),
            made.fit.cells.tables,
            pooled(&made.left).by_name()
        );
        Some(made)
    }

    /// Models scored by the simulation error under noise as large as what the laws leave of the runs that others predict,
    /// counted as often as that is independent.
    fn coarsened(
        &self,
        laws: &Unseen,
        mut asked: Vec<Fit>,
        rival: Option<Fit>,
    ) -> Option<(Problem, BTreeMap<Vec<usize>, Fit>)> {
        let (count, samples) = (
            self.independent_samples(&laws.fit.terms, &laws.fit.point),
            self.samples(),
        );
        let left = pooled(&laws.left);
        let mut coarse = self.clone();
        coarse.noises.has_force = false;
        coarse.noises.floor_sd = PerChannel::from_fn(|c| {
            let sd = left[c] * (samples[c] / count[c]).sqrt();
            if sd.is_finite() { sd } else { 0.0 }
        });
        asked.extend(rival);
        for member in 0..laws.fit.terms.len() {
            let (terms, point) = self.without(&laws.fit, member);
            asked.push(Fit {
                terms,
                point,
                ..laws.fit.clone()
            });
        }
        let made = parallel::map_owned(asked, |fit| {
            cancel::check();
            coarse.scored_by_squares(&fit)
        });
        let mut models: BTreeMap<Vec<usize>, Fit> = BTreeMap::new();
        for fit in made.into_iter().flatten() {
            tracing::debug!("{:.1} by squares {:?}", fit.ln_score, self.names(&fit));
            let known = models.get(&fit.terms);
            if known.is_none_or(|old| old.ln_score < fit.ln_score) {
                models.insert(fit.terms.clone(), fit);
            }
        }
        let is_whole = models.contains_key(&Vec::new()) && models.contains_key(&laws.fit.terms);
        is_whole.then_some((coarse, models))
    }
}

#[cfg(test)]
mod tests;
