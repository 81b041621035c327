//! `thrust_asymmetry`: a propeller pushes less astern than ahead.

use super::info::DOF;
use super::{EffectInfo, Law, Moment, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "thrust_asymmetry",
    law: "X reverse_gain for X < 0",
    stage: Stage::Thruster,
    order: 30,
    parameters: &[ParameterInfo::new(
        "reverse_gain",
        "1",
        "real over commanded load for negative commands",
        (0.7, 0.95),
        (0.0, 5.0),
        0.85,
    )],
    words: &[DOF],
    confusable: &["astern_drag", "constant_force", "current"],
    source: "theory/physics.md, thruster stage; Blue Robotics T200: +51.5 / -39.9 N at 16 V",
};

#[derive(Debug)]
struct Asymmetry<T> {
    dof: usize,
    reverse_gain: T,
}

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    // Factors are clamped at >= 0 (theory/physics.md, thruster stage).
    Asymmetry {
        dof: values.words[0],
        reverse_gain: values.numbers[0].max(T::zero()),
    }
}

impl<T: Real> Law<T> for Asymmetry<T> {
    fn thrust(&self, _m: &Moment<'_, T>, wrench: &mut [T; 6], _own: &[T], _rate: &mut [T]) {
        let load = wrench[self.dof];
        wrench[self.dof] = load.where_negative(load * self.reverse_gain, load);
    }
}
