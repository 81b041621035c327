//! Variables of an FMU: what its description names and its library answers to.

use hydroline_rigs::{Dof, Rig};

/// Role of a variable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Causality {
    /// Thrust of a thruster, held over a step.
    Input,
    /// Pose or rate.
    Output,
    /// Number of the vehicle, fixed once the run has begun.
    Parameter,
}

/// A variable.
#[derive(Debug, Clone, PartialEq)]
pub struct Variable {
    /// Number by which it is asked for; 0 is the time.
    pub reference: u32,
    /// Name.
    pub name: String,
    /// Unit, SI.
    pub unit: &'static str,
    /// Role.
    pub causality: Causality,
    /// Value before it is set; of an output that of the start.
    pub start: f64,
}

/// Names of pose and rates with their units.
const MOTION: [(&str, &str); 12] = [
    ("x", "m"),
    ("y", "m"),
    ("z", "m"),
    ("phi", "rad"),
    ("theta", "rad"),
    ("psi", "rad"),
    ("u", "m/s"),
    ("v", "m/s"),
    ("w", "m/s"),
    ("p", "rad/s"),
    ("q", "rad/s"),
    ("r", "rad/s"),
];
/// Units of added mass, linear and quadratic damping along an axis, and about one.
const UNITS: [[&str; 3]; 2] = [["kg", "kg/s", "kg/m"], ["kg.m2", "kg.m2/s", "kg.m2"]];
/// Numbers of a vehicle beside its coefficients.
const VEHICLE: [(&str, &str); 5] = [
    ("mass_kg", "kg"),
    ("ix_kgm2", "kg.m2"),
    ("iy_kgm2", "kg.m2"),
    ("iz_kgm2", "kg.m2"),
    ("r_bz_m", "m"),
];

/// All variables of a rig's FMU but the time, in the order of their references, which begin at 1.
pub fn variables(rig: &Rig) -> Vec<Variable> {
    let mut all = Vec::new();
    let mut add = |name: String, unit, causality, start| {
        let reference = all.len() as u32 + 1;
        all.push(Variable {
            reference,
            name,
            unit,
            causality,
            start,
        });
    };
    for thruster in &rig.thrusters.thrusters {
        add(
            format!("thrust_{}", thruster.name),
            "N",
            Causality::Input,
            0.0,
        );
    }
    for (k, (name, unit)) in MOTION.into_iter().enumerate() {
        let start = rig.tank.start_pose.get(k).copied().unwrap_or(0.0);
        add(name.to_owned(), unit, Causality::Output, start);
    }
    for (k, (name, unit)) in MOTION.into_iter().take(6).enumerate() {
        let start = rig.tank.start_pose[k];
        add(format!("start_{name}"), unit, Causality::Parameter, start);
    }
    for (k, (name, unit)) in VEHICLE.into_iter().enumerate() {
        add(name.to_owned(), unit, Causality::Parameter, vehicle(rig, k));
    }
    for dof in Dof::ALL {
        let of = rig.vehicle.coefficients[dof.index()];
        let values = [of.added, of.linear, of.quadratic];
        for (k, name) in dof.coefficient_names().into_iter().enumerate() {
            let unit = UNITS[usize::from(dof.index() > 2)][k];
            add(name.to_owned(), unit, Causality::Parameter, values[k]);
        }
    }
    all
}

fn vehicle(rig: &Rig, place: usize) -> f64 {
    match place {
        0 => rig.vehicle.mass_kg,
        1..=3 => rig.vehicle.inertia_kgm2[place - 1],
        _ => rig.vehicle.r_bz_m,
    }
}

/// Puts a parameter by its name; `false` = there is none of this name.
pub(crate) fn put(rig: &mut Rig, name: &str, value: f64) -> bool {
    if let Some(k) = VEHICLE.iter().position(|(n, _)| *n == name) {
        match k {
            0 => rig.vehicle.mass_kg = value,
            1..=3 => rig.vehicle.inertia_kgm2[k - 1] = value,
            _ => rig.vehicle.r_bz_m = value,
        }
        return true;
    }
    let start = name.strip_prefix("start_");
    let start = start.and_then(|n| MOTION.iter().take(6).position(|(m, _)| *m == n));
    if let Some(k) = start {
        rig.tank.start_pose[k] = value;
        return true;
    }
    for dof in Dof::ALL {
        let of = &mut rig.vehicle.coefficients[dof.index()];
        match dof.coefficient_names().iter().position(|n| *n == name) {
            Some(0) => of.added = value,
            Some(1) => of.linear = value,
            Some(_) => of.quadratic = value,
            None => continue,
        }
        return true;
    }
    false
}

/// Token by which library and description know that they belong together: of the rig's text in the resources.
pub fn token(rig_toml: &str) -> String {
    format!("hydroline-{:08x}", crc32fast::hash(rig_toml.as_bytes()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_parameter_goes_to_its_place_and_comes_back() {
        let mut rig = Rig::builtin("lshpi").unwrap();
        let all = variables(&rig);
        let parameters: Vec<&Variable> = all
            .iter()
            .filter(|v| v.causality == Causality::Parameter)
            .collect();
        assert_eq!(parameters.len(), 6 + 5 + 18);
        for (k, variable) in parameters.iter().enumerate() {
            assert!(
                put(&mut rig, &variable.name, 100.0 + k as f64),
                "{}",
                variable.name
            );
        }
        let now = variables(&rig);
        let now: Vec<f64> = now
            .iter()
            .filter(|v| v.causality == Causality::Parameter)
            .map(|v| v.start)
            .collect();
        let expected: Vec<f64> = (0..now.len()).map(|k| 100.0 + k as f64).collect();
        assert_eq!(now, expected);
        assert!(!put(&mut rig, "none", 1.0));
        let references: Vec<u32> = all.iter().map(|v| v.reference).collect();
        assert_eq!(references, (1..=all.len() as u32).collect::<Vec<_>>());
    }
}
