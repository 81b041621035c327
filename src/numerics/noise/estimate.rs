//! The noise of residual series: maximum likelihood of level and colour, and which samples are outliers.

use nalgebra::{DMatrix, DVector};

use super::{Noise, Whitener};
use crate::cholesky::ScaledCholesky;
use crate::statistics::{Correlogram, LAGS, robust_sd};

/// A sample further from its prediction than this many sd is an outlier: 7e-6 of normal ones are.
pub const OUTLIER_SD: f64 = 4.5;
/// More rejected than this share: it is the model that is wrong, nothing is rejected.
const OUTLIERS_MAX: f64 = 0.2;
/// Twice the gain in log-likelihood that two more parameters must bring (chi-square with 2 at 5 %).
const COLOUR_GAIN: f64 = 6.0;
/// On the diagonal of the whitened information matrix: its entries are sums over some thousand samples, good to ε n.
const JITTER: f64 = 1e-12;

/// A residual series (NaN = missing) with its stamps.
#[derive(Debug, Clone, Copy)]
pub struct Series<'a> {
    /// Stamps \[s\].
    pub times_s: &'a [f64],
    /// Residuals at the stamps; NaN = missing.
    pub values: &'a [f64],
    /// Their derivatives with respect to everything that was fitted (all columns of the problem).
    /// With them the likelihood is the restricted one (REML, Patterson and Thompson 1971): what the
    /// fit took out of the residuals, above all of slow noise, is put back.
    pub jacobian: Option<&'a DMatrix<f64>>,
}

impl<'a> Series<'a> {
    /// Of values that nothing was fitted to.
    pub fn new(times_s: &'a [f64], values: &'a [f64]) -> Self {
        Series {
            times_s,
            values,
            jacobian: None,
        }
    }

    /// The values through a filter; what is not finite is not used by it and counts as zero.
    fn whitened(&self, filter: &Whitener) -> Vec<f64> {
        let finite = |v: &f64| if v.is_finite() { *v } else { 0.0 };
        let mut values: Vec<f64> = self.values.iter().map(finite).collect();
        filter.apply(values.iter_mut());
        values
    }
}

/// Noise of several series of the same channel, and which of their samples are outliers.
///
/// The white level starts from the median absolute residual; colour is kept when it gains more
/// than [`COLOUR_GAIN`] in twice the log-likelihood. `None` when fewer than 8 samples.
pub fn estimate(series: &[Series<'_>]) -> Option<(Noise, Vec<Vec<bool>>)> {
    let present: Vec<f64> = series
        .iter()
        .flat_map(|s| s.values)
        .copied()
        .filter(|v| v.is_finite())
        .collect();
    if present.len() < 8 {
        return None;
    }
    let robust = robust_sd(&present);
    let plain = (present.iter().map(|v| v * v).sum::<f64>() / present.len() as f64).sqrt();
    let mut noise = Noise::white(if robust > 0.0 { robust } else { plain });
    if noise.white_sd <= 0.0 {
        return None;
    }
    let mut used = mask(series, noise);
    for _ in 0..4 {
        noise = likeliest(series, &used)?;
        let next = mask(series, noise);
        if next == used {
            break;
        }
        used = next;
    }
    Some((noise, used))
}

/// Autocorrelations of what is left of series when a noise's colour is taken out.
pub fn whitened_correlogram(
    series: &[Series<'_>],
    noise: Noise,
    used: &[Vec<bool>],
) -> Option<Correlogram> {
    let innovations: Vec<Vec<f64>> = series
        .iter()
        .zip(used)
        .map(|(s, used)| {
            let filter = Whitener::new(s.times_s, noise, |k| used[k]);
            let values = s.whitened(&filter);
            (0..values.len())
                .map(|k| if used[k] { values[k] } else { f64::NAN })
                .collect()
        })
        .collect();
    Correlogram::of(&innovations, LAGS)
}

/// Samples that are neither missing nor outliers of this noise.
pub fn mask(series: &[Series<'_>], noise: Noise) -> Vec<Vec<bool>> {
    let (white, ou) = (noise.white_sd.powi(2), noise.coloured_sd.powi(2));
    let mut rejected = 0;
    let flags = |s: &Series<'_>| -> Vec<bool> {
        let (mut state, mut variance, mut last_s) = (0.0, ou, f64::NAN);
        s.times_s
            .iter()
            .zip(s.values)
            .map(|(t_s, value)| {
                let decay = if ou > 0.0 && last_s.is_finite() {
                    (-(t_s - last_s) / noise.correlation_s).exp()
                } else {
                    0.0
                };
                last_s = *t_s;
                state *= decay;
                variance = ou + decay * decay * (variance - ou);
                let innovation = value - state;
                let total = variance + white;
                if !innovation.is_finite() || innovation.abs() > OUTLIER_SD * total.sqrt() {
                    rejected += usize::from(innovation.is_finite());
                    return false;
                }
                let gain = variance / total;
                state += gain * innovation;
                variance -= gain * variance;
                true
            })
            .collect()
    };
    let flags: Vec<Vec<bool>> = series.iter().map(flags).collect();
    let present: usize = series
        .iter()
        .flat_map(|s| s.values)
        .filter(|v| v.is_finite())
        .count();
    if rejected as f64 > OUTLIERS_MAX * present as f64 {
        return series
            .iter()
            .map(|s| s.values.iter().map(|v| v.is_finite()).collect())
            .collect();
    }
    flags
}

/// Maximum likelihood over share and time of the coloured part; the level follows in closed form.
fn likeliest(series: &[Series<'_>], used: &[Vec<bool>]) -> Option<Noise> {
    // (twice the negative log-likelihood, white sd) at a ratio of variances and a correlation time.
    let deviance = |ratio: f64, correlation_s: f64| -> Option<(f64, f64)> {
        let unit = Noise {
            white_sd: 1.0,
            coloured_sd: ratio.sqrt(),
            correlation_s,
        };
        let (mut energy, mut logs, mut n) = (0.0, 0.0, 0usize);
        let mut fitted: Option<(DVector<f64>, DMatrix<f64>)> = None;
        for (s, used) in series.iter().zip(used) {
            let filter = Whitener::new(s.times_s, unit, |k| used[k]);
            let values = s.whitened(&filter);
            energy += values.iter().map(|v| v * v).sum::<f64>();
            logs += filter.log_variance();
            n += filter.used();
            if let Some(jacobian) = s.jacobian {
                let columns = jacobian.ncols();
                let (gradient, hessian) = fitted.get_or_insert_with(|| {
                    (DVector::zeros(columns), DMatrix::zeros(columns, columns))
                });
                let mut whitened = jacobian.clone();
                // Columns of other runs' own unknowns are empty here.
                let busy: Vec<usize> = (0..columns)
                    .filter(|c| jacobian.column(*c).iter().any(|v| *v != 0.0))
                    .collect();
                for c in &busy {
                    filter.apply(whitened.column_mut(*c).iter_mut());
                }
                for (a, ca) in busy.iter().enumerate() {
                    gradient[*ca] += whitened
                        .column(*ca)
                        .iter()
                        .zip(&values)
                        .map(|(j, v)| j * v)
                        .sum::<f64>();
                    for cb in &busy[..=a] {
                        let product = whitened.column(*ca).dot(&whitened.column(*cb));
                        hessian[(*ca, *cb)] += product;
                        if ca != cb {
                            hessian[(*cb, *ca)] += product;
                        }
                    }
                }
            }
        }
        let mut freedom = n as f64;
        if let Some((gradient, hessian)) = fitted {
            let p = gradient.len();
            // A direction without information leaves the likelihood the plain one.
            if let Some(root) = ScaledCholesky::new(&hessian, JITTER).filter(|_| n > 2 * p) {
                energy -= root.squared_norm(&gradient);
                logs += root.ln_determinant();
                freedom -= p as f64;
            }
        }
        let variance = energy / freedom.max(1.0);
        (variance > 0.0).then(|| (freedom * variance.ln() + logs, variance.sqrt()))
    };
    let (white_deviance, white_sd) = deviance(0.0, 1.0)?;
    let interval_s = series
        .iter()
        .flat_map(|s| s.times_s.windows(2))
        .map(|w| w[1] - w[0])
        .fold(f64::INFINITY, f64::min);
    let span_s = series
        .iter()
        .filter_map(|s| Some(s.times_s.last()? - s.times_s.first()?))
        .fold(0.0, f64::max);
    let (low, high) = (0.5 * interval_s, 0.25 * span_s);
    if !(low > 0.0 && high > 2.0 * low) {
        return Some(Noise::white(white_sd));
    }
    let mut best = (white_deviance, 0.0, 1.0, white_sd);
    let look = |log_ratio: f64, log_time: f64, best: &mut (f64, f64, f64, f64)| {
        let (ratio, time_s) = (log_ratio.exp(), log_time.exp().clamp(low, high));
        if let Some((d, sd)) = deviance(ratio, time_s).filter(|(d, _)| *d < best.0) {
            *best = (d, ratio, time_s, sd);
        }
    };
    for i in 0..6 {
        let log_time = low.ln() + (high / low).ln() * (f64::from(i) + 0.5) / 6.0;
        for j in 0..7 {
            look(0.01_f64.ln() + f64::from(j) * 1.6, log_time, &mut best);
        }
    }
    if best.1 > 0.0 {
        // Pattern search about the best grid point; steps halve to 2 %.
        let mut step = 0.8;
        while step > 0.02 {
            let before = best.0;
            let (r, t) = (best.1.ln(), best.2.ln());
            for (dr, dt) in [
                (step, 0.0),
                (-step, 0.0),
                (0.0, step),
                (0.0, -step),
                (step, -step),
                (-step, step),
            ] {
                look(r + dr, t + dt, &mut best);
            }
            if best.0 >= before - 1e-3 {
                step *= 0.5;
            }
        }
    }
    let (d, ratio, correlation_s, sd) = best;
    if ratio == 0.0 || white_deviance - d < COLOUR_GAIN {
        return Some(Noise::white(white_sd));
    }
    Some(Noise {
        white_sd: sd,
        coloured_sd: sd * ratio.sqrt(),
        correlation_s,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{SeedableRng, rngs::StdRng};
    use rand_distr::{Distribution, StandardNormal};

    fn draw(seed: u64, n: usize, interval_s: f64, noise: Noise) -> Vec<f64> {
        let mut rng = StdRng::seed_from_u64(seed);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let decay = (-interval_s / noise.correlation_s.max(1e-9)).exp();
        let mut state = noise.coloured_sd * normal();
        (0..n)
            .map(|_| {
                state = decay * state + noise.coloured_sd * (1.0 - decay * decay).sqrt() * normal();
                state + noise.white_sd * normal()
            })
            .collect()
    }

    #[test]
    fn colour_and_outliers_are_found() {
        let truth = Noise {
            white_sd: 1.0,
            coloured_sd: 1.5,
            correlation_s: 0.6,
        };
        let times: Vec<f64> = (0..2400).map(|k| 0.04 * f64::from(k)).collect();
        let mut values = draw(3, 2400, 0.04, truth);
        for k in (50..2400).step_by(97) {
            values[k] += 30.0;
        }
        values[777] = f64::NAN;
        let (noise, used) = estimate(&[Series {
            times_s: &times,
            values: &values,
            jacobian: None,
        }])
        .unwrap();
        assert!((noise.white_sd - 1.0).abs() < 0.1, "{noise:?}");
        assert!((noise.coloured_sd - 1.5).abs() < 0.25, "{noise:?}");
        assert!((noise.correlation_s - 0.6).abs() < 0.2, "{noise:?}");
        assert!((50..2400).step_by(97).all(|k| !used[0][k]) && !used[0][777]);
        assert!(used[0].iter().filter(|u| !**u).count() < 30);
    }

    #[test]
    fn white_noise_mostly_stays_white_and_the_filter_whitens_colour() {
        let times: Vec<f64> = (0..600).map(|k| 0.04 * f64::from(k)).collect();
        let coloured = (0..60)
            .filter(|seed| {
                let values = draw(*seed, 600, 0.04, Noise::white(2.0));
                estimate(&[Series {
                    times_s: &times,
                    values: &values,
                    jacobian: None,
                }])
                .unwrap()
                .0
                .coloured_sd
                    > 0.0
            })
            .count();
        assert!(
            coloured <= 9,
            "{coloured} of 60 white series called coloured"
        );
        let truth = Noise {
            white_sd: 0.5,
            coloured_sd: 1.0,
            correlation_s: 0.3,
        };
        let mut values = draw(5, 600, 0.04, truth);
        Whitener::new(&times, truth, |_| true).apply(values.iter_mut());
        let white = crate::statistics::ljung_box(&values, 20).unwrap();
        let variance = values.iter().map(|v| v * v).sum::<f64>() / 600.0;
        assert!(
            white.p_value > 0.01 && (variance - 1.0).abs() < 0.15,
            "{white:?} {variance}"
        );
    }
}
