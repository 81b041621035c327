//! Plans for one's own vehicle.
//!
//! `sized` (which DOFs the thrusters drive, and how far they reach before tank, limits or target refuse) -> `pattern`
//! (steps with a level per DOF) -> `judge` (information to expect of a run, `hydroline_inference::planned`) -> `search`
//! (the set that says most) -> `summary` (what each plan excites). `library` = plans of one DOF from which the next run of a
//! diagnosis is chosen.
//!
//! Nothing here reads a file or prints.
//!
//! ```
//! use hydroline_design::Admission;
//! use hydroline_rigs::{Plan, Rig};
//!
//! let (rig, plan) = (Rig::builtin("lshpi")?, Plan::load_or_builtin("surge-4n")?);
//! // The vehicle as the rig file has it runs the plan; one of a quarter less mass and damping would not.
//! assert!(Admission::of_known(&rig, None).admits(&plan));
//! assert!(!Admission::new(&rig, None).admits(&plan));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

// Tests may unwrap; the crate itself must not.
#![cfg_attr(test, allow(clippy::unwrap_used))]

mod judge;
pub mod library;
mod options;
mod pattern;
mod search;
mod sized;
mod summary;

pub use judge::{Judge, Separation};
pub use options::{Instruments, Options, Purpose};
pub use search::{DesignError, Designed, Set, design, not_shown_yet};
pub use sized::{Admission, Reach, reach};
