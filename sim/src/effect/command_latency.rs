//! `command_latency`: a command takes effect after its stamp.

use super::{EffectInfo, Law, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "command_latency",
    law: "a command stamped t acts at t + delay_s",
    stage: Stage::Timing,
    order: 30,
    parameters: &[ParameterInfo::new(
        "delay_s",
        "s",
        "time from a command's stamp to its load",
        (0.005, 0.3),
        (0.0, 5.0),
        0.08,
    )],
    words: &[],
    confusable: &["camera_latency", "fluid_memory", "thruster_lag"],
    source: "theory/physics.md, timing",
};

#[derive(Debug)]
struct CommandLatency<T>(T);

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    CommandLatency(values.numbers[0])
}

impl<T: Real> Law<T> for CommandLatency<T> {
    fn command_delay_s(&self) -> T {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    #[test]
    fn the_motion_is_that_of_commands_given_later() {
        let (mut r, mass) = frictionless(&[entry("command_latency", &[("delay_s", 0.0731)])]);
        r.command(0.3, surge(8.0)).unwrap();
        r.command(1.1, surge(-4.0)).unwrap();
        let u = |r: &mut crate::Trajectory, t_s: f64| r.state_at(t_s).unwrap().vehicle.nu[0] * mass;
        assert_eq!(u(&mut r, 0.37), 0.0);
        assert!((u(&mut r, 1.0) - 8.0 * (1.0 - 0.3731)).abs() < 1e-12);
        assert!((u(&mut r, 2.0) - (8.0 * 0.8 - 4.0 * (2.0 - 1.1731))).abs() < 1e-12);
    }
}
