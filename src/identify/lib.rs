//! Hydrodynamic parameters with their uncertainty, from motion and commands.
//!
//! `data` (a log becomes a [`Run`](hydroline_core::run::Run)) -> a model with its sensitivities
//! ([`Forward`](forward::Forward): one DOF in `axis`, the full Eq. 1 in `coupled`) -> `problem`
//! (one vector of unknowns, residuals whitened) -> a [`Method`](method::Method)
//! (`lm`, or another [`method`]) -> `estimate` (noise, intervals, whiteness, what is not identifiable).
//!
//! ```
//! use hydroline_core::run::{Channel, Command, PerChannel, Run, Sample};
//! use hydroline_identify::{Options, identify};
//! use hydroline_sim::{Model, Trajectory, model::ModelState};
//!
//! let rig = hydroline_rigs::Rig::builtin("lshpi")?;
//! let mut truth = Trajectory::<f64>::new(Model::from_rig(&rig)?, ModelState::at_rest([0.0; 6]), 0.01)?;
//! let mut run = Run::default();
//! for (t_s, surge_n) in [(0.0, 8.0), (6.0, -8.0), (12.0, 4.0)] {
//!     let wrench = [surge_n, 0.0, 0.0, 0.0, 0.0, 0.0];
//!     truth.command(t_s, wrench)?;
//!     run.commands.push(Command { t_s, wrench });
//! }
//! for k in 1..=360 {
//!     let mut values = PerChannel::NAN; // only x is measured, to a millimetre
//!     let off_m = 1e-3 * (f64::from(k * 7 % 11) / 5.0 - 1.0);
//!     values[Channel::X] = truth.state_at(0.05 * f64::from(k))?.vehicle.eta[0] + off_m;
//!     run.samples.push(Sample { t_s: 0.05 * f64::from(k), values, covariance: None });
//! }
//! let found = identify(&[run], &rig, &Options::default())?;
//! let added = &found.parameters["x_udot"];
//! let sd = added.sd.ok_or("the run says nothing about it")?;
//! assert!((added.value - rig.vehicle.coefficients[0].added).abs() < 4.0 * sd);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod adopt;
pub mod axis;
mod blind;
pub mod bollard;
pub mod coupled;
pub mod curve;
pub mod data;
mod estimate;
pub mod figures;
pub mod forward;
pub mod lm;
pub mod merged;
pub mod method;
mod outcome;
pub mod parameter;
pub mod predict;
pub mod problem;
mod refit;
pub mod report;
mod seen;
pub mod uncertainty;

pub use estimate::{IdentifyError, ModelChoice, Options, identify, measured_channels, stretched};
pub use outcome::{
    CrossValidation, Estimate, Identification, NotIdentifiable, Residuals, RunSummary, SlotNoise,
    Trace,
};
pub use refit::{Refitted, refit};
pub use seen::{Seen, seen};
