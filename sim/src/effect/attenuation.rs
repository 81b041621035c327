//! `attenuation`: the water absorbs the laser on its way there and back.

use super::{EffectInfo, Law, Optics, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "attenuation",
    law: "light times exp(-c_pm (laser to surface + surface to camera))",
    stage: Stage::Measurement,
    order: 150,
    parameters: &[ParameterInfo::new(
        "c_pm",
        "1/m",
        "attenuation coefficient",
        (0.05, 1.0),
        (0.0, 20.0),
        0.3,
    )],
    words: &[],
    confusable: &["backscatter_haze", "image_saturation", "speckle"],
    source: "theory/physics.md, measurement; Beer-Lambert law",
};

#[derive(Debug)]
struct Attenuation<T>(T);

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Attenuation(values.numbers[0])
}

impl<T: Real> Law<T> for Attenuation<T> {
    fn optics(&self, optics: &mut Optics<T>) {
        optics.attenuation_pm = optics.attenuation_pm + self.0;
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    #[test]
    fn light_falls_with_the_whole_way() {
        let (with, without) = (
            column(&[entry("attenuation", &[("c_pm", 0.5)])]),
            column(&[]),
        );
        let sum = |c: &[f64]| c.iter().sum::<f64>();
        // 0.78 m down from the apex, back to the camera over (0.46, 0.56).
        let way = 0.78 + 0.46f64.hypot(0.56);
        assert!((sum(&with) / sum(&without) / (-0.5 * way).exp() - 1.0).abs() < 1e-3);
    }
}
