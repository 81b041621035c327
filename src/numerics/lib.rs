//! The numerical kernel: what pose, calibration, identification and smoothing share, and nothing of theirs.
//!
//! - [`least_squares`]: one nonlinear least-squares loop (Levenberg–Marquardt, Gauss–Newton), each option with its
//!   default, reason and source;
//! - [`apart`]: samples of a series that stand apart from their neighbours, without a model;
//! - [`outliers`]: the same of a measurement, by the motion around each sample;
//! - [`cancel`]: ending a long computation from outside;
//! - [`cholesky`]: factors scaled to unit diagonal, with jitter;
//! - [`information`]: from an information matrix to a covariance, undetermined directions said;
//! - [`noise`]: white noise plus an Ornstein-Uhlenbeck process, and the filter that whitens it;
//! - [`pattern`]: pattern search for few unknowns without derivatives;
//! - [`parallel`]: maps on all cores, results in order;
//! - [`statistics`]: medians, robust levels, tests of whiteness, quantiles.
//!
//! Why not a library (looked at in 2026, nalgebra 0.35 here):
//! - `levenberg-marquardt` 0.15 (MINPACK's algorithm): on nalgebra 0.34; vectors of parameters only, no bounds, no
//!   stopping by the Newton decrement, and it wants the whole Jacobian where a frame has 10⁵ rows and 9 columns.
//! - `argmin` 0.11 (argmin-math 0.5): Gauss–Newton without damping, no Levenberg–Marquardt; nalgebra up to 0.34.
//! - `tiny-solver` 0.18 and `factrs` 0.3: on nalgebra 0.34 and faer; sparse factor graphs of many small blocks, where
//!   ours are one dense block of 3 to 40 unknowns, mostly without allocation.
//! - `num-dual` 0.15 for `hydroline_sim::dual`: on nalgebra 0.35 and the same derivatives to the last digit, but 1.8 to
//!   2.6 times slower over a trajectory (4, 7 and 16 directions): every number says by an `Option` whether it has any.
//!
//! ```
//! use hydroline_numerics::{cholesky::ScaledCholesky, statistics::median};
//! use nalgebra::{Matrix2, Vector2};
//!
//! let factor = ScaledCholesky::new(&Matrix2::new(4.0, 1.0, 1.0, 3.0), 0.0).ok_or("not positive definite")?;
//! let x = factor.solve(&Vector2::new(6.0, 7.0));
//! assert!((x - Vector2::new(1.0, 2.0)).norm() < 1e-12);
//! assert_eq!(median(&mut [3.0, 1.0, 2.0]), Some(2.0));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod apart;
pub mod cancel;
pub mod cholesky;
pub mod information;
pub mod least_squares;
pub mod noise;
pub mod outliers;
pub mod parallel;
pub mod pattern;
pub mod span;
pub mod statistics;
