//! Which effects were left out together: forward selection with removal and exchange, several sets at a time.

mod elsewhere;
mod noise;

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::DVector;
use rayon::prelude::*;

use super::bank::{Promise, Response, View, begin, joined, motion, responses, whitened, without};
use super::descent::Effort;
use super::explain::{Care, Explanation, early, look, unnamed_from_nothing};
use super::fit::{Fit, Posed};
use super::rest;
use super::setting::Setting;
use super::weights::Weights;
use crate::identify::noise::Noise;

/// Sets carried from one depth to the next.
const BEAM: usize = 5;
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
/// Most effects together.
const DEPTH: usize = 7;
/// Rounds without a better set after which the beam has done its work; exchange follows.
const IDLE: usize = 1;
/// A set this far below the best one in log evidence is out of the race.
const FAR: f64 = 12.0;
/// A fit whose cost ends this far above the best one's is not followed to its minimum.
const HOPELESSLY_FAR: f64 = 60.0;
/// Rough fits at the front that are finished when a search ends.
const FINISHED: usize = 12;
/// Candidates tried in the place of a member.
const REPLACED: usize = 3;
/// Promised gain below the best one's at which a candidate is still tried there.
const NEAR_TWIN: f64 = 12.0;
/// Half chi-square per sample above which a fit is far from the noise.
const HOPELESS: f64 = 1.0;
/// Cost over that of pure noise above which the vehicle alone is fitted from far off as well.
const ASTRAY: f64 = 100.0;
/// Cost over that of pure noise below which a free force explains all there is.
const ALL_BUT_NOISE: f64 = 3.0;
/// Half chi-square per sample above which a set leaves more than noise, which leaves 0.5.
const NOT_NOISE: f64 = 0.6;
/// Members from which a set that explains less than few effects with a bent law only imitates them.
const IMITATES: usize = 5;
/// Members from which a set that leaves more than noise is compared with an unnamed force from nothing.
const CROWDED: usize = 5;
/// Half chi-square per sample above which it does: three sd of that of pure noise in some thousand samples.
const MORE_THAN_NOISE: f64 = 0.53;
/// Half chi-square above what a way promises from which a fit is taken to have ended elsewhere.
const OTHER_MINIMUM: f64 = 6.0;
/// Share by which what a linear view promises may be wrong.
const PROMISES_ARE_OFF: f64 = 0.3;
/// Log evidence that a free force must gain beside a set for the search to end.
const PLAINLY: f64 = 30.0;

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

    /// The whole search under the present weights: singles, pairs, then the beam, then exchange.
    pub fn run(&mut self) {
        if !self.fits.contains_key(&Vec::new()) {
            self.nothing();
        }
        let seeds: Vec<Vec<usize>> = self.fits.keys().cloned().collect();
        // All singles, fitted.
        self.extend(&[Vec::new()], usize::MAX, 0.0);
        (self.progress)("singles");
        // All pairs, linearised from every single; the promising ones fitted.
        let singles: Vec<Vec<usize>> = self.fits.keys().filter(|s| s.len() == 1).cloned().collect();
        let best_single = self
            .ranked()
            .iter()
            .filter(|f| f.set.len() <= 1)
            .map(|f| f.log_evidence)
            .fold(f64::NEG_INFINITY, f64::max);
        let mut pairs: Vec<(f64, Vec<usize>, Vec<f64>)> = Vec::new();
        for single in &singles {
            let promises = self.promises(single);
            let Some(fit) = self.get(single) else {
                continue;
            };
            for list in &promises {
                let p = list[0];
                if p.gain > LEAST_GAIN && fit.log_evidence + p.gain > best_single - FAR {
                    let point = self.begin(fit, &p);
                    let (set, from) = joined(self.setting, fit, p.candidate, &point);
                    pairs.push((fit.log_evidence + p.gain, set, from));
                }
            }
        }
        pairs.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut seen = BTreeSet::new();
        pairs.retain(|(_, set, _)| seen.insert(set.clone()));
        pairs.truncate(4 * BEAM);
        self.fit(pairs.into_iter().map(|(_, s, a)| (s, a)).collect());
        (self.progress)("pairs");
        // What a free force does beside nothing, two effects may do as well (a lag and a delay).
        self.hopeless = self.hopeless && self.unnamed_is_better(true);
        if self.hopeless {
            return;
        }
        let mut bar = None;
        let mut beside: Option<Vec<usize>> = None;
        let mut done = BTreeSet::new();
        let mut best = f64::NEG_INFINITY;
        let mut idle = 0;
        let mut asked = false;
        let noise = MORE_THAN_NOISE * self.weights.samples() as f64;
        for round in 0..2 * DEPTH {
            let look_around = round >= 2 && round % 2 == 0;
            if look_around
                && (round == 2 && self.unnamed_is_better(false) || self.imitates_unnamed())
            {
                self.hopeless = true;
                return;
            }
            let crowded = |f: &&Fit| f.set.len() >= CROWDED && f.cost > noise;
            if !asked && let Some(crowd) = self.best().filter(crowded) {
                asked = true;
                let best = crowd.log_evidence;
                let free = unnamed_from_nothing(self);
                tracing::debug!(
                    "{:?} {best:.1}, an unnamed force {:?}",
                    crowd.set,
                    free.as_ref().map(|e| (&e.fit.set, e.log_evidence))
                );
                (self.progress)("unnamed");
                if let Some(free) = free.filter(|e| e.log_evidence > best + PLAINLY) {
                    self.instead = Some(free);
                    self.hopeless = true;
                    return;
                }
            }
            let far = NOT_NOISE * self.weights.samples() as f64;
            let many = |f: &&Fit| f.set.len() >= IMITATES;
            if bar.is_none() && self.best().filter(many).is_some_and(|f| f.cost > far) {
                bar = Some(self.bend_early());
                beside = None;
            }
            let imitates = |f: &Fit| bar.is_some_and(|bar| f.log_evidence < bar);
            if self.best().filter(many).is_some_and(imitates) {
                return;
            }
            // What a period or a place promises beside nothing is out of step with what it does beside what is
            // there.
            if let Some(best) = self.best().map(|f| f.set.clone())
                && best.len() > 1
                && beside.as_ref() != Some(&best)
            {
                self.refresh(&best);
                beside = Some(best);
            }
            let mut beam: Vec<Vec<usize>> = self
                .ranked()
                .iter()
                .filter(|f| !done.contains(&f.set) && f.set.len() < DEPTH)
                .take(BEAM)
                .map(|f| f.set.clone())
                .collect();
            beam.extend(seeds.iter().filter(|s| !done.contains(*s)).cloned());
            let now = self.best().map_or(f64::NEG_INFINITY, |f| f.log_evidence);
            beam.retain(|s| {
                self.get(s)
                    .is_some_and(|f| f.log_evidence > now - 60.0 - FAR)
            });
            if beam.is_empty() {
                break;
            }
            done.extend(beam.iter().cloned());
            self.extend(&beam, WIDTH, LEAST_GAIN);
            self.reduce(&beam);
            let after = self.best().map_or(f64::NEG_INFINITY, |f| f.log_evidence);
            idle = if after > best + 0.01 { 0 } else { idle + 1 };
            best = after;
            (self.progress)("sets");
            tracing::debug!(
                "round {round}: {:?}",
                self.best().map(|b| (b.set.clone(), b.log_evidence, b.cost))
            );
            let front: Vec<Vec<usize>> = self
                .ranked()
                .iter()
                .take(2)
                .map(|f| f.set.clone())
                .collect();
            let follow = |s: &Vec<usize>| s.len() < DEPTH && !done.contains(s);
            if idle >= IDLE && !front.iter().any(follow) {
                break;
            }
        }
        if let Some(best) = self.best().filter(|f| f.cost > noise).cloned() {
            // A wrong period leaves what a free force would take up.
            self.elsewhere(&best);
            if self.imitates_unnamed() {
                self.hopeless = true;
                return;
            }
        }
        self.exchange();
    }

    /// Where a set of some size leaves more than noise: what few effects do of which one does not act by its
    /// law. Sets that stay below that log evidence with many members only imitate it.
    fn bend_early(&mut self) -> f64 {
        self.singles();
        self.early = early(self);
        (self.progress)("bent laws");
        self.early
            .iter()
            .map(|e| e.log_evidence)
            .fold(f64::NEG_INFINITY, f64::max)
    }

    /// Whether a free force beside nothing, or beside the best single effect, beats every set so far
    /// while none of them comes near the noise: then more of the vocabulary only imitates it.
    /// `alone` = only if that force leaves hardly more than noise.
    fn unnamed_is_better(&mut self, alone: bool) -> bool {
        let Some(best) = self.best().cloned() else {
            return false;
        };
        let floor = 0.5 * self.weights.samples() as f64;
        if best.cost < 2.0 * HOPELESS * floor {
            return false;
        }
        let single = self
            .ranked()
            .into_iter()
            .find(|f| f.set.len() == 1)
            .cloned();
        let nothing = self.get(&[]).cloned();
        [nothing, single].into_iter().flatten().any(|fit| {
            let seen = look(self, &fit, Care::Glance);
            let better = seen.unnamed() && seen.log_evidence > best.log_evidence;
            better && (!alone || seen.fit.cost < ALL_BUT_NOISE * floor)
        })
    }

    /// Whether beside the best set so far a free force is left that matters and gains more than effects
    /// still to come: then what comes only imitates it.
    fn imitates_unnamed(&mut self) -> bool {
        // The same set is not looked at twice: a look costs as much as a round.
        let Some(best) = self
            .best()
            .filter(|b| self.looked_beside.as_ref() != Some(&b.set))
            .cloned()
        else {
            return false;
        };
        self.looked_beside = Some(best.set.clone());
        let seen = look(self, &best, Care::Glance);
        seen.unnamed()
            && seen.family_weight > self.setting.tolerance
            && seen.log_evidence > best.log_evidence + PLAINLY
    }

    /// Every member of the best set against every other candidate, with responses taken beside it.
    pub fn exchange(&mut self) {
        for _ in 0..3 {
            let Some(best) = self.best().cloned() else {
                return;
            };
            self.refresh(&best.set);
            self.reduce_below(std::slice::from_ref(&best.set), f64::INFINITY);
            let smaller: Vec<Vec<usize>> = (0..best.set.len())
                .map(|m| without(self.setting, &best, m).0)
                .collect();
            self.extend(&smaller, 4, LEAST_GAIN);
            self.extend(std::slice::from_ref(&best.set), WIDTH, LEAST_GAIN);
            self.replace(&best);
            self.rejoin(&best);
            self.elsewhere(&best);
            (self.progress)("exchange");
            let same = |b: &Fit| b.set == best.set && b.cost > best.cost - OTHER_MINIMUM;
            if self.best().is_some_and(same) {
                break;
            }
        }
    }

    /// What could stand in the place of each member, all else as it is: near twins are found so even
    /// where the set without the member, fitted, has drifted away.
    fn replace(&mut self, best: &Fit) {
        let mut jobs = Vec::new();
        let mut ways = BTreeSet::new();
        for member in 0..best.set.len() {
            let (set, at) = without(self.setting, best, member);
            let gap = Fit {
                set,
                at,
                ..best.clone()
            };
            let view = View::new(self.setting, &self.weights, &gap);
            let found = view.promises(&self.bank, &self.whitened, &gap.set);
            let own = best.set[member];
            let top = found.first().map_or(0.0, |l| l[0].gain);
            for list in found
                .iter()
                .filter(|l| l[0].candidate != own && !self.blind.contains(&l[0].candidate))
                .take_while(|l| l[0].gain > top - NEAR_TWIN - 0.02 * top)
                .take(REPLACED)
            {
                let point = self.begin(&gap, &list[0]);
                let job = joined(self.setting, &gap, list[0].candidate, &point);
                let change = top - list[0].gain;
                let way = Search::way(&job.0, best, list[0].start, change);
                if self.lacks(&way, best, Some(change)) {
                    ways.insert(way);
                    jobs.push(job);
                }
            }
        }
        self.ways.append(&mut ways);
        self.fit(jobs);
    }

    /// A member with several parameters may have come to do the work of two: each is taken out, a
    /// partner put in, and it joins again from wherever it then promises most.
    fn rejoin(&mut self, best: &Fit) {
        let mut jobs = Vec::new();
        for (member, candidate) in best.set.iter().enumerate() {
            if self.setting.vocabulary[*candidate].info.parameters.len() < 2 {
                continue;
            }
            let (smaller, _) = without(self.setting, best, member);
            let partners: Vec<Fit> = self
                .fits
                .values()
                .filter(|f| {
                    f.set.len() == best.set.len()
                        && !f.set.contains(candidate)
                        && smaller.iter().all(|c| f.set.contains(c))
                })
                .cloned()
                .collect();
            for fit in partners {
                let view = View::new(self.setting, &self.weights, &fit);
                let found = view.promises(&self.bank, &self.whitened, &fit.set);
                for p in found
                    .iter()
                    .flatten()
                    .filter(|p| p.candidate == *candidate)
                    .take(2)
                {
                    let point = self.begin(&fit, p);
                    jobs.push(joined(self.setting, &fit, p.candidate, &point));
                }
            }
        }
        self.fit(jobs);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::testing::{candidate, setting, surge};

    /// One at a time a search ends where no single step gains: the wrong one of two must be exchanged.
    #[test]
    fn a_wrong_member_is_exchanged_for_the_right_one() {
        let effects: [(&str, &[(&str, f64)]); 2] = [
            ("coulomb_friction", &[("f_n", 0.4)]),
            ("thruster_saturation", &[("limit_n", 5.0)]),
        ];
        let own = setting(&[surge(0, &effects), surge(1, &effects), surge(2, &effects)]);
        let [friction, limit, wrong] =
            ["coulomb_friction", "thruster_saturation", "battery_sag"].map(|e| candidate(&own, e));
        let mut search = Search::new(&own, &|_| {});
        search.nothing();
        search.singles();
        let single = search.finished(&[friction]).unwrap();
        let sag = search.finished(&[wrong]).unwrap().member(&own, 0).to_vec();
        search.fit(vec![joined(&own, &single, wrong, &sag)]);
        let mut pair = [friction, wrong];
        pair.sort_unstable();
        let before = search.get(&pair).unwrap().log_evidence;
        search.exchange();
        let best = search.best().unwrap();
        let mut right = [friction, limit];
        right.sort_unstable();
        assert!(right.iter().all(|c| best.set.contains(c)), "{:?}", best.set);
        assert!(best.log_evidence > before + 10.0);
        let member = best.set.iter().position(|c| *c == limit).unwrap();
        assert!((best.member(&own, member)[0] - 5.0).abs() < 0.3);
    }
}
