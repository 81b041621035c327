//! `astern_drag`: a hull that goes astern with more drag than ahead.

use super::info::DOF;
use super::{EffectInfo, Law, Moment, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "astern_drag",
    law: "drag gain for u_r < 0",
    stage: Stage::Hydrodynamics,
    order: 60,
    parameters: &[ParameterInfo::new(
        "gain",
        "1",
        "drag astern over drag ahead",
        (1.05, 1.8),
        (0.0, 20.0),
        1.3,
    )],
    words: &[DOF],
    confusable: &["quadratic_damping", "thrust_asymmetry"],
    source: "theory/physics.md, hydrodynamics",
};

#[derive(Debug)]
struct Astern<T> {
    dof: usize,
    gain: T,
}

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Astern {
        dof: values.words[0],
        gain: values.numbers[0],
    }
}

impl<T: Real> Law<T> for Astern<T> {
    fn drag(&self, m: &Moment<'_, T>, drag: &mut [T; 6]) {
        // Continuous: the drag itself is 0 where the sign changes.
        let grown = drag[self.dof] * self.gain;
        drag[self.dof] = m.nu_r[self.dof].where_negative(grown, drag[self.dof]);
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::tests::fixtures::*;

    #[test]
    fn only_astern_drag_grows() {
        let more = [entry("astern_drag", &[("gain", 1.5)])];
        for (u, expected) in [(0.2, 0.0), (-0.2, 0.5 * (20.0 * 0.2 + 200.0 * 0.04))] {
            let state = State {
                nu: [u, 0.0, 0.0, 0.0, 0.0, 0.0],
                ..State::default()
            };
            assert!((extra(&more, state, [0.0; 6])[0] - expected).abs() < 1e-12);
        }
    }

    #[test]
    fn it_scales_the_added_damping_terms_too() {
        let state = State {
            nu: [-0.2, 0.0, 0.0, 0.0, 0.0, 0.0],
            ..State::default()
        };
        let both = [
            entry("astern_drag", &[("gain", 1.5)]),
            entry("linear_damping", &[("coefficient", -10.0)]),
        ];
        let expected = 0.5 * 12.0 + 1.5 * 2.0;
        assert!((extra(&both, state, [0.0; 6])[0] - expected).abs() < 1e-12);
    }
}
