//! `attitude_disturbance`: the vehicle oscillates in an axis that the one-DOF formulas assume to be still.

use std::f64::consts::{PI, TAU};

use super::{EffectInfo, Law, ParameterInfo, Stage, Values, WordInfo};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "attitude_disturbance",
    law: "axis + amp_rad sin(2 pi (t - t0)/period_s + phase_rad)",
    stage: Stage::Measurement,
    order: 10,
    parameters: &[
        ParameterInfo::new(
            "amp_rad",
            "rad",
            "amplitude",
            (0.001, 0.0175),
            (-1.0, 1.0),
            0.006,
        ),
        ParameterInfo::new("period_s", "s", "period", (1.0, 20.0), (0.1, 1000.0), 5.0),
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
    words: &[WordInfo {
        name: "axis",
        meaning: "angle that is disturbed",
        allowed: &["roll", "pitch", "yaw"],
        absent: Some("pitch"),
    }],
    confusable: &["floor_slope", "thrust_line_offset"],
    source: "theory/physics.md, measurement; paper Tables 4 and 5",
};

#[derive(Debug)]
struct Disturbance<T> {
    dof: usize,
    amp_rad: T,
    rate_radps: T,
    phase_rad: T,
}

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Disturbance {
        dof: INFO.words[0].dof(values.words[0]),
        amp_rad: values.numbers[0],
        rate_radps: T::from_f64(TAU) / values.numbers[1],
        phase_rad: values.numbers[2],
    }
}

impl<T: Real> Law<T> for Disturbance<T> {
    fn scene_pose(&self, t_s: T, pose: &mut [T; 6]) {
        let offset_rad = self.amp_rad * (self.rate_radps * t_s + self.phase_rad).sin();
        pose[self.dof] = pose[self.dof] + offset_rad;
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    #[test]
    fn the_camera_looks_from_the_oscillating_pose() {
        let pitch = entry(
            "attitude_disturbance",
            &[("amp_rad", 0.01), ("period_s", 4.0)],
        );
        let roll = with_word(
            entry(
                "attitude_disturbance",
                &[("amp_rad", 0.02), ("period_s", 8.0), ("phase_rad", 0.5)],
            ),
            "axis",
            "roll",
        );
        let pose = stack(&[pitch, roll]).scene_pose(1.0, [0.0; 6]);
        assert!((pose[4] - 0.01).abs() < 1e-15);
        assert!((pose[3] - 0.02 * (std::f64::consts::FRAC_PI_4 + 0.5).sin()).abs() < 1e-15);
    }
}
