//! A rig's model for other programs, and rigs from theirs.
//!
//! ```text
//! traced, formula   the simulator's own laws, run in a scalar that remembers how it was made: formulas of any language
//! model             equations of motion of a rig as such formulas, with states, parameters and thrusters
//! target            files of a language or a simulator, each with the list of what it cannot hold
//! ```

#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

pub mod draws;
pub mod formula;
pub mod lost;
pub mod model;
pub mod npz;
pub mod stored;
pub mod target;
pub mod traced;
