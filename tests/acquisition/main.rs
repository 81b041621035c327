//! Parts of the daemon on real files and terminals: the log under crashes, cuts, bit flips and slow disks; thruster lines.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

mod log_files;
mod thruster_pty;

#[path = "../support/inputs.rs"]
mod inputs;
