//! The paper's own protocol: two constant thrusts over 1 m, which cannot part five effects
//! (theory/identifiability.md, confusable effects).

use hydroline_rigs::{ParameterValue, PhysicsEntry, Plan};

use super::error::ProveError;

/// Effects that those runs cannot distinguish.
pub const SET: [&str; 5] = [
    "thruster_deadband",
    "thruster_saturation",
    "current",
    "constant_force",
    "coulomb_friction",
];

/// The two plans.
///
/// # Errors
/// [`ProveError::Rig`].
pub fn plans() -> Result<Vec<Plan>, ProveError> {
    Ok(vec![Plan::builtin("surge-4n")?, Plan::builtin("surge-8n")?])
}

/// Turns a signed effect against the motion: only then is it one of the set (a deadband, a limit
/// and friction cannot push).
pub fn against(entry: &mut PhysicsEntry) {
    if entry.effect == "current" || entry.effect == "constant_force" {
        for (_, value) in &mut entry.parameters {
            if let ParameterValue::Number(v) = value {
                *v = -v.abs();
            }
        }
    }
}
