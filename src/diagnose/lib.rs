//! What was left out: where simulation and recording differ, which physics explains it, and proof.
//!
//! `alone` (one log only: what of it is predicted) -> `faults` (is it the data?) -> per DOF that moves: `setting` (runs, rig's model, candidates from
//! the registry) -> `search` (noise from the richest model; sets of effects fitted jointly with the
//! vehicle's coefficients) -> `explain` (is a law only inexact, is something unnamed at work?) ->
//! `posterior` (what is tied) -> `predict`, `locate`, `next` -> `verdict`.
//!
//! Nothing here knows a single effect: laws, ranges and stages come from `sim`'s registry.

mod alone;
pub mod bank;
pub mod body;
pub mod candidate;
pub mod choosing;
mod conclude;
mod descent;
pub mod explain;
pub mod family;
pub mod faults;
pub mod fit;
mod joined;
pub mod locate;
pub mod next;
pub mod posterior;
pub mod predict;
pub mod profiles;
pub mod report;
pub mod rest;
pub mod scale;
pub mod search;
pub mod setting;
mod source;
#[cfg(test)]
mod testing;
pub mod verdict;
pub mod weight;
pub mod weights;

pub use conclude::{DiagnoseError, Diagnosis};
pub use source::{Part, Source, read};
pub use verdict::Verdict;

use hydroline_rigs::{Dof, Rig};

/// Which engine is asked, until one is left.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Engine {
    /// One likelihood over all DOFs.
    #[default]
    Body,
    /// One DOF after the other, in stages: the one before, to be compared with.
    Staged,
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
    diagnose_by(Engine::default(), sources, held, rig, progress)
}

/// The same by an engine.
///
/// # Errors
/// [`DiagnoseError`].
pub fn diagnose_by(
    engine: Engine,
    sources: &[Source],
    held: &[Source],
    rig: &Rig,
    progress: &(dyn Fn(&str) + Sync),
) -> Result<Diagnosis, DiagnoseError> {
    diagnose_beside(engine, sources, held, rig, &[], progress)
}

/// The same where the measured motion of some DOFs is an input.
///
/// # Errors
/// [`DiagnoseError`].
pub fn diagnose_beside(
    engine: Engine,
    sources: &[Source],
    held: &[Source],
    rig: &Rig,
    given: &[Dof],
    progress: &(dyn Fn(&str) + Sync),
) -> Result<Diagnosis, DiagnoseError> {
    match engine {
        // What drives a vehicle beside the commands only one of them knows.
        Engine::Staged if given.is_empty() => alone::diagnose(sources, held, rig, progress),
        _ => body::diagnose(sources, held, rig, given, progress),
    }
}
