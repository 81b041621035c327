//! Plans before they run: set-points over time, and the whole plan simulated before the first command.

pub mod preflight;
pub mod setpoint;
