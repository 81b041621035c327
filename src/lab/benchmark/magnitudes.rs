//! Practical sizes: what a share of an effect's practical size is in its parameters.
//!
//! Only the motion-level effects that act in surge and leave something in a position log, by hand: an effect that is new to
//! the library is in no case until it stands in [`EFFECTS`] and in [`entry`]. Sizes as in theory/physics.md. 1 = the largest that a tank run may show, 0 = nothing.

use hydroline_rigs::{ParameterValue, PhysicsEntry};
use rand::{RngExt, rngs::StdRng};

use crate::benchmark::error::ProveError;

/// Effects of the cases.
pub const EFFECTS: [&str; 18] = [
    "camera_latency",
    "clock_drift",
    "command_latency",
    "thruster_deadband",
    "thruster_saturation",
    "thrust_asymmetry",
    "battery_sag",
    "thruster_lag",
    "advance_loss",
    "current",
    "seiche",
    "constant_force",
    "tether_spring",
    "cubic_damping",
    "astern_drag",
    "coulomb_friction",
    "fluid_memory",
    "wall_added_mass",
];

/// A number drawn evenly from a range.
pub(super) fn between(rng: &mut StdRng, low: f64, high: f64) -> f64 {
    low + (high - low) * rng.random::<f64>()
}

/// 1 or -1, either as often.
pub(super) fn sign(rng: &mut StdRng) -> f64 {
    if rng.random::<bool>() { 1.0 } else { -1.0 }
}

/// An effect at a share of its practical size; `top_n` = largest command \[N\].
///
/// # Errors
/// [`ProveError::Unsized`] where the effect is none of [`EFFECTS`].
pub fn entry(
    id: &str,
    share: f64,
    top_n: f64,
    rng: &mut StdRng,
) -> Result<PhysicsEntry, ProveError> {
    let mut between = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
    let parameters: Vec<(&str, f64)> = match id {
        "camera_latency" => vec![("delay_s", 0.15 * share)],
        "clock_drift" => vec![("drift_ppm", 2000.0 * share * either(between(-1.0, 1.0)))],
        "command_latency" => vec![("delay_s", 0.3 * share)],
        "thruster_deadband" => vec![("width_n", share)],
        // A limit is small when it only just cuts the largest command.
        "thruster_saturation" => vec![("limit_n", top_n * (1.0 - 0.5 * share))],
        "thrust_asymmetry" => vec![("reverse_gain", 1.0 - 0.3 * share)],
        "battery_sag" => vec![("sag", 0.1 * share)],
        "thruster_lag" => vec![("lag_s", 0.5 * share)],
        "advance_loss" => vec![("loss_spm", 0.8 * share)],
        "current" => vec![("vx_mps", 0.02 * share * either(between(-1.0, 1.0)))],
        "seiche" => vec![
            ("amp_mps", 0.01 * share),
            ("period_s", 2.0 * 10f64.powf(between(0.0, 1.0))),
            (
                "phase_rad",
                between(-std::f64::consts::PI, std::f64::consts::PI),
            ),
        ],
        "constant_force" => vec![("bias_n", 0.5 * share * either(between(-1.0, 1.0)))],
        "tether_spring" => vec![
            ("stiffness_npm", 2.0 * share),
            ("slack_m", between(-0.1, 0.4)),
        ],
        "cubic_damping" => vec![("d3", 2000.0 * share)],
        "astern_drag" => vec![("gain", 1.0 + 0.8 * share)],
        "coulomb_friction" => vec![("f_n", 0.5 * share)],
        "fluid_memory" => vec![("gain_nspm", 200.0 * share), ("tau_s", between(0.3, 2.0))],
        "wall_added_mass" => vec![
            ("gain", 0.2 * share),
            ("wall_x_m", between(-0.8, 1.5)),
            ("length_m", between(0.2, 0.8)),
        ],
        _ => {
            return Err(ProveError::Unsized {
                effect: id.to_owned(),
                file: "magnitudes.rs",
            });
        }
    };
    Ok(PhysicsEntry {
        effect: id.to_owned(),
        parameters: parameters
            .into_iter()
            .map(|(n, v)| (n.to_owned(), ParameterValue::Number(v)))
            .collect(),
    })
}

fn either(v: f64) -> f64 {
    if v < 0.0 { -1.0 } else { 1.0 }
}

/// Numbers of an entry by name.
pub fn numbers(entry: &PhysicsEntry) -> Vec<(String, f64)> {
    entry
        .parameters
        .iter()
        .filter_map(|(n, v)| match v {
            ParameterValue::Number(v) => Some((n.clone(), *v)),
            ParameterValue::Word(_) => None,
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_sim::EffectStack;
    use rand::SeedableRng;

    #[test]
    fn every_effect_of_the_cases_is_accepted_by_the_simulator_at_any_share() {
        let mut rng = StdRng::seed_from_u64(7);
        for id in EFFECTS {
            for share in [0.03, 0.08, 0.4, 1.0] {
                let made = entry(id, share, 16.0, &mut rng).unwrap();
                assert!(EffectStack::build(&[made]).is_ok(), "{id} {share}");
            }
        }
    }

    /// A name without an arm was drawn with the keys of the last one's.
    #[test]
    fn an_effect_without_a_size_is_an_error() {
        let mut rng = StdRng::seed_from_u64(7);
        for info in hydroline_sim::effect::ALL {
            let known = entry(info.id, 0.5, 16.0, &mut rng).is_ok();
            assert_eq!(known, EFFECTS.contains(&info.id), "{}", info.id);
        }
        for id in crate::benchmark::external_law::NEAR
            .iter()
            .chain(&crate::benchmark::modulated::MODULATED)
            .chain(&crate::benchmark::paper::SET)
        {
            assert!(EFFECTS.contains(id), "{id}");
        }
    }
}
