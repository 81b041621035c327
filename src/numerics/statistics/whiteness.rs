//! Is a series white, and do two series have the same colour?

use super::chi2_above;

/// Result of a test of whiteness.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, schemars::JsonSchema)]
pub struct Whiteness {
    /// Ljung-Box statistic.
    pub statistic: f64,
    /// Lags summed = degrees of freedom.
    pub lags: usize,
    /// Probability of a larger statistic from white noise.
    pub p_value: f64,
    /// Correlation of neighbours.
    pub lag1: f64,
    /// Number of samples.
    pub count: usize,
}

/// Ljung-Box test of a series (Biometrika 65, 1978): Q = n (n+2) sum r_k^2 / (n-k), chi-square with `lags`.
///
/// NaN counts as missing: a pair with a missing member does not enter.
pub fn ljung_box(series: &[f64], lags: usize) -> Option<Whiteness> {
    let count = series.iter().filter(|v| v.is_finite()).count();
    if count < 3 * lags.max(1) {
        return None;
    }
    let n = count as f64;
    let mean = series.iter().filter(|v| v.is_finite()).sum::<f64>() / n;
    let centred: Vec<f64> = series
        .iter()
        .map(|v| if v.is_finite() { v - mean } else { 0.0 })
        .collect();
    let energy: f64 = centred.iter().map(|v| v * v).sum();
    if energy <= 0.0 {
        return None;
    }
    let correlation = |k: usize| {
        centred
            .iter()
            .zip(&centred[k..])
            .map(|(a, b)| a * b)
            .sum::<f64>()
            / energy
    };
    let statistic = n
        * (n + 2.0)
        * (1..=lags)
            .map(|k| correlation(k).powi(2) / (n - k as f64))
            .sum::<f64>();
    Some(Whiteness {
        statistic,
        lags,
        p_value: chi2_above(statistic, lags as f64),
        lag1: correlation(1),
        count,
    })
}

/// Lags of every test of whiteness and colour.
pub const LAGS: usize = 20;

/// Autocorrelations of what is left of a noise when its colour was taken out.
#[derive(
    Debug, Clone, PartialEq, Default, serde::Serialize, schemars::JsonSchema, serde::Deserialize,
)]
pub struct Correlogram {
    /// At lags 1, 2, ...
    pub correlations: Vec<f64>,
    /// Samples they come from.
    pub samples: usize,
    /// Their variance.
    pub variance: f64,
}

impl Correlogram {
    /// Of several series of one process, each about its own mean; NaN = missing.
    pub fn of(series: &[Vec<f64>], lags: usize) -> Option<Correlogram> {
        let (mut energy, mut samples) = (0.0, 0usize);
        let mut products = vec![0.0; lags];
        for values in series {
            let count = values.iter().filter(|v| v.is_finite()).count();
            let mean = values.iter().filter(|v| v.is_finite()).sum::<f64>() / count.max(1) as f64;
            let about: Vec<f64> = values
                .iter()
                .map(|v| if v.is_finite() { v - mean } else { 0.0 })
                .collect();
            samples += count;
            energy += about.iter().map(|v| v * v).sum::<f64>();
            for (k, product) in products.iter_mut().enumerate() {
                *product += about
                    .iter()
                    .zip(about.iter().skip(k + 1))
                    .map(|(a, b)| a * b)
                    .sum::<f64>();
            }
        }
        (samples >= 3 * lags.max(1) && energy > 0.0).then(|| Correlogram {
            correlations: products.into_iter().map(|p| p / energy).collect(),
            samples,
            variance: energy / samples as f64,
        })
    }

    /// Whether another series that went through the same filter has the same autocorrelations: the sum of
    /// squared differences over their variances (Bartlett: (n - k) / (n (n + 2)) each for nearly white series),
    /// chi-square with as many degrees of freedom as lags.
    ///
    /// Correlation that the filter leaves because its numbers are estimates is the same in both: it drops out of the
    /// difference, where a test of one series against white noise would call it a misfit.
    pub fn against(&self, other: &Correlogram) -> Option<Whiteness> {
        let lags = self.correlations.len().min(other.correlations.len());
        let variance = |of: &Correlogram, k: usize| {
            let n = of.samples as f64;
            (n - k as f64) / (n * (n + 2.0))
        };
        let statistic = (0..lags)
            .map(|i| {
                let difference = self.correlations[i] - other.correlations[i];
                difference.powi(2) / (variance(self, i + 1) + variance(other, i + 1))
            })
            .sum::<f64>();
        (lags > 0).then(|| Whiteness {
            statistic,
            lags,
            p_value: chi2_above(statistic, lags as f64),
            lag1: self.correlations[0],
            count: self.samples,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{SeedableRng, rngs::StdRng};
    use rand_distr::{Distribution, StandardNormal};

    fn white(seed: u64, n: usize) -> Vec<f64> {
        let mut rng = StdRng::seed_from_u64(seed);
        (0..n).map(|_| StandardNormal.sample(&mut rng)).collect()
    }

    #[test]
    fn ljung_box_keeps_its_level_and_finds_colour() {
        let rejected = (0..400)
            .filter(|s| ljung_box(&white(*s, 300), 20).unwrap().p_value < 0.05)
            .count();
        assert!((8..=35).contains(&rejected), "{rejected} of 400 at 5 %");
        let mut coloured = white(7, 600);
        for i in 1..coloured.len() {
            coloured[i] += 0.5 * coloured[i - 1];
        }
        assert!(ljung_box(&coloured, 20).unwrap().p_value < 1e-9);
        assert!(ljung_box(&[1.0; 10], 20).is_none());
    }

    #[test]
    fn two_series_of_one_filter_differ_by_chance_only() {
        // Both keep a correlation of 0.1 that a filter has left: white they are not, alike they are.
        let left = |seed: u64, n: usize| -> Vec<f64> {
            let e = white(seed, n + 1);
            (0..n).map(|i| e[i + 1] + 0.1 * e[i]).collect()
        };
        let (mut apart, mut alike_called_different) = (0, 0);
        for seed in 0..400 {
            let a = Correlogram::of(&[left(2 * seed, 900)], LAGS).unwrap();
            let b = Correlogram::of(&[left(2 * seed + 1, 500)], LAGS).unwrap();
            alike_called_different += usize::from(a.against(&b).unwrap().p_value < 0.05);
            let other = Correlogram::of(&[white(9000 + seed, 500)], LAGS).unwrap();
            apart += usize::from(a.against(&other).unwrap().p_value < 0.05);
        }
        assert!(
            (8..=35).contains(&alike_called_different),
            "{alike_called_different} of 400 at 5 %"
        );
        assert!(apart > alike_called_different, "{apart}");
    }
}
