//! `thruster_deadband`: small commands do not turn the propeller.

use super::info::DOF;
use super::{EffectInfo, Law, Moment, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "thruster_deadband",
    law: "X = 0 for |X| < width_n, else X - sign(X) width_n",
    stage: Stage::Thruster,
    order: 10,
    parameters: &[ParameterInfo {
        name: "width_n",
        unit: "N (N m for a moment)",
        meaning: "load below which nothing happens, subtracted above",
        plausible: (0.1, 1.0),
        limits: (0.0, 100.0),
        typical: 0.4,
        absent: None,
        bounds_load: false,
        corner: true,
        held: false,
    }],
    words: &[DOF],
    confusable: &[
        "constant_force",
        "coulomb_friction",
        "current",
        "thruster_saturation",
    ],
    source: "theory/physics.md, thruster stage; ESC neutral band of brushless thrusters",
};

#[derive(Debug)]
struct Deadband<T> {
    dof: usize,
    width_n: T,
}

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Deadband {
        dof: values.words[0],
        width_n: values.numbers[0],
    }
}

impl<T: Real> Law<T> for Deadband<T> {
    fn thrust(&self, _m: &Moment<'_, T>, wrench: &mut [T; 6], _own: &[T], _rate: &mut [T]) {
        let x = wrench[self.dof];
        wrench[self.dof] = if x.abs().value() < self.width_n.value() {
            T::zero()
        } else if x.value() < 0.0 {
            x + self.width_n
        } else {
            x - self.width_n
        };
    }
}
