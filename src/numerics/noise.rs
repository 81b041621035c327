//! Measurement noise with its colour: white noise plus an Ornstein-Uhlenbeck process.
//!
//! The residual series of a channel is filtered by the Kalman filter of that noise; what comes
//! out (innovations over their sd) is white when the model is right. The filter is linear, so
//! the columns of the Jacobian go through the same one: generalised least squares in O(n), with
//! gaps, uneven stamps and outliers (a rejected sample updates nothing).
//! Reference: Jazwinski 1970, ch. 7; Harvey 1989, section 3.4 (prediction error decomposition).

mod estimate;

pub use estimate::{OUTLIER_SD, Series, estimate, mask, whitened_correlogram};

/// White noise plus an Ornstein-Uhlenbeck process, in the unit of what is measured.
#[derive(
    Debug, Clone, Copy, PartialEq, serde::Serialize, schemars::JsonSchema, serde::Deserialize,
)]
pub struct Noise {
    /// White part.
    pub white_sd: f64,
    /// Correlated part; 0 = none.
    pub coloured_sd: f64,
    /// Correlation time e^-1 of the correlated part \[s\].
    pub correlation_s: f64,
}

impl Noise {
    /// White only.
    pub fn white(sd: f64) -> Self {
        Noise {
            white_sd: sd,
            coloured_sd: 0.0,
            correlation_s: 0.0,
        }
    }

    /// The same noise in another unit, or of samples that are this much worse.
    #[must_use]
    pub fn times(self, factor: f64) -> Self {
        Noise {
            white_sd: factor * self.white_sd,
            coloured_sd: factor * self.coloured_sd,
            ..self
        }
    }

    /// sd of one sample.
    pub fn total_sd(&self) -> f64 {
        self.white_sd.hypot(self.coloured_sd)
    }
}

/// The whitening filter of one series: fixed stamps, noise and rejected samples.
#[derive(Debug, Clone, Default)]
pub struct Whitener {
    /// (decay since the sample before, gain, 1 / sd of the innovation); gain and the last 0 where rejected or missing.
    steps: Vec<(f64, f64, f64)>,
}

impl Whitener {
    /// For samples at `times_s`; `used` says which count.
    pub fn new(times_s: &[f64], noise: Noise, used: impl Fn(usize) -> bool) -> Self {
        let (white, ou) = (noise.white_sd.powi(2), noise.coloured_sd.powi(2));
        let (mut variance, mut last_s) = (ou, f64::NAN);
        let steps = times_s.iter().enumerate().map(|(k, &t_s)| {
            let decay = if ou > 0.0 && last_s.is_finite() {
                (-(t_s - last_s) / noise.correlation_s).exp()
            } else {
                0.0
            };
            last_s = t_s;
            variance = ou + decay * decay * (variance - ou);
            if !used(k) {
                return (decay, 0.0, 0.0);
            }
            let total = variance + white;
            let gain = variance / total;
            variance -= gain * variance;
            (decay, gain, 1.0 / total.sqrt())
        });
        Whitener {
            steps: steps.collect(),
        }
    }

    /// Filters a series in place; rejected samples become 0.
    pub fn apply<'a>(&self, series: impl Iterator<Item = &'a mut f64>) {
        let mut state = 0.0;
        for (value, (decay, gain, inverse_sd)) in series.zip(&self.steps) {
            state *= decay;
            if *inverse_sd == 0.0 {
                *value = 0.0;
                continue;
            }
            let innovation = *value - state;
            state += gain * innovation;
            *value = innovation * inverse_sd;
        }
    }

    /// Samples that count.
    pub fn used(&self) -> usize {
        self.steps.iter().filter(|s| s.2 > 0.0).count()
    }

    /// Whether sample k counts.
    pub fn counts(&self, k: usize) -> bool {
        self.steps.get(k).is_some_and(|s| s.2 > 0.0)
    }

    /// Sum of log innovation variances.
    pub fn log_variance(&self) -> f64 {
        self.steps
            .iter()
            .filter(|s| s.2 > 0.0)
            .map(|s| -2.0 * s.2.ln())
            .sum()
    }
}
