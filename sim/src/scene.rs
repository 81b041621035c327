//! The renderer of laser images and the analytic stripe.
//!
//! A frame is the exact ray of each pixel against floor and target, times the sheet's
//! Gaussian at the hit point, integrated over the pixel, blurred by the point spread,
//! plus ambient light, shot and read noise, rounded to 8 bits.
//!
//! All geometry is done in the affine coordinates (x, y, height above the floor) of the
//! target frame: lines stay lines, slabs are upright prisms, and a sloping floor is h = 0.

mod board;
mod exposure;
mod frame_poses;
mod lens;
mod noise;
mod psf;
mod rays;
mod refracted;
mod renderer;
mod sheet;
mod solid;
mod speckle;
mod truth;

pub use board::{BoardLight, BoardPicture, BoardPlacement};
pub use exposure::{Exposure, RowLight};
pub use frame_poses::FramePoses;
pub use noise::Noise;
pub use renderer::{GreyPixels, Renderer};
pub use solid::Surface;
pub use truth::{ColumnTruth, NEAR_STEP_PX};

use crate::effect::EffectError;

/// Pose of the CG in the tank frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Pose6 {
    /// X \[m\].
    pub x_m: f64,
    /// Y \[m\].
    pub y_m: f64,
    /// Z, down from the floor: negative above it \[m\].
    pub z_m: f64,
    /// Roll \[rad\].
    pub phi_rad: f64,
    /// Pitch \[rad\].
    pub theta_rad: f64,
    /// Yaw \[rad\].
    pub psi_rad: f64,
}

impl Pose6 {
    /// x, y, z, phi, theta, psi.
    pub fn to_array(self) -> [f64; 6] {
        [
            self.x_m,
            self.y_m,
            self.z_m,
            self.phi_rad,
            self.theta_rad,
            self.psi_rad,
        ]
    }
}

impl From<[f64; 6]> for Pose6 {
    fn from([x_m, y_m, z_m, phi_rad, theta_rad, psi_rad]: [f64; 6]) -> Self {
        Pose6 {
            x_m,
            y_m,
            z_m,
            phi_rad,
            theta_rad,
            psi_rad,
        }
    }
}

/// A rig that cannot be rendered.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum SceneError {
    #[error(transparent)]
    Effect(#[from] EffectError),
    #[error("{what} = {value}; it must lie in {low} .. {high}")]
    Range {
        /// Which number, with its unit.
        what: &'static str,
        value: f64,
        low: f64,
        high: f64,
    },
    #[error("target slab \"{slab}\": its outline {reason}")]
    Outline { slab: String, reason: &'static str },
    #[error("board \"{board}\": {what} = {value}; it must be positive and finite")]
    Board {
        board: String,
        what: &'static str,
        value: f64,
    },
    #[error("the target has {slabs} slabs, at most {limit} can be rendered; merge some")]
    TooManySlabs { slabs: usize, limit: usize },
}
