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
pub mod candidate;
pub mod choosing;
mod conclude;
mod descent;
pub mod explain;
pub mod family;
pub mod faults;
pub mod fit;
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

pub use alone::diagnose;
pub use conclude::{DiagnoseError, Diagnosis};
pub use source::{Part, Source, read};
pub use verdict::Verdict;
