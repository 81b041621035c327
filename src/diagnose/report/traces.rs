//! Traces of the figures: each run measured, and as the model has it without and with the effects.

/// A channel in the report's figures.
#[derive(Debug, Clone)]
pub struct Shown {
    /// Its name.
    pub channel: String,
    /// Noise of a sample \[SI\].
    pub noise_sd: f64,
    /// Runs predicted, only their starts fitted.
    pub predicted: Runs,
    /// Runs fitted.
    pub fitted: Vec<Trace>,
}

/// Runs that neither model was fitted to.
#[derive(Debug, Clone)]
pub enum Runs {
    /// Those that were held out.
    HeldOut(Vec<Trace>),
    /// Each run, by coefficients and effects fitted to the others.
    ByTheOthers(Vec<Trace>),
    /// None: of one run none can be.
    None,
}

/// One run under both models.
#[derive(Debug, Clone)]
pub struct Trace {
    /// The run.
    pub name: String,
    /// Stamps \[s\].
    pub times_s: Vec<f64>,
    /// (time, load) of the commands in its DOF \[s; N, N m\].
    pub edges: Vec<(f64, f64)>,
    /// Measured; NaN = not \[SI\].
    pub measured: Vec<f64>,
    /// Without effects \[SI\].
    pub before: Vec<f64>,
    /// With them \[SI\].
    pub after: Vec<f64>,
    /// Samples that are no outliers.
    pub used: Vec<bool>,
}

impl Trace {
    /// Measured minus model, outliers as NaN; \[m, rad\].
    pub fn residual(&self, model: &[f64]) -> Vec<f64> {
        self.measured
            .iter()
            .zip(model)
            .zip(&self.used)
            .map(|((m, v), used)| if *used { m - v } else { f64::NAN })
            .collect()
    }

    /// Outliers: (time, measured minus the model with effects).
    pub fn outliers(&self) -> Vec<(f64, f64)> {
        self.times_s
            .iter()
            .zip(self.measured.iter().zip(&self.after))
            .zip(&self.used)
            .filter(|((_, (m, _)), used)| !**used && m.is_finite())
            .map(|((t, (m, v)), _)| (*t, m - v))
            .collect()
    }

    /// rms without and with effects.
    pub fn rms(&self) -> (f64, f64) {
        let of = |model: &[f64]| {
            let r: Vec<f64> = self
                .residual(model)
                .into_iter()
                .filter(|v| v.is_finite())
                .collect();
            (r.iter().map(|v| v * v).sum::<f64>() / r.len().max(1) as f64).sqrt()
        };
        (of(&self.before), of(&self.after))
    }
}
