//! Numbers of a rig that are allowed but not plausible together: a mass in grams, an added mass of many hulls, a tank that is too small.

use crate::{AxisCoefficients, Dof, Rig, ThrustCurve};

/// Radius of gyration over the farthest thruster's distance from the CG. Hulls with thrusters at their ends have 0.1 (roll of a
/// torpedo) to 1; a mass in grams beside an inertia in kg m² makes it 30 times less.
const GYRATION: [f64; 2] = [0.03, 5.0];
/// Added mass over mass of a compact hull: a sphere has 0.5, a box 0.5 to 2, an open frame up to 3.
const ADDED_OVER_MASS: f64 = 3.0;
/// Added inertia over inertia: the same hulls turned, where appendages count by their distance squared.
const ADDED_OVER_INERTIA: f64 = 10.0;
/// Speed at full thrust: no vehicle that hovers or is towed by its own thrusters in a tank is faster.
const FASTEST_MPS: f64 = 8.0;
/// Rate of turn at full thrust: two turns per second.
const FASTEST_RADPS: f64 = 4.0 * std::f64::consts::PI;
/// Share of the vertical thrust that net weight may take.
const WEIGHT_OVER_THRUST: f64 = 0.5;
/// Room about the CG, over the farthest thruster's distance, that turning without touching a wall takes.
const ROOM: f64 = 1.0;

/// Largest load along or about an axis that the thrusters make if all push there \[N or N m\].
fn largest_load(rig: &Rig, dof: Dof) -> f64 {
    let set = &rig.thrusters;
    let each = |curve: &ThrustCurve| {
        let (astern, ahead) = curve.thrust_range_n(set.min_us, set.max_us);
        ahead.max(-astern)
    };
    let lever = |position: [f64; 3], direction: [f64; 3]| {
        let ([x, y, z], [a, b, c]) = (position, direction);
        [a, b, c, y * c - z * b, z * a - x * c, x * b - y * a][dof.index()].abs()
    };
    set.thrusters
        .iter()
        .map(|t| each(&t.curve) * lever(t.position_m, t.direction))
        .sum()
}

/// Speed at which drag takes a load; `None` without drag.
fn terminal(load: f64, axis: &AxisCoefficients) -> Option<f64> {
    let (linear, quadratic) = (-axis.linear, -axis.quadratic);
    if quadratic > 0.0 {
        let root = (linear * linear + 4.0 * quadratic * load).sqrt();
        Some((root - linear) / (2.0 * quadratic))
    } else {
        (linear > 0.0).then(|| load / linear)
    }
}

/// A number with three digits.
fn three(value: f64) -> String {
    let digits = if value == 0.0 {
        0
    } else {
        2 - value.abs().log10().floor() as i32
    };
    format!("{value:.*}", digits.max(0) as usize)
}

/// Remarks on a rig, one sentence each with what to check; empty = nothing looks wrong.
pub fn remarks(rig: &Rig) -> Vec<String> {
    let mut said = Vec::new();
    let v = &rig.vehicle;
    let thrusters = &rig.thrusters.thrusters;
    let reach_m = thrusters
        .iter()
        .map(|t| t.position_m.iter().map(|x| x * x).sum::<f64>().sqrt())
        .fold(0.0, f64::max);
    for (axis, inertia) in ["I_x", "I_y", "I_z"].into_iter().zip(v.inertia_kgm2) {
        let gyration_m = (inertia / v.mass_kg).sqrt();
        let [least, most] = GYRATION.map(|g| g * reach_m);
        if reach_m > 0.0 && !(least..=most).contains(&gyration_m) {
            said.push(format!(
                "vehicle.mass_kg = {} and {axis} = {inertia} kg m2 make a radius of gyration of {} m, where thrusters are up to {} m from the CG: check both units (kg, kg m2)",
                v.mass_kg,
                three(gyration_m),
                three(reach_m)
            ));
        }
    }
    for dof in Dof::ALL {
        let axis = &v.coefficients[dof.index()];
        let (own, unit, most) = match dof.index() {
            0..=2 => (v.mass_kg, "kg", ADDED_OVER_MASS),
            turning => (v.inertia_kgm2[turning - 3], "kg m2", ADDED_OVER_INERTIA),
        };
        let ratio = -axis.added / own;
        if ratio > most {
            said.push(format!(
                "{}: added mass of {} {unit} is {} times the vehicle's own {} {unit}; compact hulls have up to {most}: check the unit, and whether the vehicle's own mass is in it",
                dof.name(),
                three(-axis.added),
                three(ratio),
                three(own)
            ));
        }
        let load = largest_load(rig, dof);
        let (limit, unit) = if dof.index() < 3 {
            (FASTEST_MPS, "m/s")
        } else {
            (FASTEST_RADPS, "rad/s")
        };
        match terminal(load, axis) {
            None if load > 0.0 => said.push(format!(
                "{}: no drag at all: with thrust it never stops getting faster",
                dof.name()
            )),
            Some(speed) if speed > limit => said.push(format!(
                "{}: all thrusters together ({} {}) would reach {} {unit}: check the drag and the thrust curve (N, not kgf or grams)",
                dof.name(),
                three(load),
                if dof.index() < 3 { "N" } else { "N m" },
                three(speed)
            )),
            _ => {}
        }
    }
    if v.r_bz_m > 0.0 && v.stiffness[1] == 0.0 && v.stiffness[2] == 0.0 {
        said.push(format!(
            "vehicle.r_bz_m = {}: the centre of buoyancy is below the CG, so the vehicle turns over; z points down, above is negative",
            v.r_bz_m
        ));
    }
    let upright_n = largest_load(rig, Dof::Heave);
    if upright_n > 0.0
        && v.stiffness[0] == 0.0
        && v.net_weight_n.abs() > WEIGHT_OVER_THRUST * upright_n
    {
        said.push(format!(
            "vehicle.net_weight_n = {} N takes more than half of the vertical thrust ({} N): weight minus buoyancy is meant, not the weight",
            v.net_weight_n,
            three(upright_n)
        ));
    }
    for (name, [low, high]) in [("x_m", rig.tank.x_m), ("y_m", rig.tank.y_m)] {
        if high - low < 2.0 * ROOM * reach_m {
            said.push(format!(
                "tank.{name} = [{low}, {high}]: {} m between the walls, where the thrusters alone are {} m apart: check the tank's unit",
                three(high - low),
                three(2.0 * reach_m)
            ));
        }
    }
    said
}

#[cfg(test)]
mod tests {
    use super::*;

    fn changed(change: impl Fn(&mut Rig)) -> Vec<String> {
        let mut rig = Rig::builtin("bluerov2-heavy").unwrap();
        change(&mut rig);
        remarks(&rig)
    }

    #[test]
    fn published_vehicles_are_plausible_and_the_papers_added_masses_are_not() {
        assert_eq!(remarks(&Rig::builtin("bluerov2").unwrap()), [""; 0]);
        assert_eq!(changed(|_| {}), [""; 0]);
        let paper = remarks(&Rig::builtin("lshpi").unwrap());
        // Table 6: 250 kg for a vehicle of 29.777 kg; 320 and 360 kg were chosen to go with it.
        assert!(
            paper[0].starts_with("surge: added mass of 250 kg is 8.40 times"),
            "{paper:?}"
        );
        assert!(paper.iter().all(|s| s.contains("added mass")), "{paper:?}");
    }

    #[test]
    fn each_mistake_of_a_unit_or_a_sign_is_named_by_its_key() {
        let grams = changed(|r| r.vehicle.mass_kg *= 1000.0);
        assert_eq!(grams.len(), 3, "{grams:?}");
        assert!(grams.iter().all(|s| s.contains("vehicle.mass_kg = 13500")));
        let below = changed(|r| r.vehicle.r_bz_m = 0.01);
        assert!(below.len() == 1 && below[0].contains("r_bz_m"), "{below:?}");
        let heavy = changed(|r| r.vehicle.net_weight_n = 132.6);
        assert!(
            heavy.len() == 1 && heavy[0].contains("net_weight_n"),
            "{heavy:?}"
        );
        let none = changed(|r| {
            let surge = &mut r.vehicle.coefficients[0];
            (surge.linear, surge.quadratic) = (0.0, 0.0);
        });
        assert!(none.len() == 1 && none[0].contains("no drag"), "{none:?}");
        let small = changed(|r| r.tank.y_m = [-0.002, 0.002]);
        assert!(
            small.len() == 1 && small[0].contains("tank.y_m"),
            "{small:?}"
        );
        // Curve in grams of force.
        let grams = changed(|r| {
            for t in &mut r.thrusters.thrusters {
                for p in &mut t.curve.points {
                    p.1 *= 101.97;
                }
            }
        });
        assert!(
            grams.iter().any(|s| s.contains("thrust curve")),
            "{grams:?}"
        );
    }

    #[test]
    fn speed_at_full_thrust_is_where_drag_takes_it() {
        let axis = AxisCoefficients {
            added: 0.0,
            linear: -2.0,
            quadratic: -3.0,
        };
        let v = terminal(16.0, &axis).unwrap();
        assert!((2.0 * v + 3.0 * v * v - 16.0).abs() < 1e-12);
        assert_eq!(
            terminal(
                1.0,
                &AxisCoefficients {
                    quadratic: 0.0,
                    ..axis
                }
            ),
            Some(0.5)
        );
    }
}
