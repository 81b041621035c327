//! `rolling_shutter`: the rows of a frame are exposed one after the other.

use super::{EffectInfo, Law, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "rolling_shutter",
    law: "row j (0 at the stamp) shows t + j row_time_s",
    stage: Stage::Timing,
    order: 40,
    parameters: &[ParameterInfo::new(
        "row_time_s",
        "s",
        "from one row to the next",
        (10e-6, 35e-6),
        (0.0, 1e-3),
        25e-6,
    )],
    words: &[],
    confusable: &["camera_latency", "camera_shift", "interlace"],
    source: "theory/physics.md, timing; CMOS sensors with an electronic rolling shutter",
};

#[derive(Debug)]
struct RollingShutter<T>(T);

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    RollingShutter(values.numbers[0])
}

impl<T: Real> Law<T> for RollingShutter<T> {
    fn scene_time_s(&self, stamp_s: T, row_px: f64) -> T {
        stamp_s + self.0 * row_px
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    #[test]
    fn a_lower_row_is_later() {
        let stack = stack(&[entry("rolling_shutter", &[("row_time_s", 20e-6)])]);
        assert_eq!(stack.scene_time_s(3.0, 0.0), 3.0);
        assert!((stack.scene_time_s(3.0, 500.0) - 3.01).abs() < 1e-15);
    }
}
