//! `current`: the water moves steadily through the tank; the drag sees the velocity through the water.

use super::{EffectInfo, Law, Moment, ParameterInfo, Stage, Values};
use crate::real::Real;

const fn component(name: &'static str, meaning: &'static str) -> ParameterInfo {
    ParameterInfo {
        name,
        unit: "m/s",
        meaning,
        plausible: (-0.02, 0.02),
        limits: (-2.0, 2.0),
        typical: 0.005,
        absent: Some(0.0),
        bounds_load: false,
        corner: false,
        held: false,
    }
}

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "current",
    law: "u_r = u - vx cos(psi) - vy sin(psi), v_r = v + vx sin(psi) - vy cos(psi), in the drag",
    stage: Stage::Hydrodynamics,
    order: 10,
    parameters: &[
        component("vx_mps", "velocity of the water along tank X"),
        component("vy_mps", "velocity of the water along tank Y"),
    ],
    words: &[],
    confusable: &[
        "constant_force",
        "coulomb_friction",
        "linear_damping",
        "seiche",
        "thrust_asymmetry",
        "thruster_deadband",
        "thruster_saturation",
    ],
    source: "theory/physics.md, hydrodynamics; Fossen 2011, 8.3 (irrotational current)",
};

#[derive(Debug)]
struct Current<T> {
    vx_mps: T,
    vy_mps: T,
}

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Current {
        vx_mps: values.numbers[0],
        vy_mps: values.numbers[1],
    }
}

impl<T: Real> Law<T> for Current<T> {
    fn relative_velocity(&self, m: &Moment<'_, T>, nu_r: &mut [T; 6]) {
        let (sin, cos) = *m.heading;
        nu_r[0] = nu_r[0] - self.vx_mps * cos - self.vy_mps * sin;
        nu_r[1] = nu_r[1] + self.vx_mps * sin - self.vy_mps * cos;
    }
}
