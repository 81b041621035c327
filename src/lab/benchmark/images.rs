//! Image-level cases: rendered runs with one or two effects of camera, sheet, target, water or light, or none.
//!
//! A case is two logs of frames (reversals and two tones) of a vehicle up to 20 % off the rig file,
//! over a background of four motion effects at 3–8 % of their practical size and a disturbance in roll,
//! pitch and yaw; laser, lens and sheet are as a rig file leaves open. In turn it has one effect, two and none, of random
//! sizes: at least three standard deviations of the pose that a frame gives where an effect moves it, at least a tenth of
//! the largest plausible one else. The frames come from the renderer; the diagnosis predicts the stripe with geometry of
//! its own and reads the logs only. An observer who knows the numbers says whether the frames can show each effect.

mod make;
mod poses;
mod size;

pub use make::{EFFECTS, ImageCase, NONE, make};
pub use size::{Moved, moved};

use super::cache::Kept;
use super::error::ProveError;
use super::score::Rate;
use hydroline_diagnose::Watch;
use hydroline_diagnose::profiles::findings::{Findings, ImageError, explain};
use hydroline_diagnose::profiles::known;
use hydroline_diagnose::verdict::{Effect, Word};
use hydroline_numerics::parallel;
use hydroline_rigs::PhysicsEntry;
use hydroline_stripe::Profile;
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// A case after its diagnosis.
#[derive(Debug, Clone, serde::Serialize, schemars::JsonSchema, serde::Deserialize)]
pub struct ImageJudged {
    /// Index of the case.
    pub index: usize,
    /// Effects that are there.
    pub truth: Vec<String>,
    /// Their numbers.
    pub numbers: Vec<(String, f64)>,
    /// Whether the frames can show all of them to one who knows them.
    pub shown: bool,
    /// rms error of the poses after over that of the frames without the effects, mean over the six numbers' squares.
    pub pose_ratio: Option<f64>,
    /// Shift of a frame's pose by it, largest of six in its own sds.
    #[serde(deserialize_with = "number_or_nan")]
    pub moves_sds: f64,
    /// The same of x, y and z alone.
    #[serde(deserialize_with = "number_or_nan")]
    pub moves_position_sds: f64,
    /// Effects that were named.
    pub found: Vec<String>,
    /// Sets that the frames cannot distinguish.
    pub sets: Vec<Vec<String>>,
    /// The verdict's word.
    pub word: Word,
    /// Log odds over nothing.
    #[serde(deserialize_with = "number_or_nan")]
    pub log_odds: f64,
    /// The truth named, nothing else, and nothing that is not distinguished from it.
    pub right: bool,
    /// The truth named alone, in one of the tied sets, or as the `or` of the one effect named.
    pub right_or_tied: bool,
    /// Errors of the numbers in their sds.
    pub errors_sds: Vec<(String, f64)>,
    /// Seconds of the diagnosis.
    pub seconds: f64,
}

/// JSON has no word for a number that is none.
fn number_or_nan<'de, D: serde::Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    Ok(<Option<f64> as serde::Deserialize>::deserialize(from)?.unwrap_or(f64::NAN))
}

/// Makes, diagnoses and scores cases; `done` is called with each. With `kept`, a case that lies there is not run again, and
/// each that was run is laid there.
///
/// # Errors
/// [`ProveError`].
pub fn run(
    seed: u64,
    indices: &[usize],
    kept: Option<&Kept>,
    done: &(dyn Fn(&ImageJudged) + Sync),
) -> Result<Vec<ImageJudged>, ProveError> {
    parallel::try_map_slice(indices, |index| {
        let judged = Kept::or_run(kept, &format!("image-{index}"), || {
            Ok(judge(&make(seed, *index)?)?.0)
        })?;
        done(&judged);
        Ok(judged)
    })
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
    let found = match explain(&case.runs, &case.rig, Watch::unlimited(&|_| {})) {
        Ok(found) => Some(found),
        // A finding that is not made is a wrong one, not a broken case.
        Err(ImageError::NoPose | ImageError::Few { .. }) => None,
        Err(error) => return Err(broken(&error)),
    };
    let seconds = started.elapsed().as_secs_f64();
    let shown = known::shown(&case.runs, &case.rig, &case.truth).map_err(|e| broken(&e));
    // No pose under the known numbers: not shown.
    let shown = shown.is_ok_and(|all| all.iter().all(|s| *s));
    let pose_ratio = (found.as_ref()).and_then(|f| poses::ratio(case, &f.poses));
    let names = |f: &Findings| {
        let mut names: Vec<String> = f.effects.iter().map(|e| e.effect.clone()).collect();
        names.sort();
        names
    };
    let named = found.as_ref().map(names).unwrap_or_default();
    let sets = found
        .as_ref()
        .map(|f| f.equivalent.clone())
        .unwrap_or_default();
    let word = found.as_ref().map_or(Word::Unknown, |f| f.word);
    let mut wanted: Vec<String> = case.truth.iter().map(|e| e.effect.clone()).collect();
    wanted.sort();
    let decided = found.is_some() && word != Word::Unknown;
    let alone = |f: &Findings| f.effects.iter().all(|e| e.or.is_empty());
    let right = decided && named == wanted && sets.len() < 2 && found.as_ref().is_some_and(alone);
    // Each effect there named, or beside the one that these frames do not tell from it.
    let or = found.as_ref().is_some_and(|f| {
        let is = |e: &Effect, w: &String| e.effect == *w || e.or.contains(w);
        f.effects.len() == wanted.len() && wanted.iter().all(|w| f.effects.iter().any(|e| is(e, w)))
    });
    let same = |set: &Vec<String>| {
        let mut set = set.clone();
        set.sort();
        set == wanted
    };
    let errors_sds = found.as_ref().map(|f| errors(case, f)).unwrap_or_default();
    let judged = ImageJudged {
        index: case.index,
        numbers: (case.truth.iter())
            .flat_map(super::magnitudes::numbers)
            .collect(),
        shown,
        pose_ratio,
        moves_sds: case.moved.any_sds,
        moves_position_sds: case.moved.position_sds,
        right_or_tied: right || decided && (or || sets.iter().any(same)),
        truth: wanted,
        found: named,
        sets,
        word,
        log_odds: found.as_ref().map_or(f64::NAN, |f| f.log_odds),
        right,
        errors_sds,
        seconds,
    };
    Ok((judged, found))
}

/// Errors of the numbers of the effects found, in their sds.
fn errors(case: &ImageCase, found: &Findings) -> Vec<(String, f64)> {
    let of = |truth: &PhysicsEntry| {
        let effect = found.effects.iter().find(|e| e.effect == truth.effect);
        let numbers = super::magnitudes::numbers(truth).into_iter();
        let error = |(name, value): (String, f64)| {
            let p = effect?.parameters.get(&name)?;
            Some((name, (p.value - value) / p.sd?))
        };
        numbers.filter_map(error).collect::<Vec<_>>()
    };
    case.truth.iter().flat_map(of).collect()
}

/// Error of the pose after over that of the clean frames that is asked for.
const POSE_RATIO: f64 = 1.3;

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
        for truth in &j.truth {
            by.entry(truth).or_default().push(j);
        }
    }
    for (name, some) in &by {
        line(name, some);
    }
    let of = |count: usize| -> Vec<&ImageJudged> {
        all.iter().filter(|j| j.truth.len() == count).collect()
    };
    line(NONE, &of(0));
    line("one effect", &of(1));
    line("two effects", &of(2));
    let with: Vec<&ImageJudged> = all.iter().filter(|j| !j.truth.is_empty()).collect();
    let between = |low: f64, high: f64| -> Vec<&ImageJudged> {
        with.iter()
            .copied()
            .filter(|j| j.moves_position_sds >= low && j.moves_position_sds < high)
            .collect()
    };
    line("all with an effect", &with);
    let shown: Vec<&ImageJudged> = with.iter().copied().filter(|j| j.shown).collect();
    line("  that these frames can show", &shown);
    line("  position moved by under 3 sd", &between(0.0, 3.0));
    line("  by 3 to 10 sd", &between(3.0, 10.0));
    line("  by 10 sd and more", &between(10.0, f64::INFINITY));
    let errors = all.iter().filter(|j| j.right).flat_map(|j| &j.errors_sds);
    let of_sds = |sds: f64| Rate::of(errors.clone().map(|e| e.1.abs() < sds));
    for (what, rate) in [("95 % intervals", of_sds(1.96)), ("3 sds", of_sds(3.0))] {
        let _ = writeln!(
            text,
            "  {what} of the parameters hold the truth in {} of {} = {:.1} % [{:.1}, {:.1}]",
            rate.hits,
            rate.count,
            100.0 * rate.share,
            100.0 * rate.low,
            100.0 * rate.high
        );
    }
    let mut ratios: Vec<f64> = shown
        .iter()
        .filter(|j| j.right)
        .filter_map(|j| j.pose_ratio)
        .collect();
    ratios.sort_by(f64::total_cmp);
    if let Some(median) = ratios.get(ratios.len() / 2) {
        let within = ratios.iter().filter(|r| **r <= POSE_RATIO).count();
        let _ = writeln!(
            text,
            "  pose after over pose of the clean frames: median {median:.2}, within {POSE_RATIO} in {within} of {}",
            ratios.len()
        );
    }
    text
}

/// One line about a case that did not come out.
pub fn complaint(j: &ImageJudged) -> Option<String> {
    (!j.right).then(|| {
        format!(
            "image-{}: {:?} {:?} (moves the pose by {:.1} sd, position {:.1}; shown: {}), found {:?} {:?}, tied {:?}, log odds {:.1}, pose ratio {:.2}",
            j.index, j.truth, j.numbers, j.moves_sds, j.moves_position_sds, j.shown, j.found, j.word, j.sets, j.log_odds, j.pose_ratio.unwrap_or(f64::NAN)
        )
    })
}

/// Whether a frame shows a stripe at all.
fn shows(profile: &Profile) -> bool {
    profile.fault.is_none()
}
