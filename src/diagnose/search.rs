//! Which effects were left out together: forward selection with removal and exchange, several sets at a time.

mod elsewhere;
mod exchange;
mod noise;
mod rounds;

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::DVector;
use rayon::prelude::*;

use super::bank::{Promise, Response, View, begin, joined, motion, responses, whitened, without};
use super::descent::Effort;
use super::explain::Explanation;
use super::fit::{Fit, Posed};
use super::rest;
use super::setting::Setting;
use super::weights::Weights;
use hydroline_numerics::noise::Noise;

/// Candidates fitted per set of the beam.
const WIDTH: usize = 5;
/// A candidate whose linearised gain is below this is not worth a fit.
pub const LEAST_GAIN: f64 = 3.0;
/// Starting points fitted per candidate.
const STARTS: usize = 2;
/// Ways to the same set that are followed in one round.
const WAYS: usize = 2;
/// Half chi-square of a member's size above which sets without it are not looked at.
const SURELY_THERE: f64 = 60.0;
/// A fit whose cost ends this far above the best one's is not followed to its minimum.
const HOPELESSLY_FAR: f64 = 60.0;
/// Rough fits at the front that are finished when a search ends.
const FINISHED: usize = 12;
/// Cost over that of pure noise above which the vehicle alone is fitted from far off as well.
const ASTRAY: f64 = 100.0;
/// Half chi-square above what a way promises from which a fit is taken to have ended elsewhere.
const OTHER_MINIMUM: f64 = 6.0;
/// Share by which what a linear view promises may be wrong.
const PROMISES_ARE_OFF: f64 = 0.3;

/// A set, the one it was reached from, that one's cost, the start (`usize::MAX`: none) and what was promised.
type Way = (Vec<usize>, Vec<usize>, i64, usize, i64);

/// Work in progress of one DOF.
pub struct Search<'a> {
    /// The problem.
    pub setting: &'a Setting,
    /// Noise and samples in use.
    pub weights: Weights,
    /// Every set fitted under these weights.
    pub fits: BTreeMap<Vec<usize>, Fit>,
    /// Sets looked at, linearised or fitted.
    pub looked: usize,
    /// Candidates that the vehicle's own coefficients do the work of.
    pub blind: BTreeSet<usize>,
    hopeless: bool,
    /// Runs that begin at rest stand still; else how still is found along with the noise.
    held_still: bool,
    /// Ways to sets that were taken, under the present weights.
    ways: BTreeSet<Way>,
    /// Few effects of which one does not act by its law, found before the large sets.
    pub early: Vec<Explanation>,
    /// The unnamed force for which the search ended.
    pub instead: Option<Explanation>,
    /// Effects that only the runs held out show, with their numbers and what they gain there.
    pub shown: Vec<(usize, Vec<f64>, f64)>,
    /// The noise was found beside a free function: a set that lacks it would take structure for noise.
    noise_stands: bool,
    /// The least noise found on the way to the present one.
    least_noise: Option<Noise>,
    /// The same, kept where that one is given up once it was tried.
    sharpest: Option<Noise>,
    /// The set beside which free functions were looked at last.
    looked_beside: Option<Vec<usize>>,
    bank: Vec<Response>,
    whitened: Vec<DVector<f64>>,
    /// Told what is done.
    pub progress: &'a (dyn Fn(&str) + Sync),
}

impl<'a> Search<'a> {
    /// Starts with white noise from differences and nothing left out; how still the runs begin is found with the noise.
    pub fn new(setting: &'a Setting, progress: &'a (dyn Fn(&str) + Sync)) -> Search<'a> {
        Search {
            weights: Weights::first(&setting.tracks),
            held_still: false,
            setting,
            fits: BTreeMap::new(),
            looked: 0,
            blind: BTreeSet::new(),
            hopeless: false,
            ways: BTreeSet::new(),
            early: Vec::new(),
            instead: None,
            shown: Vec::new(),
            noise_stands: false,
            least_noise: None,
            sharpest: None,
            looked_beside: None,
            bank: Vec::new(),
            whitened: Vec::new(),
            progress,
        }
    }

    /// The same with runs that stand still at their start, come what may.
    pub fn still(setting: &'a Setting, progress: &'a (dyn Fn(&str) + Sync)) -> Search<'a> {
        let mut made = Search::new(setting, progress);
        made.weights.rest_sd = Some(rest::still(setting.tolerance));
        made.held_still = true;
        made
    }

    /// Whether the search ended because a free force was better than all of the vocabulary.
    pub fn stopped_early(&self) -> bool {
        self.hopeless
    }

    /// The fit of a set, if there is one.
    pub fn get(&self, set: &[usize]) -> Option<&Fit> {
        self.fits.get(set)
    }

    /// The best set by log evidence.
    pub fn best(&self) -> Option<&Fit> {
        self.fits
            .values()
            .max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))
    }

    /// Fits sets from given points; a better fit of the same set replaces the old one.
    pub fn fit(&mut self, jobs: Vec<(Vec<usize>, Vec<f64>)>) {
        let effort = Effort {
            limit: self
                .best()
                .map_or(f64::INFINITY, |b| b.cost + HOPELESSLY_FAR),
            ..self.weights.to_a_percent()
        };
        self.fit_with(jobs, effort);
    }

    fn fit_with(&mut self, jobs: Vec<(Vec<usize>, Vec<f64>)>, effort: Effort) {
        self.looked += jobs.len();
        let made: Vec<Fit> = jobs
            .into_par_iter()
            .filter_map(|(set, from)| {
                Posed::new(self.setting, &self.weights, &set)
                    .fit_with(from, effort)
                    .ok()
            })
            .filter(|f| f.log_evidence.is_finite())
            .collect();
        for fit in made {
            // Exactly confounded with the vehicle or with each other: no explanation, a blind spot.
            let confounded = fit.confounded(self.setting);
            if !confounded.is_empty() {
                if let [one] = fit.set[..] {
                    self.blind.insert(one);
                }
                continue;
            }
            tracing::trace!(
                "fitted {:?} {:.1}, cost {:.1}{}",
                fit.set,
                fit.log_evidence,
                fit.cost,
                if fit.rough { ", rough" } else { "" }
            );
            let keep = self.fits.get(&fit.set).is_none_or(|old| {
                let finished = old.rough && !fit.rough && fit.cost <= old.cost + 1e-3;
                fit.cost < old.cost - 1e-3 || finished
            });
            if keep {
                self.fits.insert(fit.set.clone(), fit);
            }
        }
    }

    /// Brings rough fits at the front to their minimum, until none is left there.
    pub fn finish(&mut self) {
        for _ in 0..4 {
            let rough: Vec<(Vec<usize>, Vec<f64>)> = self
                .ranked()
                .iter()
                .take(FINISHED)
                .filter(|f| f.rough)
                .map(|f| (f.set.clone(), f.at.clone()))
                .collect();
            if rough.is_empty() {
                break;
            }
            self.fit_with(rough, Effort::FULL);
        }
    }

    /// One set's fit, brought to its minimum.
    pub fn finished(&mut self, set: &[usize]) -> Option<Fit> {
        if let Some(fit) = self.get(set).filter(|f| f.rough) {
            let job = (fit.set.clone(), fit.at.clone());
            self.fit_with(vec![job], Effort::FULL);
        }
        self.get(set).cloned()
    }

    /// A set's own fit, without any function that it was fitted along with.
    pub fn alone(&mut self, like: &Fit) -> Option<Fit> {
        if self.get(&like.set).is_none() {
            self.fit(vec![(like.set.clone(), like.at.clone())]);
        }
        self.finished(&like.set)
    }

    /// Fits the empty set from the rig's numbers and, where that ends far from the noise, from others: with
    /// commands that a controller gave, a mass or a damping that is far off has minima of its own.
    pub fn nothing(&mut self) {
        let from = Posed::new(self.setting, &self.weights, &[]).start();
        self.fit(vec![(Vec::new(), from.clone())]);
        let floor = 0.5 * self.weights.samples() as f64;
        if self.get(&[]).is_some_and(|f| f.cost < ASTRAY * floor) {
            return;
        }
        let far = [(3.0, 3.0), (1.0, 3.0), (3.0, 1.0), (1.0, 0.3), (0.3, 1.0)];
        let jobs = far
            .into_iter()
            .map(|(inertia, damping)| {
                let mut at = from.clone();
                at[0] *= inertia;
                at[1] *= damping;
                (Vec::new(), at)
            })
            .collect();
        self.fit_with(jobs, self.weights.to_a_percent());
    }

    /// Takes responses of all candidates beside a set.
    pub fn refresh(&mut self, set: &[usize]) {
        if let Some(fit) = self.get(set) {
            let mut bank = responses(self.setting, fit);
            // Members of the set keep the responses they had.
            bank.extend(
                self.bank
                    .iter()
                    .filter(|r| set.contains(&r.candidate))
                    .cloned(),
            );
            self.bank = bank;
            self.rewhiten();
        }
    }

    /// Responses of candidates as last taken.
    pub fn bank(&self) -> &[Response] {
        &self.bank
    }

    /// The same, whitened.
    pub fn white(&self) -> &[DVector<f64>] {
        &self.whitened
    }

    fn rewhiten(&mut self) {
        self.whitened = self
            .bank
            .par_iter()
            .map(|r| whitened(self.setting, &self.weights, &r.column))
            .collect();
    }

    /// What may be added to a set, best first.
    pub fn promises(&mut self, set: &[usize]) -> Vec<Vec<Promise>> {
        let Some(fit) = self.get(set) else {
            return Vec::new();
        };
        let view = View::new(self.setting, &self.weights, fit);
        let mut found = view.promises(&self.bank, &self.whitened, set);
        found.retain(|l| !self.blind.contains(&l[0].candidate));
        self.looked += found.len();
        found
    }

    /// Where a promised candidate begins beside a fit.
    pub fn begin(&self, fit: &Fit, promise: &Promise) -> Vec<f64> {
        begin(
            self.setting,
            fit,
            &self.bank,
            promise,
            &|set, globals, starts| motion(self.setting, set, globals, starts),
        )
    }

    /// Fits a set with each of its most promising additions.
    pub fn extend(&mut self, sets: &[Vec<usize>], width: usize, least_gain: f64) {
        let (mut jobs, mut ways) = (Vec::new(), Vec::new());
        for set in sets {
            let promises = self.promises(set);
            let Some(fit) = self.get(set) else { continue };
            tracing::trace!(
                "{set:?} {:.1} promised {:?}",
                fit.log_evidence,
                promises
                    .iter()
                    .take(width)
                    .map(|l| (l[0].candidate, l[0].start, l[0].gain as i64))
                    .collect::<Vec<_>>()
            );
            for list in promises
                .iter()
                .filter(|l| l[0].gain > least_gain)
                .take(width)
            {
                for p in list.iter().take(STARTS) {
                    let point = self.begin(fit, p);
                    let (bigger, from) = joined(self.setting, fit, p.candidate, &point);
                    let way = Search::way(&bigger, fit, p.start, -p.gain);
                    if p.gain >= least_gain && self.lacks(&way, fit, Some(-p.gain)) {
                        jobs.push((bigger, from));
                        ways.push(way);
                    }
                }
            }
        }
        // The same set comes up from several parents: two ways to it are enough.
        let mut taken: BTreeMap<Vec<usize>, usize> = BTreeMap::new();
        let mut kept = Vec::new();
        for (job, way) in jobs.into_iter().zip(ways) {
            let count = taken.entry(job.0.clone()).or_default();
            *count += 1;
            if *count <= WAYS {
                kept.push(job);
                self.ways.insert(way);
            }
        }
        self.fit(kept);
    }

    /// Whether a set is not fitted yet, or only far above a cost that another way to it promises: what has a
    /// period or a place has minima of its own, and the first way may have ended in one.
    /// `change` of the cost as the parent promises it; the same way is not taken twice.
    fn lacks(&self, way: &Way, parent: &Fit, change: Option<f64>) -> bool {
        let Some(fit) = self.get(&way.0) else {
            return true;
        };
        change.is_some_and(|change| {
            let slack = OTHER_MINIMUM.max(PROMISES_ARE_OFF * change.abs());
            fit.cost > parent.cost + change + slack && !self.ways.contains(way)
        })
    }

    fn way(set: &[usize], parent: &Fit, start: usize, change: f64) -> Way {
        let (cost, change) = (parent.cost as i64, change as i64);
        (set.to_vec(), parent.set.clone(), cost, start, change)
    }

    /// Every candidate by itself, fitted to a percent of its cost.
    pub fn singles(&mut self) {
        self.refresh(&[]);
        let Some(nothing) = self.get(&[]).cloned() else {
            return;
        };
        let jobs = self
            .promises(&[])
            .into_iter()
            .flat_map(|l| l.into_iter().take(STARTS))
            .map(|p| {
                let point = self.begin(&nothing, &p);
                joined(self.setting, &nothing, p.candidate, &point)
            })
            .collect();
        self.fit_all(jobs);
    }

    /// Fits sets, all to a percent of their cost.
    pub fn fit_all(&mut self, jobs: Vec<(Vec<usize>, Vec<f64>)>) {
        self.fit_with(jobs, self.weights.to_a_percent());
    }

    /// Fits sets with each of their members taken out that is not surely there.
    pub fn reduce(&mut self, sets: &[Vec<usize>]) {
        self.reduce_below(sets, SURELY_THERE);
    }

    /// Fits sets with each of their members taken out whose size is below this half chi-square.
    pub fn reduce_below(&mut self, sets: &[Vec<usize>], sure: f64) {
        let mut jobs = Vec::new();
        let mut ways = BTreeSet::new();
        for set in sets {
            let Some(fit) = self.get(set) else { continue };
            let sizes = fit.sizes(self.setting);
            for member in (0..set.len()).filter(|m| sizes[*m] < sure) {
                let (smaller, from) = without(self.setting, fit, member);
                let size = Some(sizes[member]).filter(|s| *s > 0.0);
                let way = Search::way(&smaller, fit, usize::MAX, sizes[member]);
                if self.lacks(&way, fit, size) {
                    ways.insert(way);
                    jobs.push((smaller, from));
                }
            }
        }
        self.ways.append(&mut ways);
        self.fit(jobs);
    }

    /// Best sets, best first.
    pub fn ranked(&self) -> Vec<&Fit> {
        let mut all: Vec<&Fit> = self.fits.values().collect();
        all.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
        all
    }

    /// A quick greedy look, to have the noise roughly right before the real search.
    pub fn glance(&mut self, depth: usize) -> Vec<usize> {
        let mut set: Vec<usize> = self.best().map(|f| f.set.clone()).unwrap_or_default();
        for _ in 0..depth {
            let before = self.get(&set).map_or(f64::NEG_INFINITY, |f| f.log_evidence);
            self.extend(std::slice::from_ref(&set), 3, 10.0);
            match self
                .best()
                .filter(|b| b.log_evidence > before + 5.0 && b.set != set)
            {
                Some(better) => set = better.set.clone(),
                None => break,
            }
        }
        set
    }
}
