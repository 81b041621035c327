//! `image_saturation`: the sensor clips below its full scale.

use super::{EffectInfo, Law, Optics, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "image_saturation",
    law: "grey levels above level_grey are level_grey (the sensor's, before any tone curve)",
    stage: Stage::Measurement,
    order: 130,
    parameters: &[ParameterInfo::new(
        "level_grey",
        "grey level",
        "greatest grey level that it gives",
        (80.0, 250.0),
        (1.0, 255.0),
        140.0,
    )],
    words: &[],
    confusable: &[
        "attenuation",
        "backscatter_haze",
        "range_clipping",
        "speckle",
        "tone_curve",
    ],
    source: "theory/physics.md, measurement",
};

#[derive(Debug)]
struct Saturation<T>(T);

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Saturation(values.numbers[0])
}

impl<T: Real> Law<T> for Saturation<T> {
    fn optics(&self, optics: &mut Optics<T>) {
        optics.saturation = optics.saturation.min(self.0);
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    #[test]
    fn nothing_is_brighter_than_the_level() {
        let image = image(&[entry("image_saturation", &[("level_grey", 120.0)])]);
        assert_eq!(image.iter().max(), Some(&120));
        assert!(image.iter().filter(|v| **v == 120).count() > 500);
    }
}
