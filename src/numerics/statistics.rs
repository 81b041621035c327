//! Small statistics: medians, robust levels, whiteness, quantiles of the test distributions.

use statrs::distribution::{ChiSquared, ContinuousCDF, FisherSnedecor, StudentsT};

mod whiteness;

pub use whiteness::{Correlogram, LAGS, Whiteness, ljung_box};

/// sd of a normal distribution per median absolute deviation.
pub const MAD_TO_SD: f64 = 1.482_602_218_505_602;

/// Median (upper of the two middle values for an even count); sorts; `None` when empty.
pub fn median(values: &mut [f64]) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// Robust standard deviation about 0: 1.4826 median |v|.
pub fn robust_sd(values: &[f64]) -> f64 {
    let mut sizes: Vec<f64> = values
        .iter()
        .map(|v| v.abs())
        .filter(|v| v.is_finite())
        .collect();
    median(&mut sizes).unwrap_or(0.0) * MAD_TO_SD
}

/// White noise of a smooth signal from third differences, whose variance is 20 sd^2
/// (1 + 9 + 9 + 1); what is smoother than a few samples drops out.
pub fn difference_sd(values: &[f64]) -> f64 {
    let third: Vec<f64> = values
        .windows(4)
        .map(|w| w[3] - 3.0 * w[2] + 3.0 * w[1] - w[0])
        .collect();
    robust_sd(&third) / 20f64.sqrt()
}

/// Probability that the variance of `freedom` samples is more than `ratio` times that of `of` others of the same noise.
pub fn variance_above(ratio: f64, freedom: f64, of: f64) -> f64 {
    FisherSnedecor::new(freedom.max(1.0), of.max(1.0)).map_or(f64::NAN, |d| d.sf(ratio.max(0.0)))
}

/// Probability that a chi-square variable exceeds `x`.
pub fn chi2_above(x: f64, freedom: f64) -> f64 {
    ChiSquared::new(freedom).map_or(f64::NAN, |d| d.sf(x.max(0.0)))
}

/// Two-sided 95 % quantile of Student's t.
pub fn t95(freedom: f64) -> f64 {
    StudentsT::new(0.0, 1.0, freedom.max(1.0)).map_or(1.96, |d| d.inverse_cdf(0.975))
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
    fn difference_sd_sees_noise_through_motion() {
        let series: Vec<f64> = white(1, 2000)
            .iter()
            .enumerate()
            .map(|(i, e)| 0.1 * e + (i as f64 * 0.01).sin() * 5.0)
            .collect();
        let sd = difference_sd(&series);
        assert!((sd - 0.1).abs() < 0.006, "{sd}");
    }

    #[test]
    fn quantiles_are_those_of_the_tables() {
        assert!((t95(10.0) - 2.22814).abs() < 1e-5);
        assert!((chi2_above(7.81473, 3.0) - 0.05).abs() < 1e-6);
        // 30 and 20 degrees of freedom: the F table's 2.35 at 2.5 %.
        assert!((variance_above(2.3486, 30.0, 20.0) - 0.025).abs() < 1e-4);
    }
}
