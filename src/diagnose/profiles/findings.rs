//! What the profiles say, as part of the verdict.

mod effects;
mod figures;
mod told;

use super::candidate::{Base, vocabulary};
use super::fit::{Fitted, Problem};
use super::haze::{Haze, skirt};
use super::observe::{self, ImageRun};
use super::picture;
use super::prior::Motion;
use super::search::{Searched, search, visibility};
use crate::verdict::{Alternative, BeforeAfter, Effect, FitTable, Word};
use effects::{effect, entry, hazy, heaviness, instead};
use figures::{held_out, noise, rms, worst};
use hydroline_identify::data::LoadError;
use hydroline_report::Body;
use hydroline_rigs::{PhysicsEntry, Rig};
use hydroline_sim::SimError;
use hydroline_sim::effect::EffectError;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Frames looked at in all.
pub const FRAMES: usize = 52;
/// Fewest frames that say anything.
const LEAST_FRAMES: usize = 5;
/// Channels of a pose.
const CHANNELS: [&str; 6] = ["x_m", "y_m", "z_m", "phi_rad", "theta_rad", "psi_rad"];
/// Mean residual of a part of the image that no explanation takes away \[px\], and in its own sds.
const UNEXPLAINED_PX: f64 = 0.08;
const UNEXPLAINED_SDS: f64 = 6.0;
/// What a typical size of an effect must at least be worth, or these frames cannot show it.
const BLIND: f64 = 3.0;

/// Share by which haze must pull otherwise than was allowed for, and all is fitted anew.
const PULL_SHARE: f64 = 0.3;

/// Why there is no finding.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// A log.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// The rig's motion.
    #[error("image level: {0}")]
    Sim(#[from] SimError),
    /// The rig's `[[physics]]`.
    #[error("image level: {0}")]
    Effect(#[from] EffectError),
    /// Too few frames.
    #[error(
        "image level: {found} of {frames} frames show a stripe, at least {LEAST_FRAMES} are needed: is the laser on, is it the rig's camera?"
    )]
    Few {
        /// With a stripe.
        found: usize,
        /// In the logs.
        frames: usize,
    },
    /// No pose.
    #[error(
        "image level: no frame lies on the rig's floor and target, whatever effect is assumed: is it the rig's target?"
    )]
    NoPose,
}

/// What the profiles say.
#[derive(Debug, Clone)]
pub struct Findings {
    /// One word.
    pub word: Word,
    /// Heaviest first.
    pub effects: Vec<Effect>,
    /// Complete sets that the frames cannot tell apart; empty where one stands out.
    pub equivalent: Vec<Vec<String>>,
    /// Entries for the rig file.
    pub entries: Vec<PhysicsEntry>,
    /// Log odds of the best explanation over nothing.
    pub log_odds: f64,
    /// log posterior without effects \[nat\].
    pub score_of_nothing: f64,
    /// Rows by which haze was allowed to pull the stripe \[px\].
    pub pull_px: f64,
    /// Fit and prediction \[px\].
    pub fit: FitTable,
    /// Other explanations.
    pub alternatives: Vec<Alternative>,
    /// Effects of typical size that these frames would not show.
    pub blind_spots: Vec<String>,
    /// Largest mean residual of a part of the image, before and after \[px\], and where it is.
    pub worst_px: [f64; 2],
    /// Part of the image in words.
    pub part: String,
    /// Poses per run with the effects: (t, pose).
    pub poses: Vec<Vec<(f64, [f64; 6])>>,
    /// The light beside the stripe.
    pub haze: Option<Haze>,
    /// Section of the report with its pictures.
    pub section: Body,
    /// Remarks.
    pub notes: Vec<String>,
    /// Sets of effects looked at.
    pub sets_looked_at: usize,
}

/// Reads the logs that hold frames and says what they show; `None` where none does.
///
/// # Errors
/// [`ImageError`].
pub fn level(
    logs: &[PathBuf],
    rig: &Rig,
    progress: &(dyn Fn(&str) + Sync),
) -> Result<Option<Findings>, ImageError> {
    let mut with = Vec::new();
    for path in logs {
        if observe::has_images(path)? {
            with.push(path);
        }
    }
    if with.is_empty() {
        return Ok(None);
    }
    let most = FRAMES.div_ceil(with.len()).max(LEAST_FRAMES);
    let mut runs = Vec::new();
    for path in with {
        progress(&path.display().to_string());
        runs.push(observe::read(path, rig, most)?);
    }
    explain(&runs, rig, progress).map(Some)
}

/// The same for frames in memory.
///
/// # Errors
/// [`ImageError`].
pub fn explain(
    runs: &[ImageRun],
    rig: &Rig,
    progress: &(dyn Fn(&str) + Sync),
) -> Result<Findings, ImageError> {
    let runs = moving(runs);
    let frames: usize = runs.iter().map(|r| r.frames.len()).sum();
    if frames < LEAST_FRAMES {
        let all = runs.iter().map(|r| r.in_log).sum();
        return Err(ImageError::Few {
            found: frames,
            frames: all,
        });
    }
    let base = Base::new(rig)?;
    let candidates = vocabulary(&base);
    let mut problem = problem(&runs, rig, base)?;
    let beside = |problem: &Problem<'_>, fit: &Fitted| {
        skirt(problem, &candidates, fit).and_then(|s| s.haze(rig.laser.sigma_m))
    };
    let pull = |haze: Option<&Haze>| haze.filter(|h| h.found).map_or(0.0, |h| h.pull_px.abs());
    // Haze pulls rows and broadens the line. Its light is seen wherever about the stripe lies, so it
    // is measured first: geometry found without it would have to be found all over again.
    progress("light beside the stripe");
    let rough = problem
        .placed(&[], Vec::new(), false)
        .and_then(|s| problem.glance(&candidates, &[], s));
    problem.pull_px = pull(rough.and_then(|f| beside(&problem, &f)).as_ref());
    let mut found = search(&problem, &candidates, progress).ok_or(ImageError::NoPose)?;
    let mut haze = beside(&problem, found.best());
    let (now_px, was_px) = (pull(haze.as_ref()), problem.pull_px);
    let other = (now_px - was_px).abs() > PULL_SHARE * now_px.max(was_px);
    if other && (now_px < was_px || !found.best().effects.is_empty()) {
        problem.pull_px = now_px;
        found = search(&problem, &candidates, progress).ok_or(ImageError::NoPose)?;
        haze = beside(&problem, found.best());
    }
    let best = found.best();
    let tied = found.tied();
    let mut effects: Vec<Effect> = best
        .effects
        .iter()
        .enumerate()
        .map(|(k, e)| Effect {
            or: instead(&candidates, best, &tied, *e),
            ..effect(&problem, &candidates, &found, best, k, *e)
        })
        .collect();
    let mut entries: Vec<PhysicsEntry> = best
        .effects
        .iter()
        .zip(&best.state.numbers)
        .map(|(e, n)| entry(candidates[*e].info, n))
        .collect();
    if let Some((info, own)) = haze.as_ref().and_then(|h| hazy(&problem, best, h)) {
        effects.push(own);
        if let Some(h) = &haze {
            entries.push(entry(info, &[h.fraction, h.length_m]));
        }
    }
    effects.sort_by(|a, b| heaviness(b, rig).total_cmp(&heaviness(a, rig)));
    let matters = |f: &Fitted| -> Vec<String> {
        f.effects
            .iter()
            .map(|e| candidates[*e].info.id.to_owned())
            .collect()
    };
    let important = effects.iter().any(|e| e.matters);
    let haze_ids: Vec<String> = effects
        .iter()
        .filter(|e| {
            e.matters
                && !best
                    .effects
                    .iter()
                    .any(|k| candidates[*k].info.id == e.effect)
        })
        .map(|e| e.effect.clone())
        .collect();
    let equivalent = if tied.len() > 1 && important {
        tied.iter()
            .take(6)
            .map(|f| matters(f).into_iter().chain(haze_ids.clone()).collect())
            .collect()
    } else {
        Vec::new()
    };
    let (worst, part) = worst(&found.nothing, best, rig);
    let unexplained = worst[1].0 > UNEXPLAINED_PX && worst[1].1 > UNEXPLAINED_SDS;
    let word = if unexplained {
        Word::Unknown
    } else if !important {
        Word::None
    } else if equivalent.is_empty() {
        Word::Named
    } else {
        Word::Ambiguous
    };
    let mut notes = vec![format!(
        "image level: {frames} frames of {} run(s)",
        runs.len()
    )];
    if unexplained {
        notes.push(format!(
            "no effect of the vocabulary takes away {:.2} px about {part}",
            worst[1].0
        ));
    }
    let blind_spots = found
        .all
        .iter()
        .filter(|f| f.effects.len() == 1)
        .filter(|f| visibility(&candidates[f.effects[0]], f) < BLIND)
        .map(|f| candidates[f.effects[0]].info.id.to_owned())
        .collect();
    progress("frames held out");
    let fit = FitTable {
        train: BeforeAfter {
            before: rms(&found.nothing),
            after: rms(best),
            noise: noise(best),
        },
        held_out: held_out(&runs, rig, &candidates, &found)?,
        held_out_by: "every other frame, its pose alone fitted".to_owned(),
        held_out_written: BTreeMap::new(),
    };
    let section = picture::section(rig, &found.nothing, best, &effects);
    let zero = Searched::score(&found.nothing);
    let top = Searched::score(best);
    Ok(Findings {
        word,
        equivalent,
        entries,
        log_odds: top - zero,
        score_of_nothing: zero,
        pull_px: problem.pull_px,
        fit,
        alternatives: found
            .all
            .iter()
            .take(8)
            .map(|f| Alternative {
                effects: matters(f),
                log_evidence: Searched::score(f) - top,
                probability: found
                    .all
                    .iter()
                    .map(|o| (Searched::score(o) - Searched::score(f)).exp())
                    .sum::<f64>()
                    .recip(),
                train: BTreeMap::new(),
                held_out: BTreeMap::new(),
            })
            .collect(),
        blind_spots,
        worst_px: [worst[0].0, worst[1].0],
        part,
        poses: runs
            .iter()
            .zip(&best.state.poses)
            .map(|(r, p)| r.frames.iter().zip(p).map(|(f, p)| (f.t_s, *p)).collect())
            .collect(),
        haze,
        section,
        notes,
        sets_looked_at: found.all.len(),
        effects,
    })
}

/// Runs of more than one frame: one alone has no motion.
pub(super) fn moving(runs: &[ImageRun]) -> Vec<ImageRun> {
    runs.iter()
        .filter(|r| r.frames.len() > 1)
        .cloned()
        .collect()
}

pub(super) fn problem<'a>(
    runs: &'a [ImageRun],
    rig: &'a Rig,
    base: Base,
) -> Result<Problem<'a>, ImageError> {
    let motions: Result<Vec<Motion>, SimError> = runs.iter().map(|r| Motion::new(r, rig)).collect();
    Ok(Problem::new(rig, base, runs, motions?))
}
