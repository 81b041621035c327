//! What a frame says of the pose, or why it says nothing.

use super::super::segments::{Caveat, SegmentError};
use super::Matrix7;
use hydroline_calib::Pose;
use nalgebra::Matrix6;

/// Why a number is missing or larger in its sd than usual.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum PoseCaveat {
    /// About the stripe.
    #[error(transparent)]
    Stripe(#[from] Caveat),
    /// No target in sight: x, y, ψ are not measured, θ is taken as zero (or as held) and z hangs on it.
    #[error(
        "a bare floor shows z and roll only: x, y and yaw are not measured, z holds for the pitch assumed"
    )]
    BareFloor,
    /// θ taken as known.
    #[error("pitch is not shown by this frame: held, and x and z hold for that pitch")]
    PitchHeld,
    /// The target repeats itself and no hint said which repetition.
    #[error("the target looks the same one hexagon on: x is known up to that, a hint is needed")]
    WhichHexagon,
    /// Two different poses explain the frame about equally well.
    #[error("another pose explains the frame nearly as well")]
    Ambiguous,
    /// Many pixels were set aside.
    #[error(
        "many pixels do not fit and were set aside: particles, haze, or a target that is not the rig's"
    )]
    Misfit,
}

/// The pose of one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct JointPose {
    /// CG in the tank frame.
    pub pose: Pose,
    /// Covariance of (x, y, z, φ, θ, ψ) \[m², rad²\]; meaningful where `measured`.
    pub covariance: Matrix6<f64>,
    /// The same with the thickness \[m\] as seventh: it goes with the weak direction, and is the
    /// same in all frames of a run. Zero where held.
    pub covariance_with_thickness: Matrix7,
    /// Which of x, y, z, φ, θ, ψ the frame determines.
    pub measured: [bool; 6],
    /// Sheet's thickness as fitted \[m\].
    pub thickness_m: f64,
    /// Brightness as fitted \[grey levels\].
    pub brightness: f64,
    /// Background as fitted \[grey levels\].
    pub background: f64,
    /// Pixel noise as found \[grey levels\].
    pub noise_sd: f64,
    /// Share of pixels set aside.
    pub rejected: f64,
    /// Doubt of the edges' pixels as found, share of a pixel cut in half.
    pub edge_doubt: f64,
    /// Pixels compared.
    pub pixels: usize,
    /// What to mind.
    pub caveats: Vec<PoseCaveat>,
}

/// Why a frame gives no pose.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PoseFault {
    /// The stripe.
    #[error("no stripe: {0}")]
    NoStripe(String),
    /// Sorting it.
    #[error(transparent)]
    Segments(#[from] SegmentError),
    /// The image is not the map's.
    #[error(
        "image is {got_px:?}, the calibration holds for {wanted_px:?}: use the camera's own calibration"
    )]
    Size {
        /// Width, height there \[px\].
        got_px: (usize, usize),
        /// Of the map \[px\].
        wanted_px: (usize, usize),
    },
    /// Steps were seen, but not so that they lie on the target.
    #[error(
        "{steps} steps of the stripe lie nowhere on the target: is it the rig's target, and does it lie where the rig says?"
    )]
    Nowhere {
        /// Steps.
        steps: usize,
    },
    /// None near the hint.
    #[error(
        "the steps fit the target only {away_m:.3} m or more from where the vehicle is known to be ({hint_m:.3} m)"
    )]
    FarFromHint {
        /// Nearest place, distance from the hint \[m\].
        away_m: f64,
        /// The hint \[m\].
        hint_m: f64,
    },
    /// The fit does not explain the frame.
    #[error(
        "the best pose leaves {chi:.1} times the noise in the pixels: glare, haze, or another target than the rig's"
    )]
    Unexplained {
        /// Residual over noise, rms.
        chi: f64,
    },
    /// The fit went astray.
    #[error("the fit of the pose did not settle")]
    Unsettled,
}
