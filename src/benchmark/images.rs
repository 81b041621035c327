//! Image-level cases: rendered runs with one effect of camera, sheet, target or water, or none.
//!
//! A case is two logs of frames (reversals and two tones) of a vehicle up to 20 % off the rig file,
//! over a background of four motion effects at 3–8 % of their practical size and a wobble in roll,
//! pitch and yaw. One of six effects has a random size of at least three standard deviations of the
//! pose that a frame gives; every seventh case has none. The frames come from the renderer; the
//! diagnosis predicts the stripe with geometry of its own and reads the logs only.

mod make;
mod size;

pub use make::{EFFECTS, ImageCase, NONE, make};
pub use size::{Moved, moved};

use super::error::ProveError;
use super::score::Rate;
use hydroline_diagnose::profiles::findings::{Findings, ImageError, explain};
use hydroline_diagnose::profiles::known;
use hydroline_diagnose::profiles::search::ESTABLISHED;
use hydroline_diagnose::verdict::Word;
use hydroline_stripe::Profile;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// A case after its diagnosis.
#[derive(Debug, Clone, serde::Serialize)]
pub struct ImageJudged {
    /// Number.
    pub index: usize,
    /// Effect that is there.
    pub truth: String,
    /// Its numbers.
    pub numbers: Vec<(String, f64)>,
    /// How far it moves the pose of a frame, largest of six in its own sds.
    pub moves_sds: f64,
    /// The same of x, y and z alone.
    pub moves_position_sds: f64,
    /// What was named.
    pub found: Vec<String>,
    /// Sets that the frames cannot tell apart.
    pub sets: Vec<Vec<String>>,
    /// The verdict's word.
    pub word: Word,
    /// Log odds over nothing.
    pub log_odds: f64,
    /// Log odds over nothing of the truth, fitted from its own numbers.
    pub log_odds_truth: Option<f64>,
    /// The truth named, nothing else, and nothing that is not told from it.
    pub right: bool,
    /// The truth named alone, in one of the tied sets, or as the `or` of the one effect named.
    pub right_or_tied: bool,
    /// Errors of the numbers in their sds.
    pub errors_sds: Vec<(String, f64)>,
    /// Seconds of the diagnosis.
    pub seconds: f64,
}

/// Makes, diagnoses and scores cases; `done` is told of each.
///
/// # Errors
/// [`ProveError`].
pub fn run(
    seed: u64,
    indices: &[usize],
    done: &(dyn Fn(&ImageJudged) + Sync),
) -> Result<Vec<ImageJudged>, ProveError> {
    indices
        .par_iter()
        .map(|index| {
            let case = make(seed, *index)?;
            let (judged, _) = judge(&case)?;
            done(&judged);
            Ok(judged)
        })
        .collect()
}

/// Diagnoses and scores a case; the findings beside it, where there are any.
///
/// # Errors
/// [`ProveError`].
pub fn judge(case: &ImageCase) -> Result<(ImageJudged, Option<Findings>), ProveError> {
    let broken = |error: &ImageError| ProveError::Images {
        index: case.index,
        reason: error.to_string(),
    };
    let started = std::time::Instant::now();
    let found = match explain(&case.runs, &case.rig, &|_| {}) {
        Ok(found) => Some(found),
        // A finding that is not made is a wrong one, not a broken case.
        Err(ImageError::NoPose | ImageError::Few { .. }) => None,
        Err(error) => return Err(broken(&error)),
    };
    let seconds = started.elapsed().as_secs_f64();
    let known = match (&case.truth, &found) {
        (Some(truth), Some(found)) => {
            known::score(&case.runs, &case.rig, truth, found).map_err(|e| broken(&e))?
        }
        _ => None,
    };
    let names = |f: &Findings| {
        f.effects
            .iter()
            .map(|e| e.effect.clone())
            .collect::<Vec<_>>()
    };
    let named = found.as_ref().map(names).unwrap_or_default();
    let sets = found
        .as_ref()
        .map(|f| f.equivalent.clone())
        .unwrap_or_default();
    let word = found.as_ref().map_or(Word::Unknown, |f| f.word);
    let wanted: Vec<String> = case.truth.iter().map(|e| e.effect.clone()).collect();
    let told = found.is_some() && word != Word::Unknown;
    let alone = |f: &Findings| f.effects.iter().all(|e| e.or.is_empty());
    let right = told && named == wanted && sets.len() < 2 && found.as_ref().is_some_and(alone);
    // One effect too small for a set of its own, listed with what these frames do not tell from it.
    let or = sets.is_empty()
        && found.as_ref().is_some_and(|f| {
            matches!((&f.effects[..], &wanted[..]), ([e], [w]) if e.effect == *w || e.or.contains(w))
        });
    let errors_sds = found.as_ref().map(|f| errors(case, f)).unwrap_or_default();
    let judged = ImageJudged {
        index: case.index,
        truth: case
            .truth
            .as_ref()
            .map_or_else(|| NONE.to_owned(), |e| e.effect.clone()),
        numbers: case
            .truth
            .as_ref()
            .map(super::sizes::numbers)
            .unwrap_or_default(),
        moves_sds: case.moved.any_sds,
        moves_position_sds: case.moved.position_sds,
        right_or_tied: right || told && (or || sets.contains(&wanted)),
        found: named,
        sets,
        word,
        log_odds: found.as_ref().map_or(f64::NAN, |f| f.log_odds),
        log_odds_truth: known
            .zip(found.as_ref())
            .map(|(k, f)| k - f.score_of_nothing),
        right,
        errors_sds,
        seconds,
    };
    Ok((judged, found))
}

fn errors(case: &ImageCase, found: &Findings) -> Vec<(String, f64)> {
    let Some(truth) = &case.truth else {
        return Vec::new();
    };
    let Some(effect) = found.effects.iter().find(|e| e.effect == truth.effect) else {
        return Vec::new();
    };
    super::sizes::numbers(truth)
        .into_iter()
        .filter_map(|(name, value)| {
            let p = effect.parameters.get(&name)?;
            Some((name, (p.value - value) / p.sd?))
        })
        .collect()
}

/// The table in words.
pub fn words(all: &[ImageJudged]) -> String {
    let mut text = String::from(
        "image level: cases, named right or in a tied set [95 % Wilson], named right alone\n",
    );
    let mut line = |name: &str, some: &[&ImageJudged]| {
        let right = Rate::of(some.iter().map(|j| j.right_or_tied));
        let alone = some.iter().filter(|j| j.right).count();
        let _ = writeln!(
            text,
            "  {name:<34} {:>4}  {:>4} = {:5.1} % [{:.1}, {:.1}]  {alone:>4}",
            right.count,
            right.hits,
            100.0 * right.share,
            100.0 * right.low,
            100.0 * right.high
        );
    };
    let mut by: BTreeMap<&str, Vec<&ImageJudged>> = BTreeMap::new();
    for j in all {
        by.entry(&j.truth).or_default().push(j);
    }
    for (name, some) in &by {
        line(name, some);
    }
    let with: Vec<&ImageJudged> = all.iter().filter(|j| j.truth != NONE).collect();
    let between = |low: f64, high: f64| -> Vec<&ImageJudged> {
        with.iter()
            .copied()
            .filter(|j| j.moves_position_sds >= low && j.moves_position_sds < high)
            .collect()
    };
    line("all with an effect", &with);
    // What the truth, fitted from its own numbers, is not established for no search can find; haze is not fitted so.
    let shown: Vec<&ImageJudged> = with
        .iter()
        .copied()
        .filter(|j| {
            j.log_odds_truth
                .is_none_or(|t| t.max(j.log_odds) > ESTABLISHED)
        })
        .collect();
    line("  that these frames can show", &shown);
    line("  position moved by under 3 sd", &between(0.0, 3.0));
    line("  by 3 to 10 sd", &between(3.0, 10.0));
    line("  by 10 sd and more", &between(10.0, f64::INFINITY));
    let errors = all.iter().filter(|j| j.right).flat_map(|j| &j.errors_sds);
    let covered = Rate::of(errors.map(|e| e.1.abs() < 1.96));
    let _ = writeln!(
        text,
        "  95 % intervals of the parameters hold the truth in {} of {} = {:.1} % [{:.1}, {:.1}]",
        covered.hits,
        covered.count,
        100.0 * covered.share,
        100.0 * covered.low,
        100.0 * covered.high
    );
    text
}

/// One line about a case that did not come out.
pub fn complaint(j: &ImageJudged) -> Option<String> {
    (!j.right).then(|| {
        format!(
            "image-{}: {} {:?} (moves the pose by {:.1} sd, position {:.1}), found {:?} {:?}, tied {:?}, log odds {:.1}, of the truth {:.1}",
            j.index, j.truth, j.numbers, j.moves_sds, j.moves_position_sds, j.found, j.word, j.sets, j.log_odds, j.log_odds_truth.unwrap_or(f64::NAN)
        )
    })
}

/// Whether a frame shows a stripe at all.
fn shows(profile: &Profile) -> bool {
    profile.fault.is_none()
}
