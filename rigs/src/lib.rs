//! Rig, target, board and plan files: what a person types, checked once, and the
//! ready objects the rest of hydroline works with.
//!
//! A table of a file is declared once (`raw::table!`): name, meaning, unit, range and default of its keys, from which
//! reading, writing and the book's reference come, and the checked type exported here. [`Rig::load`] and friends are the
//! only way to it; unknown keys are refused, and every error names file, key, value and allowed range.
//!
//! ```
//! use hydroline_rigs::{Plan, Rig};
//!
//! let rig = Rig::load_or_builtin("lshpi")?;
//! let plan = Plan::load_or_builtin("surge-4n")?;
//! plan.check_against(&rig)?;
//! assert_eq!(rig.camera.width_px, 720);
//!
//! let wrong = Rig::from_toml("[rig]\nnmae = \"mine\"", "my.toml", None).unwrap_err();
//! assert!(wrong.to_string().contains("my.toml:2: rig.nmae: unknown key (did you mean `name`?)"));
//! # Ok::<(), hydroline_rigs::RigError>(())
//! ```
//!
//! Frames (see `theory/geometry.md`): tank frame NED-like, Z down, floor at Z = 0; body
//! frame x forward, y starboard, z down, origin at the CG; laser plane (xi to port,
//! eta up). Everything here is SI; angles in radians.

// A test may stop at the first surprise; the library may not.
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

// First: what it declares tables with is a macro.
#[macro_use]
mod raw;

pub mod bounded;
pub mod camera;
pub mod channel;
pub mod laser;
pub mod physics;
pub mod pixel_format;
pub mod plan;
pub mod plausible;
pub mod reference;
pub mod settings;
pub mod target;
pub mod thruster;
pub mod vehicle;

mod builtin;
mod device;
mod error;
mod identified;
mod load;
mod response;
mod rig;

pub use camera::{Camera, CameraBackend, CameraControl, ImageNoise};
pub use device::DeviceIdentity;
pub use error::{Problem, ProblemKind, RigError};
pub use identified::Identified;
pub use laser::{FlatPort, Laser, Mounts};
pub use physics::{ParameterValue, PhysicsEntry};
pub use pixel_format::{
    BayerDepth, BayerOrder, Channel, FRAME_BYTES_MAX, GreyRule, PixelFormat, YuvRange,
};
pub use plan::{Plan, PlanStep, Shape, StepLoad, Wrench};
pub use response::StatedResponse;
pub use rig::Rig;
pub use settings::{Limits, LogSettings, Tank, Tolerance};
pub use target::{Board, BoardPattern, Dictionary, GaugeBlock, Slab, SlabOutline, Target};
pub use thruster::{
    BollardPull, Link, LinkKind, LinkPort, Mavlink, RecordOn, ThrustCurve, Thruster, ThrusterSet,
};
pub use vehicle::{AxisCoefficients, Dof, Vehicle, VehicleModel};
