//! Thrusters: pulse to thrust and back, thrusters to wrench and back.

mod allocation;

pub use allocation::{Allocated, Allocation, Saturation};

/// What can go wrong between a wrench and the pulses.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ThrustError {
    /// The layout cannot make this load.
    #[error(
        "the thrusters cannot make {dof} {asked}: the best they reach is {reached}; {dof} is not spanned by their positions and directions"
    )]
    NotSpanned {
        /// Component that fails.
        dof: &'static str,
        /// Asked \[N or N m\].
        asked: f64,
        /// What the least-squares allocation gives \[N or N m\].
        reached: f64,
    },
    /// Not one value per thruster.
    #[error("{given} values for {thrusters} thrusters; give one each, in the rig's order")]
    Count {
        /// Values given.
        given: usize,
        /// Thrusters of the rig.
        thrusters: usize,
    },
    /// NaN or infinite.
    #[error("{what} is {value}; it must be finite")]
    NotFinite {
        /// Which number.
        what: String,
        /// Its value.
        value: f64,
    },
    /// A curve that is no curve.
    #[error(
        "thruster {thruster}: its pulse-to-thrust curve has {points} points; at least 2 with ascending pulses are needed"
    )]
    Curve {
        /// Thruster.
        thruster: String,
        /// Number of points.
        points: usize,
    },
    /// The pseudo-inverse failed.
    #[error(
        "the allocation matrix of {thrusters} thrusters has no pseudo-inverse ({reason}); check positions and directions"
    )]
    Singular {
        /// Thrusters of the rig.
        thrusters: usize,
        /// What the solver said.
        reason: &'static str,
    },
}
