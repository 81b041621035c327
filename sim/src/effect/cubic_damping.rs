//! `cubic_damping`: damping that grows faster than quadratically.

use super::info::DOF;
use super::{EffectInfo, Law, Moment, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "cubic_damping",
    law: "X - d3 u_r^3",
    stage: Stage::Hydrodynamics,
    order: 52,
    parameters: &[ParameterInfo::new(
        "d3",
        "N s3/m3 (N m s3/rad3 for a moment)",
        "cubic damping",
        (0.5, 2000.0),
        (0.0, 1e5),
        300.0,
    )],
    words: &[DOF],
    confusable: &["linear_damping", "nonlinear_restoring", "quadratic_damping"],
    source: "theory/physics.md, hydrodynamics",
};

#[derive(Debug)]
struct Cubic<T> {
    dof: usize,
    d3: T,
}

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Cubic {
        dof: values.words[0],
        d3: values.numbers[0],
    }
}

impl<T: Real> Law<T> for Cubic<T> {
    fn drag(&self, m: &Moment<'_, T>, drag: &mut [T; 6]) {
        let v = m.nu_r[self.dof];
        drag[self.dof] = drag[self.dof] - self.d3 * v * v * v;
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    /// Coasting: M u' = -d3 u^3: u = u0 / sqrt(1 + 2 d3 u0^2 t / M).
    #[test]
    fn coasting_follows_the_closed_form() {
        let (mut r, mass) = frictionless(&[entry("cubic_damping", &[("d3", 900.0)])]);
        r.command(0.0, surge(100.0)).unwrap();
        let u0 = r.state_at(1.0).unwrap().vehicle.nu[0];
        r.command(1.0, surge(0.0)).unwrap();
        let u = u0 / (1.0 + 2.0 * 900.0 * u0 * u0 * 5.0 / mass).sqrt();
        assert!((r.state_at(6.0).unwrap().vehicle.nu[0] - u).abs() < 1e-11);
    }
}
