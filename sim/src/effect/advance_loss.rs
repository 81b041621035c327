//! `advance_loss`: a propeller that advances pushes less than at the bollard.

use super::info::DOF;
use super::{EffectInfo, Law, Moment, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "advance_loss",
    law: "X (1 - loss_spm |u|)",
    stage: Stage::Thruster,
    order: 60,
    parameters: &[ParameterInfo::new(
        "loss_spm",
        "s/m (s/rad for a moment)",
        "share of the load lost per unit of the DOF's own speed over ground",
        (0.05, 0.8),
        (-10.0, 10.0),
        0.3,
    )],
    words: &[DOF],
    confusable: &["battery_sag", "linear_damping", "quadratic_damping"],
    source: "theory/physics.md, thruster stage; Fossen 2011, 12.2 (thrust falls with the advance speed)",
};

#[derive(Debug)]
struct Loss<T> {
    dof: usize,
    loss_spm: T,
}

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Loss {
        dof: values.words[0],
        loss_spm: values.numbers[0],
    }
}

impl<T: Real> Law<T> for Loss<T> {
    fn thrust(&self, m: &Moment<'_, T>, wrench: &mut [T; 6], _own: &[T], _rate: &mut [T]) {
        // Factors are clamped at >= 0 (theory/physics.md, thruster stage).
        let factor = (T::one() - self.loss_spm * m.nu[self.dof].abs()).max(T::zero());
        wrench[self.dof] = wrench[self.dof] * factor;
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    #[test]
    fn speed_takes_thrust_either_way() {
        let loss = [entry("advance_loss", &[("loss_spm", 0.5)])];
        for (u, factor) in [(0.0, 1.0), (0.2, 0.9), (-0.2, 0.9), (3.0, 0.0)] {
            let state = State {
                nu: [u, 0.0, 0.0, 0.0, 0.0, 0.0],
                ..State::default()
            };
            let made = extra(&loss, state, surge(8.0))[0];
            assert!(
                (made - 8.0 * (factor - 1.0)).abs() < 1e-12,
                "u = {u}: {made}"
            );
        }
    }

    /// Without drag M u' = X (1 - loss u): u = (1 - exp(-loss X t / M)) / loss.
    #[test]
    fn speed_approaches_that_of_no_thrust() {
        let (mut r, mass) = frictionless(&[entry("advance_loss", &[("loss_spm", 0.5)])]);
        r.command(0.0, surge(8.0)).unwrap();
        let u = (1.0 - (-0.5 * 8.0 * 9.0 / mass).exp()) / 0.5;
        assert!((r.state_at(9.0).unwrap().vehicle.nu[0] - u).abs() < 1e-12);
    }
}
