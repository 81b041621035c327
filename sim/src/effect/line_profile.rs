//! `line_profile`: the laser's fan is not equally bright over its angle.

use super::{EffectInfo, Law, Optics, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "line_profile",
    law: "laser light times 1 - end_loss w^2 + tilt w / 2 (not below 0), w = fan angle over half the fan, -1 at the port end, 1 at the starboard end",
    stage: Stage::Measurement,
    order: 160,
    parameters: &[
        ParameterInfo::new(
            "end_loss",
            "1",
            "share of the light that both ends of the fan lack",
            (0.0, 0.5),
            (0.0, 1.0),
            0.15,
        )
        .or(0.0),
        ParameterInfo::new(
            "tilt",
            "1",
            "how much brighter the starboard end is than the port end, over the middle",
            (-0.4, 0.4),
            (-2.0, 2.0),
            0.1,
        )
        .or(0.0),
    ],
    words: &[],
    confusable: &["lens_shading"],
    source: "line optics of laser modules: a Powell lens leaves some 10-20 % over the fan, a cylinder lens a Gaussian's fall",
};

#[derive(Debug)]
struct Profile<T> {
    end_loss: T,
    tilt: T,
}

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Profile {
        end_loss: values.numbers[0],
        tilt: values.numbers[1],
    }
}

impl<T: Real> Law<T> for Profile<T> {
    fn optics(&self, optics: &mut Optics<T>) {
        optics.brightness.line_end_loss = self.end_loss;
        optics.brightness.line_tilt = self.tilt;
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    /// A level vehicle: the angle of a column's stripe follows from the camera's similar triangles.
    #[test]
    fn the_light_falls_with_the_fans_angle_and_leans_to_starboard() {
        let (end_loss, tilt) = (0.3, 0.2);
        let with = entry("line_profile", &[("end_loss", end_loss), ("tilt", tilt)]);
        let height_m = 0.78;
        let (with, plain) = (Bare::new(&[with]), Bare::new(&[]));
        let (lit, clean) = (with.clean(height_m), plain.clean(height_m));
        let half_fan_rad = 20.0f64.to_radians();
        for column in [60, 200, 360, 500, 660] {
            let sum = |image: &[f32]| -> f64 {
                let lights = image.iter().skip(column).step_by(plain.width_px());
                lights.map(|v| f64::from(*v)).sum()
            };
            // The camera 0.46 m behind the stripe and 0.56 m above it, tilted by 45 deg; the apex straight above the stripe.
            let depth_m = (0.46 + 0.56) / 2.0f64.sqrt();
            let y_m = (column as f64 - 360.0) / plain.focal_px() * depth_m;
            let w = (y_m / height_m).atan() / half_fan_rad;
            let expected = 1.0 - end_loss * w * w + 0.5 * tilt * w;
            let seen = sum(&lit) / sum(&clean);
            assert!(
                (seen - expected).abs() < 2e-4,
                "{column}: {seen} {expected}"
            );
        }
    }
}
