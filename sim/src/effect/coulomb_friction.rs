//! `coulomb_friction`: dry friction of a rail, a carriage or a seal.

use super::info::DOF;
use super::{EffectInfo, Law, Moment, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "coulomb_friction",
    law: "-f_n tanh(u / 0.004 m/s)",
    stage: Stage::Hydrodynamics,
    order: 80,
    parameters: &[ParameterInfo::new(
        "f_n",
        "N (N m for a moment)",
        "friction at any speed",
        (0.05, 0.5),
        // Stiff near rest: f / (0.004 M) per second must stay below RK4's bound.
        (-50.0, 50.0),
        0.2,
    )],
    words: &[DOF],
    confusable: &[
        "constant_force",
        "current",
        "linear_damping",
        "thruster_deadband",
        "thruster_saturation",
    ],
    source: "theory/physics.md, hydrodynamics",
};

#[derive(Debug)]
struct Coulomb<T> {
    dof: usize,
    f_n: T,
}

/// Speed over ground at which the friction has come to tanh(1) of itself \[m/s, rad/s\].
pub(super) const SLIP_MPS: f64 = 0.004;

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Coulomb {
        dof: values.words[0],
        f_n: values.numbers[0],
    }
}

impl<T: Real> Law<T> for Coulomb<T> {
    fn force(&self, m: &Moment<'_, T>, _own: &[T], force: &mut [T; 6]) {
        let slip = (m.nu[self.dof] * (1.0 / SLIP_MPS)).tanh();
        force[self.dof] = force[self.dof] - self.f_n * slip;
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    /// Coasting: sinh(u / s) = sinh(u0 / s) exp(-f t / (M s)).
    #[test]
    fn coasting_follows_the_closed_form() {
        let (mut r, mass) = frictionless(&[entry("coulomb_friction", &[("f_n", 0.5)])]);
        r.command(0.0, surge(8.5)).unwrap();
        let s = 0.004f64;
        let u0 = r.state_at(0.3).unwrap().vehicle.nu[0];
        r.command(0.3, surge(0.0)).unwrap();
        for t_s in [0.5, 3.0, 8.0] {
            let u = s * ((u0 / s).sinh() * (-0.5 * (t_s - 0.3) / (mass * s)).exp()).asinh();
            assert!((r.state_at(t_s).unwrap().vehicle.nu[0] - u).abs() < 1e-11);
        }
    }
}
