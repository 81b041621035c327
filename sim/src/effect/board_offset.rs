//! `board_offset`: the calibration board stood off the sheet: the sheet is not where the calibration says.

use super::{EffectInfo, Law, Optics, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "board_offset",
    law: "sheet at l_laser - offset_m",
    stage: Stage::Measurement,
    order: 70,
    parameters: &[ParameterInfo::new(
        "offset_m",
        "m",
        "board beyond the sheet (forward)",
        (-0.003, 0.003),
        (-0.1, 0.1),
        0.001,
    )],
    words: &[],
    confusable: &["backscatter_haze", "camera_shift", "laser_plane_tilt"],
    source: "theory/physics.md, measurement",
};

#[derive(Debug)]
struct Offset<T>(T);

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Offset(values.numbers[0])
}

impl<T: Real> Law<T> for Offset<T> {
    fn optics(&self, optics: &mut Optics<T>) {
        // The rig's plane is where the board stood; the sheet itself is that much behind it.
        optics.l_laser_m = optics.l_laser_m - self.0;
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    /// 1 mm of offset reads as 0.5 .. 1.6 mm in eta (theory/physics.md, measurement): here by the rig's own map.
    #[test]
    fn a_millimetre_reads_as_one_in_eta() {
        let (_, seen) = stripe_rows(&[entry("board_offset", &[("offset_m", 0.001)])], 0.78);
        let angle =
            std::f64::consts::FRAC_PI_4 - ((seen.row_px - seen.centre_px) / seen.focal_px).atan();
        // eta where the rig's upright sheet, 0.46 m ahead of the camera, meets this ray; the truth is -0.1.
        let eta = 0.46 - 0.46 / angle.tan();
        assert!((0.5e-3..1.6e-3).contains(&(eta + 0.1).abs()), "{eta}");
    }
}
