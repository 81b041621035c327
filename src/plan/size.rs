//! A plan at another size: what of a refused one fits into tank, limits and target.

use hydroline_calib::plane::PlaneMap;
use hydroline_rigs::{Plan, PlanStep, Rig, StepLoad, Wrench};

use crate::preflight::{PreflightError, Repeats, preflight_runs};

/// Shares that are tried from the largest down: what is refused need not be refused at every larger size (a stripe that
/// never comes back over the target, a load within the deadband), so the first that fits counts.
const TRIED: [f64; 12] = [
    0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.15, 0.1, 0.05, 0.02,
];
/// The share that fits is known to a fiftieth of it: nobody sets a load finer.
const KNOWN_TO: f64 = 0.02;

/// The same steps with every load times `share`.
pub fn scaled(plan: &Plan, share: f64) -> Plan {
    let steps = plan.steps.iter().map(|step| PlanStep {
        load: match &step.load {
            StepLoad::Wrench(w) => {
                StepLoad::Wrench(Wrench::from_array(w.to_array().map(|v| share * v)))
            }
            StepLoad::ThrustN(each) => {
                let each = each.iter().map(|(name, n)| (name.clone(), share * n));
                StepLoad::ThrustN(each.collect())
            }
        },
        ..step.clone()
    });
    let mut made = Plan {
        name: plan.name.clone(),
        steps: steps.collect(),
        source_toml: String::new(),
    };
    made.source_toml = made.to_toml();
    made
}

/// Largest load of a plan per axis of the body \[N, N m\]; none where single thrusters are commanded.
pub fn largest(plan: &Plan) -> Option<[f64; 6]> {
    plan.steps
        .iter()
        .try_fold([0.0_f64; 6], |largest, step| match &step.load {
            StepLoad::Wrench(w) => {
                let w = w.to_array();
                Some(std::array::from_fn(|i| largest[i].max(w[i].abs())))
            }
            StepLoad::ThrustN(_) => None,
        })
}

/// Why a rig refuses a plan: the first violation, or more than the thrusters give; `None` where it runs. `map` as for
/// [`preflight_runs`].
///
/// # Errors
/// [`PreflightError::Sim`] for a rig that cannot be simulated.
pub fn refusal(
    rig: &Rig,
    plan: &Plan,
    repeats: Repeats,
    map: Option<&dyn PlaneMap>,
) -> Result<Option<String>, PreflightError> {
    match preflight_runs(rig, plan, repeats, map) {
        Ok(report) => Ok(report.violations.first().map(ToString::to_string)),
        Err(PreflightError::Setpoint(error)) => Ok(Some(error.to_string())),
        Err(other) => Err(other),
    }
}

/// Whether a plan runs on a rig.
fn fits(
    rig: &Rig,
    plan: &Plan,
    repeats: Repeats,
    map: Option<&dyn PlaneMap>,
) -> Result<bool, PreflightError> {
    Ok(refusal(rig, plan, repeats, map)?.is_none())
}

/// Largest share of a refused plan's loads with which it runs on this rig, to two digits; `None` where it is not the size
/// that keeps it from running.
///
/// # Errors
/// [`PreflightError::Sim`] for a rig that cannot be simulated.
pub fn share_that_fits(
    rig: &Rig,
    plan: &Plan,
    repeats: Repeats,
    map: Option<&dyn PlaneMap>,
) -> Result<Option<f64>, PreflightError> {
    let at = |share: f64| fits(rig, &scaled(plan, share), repeats, map);
    let mut refused = 1.0;
    for share in TRIED {
        if !at(share)? {
            refused = share;
            continue;
        }
        let mut fitting = share;
        while refused - fitting > KNOWN_TO * fitting {
            let middle = 0.5 * (fitting + refused);
            if at(middle)? {
                fitting = middle;
            } else {
                refused = middle;
            }
        }
        // Down to two digits; where a gap lies just there, what was tried stands.
        let digits = 10f64.powf(1.0 - fitting.log10().floor());
        let round = (fitting * digits).floor() / digits;
        return Ok(Some(if at(round)? { round } else { fitting }));
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rig_and(plan: &str) -> (Rig, Plan) {
        let rig = Rig::builtin("lshpi").unwrap();
        (rig, Plan::load_or_builtin(plan).unwrap())
    }

    #[test]
    fn what_is_refused_for_its_size_fits_at_the_share_that_is_said_and_not_at_a_tenth_more() {
        let (rig, plan) = rig_and("surge-8n");
        let large = scaled(&plan, 6.0);
        assert!(!fits(&rig, &large, Repeats::ONCE, None).unwrap());
        let share = share_that_fits(&rig, &large, Repeats::ONCE, None)
            .unwrap()
            .unwrap();
        assert!(fits(&rig, &scaled(&large, share), Repeats::ONCE, None).unwrap());
        assert!(
            !fits(&rig, &scaled(&large, 1.1 * share), Repeats::ONCE, None).unwrap(),
            "{share}"
        );
    }

    #[test]
    fn more_than_the_thrusters_give_is_a_question_of_size_as_well() {
        let (rig, plan) = rig_and("surge-4n");
        let share = share_that_fits(&rig, &scaled(&plan, 1e4), Repeats::ONCE, None);
        // A ten-thousandth is less than the least that is tried.
        assert_eq!(share.unwrap(), None);
        let share = share_that_fits(&rig, &scaled(&plan, 20.0), Repeats::ONCE, None);
        assert!(share.unwrap().is_some_and(|s| s > 0.02 && s < 0.5));
    }

    #[test]
    fn a_start_outside_of_the_limits_is_no_question_of_size() {
        let (mut rig, plan) = rig_and("surge-4n");
        rig.tank.start_pose[0] = rig.limits.x_m[1] + 1.0;
        assert_eq!(
            share_that_fits(&rig, &plan, Repeats::ONCE, None).unwrap(),
            None
        );
    }

    #[test]
    fn a_scaled_plan_reads_back_as_it_is() {
        let (_, plan) = rig_and("two-tone");
        let half = scaled(&plan, 0.5);
        let back = Plan::from_toml(&half.source_toml, "half.toml").unwrap();
        assert_eq!(back.steps, half.steps);
        assert_eq!(largest(&half).unwrap()[0], 12.0);
    }
}
