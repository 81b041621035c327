//! Frames, camera and the maps between image and laser plane.
//!
//! The only place where one frame is converted into another: everything else asks here,
//! so a sign can be wrong once only. SI units, radians; pixel coordinates with 0 at the
//! CENTRE of the top left pixel.
//!
//! - [`frames`]: tank, body, laser plane and camera frame, poses.
//! - [`camera`]: the pinhole on its mount: body point ↔ pixel, pixel → laser plane.
//! - [`analytic`]: the paper's Eqs. 11–12, the map of an ideal camera.
//! - [`plane`]: the trait every map from image to laser plane implements.
//! - [`map`]: the maps fitted to a board's nodes; [`study`]: their comparison.
//! - [`calibration`]: a map with its provenance, as a file.
//! - [`flat`]: the camera's response from an exposure series.
//!
//! ```
//! use hydroline_calib::{IdealMap, PlaneMap};
//!
//! let rig = hydroline_rigs::Rig::builtin("lshpi")?;
//! let map = IdealMap::of(&rig);
//! let point = map.to_plane(400.0, 300.0).ok_or("not in the laser's fan")?;
//! let (column_px, row_px) = map.to_image(point.xi_m, point.eta_m).ok_or("not in the image")?;
//! assert!((column_px - 400.0).abs() < 1e-6 && (row_px - 300.0).abs() < 1e-6);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

// A test may stop at the first surprise; the library may not.
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

pub mod analytic;
pub mod board;
pub mod calibration;
pub mod camera;
pub mod charuco;
pub mod detect;
pub mod drawing;
pub mod flat;
pub mod frames;
pub mod free;
pub mod map;
pub mod online;
pub mod plane;
#[cfg(test)]
#[path = "../tests/synthetic/mod.rs"]
mod synthetic;

// The boards that tests draw name this crate as other crates do.
#[cfg(test)]
extern crate self as hydroline_calib;

pub use analytic::IdealMap;
pub use calibration::{CalibError, Calibration, IdealParameters, MapParameters, Medium, Residuals};
pub use camera::{Pinhole, Sheet};
pub use frames::{LevelLine, PlaneCoordinates, Pose};
pub use plane::{Fan, ImageSize, PlaneMap, PlanePoint};
