//! `clock_drift`: the measurement's clock runs fast against the commands' clock.

use super::{EffectInfo, Law, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "clock_drift",
    law: "stamp - t0 = (t - t0) (1 + drift_ppm 1e-6)",
    stage: Stage::Timing,
    order: 10,
    parameters: &[ParameterInfo::new(
        "drift_ppm",
        "1e-6",
        "rate of the measurement's clock over that of the commands', minus one",
        (-2000.0, 2000.0),
        (-1e5, 1e5),
        500.0,
    )],
    words: &[],
    confusable: &["camera_latency", "position_scale"],
    source: "theory/physics.md, timing; a BlueROV log: 308-861 ppm",
};

#[derive(Debug)]
struct ClockDrift<T>(T);

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    ClockDrift(values.numbers[0])
}

impl<T: Real> Law<T> for ClockDrift<T> {
    fn scene_time_s(&self, stamp_s: T, _row_px: f64) -> T {
        stamp_s / (T::one() + self.0 * 1e-6)
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::tests::fixtures::*;

    #[test]
    fn a_fast_clock_stamps_late() {
        let (mut fast, mut plain) = (
            world(&[entry("clock_drift", &[("drift_ppm", 2000.0)])]),
            world(&[]),
        );
        for w in [&mut fast, &mut plain] {
            drive(w, 4.0);
        }
        // A pose stamped 3 (1 + 0.002) s was true at 3 s.
        let was = plain.state_at(3.0).unwrap().eta;
        let seen = fast.pose_reported(3.006).unwrap().to_array();
        for (a, b) in seen.iter().zip(was) {
            assert!((a - b).abs() < 1e-12);
        }
    }
}
