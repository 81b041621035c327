//! Survey of a folder: logs with their identity, and files that are none, each with the reason.

use crate::store::{Key, Store, StoreError};
use hydroline_log::{LogReader, MetadataMap};
use hydroline_numerics::parallel;
use hydroline_rigs::Rig;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// From this salinity on water is sea water and not fresh \[g/kg\]: brackish water of a tank stays below.
const SALT_FROM_GPKG: f64 = 10.0;

/// A file named like a log.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Found {
    /// Path from the campaign's folder.
    pub name: String,
    /// Path to open.
    #[serde(skip)]
    pub path: PathBuf,
    /// Hash of its content.
    pub hash: String,
    /// Identity, or why it cannot be used.
    pub is: Result<Identity, String>,
}

/// A rig as a file; logs of one rig share it.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(from = "String", into = "String")]
pub struct RigToml(Arc<str>);

impl From<String> for RigToml {
    fn from(text: String) -> Self {
        Self(text.into())
    }
}

impl From<RigToml> for String {
    fn from(rig: RigToml) -> Self {
        rig.0.as_ref().to_owned()
    }
}

impl std::ops::Deref for RigToml {
    type Target = str;

    fn deref(&self) -> &str {
        &self.0
    }
}

/// Identity of a log: its rig, calibration, water, time, plan and note.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Identity {
    /// The rig's name.
    pub vehicle: String,
    /// The rig as a file, without what differs from run to run (seed of the simulated camera, start pose).
    /// Shared by all logs of it.
    pub rig_toml: RigToml,
    /// Hash of the calibration in the log; empty = none.
    pub calibration: String,
    /// Kind of water or air, as the session says; empty = it does not.
    pub water: String,
    /// First message, UNIX \[ns\].
    pub start_ns: u64,
    /// Plan's name; empty = none.
    pub plan: String,
    /// The person's note; empty = none.
    pub note: String,
}

/// Looks at each file; `rig` stands for logs that carry none.
///
/// # Errors
/// [`StoreError`]: an identity cannot be kept.
pub fn survey(
    folder: &Path,
    paths: &[PathBuf],
    rig: Option<&Rig>,
    store: &mut Store,
) -> Result<Vec<Found>, StoreError> {
    // What cannot be read is a row, not the end: it goes by its name.
    let mut hashed: Vec<(&PathBuf, Result<String, String>)> = Vec::with_capacity(paths.len());
    for path in paths {
        hashed.push((path, store.hash(path).map_err(|e| e.to_string())));
    }
    let store = &*store;
    let rigs: Mutex<BTreeSet<RigToml>> = Mutex::default();
    let shared = |text: RigToml| -> RigToml {
        let mut rigs = rigs.lock().unwrap_or_else(PoisonError::into_inner);
        match rigs.get(&text) {
            Some(same) => same.clone(),
            None => {
                rigs.insert(text.clone());
                text
            }
        }
    };
    parallel::try_map_slice(&hashed, |(path, hash)| {
        let name = path.strip_prefix(folder).unwrap_or(path);
        let found = |hash: &str, is| Found {
            name: name.display().to_string(),
            path: (*path).clone(),
            hash: hash.to_owned(),
            is,
        };
        let hash = match hash {
            Ok(hash) => hash,
            Err(why) => return Ok(found("", Err(why.clone()))),
        };
        let mut key = Key::of("identity/1").with(hash);
        if let Some(rig) = rig {
            key = key.with(&rig.to_toml());
        }
        let key = key.name();
        let known = store.get::<Result<Identity, String>>(&key);
        let is = match known {
            Some(is) => is,
            None => {
                let is = identity(path, rig);
                store.put(&key, &is)?;
                is
            }
        };
        let is = is.map(|is| Identity {
            rig_toml: shared(is.rig_toml),
            ..is
        });
        Ok(found(hash, is))
    })
}

fn identity(path: &Path, given: Option<&Rig>) -> Result<Identity, String> {
    let mut log = LogReader::open(path).map_err(|e| e.to_string())?;
    let own = log
        .rig_toml()
        .map(|text| Rig::from_toml(text, "the log's rig", None));
    let rig = match (own, given) {
        (Some(Ok(rig)), _) => rig,
        (Some(Err(e)), None) => return Err(e.to_string()),
        (_, Some(rig)) => rig.clone(),
        (None, None) => {
            return Err("no rig in it: give the one it was made with (--rig)".to_owned());
        }
    };
    let first = log
        .next()
        .ok_or("no message in it")?
        .map_err(|e| e.to_string())?;
    let session = log.metadata().get("session").cloned().unwrap_or_default();
    let said = |key: &str| session.get(key).cloned().unwrap_or_default();
    let calibration = log
        .metadata()
        .get("calibration")
        .map_or(String::new(), |map| {
            let parts = map.iter().flat_map(|(k, v)| [k.as_str(), v.as_str()]);
            parts.fold(Key::of("calibration"), Key::with).name()
        });
    Ok(Identity {
        vehicle: rig.name.clone(),
        rig_toml: comparable(rig).to_toml().into(),
        calibration,
        water: water(&session),
        start_ns: first.log_ns,
        plan: said("plan.name"),
        note: said("note"),
    })
}

/// The water's kind: its temperature differs from day to day and is no other water.
fn water(session: &MetadataMap) -> String {
    if let Some(medium) = session.get("medium") {
        return medium.clone();
    }
    let number = |key: &str| session.get(key).and_then(|v| v.parse::<f64>().ok());
    match (number("water.salinity_gpkg"), number("water.temperature_c")) {
        (Some(salinity), _) if salinity >= SALT_FROM_GPKG => "salt".to_owned(),
        (None, None) => String::new(),
        _ => "fresh".to_owned(),
    }
}

/// The rig without what differs from run to run of one vehicle.
fn comparable(mut rig: Rig) -> Rig {
    rig.camera.seed = 0;
    rig
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A log that could not be read ended the campaign of all others.
    #[test]
    fn a_file_that_cannot_be_read_is_a_row_with_the_reason() {
        let dir = tempfile::tempdir().unwrap();
        let gone = dir.path().join("gone.mcap");
        let none = dir.path().join("none.mcap");
        std::fs::write(&none, b"no log").unwrap();
        let mut store = Store::open(&dir.path().join("store")).unwrap();
        let found = survey(dir.path(), &[gone, none], None, &mut store).unwrap();
        assert_eq!(found.len(), 2);
        assert!(found.iter().all(|f| f.is.is_err()), "{found:?}");
        assert_eq!(found[0].name, "gone.mcap");
    }
}
