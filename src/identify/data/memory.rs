//! How long a vehicle remembers its motion.

use hydroline_rigs::{Dof, Vehicle};

use crate::parameter::Coefficient;

/// Time constants after which less than a hundredth of a velocity is left.
const TIME_CONSTANTS: f64 = 5.0;
/// Memory is no shorter than this \[s\]: frames and poses are lost for seconds, and what a vehicle does meanwhile is known.
const SHORTEST_S: f64 = 30.0;
/// Nor longer \[s\]: what it costs to integrate over a gap is bounded, whatever a rig says of damping.
const LONGEST_S: f64 = 120.0;

/// Time after which a vehicle's velocities no longer depend on what they were \[s\]: five times the longest of its time
/// constants, mass with added mass over linear damping, within 30 .. 120 s.
///
/// Quadratic damping shortens it; that the rig's coefficients may be far off is what the bounds are for.
pub fn memory_s(vehicle: &Vehicle) -> f64 {
    let of = |dof: Dof| {
        let [added, linear, _] = Coefficient::of(dof).map(|c| c.of_vehicle(vehicle));
        let rigid = match dof.index() {
            0..3 => vehicle.mass_kg,
            i => vehicle.inertia_kgm2[i - 3],
        };
        (rigid - added) / -linear
    };
    let constants = Dof::ALL.map(of).into_iter().filter(|s| *s > 0.0);
    let longest = constants.fold(0.0, f64::max);
    (TIME_CONSTANTS * longest).clamp(SHORTEST_S, LONGEST_S)
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_rigs::Rig;

    #[test]
    fn the_memory_is_that_of_the_slowest_motion_within_its_bounds() {
        let mut vehicle = Rig::builtin("lshpi").unwrap().vehicle;
        let own_s = memory_s(&vehicle);
        assert!((60.0..90.0).contains(&own_s), "{own_s}");
        let [_, linear, _] = Coefficient::of(Dof::Surge);
        linear.put(&mut vehicle, -1e-9);
        assert_eq!(memory_s(&vehicle), LONGEST_S);
        for dof in Dof::ALL {
            let [_, linear, _] = Coefficient::of(dof);
            linear.put(&mut vehicle, 0.0);
        }
        assert_eq!(memory_s(&vehicle), SHORTEST_S);
    }
}
