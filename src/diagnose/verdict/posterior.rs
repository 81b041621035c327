//! Models of the posterior, with what draws from them need.

use serde::Serialize;

/// A model with its probability and the joint posterior of its numbers.
#[derive(Debug, Clone, PartialEq, Default, Serialize, schemars::JsonSchema)]
pub struct PosteriorModel {
    /// Posterior probability.
    pub probability: f64,
    /// Its effects as `[[physics]]` tables of a rig, at their most probable numbers (TOML).
    pub physics: String,
    /// Names of the numbers below: coefficients, and `PLACE.PARAMETER` of the table at that place of `physics`, counted from 1.
    pub numbers: Vec<String>,
    /// Most probable values, SI.
    pub values: Vec<f64>,
    /// Whether the logarithm of a number's size is normal, its sign fixed; else the number itself is.
    pub logarithmic: Vec<bool>,
    /// Covariance of the numbers, of their logarithms where those are normal: one row each. Tables and starts of the runs are integrated out.
    pub covariance: Vec<Vec<f64>>,
}
