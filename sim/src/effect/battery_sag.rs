//! `battery_sag`: the battery gives less the more has been drawn from it.

use super::info::DOF;
use super::{EffectInfo, Law, Moment, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "battery_sag",
    law: "X (1 - sag E), E = integral of |X| dt / 100 N s, after sag and before lag",
    stage: Stage::Thruster,
    order: 40,
    parameters: &[ParameterInfo::new(
        "sag",
        "1",
        "share of the load lost per 100 N s already delivered",
        (0.01, 0.1),
        (-1.0, 1.0),
        0.04,
    )],
    words: &[DOF],
    confusable: &["advance_loss", "tether_spring", "thrust_scale"],
    source: "theory/physics.md, thruster stage",
};

#[derive(Debug)]
struct Sag<T> {
    dof: usize,
    sag: T,
}

/// Impulse that makes one unit of E \[N s\].
const UNIT_NS: f64 = 100.0;

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Sag {
        dof: values.words[0],
        sag: values.numbers[0],
    }
}

impl<T: Real> Law<T> for Sag<T> {
    fn states(&self) -> usize {
        1 // E
    }

    fn thrust(&self, _m: &Moment<'_, T>, wrench: &mut [T; 6], own: &[T], rate: &mut [T]) {
        // Factors are clamped at >= 0 (theory/physics.md, thruster stage).
        let factor = (T::one() - self.sag * own[0]).max(T::zero());
        wrench[self.dof] = wrench[self.dof] * factor;
        rate[0] = wrench[self.dof].abs() * (1.0 / UNIT_NS);
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    #[test]
    fn the_load_decays_exponentially_with_what_was_drawn() {
        // E' = X (1 - sag E) / 100: 1 - sag E = exp(-sag X t / 100), so the impulse is 100 E.
        let (mut r, mass) = frictionless(&[entry("battery_sag", &[("sag", 0.1)])]);
        r.command(0.0, surge(8.0)).unwrap();
        for t_s in [1.0f64, 7.0, 60.0] {
            let e = (1.0 - (-0.1 * 8.0 * t_s / 100.0).exp()) / 0.1;
            let state = r.state_at(t_s).unwrap();
            assert!((state.own[0] - e).abs() < 1e-12);
            assert!((state.vehicle.nu[0] * mass - 100.0 * e).abs() < 1e-9);
        }
    }

    #[test]
    fn an_empty_battery_pushes_neither_way() {
        let (mut r, _) = frictionless(&[entry("battery_sag", &[("sag", 1.0)])]);
        r.command(0.0, surge(400.0)).unwrap();
        r.state_at(10.0).unwrap();
        assert!((r.state_at(15.0).unwrap().own[0] - 1.0).abs() < 1e-9);
    }
}
