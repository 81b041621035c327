//! `ambient_gradient`: daylight or a lamp beside the tank makes the background rise across the image.

use super::{EffectInfo, Law, Optics, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "ambient_gradient",
    law: "background + columns_grey c + rows_grey r, c and r = 0 in the first and 1 in the last column and row; a negative number rises the other way, by 1 - c or 1 - r",
    stage: Stage::Measurement,
    order: 180,
    parameters: &[
        ParameterInfo::new(
            "columns_grey",
            "grey level",
            "how much brighter the background is on the right than on the left, on a linear camera",
            (-20.0, 20.0),
            (-255.0, 255.0),
            5.0,
        )
        .or(0.0),
        ParameterInfo::new(
            "rows_grey",
            "grey level",
            "how much brighter it is at the bottom than at the top",
            (-20.0, 20.0),
            (-255.0, 255.0),
            3.0,
        )
        .or(0.0),
    ],
    words: &[],
    confusable: &["lens_shading", "mains_banding"],
    source: "first order of any light that is not the laser's; camera.noise.ambient is its constant part",
};

#[derive(Debug)]
struct Gradient<T>([T; 2]);

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Gradient([values.numbers[0], values.numbers[1]])
}

impl<T: Real> Law<T> for Gradient<T> {
    fn optics(&self, optics: &mut Optics<T>) {
        optics.brightness.ambient_rise_grey = self.0;
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    #[test]
    fn the_background_rises_across_and_down_and_never_below_what_it_was() {
        let of = |columns: f64, rows: f64| {
            let rise = [("columns_grey", columns), ("rows_grey", rows)];
            Bare::quiet(10.0, &[entry("ambient_gradient", &rise)]).dark()
        };
        let image = of(7.19, 5.75);
        // A hundredth of a level per column and row.
        assert_eq!(image[0], 10);
        assert_eq!(image[719], 17);
        assert_eq!(image[575 * 720], 16);
        assert_eq!(image[575 * 720 + 719], 23);
        assert_eq!(image[300 * 720 + 400], 17);
        let other = of(-7.19, 0.0);
        assert_eq!((other[0], other[719], other[575 * 720]), (17, 10, 17));
    }
}
