//! `floor_slope`: the floor, and the target on it, is not level.

use super::{EffectInfo, Law, Optics, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "floor_slope",
    law: "surface at z = -slope X (> 0 rises along +X), target on it",
    stage: Stage::Measurement,
    order: 90,
    parameters: &[ParameterInfo::new(
        "slope",
        "1",
        "rise per length along tank X",
        (-0.02, 0.02),
        (-0.5, 0.5),
        0.005,
    )],
    words: &[],
    confusable: &["attitude_disturbance", "camera_shift", "laser_plane_tilt"],
    source: "theory/physics.md, measurement",
};

#[derive(Debug)]
struct Slope<T>(T);

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Slope(values.numbers[0])
}

impl<T: Real> Law<T> for Slope<T> {
    fn optics(&self, optics: &mut Optics<T>) {
        optics.floor_slope = optics.floor_slope + self.0;
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    #[test]
    fn the_floor_comes_up_ahead() {
        let (plain, up) = stripe_rows(&[entry("floor_slope", &[("slope", 0.02)])], 0.78);
        // At the sheet, X = 0.27: 5.4 mm higher.
        let angle = std::f64::consts::FRAC_PI_4 - (0.46f64 / (0.56 - 0.02 * 0.27)).atan();
        assert!((up.row_px - up.centre_px - up.focal_px * angle.tan()).abs() < 1e-9);
        assert!(up.row_px < plain.row_px);
    }
}
