//! The forward model: what the rig would do and what its camera would see.
//!
//! - [`vehicle`]: the paper's Eq. 1, Euler kinematics, RK4 split at every edge;
//! - [`thrust`]: pulse to thrust, thrusters to wrench and back;
//! - [`effect`]: the physics that a model may leave out, one file per effect;
//! - [`model`]: vehicle and effects together, [`given`]: what of a motion is measured instead, [`world`]: the same fed by commands as they come;
//! - [`scene`]: the renderer of laser images and the analytic stripe.
//!
//! Nothing here reads a clock, a file or a device; the same input gives the same bytes.
//!
//! ```
//! use hydroline_sim::{Model, Trajectory, model::ModelState};
//!
//! let rig = hydroline_rigs::Rig::builtin("lshpi")?;
//! let mut run = Trajectory::<f64>::new(Model::from_rig(&rig)?, ModelState::at_rest([0.0; 6]), 0.01)?;
//! run.command(0.0, [8.0, 0.0, 0.0, 0.0, 0.0, 0.0])?; // 8 N ahead
//! let after = run.state_at(5.0)?.vehicle;
//! assert!(after.eta[0] > 0.1 && after.nu[0] > 0.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

// Tests may unwrap; the crate itself must not.
#![cfg_attr(test, allow(clippy::unwrap_used))]

pub mod dual;
pub mod effect;
#[cfg(test)]
#[path = "../../tests/support/lshpi_rig.rs"]
mod fixture;
pub mod given;
pub mod model;
pub mod real;
pub mod scene;
pub mod single;
pub mod thrust;
pub mod trajectory;
pub mod vehicle;
pub mod whole;
pub mod world;

pub use dual::Dual;
pub use effect::{EffectError, EffectStack};
pub use given::Given;
pub use model::Model;
pub use real::Real;
pub use scene::{Pose6, Renderer, SceneError};
pub use thrust::{Allocation, ThrustError};
pub use trajectory::{Trajectory, TrajectoryError};
pub use vehicle::VehicleState;
pub use world::{SimError, World};
