//! Runs from logs, and what is known of them before they are fitted.

mod load;
mod memory;
mod still;
mod vehicle;

pub use load::{LoadError, capacity, load, load_messages, unwrap_turns};
pub use memory::memory_s;
pub use still::{NOISE_KEY, STILL_MIN_S, StillWatch, is_still, still_noise};
pub use vehicle::{check_vehicle, differences};

/// Prior knowledge of every run's start; by default none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Start {
    /// Nothing: place and velocity are free in each run.
    #[default]
    Free,
    /// At rest: the velocity is 0, the place is free.
    AtRest,
    /// At rest, and positions count from the first frame as the paper's x_i = (X_S,i − X_S,1) cos ψ_S do:
    /// place and velocity are 0. One-DOF models; the coupled one keeps its places free.
    AtRestFromZero,
}
