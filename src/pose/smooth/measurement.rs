//! Measurement that a frame contributes: its pose with the sheet's thickness.

use crate::joint::{JointPose, MapLoadings};
use nalgebra::SMatrix;

/// A pose with the sheet's thickness, as one frame gave them.
#[derive(Debug, Clone, PartialEq)]
pub struct Measured {
    /// x, y, z \[m\], φ, θ, ψ \[rad\], thickness \[m\].
    pub values: [f64; 7],
    /// Their covariance, SI.
    pub covariance: SMatrix<f64, 7, 7>,
    /// What errors that all poses share do to it.
    pub loadings: MapLoadings,
    /// Whether the frame determined each number of the pose.
    pub measured: [bool; 6],
    /// The thickness was fitted, not held.
    pub thickness: bool,
}

impl From<&JointPose> for Measured {
    fn from(fit: &JointPose) -> Self {
        let pose = fit.pose.to_array();
        Measured {
            values: std::array::from_fn(|i| pose.get(i).copied().unwrap_or(fit.thickness_m)),
            covariance: fit.covariance_with_thickness,
            loadings: fit.loadings,
            measured: fit.measured,
            thickness: fit.covariance_with_thickness[(6, 6)] > 0.0,
        }
    }
}

/// A frame of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasuredFrame {
    /// Mid-exposure, UNIX \[ns\].
    pub stamp_ns: u64,
    /// `None`: the frame has no pose of its own.
    pub measured: Option<Measured>,
}
