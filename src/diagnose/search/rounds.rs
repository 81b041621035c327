//! The search's course: singles, pairs, the beam's rounds, and when it ends.

use super::super::bank::joined;
use super::super::explain::{Care, early, look, unnamed_from_nothing};
use super::super::fit::Fit;
use super::{LEAST_GAIN, Search, WIDTH};
use std::collections::BTreeSet;

/// Sets carried from one depth to the next.
const BEAM: usize = 5;
/// Most effects together.
const DEPTH: usize = 7;
/// Rounds without a better set after which the beam has done its work; exchange follows.
const IDLE: usize = 1;
/// A set this far below the best one in log evidence is out of the race.
const FAR: f64 = 12.0;
/// Half chi-square per sample above which a fit is far from the noise.
const HOPELESS: f64 = 1.0;
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
/// Log evidence that a free force must gain beside a set for the search to end.
const PLAINLY: f64 = 30.0;

impl Search<'_> {
    /// The whole search under the present weights: singles, pairs, then the beam, then exchange.
    pub fn run(&mut self) {
        if !self.fits.contains_key(&Vec::new()) {
            self.nothing();
        }
        let seeds: Vec<Vec<usize>> = self.fits.keys().cloned().collect();
        self.singles_and_pairs();
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

    /// The first two rounds, in which nothing is passed over that a linear view promises.
    fn singles_and_pairs(&mut self) {
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
    pub(super) fn unnamed_is_better(&mut self, alone: bool) -> bool {
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
}
