//! Laws by the simulation error, turn by turn: what explains most is looked for first, beside the vehicle alone, then beside the best of
//! the turn before; runs left out say how many laws are enough.

use std::collections::BTreeSet;

use hydroline_core::run::{Channel, PerChannel};
use hydroline_numerics::{cancel, parallel};

use crate::body::Point;
use crate::coarse::ROUNDS;
use crate::fit::{Fit, Problem};
use crate::hyper::Tables;
use crate::limit::Watch;
use crate::predicted_gain::PredictedGain;
use crate::predicted_gain::pair::PredictedPair;
use crate::summary::Rms;

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
pub(super) struct Coarse {
    fit: Fit,
    left: Rms,
    /// Points at which the fits from all starts ended: the best one now is not always the best in the end.
    ends: Vec<Point>,
}

/// rms over runs per channel.
pub(super) fn pooled(left: &[Rms]) -> Rms {
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
pub(super) struct Unseen {
    pub(super) fit: Fit,
    /// rms of each stretch.
    pub(super) left: Vec<Rms>,
    /// Score of each stretch: mean over channels of the logarithm of the error over what matters.
    pub(super) errors: Vec<f64>,
    /// The same of all runs that it is fitted to.
    fitted: f64,
}

impl Unseen {
    pub(super) fn mean(&self) -> f64 {
        self.errors.iter().sum::<f64>() / self.errors.len().max(1) as f64
    }
}

/// Mean difference of scores in the same stretches, and its standard error.
pub(super) fn beside_each(scores: &[f64], others: &[f64]) -> (f64, f64) {
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
                Some(self.coarse_of(fit))
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

    /// A fit from one start with what it leaves.
    pub(super) fn coarse_of(&self, fit: Fit) -> Coarse {
        Coarse {
            left: self.left(&fit.terms, &fit.point),
            ends: vec![fit.point.clone()],
            fit,
        }
    }

    /// Of models the best beside one that was there before: all are fitted for some rounds, those ahead then to the end. `all`
    /// takes each.
    fn race(&self, jobs: Vec<Job>, before: &Coarse, all: &mut Vec<Fit>) -> Vec<Coarse> {
        let count = self.independent_samples(&before.fit.terms, &before.fit.point);
        let rank = |c: &Coarse| c.criterion(before, &count);
        let sort = |made: &mut Vec<Coarse>| made.sort_by(|a, b| rank(a).total_cmp(&rank(b)));
        let made = self.coarse_fits(jobs, RACE_ROUNDS).into_iter();
        let (mut ahead, mut behind): (Vec<_>, Vec<_>) = made.partition(|c| rank(c) < 0.0);
        sort(&mut ahead);
        behind.extend(ahead.split_off(RACE.min(ahead.len())));
        let to_end = ahead.into_iter().map(|c| (c.fit.terms, c.ends));
        let mut made = self.coarse_fits(to_end.collect(), ROUNDS);
        all.extend(behind.into_iter().map(|c| c.fit));
        all.extend(made.iter().map(|c| c.fit.clone()));
        sort(&mut made);
        made.truncate(FRONT);
        for c in &made {
            tracing::debug!(
                "by squares {:.1} {:?} {:?}",
                rank(c),
                self.names(&c.fit),
                c.left.by_name()
            );
        }
        made
    }

    /// A model with its errors in runs that it has not seen: each run as the others predict it.
    pub(super) fn unseen_by_squares(&self, of: &Coarse) -> Option<Unseen> {
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

    pub(super) fn scores(&self, left: &[Rms]) -> Vec<f64> {
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
    pub(super) fn explained_most(
        &self,
        alone: &Fit,
        watch: Watch<'_>,
    ) -> Option<(Unseen, Vec<Fit>)> {
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
            let (Some(before), Some(least)) = (
                front.first(),
                unseen.iter().map(Unseen::mean).reduce(f64::min),
            ) else {
                break;
            };
            let made = self.race(jobs, before, &mut all);
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
}
