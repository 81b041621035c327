//! The noise of a channel as stretches at rest show it.

use hydroline_numerics::noise::{Noise, Series, estimate, mask, whitened_correlogram};
use hydroline_numerics::statistics::{Correlogram, median};

/// Noise of one channel as a stretch at rest measured it.
#[derive(Debug, Clone, PartialEq, serde::Serialize, schemars::JsonSchema, serde::Deserialize)]
pub struct RestNoise {
    /// Level and colour, SI.
    #[serde(flatten)]
    pub noise: Noise,
    /// Share of samples that were outliers.
    pub outliers: f64,
    /// Correlogram of the stretch itself when this colour is taken out, for comparison with residuals.
    #[serde(default)]
    pub left: Option<Correlogram>,
    /// The logged sd that the level belongs to, SI; `None` = the log said none.
    #[serde(default)]
    pub logged_sd: Option<f64>,
    /// Stretches it was measured on; empty = only the figures above were stored.
    #[serde(skip)]
    pub stretches: Vec<Stretch>,
}

/// Stamps \[s\] and deviations of a stretch at rest; NaN = missing.
pub type Stretch = (Vec<f64>, Vec<f64>);

impl RestNoise {
    /// Correlogram of the stretches when another colour than their own is taken out; of figures alone the stored one.
    pub fn left_of(&self, noise: Noise) -> Option<Correlogram> {
        if self.stretches.is_empty() {
            return self.left.clone();
        }
        let views: Vec<Series<'_>> = self.stretches.iter().map(series).collect();
        whitened_correlogram(&views, noise, &mask(&views, noise))
    }
}

/// A stretch at rest as residuals that nothing was fitted to.
pub fn series((times_s, values): &Stretch) -> Series<'_> {
    Series::new(times_s, values)
}

/// A stretch at rest of samples (stamp \[s\], value, factor): deviations from the median, times the factor.
pub fn about_median(samples: &[(f64, f64, f64)]) -> Stretch {
    let mut present: Vec<f64> = samples
        .iter()
        .map(|s| s.1)
        .filter(|v| v.is_finite())
        .collect();
    let middle = median(&mut present).unwrap_or(0.0);
    let away = |(t_s, value, factor): &(f64, f64, f64)| (*t_s, (value - middle) * factor);
    samples.iter().map(away).unzip()
}

/// Noise of one channel from stretches at rest.
pub fn at_rest(stretches: Vec<Stretch>, logged_sd: Option<f64>) -> Option<RestNoise> {
    let views: Vec<Series<'_>> = stretches.iter().map(series).collect();
    let (noise, used) = estimate(&views)?;
    let kept = used.iter().flatten().filter(|u| **u).count();
    let values = stretches.iter().flat_map(|s| &s.1);
    let present = values.filter(|v| v.is_finite()).count();
    Some(RestNoise {
        noise,
        outliers: 1.0 - kept as f64 / present.max(1) as f64,
        left: whitened_correlogram(&views, noise, &used),
        logged_sd,
        stretches,
    })
}
