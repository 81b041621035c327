//! `refraction`: a flat port between air and water that the rig does not know of, or other water.

use super::{EffectInfo, Law, Optics, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "refraction",
    law: "flat port at port_m ahead of the unmoved pinhole, across its axis: n_air sin = n_water sin per ray",
    stage: Stage::Measurement,
    order: 20,
    parameters: &[
        ParameterInfo::new(
            "n_water",
            "1",
            "refractive index of the water",
            (1.329, 1.345),
            (1.0, 1.6),
            1.333,
        ),
        ParameterInfo::new(
            "port_m",
            "m",
            "pinhole to port along the axis",
            (0.005, 0.1),
            (0.0, 1.0),
            0.02,
        ),
    ],
    words: &[],
    confusable: &["camera_shift", "lens_distortion", "target_scale"],
    source: "theory/physics.md, measurement; Treibitz et al. 2012 (flat refractive geometry), glass of no thickness",
};

#[derive(Debug)]
struct Refraction<T> {
    n_water: T,
    port_m: T,
}

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Refraction {
        n_water: values.numbers[0],
        port_m: values.numbers[1],
    }
}

impl<T: Real> Law<T> for Refraction<T> {
    fn optics(&self, optics: &mut Optics<T>) {
        optics.n_water = self.n_water;
        optics.port_m = self.port_m;
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    /// A paraxial ray meets the plane at distance Z at d tan + (Z - d) tan / n, by Snell's law exactly.
    #[test]
    fn the_stripe_moves_by_snells_law() {
        let (n, d) = (1.333, 0.02);
        // Level over a bare floor at H = h_centre + 0.1: the stripe's middle column, in closed form.
        let (plain, changed) = stripe_rows(
            &[entry("refraction", &[("n_water", n), ("port_m", d)])],
            0.78,
        );
        // Stripe in camera axes: 0.46 behind, 0.56 above it, axis at 45 deg.
        let (forward, down) = (0.46f64, 0.56f64);
        let (z, y) = (
            (forward + down) / 2f64.sqrt(),
            (down - forward) / 2f64.sqrt(),
        );
        let focal = plain.focal_px;
        assert!((plain.row_px - plain.centre_px - focal * y / z).abs() < 1e-9);
        let angle = ((changed.row_px - changed.centre_px) / focal).atan();
        let reached = d * angle.tan() + (z - d) * (angle.sin() / n).asin().tan();
        assert!((reached - y).abs() < 1e-9, "{reached} {y}");
        assert!((changed.row_px - plain.row_px).abs() > 10.0);
    }
}
