//! Plans before they run: set-points over time, the whole plan simulated before the first command, and its size that fits.
//!
//! ```
//! use hydroline_plan::preflight::preflight;
//! use hydroline_rigs::{Plan, Rig};
//!
//! let flown = preflight(&Rig::builtin("lshpi")?, &Plan::load_or_builtin("surge-4n")?)?;
//! assert!(flown.violations.is_empty() && flown.duration_s > 10.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod preflight;
mod seen;
pub mod setpoint;
pub mod size;
