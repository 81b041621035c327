//! `constant_force`: something pulls all the time (tether, trim).

use super::info::DOF;
use super::{EffectInfo, Law, Moment, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "constant_force",
    law: "X + bias_n",
    stage: Stage::Hydrodynamics,
    order: 30,
    parameters: &[ParameterInfo::new(
        "bias_n",
        "N (N m for a moment)",
        "constant load",
        (-0.5, 0.5),
        (-1000.0, 1000.0),
        0.2,
    )],
    words: &[DOF],
    confusable: &[
        "coulomb_friction",
        "current",
        "seiche",
        "tether_spring",
        "thrust_asymmetry",
        "thruster_deadband",
        "thruster_saturation",
    ],
    source: "theory/physics.md, hydrodynamics",
};

#[derive(Debug)]
struct Constant<T> {
    dof: usize,
    bias_n: T,
}

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Constant {
        dof: values.words[0],
        bias_n: values.numbers[0],
    }
}

impl<T: Real> Law<T> for Constant<T> {
    fn force(&self, _m: &Moment<'_, T>, _own: &[T], force: &mut [T; 6]) {
        force[self.dof] = force[self.dof] + self.bias_n;
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    #[test]
    fn it_accelerates_without_a_command() {
        let (mut r, mass) = frictionless(&[entry("constant_force", &[("bias_n", -0.3)])]);
        assert!((r.state_at(5.0).unwrap().vehicle.nu[0] * mass + 1.5).abs() < 1e-12);
        let yaw = with_word(entry("constant_force", &[("bias_n", 0.02)]), "dof", "yaw");
        assert!((extra(&[yaw], State::default(), [0.0; 6])[5] - 0.02).abs() < 1e-14);
    }
}
