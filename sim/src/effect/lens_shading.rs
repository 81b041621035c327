//! `lens_shading`: a lens gives less light away from its axis.

use super::{EffectInfo, Law, Optics, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "lens_shading",
    law: "all light (laser, ambient, lamps) times 1 - corner_loss q, q = square of the distance from the optical axis over that of the farthest corner of the image",
    stage: Stage::Measurement,
    order: 170,
    parameters: &[ParameterInfo::new(
        "corner_loss",
        "1",
        "share of the light lost in the farthest corner",
        (0.02, 0.5),
        (0.0, 1.0),
        0.15,
    )],
    words: &[],
    confusable: &["ambient_gradient", "line_profile"],
    source: "vignetting and cos^4 falling off of a lens to second order; EMVA Standard 1288, 4.0 (photo response nonuniformity, low frequencies)",
};

#[derive(Debug)]
struct Shading<T>(T);

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Shading(values.numbers[0])
}

impl<T: Real> Law<T> for Shading<T> {
    fn optics(&self, optics: &mut Optics<T>) {
        optics.brightness.corner_loss = self.0;
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    #[test]
    fn corners_are_darker_for_every_light() {
        let shaded = Bare::quiet(100.0, &[entry("lens_shading", &[("corner_loss", 0.4)])]);
        let image = shaded.image();
        let at = |column: usize, row: usize| image[row * shaded.width_px() + column];
        // The axis at (360, 287.5) of 720 x 576: the left corners are farthest.
        assert_eq!(at(360, 288), 100);
        let q = (360.0f64 * 360.0 + 287.5 * 287.5) / (360.5 * 360.5 + 288.0 * 288.0);
        let corner = (100.0 * (1.0 - 0.4 * q)).round() as u8;
        assert_eq!((at(0, 0), at(0, 575), corner), (corner, corner, 60));
        let q = 180.0f64 * 180.0 / (360.5 * 360.5 + 288.0 * 288.0);
        assert_eq!(f64::from(at(180, 288)), (100.0 * (1.0 - 0.4 * q)).round());
        // The laser too.
        let (plain, shaded) = (
            Bare::quiet(0.0, &[]).image(),
            Bare::quiet(0.0, &[entry("lens_shading", &[("corner_loss", 0.4)])]).image(),
        );
        let lit = plain.iter().zip(&shaded).enumerate();
        let lit: Vec<_> = lit.filter(|(_, (p, _))| **p > 100).collect();
        assert!(lit.len() > 2000);
        for (n, (before, after)) in lit {
            let (u, v) = ((n % 720) as f64 - 360.0, (n / 720) as f64 - 287.5);
            let q = (u * u + v * v) / (360.5 * 360.5 + 288.0 * 288.0);
            let expected = f64::from(*before) * (1.0 - 0.4 * q);
            // Both are rounded.
            assert!((f64::from(*after) - expected).abs() <= 1.0, "{n}");
        }
    }
}
