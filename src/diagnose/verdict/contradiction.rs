//! Runs held out that a verdict does not predict.

use serde::Serialize;

/// A channel of a run held out whose prediction misses by more than the band that the likeliest model states for it.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Contradiction {
    /// Name of the run: its log's, with the window where one was given.
    pub log: String,
    /// Channel of the measurement.
    pub channel: String,
    /// rms of measured minus predicted \[SI\].
    pub rms: f64,
    /// rms to expect of the noise, of what the model's numbers leave open and of a random force that the verdict names \[SI\].
    pub band: f64,
    /// Probability of an rms as large if the model is right.
    pub p_value: f64,
    /// Loads, speeds, frequencies and places that this run has and those fitted lack, in words.
    pub outside: String,
}
