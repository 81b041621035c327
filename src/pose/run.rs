//! Poses of a run, frame after frame: which hexagon is meant follows from where the vehicle was.
//!
//! Nothing else but the camera's response ([`super::opening`]: found once, then fixed) is carried over from frame to frame, and the guess that a fit starts from does not
//! depend on the hint that picked it: a frame gives the same pose whether or not the frames
//! between were looked at, as long as the motion decides for the same place ([`super::place`]). On a
//! target that does not repeat itself the hint picks the guesses within centimetres: there it holds while the
//! vehicle is expected that well; later a frame is looked for anywhere.

use super::joint::{
    EDGES_ALIKE, EDGES_NOWHERE, EDGES_OFF, EDGES_SOUND, Hint, JointPose, MapLoadings, PoseCaveat,
    PoseFault, PoseFitter, Speculative, total_covariance,
};
use super::place::{Carried, Place};
use super::smooth::Smoothed;
use hydroline_calib::plane::PlaneMap;
use hydroline_core::frame::GreyImage;
use hydroline_log::messages::VehicleMotion;
use hydroline_rigs::Rig;
use hydroline_stripe::Profile;
use nalgebra::Matrix6;
use std::sync::Arc;

/// Expected worse than this, a place on a target without repetitions is looked for anywhere \[m\].
const EXPECTED_SD_M: f64 = 0.03;
/// Expected this well, x tells whether edges that are a little off are those of another place \[m\]: other places are
/// centimetres off.
const ANCHORED_SD_M: f64 = 0.015;
/// A pose agrees with the expected place within so many sds of both.
const AGREES_SDS: f64 = 3.0;
/// A frame whose steps fit nowhere near the expected place is looked for as far as so many of its sds.
const FAR_SDS: f64 = 4.0;

/// Follows a vehicle over its target.
#[derive(Clone)]
pub struct PoseRun {
    fitter: PoseFitter,
    start: Arc<Place>,
    place: Place,
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
        let fitter = PoseFitter::new(rig, map);
        let surfaces = fitter.surfaces();
        let place = Place::new(rig, surfaces.period_m, surfaces.span_m);
        PoseRun {
            start: Arc::new(place.clone()),
            fitter,
            place,
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
            start: self.start.clone(),
            place: (*self.start).clone(),
        }
    }

    /// The same where it is now with another fitter of the same rig.
    pub fn going_on_with(self, fitter: PoseFitter) -> Self {
        PoseRun { fitter, ..self }
    }

    /// Takes a command: thruster and thrust \[N\] that hold from a stamp on (UNIX). A frame is to be fitted after the commands
    /// before it.
    pub fn command(&mut self, stamp_ns: u64, thruster: &str, thrust_n: f64) {
        self.place.command(stamp_ns, thruster, thrust_n);
    }

    /// Takes several, the oldest first.
    pub fn commands<N: AsRef<str>>(&mut self, commands: &[(u64, N, f64)]) {
        for (stamp_ns, thruster, thrust_n) in commands {
            self.command(*stamp_ns, thruster.as_ref(), *thrust_n);
        }
    }

    /// The pose of the frame that was true at `stamp_ns` (UNIX).
    pub fn pose(&mut self, stamp_ns: u64, image: &GreyImage, profile: &Profile) -> RunPose {
        self.place.begin(stamp_ns);
        let fit = self.fitter.fit(image, profile, &self.hint(stamp_ns));
        self.judged(stamp_ns, fit, |fitter, hint| {
            fitter.fit(image, profile, hint)
        })
    }

    /// Fits a frame before its turn, in parallel with others.
    pub fn speculative(&self, stamp_ns: u64, image: &GreyImage, profile: &Profile) -> Speculative {
        // However far ahead it is: in its turn the place will be known.
        let hint = Hint {
            x_m: Some(self.place.carried(stamp_ns).x_m),
            ..Hint::default()
        };
        self.fitter.speculative(image, profile, &hint)
    }

    /// The pose of a frame that was fitted speculatively: the same bits as [`Self::pose`].
    pub fn pose_speculative(
        &mut self,
        stamp_ns: u64,
        image: &GreyImage,
        profile: &Profile,
        speculative: Speculative,
    ) -> RunPose {
        self.place.begin(stamp_ns);
        let hint = self.hint(stamp_ns);
        let fit = self
            .fitter
            .fit_speculative(image, profile, speculative, &hint);
        self.judged(stamp_ns, fit, |fitter, hint| {
            fitter.fit(image, profile, hint)
        })
    }

    /// Hint for the frame that was true at `stamp_ns`, from the poses before it or the start.
    pub fn hint(&self, stamp_ns: u64) -> Hint {
        let carried = self.place.carried(stamp_ns);
        let known = self.fitter.surfaces().period_m.is_some() || carried.sd_m < EXPECTED_SD_M;
        Hint {
            x_m: known.then_some(carried.x_m),
            ..Hint::default()
        }
    }

    /// Whether a pose may be used; the place of the next ones then follows from it. `again` fits the frame under another hint.
    fn judged(
        &mut self,
        stamp_ns: u64,
        fit: Result<JointPose, PoseFault>,
        again: impl Fn(&PoseFitter, &Hint) -> Result<JointPose, PoseFault>,
    ) -> RunPose {
        let expected = self.place.carried(stamp_ns);
        let at = |x_m: f64| {
            let hint = Hint {
                x_m: Some(x_m),
                ..Hint::default()
            };
            again(&self.fitter, &hint)
        };
        let fit = match fit {
            Err(PoseFault::FarFromHint { away_m, hint_m }) if away_m < FAR_SDS * expected.sd_m => {
                let further = [hint_m + away_m, hint_m - away_m];
                let fault = PoseFault::FarFromHint { away_m, hint_m };
                further
                    .into_iter()
                    .find_map(|x_m| at(x_m).ok())
                    .ok_or(fault)
            }
            fit => fit,
        };
        let mut fit = match fit {
            Ok(fit) => Box::new(fit),
            Err(fault) => return RunPose::None(fault),
        };
        // The place decides, below.
        fit.caveats.retain(|c| *c != PoseCaveat::WhichHexagon);
        if fit.measured[0] {
            settle_edges(&mut fit, &expected, self.fitter.surfaces().period_m);
        }
        if fit.is_flagged() {
            return RunPose::Flagged(fit);
        }
        if !fit.measured[0] {
            return RunPose::Good(fit);
        }
        let variance_m2 = fit.covariance[(0, 0)];
        let carried = self
            .place
            .update(stamp_ns, fit.pose.x_m, variance_m2, fit.pose.psi_rad);
        if !carried.is_decided() {
            fit.caveats.push(PoseCaveat::WhichHexagon);
            fit.carried = Some(Carried {
                since_s: expected.since_s,
                ..carried
            });
            return RunPose::Flagged(fit);
        }
        let elsewhere = |p: f64| (fit.pose.x_m - carried.x_m).abs() > 0.5 * p;
        if !self.fitter.surfaces().period_m.is_some_and(elsewhere) {
            return RunPose::Good(fit);
        }
        // The same frame one repetition or more on.
        let hint = Hint {
            x_m: Some(carried.x_m),
            ..Hint::default()
        };
        match again(&self.fitter, &hint) {
            Ok(mut there) => {
                there.caveats.retain(|c| *c != PoseCaveat::WhichHexagon);
                settle_edges(&mut there, &carried, self.fitter.surfaces().period_m);
                match there.is_flagged() {
                    true => RunPose::Flagged(Box::new(there)),
                    false => RunPose::Good(Box::new(there)),
                }
            }
            Err(fault) => RunPose::None(fault),
        }
    }
}

/// Takes a pose whose edges are a little off, as a compressed frame's are, for the expected place's where x agrees with
/// it; its sds grow with what the edges leave. Where that is not scatter but a shift of whole edges, x that agrees says nothing: a wrong
/// response of the camera shifts the poses that the place comes from alike.
fn settle_edges(fit: &mut JointPose, expected: &Carried, period_m: Option<f64>) {
    let off = fit.edge_model_error;
    if !fit.caveats.contains(&PoseCaveat::EdgesOff)
        || !(EDGES_OFF..EDGES_NOWHERE).contains(&off)
        || fit.edges_alike > EDGES_ALIKE
        || !expected.is_decided()
        || expected.sd_m > ANCHORED_SD_M
    {
        return;
    }
    let sds = off / EDGES_SOUND;
    let away_m = fit.pose.x_m - expected.x_m;
    let away_m = away_m - period_m.map_or(0.0, |p| (away_m / p).round() * p);
    let variance_m2 = expected.sd_m.powi(2) + sds * sds * fit.covariance[(0, 0)];
    if away_m.abs() <= AGREES_SDS * variance_m2.sqrt() {
        fit.caveats.retain(|c| *c != PoseCaveat::EdgesOff);
        fit.widen(sds);
    }
}

/// Loadings as the format has them, without the errors that the map does not have; empty where it has none.
fn shared_loadings(of: &MapLoadings) -> Vec<f64> {
    let is_there = |k: &usize| of.column(*k).iter().any(|v| *v != 0.0);
    let count = (0..of.ncols()).rfind(is_there).map_or(0, |last| last + 1);
    let rows = (0..6).flat_map(|i| (0..count).map(move |k| of[(i, k)]));
    rows.collect()
}

/// The message of a pose: what was not measured stays out; its rows in the covariance are zero.
pub fn motion_message(stamp_ns: u64, fit: &JointPose) -> VehicleMotion {
    let pose = (fit.pose.to_array(), fit.measured);
    message(stamp_ns, pose, (&fit.covariance, &fit.loadings))
}

/// The same of a smoothed frame.
pub fn smoothed_message(frame: &Smoothed) -> VehicleMotion {
    let pose = (frame.eta, frame.measured);
    message(frame.stamp_ns, pose, (&frame.covariance, &frame.loadings))
}

fn message(
    stamp_ns: u64,
    (eta, measured): ([f64; 6], [bool; 6]),
    (own, loadings): (&Matrix6<f64>, &MapLoadings),
) -> VehicleMotion {
    let eta = std::array::from_fn(|i| measured[i].then(|| eta[i]));
    let total = total_covariance(own, loadings);
    VehicleMotion {
        covariance: total.transpose().iter().copied().collect(),
        shared_loadings: shared_loadings(loadings),
        ..VehicleMotion::of_pose(stamp_ns, eta)
    }
}

#[cfg(test)]
mod tests;
