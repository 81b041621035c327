//! Coefficients as a paper prints them: dimensional, primed, scaled to another size, with their intervals.
//!
//! ```text
//! dimension  powers of mass, length and time    prime    units of the systems I, II and bis
//! froude     the same hull at another size      regime   Reynolds, Froude and Keulegan-Carpenter numbers
//! fitted     a rig or a result as rows          table    rows converted; CSV, LaTeX and text of them
//! compared   two of them, difference by difference
//! ```
//!
//! ```
//! use hydroline_coefficients::{Dimension, Particulars, Prime};
//! use hydroline_identify::parameter::Coefficient;
//!
//! // Y_v' = -0.1 of a vehicle of 5.3 m in fresh water at 2 m/s, in kilograms per second.
//! let hull = Particulars { length_m: 5.3, speed_mps: Some(2.0), ..Particulars::of_length(5.3) };
//! let units = Prime::I.units(&hull)?;
//! let y_v = Coefficient::find("y_v").ok_or("no such coefficient")?;
//! let dimensional = -0.1 * units.of(Dimension::of(y_v));
//! assert!((dimensional + 0.1 * 500.0 * 5.3 * 5.3 * 2.0).abs() < 1e-9);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

pub mod compared;
pub mod dimension;
pub mod fitted;
pub mod froude;
pub mod prime;
pub mod regime;
pub mod table;

pub use compared::{Compared, ComparedRow, Together};
pub use dimension::Dimension;
pub use fitted::{Fitted, FittedError, Row};
pub use prime::{Particulars, Prime, PrimeError, Units};
pub use table::{Line, Table};

#[cfg(test)]
mod published;
