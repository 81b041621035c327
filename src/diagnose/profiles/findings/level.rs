//! Light and profiles together, as findings.

use super::super::anytime::Anytime;
use super::super::candidate::Candidate;
use super::super::fit::{Fitted, Problem};
use super::super::observe::ImageRun;
use super::super::picture;
use super::super::search::{Searched, visibility};
use super::effects::{effect, entry, heaviness, instead};
use super::figures::{held_out, noise, rms, worst};
use super::{Alternative, Effect, Findings, FitTable, ImageError, Lit, Word};
use crate::verdict::BeforeAfter;
use hydroline_rigs::{PhysicsEntry, Rig};
use std::collections::{BTreeMap, BTreeSet};

/// Mean residual of a part of the image that no explanation takes away \[px\], and in its own sds.
const UNEXPLAINED_PX: f64 = 0.08;
const UNEXPLAINED_SDS: f64 = 6.0;
/// Log Bayes factor expected of an effect of typical size, below which these frames cannot show it \[nat\].
const BLIND: f64 = 3.0;
/// Sets that tie, shown at most.
const SETS: usize = 6;
/// Alternatives shown at most.
const ALTERNATIVES: usize = 8;

/// Results of the search and of the light, with the frames and the problem behind them.
pub(super) struct Level<'a> {
    pub rig: &'a Rig,
    /// The frames as they were logged.
    pub raw: &'a [ImageRun],
    pub problem: &'a Problem<'a>,
    pub candidates: &'a [Candidate],
    pub found: &'a Searched,
    pub lit: &'a Lit<'a>,
}

impl Level<'_> {
    pub fn findings(&self, asked: &Anytime<'_>) -> Result<Findings, ImageError> {
        let (found, best) = (self.found, self.found.best());
        let (effects, entries) = self.effects();
        let equivalent = self.equivalent(&effects);
        let (worst, part) = worst(&found.nothing, best, self.rig);
        let unexplained = worst[1].0 > UNEXPLAINED_PX && worst[1].1 > UNEXPLAINED_SDS;
        let unnamed = self.lit.unnamed();
        let word = if unexplained || unnamed.is_some() {
            Word::Unknown
        } else if !effects.iter().any(|e| e.matters) {
            Word::None
        } else if equivalent.is_empty() {
            Word::Named
        } else {
            Word::Ambiguous
        };
        let frames: usize = self.problem.runs.iter().map(|r| r.frames.len()).sum();
        let mut notes = vec![format!(
            "image level: {frames} frames of {} run(s)",
            self.problem.runs.len()
        )];
        notes.extend(self.raw.iter().flat_map(ImageRun::remarks));
        if unexplained {
            notes.push(format!(
                "no effect of the library takes away {:.2} px about {part}",
                worst[1].0
            ));
        }
        if let Some(words) = &unnamed {
            notes.push(format!(
                "light that no effect of the library makes: {words}"
            ));
        }
        asked.tell("frames held out");
        let fit = FitTable {
            train: BeforeAfter {
                before: rms(&found.nothing),
                after: rms(best),
                noise: noise(best),
            },
            held_out: held_out(self.problem.runs, self.rig, self.candidates, found)?,
            held_out_by: "every other frame, its pose alone fitted".to_owned(),
        };
        let zero = Searched::score(&found.nothing);
        Ok(Findings {
            word,
            equivalent,
            entries,
            log_odds: Searched::score(best) - zero + self.lit.log_odds(),
            score_of_nothing: zero,
            fit,
            alternatives: self.alternatives(),
            blind_spots: self.blind_spots(),
            worst_px: [worst[0].0, worst[1].0],
            part,
            unnamed_light: unnamed,
            poses: (self.problem.runs.iter().zip(&best.state.poses))
                .map(|(r, p)| r.frames.iter().zip(p).map(|(f, p)| (f.t_s, *p)).collect())
                .collect(),
            section: picture::section(self.rig, &found.nothing, best, &effects),
            notes,
            sets_looked_at: found.all.len() + self.lit.visited(),
            cut: asked.cut(),
            effects,
        })
    }

    fn ids(&self, fit: &Fitted) -> Vec<String> {
        let id = |e: &usize| self.candidates[*e].info.id.to_owned();
        fit.effects.iter().map(id).collect()
    }

    /// Effects of the profiles and of the light, heaviest first; those that are established as entries for a rig.
    fn effects(&self) -> (Vec<Effect>, Vec<PhysicsEntry>) {
        let (found, best) = (self.found, self.found.best());
        let tied = found.tied();
        let moved = best.effects.iter().enumerate().map(|(k, e)| {
            let found = Effect {
                or: instead(self.candidates, best, &tied, *e),
                ..effect(self.problem, self.candidates, found, best, k, *e)
            };
            (
                found,
                entry(self.candidates[*e].info, &best.state.numbers[k]),
            )
        });
        let lit = self.lit.entries(self.raw, self.rig, self.candidates, best);
        let lit = lit
            .into_iter()
            .filter(|(e, _)| e.established || !e.or.is_empty());
        let mut all: Vec<(Effect, PhysicsEntry)> = moved.chain(lit).collect();
        all.sort_by(|a, b| heaviness(&b.0, self.rig).total_cmp(&heaviness(&a.0, self.rig)));
        all.into_iter().unzip()
    }

    /// Complete sets that tie: each of the profiles with each of the light; empty where one stands out or none matters.
    fn equivalent(&self, effects: &[Effect]) -> Vec<Vec<String>> {
        let moved: Vec<Vec<String>> = self.found.tied().iter().map(|f| self.ids(f)).collect();
        let lit = self.lit.tied();
        if moved.len() * lit.len() < 2 || !effects.iter().any(|e| e.matters) {
            return Vec::new();
        }
        let sets = moved
            .iter()
            .flat_map(|m| lit.iter().map(move |l| [m.as_slice(), l].concat()));
        sets.take(SETS).collect()
    }

    fn alternatives(&self) -> Vec<Alternative> {
        let (all, best) = (&self.found.all, self.found.best());
        let top = Searched::score(best);
        let of = |f: &Fitted| Alternative {
            effects: self.ids(f),
            log_evidence: Searched::score(f) - top,
            probability: (all.iter())
                .map(|o| (Searched::score(o) - Searched::score(f)).exp())
                .sum::<f64>()
                .recip(),
            train: BTreeMap::new(),
        };
        all.iter().take(ALTERNATIVES).map(of).collect()
    }

    /// Each once.
    fn blind_spots(&self) -> Vec<String> {
        let single = self.found.all.iter().filter(|f| f.effects.len() == 1);
        let blind = single.filter(|f| visibility(&self.candidates[f.effects[0]], f) < BLIND);
        let mut ids: Vec<String> = blind.flat_map(|f| self.ids(f)).collect();
        let mut seen = BTreeSet::new();
        ids.retain(|id| seen.insert(id.clone()));
        ids
    }
}
