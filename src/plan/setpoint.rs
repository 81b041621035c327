//! From a plan's load to pulses: allocation over the thrusters, curve, and the wire's resolution.
//!
//! One place for `record`, `simulate` and the check before a run, so that what is checked is what is sent.

use hydroline_rigs::{Plan, Rig, StepLoad, ThrusterSet};
use hydroline_sim::{Allocation, ThrustError};

/// Resolution of both protocols on the wire: a quarter of a microsecond \[us\].
pub const PULSE_STEP_US: f64 = 0.25;

/// The set-points of all thrusters at one time, in the rig's order.
#[derive(Debug, Clone, PartialEq)]
pub struct Setpoint {
    /// Pulses on the wire's grid \[us\].
    pub pulses_us: Vec<f64>,
    /// Thrust of exactly these pulses by the rig's curves \[N\].
    pub thrust_n: Vec<f64>,
    /// Step of the plan, from 1; 0 = none.
    pub plan_step: u32,
}

/// Why a load cannot be commanded.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum SetpointError {
    #[error("plan step {step} at {t_s:.2} s: {source}")]
    Thrust {
        /// Step, from 1.
        step: u32,
        t_s: f64,
        source: ThrustError,
    },
    /// A thruster would have to give more than its curve holds.
    #[error(
        "plan step {step} at {t_s:.2} s: thruster '{thruster}' would have to give {asked_n:.2} N, its curve holds {low_n:.2} .. {high_n:.2} N; ask for less"
    )]
    Beyond {
        /// Step, from 1.
        step: u32,
        t_s: f64,
        thruster: String,
        asked_n: f64,
        low_n: f64,
        high_n: f64,
    },
}

/// The plan's load at `t_s`, allocated and on the wire's grid.
///
/// # Errors
/// [`SetpointError`] naming step, time and thruster.
pub fn setpoint(
    rig: &Rig,
    allocation: &Allocation,
    plan: &Plan,
    t_s: f64,
) -> Result<Setpoint, SetpointError> {
    let (index, load) = plan.load_at(t_s);
    let plan_step = if index < plan.steps.len() {
        index as u32 + 1
    } else {
        0
    };
    let thrust = |source| SetpointError::Thrust {
        step: plan_step,
        t_s,
        source,
    };
    let asked_n = match &load {
        StepLoad::Wrench(wrench) => {
            let allocated = allocation.allocate(wrench).map_err(thrust)?;
            if let Some(cut) = allocated.saturated.first() {
                return Err(beyond(
                    &rig.thrusters,
                    plan_step,
                    t_s,
                    &cut.thruster,
                    cut.asked_n,
                ));
            }
            allocated.thrust_n
        }
        StepLoad::ThrustN(named) => rig
            .thrusters
            .thrusters
            .iter()
            .map(|t| {
                named
                    .iter()
                    .find(|(name, _)| *name == t.name)
                    .map_or(0.0, |(_, thrust_n)| *thrust_n)
            })
            .collect(),
    };
    let mut pulses_us = Vec::with_capacity(asked_n.len());
    let mut thrust_n = Vec::with_capacity(asked_n.len());
    for (thruster, asked_n) in rig.thrusters.thrusters.iter().zip(&asked_n) {
        let pulse_us = thruster
            .curve
            .pulse_us(*asked_n, rig.thrusters.neutral_us)
            .ok_or_else(|| beyond(&rig.thrusters, plan_step, t_s, &thruster.name, *asked_n))?;
        let sent_us = (pulse_us / PULSE_STEP_US).round() * PULSE_STEP_US;
        pulses_us.push(sent_us);
        thrust_n.push(thruster.curve.thrust_n(sent_us));
    }
    Ok(Setpoint {
        pulses_us,
        thrust_n,
        plan_step,
    })
}

fn beyond(set: &ThrusterSet, step: u32, t_s: f64, thruster: &str, asked_n: f64) -> SetpointError {
    let curve = set
        .thrusters
        .iter()
        .find(|t| t.name == thruster)
        .map(|t| &t.curve);
    let (low_n, high_n) = curve.map_or((0.0, 0.0), |c| c.thrust_range_n(set.min_us, set.max_us));
    SetpointError::Beyond {
        step,
        t_s,
        thruster: thruster.to_owned(),
        asked_n,
        low_n,
        high_n,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_sent_makes_the_planned_wrench_to_the_wires_resolution() {
        let rig = Rig::builtin("lshpi").unwrap();
        let allocation = Allocation::new(&rig.thrusters).unwrap();
        let plan = Plan::builtin("surge-4n").unwrap();
        let set = setpoint(&rig, &allocation, &plan, 0.5).unwrap();
        assert_eq!(set.plan_step, 1);
        assert!(set.pulses_us.iter().all(|p| (p * 4.0).fract() == 0.0));
        let wrench = allocation.wrench(&set.thrust_n).unwrap();
        // Half a step of 0.25 us on a curve of 0.085 N/us, four thrusters at 45 deg: 0.03 N.
        assert!((wrench.surge_n - 4.0).abs() < 0.03, "{wrench:?}");
        assert!(
            wrench.sway_n.abs() < 1e-9 && wrench.yaw_nm.abs() < 1e-9,
            "{wrench:?}"
        );
    }

    #[test]
    fn too_much_is_refused_with_thruster_and_range() {
        let rig = Rig::builtin("lshpi").unwrap();
        let allocation = Allocation::new(&rig.thrusters).unwrap();
        let plan = Plan::from_toml(
            "[[step]]\nfor_s = 1\nwrench = { surge_n = 1000 }\n",
            "big.toml",
        )
        .unwrap();
        let words = setpoint(&rig, &allocation, &plan, 0.0)
            .unwrap_err()
            .to_string();
        assert!(
            words.contains("step 1") && words.contains("h_") && words.contains("51.5"),
            "{words}"
        );
    }
}
