//! Decision by the simulation error, where the likeliest model leaves a random force that matters, or follows what is left by
//! a table: the force says how accelerations scatter, and nothing of the motion.
//!
//! From the vehicle alone to what explains most of the simulation error, as a person looks first: no random force, noise of
//! the size of the misfit, which comes down as laws join; laws and pairs of laws, each of which has to predict the runs left
//! out. Where these laws predict better than the likeliest model does, they and their rivals are scored by the simulation
//! error alone, with as many samples as are independent (a coarsened posterior, Miller and Dunson 2019, JASA 114).

use std::collections::{BTreeMap, BTreeSet};

use hydroline_core::run::{Channel, PerChannel};
use hydroline_numerics::{cancel, parallel};

use super::body::Point;
use super::coarse::{ROUNDS, stretches_of_each};
use super::fit::{Fit, Problem};
use super::hyper::Tables;
use super::limit::Watch;
use super::posterior::{Posterior, UNNAMED, above_tolerance};
use super::predicted_gain::PredictedGain;
use super::predicted_gain::pair::PredictedPair;
use super::search::Found;
use super::summary::Rms;
use super::term::Kind;

/// Laws, or pairs of laws, that join one after the other at most.
const JOINS: usize = 5;
/// Laws fitted beside each model.
const SINGLES: usize = 4;
/// Pairs of laws fitted beside each model.
const PAIRS: usize = 3;
/// Laws fitted in each member's place.
const EXCHANGES: usize = 1;
/// Gain in log likelihood below which a predicted gain is not worth a fit.
const SMALLEST_GAIN: f64 = 3.0;
/// Shares of the predicted numbers from which two laws are fitted: far from everything the linear view overshoots.
const SHARES: [f64; 2] = [1.0, 0.4];
/// Models of each turn that the runs left out choose from, and that the next one begins beside.
const FRONT: usize = 3;
/// Rounds after which models of a turn are compared for the first time: in the first the noise is what their start leaves.
const RACE_ROUNDS: usize = 2;
/// Models of each turn that are fitted to the end then: on a ship of two runs a fifth of the time is spared.
const RACE: usize = 2 * FRONT;
/// Misfit over the instruments' noise up to which nothing is left to explain.
const AT_NOISE: f64 = 1.15;

/// A model by least squares, with what it leaves of the runs that it is fitted to.
#[derive(Debug, Clone)]
struct Coarse {
    fit: Fit,
    left: Rms,
    /// Points at which the fits from all starts ended: the best one now is not always the best in the end.
    ends: Vec<Point>,
}

/// rms over runs per channel.
fn pooled(left: &[Rms]) -> Rms {
    PerChannel::from_fn(|c| {
        let each = left.iter().map(|l| l[c]).filter(|v| v.is_finite());
        let squares: Vec<f64> = each.map(|v| v * v).collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    })
}

impl Coarse {
    /// Half of the Bayesian information criterion (Schwarz 1978) beside another model's, by the simulation error; below 0 =
    /// better. `count` = independent samples.
    fn criterion(&self, than: &Coarse, count: &Rms) -> f64 {
        let each = Channel::ALL
            .into_iter()
            .map(|c| (count[c], (self.left[c] / than.left[c]).ln()));
        let finite = each.filter(|(n, ratio)| n.is_finite() && ratio.is_finite());
        let (gain, samples) =
            finite.fold((0.0, 0.0), |sum, (n, ratio)| (sum.0 + n * ratio, sum.1 + n));
        let numbers = self.fit.point.len() as f64 - than.fit.point.len() as f64;
        gain + 0.5 * numbers * f64::max(samples, 1.0).ln()
    }
}

/// A model with its errors in runs that it has not seen.
#[derive(Debug, Clone)]
struct Unseen {
    fit: Fit,
    /// rms of each stretch.
    left: Vec<Rms>,
    /// Score of each stretch: mean over channels of the logarithm of the error over what matters.
    errors: Vec<f64>,
    /// The same of all runs that it is fitted to.
    fitted: f64,
}

impl Unseen {
    fn mean(&self) -> f64 {
        self.errors.iter().sum::<f64>() / self.errors.len().max(1) as f64
    }
}

/// Mean difference of scores in the same stretches, and its standard error.
fn beside_each(scores: &[f64], others: &[f64]) -> (f64, f64) {
    let each = scores.iter().zip(others).map(|(a, b)| a - b);
    let each: Vec<f64> = each.filter(|v| v.is_finite()).collect();
    let count = each.len().max(1) as f64;
    let mean = each.iter().sum::<f64>() / count;
    let squares: f64 = each.iter().map(|v| (v - mean).powi(2)).sum();
    (mean, (squares / (count - 1.0).max(1.0) / count).sqrt())
}

/// Of some models the one with fewest laws that predicts within one standard error of the best (Breiman et al. 1984, section
/// 3.4.3; here of paired differences); of these the one that explains most.
fn fewest(all: &[Unseen]) -> Option<&Unseen> {
    let best = all.iter().min_by(|a, b| a.mean().total_cmp(&b.mean()))?;
    let as_good = all.iter().filter(|m| {
        let (mean, se) = beside_each(&m.errors, &best.errors);
        mean <= se
    });
    as_good.min_by(|a, b| {
        let laws = a.fit.terms.len().cmp(&b.fit.terms.len());
        laws.then(a.fitted.total_cmp(&b.fitted))
    })
}

/// Work that a limit leaves open.
const BY_SQUARES: &str = "laws that explain most of the simulation error";

/// Points from which a model is fitted; the best of them counts.
type Job = (Vec<usize>, Vec<Point>);

impl Problem {
    /// Least-squares fits of so many rounds with what they leave of the runs that they are fitted to.
    fn coarse_fits(&self, jobs: Vec<Job>, rounds: usize) -> Vec<Coarse> {
        let count = self.samples();
        let made = parallel::map_owned(jobs, |(terms, from)| {
            let each = from.iter().filter_map(|from| {
                cancel::check();
                let fit = self.least_squares_within(rounds, &terms, from, &Tables::new())?;
                let left = self.left(&fit.terms, &fit.point);
                let ends = Vec::new();
                Some(Coarse { fit, left, ends })
            });
            let each: Vec<Coarse> = each.collect();
            let first = each.first()?.clone();
            let size = |c: &Coarse| c.criterion(&first, &count);
            let ends = each.iter().map(|c| c.fit.point.clone()).collect();
            let best = each
                .into_iter()
                .min_by(|a, b| size(a).total_cmp(&size(b)))?;
            Some(Coarse { ends, ..best })
        });
        made.into_iter().flatten().collect()
    }

    /// A model with its errors in runs that it has not seen: each run as the others predict it.
    fn unseen_by_squares(&self, of: &Coarse) -> Option<Unseen> {
        let left = self.left_by_others(&of.fit)?;
        Some(Unseen {
            fit: of.fit.clone(),
            errors: self.scores(&left),
            fitted: self.score(&of.left),
            left,
        })
    }

    /// Mean over channels of the logarithm of an error beside noise and tolerance: less matters to nobody.
    fn score(&self, left: &Rms) -> f64 {
        let each = Channel::ALL.into_iter().filter_map(|c| {
            let least = self.noise_or_tolerance(c)?;
            Some(0.5 * (left[c] / least).powi(2).ln_1p())
        });
        let each: Vec<f64> = each.filter(|v| v.is_finite()).collect();
        each.iter().sum::<f64>() / each.len() as f64
    }

    fn scores(&self, left: &[Rms]) -> Vec<f64> {
        left.iter().map(|left| self.score(left)).collect()
    }

    fn is_explained(&self, left: &Rms) -> bool {
        Channel::ALL.into_iter().all(|c| {
            let noise = self.noises.channels[c].map(|n| n.total_sd());
            noise.is_none_or(|sd| left[c].is_nan() || left[c] < AT_NOISE * sd)
        })
    }

    /// Laws, pairs of laws and exchanges worth a fit beside a model.
    fn coarse_proposals(&self, fit: &Fit) -> Vec<Job> {
        let coarse = self.coarse(&self.left(&fit.terms, &fit.point));
        let gains = coarse.predicted_gains(fit);
        // The vehicle's own coefficients are fitted anyway.
        let is_law = |candidate: usize| !self.body.candidates[candidate].own;
        let worth = |p: &&PredictedGain| p.gain > SMALLEST_GAIN && is_law(p.candidate);
        let alone = || gains.iter().filter(worth).filter(|p| p.instead.is_none());
        let mut jobs: Vec<Job> = alone()
            .take(SINGLES)
            .map(|p| {
                let (terms, point) = self.with(fit, p.candidate, &p.numbers);
                (terms, vec![point])
            })
            .collect();
        for member in 0..fit.terms.len() {
            let instead = gains.iter().filter(worth);
            let instead = instead.filter(|p| p.instead == Some(member));
            for p in instead.take(EXCHANGES) {
                let (terms, point) = self.without(fit, member);
                let smaller = Fit {
                    terms,
                    point,
                    ..fit.clone()
                };
                let (terms, point) = self.with(&smaller, p.candidate, &p.numbers);
                jobs.push((terms, vec![point]));
            }
        }
        let best = alone().next().map(|p| p.candidate);
        let holds_best = |p: &&PredictedPair| p.members.iter().any(|m| Some(m.0) == best);
        let pairs = coarse.predicted_pairs(fit);
        let needed = |p: &&PredictedPair| {
            p.members.iter().all(|m| is_law(m.0)) && p.gain > p.better_alone + SMALLEST_GAIN
        };
        // Those with the best law come in the next turn anyway: the other pairs do without it.
        let (with, without): (Vec<_>, Vec<_>) = pairs.iter().filter(needed).partition(holds_best);
        let chosen = with.into_iter().take(1);
        for p in chosen.chain(without.into_iter().take(PAIRS - 1)) {
            jobs.push(self.with_both(fit, p));
        }
        jobs
    }

    /// A model with both laws of a pair.
    fn with_both(&self, fit: &Fit, pair: &PredictedPair) -> Job {
        let mut made = (Vec::new(), Vec::new());
        for share in SHARES {
            let mut both = fit.clone();
            for (candidate, numbers) in &pair.members {
                let of = &self.body.candidates[*candidate];
                let numbers = of.at_share(numbers, of.stretched(), share);
                (both.terms, both.point) = self.with(&both, *candidate, &numbers);
            }
            made.0 = both.terms;
            made.1.push(both.point);
        }
        made
    }

    /// Of the models that explain most of the simulation error the one that predicts the runs left out with fewest laws, with
    /// all models on the way.
    fn explained_most(&self, alone: &Fit, watch: Watch<'_>) -> Option<(Unseen, Vec<Fit>)> {
        let from = vec![self.body.begin(), alone.point.clone()];
        let alone = self.coarse_fits(vec![(Vec::new(), from)], ROUNDS).pop()?;
        let mut all = vec![alone.fit.clone()];
        let mut unseen = vec![self.unseen_by_squares(&alone)?];
        let mut front = vec![alone];
        let mut visited: BTreeSet<Vec<usize>> = BTreeSet::new();
        for turn in 0..JOINS {
            if watch.limit.is_over() || front.iter().any(|c| self.is_explained(&c.left)) {
                break;
            }
            watch.tell(&format!("simulation error, turn {}", turn + 1));
            let jobs = front.iter().flat_map(|c| self.coarse_proposals(&c.fit));
            let jobs: Vec<Job> = jobs.filter(|j| visited.insert(j.0.clone())).collect();
            let mut made = self.coarse_fits(jobs, RACE_ROUNDS);
            all.extend(made.iter().map(|c| c.fit.clone()));
            let (Some(before), Some(least)) = (
                front.first(),
                unseen.iter().map(Unseen::mean).reduce(f64::min),
            ) else {
                break;
            };
            let count = self.independent_samples(&before.fit.terms, &before.fit.point);
            let rank = |c: &Coarse| c.criterion(before, &count);
            made.retain(|c| rank(c) < 0.0);
            made.sort_by(|a, b| rank(a).total_cmp(&rank(b)));
            made.truncate(RACE);
            let to_end = made.into_iter().map(|c| (c.fit.terms, c.ends));
            let mut made = self.coarse_fits(to_end.collect(), ROUNDS);
            all.extend(made.iter().map(|c| c.fit.clone()));
            made.sort_by(|a, b| rank(a).total_cmp(&rank(b)));
            made.truncate(FRONT);
            for c in &made {
                tracing::debug!(
                    "by squares {:.1} {:?} {:?}",
                    rank(c),
                    self.names(&c.fit),
                    c.left.by_name()
                );
            }
            let of = |c: &Coarse| self.unseen_by_squares(c);
            let new: Vec<Unseen> = made.iter().filter_map(of).collect();
            for n in &new {
                tracing::debug!(
                    "{:.3} {:?} leaves {:?} of runs not seen",
                    n.mean(),
                    self.names(&n.fit),
                    pooled(&n.left).by_name()
                );
            }
            // One law alone may gain nothing where two need each other.
            let is_last = turn > 0 && new.iter().all(|n| n.mean() >= least);
            unseen.extend(new);
            if is_last || made.is_empty() {
                break;
            }
            front = made;
        }
        let best = fewest(&unseen)?.clone();
        tracing::debug!("{:?} by squares", self.names(&best.fit));
        Some((best, all))
    }

    /// What a model leaves of runs held out.
    fn left_of_held(&self, held: &Problem, fit: &Fit) -> Option<Vec<Rms>> {
        let coarse = held.coarse(&self.left(&fit.terms, &fit.point));
        let point = coarse.with_starts(&fit.terms, &fit.point)?;
        let predicted = held.predicted(&fit.terms, &point);
        Some(held.left_by_stretch(&predicted, stretches_of_each(predicted.len())))
    }
}

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
        let left = self.left(&fit.terms, &fit.point);
        let ends = Vec::new();
        let made = self.unseen_by_squares(&Coarse { fit, left, ends })?;
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
