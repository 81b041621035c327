//! Findings of the profiles, as part of the verdict.

mod effects;
mod figures;
mod level;
mod lit;
mod sentence;

use super::anytime::Anytime;
use super::candidate::{Base, Candidate, library};
use super::fit::Problem;
use super::geometry::Geometry;
use super::observe::{self, ImageRun};
use super::prior::Motion;
use super::search::{Searched, search};
use crate::verdict::{Alternative, Effect, FitTable, Word};
use hydroline_identify::data::LoadError;
use hydroline_inference::limit::{Cause, Watch};
use hydroline_report::Body;
use hydroline_rigs::{PhysicsEntry, Rig};
use hydroline_sim::SimError;
use hydroline_sim::effect::EffectError;
use level::Level;
pub(super) use lit::Lit;
use std::path::PathBuf;

/// Frames looked at in all.
pub const FRAMES: usize = 52;
/// Fewest frames that say anything.
const LEAST_FRAMES: usize = 5;
/// Channels of a pose.
const CHANNELS: [&str; 6] = ["x_m", "y_m", "z_m", "phi_rad", "theta_rad", "psi_rad"];

/// Why there is no finding.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum ImageError {
    #[error(transparent)]
    Load(#[from] LoadError),
    #[error("image level: {0}")]
    Sim(#[from] SimError),
    /// The rig's `[[physics]]`.
    #[error("image level: {0}")]
    Effect(#[from] EffectError),
    #[error(
        "image level: {found} of {frames} frames show a stripe, at least {LEAST_FRAMES} are needed: is the laser on, is it the rig's camera?{}",
        left_out.iter().map(|words| format!("; {words}")).collect::<String>()
    )]
    Few {
        found: usize,
        frames: usize,
        /// Remarks on frames that were not taken.
        left_out: Vec<String>,
    },
    #[error(
        "image level: no frame lies on the rig's floor and target, whatever effect is assumed: is it the rig's target?"
    )]
    NoPose,
}

/// Findings of the image level.
#[derive(Debug, Clone)]
pub struct Findings {
    /// One word.
    pub word: Word,
    /// Heaviest first.
    pub effects: Vec<Effect>,
    /// Complete sets that the frames cannot distinguish; empty where one stands out.
    pub equivalent: Vec<Vec<String>>,
    /// Entries for the rig file.
    pub entries: Vec<PhysicsEntry>,
    /// Log odds of the best explanation over nothing.
    pub log_odds: f64,
    /// log posterior without effects \[nat\].
    pub score_of_nothing: f64,
    /// Light that no effect of the library makes, in words.
    pub unnamed_light: Option<String>,
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
    /// Section of the report with its pictures.
    pub section: Body,
    /// Remarks for the verdict.
    pub notes: Vec<String>,
    /// Sets of effects looked at.
    pub sets_looked_at: usize,
    /// Reason why the search over the frames ended before its end; `None` = it did not.
    pub cut: Option<Cause>,
}

/// Reads the logs that hold frames and says what they show; `None` where none does.
///
/// # Errors
/// [`ImageError`].
pub fn level<'a>(
    logs: impl IntoIterator<Item = &'a PathBuf>,
    rig: &Rig,
    watch: Watch<'_>,
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
        watch.tell(&path.display().to_string());
        runs.push(observe::read(path, rig, most)?);
    }
    explain(&runs, rig, watch).map(Some)
}

/// The same for frames in memory.
///
/// # Errors
/// [`ImageError`].
pub fn explain(runs: &[ImageRun], rig: &Rig, watch: Watch<'_>) -> Result<Findings, ImageError> {
    let asked = &Anytime::new(watch);
    let base = Base::new(rig)?;
    let candidates = library(&base);
    let plain = base.optics(&[]).ok_or(ImageError::NoPose)?;
    // The light comes first: rows, widths and edges are read from frames without what lights the picture.
    let look = |geometry| Lit::new(runs, rig, &base, geometry, candidates.len(), asked);
    let mut lit = look(Geometry::new(rig, plain));
    let mut cleared = enough(&lit.runs, runs)?;
    let mut problem = problem(&cleared, rig, base.clone())?;
    let mut found = search(&problem, &candidates, asked).ok_or(ImageError::NoPose)?;
    // Where the rays go otherwise than the rig says, so do the angles of the laser's fan.
    let other;
    if let Some(geometry) = misfit(&problem, &candidates, &found)
        && !asked.is_over()
    {
        let again = look(geometry);
        if again.ids() != lit.ids() {
            cleared = enough(&again.runs, runs)?;
            other = cleared;
            problem = self::problem(&other, rig, base.clone())?;
            found = search(&problem, &candidates, asked).ok_or(ImageError::NoPose)?;
        }
        lit = again;
    }
    let level = Level {
        rig,
        raw: runs,
        problem: &problem,
        candidates: &candidates,
        found: &found,
        lit: &lit,
    };
    level.findings(asked)
}

/// The geometry of the best explanation, where it has effects.
fn misfit(problem: &Problem<'_>, candidates: &[Candidate], found: &Searched) -> Option<Geometry> {
    let best = found.best();
    let chosen: Vec<&Candidate> = best.effects.iter().map(|k| &candidates[*k]).collect();
    (!chosen.is_empty())
        .then(|| problem.geometry(&chosen, &best.state.numbers))
        .flatten()
}

/// Runs that move, if they have frames enough.
fn enough(runs: &[ImageRun], raw: &[ImageRun]) -> Result<Vec<ImageRun>, ImageError> {
    let runs = moving(runs);
    let found: usize = runs.iter().map(|r| r.frames.len()).sum();
    if found < LEAST_FRAMES {
        let left_out = raw.iter().flat_map(ImageRun::remarks).collect();
        return Err(ImageError::Few {
            found,
            frames: raw.iter().map(|r| r.in_log).sum(),
            left_out,
        });
    }
    Ok(runs)
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
