//! A rig's model for other programs, and rigs from theirs.
//!
//! ```text
//! traced, formula   the simulator's own laws, run in a scalar that remembers how it was made: formulas of any language
//! model             equations of motion of a rig as such formulas, with states, parameters and thrusters
//! target            files of a language or a simulator, each with the list of what it cannot hold
//! lost              that list, and by how far the motion is another one
//! draws, npz        joint draws of coefficients and effects
//! foreign           coefficients of MSS, Gazebo, UUV Simulator and tables
//! edit, units       values put into a rig's text; units as people type them
//! ```

#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

pub mod draws;
pub mod edit;
pub mod foreign;
pub mod formula;
pub mod lost;
pub mod model;
pub mod npz;
pub mod stored;
pub mod target;
pub mod traced;
pub mod units;
