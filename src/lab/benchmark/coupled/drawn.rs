//! The effects that a coupled case may hold, each at a practical size.

use hydroline_rigs::{Dof, ParameterValue, PhysicsEntry};
use rand::{RngExt, rngs::StdRng};

use super::make::LARGEST;
use crate::benchmark::error::ProveError;
use crate::benchmark::magnitudes::{between, sign};

/// Effects of the cases, drawn as often as each other: by hand, as [`crate::benchmark::magnitudes`]. Held are those that matter:
/// `cubic_damping` seldom, of which the vehicle's own coefficients leave a tolerance only near its largest.
pub(super) const KINDS: [&str; 15] = [
    "thruster_lag",
    "thruster_deadband",
    "thruster_saturation",
    "thrust_asymmetry",
    "coulomb_friction",
    "constant_force",
    "cubic_damping",
    "astern_drag",
    "fluid_memory",
    "current",
    "command_latency",
    "camera_latency",
    "thrust_line_offset",
    "lift_damping",
    "cross_flow_coupling",
];

/// Numbers by name, words by name.
type Sized = (Vec<(&'static str, f64)>, Vec<(&'static str, &'static str)>);

/// An effect of practical size in a DOF, in a cross term, or in a DOF that nobody commands.
///
/// # Errors
/// [`ProveError::Unsized`] where [`KINDS`] names an effect that has no size here.
pub(super) fn drawn(rng: &mut StdRng) -> Result<PhysicsEntry, ProveError> {
    let driven = [Dof::Surge, Dof::Sway, Dof::Yaw][rng.random_range(0..3)];
    let share = between(rng, 0.4, 1.0);
    let effect = KINDS[rng.random_range(0..KINDS.len())];
    entry(effect, driven, share, rng)
}

/// An effect at a share of its practical size, in this DOF if it may act in any.
///
/// # Errors
/// [`ProveError::Unsized`].
pub(super) fn entry(
    effect: &str,
    driven: Dof,
    share: f64,
    rng: &mut StdRng,
) -> Result<PhysicsEntry, ProveError> {
    let Some((numbers, words)) = sized(effect, driven, share, rng) else {
        return Err(ProveError::Unsized {
            effect: effect.to_owned(),
            file: "coupled/drawn.rs",
        });
    };
    let numbers = numbers
        .into_iter()
        .map(|(n, v)| (n.to_owned(), ParameterValue::Number(v)));
    let words = words
        .into_iter()
        .map(|(n, v)| (n.to_owned(), ParameterValue::Word(v.to_owned())));
    Ok(PhysicsEntry {
        effect: effect.to_owned(),
        parameters: numbers.chain(words).collect(),
    })
}

/// Its numbers and words; `None` for an effect that has no size here.
fn sized(effect: &str, driven: Dof, share: f64, rng: &mut StdRng) -> Option<Sized> {
    let top = LARGEST[driven.index()];
    // Resistance to a rate: what it is per unit of that rate's own power is as large in sway as in surge.
    let damping = if driven == Dof::Yaw { 0.05 } else { 1.0 };
    let dof = vec![("dof", driven.name())];
    let one = |name: &'static str, value: f64| vec![(name, value)];
    Some(match effect {
        "thruster_lag" => (one("lag_s", 0.5 * share), dof),
        "thruster_deadband" => (one("width_n", 0.12 * top * share), dof),
        "thruster_saturation" => (one("limit_n", top * (1.0 - 0.5 * share)), dof),
        "thrust_asymmetry" => (one("reverse_gain", 1.0 - 0.3 * share), dof),
        "coulomb_friction" => (one("f_n", 0.06 * top * share), dof),
        "constant_force" => (one("bias_n", sign(rng) * 0.06 * top * share), dof),
        "cubic_damping" => (one("d3", 2000.0 * damping * share), dof),
        "astern_drag" => (one("gain", 1.0 + 0.8 * share), dof),
        "fluid_memory" => (
            vec![
                ("gain_nspm", 200.0 * damping * share),
                ("tau_s", between(rng, 0.3, 2.0)),
            ],
            dof,
        ),
        "current" => (
            vec![
                ("vx_mps", sign(rng) * 0.02 * share),
                ("vy_mps", sign(rng) * 0.02 * between(rng, 0.1, 1.0)),
            ],
            vec![],
        ),
        "command_latency" => (one("delay_s", 0.3 * share), vec![]),
        "camera_latency" => (one("delay_s", 0.15 * share), vec![]),
        "thrust_line_offset" => (
            one("lever_m", sign(rng) * 0.04 * share),
            vec![("axis", "pitch")],
        ),
        "lift_damping" => {
            let (of, size) = [("sway", 60.0), ("yaw", 10.0)][rng.random_range(0..2)];
            (one("c", size * share), vec![("dof", of)])
        }
        "cross_flow_coupling" => {
            let (of, a, b, size) = [
                ("yaw", "u", "r", 8.0),
                ("sway", "u", "r", 20.0),
                ("surge", "r", "v", 40.0),
                ("yaw", "u", "v", 12.0),
            ][rng.random_range(0..4)];
            (
                one("c", -size * share),
                vec![("dof", of), ("a", a), ("b", b)],
            )
        }
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_sim::EffectStack;
    use rand::SeedableRng;

    #[test]
    fn every_kind_is_accepted_by_the_simulator() {
        let mut rng = StdRng::seed_from_u64(7);
        let mut missing = KINDS.to_vec();
        for _ in 0..600 {
            let made = drawn(&mut rng).unwrap();
            let built = EffectStack::build(std::slice::from_ref(&made));
            assert!(built.is_ok(), "{made:?}: {}", built.unwrap_err());
            missing.retain(|kind| *kind != made.effect);
        }
        assert!(missing.is_empty(), "{missing:?}");
    }
}
