//! The search over models of the light: add, drop, swap, from a first look at few samples; marginals of all visited.

use super::candidate::{LightCandidate, library};
use super::equations::{Data, Left, State};
use super::fit::LightFit;
use super::options::LightOptions;
use super::samples::{frames, thinned};
use crate::profiles::anytime::Anytime;
use crate::profiles::candidate::Base;
use crate::profiles::geometry::Geometry;
use crate::profiles::observe::ImageRun;
use crate::verdict::ESTABLISHED;
use hydroline_inference::posterior::{Marginal, marginals};
use hydroline_inference::prior::PriorTable;
use hydroline_numerics::parallel;
use hydroline_rigs::Rig;
use hydroline_sim::effect::CheckedEffect;
use std::collections::{BTreeMap, BTreeSet};

/// Change of a floor that is worth another search.
const FLOOR_CHANGE: f64 = 1.25;
/// Extra sd of the samples at the first steps of a first look that begins far off \[grey levels\].
const NEAR_GREY: [f64; 1] = [5.0];
/// Gain of log score that is progress \[nat\].
const PROGRESS: f64 = 0.1;

/// Result of a look at the light.
pub struct Looked<'a> {
    pub(super) data: Data<'a>,
    /// Models visited, likeliest first.
    pub models: Vec<LightFit>,
    /// Probability of each candidate.
    pub marginals: Vec<Marginal>,
}

impl Looked<'_> {
    /// The likeliest model without what it could do without: each of its effects is worth what establishes one to the rest.
    pub fn best(&self) -> &LightFit {
        let odds = (ESTABLISHED / (1.0 - ESTABLISHED)).ln();
        let mut best = &self.models[0];
        loop {
            let simpler = self.models.iter().find(|f| {
                f.terms.len() < best.terms.len()
                    && f.terms.iter().all(|t| best.terms.contains(t))
                    && f.ln_score > best.ln_score - odds
            });
            match simpler {
                Some(simpler) => best = simpler,
                None => return best,
            }
        }
    }

    /// Effects that were asked.
    pub fn candidates(&self) -> &[LightCandidate] {
        &self.data.candidates
    }

    /// Probability that an effect lights the picture, in whatever way.
    pub fn probability(&self, id: &str) -> f64 {
        let of = |m: &&Marginal| self.data.candidates[m.candidate].info.id == id;
        self.marginals
            .iter()
            .filter(of)
            .map(|m| m.probability)
            .sum()
    }

    /// Log score of the model without effects over that of the likeliest, turned about \[nat\].
    pub fn log_odds(&self) -> f64 {
        let nothing = self.models.iter().find(|m| m.terms.is_empty());
        nothing.map_or(f64::INFINITY, |n| self.best().ln_score - n.ln_score)
    }
}

impl<'a> Looked<'a> {
    /// The model with these effects fitted from their numbers, and what each of them adds to the score \[nat\]; `None` where
    /// the frames do not show their light at all.
    pub fn known(
        runs: &[ImageRun],
        rig: &'a Rig,
        base: &'a Base,
        geometry: &Geometry,
        effects: &[CheckedEffect],
    ) -> Option<(Looked<'a>, Vec<f64>)> {
        let mut data = data(runs, rig, base, geometry)?;
        let mut state = data.first();
        for e in effects {
            let same = |c: &LightCandidate| c.info.id == e.info.id && c.words == e.words;
            let t = data.candidates.iter().position(same)?;
            let scales = data.candidates[t].scales.iter().zip(&e.numbers);
            state.terms.push(t);
            state
                .numbers
                .push(scales.map(|(s, v)| s.scaled(*v)).collect());
        }
        let mut visited = Visited::default();
        let first = visited.fit(&data, &state, 0)?;
        data.floors = floors(&data, &first.left);
        let best = data.fit(&first.state, data.options.steps.1)?;
        let gains = (0..effects.len()).map(|k| {
            let mut visited = Visited::default();
            let without = visited.fit(&data, &dropped(&best.state, k), 0);
            let score = best.ln_evidence + ln_prior(&data, &best.terms, 0);
            without.map_or(f64::INFINITY, |w| score - w.ln_score)
        });
        let gains = gains.collect();
        Some((
            Looked {
                data,
                models: vec![best],
                marginals: Vec::new(),
            },
            gains,
        ))
    }
}

/// Looks at the light of some runs; `others`: effects of the image level that do not light it. `None` where too few frames show it.
pub fn look<'a>(
    runs: &[ImageRun],
    rig: &'a Rig,
    base: &'a Base,
    geometry: &Geometry,
    others: usize,
    asked: &Anytime<'_>,
) -> Option<Looked<'a>> {
    searched(data(runs, rig, base, geometry)?, others, asked)
}

/// Data that all models are judged on; `None` where too few frames show the light.
fn data<'a>(
    runs: &[ImageRun],
    rig: &'a Rig,
    base: &'a Base,
    geometry: &Geometry,
) -> Option<Data<'a>> {
    let options = LightOptions::default();
    let frames = frames(runs, geometry, &options);
    if frames.len() < options.frames_least {
        return None;
    }
    let candidates = library(rig, base, &frames, &options);
    let even_target = (rig.target.iter())
        .flat_map(|t| &t.slabs)
        .all(|s| (s.albedo - 1.0).abs() < 1e-6);
    Some(Data {
        rig,
        base,
        frames,
        candidates,
        floors: [options.floor, options.floor_grey],
        options,
        even_target,
    })
}

fn searched<'a>(mut data: Data<'a>, others: usize, asked: &Anytime<'_>) -> Option<Looked<'a>> {
    let first = data.first();
    let mut visited = Visited::default();
    let nothing = visited.fit(&data, &first, others)?;
    let mut best = optimised(&data, nothing, others, &mut visited, asked)?;
    // Noise belongs to the instrument: found once beside the model that comes closest, the same for all.
    let floors = floors(&data, &best.left);
    let other = |(a, b): (&f64, &f64)| (a / b).max(b / a) > FLOOR_CHANGE;
    if floors.iter().zip(&data.floors).any(other) && !asked.is_over() {
        data.floors = floors;
        let states: Vec<State> = visited.near(&best, data.options.worth);
        visited = Visited::default();
        visited.fit(&data, &first, others)?;
        for state in states {
            visited.fit(&data, &state, others);
        }
        best = visited.best()?;
        optimised(&data, best, others, &mut visited, asked)?;
    }
    let mut models: Vec<LightFit> = visited.0.into_values().collect();
    models.sort_by(|a, b| b.ln_score.total_cmp(&a.ln_score));
    for m in models.iter().take(6) {
        let ids: Vec<&str> = m
            .terms
            .iter()
            .map(|t| data.candidates[*t].info.id)
            .collect();
        tracing::debug!(?ids, score = m.ln_score, numbers = ?m.numbers, sds = ?m.sds, sizes = ?m.state.sizes, nuisance = ?m.state.nuisance, floors = ?data.floors, "light");
    }
    let scored = models.iter().map(|m| (m.terms.clone(), m.ln_score));
    let (_, marginals) = marginals(scored.collect());
    Some(Looked {
        data,
        models,
        marginals,
    })
}

/// Models by their terms in order.
#[derive(Default)]
struct Visited(BTreeMap<Vec<usize>, LightFit>);

impl Visited {
    /// Fits a model and keeps the better of two fits of it.
    fn fit(&mut self, data: &Data<'_>, from: &State, others: usize) -> Option<LightFit> {
        let mut fit = data.fit(from, data.options.steps.1)?;
        fit.ln_score = fit.ln_evidence + ln_prior(data, &fit.terms, others);
        let mut key = fit.terms.clone();
        key.sort_unstable();
        let kept = self.0.entry(key).or_insert_with(|| fit.clone());
        if fit.ln_score > kept.ln_score {
            *kept = fit;
        }
        Some(kept.clone())
    }

    fn knows(&self, terms: &[usize]) -> bool {
        let mut key = terms.to_vec();
        key.sort_unstable();
        self.0.contains_key(&key)
    }

    fn best(&self) -> Option<LightFit> {
        let all = self.0.values();
        all.max_by(|a, b| a.ln_score.total_cmp(&b.ln_score))
            .cloned()
    }

    /// States of models that may still be the likeliest once the noise is another.
    fn near(&self, best: &LightFit, worth: f64) -> Vec<State> {
        let close = |f: &&LightFit| f.ln_score > best.ln_score - 4.0 * worth;
        self.0
            .values()
            .filter(close)
            .map(|f| f.state.clone())
            .collect()
    }
}

/// Log prior odds of a set of effects, by the motion level's table.
fn ln_prior(data: &Data<'_>, terms: &[usize], others: usize) -> f64 {
    let ids: BTreeSet<&str> = data.candidates.iter().map(|c| c.info.id).collect();
    let places = |id: &str| data.candidates.iter().filter(|c| c.info.id == id).count();
    let table = PriorTable::default();
    let one = |t: &usize| {
        table.ln_odds_of_effect(ids.len() + others, places(data.candidates[*t].info.id))
    };
    terms.iter().map(one).sum()
}

/// Stepwise from a model until no move gains.
fn optimised(
    data: &Data<'_>,
    from: LightFit,
    others: usize,
    visited: &mut Visited,
    asked: &Anytime<'_>,
) -> Option<LightFit> {
    let few = few(data);
    let mut best = from;
    for _ in 0..2 * data.options.effects {
        if asked.is_over() {
            break;
        }
        asked.tell("light of the picture");
        let gaining = gaining_starts(&few, &best);
        let mut moves: Vec<State> = Vec::new();
        if best.terms.len() < data.options.effects {
            moves.extend(gaining.iter().map(|p| added(&best.state, p)));
        }
        for k in 0..best.terms.len() {
            let dropped = dropped(&best.state, k);
            moves.extend(
                gaining
                    .iter()
                    .take(data.options.swaps)
                    .map(|p| added(&dropped, p)),
            );
            moves.push(dropped);
        }
        moves.retain(|m| !visited.knows(&m.terms));
        let mut any = false;
        for state in moves {
            if asked.is_over() {
                break;
            }
            any |= visited.fit(data, &state, others).is_some();
        }
        let found = visited.best()?;
        if !any || found.ln_score < best.ln_score + PROGRESS {
            return Some(found);
        }
        best = found;
    }
    Some(best)
}

/// A candidate with numbers to begin from.
type Start = (usize, Vec<f64>);

fn added(state: &State, (term, numbers): &Start) -> State {
    let mut state = state.clone();
    state.terms.push(*term);
    state.numbers.push(numbers.clone());
    state
}

fn dropped(state: &State, k: usize) -> State {
    let mut state = state.clone();
    state.terms.remove(k);
    state.numbers.remove(k);
    state
}

/// Starts that gain in a few steps on a few samples: the best of each candidate, most gaining first.
fn gaining_starts(few: &Data<'_>, best: &LightFit) -> Vec<Start> {
    let in_use = |c: &LightCandidate| {
        best.terms
            .iter()
            .any(|t| few.candidates[*t].info.id == c.info.id)
    };
    let tries: Vec<Start> = (few.candidates.iter().enumerate())
        .filter(|(_, c)| !in_use(c))
        .flat_map(|(t, c)| {
            let scaled =
                |s: &Vec<f64>| s.iter().zip(&c.scales).map(|(v, k)| k.scaled(*v)).collect();
            c.starts
                .iter()
                .map(move |s| (t, scaled(s)))
                .collect::<Vec<Start>>()
        })
        .collect();
    let Some(now) = few.fit(&best.state, few.options.steps.0) else {
        return Vec::new();
    };
    let found = parallel::map_slice(&tries, |start| {
        let fit = few.fit_from(&added(&now.state, start), few.options.steps.0, &NEAR_GREY)?;
        let numbers = fit.state.numbers.last()?.clone();
        Some((fit.ln_evidence - now.ln_evidence, (start.0, numbers)))
    });
    let mut found: Vec<(f64, Start)> = found.into_iter().flatten().collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut seen = BTreeSet::new();
    found.retain(|(gain, (t, _))| {
        // On a few samples a gain is less, too.
        *gain > -few.options.worth && seen.insert(*t)
    });
    found.truncate(few.options.additions);
    found.into_iter().map(|f| f.1).collect()
}

/// The same on a few of the samples.
fn few<'a>(data: &Data<'a>) -> Data<'a> {
    Data {
        rig: data.rig,
        base: data.base,
        frames: thinned(&data.frames, data.options.few),
        candidates: data.candidates.clone(),
        options: data.options,
        floors: data.floors,
        even_target: data.even_target,
    }
}

/// Scatter of the samples beyond their noise: across the stripe over its brightness, and in the background \[grey levels\].
fn floors(data: &Data<'_>, left: &[Left]) -> [f64; 2] {
    let of = |on_line: bool| {
        let mut sums = (0.0, 0.0);
        for l in left
            .iter()
            .filter(|l| l.on_line == on_line && l.belongs > 0.5)
        {
            // Where the stripe is faint its shape is not seen.
            let bright = if on_line { l.scale * l.scale } else { 1.0 };
            sums.0 += l.off * l.off - l.noise;
            sums.1 += bright;
        }
        (sums.0 / f64::max(sums.1, 1.0)).max(0.0).sqrt()
    };
    let o = &data.options;
    [
        of(true).max(0.25 * o.floor),
        of(false).max(0.2 * o.floor_grey),
    ]
}
