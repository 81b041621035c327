//! Where and how surely the vehicle alone misses the data, and what is wrong with these.

use std::collections::BTreeMap;

use serde::Serialize;

/// Where the mismatch acts.
#[derive(Debug, Clone, PartialEq, Default, Serialize, schemars::JsonSchema)]
pub struct Where {
    /// Stage of the heaviest effect.
    pub stage: Option<String>,
    /// Degrees of freedom in which the model without effects misses by more than its noise.
    pub dof: Vec<String>,
    /// Windows of the first run in which the model without effects misses by more than its noise, and by more than elsewhere where it
    /// misses everywhere \[s since the log's first stamp\].
    pub windows_s: Vec<[f64; 2]>,
    /// The same, run by run.
    pub windows: BTreeMap<String, Vec<[f64; 2]>>,
    /// Windows in which the model with the effects still misses so, run by run \[s since the log's first stamp\].
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub left_windows: BTreeMap<String, Vec<[f64; 2]>>,
    /// The same in words; of frames with the size of the misfit.
    pub regime: String,
}

/// Is there a mismatch at all?
#[derive(Debug, Clone, PartialEq, Default, Serialize, schemars::JsonSchema)]
pub struct Test {
    /// Statistic, in words.
    pub statistic: String,
    /// Its value.
    pub value: f64,
    /// Degrees of freedom.
    pub freedom: f64,
    /// Probability of it without any effect.
    pub p_value: f64,
    /// Ljung-Box p of the whitened residuals that are left, per run.
    pub whiteness_p: Vec<f64>,
    /// Noise per channel \[SI\].
    pub noise_rms: BTreeMap<String, f64>,
}

/// Noise of a channel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, schemars::JsonSchema)]
pub struct NoiseFound {
    /// sd of one sample \[SI\].
    pub sd: f64,
    /// White part \[SI\].
    pub white_sd: f64,
    /// Correlated part \[SI\].
    pub coloured_sd: f64,
    /// Its correlation time; 0 = white \[s\].
    pub correlation_s: f64,
    /// Share of samples discarded as outliers.
    pub outliers: f64,
}

/// Something wrong with the data.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct DataFault {
    /// Kind of fault.
    pub fault: String,
    /// Channel of the measurement that has it.
    pub channel: String,
    /// Run that has it.
    pub run: String,
    /// Evidence, in words.
    pub evidence: String,
    /// Whether it stops the diagnosis.
    pub fatal: bool,
}
