//! `fin_force`: a rudder or a fin lifts and drags under way.

use super::info::DOF;
use super::{EffectInfo, Law, Moment, ParameterInfo, Stage, Values, WordInfo};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "fin_force",
    law: "+ (a + b |u|) |u| (c1 δ + c2 δ²) in one DOF, δ = measured angle of the fin, u through the water",
    stage: Stage::Hydrodynamics,
    order: 135,
    // a and b with c1 and c2 say one scale twice: a fit leaves the stream at the square of the speed, a file may say otherwise.
    parameters: &[
        ParameterInfo::new(
            "c1",
            "N s2/(m2 rad) (N m s2/(m2 rad) for a moment)",
            "force by the angle: lift",
            (-100.0, 100.0),
            (-1e5, 1e5),
            10.0,
        ),
        ParameterInfo::new(
            "c2",
            "N s2/(m2 rad2) (N m s2/(m2 rad2) for a moment)",
            "force by the angle's square: drag",
            (-200.0, 200.0),
            (-1e5, 1e5),
            -20.0,
        )
        .or(0.0),
        ParameterInfo::new(
            "a_mps",
            "m/s",
            "speed of a stream that the fin stands in besides the way (a propeller's)",
            (0.0, 2.0),
            (-10.0, 10.0),
            0.5,
        )
        .or(0.0)
        .held(),
        ParameterInfo::new(
            "b",
            "1",
            "share of the way in the stream",
            (0.5, 1.5),
            (-10.0, 10.0),
            1.0,
        )
        .or(1.0)
        .held(),
    ],
    words: &[
        DOF,
        WordInfo {
            name: "fin",
            meaning: "fin whose measured angle it is",
            allowed: &["rudder", "elevator"],
            absent: Some("rudder"),
        },
    ],
    confusable: &["cross_flow_coupling"],
    source: "theory/physics.md, hydrodynamics; Fossen 2011, 9.5 (rudder forces); Ogawa and Kasai 1978 (MMG)",
};

#[derive(Debug)]
struct Fin<T> {
    dof: usize,
    fin: usize,
    c1: T,
    c2: T,
    a_mps: T,
    b: T,
}

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    let [c1, c2, a_mps, b] = std::array::from_fn(|i| values.numbers[i]);
    Fin {
        dof: values.words[0],
        fin: values.words[1],
        c1,
        c2,
        a_mps,
        b,
    }
}

impl<T: Real> Law<T> for Fin<T> {
    fn force(&self, m: &Moment<'_, T>, _own: &[T], force: &mut [T; 6]) {
        if m.companions.is_none() {
            return;
        }
        let angle = m.companion(self.fin);
        let speed = m.nu_r[0].abs();
        let stream = (self.a_mps + self.b * speed) * speed;
        force[self.dof] = force[self.dof] + stream * angle * (self.c1 + self.c2 * angle);
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;
    use crate::given::{Curve, Given};
    use crate::model::{Model, ModelState};
    use crate::vehicle::Hydrodynamics;

    /// Force in surge and yaw at a speed and angles of rudder and elevator.
    fn forces(entries: &[hydroline_rigs::PhysicsEntry], u_mps: f64, angles: [f64; 2]) -> [f64; 6] {
        let given = Given {
            companions: [
                Some(Curve::constant(angles[0])),
                Some(Curve::constant(angles[1])),
                None,
                None,
            ],
            ..Given::default()
        };
        let hydrodynamics = Hydrodynamics::new(&crate::fixture::lshpi_rig().vehicle);
        let mass = hydrodynamics.mass();
        let mut state = ModelState::at_rest([0.0; 6]);
        state.vehicle.nu[0] = u_mps;
        let rate = |entries: &[hydroline_rigs::PhysicsEntry]| {
            let model = Model {
                hydrodynamics: hydrodynamics.clone(),
                effects: stack(entries),
            };
            let made = model.rate_beside(0.0, 0.0, &state, &[0.0; 6], Some(&given));
            made.vehicle.nu
        };
        let (with, without) = (rate(entries), rate(&[]));
        std::array::from_fn(|d| (with[d] - without[d]) * mass[d])
    }

    #[test]
    fn it_lifts_by_the_angle_and_drags_by_its_square() {
        let of = |numbers: &[(&str, f64)], dof: &str, fin: &str| {
            with_word(
                with_word(entry("fin_force", numbers), "dof", dof),
                "fin",
                fin,
            )
        };
        let both = [
            of(&[("c1", 6.0)], "yaw", "rudder"),
            of(&[("c1", 0.0), ("c2", -20.0)], "surge", "rudder"),
            of(
                &[("c1", -4.0), ("a_mps", 0.3), ("b", 0.5)],
                "pitch",
                "elevator",
            ),
        ];
        for (u, sign) in [(0.5, 1.0), (-0.5, 1.0), (0.0, 0.0)] {
            let made = forces(&both, u, [-0.2, 0.1]);
            let square = 0.25 * sign;
            assert!((made[5] - square * 6.0 * -0.2).abs() < 1e-12, "{made:?}");
            assert!((made[0] - square * -20.0 * 0.04).abs() < 1e-12, "{made:?}");
            let stream = (0.3 + 0.25) * 0.5 * sign;
            assert!((made[4] - stream * -4.0 * 0.1).abs() < 1e-12, "{made:?}");
        }
    }

    #[test]
    fn without_a_measured_angle_it_does_nothing() {
        let fin = [entry("fin_force", &[("c1", 6.0)])];
        let state = State {
            nu: [0.5, 0.0, 0.0, 0.0, 0.0, 0.1],
            ..State::default()
        };
        assert_eq!(extra(&fin, state, [0.0; 6]), [0.0; 6]);
    }
}
