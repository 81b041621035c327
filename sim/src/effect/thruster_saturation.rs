//! `thruster_saturation`: a thruster gives no more than its limit.

use super::info::DOF;
use super::{EffectInfo, Law, Moment, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "thruster_saturation",
    law: "|X| <= limit_n",
    stage: Stage::Thruster,
    order: 20,
    parameters: &[ParameterInfo::new(
        "limit_n",
        "N (N m for a moment)",
        "greatest load",
        (1.0, 50.0),
        (0.0, 1e4),
        6.0,
    )
    .limit()
    .corner()],
    words: &[DOF],
    confusable: &[
        "constant_force",
        "coulomb_friction",
        "current",
        "thruster_deadband",
    ],
    source: "theory/physics.md, thruster stage",
};

#[derive(Debug)]
struct Saturation<T> {
    dof: usize,
    limit_n: T,
}

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Saturation {
        dof: values.words[0],
        limit_n: values.numbers[0],
    }
}

impl<T: Real> Law<T> for Saturation<T> {
    fn thrust(&self, _m: &Moment<'_, T>, wrench: &mut [T; 6], _own: &[T], _rate: &mut [T]) {
        wrench[self.dof] = wrench[self.dof].min(self.limit_n).max(-self.limit_n);
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    #[test]
    fn the_load_is_cut_on_both_sides() {
        for (x_n, expected) in [(4.0, 4.0), (-4.0, -4.0), (9.0, 6.5), (-9.0, -6.5)] {
            let made = force(
                &[entry("thruster_saturation", &[("limit_n", 6.5)])],
                State::default(),
                surge(x_n),
            );
            assert!((made[0] - expected).abs() < 1e-12);
        }
    }
}
