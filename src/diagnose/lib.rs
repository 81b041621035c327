//! Missing physics: where simulation and recording differ, which physics explains it, and proof.
//!
//! `source` (a log, and with `faults` what is wrong with its data) -> `body` (the models of `hydroline_inference`, weighed: what matters, how
//! sure, where, what else it may be, which run would tell) -> `verdict` -> `report`. `profiles` asks the same of frames, and
//! [`diagnose`] joins both: every command that gives a verdict calls it.
//!
//! Nothing here knows a single effect: laws, ranges and stages come from `sim`'s registry.
//!
//! ```
//! use hydroline_daemon::simulate::{Options, simulate};
//! use hydroline_diagnose::{diagnose, read, verdict::Word};
//! use hydroline_rigs::{Plan, Rig};
//!
//! // A vehicle whose thrusters lag, and a rig that does not know.
//! let rig = Rig::builtin("lshpi")?;
//! let lag = "[[physics]]\neffect = \"thruster_lag\"\nlag_s = 0.25\n";
//! let water = Rig::from_toml(&format!("{}\n{lag}", rig.effective_toml), "water.toml", None)?;
//! let folder = tempfile::tempdir()?;
//! let log = folder.path().join("run.mcap");
//! let options = Options { motion_only: true, ..Options::default() };
//! simulate(&water, &Plan::load_or_builtin("two-tone")?, &log, &options, &mut |_, _| ())?;
//!
//! let verdict = diagnose(&[read(&log, &rig)?], &[], &rig, &|_| ())?.verdict;
//! assert_eq!(verdict.verdict, Word::Named);
//! assert_eq!(verdict.effects[0].effect, "thruster_lag");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod body;
mod conclude;
pub mod faults;
mod joined;
pub mod profiles;
pub mod report;
mod single_run_split;
mod source;
pub mod until;
pub mod verdict;

#[cfg(test)]
#[path = "../../tests/support/lshpi_rig.rs"]
mod fixture;

pub use conclude::{DiagnoseError, Diagnosis};
pub use source::{Part, Source, read};
pub use verdict::Verdict;

use std::collections::BTreeSet;
use std::path::PathBuf;

use hydroline_calib::Calibration;
use hydroline_rigs::{Dof, Rig};
use profiles::{ImageError, level};
use verdict::Word;

/// Knowledge beside logs and rig.
#[derive(Debug, Clone, Copy, Default)]
pub struct Beside<'a> {
    /// DOFs whose measured motion is an input.
    pub given: &'a [Dof],
    /// By which the next run will be seen; `None` = the rig's ideal camera.
    pub calibration: Option<&'a Calibration>,
}

/// Diagnoses logs against a rig by their motion and by their frames; `held` are predicted only.
///
/// # Errors
/// [`DiagnoseError`].
pub fn diagnose(
    sources: &[Source],
    held: &[Source],
    rig: &Rig,
    progress: &(dyn Fn(&str) + Sync),
) -> Result<Diagnosis, DiagnoseError> {
    diagnose_beside(sources, held, rig, &Beside::default(), progress)
}

/// The same with what is known beside them.
///
/// # Errors
/// [`DiagnoseError`].
pub fn diagnose_beside(
    sources: &[Source],
    held: &[Source],
    rig: &Rig,
    beside: &Beside<'_>,
    progress: &(dyn Fn(&str) + Sync),
) -> Result<Diagnosis, DiagnoseError> {
    let moving = |all: &[Source]| -> Vec<Source> {
        let with = all.iter().filter(|s| s.has_motion());
        with.cloned().collect()
    };
    let runs = moving(sources);
    let mut found = match runs.is_empty() {
        true => None,
        false => Some(body::diagnose(&runs, &moving(held), rig, beside, progress)?),
    };
    if let Some(fault) = found.take_if(|f| f.verdict.verdict == Word::DataFault) {
        return Ok(fault);
    }
    let logs: BTreeSet<&PathBuf> = sources.iter().filter_map(|s| s.frames.as_ref()).collect();
    let images = level(logs, rig, progress);
    match (found, images) {
        (Some(found), Ok(None)) => Ok(found),
        (Some(found), Ok(Some(images))) => Ok(images.join(found)),
        // The motion has its verdict whatever the frames are.
        (Some(mut found), Err(error @ (ImageError::Few { .. } | ImageError::NoPose))) => {
            found.verdict.notes.push(error.to_string());
            Ok(found)
        }
        (_, Err(error)) => Err(error.into()),
        (None, Ok(Some(images))) => Ok(images.alone(rig)),
        (None, Ok(None)) => Err(DiagnoseError::NothingMoves(sources.len())),
    }
}
