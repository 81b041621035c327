//! `thruster_deadband`: small commands do not turn the propeller.

use super::info::DOF;
use super::{EffectInfo, Law, Moment, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "thruster_deadband",
    law: "X = 0 for |X| < width_n, else X - sign(X) width_n",
    stage: Stage::Thruster,
    order: 10,
    parameters: &[ParameterInfo::new(
        "width_n",
        "N (N m for a moment)",
        "load below which nothing happens, subtracted above",
        (0.1, 1.0),
        (0.0, 100.0),
        0.4,
    )],
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
        let beyond = x.where_negative(x + self.width_n, x - self.width_n);
        wrench[self.dof] = (x.abs() - self.width_n).where_negative(T::zero(), beyond);
    }
}
