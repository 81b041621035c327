//! Findings of the light as part of the verdict: effects, sets that tie, light of no known effect.

use super::fit::{LightFit, SIZES};
use super::search::Looked;
use crate::verdict::ESTABLISHED;
use hydroline_rigs::PhysicsEntry;
use hydroline_sim::effect::{CheckedEffect, EffectInfo};

/// Probability from which an effect is listed.
const LISTED: f64 = 0.5;

/// An effect that lights the picture.
#[derive(Debug, Clone)]
pub struct LightEffect {
    /// The effect with its numbers.
    pub effect: CheckedEffect,
    /// sd of each number.
    pub sds: Vec<f64>,
    /// Probability over all models visited.
    pub probability: f64,
    /// Effects that do as well in its place.
    pub or: Vec<String>,
}

impl LightEffect {
    /// The effect.
    pub fn info(&self) -> &'static EffectInfo {
        self.effect.info
    }

    /// Whether it goes into a rig.
    pub fn established(&self) -> bool {
        self.probability >= ESTABLISHED
    }

    /// Entry for a rig file.
    pub fn entry(&self) -> PhysicsEntry {
        self.effect.entry()
    }
}

impl Looked<'_> {
    fn ids(&self, fit: &LightFit) -> Vec<String> {
        let id = |t: &usize| self.data.candidates[*t].info.id.to_owned();
        let mut ids: Vec<String> = fit.terms.iter().map(id).collect();
        ids.sort();
        ids
    }

    /// Sets of effects within one in a hundred of the likeliest, that one first, none containing another.
    pub fn tied(&self) -> Vec<Vec<String>> {
        let best = self.best();
        let mut sets = vec![self.ids(best)];
        let close = |f: &&LightFit| f.ln_score > best.ln_score - self.data.options.worth;
        for fit in self.models.iter().filter(close) {
            let ids = self.ids(fit);
            let inside = |a: &[String], b: &[String]| a.iter().all(|x| b.contains(x));
            if !sets.iter().any(|s| inside(s, &ids) || inside(&ids, s)) {
                sets.push(ids);
            }
        }
        sets
    }

    /// Effects of the likeliest model that are more likely there than not.
    pub fn effects(&self) -> Vec<LightEffect> {
        let best = self.best();
        let tied = self.tied();
        let own = &tied[0];
        let mut out = Vec::new();
        for (k, t) in best.terms.iter().enumerate() {
            let c = &self.data.candidates[*t];
            let probability = self.probability(c.info.id);
            let rest = || own.iter().filter(|o| *o != c.info.id);
            let instead = |s: &&Vec<String>| s.len() == own.len() && rest().all(|r| s.contains(r));
            let or = tied[1..].iter().filter(instead);
            let or: Vec<String> = or
                .flat_map(|s| s.iter().filter(|o| !own.contains(o)).cloned())
                .collect();
            if probability > LISTED || !or.is_empty() {
                out.push(LightEffect {
                    effect: c.effect(&best.numbers[k]),
                    sds: best.sds[k].clone(),
                    probability,
                    or,
                });
            }
        }
        out
    }

    /// Light that no effect of the library makes: in words; `None` where there is none worth a word.
    pub fn unnamed(&self) -> Option<String> {
        let o = &self.data.options;
        let state = &self.best().state;
        let uncertain = self.data.uncertain(&state.nuisance);
        // The polynomials' own mean squares are below one: an upper bound, and near it for the lowest.
        let rms = |x: &[f64]| x.iter().map(|v| v * v).sum::<f64>().sqrt();
        let (gain, ambient) = (rms(&uncertain.gain), rms(&uncertain.ambient));
        let mut words = Vec::new();
        if gain > o.unnamed.0 && SIZES[state.sizes[0]] > 1.0 {
            words.push(format!(
                "the line's brightness varies by {:.1} % over the image",
                100.0 * gain
            ));
        }
        if ambient > o.unnamed.1 && SIZES[state.sizes[1]] > 1.0 {
            words.push(format!(
                "the background varies by {ambient:.1} grey levels over the image"
            ));
        }
        for (on_line, what) in [(false, "of the background"), (true, "across the stripe")] {
            let own = || self.best().left.iter().filter(|l| l.on_line == on_line);
            let strays = own().map(|l| 1.0 - l.belongs).sum::<f64>() / own().count().max(1) as f64;
            if strays > o.strays {
                words.push(format!(
                    "{:.0} % of what was read {what} is something else",
                    100.0 * strays
                ));
            }
        }
        (!words.is_empty()).then(|| words.join("; "))
    }

    /// Whether nothing that has a name lights the picture.
    pub fn nothing_found(&self) -> bool {
        self.best().terms.is_empty()
    }
}
