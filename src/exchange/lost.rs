//! What an export cannot hold, and by how far the motion is another one without it.

use hydroline_identify::predict::predict;
use hydroline_rigs::channel::Channel;
use hydroline_rigs::{PhysicsEntry, Plan, Rig};
use hydroline_sim::effect::check;
use schemars::JsonSchema;
use serde::Serialize;

use super::model::{Written, name_of};

/// Plans over which exports are compared: a push, reversals, all degrees of freedom at once; of each the first that the rig runs.
const PLANS: [&[&str]; 3] = [
    &["surge-8n"],
    &["reversals"],
    &["mixed-6dof", "bluerov2-heavy-mixed", "bluerov2-mixed"],
];
/// Samples per second of the comparison.
const RATE_HZ: f64 = 10.0;

/// Something that the target cannot hold.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Lost {
    /// Effect, or part of the rig.
    pub what: String,
    /// Reason, with what to do about it.
    pub why: String,
}

impl Lost {
    /// A part of the rig and the reason.
    pub fn new(what: impl Into<String>, why: impl Into<String>) -> Self {
        Lost {
            what: what.into(),
            why: why.into(),
        }
    }
}

/// Largest distance between the rig's motion and that of what was written, over one plan.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Difference {
    /// Name of the plan.
    pub plan: String,
    /// Of the position \[mm\].
    pub position_mm: f64,
    /// Of the attitude \[deg\].
    pub attitude_deg: f64,
}

/// The reasons of effects that formulas do not hold.
pub fn of_formulas(model: &Written) -> Vec<Lost> {
    let absent = model.absent.iter();
    absent
        .map(|(name, reason)| Lost::new(name, reason.words()))
        .collect()
}

/// The same rig without some of its effects, by their names with the words that place them.
#[must_use]
pub fn without(rig: &Rig, names: &[String]) -> Rig {
    let mut less = rig.clone();
    if let Ok(effects) = check(&rig.physics) {
        let stays = effects.iter().map(|e| !names.contains(&name_of(e)));
        let entries: Vec<PhysicsEntry> = rig
            .physics
            .iter()
            .zip(stays)
            .filter(|e| e.1)
            .map(|e| e.0.clone())
            .collect();
        less.physics = entries;
    }
    less
}

/// Distances over the plans that fit the rig; a plan that its thrusters cannot make, or that runs away with it, is left out.
pub fn differences(rig: &Rig, written: &Rig) -> Vec<Difference> {
    if rig == written {
        return Vec::new();
    }
    PLANS
        .into_iter()
        .filter_map(|names| names.iter().find_map(|name| over(rig, written, name)))
        .collect()
}

fn over(rig: &Rig, written: &Rig, name: &str) -> Option<Difference> {
    let plan = Plan::builtin(name).ok()?;
    plan.check_against(rig).ok()?;
    let motion = |rig: &Rig| Some(predict(rig, &plan, None, RATE_HZ, 0.0).ok()?.motion);
    let (ours, theirs) = (motion(rig)?, motion(written)?);
    let largest = |channels: [Channel; 3]| {
        let each = ours.iter().zip(&theirs);
        each.map(|(a, b)| {
            let squares = channels.map(|c| (a[c] - b[c]).powi(2));
            squares.iter().sum::<f64>().sqrt()
        })
        .fold(0.0, f64::max)
    };
    let [x, y, z, phi, theta, psi] = Channel::POSES;
    Some(Difference {
        plan: name.to_owned(),
        position_mm: 1e3 * largest([x, y, z]),
        attitude_deg: largest([phi, theta, psi]).to_degrees(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_rigs::ParameterValue;

    /// No pitch, no mixed-6dof: the third plan is that of its own thrusters.
    #[test]
    fn a_vehicle_of_five_degrees_of_freedom_is_compared_over_three_plans_too() {
        let rig = Rig::builtin("bluerov2").unwrap();
        let mut less = rig.clone();
        less.vehicle.coefficients[1].linear *= 0.5;
        let found = differences(&rig, &less);
        let plans: Vec<&str> = found.iter().map(|d| d.plan.as_str()).collect();
        assert_eq!(plans, ["surge-8n", "reversals", "bluerov2-mixed"]);
        assert!(found[2].position_mm > 0.1, "{found:?}");
    }

    #[test]
    fn the_distance_without_an_effect_is_that_of_two_simulations() {
        let mut rig = Rig::builtin("lshpi").unwrap();
        assert!(differences(&rig, &rig.clone()).is_empty());
        rig.physics = vec![PhysicsEntry {
            effect: "thruster_lag".into(),
            parameters: vec![("lag_s".into(), ParameterValue::Number(0.4))],
        }];
        let less = without(&rig, &["thruster_lag_surge".to_owned()]);
        assert!(less.physics.is_empty());
        let found = differences(&rig, &less);
        assert_eq!(found.len(), 3, "{found:?}");
        assert!(found.iter().all(|d| d.position_mm > 1.0), "{found:?}");
    }
}
