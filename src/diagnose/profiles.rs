//! Diagnosis at image level: what of camera, sheet, target and water the rig's model left out.
//!
//! `observe` (a log's frames: stripe points, widths, edges) -> `light` (what lights the picture; the frames without it) ->
//! `start` (poses to begin with) -> `fit` (poses of all frames together with shared parameters and a candidate's own,
//! evidence) -> `search` (nothing, each, pairs; what is tied; what these frames cannot show) -> `findings` (into the
//! verdict) -> `picture` (residuals over the image).
//!
//! `geometry` predicts the stripe from [`Optics`](hydroline_sim::effect::Optics): the effects' laws
//! are `sim`'s, what light makes of them is computed here anew and not by the renderer.

mod anytime;
pub mod candidate;
mod evidence;
pub mod findings;
pub mod fit;
pub mod geometry;
pub mod known;
pub mod light;
pub mod model;
mod motion_prior;
pub mod observe;
pub mod picture;
pub mod prior;
pub mod search;
mod start;

pub use findings::{Findings, ImageError, level};
