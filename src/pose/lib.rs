//! From the stripe to the pose.
//!
//! Two ways, one behind the other:
//! 1. [`segments`] sorts the stripe in the laser plane into floor, board and hexagon and finds the
//!    edge points A, B, C, D; [`estimators`] turns them into one degree of freedom each, by the
//!    paper's six formulas and with the paper's assumptions.
//! 2. [`joint`] fits all six degrees of freedom at once to the grey levels along the stripe
//!    ([`photometric`]: closed form, with derivatives), from the first guess of [`initial`].
//!
//! Every result depends on the frame, the rig, the camera's response ([`opening`]: found once, then fixed) and, where
//! the target repeats itself, on a hint which of its repetitions is meant; never on how many frames were looked at before.
//!
//! ```
//! use hydroline_calib::{IdealMap, Pose};
//! use hydroline_core::frame::GreyImage;
//! use hydroline_pose::joint::{Hint, PoseFitter};
//! use hydroline_sim::{Pose6, Renderer};
//! use hydroline_stripe::{Extractor, ExtractorConfig};
//! use std::sync::Arc;
//!
//! let rig = hydroline_rigs::Rig::builtin("lshpi")?;
//! let truth = Pose { x_m: 0.21, y_m: 0.004, z_m: -0.826, phi_rad: 0.01, theta_rad: -0.008, psi_rad: -0.05 };
//! let pixels = Renderer::new(&rig)?.render(&Pose6::from(truth.to_array()), 0).0;
//! let image = GreyImage { width_px: 720, height_px: 576, pixels };
//! let profile = Extractor::new(ExtractorConfig::default()).extract(&image);
//! let fitter = PoseFitter::new(&rig, Arc::new(IdealMap::of(&rig)));
//! let hint = Hint { x_m: Some(0.2), ..Hint::default() }; // which of the hexagons, which look alike
//! let found = fitter.fit(&image, &profile, &hint)?.pose;
//! assert!((found.position_m() - truth.position_m()).norm() < 2e-3);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod estimators;
pub mod initial;
pub mod joint;
mod normal;
pub mod opening;
pub mod outline;
mod photometric;
pub mod place;
pub mod run;
pub mod segments;
pub mod sheet;
pub mod smooth;

#[cfg(test)]
#[path = "../../tests/support/lshpi_rig.rs"]
mod fixture;

pub use hydroline_calib::Pose;
