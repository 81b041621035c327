//! `fluid_memory`: the water remembers an acceleration (frequency-dependent added mass).

use super::info::DOF;
use super::{EffectInfo, Law, Moment, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "fluid_memory",
    law: "+ gain_nspm z, z' = -z/tau_s - u', z(t0) = 0",
    stage: Stage::Hydrodynamics,
    order: 90,
    parameters: &[
        ParameterInfo::new(
            "gain_nspm",
            "N s/m (N m s/rad for a moment)",
            "load per remembered velocity; gain times tau is added mass at low frequency",
            (5.0, 200.0),
            (-500.0, 1000.0),
            40.0,
        ),
        ParameterInfo::new(
            "tau_s",
            "s",
            "memory",
            (0.1, 3.0),
            // RK4 on a 20 ms grid needs 1/tau + gain/M below 139 1/s.
            (0.02, 100.0),
            0.6,
        ),
    ],
    words: &[DOF],
    confusable: &[
        "camera_latency",
        "command_latency",
        "thruster_lag",
        "wall_added_mass",
    ],
    source: "theory/physics.md, hydrodynamics; Cummins 1962, with one exponential",
};

#[derive(Debug)]
struct Memory<T> {
    dof: usize,
    gain_nspm: T,
    tau_s: T,
}

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Memory {
        dof: values.words[0],
        gain_nspm: values.numbers[0],
        tau_s: values.numbers[1],
    }
}

impl<T: Real> Law<T> for Memory<T> {
    fn states(&self) -> usize {
        1 // z
    }

    fn fastest_s(&self) -> f64 {
        self.tau_s.value()
    }

    fn force(&self, _m: &Moment<'_, T>, own: &[T], force: &mut [T; 6]) {
        force[self.dof] = force[self.dof] + self.gain_nspm * own[0];
    }

    fn own_rate(&self, _m: &Moment<'_, T>, nu_dot: &[T; 6], own: &[T], rate: &mut [T]) {
        rate[0] = -own[0] / self.tau_s - nu_dot[self.dof];
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    /// Without drag M u' = X + g z and z' = -z/tau - u': z = -X tau_e / M (1 - exp(-t/tau_e)),
    /// 1/tau_e = 1/tau + g/M.
    #[test]
    fn constant_thrust_has_a_closed_form() {
        let (gain, tau) = (80.0, 0.7);
        let (mut r, mass) = frictionless(&[entry(
            "fluid_memory",
            &[("gain_nspm", gain), ("tau_s", tau)],
        )]);
        r.command(0.0, surge(8.0)).unwrap();
        let tau_e = 1.0 / (1.0 / tau + gain / mass);
        for t_s in [0.2f64, 1.0, 5.0] {
            let fading = 1.0 - (-t_s / tau_e).exp();
            let z = -8.0 * tau_e / mass * fading;
            let u = 8.0 / mass * t_s - gain / mass * 8.0 * tau_e / mass * (t_s - tau_e * fading);
            let state = r.state_at(t_s).unwrap();
            assert!((state.own[0] - z).abs() < 1e-10 && (state.vehicle.nu[0] - u).abs() < 1e-10);
        }
    }
}
