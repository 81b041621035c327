//! Is the vehicle of a log the one of the rig? Runs of two vehicles fitted as one give the coefficients of neither.

use std::path::Path;

use super::LoadError;
use hydroline_log::LogReader;
use hydroline_rigs::{Rig, Thruster};

/// Two masses or places are the same when they differ by less than this part: what writing and reading a number in
/// decimal, or a change of units, may do to it.
const SAME: f64 = 1e-6;

fn same(a: f64, b: f64) -> bool {
    (a - b).abs() <= SAME * a.abs().max(b.abs()).max(1.0)
}

fn same_place(a: &Thruster, b: &Thruster) -> bool {
    a.name == b.name
        && a.channel == b.channel
        && (0..3)
            .all(|i| same(a.position_m[i], b.position_m[i]) && same(a.direction[i], b.direction[i]))
}

/// Differences between two vehicles, one item each: name, mass, thrusters (number, names, channels, places, directions).
/// Coefficients and the thrusters' curve are what identification finds, and are not compared.
pub fn differences(log: &Rig, rig: &Rig) -> Vec<String> {
    let mut found = Vec::new();
    if log.name != rig.name {
        found.push(format!("name '{}' for '{}'", log.name, rig.name));
    }
    let (of_log, of_rig) = (log.vehicle.mass_kg, rig.vehicle.mass_kg);
    if !same(of_log, of_rig) {
        found.push(format!("mass_kg {of_log} for {of_rig}"));
    }
    let (of_log, of_rig) = (&log.thrusters.thrusters, &rig.thrusters.thrusters);
    if of_log.len() != of_rig.len() {
        found.push(format!("{} thrusters for {}", of_log.len(), of_rig.len()));
    } else {
        let moved = of_log.iter().zip(of_rig).filter(|(a, b)| !same_place(a, b));
        let moved: Vec<&str> = moved.map(|(a, _)| a.name.as_str()).collect();
        if !moved.is_empty() {
            found.push(format!(
                "another place, direction, name or channel of thruster {}",
                moved.join(", ")
            ));
        }
    }
    found
}

/// Refuses a log whose own rig is another vehicle. A log that carries no rig, or one that this version does not read,
/// is taken at the word of whoever names `rig` for it.
/// Returned is what of the log's metadata is damaged, in words.
///
/// # Errors
/// [`LoadError::OtherVehicle`]; [`LoadError::Log`] when the log cannot be read.
pub fn check_vehicle(path: &Path, rig: &Rig) -> Result<Vec<String>, LoadError> {
    let log = LogReader::open(path)?;
    let damaged = log.seal_findings().into_iter().filter(|f| f.damaged());
    let damaged = damaged
        .map(|f| format!("{}: {f}", path.display()))
        .collect();
    let own = log
        .rig_toml()
        .map(|text| Rig::from_toml(text, "the log's rig", None));
    let Some(Ok(own)) = own else {
        return Ok(damaged);
    };
    let differences = differences(&own, rig);
    if differences.is_empty() {
        return Ok(damaged);
    }
    Err(LoadError::OtherVehicle {
        log: path.display().to_string(),
        differences: differences.join("; "),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_identification_finds_is_no_other_vehicle_and_the_rest_is() {
        let rig = Rig::builtin("lshpi").unwrap();
        let mut fitted = rig.clone();
        fitted.vehicle.coefficients[0].added *= 1.3;
        fitted.vehicle.mass_kg *= 1.0 + 1e-9;
        assert_eq!(differences(&fitted, &rig), [] as [String; 0]);
        type Change = fn(&mut Rig);
        let changes: [(Change, &str); 5] = [
            (|r| r.name = "other".to_owned(), "name 'other'"),
            (|r| r.vehicle.mass_kg *= 1.02, "mass_kg"),
            (|r| drop(r.thrusters.thrusters.pop()), "thrusters for"),
            (
                |r| r.thrusters.thrusters[1].position_m[1] += 0.01,
                "another place",
            ),
            (|r| r.thrusters.thrusters[0].channel += 7, "channel"),
        ];
        for (change, word) in changes {
            let mut other = rig.clone();
            change(&mut other);
            let found = differences(&other, &rig);
            assert!(found.len() == 1 && found[0].contains(word), "{found:?}");
        }
    }
}
