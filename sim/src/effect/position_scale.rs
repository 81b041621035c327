//! `position_scale`: every measured position is off by a factor. A motion-only log never shows it.

use super::{EffectInfo, Law, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "position_scale",
    law: "measured position times gain",
    stage: Stage::Measurement,
    order: 110,
    parameters: &[ParameterInfo::new(
        "gain",
        "1",
        "measured over true position (x, y and z, from the rig's zero)",
        (0.97, 1.03),
        (0.1, 10.0),
        1.01,
    )],
    words: &[],
    confusable: &["clock_drift", "target_scale", "thrust_scale"],
    source: "theory/physics.md, measurement (not identifiable in motion-only logs)",
};

#[derive(Debug)]
struct PositionScale<T>(T);

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    PositionScale(values.numbers[0])
}

impl<T: Real> Law<T> for PositionScale<T> {
    fn reported_pose(&self, _t_s: T, pose: &mut [T; 6]) {
        for position in &mut pose[..3] {
            *position = *position * self.0;
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    #[test]
    fn positions_scale_and_angles_do_not() {
        let pose = [1.0, -2.0, 0.5, 0.1, 0.2, 0.3];
        let seen = stack(&[entry("position_scale", &[("gain", 1.02)])]).reported_pose(0.0, pose);
        for (a, b) in seen.iter().zip([1.02, -2.04, 0.51, 0.1, 0.2, 0.3]) {
            assert!((a - b).abs() < 1e-15);
        }
    }
}
