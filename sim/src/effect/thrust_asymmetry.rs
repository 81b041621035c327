//! `thrust_asymmetry`: a propeller pushes less astern than ahead.

use super::info::DOF;
use super::{EffectInfo, Law, Moment, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "thrust_asymmetry",
    law: "X reverse_gain for X < 0",
    stage: Stage::Thruster,
    order: 30,
    parameters: &[ParameterInfo {
        name: "reverse_gain",
        unit: "1",
        meaning: "real over commanded load for negative commands",
        plausible: (0.7, 0.95),
        limits: (0.0, 5.0),
        typical: 0.85,
        absent: None,
        bounds_load: false,
        corner: false,
        held: false,
    }],
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
        if wrench[self.dof].value() < 0.0 {
            wrench[self.dof] = wrench[self.dof] * self.reverse_gain;
        }
    }
}
