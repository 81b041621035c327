//! `target_scale`: the target is not as large as its file says.

use super::{EffectInfo, Law, Optics, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "target_scale",
    law: "hexagon side times gain (board length follows; board width and thicknesses unchanged)",
    stage: Stage::Measurement,
    order: 80,
    parameters: &[ParameterInfo::new(
        "gain",
        "1",
        "real over stated length along the centre line",
        (0.97, 1.03),
        (0.2, 5.0),
        1.01,
    )],
    words: &[],
    confusable: &["position_scale", "refraction"],
    source: "theory/physics.md, measurement",
};

#[derive(Debug)]
struct TargetScale<T>(T);

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    TargetScale(values.numbers[0])
}

impl<T: Real> Law<T> for TargetScale<T> {
    fn optics(&self, optics: &mut Optics<T>) {
        optics.target_scale = optics.target_scale * self.0;
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    /// Over the middle of the first hexagon it is 2 sides wide.
    #[test]
    fn the_hexagon_is_as_much_wider() {
        for gain in [1.0, 1.03] {
            let x_m = 3f64.sqrt() * 0.12 * gain / 2.0 - 0.27;
            let profile = profile_over(&[entry("target_scale", &[("gain", gain)])], x_m);
            let width = |slab: usize| {
                let on = profile
                    .iter()
                    .filter(|p| p.surface == crate::scene::Surface::Slab(slab))
                    .map(|p| p.xi_m);
                on.clone().fold(f64::MIN, f64::max) - on.fold(f64::MAX, f64::min)
            };
            // A column is a millimetre wide; at its widest the corner takes one or two more.
            let widest = width(0).min(width(1));
            let board = width(0).max(width(1));
            assert!((widest - 0.24 * gain).abs() < 0.004, "{gain}: {widest}");
            assert!((board - 0.30).abs() < 0.004, "{gain}: {board}");
        }
    }
}
