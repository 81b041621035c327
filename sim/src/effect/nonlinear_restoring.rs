//! `nonlinear_restoring`: the righting moment is not a sine of the metacentre alone.

use super::{EffectInfo, Law, Moment, ParameterInfo, Stage, Values, WordInfo};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "nonlinear_restoring",
    law: "K - k3_nmprad3 phi^3 (dof = roll) or M - k3_nmprad3 theta^3 (dof = pitch); positive stiffens",
    stage: Stage::Hydrodynamics,
    order: 110,
    parameters: &[ParameterInfo::new(
        "k3_nmprad3",
        "N m/rad3",
        "cubic stiffness",
        // -0.9 to +1 times the linear stiffness, here that of the paper's vehicle (8.18 N m/rad).
        (-7.4, 8.2),
        (-1e4, 1e4),
        4.0,
    )],
    words: &[WordInfo {
        name: "dof",
        meaning: "degree of freedom that it acts in",
        allowed: &["roll", "pitch"],
        absent: Some("roll"),
    }],
    confusable: &["cubic_damping", "quadratic_damping"],
    source: "theory/physics.md, hydrodynamics",
};

#[derive(Debug)]
struct Restoring<T> {
    dof: usize,
    k3_nmprad3: T,
}

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Restoring {
        dof: 3 + values.words[0],
        k3_nmprad3: values.numbers[0],
    }
}

impl<T: Real> Law<T> for Restoring<T> {
    fn force(&self, m: &Moment<'_, T>, _own: &[T], force: &mut [T; 6]) {
        let angle = m.eta[self.dof];
        force[self.dof] = force[self.dof] - self.k3_nmprad3 * angle * angle * angle;
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    #[test]
    fn a_positive_one_stiffens() {
        let eta = [0.0, 0.0, 0.0, 0.3, -0.2, 0.0];
        let state = State {
            eta,
            ..State::default()
        };
        let pitch = with_word(
            entry("nonlinear_restoring", &[("k3_nmprad3", -3.0)]),
            "dof",
            "pitch",
        );
        let made = extra(
            &[entry("nonlinear_restoring", &[("k3_nmprad3", 5.0)]), pitch],
            state,
            [0.0; 6],
        );
        assert!(
            (made[3] + 5.0 * 0.027).abs() < 1e-12 && (made[4] + 3.0 * 0.008).abs() < 1e-12,
            "{made:?}"
        );
    }
}
