//! Where the vehicle is, from one frame by itself: hands move it in ways that no model of a run expects.
//!
//! A target that repeats itself looks the same a whole repetition on ([`Finder::repeats_m`]). The place next to the start is
//! tried first, then those further on, one a frame: off the target's end wrong ones do not fit. What was found is
//! followed from frame to frame. A line across hexagons alone does not show which of them it lies on: a person sees it.

use super::Seen;
use crate::analysis::Analyst;
use hydroline_calib::Pose;
use hydroline_calib::plane::PlaneMap;
use hydroline_core::frame::Frame;
use hydroline_log::messages::pb::StripeProfile;
use hydroline_pose::joint::{Hint, JointPose, PoseFitter};
use hydroline_rigs::Rig;
use hydroline_stripe::ExtractorConfig;
use std::sync::Arc;

/// A place that is known worse than this guides nobody: a third of the tolerance \[m\].
const MAX_SD_M: f64 = 0.01;
/// The same of the heading \[rad\]: 1 deg.
const MAX_SD_RAD: f64 = 0.0175;
/// Repetitions beside the start that are tried, in this order: a run goes ahead more often than back.
const BESIDE: [f64; 6] = [1.0, -1.0, 2.0, 3.0, 4.0, 5.0];

/// Measures poses of frames.
pub struct Finder {
    analyst: Analyst,
    fitter: PoseFitter,
    start_x_m: f64,
    /// Where the vehicle was seen in the frame before.
    last_x_m: Option<f64>,
    /// Which of [`BESIDE`] is tried next.
    turn: usize,
}

/// Stripe and pose that a frame gave.
#[derive(Debug, Clone, PartialEq)]
pub struct Look {
    /// Its stripe.
    pub profile: StripeProfile,
    /// Place and heading, as far as it shows them.
    pub seen: Seen,
    /// The whole pose, where there is one.
    pub pose: Option<Pose>,
}

impl Finder {
    /// For a rig under the map in force.
    pub fn new(rig: &Rig, map: Arc<dyn PlaneMap>) -> Self {
        Self {
            analyst: Analyst::new(
                ExtractorConfig::default(),
                Some(map.clone()),
                rig.grey_rule(),
            )
            .learning(),
            fitter: PoseFitter::new(rig, map),
            start_x_m: rig.tank.start_pose[0],
            last_x_m: None,
            turn: 0,
        }
    }

    /// Where the vehicle may be in the next frame.
    fn hints_m(&mut self) -> Vec<f64> {
        let mut hints: Vec<f64> = self.last_x_m.into_iter().collect();
        hints.push(self.start_x_m);
        if let (None, Some(repeats_m)) = (self.last_x_m, self.repeats_m()) {
            hints.push(self.start_x_m + BESIDE[self.turn] * repeats_m);
            self.turn = (self.turn + 1) % BESIDE.len();
        }
        hints
    }

    /// After how many metres along x the target looks the same; `None` = it does not repeat itself.
    pub fn repeats_m(&self) -> Option<f64> {
        self.fitter.surfaces().period_m
    }

    /// Looks at a frame.
    pub fn look(&mut self, frame: &Frame) -> Look {
        let (profile, whole) = self.analyst.analyse_whole(frame);
        let hints_m = self.hints_m();
        let fit = whole.ok().and_then(|(image, stripe)| {
            hints_m.into_iter().find_map(|x_m| {
                let hint = Hint {
                    x_m: Some(x_m),
                    ..Hint::default()
                };
                let fit = self.fitter.fit(&image, &stripe, &hint).ok();
                fit.filter(|fit| !fit.is_flagged() && fit.measured[0])
            })
        });
        self.last_x_m = fit.as_ref().map(|fit| fit.pose.x_m);
        Look {
            profile,
            seen: fit.as_ref().map(seen).unwrap_or_default(),
            pose: fit.map(|fit| fit.pose),
        }
    }
}

/// Place and heading that a fit shows well enough.
fn seen(fit: &JointPose) -> Seen {
    let values = fit.pose.to_array();
    let value = |i: usize| {
        let most = if i < 3 { MAX_SD_M } else { MAX_SD_RAD };
        let sd = fit.covariance[(i, i)].sqrt();
        (fit.measured[i] && sd <= most && values[i].is_finite()).then_some(values[i])
    };
    Seen {
        x_m: value(0),
        y_m: value(1),
        psi_rad: value(5),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bring_back::{Guide, Left, Stage, StartTolerance};
    use bytes::Bytes;
    use hydroline_calib::analytic::IdealMap;
    use hydroline_core::frame::{FrameMeta, LossBefore, PixelFormat, StampClock, StampSource};
    use hydroline_sim::Renderer;

    /// The simulated camera where somebody holds the vehicle.
    fn held_at(rig: &Rig, renderer: &Renderer, eta: [f64; 6], k: u64) -> Frame {
        let pose = hydroline_sim::Pose6::from(eta);
        Frame {
            format: PixelFormat::Grey,
            width_px: rig.camera.width_px,
            height_px: rig.camera.height_px,
            stride_bytes: rig.camera.width_px,
            data: Bytes::from(renderer.render(&pose, k).0),
            meta: FrameMeta {
                sequence: k as u32,
                driver_stamp_ns: k,
                stamp_clock: StampClock::Realtime,
                stamp_source: StampSource::MidExposure,
                flags: 0,
                received_monotonic_ns: k,
                mid_exposure_ns: k,
                exposure_s: rig.camera.exposure_s,
                fault: None,
                lost_before: LossBefore::default(),
            },
        }
    }

    #[test]
    fn a_vehicle_that_is_moved_by_hand_is_guided_to_the_start() {
        let rig = Rig::builtin("lshpi").unwrap();
        let map = Arc::new(IdealMap::of(&rig));
        let renderer = Renderer::new(&rig).unwrap();
        let mut finder = Finder::new(&rig, map);
        let start = rig.tank.start_pose;
        let mut guide = Guide::new(start, StartTolerance::default());
        let mut at_ns = 0;
        // More than half a hexagon ahead; nearer, rotated by 3.5 deg; then at the start, for long enough.
        let mut away = start;
        away[0] += 0.12;
        let mut nearer = start;
        nearer[0] += 0.06;
        nearer[5] += 3.5f64.to_radians();
        let mut stages = Vec::new();
        for (k, eta) in [away, nearer, start, start, start].into_iter().enumerate() {
            let look = finder.look(&held_at(&rig, &renderer, eta, k as u64));
            let left = Left::of(&start, &look.seen);
            let exact = Left::of(
                &start,
                &Seen {
                    x_m: Some(eta[0]),
                    y_m: Some(eta[1]),
                    psi_rad: Some(eta[5]),
                },
            );
            let forward = left.forward_m.unwrap() - exact.forward_m.unwrap();
            assert!(forward.abs() < 0.005, "{left} instead of {exact}");
            let turn = left.turn_rad.unwrap() - exact.turn_rad.unwrap();
            assert!(turn.abs() < 0.01, "{left} instead of {exact}");
            at_ns += 600_000_000;
            guide.look(at_ns, look.seen);
            stages.push(guide.stage(at_ns));
        }
        assert!(matches!(stages[0], Stage::Away(_)), "{stages:?}");
        assert!(matches!(stages[1], Stage::Away(_)), "{stages:?}");
        assert!(matches!(stages[2], Stage::Arriving(_)), "{stages:?}");
        assert!(matches!(stages[4], Stage::Back(_)), "{stages:?}");
        // Where the floor is bare it is not known.
        let mut behind = start;
        behind[0] -= 0.5;
        let look = finder.look(&held_at(&rig, &renderer, behind, 9));
        assert_eq!(look.seen, Seen::default());
    }
}
