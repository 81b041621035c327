//! What was left out: where simulation and recording differ, which physics explains it, and proof.
//!
//! `source` (a log, and with `faults` what is wrong with its data) -> `body` (the models of `hydroline_inference`, weighed: what matters, how
//! sure, where, what else it may be, which run would tell) -> `verdict` -> `report`. `profiles` asks the same of frames.
//!
//! Nothing here knows a single effect: laws, ranges and stages come from `sim`'s registry.

mod alone;
pub mod body;
mod conclude;
pub mod faults;
mod joined;
pub mod profiles;
pub mod report;
mod source;
pub mod until;
pub mod verdict;

pub use conclude::{DiagnoseError, Diagnosis};
pub use source::{Part, Source, read};
pub use verdict::Verdict;

use hydroline_rigs::{Dof, Rig};

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
    diagnose_beside(sources, held, rig, &[], progress)
}

/// The same where the measured motion of some DOFs is an input.
///
/// # Errors
/// [`DiagnoseError`].
pub fn diagnose_beside(
    sources: &[Source],
    held: &[Source],
    rig: &Rig,
    given: &[Dof],
    progress: &(dyn Fn(&str) + Sync),
) -> Result<Diagnosis, DiagnoseError> {
    body::diagnose(sources, held, rig, given, progress)
}
