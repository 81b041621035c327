//! A log, read once: its run, and what shows faults of the data.

use std::path::Path;

use hydroline_rigs::Rig;

use super::faults::{Records, faults};
use super::verdict::DataFault;
use crate::identify::data::{LoadError, Run, load_messages};
use crate::log::messages::{timestamp, unix_ns};
use crate::log::{LogReader, Record};

/// A log taken apart.
#[derive(Debug, Clone)]
pub struct Source {
    /// Commands and motion.
    pub run: Run,
    /// What is wrong with it.
    pub faults: Vec<DataFault>,
}

/// Reads a log.
///
/// # Errors
/// [`LoadError`].
pub fn read(path: &Path, rig: &Rig) -> Result<Source, LoadError> {
    let name = path.file_stem().map_or_else(
        || path.display().to_string(),
        |s| s.to_string_lossy().into_owned(),
    );
    let (mut commands, mut motion, mut frames) = (Vec::new(), Vec::new(), 0);
    let mut records = Records::default();
    for message in LogReader::open(path)? {
        match message?.record {
            Record::Command(command) => commands.push(command),
            Record::Motion(sample) => {
                records.motion(
                    unix_ns(sample.timestamp.as_ref().unwrap_or(&timestamp(0))),
                    &sample,
                );
                motion.push(sample);
            }
            Record::Frame(_) => frames += 1,
            Record::Clock(pair) => {
                records
                    .clocks_ns
                    .push((pair.monotonic_ns, pair.realtime_ns));
                if let Some(c) = &pair.controller {
                    records.drift_ppm.push((c.drift_ppm, c.drift_sd_ppm));
                }
            }
            _ => {}
        }
    }
    if motion.is_empty() {
        return Err(LoadError::NoMotion {
            log: path.display().to_string(),
            frames,
        });
    }
    let run = load_messages(&name, &commands, &motion, rig)?;
    let faults = faults(&run, &records, rig);
    Ok(Source { run, faults })
}
