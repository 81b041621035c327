//! hydroline: a laser line on a tank floor, from camera frames to hydrodynamic parameters.
//!
//! One way for data: capture -> log; log/capture -> stripe -> pose -> identify -> diagnose -> report.
//! Each room is a crate of its own, so that the compiler holds who may use whom (ARCHITECTURE.md); this
//! facade gives them their names in one place. Devices, clocks and files are injected.
//!
//! ```
//! use hydroline::estimate::{Options, identify};
//! use hydroline::identify::data::load;
//! use hydroline::simulate::{self, simulate};
//! use hydroline_rigs::{Plan, Rig};
//!
//! let folder = tempfile::tempdir()?;
//! let log = folder.path().join("run.mcap");
//! let (rig, plan) = (Rig::builtin("lshpi")?, Plan::load_or_builtin("reversals")?);
//! let options = simulate::Options { motion_only: true, ..simulate::Options::default() };
//! simulate(&rig, &plan, &log, &options, &mut |_, _| ())?;
//! let found = identify(&[load(&log, &rig)?], &rig, &Options::default())?;
//! assert_eq!(found.model, "surge");
//! assert!(found.parameters["x_udot"].sd.is_some());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub use hydroline_capture as capture;
pub use hydroline_cli as cli;
pub use hydroline_coefficients as coefficients;
pub use hydroline_core::{
    build_info, clock, event, frame, run, session, shutdown, thread_class, water,
};
pub use hydroline_daemon::live as live_run;
pub use hydroline_daemon::{
    analysis, calibrate, diagnostics, record, replay, signals, simulate, simulated,
};
pub use hydroline_diagnose as diagnose;
pub use hydroline_estimate as estimate;
pub use hydroline_exchange as exchange;
pub use hydroline_identify as identify;
pub use hydroline_identify::predict;
pub use hydroline_import as import;
#[cfg(feature = "lab")]
pub use hydroline_lab::{benchmark as prove, reproduce};
pub use hydroline_live as live;
pub use hydroline_log as log;
pub use hydroline_plan as plan;
pub use hydroline_pose as pose;
pub use hydroline_pose::smooth;
pub use hydroline_stripe as stripe;
pub use hydroline_thruster as thruster;
