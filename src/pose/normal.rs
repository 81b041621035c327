//! The normal distribution in one and two dimensions.

use std::f64::consts::{FRAC_1_SQRT_2, PI};

/// Density of N(0, 1).
pub(super) fn density(x: f64) -> f64 {
    (-0.5 * x * x).exp() * (0.5 / PI).sqrt()
}

/// Distribution function of N(0, 1).
pub(super) fn cumulative(x: f64) -> f64 {
    0.5 * libm::erfc(-x * FRAC_1_SQRT_2)
}

/// P(X < h, Y < k) for a pair of normals with correlation `rho`.
///
/// Drezner and Wesolowsky (1990): Φ(h)Φ(k) + 1/2π ∫₀^asin ρ exp(−(h² + k² − 2hk sin t) / 2cos²t) dt,
/// by ten Gauss–Legendre points: error below 1e-7 for |ρ| ≤ 0.97; beyond, ρ is held there, where
/// a corner is so sharp or so blunt that one of its edges decides.
pub(super) fn cumulative2(h: f64, k: f64, rho: f64) -> f64 {
    const NODES: [(f64, f64); 5] = [
        (0.148_874_338_981_631_2, 0.295_524_224_714_752_9),
        (0.433_395_394_129_247_2, 0.269_266_719_309_996_4),
        (0.679_409_568_299_024_4, 0.219_086_362_515_982_04),
        (0.865_063_366_688_984_5, 0.149_451_349_150_580_6),
        (0.973_906_528_517_171_7, 0.066_671_344_308_688_14),
    ];
    let end = rho.clamp(-0.97, 0.97).asin();
    let mut sum = 0.0;
    for (node, weight) in NODES {
        for sign in [-1.0, 1.0] {
            let sin = (0.5 * end * (1.0 + sign * node)).sin();
            sum += weight * (-0.5 * (h * h + k * k - 2.0 * h * k * sin) / (1.0 - sin * sin)).exp();
        }
    }
    (cumulative(h) * cumulative(k) + sum * 0.5 * end / (2.0 * PI)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_values() {
        assert!((cumulative(0.0) - 0.5).abs() < 1e-15);
        assert!((cumulative(1.959_963_984_540_054) - 0.975).abs() < 1e-12);
        assert!((density(0.0) - 0.398_942_280_401_432_7).abs() < 1e-15);
        // Orthant probability: 1/4 + asin(rho) / 2 pi.
        for rho in [-0.9f64, -0.5, 0.0, 0.3, 0.95] {
            let exact = 0.25 + rho.asin() / (2.0 * PI);
            assert!((cumulative2(0.0, 0.0, rho) - exact).abs() < 1e-7, "{rho}");
        }
        // With one bound at infinity the other distribution remains.
        assert!((cumulative2(0.7, 9.0, 0.6) - cumulative(0.7)).abs() < 1e-7);
    }
}
