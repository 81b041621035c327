//! `wave_force`: waves excite a hull at or near the surface, and push it slowly along.

use super::info::DOF;
use super::{EffectInfo, Law, Moment, ParameterInfo, Stage, Values};
use crate::given::WAVE;
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "wave_force",
    law: "+ a_npm ζ + b_nspm ζ' + c_kg ζ'' + d_npm2 s in one DOF, s' = (ζ² - s)/drift_s, s(t0) = 0, ζ = measured height of the water's surface at the vehicle",
    stage: Stage::Hydrodynamics,
    order: 136,
    // A hull of 30 kg, .5 m long and .3 m wide, at the surface: rho g A_wp = 1.5 kN/m at most, and its water's mass.
    parameters: &[
        ParameterInfo::new(
            "a_npm",
            "N/m (N for a moment)",
            "force by the height: buoyancy of the wave",
            (-1000.0, 1000.0),
            (-1e7, 1e7),
            100.0,
        ),
        ParameterInfo::new(
            "b_nspm",
            "N s/m (N s for a moment)",
            "force by its rate: what lags a quarter of a period",
            (-300.0, 300.0),
            (-1e7, 1e7),
            20.0,
        )
        .or(0.0),
        ParameterInfo::new(
            "c_kg",
            "kg (kg m for a moment)",
            "force by its second derivative: inertia of the moving water",
            (-400.0, 400.0),
            (-1e7, 1e7),
            20.0,
        )
        .or(0.0),
        ParameterInfo::new(
            "d_npm2",
            "N/m2 (N/m for a moment)",
            "slow drift by the height's square",
            (-3000.0, 3000.0),
            (-1e8, 1e8),
            500.0,
        )
        .or(0.0),
        ParameterInfo::new(
            "drift_s",
            "s",
            "time constant over which the square is averaged",
            (2.0, 60.0),
            (0.5, 1000.0),
            10.0,
        )
        .or(10.0),
    ],
    words: &[DOF],
    confusable: &["constant_force", "seiche"],
    source: "theory/physics.md, hydrodynamics; Faltinsen 1990, 3 (linear wave loads) and 5 (slow drift); Newman 1977, 6 (bodies in waves)",
};

#[derive(Debug)]
struct Wave<T> {
    dof: usize,
    a_npm: T,
    b_nspm: T,
    c_kg: T,
    d_npm2: T,
    drift_s: T,
}

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    let [a_npm, b_nspm, c_kg, d_npm2, drift_s] = std::array::from_fn(|i| values.numbers[i]);
    Wave {
        dof: values.words[0],
        a_npm,
        b_nspm,
        c_kg,
        d_npm2,
        drift_s,
    }
}

impl<T: Real> Law<T> for Wave<T> {
    fn states(&self) -> usize {
        1 // ζ², averaged
    }

    fn fastest_s(&self) -> f64 {
        self.drift_s.value()
    }

    fn force(&self, m: &Moment<'_, T>, own: &[T], force: &mut [T; 6]) {
        // Without a wave there is no drift either.
        if m.given.and_then(|g| g.companions[WAVE].as_ref()).is_none() {
            return;
        }
        let height_m = m.companion(WAVE);
        let [rise_mps, second_mps2] = m.companion_slopes(WAVE);
        let excited = self.a_npm * height_m + self.b_nspm * rise_mps + self.c_kg * second_mps2;
        force[self.dof] = force[self.dof] + excited + self.d_npm2 * own[0];
    }

    fn own_rate(&self, m: &Moment<'_, T>, _nu_dot: &[T; 6], own: &[T], rate: &mut [T]) {
        let height_m = m.companion(WAVE);
        rate[0] = (height_m * height_m - own[0]) / self.drift_s;
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::tests::fixtures::*;
    use crate::given::{Curve, Given};

    const SPEED_RADPS: f64 = 2.0;
    const HEIGHT_M: f64 = 0.05;

    /// Regular waves of 5 cm for 40 s.
    fn waves() -> Given {
        let knots = (0..2000).map(|k| 0.02 * f64::from(k)).map(|t_s| {
            let (sin, cos) = (SPEED_RADPS * t_s).sin_cos();
            (t_s, HEIGHT_M * sin, HEIGHT_M * SPEED_RADPS * cos)
        });
        Given {
            companions: [
                None,
                None,
                None,
                Some(Curve::new(&knots.collect::<Vec<_>>())),
            ],
            ..Given::default()
        }
    }

    #[test]
    fn without_a_measured_wave_it_does_nothing() {
        let all = [
            ("a_npm", 50.0),
            ("b_nspm", 20.0),
            ("c_kg", 10.0),
            ("d_npm2", 500.0),
        ];
        let wave = [entry("wave_force", &all)];
        assert_eq!(extra(&wave, State::default(), [0.0; 6]), [0.0; 6]);
        let (path, _) = frictionless(&wave);
        let mut path = path.beside(Given::default());
        assert_eq!(path.state_at(10.0).unwrap().vehicle.nu, [0.0; 6]);
    }

    /// M u' = (a - c w^2) h sin(w t) + b h w cos(w t) has a closed form.
    #[test]
    fn it_excites_by_height_rate_and_second_derivative() {
        let (a, b, c, w) = (60.0, 20.0, 25.0, SPEED_RADPS);
        let numbers = [("a_npm", a), ("b_nspm", b), ("c_kg", c)];
        let (path, mass) = frictionless(&[entry("wave_force", &numbers)]);
        let mut path = path.beside(waves());
        for t_s in [0.5_f64, 2.0, 11.0] {
            let (sin, cos) = (w * t_s).sin_cos();
            let impulse = HEIGHT_M * ((a - c * w * w) / w * (1.0 - cos) + b * sin);
            let made = path.state_at(t_s).unwrap().vehicle.nu[0] * mass;
            assert!((made - impulse).abs() < 1e-4, "{t_s}: {made} {impulse}");
        }
    }

    /// The square of a regular wave has half the square of its height as its mean, reached over the time constant.
    #[test]
    fn slow_drift_is_the_mean_of_the_square() {
        let numbers = [("a_npm", 0.0), ("d_npm2", 800.0), ("drift_s", 4.0)];
        let (path, mass) = frictionless(&[entry("wave_force", &numbers)]);
        let mut path = path.beside(waves());
        let mut speed = |t_s: f64| path.state_at(t_s).unwrap().vehicle.nu[0];
        let early_n = speed(1.0) * mass;
        // Four whole periods of the square, long after the beginning.
        let (from_s, over_s) = (25.0, 4.0 * std::f64::consts::PI / SPEED_RADPS);
        let mean_n = (speed(from_s + over_s) - speed(from_s)) * mass / over_s;
        let expected_n = 800.0 * 0.5 * HEIGHT_M * HEIGHT_M;
        assert!(
            (mean_n / expected_n - 1.0).abs() < 5e-3,
            "{mean_n} {expected_n}"
        );
        assert!(early_n < 0.2 * expected_n, "{early_n}");
    }
}
