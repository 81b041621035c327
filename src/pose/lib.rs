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

pub mod estimators;
pub mod initial;
pub mod joint;
mod normal;
pub mod opening;
pub mod outline;
mod photometric;
pub mod run;
pub mod segments;
pub mod sheet;
pub mod smooth;

pub use hydroline_calib::Pose;
