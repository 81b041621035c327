//! `seiche`: the water of the tank sways; moving water carries the body with it.

use std::f64::consts::{PI, TAU};

use super::{EffectInfo, Law, Moment, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "seiche",
    law: "u_c = amp_mps sin(2 pi (t - t0)/period_s + phase_rad) along tank X: seen by the drag, and + M du_c/dt",
    stage: Stage::Hydrodynamics,
    order: 20,
    parameters: &[
        ParameterInfo::new(
            "amp_mps",
            "m/s",
            "amplitude of the water's velocity",
            (0.001, 0.01),
            (-1.0, 1.0),
            0.005,
        ),
        ParameterInfo::new(
            "period_s",
            "s",
            "period",
            (2.0, 20.0),
            // A grid step (20 ms at most) must resolve it.
            (0.5, 1000.0),
            6.0,
        ),
        ParameterInfo::new(
            "phase_rad",
            "rad",
            "phase at the log's first stamp",
            (-PI, PI),
            (-100.0, 100.0),
            0.5,
        )
        .or(0.0),
    ],
    words: &[],
    confusable: &["constant_force", "current"],
    source: "theory/physics.md, hydrodynamics; Fossen 2011, 8.3 (relative motion in an accelerated fluid)",
};

#[derive(Debug)]
struct Seiche<T> {
    amp_mps: T,
    rate_radps: T,
    phase_rad: T,
}

impl<T: Real> Seiche<T> {
    /// Velocity \[m/s\] and acceleration \[m/s2\] of the water along tank X.
    fn water(&self, t_s: T) -> (T, T) {
        let angle = self.rate_radps * t_s + self.phase_rad;
        let (sin, cos) = angle.sin_cos();
        (self.amp_mps * sin, self.amp_mps * self.rate_radps * cos)
    }
}

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Seiche {
        amp_mps: values.numbers[0],
        rate_radps: T::from_f64(TAU) / values.numbers[1],
        phase_rad: values.numbers[2],
    }
}

impl<T: Real> Law<T> for Seiche<T> {
    fn relative_velocity(&self, m: &Moment<'_, T>, nu_r: &mut [T; 6]) {
        let (v, _) = self.water(m.t_s);
        let (sin, cos) = *m.heading;
        nu_r[0] = nu_r[0] - v * cos;
        nu_r[1] = nu_r[1] + v * sin;
    }

    fn force(&self, m: &Moment<'_, T>, _own: &[T], force: &mut [T; 6]) {
        // M u_r' = ...: the water's acceleration, in the body's axes, times the mass that moves.
        let (_, a) = self.water(m.t_s);
        let (sin, cos) = *m.heading;
        force[0] = force[0] + m.mass[0] * a * cos;
        force[1] = force[1] - m.mass[1] * a * sin;
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    const SEICHE: [(&str, f64); 3] = [("amp_mps", 0.01), ("period_s", 4.0), ("phase_rad", 0.3)];

    /// Without drag the body goes with the water: u = u_c(t) - u_c(0).
    #[test]
    fn water_carries_a_body_without_drag() {
        let (mut r, _) = frictionless(&[entry("seiche", &SEICHE)]);
        for t_s in [0.4f64, 1.3, 5.0] {
            let water = |t: f64| 0.01 * (std::f64::consts::TAU * t / 4.0 + 0.3).sin();
            let u = r.state_at(t_s).unwrap().vehicle.nu[0];
            assert!((u - water(t_s) + water(0.0)).abs() < 1e-10, "{u}");
        }
    }

    #[test]
    fn across_the_tank_it_sways_the_body_to_port() {
        let state = State {
            eta: [0.0, 0.0, 0.0, 0.0, 0.0, std::f64::consts::FRAC_PI_2],
            ..State::default()
        };
        let made = extra(
            &[entry("seiche", &[("amp_mps", 0.01), ("period_s", 4.0)])],
            state,
            [0.0; 6],
        );
        // At t = 0 the water stands still and accelerates by amp omega.
        let a = 0.01 * std::f64::consts::TAU / 4.0;
        assert!(
            made[0].abs() < 1e-12 && (made[1] + (29.777 + 320.0) * a).abs() < 1e-9,
            "{made:?}"
        );
    }
}
