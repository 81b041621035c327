//! `wall_added_mass`: near a wall the added mass grows.

use super::{EffectInfo, Law, Moment, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "wall_added_mass",
    law: "-X_udot (1 + g), g = gain exp(-|x - wall_x_m| / length_m), and the force -1/2 (dM/dx) u^2",
    stage: Stage::Hydrodynamics,
    order: 100,
    parameters: &[
        ParameterInfo::new(
            "gain",
            "1",
            "growth of the added mass at the wall",
            (0.02, 0.2),
            (-0.9, 10.0),
            0.1,
        ),
        ParameterInfo::new(
            "wall_x_m",
            "m",
            "the wall, tank frame",
            (-3.0, 5.0),
            (-1000.0, 1000.0),
            0.5,
        ),
        ParameterInfo::new(
            "length_m",
            "m",
            "distance over which it fades by e",
            (0.05, 1.0),
            (0.02, 100.0),
            0.2,
        ),
    ],
    words: &[],
    confusable: &["fluid_memory", "tether_spring"],
    source: "theory/physics.md, hydrodynamics; Lamb 1932, art. 137 (Lagrange: a mass that depends on place)",
};

#[derive(Debug)]
struct Wall<T> {
    gain: T,
    wall_x_m: T,
    length_m: T,
}

/// The kink of |x - wall| is rounded over this distance, so that the force has no jump for a vehicle
/// that passes the "wall" (a step in the tank's section); 1 % of g for the shortest plausible length.
const ROUND_M: f64 = 0.001;

impl<T: Real> Wall<T> {
    /// g and dg/dx.
    fn growth(&self, x_m: T) -> (T, T) {
        let d = x_m - self.wall_x_m;
        let far = (d * d + T::from_f64(ROUND_M * ROUND_M)).sqrt();
        let g = self.gain * (-far / self.length_m).exp();
        (g, -g * d / (far * self.length_m))
    }
}

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Wall {
        gain: values.numbers[0],
        wall_x_m: values.numbers[1],
        length_m: values.numbers[2],
    }
}

impl<T: Real> Law<T> for Wall<T> {
    fn added_mass(&self, m: &Moment<'_, T>, mass: &mut [T; 6]) {
        let (g, _) = self.growth(m.eta[0]);
        mass[0] = mass[0] - m.hydrodynamics.added[0] * g;
    }

    fn force(&self, m: &Moment<'_, T>, _own: &[T], force: &mut [T; 6]) {
        // d/dt(M u) - 1/2 M' u^2 = X with M' = dM/dx: M u' = X - 1/2 M' u^2.
        let (_, slope) = self.growth(m.eta[0]);
        let mass_slope = -m.hydrodynamics.added[0] * slope;
        force[0] = force[0] - mass_slope * m.nu[0] * m.nu[0] * 0.5;
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    const WALL: [(&str, f64); 3] = [("gain", 0.2), ("wall_x_m", 0.5), ("length_m", 0.15)];

    /// Without drag and thrust 1/2 M(x) u^2 is kept, also across the wall.
    #[test]
    fn energy_is_kept_on_the_way_past_the_wall() {
        let (mut r, mass) = frictionless(&[entry("wall_added_mass", &WALL)]);
        r.command(0.0, surge(100.0)).unwrap();
        r.command(0.5, surge(0.0)).unwrap();
        let energy = |r: &mut crate::Trajectory, t_s: f64| {
            let s = r.state_at(t_s).unwrap().vehicle;
            let g = 0.2 * (-((s.eta[0] - 0.5).powi(2) + 1e-6).sqrt() / 0.15).exp();
            (s.eta[0], 0.5 * (mass + 250.0 * g) * s.nu[0].powi(2))
        };
        let (_, first) = energy(&mut r, 0.5);
        for t_s in [1.0, 2.0, 3.0, 4.0, 5.5] {
            let (x, e) = energy(&mut r, t_s);
            assert!(
                (e / first - 1.0).abs() < 2e-6,
                "x = {x}: {}",
                e / first - 1.0
            );
        }
        assert!(energy(&mut r, 5.5).0 > 0.7);
    }

    #[test]
    fn at_the_wall_the_same_thrust_accelerates_less() {
        let at = |x: f64| State {
            eta: [x, 0.0, 0.0, 0.0, 0.0, 0.0],
            ..State::default()
        };
        let a = |x: f64| acceleration(&[entry("wall_added_mass", &WALL)], at(x), surge(8.0))[0];
        let expected = |x: f64| 8.0 / (279.777 + 250.0 * 0.2 * (-(x - 0.5f64).abs() / 0.15).exp());
        assert!(
            (a(0.2) - expected(0.2)).abs() < 1e-6 && (a(0.5) / expected(0.5) - 1.0).abs() < 2e-3
        );
    }
}
