//! Fit and prediction, without and with the effects.

use std::collections::BTreeMap;

use serde::Serialize;

/// How runs are predicted of which none is held out, in words.
const BY_THE_OTHERS: &str = "each run by the others";

/// rms per channel, before and after.
#[derive(Debug, Clone, PartialEq, Default, Serialize, schemars::JsonSchema)]
pub struct BeforeAfter {
    /// The vehicle's coefficients refitted, without effects \[SI\].
    pub before: BTreeMap<String, f64>,
    /// With the effects \[SI\].
    pub after: BTreeMap<String, f64>,
    /// Noise of the measurement \[SI\].
    pub noise: BTreeMap<String, f64>,
}

impl BeforeAfter {
    /// Whether it holds no channel.
    pub fn is_empty(&self) -> bool {
        self.before.is_empty()
    }

    /// Channel by channel.
    pub fn rows<'a>(&'a self, by: &'a str) -> impl Iterator<Item = Predicted<'a>> {
        self.before.iter().map(move |(channel, before)| Predicted {
            channel,
            by,
            before: *before,
            after: self.after.get(channel).copied(),
            noise: self.noise.get(channel).copied(),
        })
    }
}

/// A channel of what was predicted, rms \[SI\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Predicted<'a> {
    /// Its name.
    pub channel: &'a str,
    /// How it was predicted, in words.
    pub by: &'a str,
    /// By the vehicle alone, refitted.
    pub before: f64,
    /// With the effects.
    pub after: Option<f64>,
    /// Noise of the measurement.
    pub noise: Option<f64>,
}

/// Fit and prediction of runs that were not fitted.
#[derive(Debug, Clone, PartialEq, Default, Serialize, schemars::JsonSchema)]
pub struct FitTable {
    /// rms of the residuals per channel on the runs fitted.
    pub train: BeforeAfter,
    /// The same on the runs held out, and on frames that were not fitted.
    #[serde(skip_serializing_if = "BeforeAfter::is_empty")]
    pub held_out: BeforeAfter,
    /// Runs or frames that `held_out` is of, in words.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub held_out_by: String,
}

/// Prediction of a run held against what was measured.
#[derive(Debug, Clone, PartialEq, Default, Serialize, schemars::JsonSchema)]
pub struct Predictive {
    /// Log density of its samples, each normal about the prediction with the variance of noise and prediction \[nat\].
    pub log_predictive_density: f64,
    /// rms of what the prediction leaves, per channel \[SI\].
    pub rms: BTreeMap<String, f64>,
}

/// A run as the others predict it.
#[derive(Debug, Clone, PartialEq, Default, Serialize, schemars::JsonSchema)]
pub struct PredictedRun {
    /// Name of the run: its log's, with the window where one was given.
    pub run: String,
    /// Prediction without effects.
    pub before: Predictive,
    /// Prediction with the effects.
    pub after: Predictive,
}

/// Each run as the others predict it, the model refitted without that run.
#[derive(Debug, Clone, PartialEq, Default, Serialize, schemars::JsonSchema)]
pub struct LeaveOneRunOut {
    /// Run by run, in the order of the logs.
    pub runs: Vec<PredictedRun>,
    /// rms over all runs per channel.
    pub rms: BeforeAfter,
}

impl LeaveOneRunOut {
    /// Channel by channel, over all runs.
    pub fn rows(&self) -> impl Iterator<Item = Predicted<'_>> {
        self.rms.rows(BY_THE_OTHERS)
    }
}
