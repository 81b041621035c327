//! Poses of a run, frame after frame: which hexagon is meant follows from where the vehicle was.
//!
//! Nothing else but the camera's response ([`super::opening`]: found once, then fixed) is carried over from frame to frame, and the guess that a fit starts from does not
//! depend on the hint that picked it: a frame gives the same pose whether or not the frames
//! between were looked at, as long as the vehicle cannot have passed half a hexagon meanwhile. On a
//! target that does not repeat itself the hint picks the guesses within centimetres: there it holds while the
//! vehicle is expected that well.

use super::joint::{Hint, JointPose, PoseCaveat, PoseFault, PoseFitter, Speculative};
use hydroline_calib::plane::PlaneMap;
use hydroline_core::frame::GreyImage;
use hydroline_log::messages::VehicleMotion;
use hydroline_rigs::Rig;
use hydroline_stripe::Profile;
use std::sync::Arc;

/// Fastest change of speed that continuity allows for \[m/s²\]: 16 N on the paper's vehicle give 0.06.
const ACCELERATION_MPS2: f64 = 0.2;

/// Follows a vehicle over its target.
#[derive(Clone)]
pub struct PoseRun {
    fitter: PoseFitter,
    start_x_m: f64,
    last: Option<Last>,
}

#[derive(Debug, Clone, Copy)]
struct Last {
    stamp_ns: u64,
    x_m: f64,
    u_mps: f64,
}

/// Outcome of a frame of a run.
#[derive(Debug, Clone, PartialEq)]
pub enum RunPose {
    /// A pose fit to be used.
    Good(Box<JointPose>),
    /// A pose that should not be used without looking at its caveats.
    Flagged(Box<JointPose>),
    /// No pose, for this reason.
    None(PoseFault),
}

impl PoseRun {
    /// Starts where the rig says the vehicle starts.
    pub fn new(rig: &Rig, map: Arc<dyn PlaneMap>) -> Self {
        PoseRun {
            fitter: PoseFitter::new(rig, map),
            start_x_m: rig.tank.start_pose[0],
            last: None,
        }
    }

    /// The fitter.
    pub fn fitter(&self) -> &PoseFitter {
        &self.fitter
    }

    /// The same from the start with another fitter of the same rig.
    pub fn with_fitter(&self, fitter: PoseFitter) -> Self {
        PoseRun {
            fitter,
            start_x_m: self.start_x_m,
            last: None,
        }
    }

    /// The same where it is now with another fitter of the same rig.
    pub fn going_on_with(self, fitter: PoseFitter) -> Self {
        PoseRun { fitter, ..self }
    }

    /// The pose of the frame that was true at `stamp_ns` (UNIX).
    pub fn pose(&mut self, stamp_ns: u64, image: &GreyImage, profile: &Profile) -> RunPose {
        let fit = self.fitter.fit(image, profile, &self.hint(stamp_ns));
        self.judged(stamp_ns, fit)
    }

    /// Fits a frame before its turn, in parallel with others.
    pub fn speculative(&self, stamp_ns: u64, image: &GreyImage, profile: &Profile) -> Speculative {
        self.fitter
            .speculative(image, profile, &self.hint(stamp_ns))
    }

    /// The pose of a frame that was fitted speculatively: the same bits as [`Self::pose`].
    pub fn pose_speculative(
        &mut self,
        stamp_ns: u64,
        image: &GreyImage,
        profile: &Profile,
        speculative: Speculative,
    ) -> RunPose {
        let hint = self.hint(stamp_ns);
        let fit = self
            .fitter
            .fit_speculative(image, profile, speculative, &hint);
        self.judged(stamp_ns, fit)
    }

    /// Hint for the frame that was true at `stamp_ns`, from the poses before it or the start.
    pub fn hint(&self, stamp_ns: u64) -> Hint {
        Hint {
            x_m: Some(self.expected(stamp_ns).0),
            ..Hint::default()
        }
    }

    /// Whether a pose may be used; it is then the hint of the next ones.
    fn judged(&mut self, stamp_ns: u64, fit: Result<JointPose, PoseFault>) -> RunPose {
        let (hint_m, open_m) = self.expected(stamp_ns);
        let mut fit = match fit {
            Ok(fit) => Box::new(fit),
            Err(fault) => return RunPose::None(fault),
        };
        let period_m = self.fitter.surfaces().period_m;
        if fit.measured[0]
            && period_m.is_some_and(|p| open_m + (fit.pose.x_m - hint_m).abs() > 0.5 * p)
        {
            fit.caveats.push(PoseCaveat::WhichHexagon);
        }
        if fit.is_flagged() {
            return RunPose::Flagged(fit);
        }
        if fit.measured[0] {
            self.remember(stamp_ns, fit.pose.x_m);
        }
        RunPose::Good(fit)
    }

    /// Where the vehicle is expected, and how far it may be from there \[m\].
    fn expected(&self, stamp_ns: u64) -> (f64, f64) {
        let Some(last) = self.last else {
            return (self.start_x_m, 0.0);
        };
        let s = (stamp_ns as f64 - last.stamp_ns as f64) * 1e-9;
        (last.x_m + last.u_mps * s, 0.5 * ACCELERATION_MPS2 * s * s)
    }

    fn remember(&mut self, stamp_ns: u64, x_m: f64) {
        let u_mps = match self.last {
            // Over less than 20 ms the noise of two poses is all there is.
            Some(last) if stamp_ns.saturating_sub(last.stamp_ns) > 20_000_000 => {
                (x_m - last.x_m) / ((stamp_ns - last.stamp_ns) as f64 * 1e-9)
            }
            Some(last) => last.u_mps,
            None => 0.0,
        };
        self.last = Some(Last {
            stamp_ns,
            x_m,
            u_mps,
        });
    }
}

/// The message of a pose: what was not measured stays out; its rows in the covariance are zero.
pub fn motion_message(stamp_ns: u64, fit: &JointPose) -> VehicleMotion {
    let eta = fit.pose.to_array();
    let eta = std::array::from_fn(|i| fit.measured[i].then(|| eta[i]));
    VehicleMotion {
        covariance: fit.covariance.transpose().iter().copied().collect(),
        ..VehicleMotion::of_pose(stamp_ns, eta)
    }
}
