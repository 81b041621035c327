//! `range_clipping`: the camera's 8-bit range ends before 0 and 255.

use super::{EffectInfo, Law, Optics, ParameterInfo, Stage, Values, WordInfo};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "range_clipping",
    law: "clip: a level below floor_grey is floor_grey, one above ceiling_grey is ceiling_grey; scale (video range): floor_grey + g (ceiling_grey - floor_grey) / 255; after the tone curve, scale before clip where both are given, before rounding",
    stage: Stage::Measurement,
    order: 210,
    parameters: &[
        ParameterInfo::new(
            "floor_grey",
            "grey level",
            "least grey level that it gives",
            (0.0, 30.0),
            (0.0, 100.0),
            16.0,
        )
        .or(0.0),
        ParameterInfo::new(
            "ceiling_grey",
            "grey level",
            "greatest grey level that it gives",
            (200.0, 255.0),
            (110.0, 255.0),
            235.0,
        )
        .or(255.0),
    ],
    words: &[WordInfo {
        name: "how",
        meaning: "whether levels are clipped to the range or scaled into it",
        allowed: &["clip", "scale"],
        absent: Some("clip"),
    }],
    confusable: &["image_saturation", "tone_curve"],
    source: "ITU-R BT.601: 16 to 235 of 8 bits",
};

#[derive(Debug)]
struct Range<T> {
    ends_grey: [T; 2],
    scales: bool,
}

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Range {
        ends_grey: [values.numbers[0], values.numbers[1]],
        scales: values.words.first() == Some(&1),
    }
}

impl<T: Real> Law<T> for Range<T> {
    fn optics(&self, optics: &mut Optics<T>) {
        if self.scales {
            optics.brightness.scaled_grey = self.ends_grey;
        } else {
            optics.brightness.clipped_grey = self.ends_grey;
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    #[test]
    fn levels_outside_are_pushed_to_the_ends_or_all_are_squeezed() {
        let ends = [("floor_grey", 16.0), ("ceiling_grey", 235.0)];
        let level = |ambient: f64, how: &str| {
            let range = with_word(entry("range_clipping", &ends), "how", how);
            Bare::quiet(ambient, &[range]).dark()[17]
        };
        for (ambient, clipped, scaled) in [
            (0.0, 16, 16),
            (15.0, 16, 29),
            (17.0, 17, 31),
            (100.0, 100, 102),
            (255.0, 235, 235),
        ] {
            assert_eq!(level(ambient, "clip"), clipped);
            assert_eq!(level(ambient, "scale"), scaled);
        }
    }

    /// The curve first: sqrt(255 x 240) = 247 is above the ceiling, sqrt(255 x 200) = 226 is not.
    #[test]
    fn it_comes_after_the_tone_curve() {
        let both = [
            entry("range_clipping", &[("ceiling_grey", 235.0)]),
            entry("tone_curve", &[("gamma", 0.5)]),
        ];
        assert_eq!(Bare::quiet(240.0, &both).dark()[17], 235);
        assert_eq!(Bare::quiet(200.0, &both).dark()[17], 226);
    }
}
