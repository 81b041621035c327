//! Plans before they run: set-points over time, the whole plan simulated before the first command, and its size that fits.

pub mod preflight;
mod seen;
pub mod setpoint;
pub mod size;
