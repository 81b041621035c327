//! `shaft_thrust`: a propeller whose shaft speed is measured pushes by its square.

use super::info::DOF;
use super::{EffectInfo, Law, Moment, ParameterInfo, Stage, Values};
use crate::given::SHAFT;
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "shaft_thrust",
    law: "X + k_ns2prad2 |n| n, n = measured speed of the shaft",
    stage: Stage::Thruster,
    // Behind what stands between command and shaft, before what the water and the mounting make of the thrust.
    order: 55,
    parameters: &[ParameterInfo::new(
        "k_ns2prad2",
        "N s2/rad2 (N m s2/rad2 for a moment)",
        "thrust at rest by the square of the shaft speed; of the sign of the shaft's way of turning",
        // 10 N at 10 to 50 revolutions per second is 2.5e-3 to 1e-4; a large slow propeller has more.
        (-0.01, 0.01),
        (-1e4, 1e4),
        4e-4,
    )],
    words: &[DOF],
    confusable: &["constant_force", "thrust_scale"],
    source: "theory/physics.md, thruster stage; Fossen 2011, 12.2 (thrust by |n| n)",
};

#[derive(Debug)]
struct Shaft<T> {
    dof: usize,
    k_ns2prad2: T,
}

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Shaft {
        dof: values.words[0],
        k_ns2prad2: values.numbers[0],
    }
}

impl<T: Real> Law<T> for Shaft<T> {
    fn thrust(&self, m: &Moment<'_, T>, wrench: &mut [T; 6], _own: &[T], _rate: &mut [T]) {
        if m.companions.is_none() {
            return;
        }
        let speed_radps = m.companion(SHAFT);
        let thrust_n = self.k_ns2prad2 * speed_radps.abs() * speed_radps;
        wrench[self.dof] = wrench[self.dof] + thrust_n;
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::tests::fixtures::*;
    use crate::given::{Curve, Given};

    fn turning(speed_radps: f64) -> Given {
        Given {
            companions: [None, None, Some(Curve::constant(speed_radps)), None],
            ..Given::default()
        }
    }

    #[test]
    fn it_pushes_by_the_square_of_the_shaft_speed_with_its_sign() {
        for (speed_radps, thrust_n) in [(100.0, 4.0), (-50.0, -1.0), (0.0, 0.0)] {
            let shaft = [entry("shaft_thrust", &[("k_ns2prad2", 4e-4)])];
            let (path, mass) = frictionless(&shaft);
            let mut path = path.beside(turning(speed_radps));
            let made_n = path.state_at(2.0).unwrap().vehicle.nu[0] * mass / 2.0;
            assert!((made_n - thrust_n).abs() < 1e-10, "{speed_radps}: {made_n}");
        }
    }

    /// Deadband and lag are of the way from command to shaft, which was measured; advance loss is the water's.
    #[test]
    fn the_shaft_has_no_deadband_and_no_lag_but_loses_thrust_under_way() {
        let k = entry("shaft_thrust", &[("k_ns2prad2", 4e-4)]);
        let before = [
            k.clone(),
            entry("thruster_deadband", &[("width_n", 1.0)]),
            entry("thruster_lag", &[("lag_s", 0.5)]),
        ];
        let (path, mass) = frictionless(&before);
        let mut path = path.beside(turning(100.0));
        let made_n = path.state_at(2.0).unwrap().vehicle.nu[0] * mass / 2.0;
        assert!((made_n - 4.0).abs() < 1e-10, "{made_n}");
        let (path, mass) = frictionless(&[k, entry("advance_loss", &[("loss_spm", 0.5)])]);
        let mut path = path.beside(turning(100.0));
        let u_mps = (1.0 - (-0.5 * 4.0 * 9.0 / mass).exp()) / 0.5;
        let made_mps = path.state_at(9.0).unwrap().vehicle.nu[0];
        assert!((made_mps - u_mps).abs() < 1e-10, "{made_mps} {u_mps}");
    }

    #[test]
    fn without_a_measured_shaft_it_does_nothing() {
        let shaft = [entry("shaft_thrust", &[("k_ns2prad2", 4e-4)])];
        assert_eq!(extra(&shaft, State::default(), [0.0; 6]), [0.0; 6]);
    }
}
