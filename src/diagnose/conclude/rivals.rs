//! Models with a term missing or a wrong one, refitted: what they lose is the proof of what was named.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::tables::rms;
use crate::bank::{joined, without};
use crate::explain::{GAINS, Windows, pieces};
use crate::fit::{Fit, Posed};
use crate::predict::{BETTER_T, Prediction, predicted};
use crate::search::Search;
use crate::setting::{COEFFICIENTS, Track};
use crate::verdict::{Alternative, Rung};

/// Members asked, heaviest first.
const MEMBERS: usize = 4;
/// Members in whose place kin are tried.
const REPLACED: usize = 2;
/// rms of the runs held out over that of the first set up to which another is as good.
const AS_GOOD: f64 = 1.1;
/// The same up to which it is, where the errors vary by as much.
const NOT_FAR: f64 = 1.5;
/// rms of the runs held out over the noise below which likelihoods decide.
const AT_NOISE: f64 = 1.5;
/// Starting points of a candidate that joins a set.
const STARTS: usize = 5;
/// Of the tolerance: what is lighter is not asked.
pub(super) const LIGHT: f64 = 0.25;

/// A refitted model.
#[derive(Debug, Clone)]
pub struct Rival {
    /// Its fit.
    pub fit: Fit,
    /// rms of the runs held out \[m, rad\].
    pub held: Option<f64>,
    /// The same with every error.
    missed: Option<Prediction>,
    /// (member of the first set, its kin that stands in its place).
    pub in_place: Option<(usize, usize)>,
}

/// A set, where its fits begin, and whose place is taken by which kin.
type Job = (Vec<usize>, Vec<Vec<f64>>, Option<(usize, usize)>);

/// The first set's rivals.
pub struct Rivals<'a> {
    search: &'a Search<'a>,
    first: &'a Fit,
    held: &'a [Track],
    /// The runs fitted in windows and the runs held out cut into them, where these are what effects are judged by.
    windows: Option<(Windows, Vec<Track>)>,
    /// Heavy members (candidates), heaviest first.
    heavy: Vec<usize>,
    /// Candidates that are asked in the place of each.
    also: Vec<usize>,
    made: BTreeMap<Vec<usize>, Rival>,
}

impl<'a> Rivals<'a> {
    /// Nothing; each heavy member alone; the set without each; the set with kin in their place.
    pub fn of(
        search: &'a Search<'a>,
        first: &'a Fit,
        shares: &[f64],
        held: &'a [Track],
    ) -> Rivals<'a> {
        let setting = search.setting;
        let mut heavy: Vec<(f64, usize)> = shares
            .iter()
            .copied()
            .zip(first.set.iter().copied())
            .filter(|(w, _)| *w > LIGHT * setting.tolerance)
            .collect();
        heavy.sort_by(|a, b| b.0.total_cmp(&a.0));
        heavy.truncate(MEMBERS);
        let mut rivals = Rivals {
            search,
            first,
            held,
            windows: None,
            heavy: heavy.into_iter().map(|h| h.1).collect(),
            also: Vec::new(),
            made: BTreeMap::new(),
        };
        let mut jobs: Vec<Job> = Vec::new();
        let heavy = rivals.heavy.clone();
        let all = first.set.clone();
        let mut parts = vec![Vec::new()];
        for h in &heavy {
            parts.push(vec![*h]);
            parts.push(all.iter().copied().filter(|c| c != h).collect());
        }
        for part in parts {
            let (set, at) = rivals.part(&part);
            jobs.push((set, vec![at], None));
        }
        for h in heavy.iter().take(REPLACED) {
            let member = all.iter().position(|c| c == h).unwrap_or(0);
            let (set, at) = without(setting, first, member);
            let gap = Fit {
                set,
                at,
                ..first.clone()
            };
            let info = setting.vocabulary[*h].info;
            for (other, kin) in setting.vocabulary.iter().enumerate() {
                let near = info.kin.contains(&kin.info.id) && kin.info.stage == info.stage;
                if !near || all.contains(&other) || search.blind.contains(&other) {
                    continue;
                }
                jobs.extend(rivals.joining(&gap, other, Some((*h, other))));
            }
        }
        rivals.fit(jobs);
        rivals
    }

    /// A set, and where its fits begin, with one candidate more.
    fn joining(&self, to: &Fit, candidate: usize, in_place: Option<(usize, usize)>) -> Option<Job> {
        let setting = self.search.setting;
        let begins: Vec<(Vec<usize>, Vec<f64>)> = setting.vocabulary[candidate]
            .starts
            .iter()
            .take(STARTS)
            .map(|p| joined(setting, to, candidate, p))
            .collect();
        let set = begins.first()?.0.clone();
        Some((set, begins.into_iter().map(|b| b.1).collect(), in_place))
    }

    /// Candidates that the ladder asks in the place of each of its rungs.
    pub fn beside(mut self, also: &[usize]) -> Self {
        self.also = also.to_vec();
        self
    }

    /// The ladder by what each effect gains in windows of the runs held out: where no law is exact, and nothing takes the
    /// vehicle back to its place, a small force adds up to more than a large one that changes its sign.
    pub fn in_windows(mut self) -> Self {
        self.windows = Some((Windows::of(self.search), pieces(self.held)));
        self
    }

    /// Those of the first set's members that are in `keep`, and where their fit begins.
    fn part(&self, keep: &[usize]) -> (Vec<usize>, Vec<f64>) {
        let mut now = self.first.clone();
        while let Some(member) = now.set.iter().position(|c| !keep.contains(c)) {
            (now.set, now.at) = without(self.search.setting, &now, member);
        }
        (now.set, now.at)
    }

    fn fit(&mut self, mut jobs: Vec<Job>) {
        let search = self.search;
        let setting = search.setting;
        jobs.retain(|j| !self.made.contains_key(&j.0));
        let made: Vec<(Vec<usize>, Rival)> = jobs
            .into_par_iter()
            .filter_map(|(set, begins, in_place)| {
                let known = search.get(&set).filter(|f| !f.rough).cloned();
                let fitted = known.or_else(|| {
                    begins
                        .into_iter()
                        .filter_map(|at| Posed::new(setting, &search.weights, &set).fit(at).ok())
                        .min_by(|a, b| a.cost.total_cmp(&b.cost))
                })?;
                if in_place.is_some() && !fitted.confounded(setting).is_empty() {
                    return None;
                }
                let missed = predicted(setting, self.held, &fitted, search.weights.noise);
                let rival = Rival {
                    fit: fitted,
                    held: missed.as_ref().map(|m| m.rms),
                    missed,
                    in_place,
                };
                Some((set, rival))
            })
            .collect();
        self.made.extend(made);
    }

    /// The runs held out, predicted as effects are judged here: whole, or in windows with what was fitted in windows.
    fn predicts(&self, fit: &Fit) -> Option<Prediction> {
        let (setting, noise) = (self.search.setting, self.search.weights.noise);
        let Some((windows, pieces)) = &self.windows else {
            return predicted(setting, self.held, fit, noise);
        };
        // A fit of whole runs may have run off; the numbers of the first set had not.
        let mut begins = vec![fit.globals(setting).to_vec()];
        if fit.set.iter().all(|c| self.first.set.contains(c)) {
            let (set, at) = self.part(&fit.set);
            begins.push(at[..COEFFICIENTS + setting.parameters(&set)].to_vec());
        }
        let fit = begins
            .iter()
            .filter_map(|b| windows.fit(&fit.set, b))
            .min_by(|a, b| a.cost.total_cmp(&b.cost))?;
        predicted(setting, pieces, &fit, noise)
    }

    /// rms of windows of the runs held out \[m, rad\]; `None` where effects are not judged by them.
    fn rms_in_windows(&self, r: &Rival) -> Option<f64> {
        self.windows.as_ref()?;
        self.predicts(&r.fit).map(|p| p.rms)
    }

    /// Kin that, in the place of a member, predict the runs held out as well: which of the two laws it is
    /// these data leave open, whatever their likelihoods say where no law reaches the noise.
    pub fn undecided(&self) -> Vec<String> {
        let search = self.search;
        let id = |c: usize| search.setting.vocabulary[c].info.id;
        let Some(best) = self.predicts(self.first) else {
            return Vec::new();
        };
        let own = best.rms;
        if own < AT_NOISE * search.weights.noise.total_sd() {
            return Vec::new();
        }
        self.made
            .values()
            .filter_map(|r| {
                let in_place = r.in_place?;
                let missed = match &self.windows {
                    Some(_) => self.predicts(&r.fit)?,
                    None => r.missed.clone()?,
                };
                Some((in_place, missed))
            })
            // As good, or worse by no more than the errors vary.
            .filter(|(_, missed)| {
                missed.rms < AS_GOOD * own
                    || (missed.rms < NOT_FAR * own && best.better_than(missed) < BETTER_T)
            })
            .map(|((member, kin), missed)| {
                let held = missed.rms;
                format!(
                    "{} or {}: not decided, the runs held out are predicted to {own:.2e} and {held:.2e} rms",
                    id(member),
                    id(kin)
                )
            })
            .collect()
    }

    /// As alternatives of the verdict, best first.
    pub fn alternatives(&self, probability: f64) -> Vec<Alternative> {
        let setting = self.search.setting;
        let channel = setting.channel();
        let mut all: Vec<Alternative> = self
            .made
            .values()
            .map(|r| {
                let below = r.fit.log_evidence - self.first.log_evidence;
                Alternative {
                    effects: names(self.search, &r.fit.set),
                    log_evidence: below,
                    probability: probability * below.exp().min(1.0),
                    train: BTreeMap::from([(channel.to_owned(), rms(self.search, &r.fit))]),
                    held_out: r
                        .held
                        .map(|v| (channel.to_owned(), v))
                        .into_iter()
                        .collect(),
                }
            })
            .collect();
        all.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
        all
    }

    /// The heavy members one after the other, each time the one that gains most in prediction (in the
    /// runs fitted where none are held out).
    pub fn ladder(&mut self) -> Vec<Rung> {
        if self.heavy.is_empty() {
            return Vec::new();
        }
        let search = self.search;
        let channel = search.setting.channel();
        let id = |c: usize| search.setting.vocabulary[c].info.id;
        let no_runs = self.held.is_empty();
        // A prediction that failed is no prediction, not a good fit.
        let by_windows = self.windows.is_some();
        let miss = |r: &Rival, there: Option<f64>| match if by_windows { there } else { r.held } {
            Some(held) => held,
            None if no_runs => rms(search, &r.fit),
            None => f64::INFINITY,
        };
        let rung = |effect: &str, r: &Rival, there: Option<f64>| {
            let of = |v: Option<f64>| v.map(|v| (channel.to_owned(), v)).into_iter().collect();
            Rung {
                effect: effect.to_owned(),
                train: of(Some(rms(search, &r.fit))),
                held_out: of(r.held),
                held_out_in_windows: of(there),
                instead: BTreeMap::new(),
            }
        };
        let mut rungs: Vec<Rung> = self
            .made
            .get(&Vec::new())
            .map(|r| rung("", r, self.rms_in_windows(r)))
            .into_iter()
            .collect();
        let mut now: Vec<usize> = Vec::new();
        let mut left = self.heavy.clone();
        let mut below = self
            .made
            .get(&now)
            .map_or(f64::INFINITY, |r| miss(r, self.rms_in_windows(r)));
        while !left.is_empty() {
            let grown = |c: usize| -> Vec<usize> { now.iter().copied().chain([c]).collect() };
            let jobs = left
                .iter()
                .map(|c| {
                    let (set, at) = self.part(&grown(*c));
                    (set, vec![at], None)
                })
                .collect();
            self.fit(jobs);
            let best = left
                .iter()
                .filter_map(|c| {
                    let (set, _) = self.part(&grown(*c));
                    let rival = self.made.get(&set)?;
                    Some((*c, rival, self.rms_in_windows(rival)))
                })
                .min_by(|a, b| miss(a.1, a.2).total_cmp(&miss(b.1, b.2)));
            let Some((c, r, there)) = best else { break };
            let mut made = rung(id(c), r, there);
            let reached = miss(r, there);
            let others: Vec<usize> = left.iter().copied().filter(|l| *l != c).collect();
            let base = self.made.get(&self.part(&now).0).map(|r| r.fit.clone());
            let asked: Vec<(usize, Job)> = self
                .also
                .iter()
                .filter_map(|other| Some((*other, self.joining(base.as_ref()?, *other, None)?)))
                .collect();
            let sets: Vec<(usize, Vec<usize>)> = asked
                .iter()
                .map(|(other, job)| (*other, job.0.clone()))
                .chain(others.iter().map(|o| (*o, self.part(&grown(*o)).0)))
                .collect();
            self.fit(asked.into_iter().map(|a| a.1).collect());
            made.instead = sets
                .into_iter()
                .filter_map(|(other, set)| {
                    let rival = self.made.get(&set)?;
                    let held = miss(rival, self.rms_in_windows(rival));
                    (held < GAINS * below).then(|| (id(other).to_owned(), held))
                })
                .collect();
            below = reached;
            rungs.push(made);
            now.push(c);
            left.retain(|l| *l != c);
        }
        rungs
    }
}

/// Ids of a set.
pub fn names(search: &Search<'_>, set: &[usize]) -> Vec<String> {
    set.iter()
        .map(|c| search.setting.vocabulary[*c].info.id.to_owned())
        .collect()
}
