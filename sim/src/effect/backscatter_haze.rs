//! `backscatter_haze`: turbid water glows beyond the stripe.

use super::{EffectInfo, Law, Optics, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "backscatter_haze",
    law: "light + fraction peak exp(-d/length_m) at a distance d > 0 beyond (forward of) the sheet",
    stage: Stage::Measurement,
    order: 120,
    parameters: &[
        ParameterInfo::new(
            "fraction",
            "1",
            "haze beside the stripe over the stripe's peak",
            (0.01, 0.1),
            (0.0, 1.0),
            0.05,
        ),
        ParameterInfo::new(
            "length_m",
            "m",
            "distance over which it fades by e",
            (0.005, 0.05),
            (0.0005, 1.0),
            0.01,
        ),
    ],
    words: &[],
    confusable: &[
        "attenuation",
        "board_offset",
        "camera_shift",
        "image_saturation",
    ],
    source: "theory/physics.md, measurement; theory/noise.md, rows of the stripe",
};

#[derive(Debug)]
struct Haze<T> {
    fraction: T,
    length_m: T,
}

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Haze {
        fraction: values.numbers[0],
        length_m: values.numbers[1],
    }
}

impl<T: Real> Law<T> for Haze<T> {
    fn optics(&self, optics: &mut Optics<T>) {
        optics.haze_fraction = self.fraction;
        optics.haze_length_m = self.length_m;
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    /// The glow of a column is fraction peak length, in metres on the floor, all of it on the far side.
    #[test]
    fn it_adds_its_integral_on_the_far_side() {
        let haze = [entry(
            "backscatter_haze",
            &[("fraction", 0.05), ("length_m", 0.01)],
        )];
        let (with, without) = (column(&haze), column(&[]));
        let added: Vec<f64> = with.iter().zip(&without).map(|(a, b)| a - b).collect();
        // Pinhole at (0.46 behind, 0.56 above): pixels per metre of floor along the column, at the stripe.
        let fine = 1e-6;
        let focal = stripe_rows(&[], 0.78).0.focal_px;
        let row = |ahead: f64| focal * ((0.56 - 0.46 - ahead) / (1.02 + ahead));
        let per_m = (row(-fine) - row(fine)) / (2.0 * fine);
        let sum: f64 = added.iter().sum();
        let peak = 200.0;
        // The scale changes by 2 % over the haze's length.
        assert!(
            (sum / (0.05 * peak * 0.01 * per_m) - 1.0).abs() < 0.04,
            "{sum} {per_m}"
        );
        let top = without
            .iter()
            .enumerate()
            .max_by(|a, b| a.1.total_cmp(b.1))
            .unwrap()
            .0;
        let near: f64 = added[top + 4..].iter().sum();
        assert!(near < 0.02 * sum, "{near} of {sum} on the near side");
    }

    /// theory/physics.md, measurement: -0.08 px at 5 % for a stripe finder of the stripe's own width.
    #[test]
    fn it_pulls_the_stripes_centre_up_by_a_tenth_of_a_pixel() {
        let haze = [entry(
            "backscatter_haze",
            &[("fraction", 0.05), ("length_m", 0.01)],
        )];
        let moved = centre(&column(&haze)) - centre(&column(&[]));
        assert!((-0.2..-0.03).contains(&moved), "{moved}");
    }
}
