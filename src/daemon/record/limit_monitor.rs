//! The rig's limits while running, on a thread of its own.
//!
//! z and roll come from the stripe's floor line, x, y and pitch from the measured poses. Where neither is fresh the model's
//! prediction from the sent commands stands in, while thrusters push; and when nothing is seen at all, neutral. A measurement
//! counts once, however often it is looked at: one outlier must not become the three in a row that abort.

use super::floor::Floor;
use super::limits::{Estimate, LimitMonitor};
use super::measured_pose::MeasuredPose;
use super::{Job, RecordError, Shared, worker};
use hydroline_core::event::{Severity, kind};
use hydroline_core::lock::Lock;
use hydroline_core::shutdown::StopReason;
use hydroline_thruster::NeutralHandle;
use hydroline_thruster::safety::NeutralReason;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

/// Period at which the limits are looked at.
const LOOK: Duration = Duration::from_millis(50);
/// A floor line older than this says nothing about now \[ns\].
const FRESH_NS: u64 = 500_000_000;
/// A measured pose older than this says nothing about now \[ns\]: a fit on a busy computer takes some tenths of a
/// second, and while a pose stands for now, the faster model is not asked.
const FRESH_POSE_NS: u64 = 400_000_000;
/// Without a good frame for so long a moving vehicle is unwatched: neutral \[ns\]. Longer than a camera
/// takes to come back from an unplugged cable (2-3 s), shorter than a metre at full ahead.
const BLIND_NS: u64 = 5_000_000_000;

/// A floor line and when it was measured, CLOCK_MONOTONIC \[ns\].
pub(super) type Measured = (u64, Floor);

/// Sorts what is known into one estimate per look.
#[derive(Debug, Default)]
struct Sight {
    /// Stamp of the floor line that was counted last.
    floor_ns: Option<u64>,
    /// Stamp of the pose that was counted last.
    pose_ns: Option<u64>,
}

/// One channel: what is measured, if it is new; nothing while it is fresh and was counted; else the model.
fn channel(measured: Option<f64>, is_new: bool, model: Option<f64>) -> Option<f64> {
    match measured {
        Some(value) => is_new.then_some(value),
        None => model,
    }
}

impl Sight {
    /// `floor` and `pose` are what is fresh, `model` the prediction.
    fn estimate(
        &mut self,
        floor: Option<Measured>,
        pose: Option<MeasuredPose>,
        model: Estimate,
    ) -> Estimate {
        let floor_ns = floor.map(|(at_ns, _)| at_ns);
        let new_floor = floor.is_some() && self.floor_ns != floor_ns;
        self.floor_ns = floor_ns.or(self.floor_ns);
        let pose_ns = pose.map(|p| p.received_ns);
        let new_pose = pose.is_some() && self.pose_ns != pose_ns;
        self.pose_ns = pose_ns.or(self.pose_ns);

        let of_pose = |i: usize, model| channel(pose.and_then(|p| p.sane(i)), new_pose, model);
        // The floor line is there for every frame, the pose only when there was time to fit it: the faster one warns first.
        let of_floor = |value: Option<f64>, i: usize, model| match value {
            Some(value) => new_floor.then_some(value),
            None => of_pose(i, model),
        };
        Estimate {
            x_m: of_pose(0, model.x_m),
            y_m: of_pose(1, model.y_m),
            z_m: of_floor(floor.map(|(_, f)| -f.height_m), 2, model.z_m),
            phi_rad: of_floor(floor.map(|(_, f)| f.phi_rad), 3, model.phi_rad),
            theta_rad: of_pose(4, model.theta_rad),
        }
    }
}

/// Watches until the shutdown is raised.
pub(super) fn start(
    shared: Arc<Shared>,
    job: &Job,
    neutral: Option<NeutralHandle>,
) -> Result<JoinHandle<Option<()>>, RecordError> {
    let mut monitor = LimitMonitor::new(job.rig.limits);
    if !shared.tracker.is_tracking() {
        let words = "the rig's model cannot be simulated: x, y and pitch are watched only where the target is measured";
        shared.say(Severity::Warning, &kind::LIMIT_UNWATCHED, words);
    }
    worker::spawn("limits", shared, move |shared| {
        let mut blind = false;
        let mut sight = Sight::default();
        while !shared.shutdown.wait(LOOK) {
            let now_ns = shared.clock.monotonic_ns();
            let estimate = look(shared, &mut sight, now_ns);
            if let Some(words) = monitor.update(&estimate) {
                if let Some(neutral) = &neutral {
                    neutral.request(NeutralReason::Limit);
                }
                shared.say(Severity::Error, &kind::LIMIT_PASSED, words.clone());
                shared.shutdown.raise(StopReason::Limit(words));
            }
            let last_good_ns = shared.progress(|p| p.last_good_ns);
            let silent = last_good_ns.is_some_and(|last| now_ns.saturating_sub(last) > BLIND_NS);
            if silent && !blind {
                if let Some(neutral) = &neutral {
                    neutral.request(NeutralReason::Limit);
                }
                let seconds = BLIND_NS / 1_000_000_000;
                let words = format!(
                    "no good frame for {seconds} s: nobody watches the vehicle, thrusters to neutral; recording goes on"
                );
                shared.say(Severity::Error, &kind::LIMIT_BLIND, words);
            }
            blind = silent;
        }
    })
}

fn look(shared: &Shared, sight: &mut Sight, now_ns: u64) -> Estimate {
    let floor = *shared.floor.held();
    let pose = *shared.pose.held();
    sight.estimate(
        floor.filter(|(at_ns, _)| now_ns.saturating_sub(*at_ns) <= FRESH_NS),
        pose.filter(|p| now_ns.saturating_sub(p.received_ns) <= FRESH_POSE_NS),
        shared.tracker.estimate(now_ns),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_rigs::Limits;

    fn monitor() -> LimitMonitor {
        LimitMonitor::new(Limits {
            x_m: [-0.1, 1.5],
            y_m: [-1.0, 1.0],
            z_m: [-1.0, -0.5],
            attitude_rad: 0.3,
        })
    }

    fn floor(at_ns: u64, height_m: f64) -> Option<Measured> {
        let floor = Floor {
            height_m,
            phi_rad: 0.0,
            share: 1.0,
        };
        Some((at_ns, floor))
    }

    fn pose(received_ns: u64, x_m: f64, sd_m: f64) -> Option<MeasuredPose> {
        let mut eta = [Some((0.0, 0.001)); 6];
        eta[0] = Some((x_m, sd_m));
        eta[2] = Some((-0.8, 0.001));
        Some(MeasuredPose { received_ns, eta })
    }

    fn at_x(x_m: f64) -> Estimate {
        Estimate {
            x_m: Some(x_m),
            ..Estimate::default()
        }
    }

    #[test]
    fn one_floor_line_counts_once_however_often_it_is_looked_at() {
        let (mut sight, mut monitor) = (Sight::default(), monitor());
        for _ in 0..10 {
            let estimate = sight.estimate(floor(1, 0.2), None, Estimate::default());
            assert_eq!(monitor.update(&estimate), None);
        }
        for at_ns in [2, 3] {
            let estimate = sight.estimate(floor(at_ns, 0.2), None, Estimate::default());
            let words = monitor.update(&estimate);
            assert_eq!(words.is_some(), at_ns == 3, "{words:?}");
        }
    }

    #[test]
    fn a_measured_x_beyond_aborts_although_the_model_is_inside() {
        let (mut sight, mut monitor) = (Sight::default(), monitor());
        let mut words = None;
        for received_ns in [1, 2, 2, 2, 3] {
            assert_eq!(words, None, "before the third pose");
            words = monitor.update(&sight.estimate(None, pose(received_ns, 1.7, 0.001), at_x(0.5)));
        }
        assert!(words.unwrap().contains("x = 1.700"));
    }

    #[test]
    fn a_model_beyond_is_nothing_against_a_fresh_pose_inside_but_counts_without_one() {
        let (mut sight, mut monitor) = (Sight::default(), monitor());
        for _ in 0..10 {
            let estimate = sight.estimate(None, pose(1, 0.5, 0.001), at_x(1.7));
            assert_eq!(monitor.update(&estimate), None);
        }
        // A pose that hardly knows its x is none.
        let looks: Vec<_> = (2..5)
            .map(|ns| monitor.update(&sight.estimate(None, pose(ns, 0.5, 0.1), at_x(1.7))))
            .collect();
        assert!(looks[0].is_none() && looks[2].is_some(), "{looks:?}");
    }

    #[test]
    fn without_anything_nothing_is_claimed() {
        let estimate = Sight::default().estimate(None, None, Estimate::default());
        assert_eq!(estimate, Estimate::default());
    }
}
