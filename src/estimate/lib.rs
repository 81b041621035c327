//! Coefficients with their uncertainty: the likelihood of `hydroline_inference` of the vehicle alone, without candidates.
//!
//! Runs at rest measure the noise ([`hydroline_inference::at_rest`]), the others make a body of which the coefficients asked for are free
//! (`asked`), its likeliest mode is found from several starts beside the noise and a random force (`fitted`), and becomes numbers with
//! intervals (`numbers`, `profiles`), words (`conclude`), an uncertainty budget (`budget`) with the scatter between repeats beside it
//! (`repeats`), and predictions of each run by the others (`held_out`).
//!
//! ```
//! use hydroline_core::run::{Channel, Command, PerChannel, Run, Sample};
//! use hydroline_estimate::{Options, identify};
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

// Tests may unwrap; the crate itself must not.
#![cfg_attr(test, allow(clippy::unwrap_used))]

mod asked;
mod budget;
mod conclude;
mod fitted;
mod held_out;
mod identify;
mod numbers;
mod options;
mod over_noise;
mod profiles;
mod refit;
mod repeats;
#[cfg(test)]
mod tests;

pub use identify::identify;
pub use options::{EstimateError, ModelChoice, Options};
pub use refit::{Refitted, refit};
