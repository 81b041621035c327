//! `lens_distortion`: the lens distorts what the rig takes for straight.

use super::{EffectInfo, Law, Optics, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "lens_distortion",
    law: "x_d = x (1 + k1 r^2 + k2 r^4) + 2 p1 x y + p2 (r^2 + 2 x^2), y_d likewise, on normalised coordinates (x right, y down)",
    stage: Stage::Measurement,
    order: 30,
    parameters: &[
        ParameterInfo::new(
            "k1",
            "1",
            "radial, second order",
            (-0.3, 0.3),
            (-1.0, 1.0),
            -0.02,
        )
        .or(0.0),
        ParameterInfo::new(
            "k2",
            "1",
            "radial, fourth order",
            (-0.1, 0.1),
            (-1.0, 1.0),
            0.005,
        )
        .or(0.0),
        ParameterInfo::new("p1", "1", "tangential", (-0.01, 0.01), (-0.2, 0.2), 0.0005).or(0.0),
        ParameterInfo::new("p2", "1", "tangential", (-0.01, 0.01), (-0.2, 0.2), -0.0005).or(0.0),
    ],
    words: &[],
    confusable: &["camera_shift", "laser_cone", "refraction"],
    source: "theory/physics.md, measurement; Brown 1971",
};

#[derive(Debug)]
struct Distortion<T>([T; 4]);

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Distortion(std::array::from_fn(|i| values.numbers[i]))
}

impl<T: Real> Law<T> for Distortion<T> {
    fn optics(&self, optics: &mut Optics<T>) {
        optics.distortion = self.0;
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    /// The stripe's middle lies on the axis' column, where p2 and x vanish.
    #[test]
    fn the_stripe_moves_by_browns_law() {
        let (k1, k2, p1) = (-0.1, 0.02, 0.003);
        let lens = [("k1", k1), ("k2", k2), ("p1", p1), ("p2", 0.0)];
        let (plain, changed) = stripe_rows(&[entry("lens_distortion", &lens)], 0.78);
        let y = (plain.row_px - plain.centre_px) / plain.focal_px;
        let r2 = y * y;
        let distorted = y * (1.0 + k1 * r2 + k2 * r2 * r2) + 3.0 * p1 * r2;
        let seen = (changed.row_px - changed.centre_px) / changed.focal_px;
        assert!((seen - distorted).abs() < 1e-12, "{seen} {distorted}");
    }
}
