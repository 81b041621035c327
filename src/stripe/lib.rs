//! Sub-pixel extraction of the laser stripe from a grey frame: one point per column (per row,
//! where the stripe is configured to be vertical).
//!
//! Way of a frame: `noise` of the frame → `coarse` candidates per column → of several lines
//! (`chains`) the one that is a stripe (`hypothesis`) → `path` through the columns (dynamic
//! programming, depth steps allowed) → `ceiling` at which it clips → `fit` of every column
//! (`trace`) with a kernel matched to the stripe's width, which is estimated from the frame →
//! `haze` pooled over the columns → second `fit` → where rows flicker, `banding` is taken off and
//! the way gone again → `report` → [`Profile`], its sds held against the rows' own `scatter`.
//!
//! The result depends on the image and the configuration only: an [`Extractor`] keeps scratch
//! memory, never results, so a frame extracted live and the same frame replayed give the same
//! bits. Rows grow downwards; 0 = the centre of the top left pixel.
//!
//! ```
//! use hydroline_core::frame::GreyImage;
//! use hydroline_stripe::{Extractor, ExtractorConfig};
//!
//! // A stripe of sd 2 px that falls by one row in a hundred columns.
//! let row_px = |column: f64| 287.3 + 0.01 * column;
//! let level = |i: usize| {
//!     let off_px = (i / 720) as f64 - row_px((i % 720) as f64);
//!     (14.0 + 180.0 * (-off_px * off_px / 8.0).exp()).round() as u8
//! };
//! let pixels = (0..720 * 576).map(level).collect();
//! let image = GreyImage { width_px: 720, height_px: 576, pixels };
//! let profile = Extractor::new(ExtractorConfig::default()).extract(&image);
//! assert!(profile.points.len() > 700);
//! for point in &profile.points {
//!     assert!((point.row_px - row_px(point.column_px)).abs() < 0.3);
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod banding;
mod ceiling;
mod chains;
mod clipped;
mod coarse;
mod config;
mod extractor;
mod fit;
mod haze;
mod hypothesis;
mod kernel;
mod noise;
mod output;
mod path;
mod report;
mod scatter;
mod segments;
#[cfg(test)]
#[path = "tests/synthetic/mod.rs"]
mod synthetic;
mod trace;
mod transpose;

pub use config::{ExtractorConfig, Orientation};
pub use extractor::Extractor;
pub use output::{CSV_HEADER, annotate, write_csv};

/// Bits of [`StripePoint::quality`]; 0 = nothing to remark.
pub mod quality {
    /// Pixels were clipped: the row comes from the flanks.
    pub const SATURATED: u32 = 1;
    /// One-sided haze was taken out.
    pub const HAZE_CORRECTED: u32 = 2;
    /// Another candidate in this column, within 24 rows.
    pub const RIVAL: u32 = 4;
    /// Close to a depth step or an end of the stripe, where the profile is cut and the row biased.
    pub const NEAR_STEP: u32 = 8;
}

/// The stripe in one column.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StripePoint {
    /// Column \[px\]; of a vertical stripe, its centre.
    pub column_px: f64,
    /// Centre of the stripe \[px\]; of a vertical stripe, the row.
    pub row_px: f64,
    /// Height above the background \[grey levels\]; beyond 255 where clipped (extrapolated).
    pub peak: f64,
    /// Standard deviation of the centre \[px\].
    pub sd_px: f64,
    /// Standard deviation of the stripe's own profile across \[px\], this column alone.
    pub sigma_px: f64,
    /// Bits of [`quality`].
    pub quality: u32,
}

/// The stripe of one frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Profile {
    /// One point per column where there is one, by column.
    pub points: Vec<StripePoint>,
    /// The other candidates (ghosts, particles, the other side of a step), by column, then row.
    pub candidates: Vec<StripePoint>,
    /// Size of the image: columns, rows \[px\].
    pub size_px: (usize, usize),
    /// Pixel noise of the frame \[grey levels\].
    pub noise_sd: f64,
    /// Pooled one-sided haze, fraction of the peak; 0 = none established.
    pub haze_level: f64,
    /// Decay length of the haze \[px\], positive = above the stripe; 0 = none.
    pub haze_length_px: f64,
    /// Why there is no point.
    pub fault: Option<ProfileFault>,
}

/// Why a frame has no stripe.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum ProfileFault {
    #[error("image {width_px}x{height_px} needs {needed} bytes, has {got}: fix the frame source")]
    Malformed {
        width_px: usize,
        height_px: usize,
        needed: usize,
        got: usize,
    },
    #[error(
        "image {width_px}x{height_px} is too small for a stripe: at least {min_columns}x{min_rows}"
    )]
    TooSmall {
        width_px: usize,
        height_px: usize,
        min_columns: usize,
        min_rows: usize,
    },
    #[error(
        "no stripe: no place stands out of noise {noise_sd:.1} (mean grey level {mean_level:.0}); \
         is the laser on, the lens cap off, the exposure right?"
    )]
    Dark { noise_sd: f64, mean_level: f64 },
    #[error("no stripe: bright spots in {spotted} columns, a stripe in {found}, needed {needed}")]
    TooFewColumns {
        spotted: usize,
        found: usize,
        needed: usize,
    },
}

#[cfg(test)]
#[path = "tests/unit/mod.rs"]
mod tests;
