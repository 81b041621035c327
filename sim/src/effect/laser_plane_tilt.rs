//! `laser_plane_tilt`: the sheet is not upright in the body.

use super::{EffectInfo, Law, Optics, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "laser_plane_tilt",
    law: "sheet x_b = l_laser + tan(pitch_rad) z_b + tan(yaw_rad) y_b (yaw > 0 brings starboard forward)",
    stage: Stage::Measurement,
    order: 50,
    parameters: &[
        ParameterInfo::new(
            "pitch_rad",
            "rad",
            "about the body y axis",
            (-0.02, 0.02),
            (-1.0, 1.0),
            0.005,
        )
        .or(0.0),
        ParameterInfo::new(
            "yaw_rad",
            "rad",
            "about the body z axis, opposite to psi",
            (-0.02, 0.02),
            (-1.0, 1.0),
            0.004,
        )
        .or(0.0),
    ],
    words: &[],
    confusable: &["board_offset", "camera_shift", "floor_slope", "laser_cone"],
    source: "theory/physics.md, measurement",
};

#[derive(Debug)]
struct Tilt<T> {
    tan_pitch: T,
    tan_yaw: T,
}

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    let [pitch, yaw] = [values.numbers[0], values.numbers[1]];
    Tilt {
        tan_pitch: pitch.sin() / pitch.cos(),
        tan_yaw: yaw.sin() / yaw.cos(),
    }
}

impl<T: Real> Law<T> for Tilt<T> {
    fn optics(&self, optics: &mut Optics<T>) {
        optics.sheet_tan_pitch = optics.sheet_tan_pitch + self.tan_pitch;
        optics.sheet_tan_yaw = optics.sheet_tan_yaw + self.tan_yaw;
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    #[test]
    fn the_stripe_lies_on_the_tilted_sheet() {
        let (plain, tilted) =
            stripe_rows(&[entry("laser_plane_tilt", &[("pitch_rad", 0.01)])], 0.78);
        // At 0.78 m below the apex the sheet is 0.78 tan(0.01) further forward.
        let forward = 0.46 + 0.78 * 0.01f64.tan();
        let angle = std::f64::consts::FRAC_PI_4 - (forward / 0.56).atan();
        assert!((tilted.row_px - tilted.centre_px - tilted.focal_px * angle.tan()).abs() < 1e-9);
        assert!(
            tilted.row_px < plain.row_px,
            "further forward is further up"
        );
    }

    #[test]
    fn yaw_brings_starboard_forward() {
        let profile = profile(&[entry("laser_plane_tilt", &[("yaw_rad", 0.01)])], 0.78);
        let (port, starboard) = (profile[0], profile[profile.len() - 1]);
        assert!(
            starboard.row_px < port.row_px - 1.0,
            "{port:?} {starboard:?}"
        );
    }
}
