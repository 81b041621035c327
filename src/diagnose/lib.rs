//! What was left out: where simulation and recording differ, which physics explains it, and proof.
//!
//! `source` (a log, and with `faults` what is wrong with its data) -> `body` (the models of `hydroline_inference`, weighed: what matters, how
//! sure, where, what else it may be, which run would tell) -> `verdict` -> `report`. `profiles` asks the same of frames.
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

pub use conclude::{DiagnoseError, Diagnosis};
pub use source::{Part, Source, read};
pub use verdict::Verdict;

use hydroline_calib::Calibration;
use hydroline_rigs::{Dof, Rig};

/// What is known beside logs and rig.
#[derive(Debug, Clone, Copy, Default)]
pub struct Beside<'a> {
    /// DOFs whose measured motion is an input.
    pub given: &'a [Dof],
    /// By which the next run will be seen; `None` = the rig's ideal camera.
    pub calibration: Option<&'a Calibration>,
}

/// Diagnoses logs against a rig; `held` are predicted only.
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
    body::diagnose(sources, held, rig, beside, progress)
}
