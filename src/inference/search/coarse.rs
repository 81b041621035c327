//! From the vehicle alone to what explains most of the simulation error, as a person looks first: no random force, noise of
//! the size of the misfit, which comes down as laws join, and each law has to predict the runs left out.
//!
//! These models propose; the search fits each of them under the instruments' noise and a random force. Where a random force
//! that matters is left in the end and they predict the runs left out better, they decide: the force then says how
//! accelerations scatter, and nothing of the motion.

use std::collections::BTreeMap;

use hydroline_core::run::{Channel, PerChannel};
use hydroline_numerics::{cancel, parallel};

use super::{AS_GIVEN, BEGIN, Job, Search};
use crate::body::Point;
use crate::fit::{Fit, Problem};
use crate::hyper::{Cell, Cells, Tables};
use crate::posterior::{UNNAMED, above_tolerance};
use crate::predicted_gain::pair::PredictedPair;
use crate::summary::Rms;

/// Laws, or pairs of laws, that join one after the other at most.
const JOINS: usize = 5;
/// Laws fitted beside each model.
const SINGLES: usize = 4;
/// Pairs of laws fitted beside each model.
const PAIRS: usize = 3;
/// Decrease of a misfit's logarithm that each law must bring.
const WORTH: f64 = 0.05;
/// Models of each size that the search decides on, and that the runs left out choose from.
const KEPT: usize = 2;
/// Logarithm of the share of a rival's misfit that is left where a model explains most of it: half.
const MOST: f64 = -std::f64::consts::LN_2;
/// Misfit over the instruments' noise up to which nothing is left to explain.
const AT_NOISE: f64 = 1.15;

/// A model by least squares, with what it leaves of each run that the others predict.
#[derive(Debug, Clone)]
pub(super) struct Coarse {
    pub fit: Fit,
    /// rms by run.
    left: Vec<Rms>,
}

/// Mean over runs and channels of a misfit's logarithm over that of another.
fn beside(left: &[Rms], other: &[Rms]) -> f64 {
    let each = left.iter().zip(other);
    let each = each.flat_map(|(a, b)| a.iter().zip(b).map(|(a, b)| (a / b).ln()));
    let each: Vec<f64> = each.filter(|v| v.is_finite()).collect();
    each.iter().sum::<f64>() / each.len().max(1) as f64
}

/// rms over runs per channel.
fn pooled(left: &[Rms]) -> Rms {
    PerChannel::from_fn(|c| {
        let each: Vec<f64> = left
            .iter()
            .map(|l| l[c])
            .filter(|v| v.is_finite())
            .collect();
        let sum: f64 = each.iter().map(|v| v * v).sum();
        (sum / each.len() as f64).sqrt()
    })
}

/// Least-squares fits from these points, of the runs that they are fitted to.
fn by_squares(problem: &Problem, jobs: Vec<(Vec<usize>, Point)>) -> Vec<Coarse> {
    let made = parallel::map_owned(jobs, |(terms, from)| {
        cancel::check();
        let fit = problem.least_squares(&terms, &from, &Tables::new())?;
        let left = problem.left_by_run(&problem.predicted(&fit.terms, &fit.point));
        Some(Coarse { fit, left })
    });
    made.into_iter().flatten().collect()
}

/// Laws and pairs of laws worth a fit beside a model.
fn proposed(problem: &Problem, fit: &Fit, least_gain: f64) -> Vec<(Vec<usize>, Point)> {
    let coarse = problem.coarse(&problem.left(&fit.terms, &fit.point));
    let gains = coarse.predicted_gains(fit);
    let alone = || gains.iter().filter(|p| p.instead.is_none());
    let mut jobs: Vec<(Vec<usize>, Point)> = alone()
        .filter(|p| p.gain > least_gain)
        .take(SINGLES)
        .map(|p| problem.with(fit, p.candidate, &p.numbers))
        .collect();
    let pairs = coarse.predicted_pairs(fit);
    let holds_best = |p: &&PredictedPair| {
        alone()
            .next()
            .is_some_and(|b| p.members.iter().any(|m| m.0 == b.candidate))
    };
    // Those with the best law come in the next turn anyway: the other pairs do without it.
    let worth = |p: &&PredictedPair| p.gain > p.better_alone + least_gain;
    let (with, without): (Vec<_>, Vec<_>) = pairs.iter().filter(worth).partition(holds_best);
    let chosen = with.into_iter().take(1);
    for p in chosen.chain(without.into_iter().take(PAIRS - 1)) {
        let [first, second] = &p.members;
        let (terms, point) = problem.with(fit, first.0, &first.1);
        let one = Fit {
            terms,
            point,
            ..fit.clone()
        };
        jobs.push(problem.with(&one, second.0, &second.1));
    }
    jobs
}

impl Search<'_> {
    fn is_explained(&self, left: &Rms) -> bool {
        Channel::ALL.into_iter().all(|c| {
            let noise = self.problem.noises.channels[c].map(|n| n.total_sd());
            noise.is_none_or(|sd| left[c].is_nan() || left[c] < AT_NOISE * sd)
        })
    }

    /// The same model with what it leaves where the other runs predict each.
    fn by_others(&self, of: &Coarse) -> Option<Coarse> {
        Some(Coarse {
            left: self.problem.left_by_others(&of.fit)?,
            fit: of.fit.clone(),
        })
    }

    /// Adds the models that explain most of the simulation error to those visited.
    pub(super) fn explain_most(&mut self) {
        let mut from = vec![self.problem.body.begin()];
        from.extend(self.models.get(&Vec::new()).map(|f| f.point.clone()));
        let alone = by_squares(
            &self.problem,
            from.into_iter().map(|point| (Vec::new(), point)).collect(),
        );
        self.fits += alone.len();
        let least = alone
            .into_iter()
            .min_by(|a, b| beside(&a.left, &b.left).total_cmp(&0.0));
        let Some(mut at) = least else { return };
        self.squares.push(at.fit.clone());
        let mut predicted = self.by_others(&at);
        let mut kept = Vec::new();
        for _ in 0..JOINS {
            if self.is_explained(&pooled(&at.left)) {
                break;
            }
            let step = format!("simulation error beside {}", self.label(&at.fit));
            if self.leaves_open(&step) {
                break;
            }
            self.watch.tell(&step);
            self.account.steps += 1;
            self.account.did(&step);
            let jobs = proposed(&self.problem, &at.fit, self.options.least_gain);
            self.fits += jobs.len();
            let mut made = by_squares(&self.problem, jobs);
            let worth = |c: &Coarse, than: &Coarse, left: &[Rms]| {
                let laws = c.fit.terms.len() as f64 - than.fit.terms.len() as f64;
                beside(&c.left, left) + WORTH * laws
            };
            made.sort_by(|a, b| worth(a, &at, &at.left).total_cmp(&worth(b, &at, &at.left)));
            for c in &made {
                tracing::debug!(
                    "squares {:.3} {:?}",
                    worth(c, &at, &at.left),
                    self.names(&c.fit)
                );
            }
            self.squares.extend(made.iter().map(|c| c.fit.clone()));
            made.retain(|c| worth(c, &at, &at.left) < 0.0);
            made.truncate(KEPT);
            kept.extend(made.iter().map(|c| c.fit.clone()));
            // Of the best the one that predicts best.
            let by_others = made
                .into_iter()
                .filter_map(|c| Some((self.by_others(&c)?, c)));
            let next = by_others.min_by(|a, b| {
                let [a, b] = [&a.0, &b.0]
                    .map(|c| predicted.as_ref().map_or(0.0, |p| worth(c, &at, &p.left)));
                a.total_cmp(&b)
            });
            let better = next.filter(|(by_others, _)| {
                let than = predicted.as_ref();
                than.is_none_or(|p| worth(by_others, &at, &p.left) < 0.0)
            });
            let Some((by_others, in_sample)) = better else {
                break;
            };
            tracing::debug!("squares take {:?}", self.names(&in_sample.fit));
            predicted = Some(by_others);
            at = in_sample;
        }
        self.predicting = predicted;
        let small = Cell {
            size: BEGIN[0],
            correlation: 1,
        };
        let jobs: Vec<Job> = kept
            .into_iter()
            .map(|f| (f.terms, f.point, Cells::of([small; 6])))
            .collect();
        self.fit_in_time(jobs, AS_GIVEN);
    }

    /// Where the likeliest model leaves a random force that matters, and the model that explains most of the simulation
    /// error predicts the runs left out no worse: that one and its rivals, scored by the simulation error alone with as many
    /// samples as are independent (a coarsened posterior, Miller and Dunson 2019).
    pub(super) fn decide_by_prediction(&mut self) {
        let (Some(best), Some(predicting)) = (self.best().cloned(), self.predicting.clone()) else {
            return;
        };
        let dofs = &self.problem.body.dofs;
        let swallows = dofs.iter().any(|d| above_tolerance(&best, *d) >= UNNAMED);
        if !swallows || predicting.fit.terms.is_empty() {
            return;
        }
        let problem = &self.problem;
        let refitted = problem.least_squares(&best.terms, &best.point, &best.cells.tables);
        let rival = refitted.and_then(|fit| {
            let left = problem.left_by_others(&fit)?;
            Some(Coarse { fit, left })
        });
        if let Some(rival) = &rival {
            let worth = beside(&predicting.left, &rival.left);
            tracing::debug!(
                "by others {:?} {:?}, rival {:?} {:?}: {worth:.3}",
                self.names(&predicting.fit),
                pooled(&predicting.left).by_name(),
                self.names(&rival.fit),
                pooled(&rival.left).by_name()
            );
            let is_table = |t: &usize| self.problem.body.candidates[*t].is_table();
            let asked = match rival.fit.terms.iter().any(is_table) {
                // A table stands only where no laws predict as well.
                true => 0.0,
                false => MOST,
            };
            if worth > asked {
                return;
            }
        }
        let count = problem.independent_samples(&predicting.fit);
        let samples = problem.samples();
        let left = pooled(&predicting.left);
        let mut coarse = problem.clone();
        coarse.noises.has_force = false;
        coarse.noises.floor_sd = PerChannel::from_fn(|c| {
            let sd = left[c] * (samples[c] / count[c]).sqrt();
            if sd.is_finite() { sd } else { 0.0 }
        });
        let mut asked: Vec<Fit> = std::mem::take(&mut self.squares);
        asked.extend(rival.map(|r| r.fit));
        for member in 0..predicting.fit.terms.len() {
            let (terms, point) = problem.without(&predicting.fit, member);
            asked.push(Fit {
                terms,
                point,
                ..predicting.fit.clone()
            });
        }
        self.fits += asked.len();
        let made = parallel::map_owned(asked, |fit| {
            cancel::check();
            coarse.scored_by_squares(&fit)
        });
        let mut models: BTreeMap<Vec<usize>, Fit> = BTreeMap::new();
        for fit in made.into_iter().flatten() {
            tracing::debug!("by squares {:.1} {:?}", fit.ln_score, self.names(&fit));
            let keep = models
                .get(&fit.terms)
                .is_none_or(|old| old.ln_score < fit.ln_score);
            if keep {
                models.insert(fit.terms.clone(), fit);
            }
        }
        if models.contains_key(&Vec::new()) && models.contains_key(&predicting.fit.terms) {
            self.models = models;
            self.problem = coarse;
        }
    }
}
