//! `speckle`: coherent light makes the stripe grainy.

use super::{EffectInfo, Law, Optics, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "speckle",
    law: "light times a lognormal factor of mean 1 and standard deviation contrast, correlated over grain_px",
    stage: Stage::Measurement,
    order: 140,
    parameters: &[
        ParameterInfo::new(
            "contrast",
            "1",
            "standard deviation of the light over its mean",
            (0.05, 0.6),
            (0.0, 2.0),
            0.2,
        ),
        ParameterInfo::new(
            "grain_px",
            "px",
            "size of a grain",
            (0.5, 4.0),
            (0.1, 50.0),
            1.5,
        ),
    ],
    words: &[],
    confusable: &["attenuation", "image_saturation"],
    source: "theory/physics.md, measurement; Goodman 2007, Speckle Phenomena in Optics, 4.3 (integrated speckle)",
};

#[derive(Debug)]
struct Speckle<T> {
    contrast: T,
    grain_px: T,
}

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Speckle {
        contrast: values.numbers[0],
        grain_px: values.numbers[1],
    }
}

impl<T: Real> Law<T> for Speckle<T> {
    fn optics(&self, optics: &mut Optics<T>) {
        optics.speckle_contrast = self.contrast;
        optics.speckle_grain_px = self.grain_px;
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    #[test]
    fn the_stripe_scatters_by_the_contrast_and_keeps_its_mean() {
        let ratios = |grain: f64| {
            let with = image(&[entry("speckle", &[("contrast", 0.2), ("grain_px", grain)])]);
            let without = image(&[]);
            // Noise and rounding are small beside 20 % of 100 grey levels and more.
            let lit = without.iter().zip(with).filter(|(b, _)| **b > 100);
            lit.map(|(b, a)| (f64::from(a) - 10.0) / (f64::from(*b) - 10.0))
                .collect::<Vec<f64>>()
        };
        for grain in [1.0, 3.0] {
            let r = ratios(grain);
            let mean = r.iter().sum::<f64>() / r.len() as f64;
            let sd = (r.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / r.len() as f64).sqrt();
            assert!((mean - 1.0).abs() < 0.03, "{grain}: mean {mean}");
            assert!((sd - 0.2).abs() < 0.03, "{grain}: {sd}");
        }
    }
}
