//! `thruster_lag`: the thrust follows its command as a first-order lag.

use super::info::DOF;
use super::{EffectInfo, Law, Moment, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "thruster_lag",
    law: "lag_s dX/dt + X = X_before, X(t0) = 0",
    stage: Stage::Thruster,
    order: 50,
    parameters: &[ParameterInfo {
        name: "lag_s",
        unit: "s",
        meaning: "time constant",
        plausible: (0.05, 0.5),
        // Below one grid step (5 ms) RK4 would leave its region of stability.
        limits: (0.005, 30.0),
        typical: 0.2,
        absent: None,
        bounds_load: false,
        corner: false,
        held: false,
    }],
    words: &[DOF],
    confusable: &["camera_latency", "command_latency", "fluid_memory"],
    source: "theory/physics.md, thruster stage; Fossen 2011, 12.2 (first-order propeller dynamics)",
};

#[derive(Debug)]
struct Lag<T> {
    dof: usize,
    lag_s: T,
}

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Lag {
        dof: values.words[0],
        lag_s: values.numbers[0],
    }
}

impl<T: Real> Law<T> for Lag<T> {
    fn states(&self) -> usize {
        1 // the lagged load itself
    }

    fn fastest_s(&self) -> f64 {
        self.lag_s.value()
    }

    fn thrust(&self, _m: &Moment<'_, T>, wrench: &mut [T; 6], own: &[T], rate: &mut [T]) {
        rate[0] = (wrench[self.dof] - own[0]) / self.lag_s;
        wrench[self.dof] = own[0];
    }
}
