//! Recorded runs of one body to models with their probabilities: one likelihood, one prior table, one score, one search.
//!
//! `recording` (all measured channels of all runs) -> `given` (what of them drives instead of being explained, by `smooth`) -> `body` (Eq. 1 with every effect's states, by duals) -> `filter`
//! (noise of the instruments and a random force per DOF, integrated out) -> `fit` (the mode and its log evidence) ->
//! `search` (moves between models) -> `posterior` (marginals).
//!
//! Nothing here knows a single effect: laws, ranges and stages come from `sim`'s registry.
//! Nothing here reads a file or prints.
//!
//! ```
//! use hydroline_inference::prior::Density;
//!
//! // Beforehand, a number one standard deviation off is less likely by half a nat.
//! let prior = Density::normal(0.0, 2.0);
//! assert!((prior.ln(0.0) - prior.ln(2.0) - 0.5).abs() < 1e-12);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

// Tests may unwrap; the crate itself must not.
#![cfg_attr(test, allow(clippy::unwrap_used))]

pub mod at_rest;
pub mod body;
pub mod by_prediction;
pub mod clock;
pub mod closed;
pub mod coarse;
mod equations;
pub mod filter;
pub mod fit;
pub mod given;
pub mod hyper;
pub mod limit;
pub mod model_test;
pub mod noise;
pub mod number_prior;
pub mod planned;
pub mod plausible;
pub mod posterior;
pub mod predicted_gain;
pub mod prediction;
pub mod predictive_check;
pub mod prior;
pub mod recording;
pub mod search;
pub mod separation;
pub mod size;
pub mod smooth;
pub mod summary;
pub mod table;
mod tables;
pub mod term;

#[cfg(test)]
#[path = "tests/unit/mod.rs"]
mod tests;
