//! Interface of a model to a fit: predictions at the stamps, and their derivatives.

use nalgebra::DMatrix;

/// A free number of a fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Free {
    /// Name in results.
    pub name: String,
    /// Where the search starts.
    pub start: f64,
    /// Smallest value allowed.
    pub low: f64,
    /// Largest value allowed.
    pub high: f64,
}

/// Failure of a prediction; a search treats it as infinitely bad.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("run {run}: {reason}")]
pub struct ForwardError {
    /// Index of the run.
    pub run: usize,
    /// Reason that the integrator gives.
    pub reason: String,
}

/// Unknowns and measurements of all runs.
#[derive(Debug, Default)]
pub struct Observed {
    /// Unknowns shared by all runs.
    pub globals: Vec<Free>,
    /// Name of each slot.
    pub slots: Vec<String>,
    /// Unknowns and measurements of each run.
    pub runs: Vec<ObservedRun>,
}

/// Unknowns and measurements of one run.
#[derive(Debug, Default)]
pub struct ObservedRun {
    /// Stamps \[s\].
    pub times_s: Vec<f64>,
    /// Measurements in the order of predictions; NaN = none.
    pub measured: Vec<f64>,
    /// The run's own unknowns.
    pub locals: Vec<Free>,
}

/// Motion of several runs as a function of coefficients (`globals`) and of each run's own unknowns (`locals`).
///
/// A run's parameters are `globals` followed by its `locals`. Predictions are sample-major:
/// sample k, slot c at `k * slots + c`. A slot is a channel.
pub trait Forward: Sync {
    /// Unknowns and measurements.
    fn observed(&self) -> &Observed;
    /// Shared by all runs.
    fn globals(&self) -> &[Free] {
        &self.observed().globals
    }
    /// Number of runs.
    fn runs(&self) -> usize {
        self.observed().runs.len()
    }
    /// A run's own unknowns.
    fn locals(&self, run: usize) -> &[Free] {
        &self.observed().runs[run].locals
    }
    /// Name of each slot.
    fn slots(&self) -> &[String] {
        &self.observed().slots
    }
    /// Stamps \[s\].
    fn times_s(&self, run: usize) -> &[f64] {
        &self.observed().runs[run].times_s
    }
    /// Measurements in the order of predictions; NaN = none.
    fn measured(&self, run: usize) -> &[f64] {
        &self.observed().runs[run].measured
    }
    /// Fills `out` with a run's predictions.
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
}
