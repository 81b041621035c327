//! `laser_cone`: a fan that is tilted from its port's normal refracts into a curved sheet.

use super::{EffectInfo, Law, Optics, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "laser_cone",
    law: "with s = y_b/z_b: x_b + z_b sin(tilt) (sqrt((1 - (n^2 - 1) s^2) / (n^2 - sin^2(tilt))) - the same at s = 0); the middle goes as the rig says",
    stage: Stage::Measurement,
    order: 60,
    parameters: &[
        ParameterInfo::new(
            "tilt_rad",
            "rad",
            "fan against the normal of the laser's port",
            (-0.0873, 0.0873),
            (-0.7, 0.7),
            0.035,
        ),
        ParameterInfo::new(
            "n_water",
            "1",
            "refractive index of the water",
            (1.329, 1.345),
            (1.0, 1.6),
            1.333,
        )
        .or(1.333),
    ],
    words: &[],
    confusable: &["laser_plane_tilt", "lens_distortion"],
    source: "theory/physics.md, measurement; Snell's law for every ray of a plane fan (an elliptic cone: Castillon et al. 2022)",
};

#[derive(Debug)]
struct Cone<T> {
    sin: T,
    n_water: T,
}

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Cone {
        sin: values.numbers[0].sin(),
        n_water: values.numbers[1],
    }
}

impl<T: Real> Law<T> for Cone<T> {
    fn optics(&self, optics: &mut Optics<T>) {
        optics.cone_sin = self.sin;
        optics.cone_n_water = self.n_water;
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    /// Every ray of the fan by Snell's law at the port: the refracted sheet passes through it.
    #[test]
    fn rays_of_a_tilted_fan_lie_on_it() {
        let (tilt, n) = (0.0873f64, 1.333);
        let optics = optics(&[entry("laser_cone", &[("tilt_rad", tilt), ("n_water", n)])]);
        let middle = tilt.sin() / n / (1.0 - (tilt.sin() / n).powi(2)).sqrt();
        for beta in [-0.45f64, -0.2, 0.0, 0.1, 0.45] {
            // Unit ray in air; its part along the port is divided by n, the rest follows from length 1.
            let (x, y) = (beta.cos() * tilt.sin() / n, beta.sin() / n);
            let z = (1.0 - x * x - y * y).sqrt();
            let (y, z, x) = (0.7 * y / z, 0.7, 0.7 * x / z);
            assert!(
                (optics.cone_m(y, z) - (x - 0.7 * middle)).abs() < 1e-12,
                "{beta}"
            );
        }
    }

    /// notes: 0.34 mm at 1 deg, 1.7 mm at 5 deg off the best plane, 0.25 .. 0.75 m, +-20 deg.
    #[test]
    fn its_size_is_that_of_the_notes() {
        for (degrees, expected_mm) in [(1.0f64, 0.34), (5.0, 1.7)] {
            let optics = optics(&[entry("laser_cone", &[("tilt_rad", degrees.to_radians())])]);
            let mut points = Vec::new();
            for i in 0..=20 {
                for j in -20..=20 {
                    let z = 0.25 + 0.025 * f64::from(i);
                    let y = z * f64::from(j).to_radians().tan();
                    points.push((y, z, optics.cone_m(y, z)));
                }
            }
            // Least squares plane x = a + b z (odd terms in y vanish by symmetry).
            let n = points.len() as f64;
            let mean = |f: &dyn Fn(&(f64, f64, f64)) -> f64| points.iter().map(f).sum::<f64>() / n;
            let (zm, xm) = (mean(&|p| p.1), mean(&|p| p.2));
            let b = mean(&|p| (p.1 - zm) * (p.2 - xm)) / mean(&|p| (p.1 - zm).powi(2));
            let off = |p: &(f64, f64, f64)| (p.2 - xm - b * (p.1 - zm)).abs() * 1e3;
            let worst = points.iter().map(off).fold(0.0, f64::max);
            assert!(
                (worst / expected_mm - 1.0).abs() < 0.1,
                "{degrees} deg: {worst} mm"
            );
        }
    }
}
