//! Thrusters: pulse to thrust and back, thrusters to wrench and back.

mod allocation;
mod commanded;

pub use allocation::{Allocated, Allocation, Saturation};
pub use commanded::{Commanded, Target};

/// Error between a wrench and the pulses.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum ThrustError {
    #[error(
        "the thrusters cannot make {dof} {asked}: the best they reach is {reached}; {dof} is not spanned by their positions and directions"
    )]
    NotSpanned {
        dof: &'static str,
        asked: f64,
        /// Result of the least-squares allocation \[N or N m\].
        reached: f64,
    },
    #[error("{given} values for {thrusters} thrusters; give one each, in the rig's order")]
    Count { given: usize, thrusters: usize },
    #[error("{what} is {value}; it must be finite")]
    NotFinite { what: String, value: f64 },
    #[error(
        "thruster {thruster}: its pulse-to-thrust curve has {points} points; at least 2 with ascending pulses are needed"
    )]
    Curve { thruster: String, points: usize },
    #[error(
        "the allocation matrix of {thrusters} thrusters has no pseudo-inverse ({reason}); check positions and directions"
    )]
    Singular {
        thrusters: usize,
        reason: &'static str,
    },
}
