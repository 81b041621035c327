//! `quadratic_damping`: the quadratic damping term, in a rig whose model lacks it.

use super::info::DOF;
use super::{EffectInfo, Law, Moment, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "quadratic_damping",
    law: "X + coefficient u_r |u_r| (SNAME sign: negative damps)",
    stage: Stage::Hydrodynamics,
    order: 51,
    parameters: &[ParameterInfo::new(
        "coefficient",
        "N s2/m2 (N m s2/rad2 for a moment)",
        "the term's coefficient, negative for a damping one",
        (-500.0, -0.1),
        (-1e4, 1e4),
        -50.0,
    )],
    words: &[DOF],
    confusable: &[
        "advance_loss",
        "astern_drag",
        "cubic_damping",
        "linear_damping",
        "nonlinear_restoring",
    ],
    source: "theory/physics.md, hydrodynamics; paper Eq. 1 (X_u|u|)",
};

#[derive(Debug)]
struct Quadratic<T> {
    dof: usize,
    coefficient: T,
}

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Quadratic {
        dof: values.words[0],
        coefficient: values.numbers[0],
    }
}

impl<T: Real> Law<T> for Quadratic<T> {
    fn drag(&self, m: &Moment<'_, T>, drag: &mut [T; 6]) {
        let v = m.nu_r[self.dof];
        drag[self.dof] = drag[self.dof] + self.coefficient * v * v.abs();
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    /// M u' = X - c u^2: u = sqrt(X/c) tanh(sqrt(X c) t / M).
    #[test]
    fn it_is_the_paper_term() {
        for sign in [1.0, -1.0] {
            let (mut r, mass) =
                frictionless(&[entry("quadratic_damping", &[("coefficient", -150.0)])]);
            r.command(0.0, surge(sign * 8.0)).unwrap();
            let u = sign * (8.0f64 / 150.0).sqrt() * ((8.0f64 * 150.0).sqrt() * 6.0 / mass).tanh();
            assert!((r.state_at(6.0).unwrap().vehicle.nu[0] - u).abs() < 1e-11);
        }
    }
}
