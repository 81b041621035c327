//! Hydrodynamic parameters with their uncertainty, from motion and commands.
//!
//! `data` (a log becomes a [`Run`](hydroline_core::run::Run)), [`parameter`] (the eighteen coefficients), [`bollard`] and [`curve`]
//! (what thrusters make), [`Identification`] (the result of a fit, which the crate `hydroline_estimate` makes by the likelihood of
//! `hydroline_inference`) with its [`report`] and its way into a rig ([`adopt`]), [`model_test`] (does a model explain its runs),
//! [`predict`] (the motion of a plan with its band).
//!
//! ```
//! use hydroline_identify::parameter::Coefficient;
//!
//! let rig = hydroline_rigs::Rig::builtin("lshpi")?;
//! let added = Coefficient::find("x_udot").ok_or("one of the eighteen")?;
//! assert_eq!((added.symbol(), added.unit()), ("X_u̇", "kg"));
//! assert!(added.of_vehicle(&rig.vehicle) < 0.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod adopt;
pub mod blind;
pub mod bollard;
pub mod curve;
pub mod data;
pub mod expanded;
pub mod figures;
pub mod merged;
pub mod model_test;
mod outcome;
pub mod parameter;
pub mod predict;
pub mod report;
mod seen;

pub use outcome::{
    BudgetLine, COVERAGE, CrossValidation, Estimate, Identification, Logged, NotIdentifiable,
    Profile, Residuals, RunSummary, SlotNoise, Trace,
};
pub use seen::{Seen, seen};
