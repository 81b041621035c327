//! Measurement as in a tank: noise correlated in time and with position, outliers, lost frames.

use rand::{RngExt, rngs::StdRng};
use rand_distr::{Distribution, StandardNormal};

use super::magnitudes::{between, sign};

/// Noise of one case.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize, schemars::JsonSchema)]
pub struct Disturbance {
    /// White part \[m\].
    pub white_m: f64,
    /// Correlated in time \[m\].
    pub slow_m: f64,
    /// Its correlation time \[s\].
    pub slow_s: f64,
    /// Depends on the place, the same in every run \[m\].
    pub place_m: f64,
    /// (wave number \[rad/m\], phase \[rad\]) of it.
    #[serde(skip)]
    pub waves: Vec<(f64, f64)>,
    /// Share of samples far off.
    pub outliers: f64,
    /// Share of frames lost one by one.
    pub lost: f64,
    /// Longest gap \[s\].
    pub gap_s: f64,
}

impl Disturbance {
    /// White and clean (one case in five) or as in a tank.
    pub fn draw(clean: bool, rng: &mut StdRng) -> Disturbance {
        let white_m = between(rng, 0.8e-4, 2e-4);
        if clean {
            return Disturbance {
                white_m,
                slow_s: 1.0,
                ..Disturbance::default()
            };
        }
        Disturbance {
            white_m,
            slow_m: between(rng, 0.5e-4, 2e-4),
            slow_s: between(rng, 0.2, 1.2),
            place_m: between(rng, 2e-5, 8e-5),
            waves: (0..6)
                .map(|_| {
                    (
                        std::f64::consts::TAU / between(rng, 0.03, 0.12),
                        between(rng, 0.0, std::f64::consts::TAU),
                    )
                })
                .collect(),
            outliers: between(rng, 0.002, 0.015),
            lost: between(rng, 0.0, 0.03),
            gap_s: between(rng, 0.2, 0.8),
        }
    }

    /// The same, all noise times a factor.
    #[must_use]
    pub fn scaled(mut self, factor: f64) -> Disturbance {
        for part in [&mut self.white_m, &mut self.slow_m, &mut self.place_m] {
            *part *= factor;
        }
        self
    }

    /// Noise along a run, without outliers \[m\].
    pub fn along(&self, times_s: &[f64], x_m: &[f64], rng: &mut StdRng) -> Vec<f64> {
        let mut normal = || -> f64 { StandardNormal.sample(rng) };
        let mut slow = self.slow_m * normal();
        let mut last_s = times_s.first().copied().unwrap_or(0.0);
        let each = self.place_m * (2.0 / self.waves.len().max(1) as f64).sqrt();
        times_s
            .iter()
            .zip(x_m)
            .map(|(t, x)| {
                // Ornstein-Uhlenbeck, exact between stamps.
                let decay = (-(t - last_s) / self.slow_s).exp();
                slow = decay * slow + self.slow_m * (1.0 - decay * decay).sqrt() * normal();
                last_s = *t;
                let place: f64 = self.waves.iter().map(|(k, p)| (k * x + p).sin()).sum();
                slow + each * place + self.white_m * normal()
            })
            .collect()
    }

    /// Outlying part of each sample \[m\]; 0 = no outlier.
    pub fn far_off(&self, n: usize, rng: &mut StdRng) -> Vec<f64> {
        (0..n)
            .map(|_| {
                let hit = rng.random::<f64>() < self.outliers;
                let size = between(rng, 0.003, 0.03) * sign(rng);
                if hit { size } else { 0.0 }
            })
            .collect()
    }

    /// Whether each frame arrives.
    pub fn arrives(&self, times_s: &[f64], rng: &mut StdRng) -> Vec<bool> {
        let end_s = times_s.last().copied().unwrap_or(0.0);
        let gap_from_s = between(rng, 0.1, 0.9) * end_s;
        times_s
            .iter()
            .map(|t| {
                let alone = rng.random::<f64>() < self.lost;
                !alone && !(gap_from_s..gap_from_s + self.gap_s).contains(t)
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn noise_has_its_size_and_its_correlation() {
        let mut rng = StdRng::seed_from_u64(5);
        let mut d = Disturbance::draw(false, &mut rng);
        (d.white_m, d.slow_m, d.slow_s, d.place_m) = (1e-4, 2e-4, 0.5, 0.5e-4);
        let times: Vec<f64> = (0..40_000).map(|k| 0.04 * f64::from(k)).collect();
        let x: Vec<f64> = times.iter().map(|t| 0.05 * t).collect();
        let n = d.along(&times, &x, &mut rng);
        let var = n.iter().map(|v| v * v).sum::<f64>() / n.len() as f64;
        assert!((var.sqrt() / d.white_m.hypot(d.slow_m).hypot(d.place_m) - 1.0).abs() < 0.05);
        let lag = 12;
        let c = n.windows(lag + 1).map(|w| w[0] * w[lag]).sum::<f64>() / n.len() as f64;
        let expected = 4e-8 * (-0.04 * lag as f64 / 0.5f64).exp();
        assert!((c - expected).abs() < 0.25 * expected, "{c} {expected}");
    }
}
