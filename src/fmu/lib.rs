//! The library inside an FMU (FMI 3.0, co-simulation): a rig's vehicle, moved by hydroline's own simulator.
//!
//! One library serves every vehicle: it reads `rig.toml` from the FMU's resources, so that a model is exported without a compiler.
//! Nothing is lost: curves of delay, effects and their edges are those of the simulator. `variables` numbers inputs, outputs and
//! parameters, `instance` is the vehicle without any C, `interface` the C functions of the standard.

#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

pub mod instance;
pub mod interface;
pub mod variables;

pub use instance::{Instance, InstanceError};
pub use variables::{Causality, Variable, token, variables};

/// Name of the library's file without its ending, and the FMU's model identifier.
pub const IDENTIFIER: &str = "hydroline_fmu";
/// Folder of binaries of this machine, as FMI 3.0 names it; `None` = FMI has no name for it.
pub fn platform() -> Option<String> {
    let system = match std::env::consts::OS {
        "linux" => "linux",
        "macos" => "darwin",
        "windows" => "windows",
        _ => return None,
    };
    let machine = match std::env::consts::ARCH {
        "x86_64" => "x86_64",
        "aarch64" => "aarch64",
        "x86" => "x86",
        "arm" => "aarch32",
        _ => return None,
    };
    Some(format!("{machine}-{system}"))
}
