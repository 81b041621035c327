//! `cross_flow_coupling`: one motion damps or drives another.

use super::info::DOF;
use super::{EffectInfo, Law, Moment, ParameterInfo, Stage, Values, WordInfo};
use crate::real::Real;

const RATES: &[&str] = &["u", "v", "w", "p", "q", "r"];

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "cross_flow_coupling",
    law: "+ c |a| b in one DOF (dof, a, b), e.g. |u| r in yaw",
    stage: Stage::Hydrodynamics,
    order: 130,
    parameters: &[ParameterInfo::new(
        "c",
        "SI",
        "coefficient",
        (-50.0, 50.0),
        (-1e4, 1e4),
        -8.0,
    )],
    words: &[
        WordInfo {
            absent: Some("yaw"),
            ..DOF
        },
        WordInfo {
            name: "a",
            meaning: "first of the two rates",
            allowed: RATES,
            absent: Some("u"),
        },
        WordInfo {
            name: "b",
            meaning: "second of the two rates",
            allowed: RATES,
            absent: Some("r"),
        },
    ],
    confusable: &["added_mass_coupling", "lift_damping", "fin_force"],
    source: "theory/physics.md, hydrodynamics; Fossen 2011, 6.4 (cross-flow drag)",
};

#[derive(Debug)]
struct CrossFlow<T> {
    dof: usize,
    a: usize,
    b: usize,
    c: T,
}

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    CrossFlow {
        dof: values.words[0],
        a: values.words[1],
        b: values.words[2],
        c: values.numbers[0],
    }
}

impl<T: Real> Law<T> for CrossFlow<T> {
    fn force(&self, m: &Moment<'_, T>, _own: &[T], force: &mut [T; 6]) {
        force[self.dof] = force[self.dof] + self.c * m.nu[self.a].abs() * m.nu[self.b];
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    #[test]
    fn the_words_say_which() {
        let state = State {
            nu: [-0.2, 0.1, 0.0, 0.0, 0.0, 0.3],
            ..State::default()
        };
        let made = extra(
            &[entry("cross_flow_coupling", &[("c", -8.0)])],
            state,
            [0.0; 6],
        );
        assert!((made[5] + 8.0 * 0.2 * 0.3).abs() < 1e-12 && made[0].abs() < 1e-12);
        let sway = with_word(
            with_word(
                with_word(entry("cross_flow_coupling", &[("c", 2.0)]), "dof", "sway"),
                "a",
                "r",
            ),
            "b",
            "v",
        );
        assert!((extra(&[sway], state, [0.0; 6])[1] - 2.0 * 0.3 * 0.1).abs() < 1e-12);
    }
}
