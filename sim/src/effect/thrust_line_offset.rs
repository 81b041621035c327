//! `thrust_line_offset`: the line of thrust misses the CG.

use super::{EffectInfo, Law, Moment, ParameterInfo, Stage, Values, WordInfo};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "thrust_line_offset",
    law: "M + lever_m X (axis = pitch; > 0: thrust line below the CG), N + lever_m X (axis = yaw)",
    stage: Stage::Thruster,
    order: 80,
    parameters: &[ParameterInfo::new(
        "lever_m",
        "m",
        "lever of the surge thrust about the axis",
        (-0.1, 0.1),
        (-5.0, 5.0),
        0.02,
    )],
    words: &[WordInfo {
        name: "axis",
        meaning: "moment that surge thrust makes",
        allowed: &["pitch", "yaw"],
        absent: Some("pitch"),
    }],
    confusable: &["added_mass_coupling", "attitude_disturbance"],
    source: "theory/physics.md, thruster stage",
};

#[derive(Debug)]
struct Offset<T> {
    dof: usize,
    lever_m: T,
}

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Offset {
        dof: INFO.words[0].dof(values.words[0]),
        lever_m: values.numbers[0],
    }
}

impl<T: Real> Law<T> for Offset<T> {
    fn thrust(&self, _m: &Moment<'_, T>, wrench: &mut [T; 6], _own: &[T], _rate: &mut [T]) {
        wrench[self.dof] = wrench[self.dof] + self.lever_m * wrench[0];
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    #[test]
    fn thrust_pitches_and_yaws() {
        let pitch = entry("thrust_line_offset", &[("lever_m", 0.03)]);
        let yaw = with_word(
            entry("thrust_line_offset", &[("lever_m", -0.01)]),
            "axis",
            "yaw",
        );
        let made = extra(&[pitch, yaw], State::default(), surge(8.0));
        for (got, expected) in made.iter().zip([0.0, 0.0, 0.0, 0.0, 0.24, -0.08]) {
            assert!((got - expected).abs() < 1e-12);
        }
    }

    #[test]
    fn it_is_the_real_thrust_that_turns() {
        let half = entry("thrust_scale", &[("gain", 0.5)]);
        let made = extra(
            &[entry("thrust_line_offset", &[("lever_m", 0.03)]), half],
            State::default(),
            surge(8.0),
        );
        assert!((made[4] - 0.12).abs() < 1e-12);
    }
}
