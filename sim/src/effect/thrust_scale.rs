//! `thrust_scale`: the thrust curve is off by a factor. Exactly confounded with mass and damping: motion alone never shows it.

use super::info::DOF;
use super::{EffectInfo, Law, Moment, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "thrust_scale",
    law: "X gain",
    stage: Stage::Thruster,
    order: 70,
    parameters: &[ParameterInfo::new(
        "gain",
        "1",
        "real over commanded load",
        (0.8, 1.2),
        (0.0, 10.0),
        1.05,
    )],
    words: &[DOF],
    confusable: &["battery_sag", "position_scale"],
    source: "theory/physics.md, thruster stage (not identifiable: needs a bollard pull or known ballast)",
};

#[derive(Debug)]
struct Scale<T> {
    dof: usize,
    gain: T,
}

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Scale {
        dof: values.words[0],
        gain: values.numbers[0],
    }
}

impl<T: Real> Law<T> for Scale<T> {
    fn thrust(&self, _m: &Moment<'_, T>, wrench: &mut [T; 6], _own: &[T], _rate: &mut [T]) {
        wrench[self.dof] = wrench[self.dof] * self.gain;
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    /// 5 % of thrust is 5 % of mass and damping: the same motion to rounding.
    #[test]
    fn it_is_confounded_with_the_vehicles_own_coefficients() {
        let mut scaled = world(&[entry("thrust_scale", &[("gain", 1.05)])]);
        let mut rig = crate::fixture::lshpi_rig();
        let c = &mut rig.vehicle.coefficients[0];
        c.added = rig.vehicle.mass_kg - (rig.vehicle.mass_kg - c.added) / 1.05;
        (c.linear, c.quadratic) = (c.linear / 1.05, c.quadratic / 1.05);
        let mut other = crate::World::new(&rig, [0.0; 6]).unwrap();
        for w in [&mut scaled, &mut other] {
            drive(w, 6.0);
        }
        let x = |w: &mut crate::World| w.state_at(6.0).unwrap().eta[0];
        let (a, b) = (x(&mut scaled), x(&mut other));
        assert!((a - b).abs() < 1e-13 && a.abs() > 0.01, "{a} {b}");
    }
}
