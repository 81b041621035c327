//! `camera_latency`: the stamp of a frame is later than what it shows.

use super::{EffectInfo, Law, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "camera_latency",
    law: "a frame stamped t shows the scene at t - delay_s",
    stage: Stage::Timing,
    order: 20,
    parameters: &[ParameterInfo::new(
        "delay_s",
        "s",
        "stamp minus the time the scene was as shown",
        (0.001, 0.15),
        // A negative delay would show what is not yet commanded.
        (0.0, 2.0),
        0.04,
    )],
    words: &[],
    confusable: &[
        "clock_drift",
        "command_latency",
        "fluid_memory",
        "interlace",
        "rolling_shutter",
        "thruster_lag",
    ],
    source: "theory/physics.md, timing",
};

#[derive(Debug)]
struct CameraLatency<T>(T);

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    CameraLatency(values.numbers[0])
}

impl<T: Real> Law<T> for CameraLatency<T> {
    fn scene_time_s(&self, stamp_s: T, _row_px: f64) -> T {
        stamp_s - self.0
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    #[test]
    fn the_reported_pose_is_that_of_before() {
        let (mut late, mut plain) = (
            world(&[entry("camera_latency", &[("delay_s", 0.06)])]),
            world(&[]),
        );
        for w in [&mut late, &mut plain] {
            drive(w, 3.0);
        }
        let was = plain.state_at(1.94).unwrap().eta;
        assert_eq!(late.pose_reported(2.0).unwrap().to_array(), was);
        assert_eq!(late.state_at(2.0).unwrap(), plain.state_at(2.0).unwrap());
    }
}
