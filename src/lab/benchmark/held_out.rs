//! Runs held out: whether a verdict says which of them it does not predict, and what they have that those fitted lack.
//!
//! A run *missed* is driven as none of those fitted was (loads three times as large, or faster), of a vehicle with a mechanism
//! that they do not show or with a law that is not the library's. Such cases are drawn until the rig that the diagnosis writes
//! misses the true motion by five times the run's noise and what that rig's numbers leave open. A run *inside* stays within the loads and frequencies of those
//! fitted, of a vehicle whose effects the diagnosis has all found. Every third case is coupled, the others have one DOF.

mod coupled;
mod make;
mod surge;
mod words;

pub use make::{Beyond, Held, HeldOutCase, Kind, Miss, make};
pub use words::{HeldOutScore, complaint, score, words};

use std::collections::BTreeSet;

use hydroline_core::run::Channel;
use hydroline_diagnose::diagnose;
use hydroline_diagnose::verdict::{Effect, Verdict, Word};

use super::cache::Kept;
use super::coupled::named;
use super::error::ProveError;

/// Miss of the true motion, over the run's noise and over that with what the numbers leave open, from which a verdict has to say it.
pub const MISSED: f64 = 5.0;
/// Diagnoses before a case is left as it was drawn last: each takes half a minute to a minute.
const DIAGNOSES: usize = 4;
/// Probability from which an effect that is there counts as found.
const FOUND: f64 = 0.5;

/// A case after its diagnosis.
#[derive(Debug, Clone, serde::Serialize, schemars::JsonSchema, serde::Deserialize)]
pub struct HeldOutJudged {
    /// Index of the case.
    pub index: usize,
    /// Surge, sway and yaw driven at once; else surge alone.
    pub is_coupled: bool,
    /// Whether the run held out is to be missed, or lies inside.
    pub kind: Kind,
    /// Quantity in which the run held out goes beyond those fitted, by its making; absent = in none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub beyond: Option<Beyond>,
    /// Effects and laws that are there.
    pub there: Vec<String>,
    /// The verdict's word.
    pub word: Word,
    /// The verdict's sentence.
    pub sentence: String,
    /// Whether the verdict has all effects that are there.
    pub is_complete: bool,
    /// Miss of the true motion by the rig that the diagnosis writes, in the channel where it is largest, over the run's noise; absent = that
    /// rig gives no finite motion.
    pub miss_over_noise: Option<f64>,
    /// That channel.
    pub channel: String,
    /// sd of the motion that the sds of the rig's coefficients leave open there, over the noise.
    pub open_over_noise: f64,
    /// rms that the likeliest model leaves of the run by the verdict's own table, in the channel where it is largest, over the noise; absent = the
    /// verdict has none.
    pub left_over_noise: Option<f64>,
    /// The run is in `contradicted_by`.
    pub is_said: bool,
    /// Quantities that it is said to have beyond those fitted.
    pub named: BTreeSet<Beyond>,
    /// The same in the verdict's words, and its probability; empty = it is not said.
    pub outside: String,
    /// Diagnoses made, each of a new draw.
    pub diagnoses: usize,
    /// Seconds of the last of them; not part of what is reproducible.
    pub seconds: f64,
}

impl HeldOutJudged {
    /// Whether the case is what its kind asks for: a run that is missed, or a complete model.
    pub fn counts(&self) -> bool {
        match self.kind {
            // The rig that is written lacks what is not established: the likeliest model has to miss too. What the numbers leave open
            // contradicts nothing.
            Kind::Missed => {
                let expected = self.open_over_noise.hypot(1.0);
                self.miss_over_noise.is_none_or(|m| m >= MISSED * expected)
                    && self.left_over_noise.is_none_or(|m| m >= MISSED)
            }
            Kind::Inside => self.is_complete,
        }
    }

    /// Whether the verdict is right: a run that is missed is said with what it has beyond those fitted, one inside is not said.
    pub fn is_right(&self) -> bool {
        match self.kind {
            Kind::Missed => self.is_said && self.beyond.is_none_or(|b| self.named.contains(&b)),
            Kind::Inside => !self.is_said,
        }
    }
}

/// Makes, diagnoses and scores cases one after the other, each on all cores; `done` is called with each. With `kept`, a case
/// that lies there is not run again, and each that was run is laid there.
///
/// # Errors
/// [`ProveError`].
pub fn run(
    seed: u64,
    indices: &[usize],
    kept: Option<&Kept>,
    done: &(dyn Fn(&HeldOutJudged) + Sync),
) -> Result<Vec<HeldOutJudged>, ProveError> {
    let one = |index: &usize| -> Result<HeldOutJudged, ProveError> {
        let judged = Kept::or_run(kept, &format!("held_out-{index}"), || {
            Ok(draw_and_judge(seed, *index)?.0)
        })?;
        done(&judged);
        Ok(judged)
    };
    indices.iter().map(one).collect()
}

/// Draws and diagnoses a case until it is what its kind asks for; the verdict beside it.
///
/// # Errors
/// [`ProveError`].
pub fn draw_and_judge(seed: u64, index: usize) -> Result<(HeldOutJudged, Verdict), ProveError> {
    let mut draw = 0;
    loop {
        let (mut judged, verdict) = judge(&make(seed, index, draw)?)?;
        draw += 1;
        judged.diagnoses = draw;
        if judged.counts() || draw == DIAGNOSES {
            return Ok((judged, verdict));
        }
    }
}

/// Diagnoses a drawn case blind, and opens the key.
///
/// # Errors
/// [`ProveError`].
pub fn judge(case: &HeldOutCase) -> Result<(HeldOutJudged, Verdict), ProveError> {
    let began = std::time::Instant::now();
    let held = std::slice::from_ref(&case.held.source);
    let made = diagnose(&case.sources, held, &case.rig, &|_| {}).map_err(|source| {
        ProveError::Diagnose {
            id: format!("held_out-{}", case.index),
            source,
        }
    })?;
    let seconds = began.elapsed().as_secs_f64();
    let verdict = made.verdict;
    let numbers = &verdict.parameters.written;
    let miss = case.held.missed_by(&made.rig, numbers, case.is_coupled)?;
    let said = verdict
        .contradicted_by
        .iter()
        .find(|c| c.log == case.held.source.run.name);
    let outside = said.map_or_else(String::new, |c| {
        format!("{} (p = {:.1e})", c.outside, c.p_value)
    });
    let judged = HeldOutJudged {
        index: case.index,
        is_coupled: case.is_coupled,
        kind: case.kind,
        beyond: case.beyond,
        there: case.there.clone(),
        word: verdict.verdict,
        sentence: verdict.sentence.clone(),
        is_complete: case.there.iter().all(|t| is_found(&verdict, t)),
        miss_over_noise: miss.over_noise,
        channel: miss.channel.name().to_owned(),
        open_over_noise: miss.open_over_noise,
        left_over_noise: left_over_noise(&verdict, &case.held),
        is_said: said.is_some(),
        named: said.map_or_else(BTreeSet::new, |c| Beyond::named_in(&c.outside)),
        outside,
        diagnoses: 1,
        seconds,
    };
    Ok((judged, verdict))
}

/// rms that the likeliest model leaves of the run held out, over the noise, in the channel where that is largest.
fn left_over_noise(verdict: &Verdict, held: &Held) -> Option<f64> {
    let after = verdict.fit.held_out.after.iter();
    let each = after.filter_map(|(c, rms)| Some(rms / held.noise[Channel::named(c)?]));
    each.filter(|v| v.is_finite()).reduce(f64::max)
}

/// Whether a verdict holds an effect, by its id or by its id with its words.
fn is_found(verdict: &Verdict, there: &str) -> bool {
    let of = |e: &&Effect| e.effect == there || named(&e.effect, &e.words) == there;
    let found = verdict.effects.iter().find(of);
    found.is_some_and(|e| e.probability >= FOUND)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A run at three times the loads under a limit that those fitted never reach is missed, said and named; one inside of what was
    /// fitted, of a vehicle that the rig describes, is not said.
    #[test]
    fn a_run_beyond_is_said_with_its_loads_and_one_inside_is_not() {
        let (missed, verdict) = judge(&make(1, 0, 0).unwrap()).unwrap();
        assert_eq!(
            (missed.kind, missed.beyond),
            (Kind::Missed, Some(Beyond::Loads))
        );
        assert!(missed.counts() && missed.is_right(), "{missed:?}");
        assert!(
            verdict.sentence.contains("surge load up to"),
            "{}",
            verdict.sentence
        );
        let (inside, _) = judge(&make(1, 1, 0).unwrap()).unwrap();
        assert_eq!((inside.kind, inside.there.len()), (Kind::Inside, 0));
        assert!(inside.counts() && inside.is_right(), "{inside:?}");
    }
}
