//! Plans from which the next run is chosen, and what a run by one would be.

use hydroline_core::run::Command;
use hydroline_plan::setpoint::setpoint;
use hydroline_rigs::{Plan, PlanStep, Rig, Shape, StepLoad, Wrench};
use hydroline_sim::Allocation;

/// Observation of a run that is planned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Watched {
    /// Behind the plan's end \[s\].
    pub tail_s: f64,
    /// Stamps per second.
    pub rate_hz: f64,
}

impl Default for Watched {
    fn default() -> Self {
        Watched {
            tail_s: 6.0,
            rate_hz: 25.0,
        }
    }
}

/// Library of plans in one DOF at a size \[N, N m\].
pub fn library(dof: usize, size: f64) -> Vec<Plan> {
    let step = |for_s: f64, share: f64, shape: Shape| {
        let load = std::array::from_fn(|i| if i == dof { share * size } else { 0.0 });
        PlanStep {
            for_s,
            load: StepLoad::Wrench(Wrench::from_array(load)),
            shape,
        }
    };
    let hold = |for_s, share| step(for_s, share, Shape::Hold);
    let sine = |for_s, share, period_s| {
        step(
            for_s,
            share,
            Shape::Sine {
                period_s,
                phase_rad: 1.31,
            },
        )
    };
    let plan = |name: &str, steps: Vec<PlanStep>| Plan {
        name: name.to_owned(),
        steps,
        source_toml: String::new(),
    };
    vec![
        plan("next-constant", vec![hold(12.0, 1.0)]),
        plan("next-coast-down", vec![hold(6.0, 1.0), hold(14.0, 0.0)]),
        plan(
            "next-reversal",
            vec![hold(6.0, 1.0), hold(8.0, -1.0), hold(6.0, 0.0)],
        ),
        plan(
            "next-reversals",
            vec![
                hold(4.0, 1.0),
                hold(6.0, -1.0),
                hold(6.0, 1.0),
                hold(4.0, -1.0),
            ],
        ),
        plan(
            "next-steps",
            vec![
                hold(5.0, 0.25),
                hold(5.0, 0.5),
                hold(5.0, 1.0),
                hold(5.0, -0.25),
                hold(4.0, -1.0),
            ],
        ),
        plan(
            "next-small-steps",
            vec![
                hold(8.0, 0.1),
                hold(4.0, 0.0),
                hold(8.0, -0.1),
                hold(4.0, 0.05),
            ],
        ),
        plan(
            "next-still-then-go",
            vec![hold(12.0, 0.0), hold(6.0, 0.5), hold(6.0, -0.5)],
        ),
        plan(
            "next-chirp",
            vec![step(
                20.0,
                1.0,
                Shape::Chirp {
                    f0_hz: 0.05,
                    f1_hz: 1.0,
                },
            )],
        ),
        plan(
            "next-two-tone",
            vec![sine(12.0, 0.6, 8.0), sine(12.0, 1.0, 2.0)],
        ),
        plan("next-slow-sine", vec![sine(24.0, 0.5, 12.0)]),
    ]
}

/// Commands that a plan sends, and the stamps at which the run is seen \[s\].
pub fn run_of(
    rig: &Rig,
    allocation: &Allocation,
    plan: &Plan,
    watched: Watched,
) -> Option<(Vec<Command>, Vec<f64>)> {
    let end_s = plan.duration_s() + watched.tail_s;
    let period_s = 1.0 / rig.thrusters.link.rate_hz;
    let mut commands: Vec<Command> = Vec::new();
    let mut k = 0u32;
    while f64::from(k) * period_s < end_s {
        let t_s = f64::from(k) * period_s;
        let set = setpoint(rig, allocation, plan, t_s).ok()?;
        let wrench = allocation.wrench(&set.thrust_n).ok()?.to_array();
        if commands.last().is_none_or(|c| c.wrench != wrench) {
            commands.push(Command { t_s, wrench });
        }
        k += 1;
    }
    let stamps = 0..(end_s * watched.rate_hz) as u32;
    let times_s = stamps
        .map(|k| 0.006 + f64::from(k) / watched.rate_hz)
        .collect();
    Some((commands, times_s))
}
