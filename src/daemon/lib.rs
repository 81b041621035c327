//! The chain put together: recording, replay, simulation and calibration. Devices, clocks and files are injected.
//!
//! ```
//! use hydroline_daemon::simulate::{Options, simulate};
//! use hydroline_rigs::{Plan, Rig};
//!
//! let folder = tempfile::tempdir()?;
//! let log = folder.path().join("run.mcap");
//! let (rig, plan) = (Rig::builtin("lshpi")?, Plan::load_or_builtin("surge-4n")?);
//! let options = Options { motion_only: true, ..Options::default() };
//! let written = simulate(&rig, &plan, &log, &options, &mut |_, _| ())?;
//! assert!(!written.lost && log.exists());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod analysis;
pub mod bring_back;
pub mod calibrate;
pub mod diagnostics;
pub mod live;
pub mod record;
pub mod remembered;
pub mod replay;
pub mod response;
pub mod series;
pub mod signals;
pub mod simulate;
pub mod simulated;
