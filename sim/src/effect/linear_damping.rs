//! `linear_damping`: the linear damping term, in a rig whose model lacks it.

use super::info::DOF;
use super::{EffectInfo, Law, Moment, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "linear_damping",
    law: "X + coefficient u_r (SNAME sign: negative damps)",
    stage: Stage::Hydrodynamics,
    order: 50,
    parameters: &[ParameterInfo::new(
        "coefficient",
        "N s/m (N m s/rad for a moment)",
        "the term's coefficient, negative for a damping one",
        (-200.0, -0.1),
        // Beyond these RK4 leaves its region of stability on a 10 ms grid for the lightest DOF.
        (-1000.0, 1000.0),
        -10.0,
    )],
    words: &[DOF],
    confusable: &[
        "advance_loss",
        "coulomb_friction",
        "cubic_damping",
        "current",
        "lift_damping",
        "quadratic_damping",
    ],
    source: "theory/physics.md, hydrodynamics; paper Eq. 1 (X_u)",
};

#[derive(Debug)]
struct Linear<T> {
    dof: usize,
    coefficient: T,
}

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Linear {
        dof: values.words[0],
        coefficient: values.numbers[0],
    }
}

impl<T: Real> Law<T> for Linear<T> {
    fn drag(&self, m: &Moment<'_, T>, drag: &mut [T; 6]) {
        let v = m.nu_r[self.dof];
        drag[self.dof] = drag[self.dof] + self.coefficient * v;
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    /// M u' = X - c u: u = X/c (1 - exp(-c t / M)).
    #[test]
    fn it_is_the_paper_term() {
        let (mut r, mass) = frictionless(&[entry("linear_damping", &[("coefficient", -60.0)])]);
        r.command(0.0, surge(8.0)).unwrap();
        let u = 8.0 / 60.0 * (1.0 - (-60.0 * 4.0 / mass).exp());
        assert!((r.state_at(4.0).unwrap().vehicle.nu[0] - u).abs() < 1e-12);
    }
}
