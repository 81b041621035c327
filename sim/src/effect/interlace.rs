//! `interlace`: the odd rows of a frame are those of the next field (720 x 576 is PAL).

use super::{EffectInfo, Law, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "interlace",
    law: "rows 1, 3, 5 ... show t + field_s",
    stage: Stage::Timing,
    order: 50,
    parameters: &[ParameterInfo::new(
        "field_s",
        "s",
        "from the field of the even rows to that of the odd ones",
        (0.016, 0.021),
        (0.0, 1.0),
        0.02,
    )],
    words: &[],
    confusable: &["camera_latency", "rolling_shutter"],
    source: "theory/physics.md, timing; ITU-R BT.470 (PAL: 50 fields per second)",
};

#[derive(Debug)]
struct Interlace<T>(T);

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Interlace(values.numbers[0])
}

impl<T: Real> Law<T> for Interlace<T> {
    fn scene_time_s(&self, stamp_s: T, row_px: f64) -> T {
        // A row between two lines (a point spread's surroundings) belongs to the nearer one.
        if (row_px.round() as i64).rem_euclid(2) == 1 {
            stamp_s + self.0
        } else {
            stamp_s
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    #[test]
    fn odd_rows_are_a_field_later() {
        let stack = stack(&[entry("interlace", &[("field_s", 0.02)])]);
        let times: Vec<f64> = (0..4)
            .map(|j| stack.scene_time_s(1.0, f64::from(j)))
            .collect();
        assert_eq!(times, [1.0, 1.02, 1.0, 1.02]);
    }
}
