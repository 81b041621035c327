//! Logs of an analysis: folders opened up, and the rig that they carry where none is named.

use super::print::errln;
use super::{CliError, inputs, many};
use hydroline_diagnose::Part;
use hydroline_identify::data::differences;
use hydroline_log::LogReader;
use hydroline_rigs::Rig;
use std::path::Path;

/// The logs named, and in a folder's place all logs in it and below it.
///
/// # Errors
/// A folder that cannot be read, holds no log, or of which a window is asked.
pub(super) fn opened(named: &[Part]) -> Result<Vec<Part>, CliError> {
    let mut logs = Vec::new();
    for part in named {
        if !part.path.is_dir() {
            logs.push(part.clone());
            continue;
        }
        if part.window_s.is_some() {
            return Err(CliError::Config(format!(
                "{part}: a window is of one log, and {} is a folder; name the log: LOG@FROM..TO",
                part.path.display()
            )));
        }
        let found = many::below(&part.path, many::LOG)?;
        logs.extend(found.iter().map(Part::from));
    }
    Ok(logs)
}

/// The rig named, else the one that all logs carry, which is said.
///
/// # Errors
/// A rig that cannot be read; logs of which one carries none, or another one.
pub(super) fn rig<'a>(
    named: Option<&str>,
    logs: impl Iterator<Item = &'a Path>,
) -> Result<Rig, CliError> {
    if let Some(named) = named {
        return inputs::rig(named);
    }
    let mut found: Option<(&Path, Rig)> = None;
    for log in logs {
        let own = carried(log)?;
        match &found {
            None => found = Some((log, own)),
            Some((first, rig)) if !is_same(rig, &own) => {
                return Err(CliError::Config(format!(
                    "{} and {} carry different rigs ({}); say which: --rig RIG",
                    first.display(),
                    log.display(),
                    difference(rig, &own)
                )));
            }
            Some(_) => {}
        }
    }
    let Some((_, rig)) = found else {
        return Err(CliError::Config(
            "no rig is named, and no log that carries one; give --rig RIG".to_owned(),
        ));
    };
    errln!(
        "hydroline: rig {}, as the logs carry it (--rig names another)",
        rig.name
    );
    Ok(rig)
}

/// The rig that a log carries.
fn carried(log: &Path) -> Result<Rig, CliError> {
    inputs::readable_file(log, "name a log (.mcap) that can be read")?;
    let reader = LogReader::open(log)?;
    let Some(text) = reader.rig_toml() else {
        return Err(CliError::Config(format!(
            "{}: it carries no rig; give --rig RIG",
            log.display()
        )));
    };
    Rig::from_toml(text, "the log's rig", None).map_err(|e| {
        CliError::Config(format!(
            "{}: the rig that it carries cannot be read ({e}); give --rig RIG",
            log.display()
        ))
    })
}

/// Whether two rigs are one for an analysis of motion: camera, calibration and settings of the log do not count.
fn is_same(a: &Rig, b: &Rig) -> bool {
    a.name == b.name
        && a.vehicle == b.vehicle
        && a.thrusters == b.thrusters
        && a.physics == b.physics
        && a.bollard == b.bollard
        && a.identified == b.identified
        && a.tolerance == b.tolerance
        && a.tank == b.tank
}

/// Difference of two rigs, in words.
fn difference(a: &Rig, b: &Rig) -> String {
    let found = differences(a, b);
    if !found.is_empty() {
        return found.join("; ");
    }
    let parts = [
        ("[vehicle]", a.vehicle != b.vehicle),
        ("thrusters", a.thrusters != b.thrusters),
        ("[[physics]]", a.physics != b.physics),
        ("[bollard]", a.bollard != b.bollard),
        ("[identified]", a.identified != b.identified),
        ("[tolerance]", a.tolerance != b.tolerance),
        ("[tank]", a.tank != b.tank),
    ];
    let parts: Vec<&str> = parts.into_iter().filter(|p| p.1).map(|p| p.0).collect();
    format!("{} differ", parts.join(", "))
}
