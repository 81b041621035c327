//! Hydrodynamic parameters with their uncertainty, from motion and commands.
//!
//! `data` (a log becomes a [`Run`](data::Run)) -> a model with its sensitivities
//! ([`Forward`](forward::Forward): one DOF in `axis`, the full Eq. 1 in `coupled`) -> `problem`
//! (one vector of unknowns, residuals whitened) -> a [`Method`](method::Method)
//! (`lm`, `cmaes`, `ga`) -> `estimate` (noise, intervals, whiteness, what is not identifiable).

pub mod adopt;
pub mod axis;
mod blind;
pub mod bollard;
pub mod cmaes;
pub mod coupled;
pub mod curve;
pub mod data;
mod estimate;
pub mod figures;
pub mod forward;
pub mod ga;
pub mod lm;
pub mod merged;
pub mod method;
mod outcome;
pub mod paper;
pub mod parameter;
pub mod predict;
pub mod problem;
pub mod report;
pub mod rest_noise;
pub mod uncertainty;

pub use estimate::{IdentifyError, ModelChoice, Options, identify, measured_channels};
pub use outcome::{
    CrossValidation, Estimate, Identification, NotIdentifiable, Residuals, RunSummary, SlotNoise,
    Trace,
};
