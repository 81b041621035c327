//! `tone_curve`: the camera's grey level is a power of the light.

use super::{EffectInfo, Law, Optics, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "tone_curve",
    law: "grey level 255 (v / 255)^gamma of v grey levels of a linear camera, noise included (v below 0 counts as 0); rounding comes after",
    stage: Stage::Measurement,
    order: 200,
    parameters: &[ParameterInfo::new(
        "gamma",
        "1",
        "exponent: 1 = linear, below 1 lifts the dark levels as video cameras do",
        (0.4, 2.2),
        (0.1, 10.0),
        0.7,
    )],
    words: &[],
    confusable: &["image_saturation", "range_clipping"],
    source: "power laws of ITU-R BT.709 (0.45) and of displays (2.2), without their linear toe",
};

#[derive(Debug)]
struct Curve<T>(T);

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Curve(values.numbers[0])
}

impl<T: Real> Law<T> for Curve<T> {
    fn optics(&self, optics: &mut Optics<T>) {
        optics.brightness.gamma = self.0;
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    #[test]
    fn levels_are_a_power_of_the_light() {
        let curve = [entry("tone_curve", &[("gamma", 0.5)])];
        // 255 (v / 255)^(1/2) = sqrt(255 v).
        for (ambient, expected) in [(0.0, 0), (51.0, 114), (100.0, 160), (255.0, 255)] {
            assert_eq!(Bare::quiet(ambient, &curve).dark()[17], expected);
        }
    }

    /// Noise is the sensor's, before the curve: dg = g'(v) dv.
    #[test]
    fn noise_is_steeper_where_the_curve_is() {
        let sd = |ambient: f64| {
            let curve = entry("tone_curve", &[("gamma", 0.5)]);
            let image = Bare::noisy(ambient, 1.5, &[curve]).dark();
            let values = image.iter().map(|v| f64::from(*v));
            let mean = values.clone().sum::<f64>() / image.len() as f64;
            let square = values.map(|v| (v - mean).powi(2)).sum::<f64>();
            // Less what rounding adds.
            (square / image.len() as f64 - 1.0 / 12.0).sqrt()
        };
        for ambient in [30.0, 120.0] {
            let slope = 0.5 * (255.0f64 / ambient).sqrt();
            assert!(
                (sd(ambient) / (1.5 * slope) - 1.0).abs() < 0.02,
                "{ambient}"
            );
        }
    }
}
