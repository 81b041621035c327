//! Why a case could not be made or diagnosed.

use hydroline_rigs::RigError;
use hydroline_sim::effect::EffectError;

use hydroline_diagnose::DiagnoseError;
use hydroline_estimate::EstimateError;
use hydroline_identify::data::LoadError;
use hydroline_plan::setpoint::SetpointError;
use hydroline_sim::ThrustError;
use hydroline_sim::trajectory::TrajectoryError;

/// Error in making, diagnosing or judging a case.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum ProveError {
    /// Built-in rig or plan.
    #[error(transparent)]
    Rig(#[from] RigError),
    #[error(transparent)]
    Thrust(#[from] ThrustError),
    /// A plan the thrusters cannot make.
    #[error(transparent)]
    Setpoint(#[from] SetpointError),
    #[error(transparent)]
    Effect(#[from] EffectError),
    #[error(
        "no practical size of '{effect}' is known: src/lab/benchmark/{file} has its effects in a list, and an arm for each of them"
    )]
    Unsized {
        effect: String,
        /// File that draws it.
        file: &'static str,
    },
    #[error(transparent)]
    Trajectory(#[from] TrajectoryError),
    #[error(transparent)]
    Load(#[from] LoadError),
    /// Maximum likelihood of the vehicle alone.
    #[error(transparent)]
    Estimate(#[from] EstimateError),
    #[error("{id}: {source}")]
    Diagnose { id: String, source: DiagnoseError },
    #[error("image-{index}: {reason}")]
    Images { index: usize, reason: String },
    #[error(
        "{id}: no draw in {tries} gave what the category asks for (last: {last}); take another --seed"
    )]
    NoCase {
        id: String,
        tries: usize,
        last: String,
    },
    #[error("no case '{id}'; ids look like {example} (category-index, index from 0)")]
    UnknownCase { id: String, example: String },
    /// Folder of kept cases, or a file in it, that cannot be used.
    #[error("{path}: {reason}")]
    Kept {
        path: String,
        /// Why, and what to do.
        reason: String,
    },
    #[error("{path}: cannot be written: {reason}; what was judged before it is kept")]
    NotKept { path: String, reason: String },
    #[error("the simulated motion is not finite at {t_s:.2} s")]
    Diverged { t_s: f64 },
}
