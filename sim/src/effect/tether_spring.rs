//! `tether_spring`: a tether that becomes taut.

use super::{EffectInfo, Law, Moment, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "tether_spring",
    law: "X - stiffness_npm max(0, x - slack_m), x from the rig's zero",
    stage: Stage::Hydrodynamics,
    order: 40,
    parameters: &[
        ParameterInfo::new(
            "stiffness_npm",
            "N/m",
            "stiffness of the taut tether",
            (0.1, 2.0),
            (0.0, 1e4),
            0.8,
        ),
        ParameterInfo::new(
            "slack_m",
            "m",
            "x in the tank frame at which it becomes taut",
            // Taut from the start on is a constant force as well.
            (0.0, 1.0),
            (-100.0, 100.0),
            0.2,
        ),
    ],
    words: &[],
    confusable: &["battery_sag", "constant_force", "wall_added_mass"],
    source: "theory/physics.md, hydrodynamics",
};

#[derive(Debug)]
struct Tether<T> {
    stiffness_npm: T,
    slack_m: T,
}

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Tether {
        stiffness_npm: values.numbers[0],
        slack_m: values.numbers[1],
    }
}

impl<T: Real> Law<T> for Tether<T> {
    fn force(&self, m: &Moment<'_, T>, _own: &[T], force: &mut [T; 6]) {
        let taut_m = (m.eta[0] - self.slack_m).max(T::zero());
        force[0] = force[0] - self.stiffness_npm * taut_m;
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    const TETHER: [(&str, f64); 2] = [("stiffness_npm", 0.8), ("slack_m", 0.2)];

    #[test]
    fn slack_it_does_nothing_taut_it_pulls() {
        for (x, pull) in [(-1.0, 0.0), (0.19, 0.0), (0.7, -0.4)] {
            let state = State {
                eta: [x, 0.0, 0.0, 0.0, 0.0, 0.0],
                ..State::default()
            };
            assert!(
                (extra(&[entry("tether_spring", &TETHER)], state, [0.0; 6])[0] - pull).abs()
                    < 1e-12
            );
        }
    }

    /// Taut and without drag it is an oscillator about slack + X / k.
    #[test]
    fn a_taut_tether_swings() {
        let (mut r, mass) = frictionless(&[entry(
            "tether_spring",
            &[("stiffness_npm", 200.0), ("slack_m", 0.0)],
        )]);
        r.command(0.0, surge(8.0)).unwrap();
        let omega = (200.0 / mass).sqrt();
        let t_s = 2.5;
        let x = 8.0 / 200.0 * (1.0 - (omega * t_s).cos());
        assert!((r.state_at(t_s).unwrap().vehicle.eta[0] - x).abs() < 1e-10);
    }
}
