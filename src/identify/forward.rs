//! What a fit needs of a model: predictions at the stamps, and their derivatives.

use nalgebra::DMatrix;

use super::parameter::Free;

/// Why a prediction failed; a search treats it as infinitely bad.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("run {run}: {reason}")]
pub struct ForwardError {
    /// Run.
    pub run: usize,
    /// What the integrator says.
    pub reason: String,
}

/// Motion of several runs as a function of coefficients (`globals`) and of each run's own unknowns (`locals`).
///
/// A run's parameters are `globals` followed by its `locals`. Predictions are sample-major:
/// sample k, slot c at `k * slots + c`. A slot is a channel, or a combination of channels that
/// the measurement's covariance leaves uncorrelated (then in units of its sd).
pub trait Forward: Sync {
    /// Shared by all runs.
    fn globals(&self) -> &[Free];
    /// Number of runs.
    fn runs(&self) -> usize;
    /// A run's own unknowns.
    fn locals(&self, run: usize) -> &[Free];
    /// Name of each slot.
    fn slots(&self) -> &[String];
    /// Stamps \[s\].
    fn times_s(&self, run: usize) -> &[f64];
    /// Measurements in the order of predictions; NaN = none.
    fn measured(&self, run: usize) -> &[f64];
    /// sd of each measurement as the log says it, in the order of predictions; NaN = not said.
    /// Empty where the log says none at all, or where the slots are in units of it already.
    fn logged_sd(&self, _run: usize) -> &[f64] {
        &[]
    }
    /// Predictions.
    ///
    /// # Errors
    /// [`ForwardError`] when the motion diverges.
    fn values(
        &self,
        run: usize,
        parameters: &[f64],
        out: &mut Vec<f64>,
    ) -> Result<(), ForwardError>;
    /// Predictions and their derivatives (row = prediction, column = parameter of the run).
    ///
    /// # Errors
    /// As [`Forward::values`].
    fn sensitivities(
        &self,
        run: usize,
        parameters: &[f64],
        out: &mut Vec<f64>,
    ) -> Result<DMatrix<f64>, ForwardError>;
    /// Predictions of the physical channels: (name, measured, predicted) over the stamps.
    ///
    /// # Errors
    /// As [`Forward::values`].
    fn channels(&self, run: usize, parameters: &[f64]) -> Result<Vec<ChannelSeries>, ForwardError>;
}

/// One measured channel of one run beside its prediction.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelSeries {
    /// Name, SI unit in it.
    pub name: String,
    /// Measured; NaN = not.
    pub measured: Vec<f64>,
    /// Predicted.
    pub predicted: Vec<f64>,
}

impl ChannelSeries {
    /// rms of measured - predicted over what was measured.
    pub fn rms(&self) -> f64 {
        let pairs = self
            .measured
            .iter()
            .zip(&self.predicted)
            .map(|(m, p)| m - p)
            .filter(|d| d.is_finite());
        let (sum, n) = pairs.fold((0.0, 0usize), |(s, n), d| (s + d * d, n + 1));
        (sum / n.max(1) as f64).sqrt()
    }
}
