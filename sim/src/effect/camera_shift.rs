//! `camera_shift`: the camera has moved since the calibration.

use super::{EffectInfo, Law, Optics, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "camera_shift",
    law: "tilt + rotation_rad (> 0 looks further forward), position + (dx_m, dy_m, dz_m) in the body frame",
    stage: Stage::Measurement,
    order: 40,
    parameters: &[
        ParameterInfo::new(
            "rotation_rad",
            "rad",
            "about the body y axis",
            (-0.02, 0.02),
            (-0.5, 0.5),
            0.003,
        )
        .or(0.0),
        ParameterInfo::new("dx_m", "m", "forward", (-0.01, 0.01), (-0.5, 0.5), 0.002).or(0.0),
        ParameterInfo::new(
            "dy_m",
            "m",
            "to starboard",
            (-0.01, 0.01),
            (-0.5, 0.5),
            0.001,
        )
        .or(0.0),
        ParameterInfo::new("dz_m", "m", "down", (-0.01, 0.01), (-0.5, 0.5), -0.001).or(0.0),
    ],
    words: &[],
    confusable: &[
        "backscatter_haze",
        "board_offset",
        "floor_slope",
        "laser_plane_tilt",
        "lens_distortion",
        "refraction",
        "rolling_shutter",
    ],
    source: "theory/physics.md, measurement",
};

#[derive(Debug)]
struct Shift<T>([T; 4]);

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Shift(std::array::from_fn(|i| values.numbers[i]))
}

impl<T: Real> Law<T> for Shift<T> {
    fn optics(&self, optics: &mut Optics<T>) {
        let [rotation_rad, shift @ ..] = self.0;
        optics.camera_tilt_rad = optics.camera_tilt_rad + rotation_rad;
        for (place, by) in optics.camera_m.iter_mut().zip(shift) {
            *place = *place + by;
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    #[test]
    fn the_stripe_is_seen_from_the_new_place() {
        let shift = [("rotation_rad", 0.01), ("dx_m", 0.004), ("dz_m", 0.006)];
        let (plain, moved) = stripe_rows(&[entry("camera_shift", &shift)], 0.78);
        // Angle of the stripe below the axis, which looks 45 deg forward of straight down.
        let angle = |forward: f64, down: f64, tilt: f64| tilt - (forward / down).atan();
        let quarter = std::f64::consts::FRAC_PI_4;
        for (row, a) in [
            (plain, angle(0.46, 0.56, quarter)),
            (moved, angle(0.456, 0.554, quarter + 0.01)),
        ] {
            assert!((row.row_px - row.centre_px - row.focal_px * a.tan()).abs() < 1e-9);
        }
    }
}
