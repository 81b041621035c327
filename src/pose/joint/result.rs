//! The pose estimated from a frame, or why there is none.

use super::super::photometric::{ACROSS, UNEVEN};
use super::super::segments::{Caveat, SegmentError};
use super::{EDGES_ALIKE, EDGES_OFF, EDGES_SOUND, LightSeen, MapLoadings, Matrix7, ResponseSeen};
use crate::place::Carried;
use hydroline_calib::Pose;
use nalgebra::Matrix6;

/// Reason why a number is missing, or its sd larger than usual.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum PoseCaveat {
    #[error(transparent)]
    Stripe(#[from] Caveat),
    #[error(
        "a bare floor shows z and roll only: x, y and yaw are not measured, z holds for the pitch assumed"
    )]
    BareFloor,
    #[error("pitch is not shown by this frame: held, and x and z hold for that pitch")]
    PitchHeld,
    #[error("the target looks the same one hexagon on: x is known up to that")]
    WhichHexagon,
    #[error("another pose explains the frame nearly as well")]
    Ambiguous,
    #[error(
        "many pixels do not fit and were set aside: particles, haze, or a target that is not the rig's"
    )]
    Misfit,
    #[error(
        "the target's edges are not where the pose has them: another place on the target, a sheet that is not the rig's (`replay --refine` finds its tilt and thickness), another target, a camera whose response is not the one in force (`hydroline flat`), or light that the model does not know"
    )]
    EdgesOff,
}

/// The pose of one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct JointPose {
    /// CG in the tank frame.
    pub pose: Pose,
    /// Covariance of (x, y, z, φ, θ, ψ) \[m², rad²\] of the frame's own error; meaningful where `measured`.
    pub covariance: Matrix6<f64>,
    /// Error by each error that all poses of this map share.
    pub loadings: MapLoadings,
    /// The same with the thickness \[m\] as seventh: it goes with the weak direction, and is the
    /// same in all frames of a run. Zero where held.
    pub covariance_with_thickness: Matrix7,
    /// Sd of θ \[rad\] with the camera's response taken as it is held: from the frame's own pixels alone.
    pub theta_sd_alone_rad: f64,
    /// Whether the frame determines each of x, y, z, φ, θ, ψ.
    pub measured: [bool; 6],
    /// Sheet's thickness as fitted \[m\].
    pub thickness_m: f64,
    /// Brightness as fitted \[grey levels\].
    pub brightness: f64,
    /// Background as fitted \[grey levels\].
    pub background: f64,
    /// ln γ of the camera's response as fitted: 0 for one that leaves light as it is.
    pub tone: f64,
    /// Its black level as fitted \[grey levels\]; 0 where the response leaves light as it is, and the background holds it.
    pub black: f64,
    /// The line's transverse profile as fitted: coefficients of Hermite polynomials of orders 3 to 10.
    pub across: [f64; ACROSS],
    /// Estimate of the response from this frame, where it is open ([`super::PoseFitter::with_response_open`]).
    pub response: Option<ResponseSeen>,
    /// Coefficients of uneven light as fitted: of the brightness as a share of it, of the background \[grey levels\].
    pub uneven: [f64; UNEVEN],
    /// Light and camera as the fit found them.
    pub light: LightSeen,
    /// Pixel noise as found \[grey levels\].
    pub noise_sd: f64,
    /// Share of pixels set aside.
    pub rejected: f64,
    /// Model error of the edges' pixels: sd beyond their noise, as a share of the light of a pixel cut in half.
    pub edge_model_error: f64,
    /// Share of its square that the pixels of an edge have alike: scatter has none, a wrong place or a wrong response of the camera
    /// more than half.
    pub edges_alike: f64,
    /// Pixels compared.
    pub pixels: usize,
    /// Reservations about the pose.
    pub caveats: Vec<PoseCaveat>,
    /// Where a run carries x, as long as the motion has not decided between places.
    pub carried: Option<Carried>,
}

/// Covariance of a pose of its own error and of those that it shares.
pub(crate) fn total_covariance(own: &Matrix6<f64>, loadings: &MapLoadings) -> Matrix6<f64> {
    let by = loadings.fixed_rows::<6>(0);
    own + by * by.transpose()
}

impl JointPose {
    /// Whether a caveat flags the pose: not to be used without looking at it.
    pub fn is_flagged(&self) -> bool {
        [
            PoseCaveat::WhichHexagon,
            PoseCaveat::Ambiguous,
            PoseCaveat::Misfit,
            PoseCaveat::EdgesOff,
        ]
        .iter()
        .any(|c| self.caveats.contains(c))
    }

    /// Whether the edges are not where the target has them: off by too much, or off as a whole.
    pub(crate) fn edges_are_off(&self) -> bool {
        self.edge_model_error >= EDGES_OFF
            || self.edge_model_error >= EDGES_SOUND && self.edges_alike > EDGES_ALIKE
    }

    /// Covariance of (x, y, z, φ, θ, ψ) \[m², rad²\] with what all poses of this map share.
    pub fn total_covariance(&self) -> Matrix6<f64> {
        total_covariance(&self.covariance, &self.loadings)
    }

    /// Scales what the pose states of its own uncertainty by a factor of its sds.
    pub(crate) fn widen(&mut self, sds: f64) {
        self.covariance *= sds * sds;
        self.covariance_with_thickness *= sds * sds;
        self.theta_sd_alone_rad *= sds;
    }

    /// The caveats in words, and where the frame does not fit, what its light looks like.
    pub fn reasons(&self) -> String {
        let mut words: Vec<String> = self.caveats.iter().map(ToString::to_string).collect();
        words.extend(self.carried.as_ref().map(ToString::to_string));
        let off = [PoseCaveat::Misfit, PoseCaveat::EdgesOff];
        if off.iter().any(|c| self.caveats.contains(c)) {
            words.push(format!(
                "{:.0} % of the pixels set aside, edges leave {:.2} of the light that they cut",
                100.0 * self.rejected,
                self.edge_model_error
            ));
            words.push(self.light.to_string());
        }
        words.retain(|w| !w.is_empty());
        words.join("; ")
    }
}

/// Reason why a frame gives no pose.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum PoseFault {
    #[error("no stripe: {0}")]
    NoStripe(String),
    #[error(transparent)]
    Segments(#[from] SegmentError),
    #[error(
        "image is {got_px:?}, the calibration holds for {wanted_px:?}: use the camera's own calibration"
    )]
    Size {
        /// Width, height there \[px\].
        got_px: (usize, usize),
        /// Of the map \[px\].
        wanted_px: (usize, usize),
    },
    #[error(
        "{steps} steps of the stripe lie nowhere on the target: is it the rig's target, and does it lie where the rig says?"
    )]
    Nowhere { steps: usize },
    #[error(
        "a flat line of {line_m:.2} m without an edge: floor, or one of the target's upper faces, on which up to {face_m:.2} m may lie; z is not known"
    )]
    FloorOrFace {
        line_m: f64,
        /// Longest line on an upper face \[m\].
        face_m: f64,
    },
    #[error(
        "the steps fit the target only {away_m:.3} m or more from where the vehicle is known to be ({hint_m:.3} m)"
    )]
    FarFromHint { away_m: f64, hint_m: f64 },
    #[error(
        "the best pose leaves {chi:.1} times the noise in the pixels: {}",
        glare(light)
    )]
    Unexplained { chi: f64, light: LightSeen },
    #[error("the fit of the pose did not converge")]
    NotConverged,
}

fn glare(light: &LightSeen) -> String {
    match light.to_string() {
        seen if seen.is_empty() => "glare, haze, or another target than the rig's".to_owned(),
        seen => format!("glare, haze, or another target than the rig's; {seen}"),
    }
}
