//! `lift_damping`: fins and hull under way damp rotation in proportion to the speed.

use super::info::DOF;
use super::{EffectInfo, Law, Moment, ParameterInfo, Stage, Values, WordInfo};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "lift_damping",
    law: "K - c V p, V = forward speed through the water, 0 astern",
    stage: Stage::Hydrodynamics,
    order: 70,
    parameters: &[ParameterInfo::new(
        "c",
        "N m s2/(m rad)",
        "damping per forward speed",
        (0.5, 100.0),
        (-1000.0, 1000.0),
        8.0,
    )],
    // Along the way itself c V u would be drag that is quadratic ahead and none astern: `astern_drag` has that name.
    words: &[WordInfo {
        allowed: &["sway", "heave", "roll", "pitch", "yaw"],
        absent: Some("roll"),
        ..DOF
    }],
    confusable: &["cross_flow_coupling", "linear_damping"],
    source: "theory/physics.md, hydrodynamics; Ikeda 1978 (lift component of roll damping)",
};

#[derive(Debug)]
struct Lift<T> {
    dof: usize,
    c: T,
}

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Lift {
        dof: INFO.words[0].dof(values.words[0]),
        c: values.numbers[0],
    }
}

impl<T: Real> Law<T> for Lift<T> {
    fn drag(&self, m: &Moment<'_, T>, drag: &mut [T; 6]) {
        // Astern the law would drive instead of damp.
        let forward_mps = m.nu_r[0].max(T::zero());
        drag[self.dof] = drag[self.dof] - self.c * forward_mps * m.nu_r[self.dof];
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    #[test]
    fn it_needs_way_ahead() {
        let lift = [entry("lift_damping", &[("c", 8.0)])];
        for (u, expected) in [(0.0, 0.0), (0.25, -0.2), (-0.25, 0.0)] {
            let state = State {
                nu: [u, 0.0, 0.0, 0.1, 0.0, 0.0],
                ..State::default()
            };
            assert!((extra(&lift, state, [0.0; 6])[3] - expected).abs() < 1e-12);
        }
    }
}
