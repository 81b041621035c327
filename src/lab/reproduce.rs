//! The paper, computed: its animations rendered, extracted, mapped and estimated again.
//!
//! Every frame goes the whole way (render → stripe → laser plane → estimate), once with the whole-pixel
//! stripe and single points of the paper, once with ours, and stands beside the paper's number.

mod all_dofs;
mod calibration;
mod chain;
mod coefficient_errors;
mod disturbed;
mod experiment;
mod figure;
mod figures;
mod paper;
mod surge;
mod table10;
mod table3;

pub use all_dofs::{DofRow, all_dofs, dofs};
pub use calibration::{CalibrationRow, CalibrationStudy};
pub use disturbed::{Disturbed, JointAccuracy, disturbed, joint_accuracy};
pub use figure::{Figure, Series};
pub use figures::{figure12, figure13, figure17};
pub use paper::{TABLE11_THRUST_N, Table11Row, table11};
pub use surge::{Disturbance, SurgeRun, table7};
pub use table3::{Row, table3};
pub use table10::{Row as Table10Row, table10, table10_under};

use hydroline_rigs::RigError;
use hydroline_sim::SceneError;

/// The six decoupled motions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, schemars::JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Motion {
    /// Motion along x.
    Surge,
    /// Motion along y.
    Sway,
    /// Motion along z.
    Heave,
    /// Turn by φ.
    Roll,
    /// Turn by θ.
    Pitch,
    /// Turn by ψ.
    Yaw,
}

impl Motion {
    /// All six, in the paper's order.
    pub const ALL: [Motion; 6] = [
        Motion::Surge,
        Motion::Sway,
        Motion::Heave,
        Motion::Roll,
        Motion::Pitch,
        Motion::Yaw,
    ];

    /// Place in a pose: x, y, z, φ, θ, ψ.
    pub fn index(self) -> usize {
        self as usize
    }

    /// Factor from SI to the paper's unit (mm or °).
    pub fn per_si(self) -> f64 {
        if self.index() < 3 {
            1e3
        } else {
            180.0 / std::f64::consts::PI
        }
    }

    /// The paper's unit.
    pub fn unit(self) -> &'static str {
        if self.index() < 3 { "mm" } else { "deg" }
    }
}

/// Why a table cannot be computed.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum ReproduceError {
    #[error(transparent)]
    Rig(#[from] RigError),
    #[error(transparent)]
    Scene(#[from] SceneError),
    #[error(transparent)]
    Trajectory(#[from] hydroline_sim::TrajectoryError),
    /// Identification from what was measured.
    #[error(transparent)]
    Estimate(#[from] hydroline_estimate::EstimateError),
    #[error(transparent)]
    Paper(#[from] crate::search::paper_fit::PaperFitError),
    #[error("the built-in rig has no hexagon target: its file was changed")]
    NoChain,
    #[error(transparent)]
    Smooth(#[from] hydroline_pose::smooth::SmoothError),
    #[error(
        "{motion:?}: the first frame gives no reference, so nothing can be measured against it"
    )]
    NoReference { motion: Motion },
}
