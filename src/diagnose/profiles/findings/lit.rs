//! The light of some runs under one geometry, and the frames without what lights them.

use super::super::anytime::Anytime;
use super::super::candidate::{Base, Candidate};
use super::super::fit::{Fitted, Free, State};
use super::super::geometry::Geometry;
use super::super::light::{LightEffect, Looked, look};
use super::super::observe::ImageRun;
use super::super::search::ANY_PX;
use super::effects::described;
use super::problem;
use crate::verdict::Effect;
use hydroline_rigs::{PhysicsEntry, Rig};

/// Weight of an effect with which frames have no stripe at all: as good as any \[m\], \[rad\].
const LOST: f64 = 1.0;

/// Light of some runs.
pub struct Lit<'a> {
    looked: Option<Looked<'a>>,
    geometry: Geometry,
    base: &'a Base,
    /// The frames without what lights them.
    pub runs: Vec<ImageRun>,
}

impl<'a> Lit<'a> {
    /// Looks at the light; `others`: effects of the image level that do not light it.
    pub fn new(
        runs: &[ImageRun],
        rig: &'a Rig,
        base: &'a Base,
        geometry: Geometry,
        others: usize,
        asked: &Anytime<'_>,
    ) -> Lit<'a> {
        let looked = look(runs, rig, base, &geometry, others, asked);
        let without = looked.as_ref().filter(|l| !l.nothing_found());
        let without = without.and_then(|l| l.removed(runs, &geometry, None));
        Lit {
            looked,
            geometry,
            base,
            runs: without.unwrap_or_else(|| runs.to_vec()),
        }
    }

    /// Effects that light the picture.
    pub fn effects(&self) -> Vec<LightEffect> {
        self.looked
            .as_ref()
            .map(Looked::effects)
            .unwrap_or_default()
    }

    /// Their names.
    pub fn ids(&self) -> Vec<&'static str> {
        self.effects().iter().map(|e| e.info().id).collect()
    }

    /// Sets that tie; one where nothing does.
    pub fn tied(&self) -> Vec<Vec<String>> {
        self.looked
            .as_ref()
            .map_or_else(|| vec![Vec::new()], Looked::tied)
    }

    /// Light without a name, in words.
    pub fn unnamed(&self) -> Option<String> {
        self.looked.as_ref().and_then(Looked::unnamed)
    }

    /// Log odds of the likeliest model over an even light \[nat\].
    pub fn log_odds(&self) -> f64 {
        self.looked.as_ref().map_or(0.0, Looked::log_odds)
    }

    /// Models visited.
    pub fn visited(&self) -> usize {
        self.looked.as_ref().map_or(0, |l| l.models.len())
    }

    /// The effects as entries of the verdict: how far each moves the poses that `best` gives, where it stays in the picture.
    pub fn entries(
        &self,
        raw: &[ImageRun],
        rig: &Rig,
        candidates: &[Candidate],
        best: &Fitted,
    ) -> Vec<(Effect, PhysicsEntry)> {
        (self.effects().into_iter())
            .map(|e| {
                let moved = self.moved(&e, raw, rig, candidates, best);
                let numbers = &e.effect.numbers;
                let lost = moved.is_none();
                let moved = moved.unwrap_or([LOST; 6]);
                let mut effect = described(rig, e.info(), numbers, &e.sds, moved, e.probability);
                effect.or = e.or.clone();
                for (word, k) in e.info().words.iter().zip(&e.effect.words) {
                    effect
                        .words
                        .insert(word.name.to_owned(), word.allowed[*k].to_owned());
                }
                if lost {
                    effect
                        .notes
                        .push("with it in the picture the frames give no poses".to_owned());
                }
                (effect, e.entry())
            })
            .collect()
    }

    /// rms by which the poses move with one effect left in the picture; `None` where the frames give none then.
    fn moved(
        &self,
        e: &LightEffect,
        raw: &[ImageRun],
        rig: &Rig,
        candidates: &[Candidate],
        best: &Fitted,
    ) -> Option<[f64; 6]> {
        let looked = self.looked.as_ref()?;
        let runs = looked.removed(raw, &self.geometry, Some(e.info().id))?;
        let clear = super::moving(&self.runs);
        // Frames of both, by their times.
        let mut common = Vec::new();
        let mut poses = Vec::new();
        for (run, (clear, own)) in super::moving(&runs)
            .into_iter()
            .zip(clear.iter().zip(&best.state.poses))
        {
            let at = |t_s: f64| clear.frames.iter().position(|f| f.t_s == t_s);
            let (frames, places): (Vec<_>, Vec<_>) = run
                .frames
                .iter()
                .filter_map(|f| Some((f.clone(), *own.get(at(f.t_s)?)?)))
                .unzip();
            if frames.len() < 2 || 2 * frames.len() < clear.frames.len() {
                return None;
            }
            common.push(ImageRun { frames, ..run });
            poses.push(places);
        }
        let problem = problem(&common, rig, self.base.clone()).ok()?;
        let begin = State {
            poses,
            // To begin with nothing passes for stray.
            floors: ANY_PX,
            ..best.state.clone()
        };
        let fit = problem.fit(candidates, &best.effects, begin.clone(), Free::All)?;
        Some(super::effects::shift(&fit.state, &begin))
    }
}
