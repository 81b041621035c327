//! The ideal observer: the Bayes-optimal choice at the true noise.
//!
//! Same runs, same candidates, same priors and evidence as the diagnosis, but it is told the noise
//! (its law fitted to the noise itself, and which samples are outliers) and starts from the truth:
//! it only chooses among all sets one removal, addition or exchange away, and goes on from a better
//! one. What it gets wrong, the data do not hold.
//!
//! Of a law near the vocabulary's it is asked whether it can be seen at all that the law is another one: it
//! knows that law, and takes it where it is likelier than the best set of the vocabulary.

use std::collections::BTreeMap;

use hydroline_rigs::Dof;
use nalgebra::DVector;
use rayon::prelude::*;

use super::case::{Case, UNNAMED_ID};
use hydroline_diagnose::Source;
use hydroline_diagnose::bank::{Response, View, joined, responses, whitened, without};
use hydroline_diagnose::choosing::Choosing;
use hydroline_diagnose::fit::{Fit, Posed};
use hydroline_diagnose::posterior::FAR;
use hydroline_diagnose::predict::held_out;
use hydroline_diagnose::rest;
use hydroline_diagnose::setting::{Setting, Track};
use hydroline_diagnose::weight::weights;
use hydroline_diagnose::weights::Weights;
use hydroline_identify::data::Run;
use hydroline_identify::parameter::Coefficient;
use hydroline_numerics::noise::{Series, estimate};

/// Additions and exchanges fitted per set.
const WIDTH: usize = 4;
/// Linearised gain below which an addition cannot win against its prior.
const LEAST_GAIN: f64 = 3.0;
/// An exchange must come this close to what the removal lost.
const CLOSE: f64 = 10.0;
/// Moves from the truth.
const ROUNDS: usize = 3;
/// Log evidence that one more number of a law costs: its range over its sd is some twenty.
const ONE_MORE: f64 = 3.0;

fn tracks(sources: &[Source]) -> Vec<Track> {
    let of = |s: &Source| Track::of(&s.run, Dof::Surge);
    sources.iter().filter_map(of).collect()
}

/// The observer of one case.
pub struct Ideal {
    setting: Setting,
    weights: Weights,
    truth: Fit,
    bank: Vec<Response>,
    white: Vec<DVector<f64>>,
    fits: BTreeMap<Vec<usize>, Fit>,
    /// The run held out that helps to choose, as in the diagnosis.
    choosing: Choosing,
}

impl Ideal {
    /// Tells it the noise and the truth; `None` where the truth is no set of the vocabulary or its
    /// fit diverges. A law near the vocabulary's stands as the vocabulary's, fitted.
    pub fn new(case: &Case) -> Option<Ideal> {
        let near = case.key.truth.iter().find(|t| !t.exact).map(|t| &t.effect);
        if near.is_some_and(|n| n == UNNAMED_ID) {
            return None;
        }
        let runs: Vec<Run> = case.sealed.sources.iter().map(|s| s.run.clone()).collect();
        let setting = Setting::new(&runs, &case.sealed.rig, Dof::Surge).ok()?;
        let aligned = setting
            .tracks
            .iter()
            .zip(&case.key.runs)
            .all(|(t, r)| t.times_s.len() == r.noise_m.len());
        if setting.tracks.len() != case.key.runs.len() || !aligned {
            return None;
        }
        let series: Vec<Series<'_>> = setting
            .tracks
            .iter()
            .zip(&case.key.runs)
            .map(|(t, r)| Series {
                times_s: &t.times_s,
                values: &r.noise_m,
                jacobian: None,
            })
            .collect();
        let (noise, _) = estimate(&series)?;
        let used = case
            .key
            .runs
            .iter()
            .map(|r| r.outlier.iter().map(|o| !o).collect())
            .collect();
        // Sealed runs begin at rest.
        let still = rest::still(setting.tolerance);
        let weights = Weights::new(&setting.tracks, noise, used).at_rest(Some(still));
        let mut members: Vec<(usize, Vec<f64>)> = Vec::new();
        for entry in &case.key.tank.entries {
            let index = setting
                .vocabulary
                .iter()
                .position(|c| c.info.id == entry.effect)?;
            let given = super::sizes::numbers(entry);
            let values = setting.vocabulary[index]
                .info
                .parameters
                .iter()
                .map(|p| {
                    let own = given.iter().find(|(n, _)| n == p.name).map(|(_, v)| *v);
                    own.or(p.absent).unwrap_or(p.typical)
                })
                .collect();
            members.push((index, values));
        }
        let mut ways: Vec<Vec<(usize, Vec<f64>)>> = vec![members.clone()];
        if let Some(near) = near {
            let index = setting.vocabulary.iter().position(|c| c.info.id == *near)?;
            let starts = &setting.vocabulary[index].starts;
            let with = |start: &Vec<f64>| [members.clone(), vec![(index, start.clone())]].concat();
            ways = starts.iter().map(with).collect();
        }
        let from = |way: &mut Vec<(usize, Vec<f64>)>| {
            way.sort_by_key(|m| m.0);
            let set: Vec<usize> = way.iter().map(|m| m.0).collect();
            let mut at: Vec<f64> = Coefficient::of(Dof::Surge)
                .iter()
                .map(|c| c.of_vehicle(&case.key.tank.vehicle))
                .collect();
            at.extend(way.iter().flat_map(|m| m.1.iter().copied()));
            for _ in &setting.tracks {
                at.extend([case.sealed.rig.tank.start_pose[0], 0.0]);
            }
            (set, at)
        };
        let jobs: Vec<(Vec<usize>, Vec<f64>)> = ways.iter_mut().map(from).collect();
        let truth = jobs
            .into_par_iter()
            .filter_map(|(set, at)| Posed::new(&setting, &weights, &set).fit(at).ok())
            .filter(|f| f.log_evidence.is_finite())
            .min_by(|a, b| a.cost.total_cmp(&b.cost))?;
        let bank = responses(&setting, &truth);
        let white = bank
            .par_iter()
            .map(|r| whitened(&setting, &weights, &r.column))
            .collect();
        let fits = BTreeMap::from([(truth.set.clone(), truth.clone())]);
        let held = tracks(&case.sealed.held);
        let first = held.get(..1).filter(|_| held.len() > 1).unwrap_or_default();
        // The true set foretells them, and holds what only they show: neither has to be asked.
        let choosing = Choosing::like(&setting, &weights, first, &truth);
        Some(Ideal {
            setting,
            weights,
            truth,
            bank,
            white,
            fits,
            choosing,
        })
    }

    fn fit(&self, set: &[usize], from: Vec<f64>) -> Option<Fit> {
        Posed::new(&self.setting, &self.weights, set)
            .fit(from)
            .ok()
            .filter(|f| f.log_evidence.is_finite() && f.confounded(&self.setting).is_empty())
    }

    fn smaller(&self, fit: &Fit, member: usize) -> Option<Fit> {
        let (set, from) = without(&self.setting, fit, member);
        match self.fits.get(&set) {
            Some(known) => Some(known.clone()),
            None => self.fit(&set, from),
        }
    }

    /// Additions to a fit worth more than `least`, fitted from their best points.
    fn larger(&self, fit: &Fit, least: f64) -> Vec<Fit> {
        let view = View::new(&self.setting, &self.weights, fit);
        let promises = view.promises(&self.bank, &self.white, &fit.set);
        let jobs: Vec<(Vec<usize>, Vec<f64>)> = promises
            .iter()
            .filter(|l| l[0].gain > least)
            .take(WIDTH)
            .flat_map(|l| l.iter().take(2))
            .map(|p| {
                let point = &self.setting.vocabulary[p.candidate].starts[p.start];
                joined(&self.setting, fit, p.candidate, point)
            })
            .filter(|(set, _)| !self.fits.contains_key(set))
            .collect();
        jobs.into_par_iter()
            .filter_map(|(set, from)| self.fit(&set, from))
            .collect()
    }

    fn keep(&mut self, made: Vec<Fit>) {
        for fit in made {
            let better = self
                .fits
                .get(&fit.set)
                .is_none_or(|old| fit.cost < old.cost);
            if better {
                self.fits.insert(fit.set.clone(), fit);
            }
        }
    }

    /// Log evidence of the best set by the runs fitted.
    fn top(&self) -> f64 {
        let all = self.fits.values().map(|f| f.log_evidence);
        all.fold(f64::NEG_INFINITY, f64::max)
    }

    fn best(&self) -> &Fit {
        let top = self.top();
        let near: Vec<&Fit> = self
            .fits
            .values()
            .filter(|f| f.log_evidence > top - FAR)
            .collect();
        self.choosing
            .likeliest(&self.setting, &self.weights, &near)
            .unwrap_or(&self.truth)
    }

    /// Its choice: (effect, weight \[m\]), heaviest first.
    pub fn choice(&mut self) -> Vec<(String, f64)> {
        let mut current = self.truth.clone();
        for _ in 0..ROUNDS {
            let mut made = self.larger(&current, LEAST_GAIN);
            for member in 0..current.set.len() {
                let Some(less) = self.smaller(&current, member) else {
                    continue;
                };
                let lost = less.cost - current.cost;
                made.extend(self.larger(&less, (lost - CLOSE).max(LEAST_GAIN)));
                made.push(less);
            }
            self.keep(made);
            let best = self.best().clone();
            if best.set == current.set {
                break;
            }
            current = best;
        }
        let shares = weights(&self.setting, &current);
        let mut found: Vec<(String, f64)> = current
            .set
            .iter()
            .zip(shares)
            .map(|(c, w)| (self.setting.vocabulary[*c].info.id.to_owned(), w))
            .collect();
        found.sort_by(|a, b| b.1.total_cmp(&a.1));
        found
    }

    /// Whether it would take the law that is near the vocabulary's for another one than that: its likelihood is
    /// that of the noise itself, with one number more than the vocabulary's.
    pub fn sees_another_law(&self, case: &Case) -> bool {
        let noise: Vec<Vec<f64>> = case.key.runs.iter().map(|r| r.noise_m.clone()).collect();
        // At its minimum a fit leaves half its numbers less than the noise, those that no prior holds.
        let posed = Posed::new(&self.setting, &self.weights, &self.truth.set);
        let covariance = self.truth.covariance();
        let precisions = posed.precisions(&self.truth.at);
        let by_priors: f64 = (0..precisions.len())
            .map(|i| (covariance[(i, i)] * precisions[i].1).min(1.0))
            .sum();
        let numbers = self.truth.at.len() as f64 - by_priors + 1.0;
        let fitted = 0.5 * self.weights.stack(noise).norm_squared() - 0.5 * numbers;
        let law = self.truth.log_evidence + (self.truth.cost - fitted) - ONE_MORE;
        tracing::debug!(
            "the other law gains {:.1} over the best set",
            law - self.top()
        );
        law > self.top()
    }

    /// rms of the run held out that chose nothing under its choice \[m\].
    pub fn held_out(&self, case: &Case) -> Option<f64> {
        let held = tracks(&case.sealed.held);
        let last = held.get(held.len().checked_sub(1)?..)?;
        held_out(&self.setting, last, self.best(), self.weights.noise)
    }

    /// Log evidence of all runs by which the truth beats the same set without some of its effects; `None` where one of
    /// them is not there, or where what is left could not be fitted.
    pub fn worth(&self, missing: &[&str]) -> Option<f64> {
        let rest = self.lacking(missing)?;
        let less = self.plainly(&rest.set, rest.at)?;
        let of = |fit: &Fit| self.choosing.evidence(&self.setting, &self.weights, fit);
        let worth = of(&self.truth) - of(&less);
        tracing::debug!("without {}: {worth:.2} less", missing.join(", "));
        Some(worth)
    }

    /// The truth without some of its effects, where the others stand; `None` where one of them is not there.
    fn lacking(&self, missing: &[&str]) -> Option<Fit> {
        let mut rest = self.truth.clone();
        for id in missing {
            let held = |c: &usize| self.setting.vocabulary[*c].info.id == *id;
            let member = rest.set.iter().position(held)?;
            (rest.set, rest.at) = without(&self.setting, &rest, member);
        }
        Some(rest)
    }

    /// What the data say nothing of (a wall far off) is no reason not to compare.
    fn plainly(&self, set: &[usize], from: Vec<f64>) -> Option<Fit> {
        let posed = Posed::new(&self.setting, &self.weights, set);
        posed.fit(from).ok().filter(|f| f.log_evidence.is_finite())
    }

    /// Log evidence by which the truth beats the same set with `wrong` in the place of `missing`: infinite where that
    /// one, fitted there, is worth no more than nothing; none where that is no question or it could not be fitted.
    pub fn gap(&self, missing: &str, wrong: &str) -> Option<f64> {
        let known = &self.setting.vocabulary;
        let f = known.iter().position(|c| c.info.id == wrong)?;
        let from = self.lacking(&[missing])?;
        if self.truth.set.contains(&f) {
            return None;
        }
        // From the true numbers and from those that the others have without it.
        let less = self.plainly(&from.set, from.at.clone());
        let starts = &self.setting.vocabulary[f].starts;
        let jobs: Vec<(Vec<usize>, Vec<f64>)> = [Some(&from), less.as_ref()]
            .into_iter()
            .flatten()
            .flat_map(|rest| starts.iter().map(|s| joined(&self.setting, rest, f, s)))
            .collect();
        // One that does nothing there stands for nothing.
        let does = |f: &Fit| {
            less.as_ref()
                .is_none_or(|l| f.log_evidence > l.log_evidence)
        };
        let other: Vec<Fit> = jobs
            .into_par_iter()
            .filter_map(|(set, from)| self.plainly(&set, from))
            .collect();
        let gap = other
            .iter()
            .filter(|o| does(o))
            .map(|o| self.truth.log_evidence - o.log_evidence)
            .fold(f64::INFINITY, f64::min);
        tracing::debug!("{wrong} for {missing}: {gap:.2} less");
        (!other.is_empty()).then_some(gap)
    }
}
