//! The normal distribution in one and two dimensions.

use std::f64::consts::{FRAC_1_SQRT_2, PI};
use std::sync::LazyLock;

/// Divisions take ten times as long as products.
pub(super) const SIXTH: f64 = 1.0 / 6.0;
/// Nodes per unit of the tables.
const PER_UNIT: f64 = 32.0;
/// Beyond this Φ is 0 or 1 to 1e-15.
const NORMAL_END: f64 = 8.0;
/// Beyond this exp(−a) counts as zero.
const EXP_END: f64 = 15.0;

/// Φ, φ and exp(−a) by a Taylor series of third order about the nearest of 32 nodes per unit:
/// error below 4e-9, in a tenth of the time of the functions themselves, of which a frame needs 10⁵.
pub(super) struct Tables {
    /// Φ and φ from −8 to 8.
    normal: Vec<[f64; 2]>,
    /// exp(−a) from 0 to 15.
    exp: Vec<f64>,
}

static TABLES: LazyLock<Tables> = LazyLock::new(|| {
    let nodes = (2.0 * NORMAL_END * PER_UNIT) as usize + 2;
    let x = |k: usize| k as f64 / PER_UNIT - NORMAL_END;
    Tables {
        normal: (0..nodes)
            .map(|k| [cumulative(x(k)), density(x(k))])
            .collect(),
        exp: (0..(EXP_END * PER_UNIT) as usize + 2)
            .map(|k| (-(k as f64) / PER_UNIT).exp())
            .collect(),
    }
});

impl Tables {
    pub fn get() -> &'static Tables {
        &TABLES
    }

    /// Φ(x), φ(x).
    #[inline]
    pub fn normal(&self, x: f64) -> (f64, f64) {
        let inside = x.abs() < NORMAL_END;
        if !inside {
            return (if x > 0.0 { 1.0 } else { 0.0 }, 0.0);
        }
        let k = ((x + NORMAL_END) * PER_UNIT + 0.5) as u32;
        let node = f64::from(k) / PER_UNIT - NORMAL_END;
        let d = x - node;
        let [share, slope] = self.normal[k as usize];
        // d²φ/dx² = (x² − 1)φ, d³φ/dx³ = −x(x² − 3)φ.
        let second = node * node - 1.0;
        (
            share + slope * d * (1.0 - d * (0.5 * node - d * second * SIXTH)),
            slope * (1.0 - d * (node - d * (0.5 * second - d * node * (second - 2.0) * SIXTH))),
        )
    }

    /// exp(−a) for a ≥ 0; zero from a = 15 on.
    #[inline]
    pub fn exp(&self, a: f64) -> f64 {
        let inside = (0.0..EXP_END).contains(&a);
        if !inside {
            return 0.0;
        }
        let k = (a * PER_UNIT + 0.5) as u32;
        let d = a - f64::from(k) / PER_UNIT;
        self.exp[k as usize] * (1.0 - d * (1.0 - d * (0.5 - d * SIXTH)))
    }
}

/// Density of N(0, 1).
pub(super) fn density(x: f64) -> f64 {
    (-0.5 * x * x).exp() * (0.5 / PI).sqrt()
}

/// Distribution function of N(0, 1).
pub(super) fn cumulative(x: f64) -> f64 {
    0.5 * libm::erfc(-x * FRAC_1_SQRT_2)
}

/// A pair of normals with one correlation.
///
/// Drezner and Wesolowsky (1990): P(X < h, Y < k) = Φ(h)Φ(k) + 1/2π ∫₀^asin ρ exp(−(h² + k² − 2hk sin t) / 2cos²t) dt,
/// by ten Gauss–Legendre points: error below 1e-7 for |ρ| ≤ 0.97; beyond, ρ is held there, where
/// a corner is so sharp or so blunt that one of its edges decides.
pub(super) struct Pair {
    rho: f64,
    /// 1/√(1 − ρ²).
    across: f64,
    /// Weight, sin t and 1/2cos²t of each point.
    points: [[f64; 3]; 10],
}

/// P(X < h, Y < k), and its derivatives by h and k.
#[derive(Clone, Copy)]
pub(super) struct Both {
    pub share: f64,
    pub by: [f64; 2],
}

/// Of the correlations that are kept ready, so many per unit: the nearest is off by 1/512 at most, by which
/// a share changes by 3e-4 at 0 and by 1.3e-3 at the largest, dΦ₂/dρ = 1/(2π√(1 − ρ²)).
const PAIRS_PER_UNIT: f64 = 256.0;
const RHO_MOST: f64 = 0.97;

static PAIRS: LazyLock<Vec<Pair>> = LazyLock::new(|| {
    let count = (2.0 * RHO_MOST * PAIRS_PER_UNIT).ceil() as usize;
    (0..=count)
        .map(|k| Pair::new(k as f64 / PAIRS_PER_UNIT - RHO_MOST))
        .collect()
});

impl Pair {
    /// The one kept ready that is nearest to a correlation.
    pub fn near(rho: f64) -> &'static Pair {
        let place = (rho.clamp(-RHO_MOST, RHO_MOST) + RHO_MOST) * PAIRS_PER_UNIT + 0.5;
        // NaN is 0 here: its shares are NaN by h and k anyway.
        &PAIRS[place as usize]
    }

    pub fn new(rho: f64) -> Pair {
        const NODES: [(f64, f64); 5] = [
            (0.148_874_338_981_631_2, 0.295_524_224_714_752_9),
            (0.433_395_394_129_247_2, 0.269_266_719_309_996_4),
            (0.679_409_568_299_024_4, 0.219_086_362_515_982_04),
            (0.865_063_366_688_984_5, 0.149_451_349_150_580_6),
            (0.973_906_528_517_171_7, 0.066_671_344_308_688_14),
        ];
        let rho = rho.clamp(-RHO_MOST, RHO_MOST);
        let end = rho.asin();
        Pair {
            rho,
            across: 1.0 / (1.0 - rho * rho).sqrt(),
            points: std::array::from_fn(|k| {
                let (node, weight) = NODES[k / 2];
                let sign = if k % 2 == 0 { -1.0 } else { 1.0 };
                let sin = (0.5 * end * (1.0 + sign * node)).sin();
                let weight = weight * 0.5 * end / (2.0 * PI);
                [weight, sin, 0.5 / (1.0 - sin * sin)]
            }),
        }
    }

    pub fn below(&self, h: f64, k: f64, tables: &Tables) -> Both {
        let ((below_h, at_h), (below_k, at_k)) = (tables.normal(h), tables.normal(k));
        let (squares, product) = (h * h + k * k, 2.0 * h * k);
        let sum: f64 = self
            .points
            .iter()
            .map(|[weight, sin, half]| weight * tables.exp((squares - product * sin) * half))
            .sum();
        let (rho, across) = (self.rho, self.across);
        Both {
            share: (below_h * below_k + sum).clamp(0.0, 1.0),
            by: [
                at_h * tables.normal((k - rho * h) * across).0,
                at_k * tables.normal((h - rho * k) * across).0,
            ],
        }
    }

    /// P(X < h or Y < k).
    pub fn either(&self, h: f64, k: f64, tables: &Tables) -> Both {
        let both = self.below(h, k, tables);
        let ((below_h, at_h), (below_k, at_k)) = (tables.normal(h), tables.normal(k));
        Both {
            share: (below_h + below_k - both.share).clamp(0.0, 1.0),
            by: [at_h - both.by[0], at_k - both.by[1]],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_are_the_functions() {
        let tables = Tables::get();
        for k in -10_000..10_000 {
            let x = f64::from(k) * 9.1e-4;
            let (share, slope) = tables.normal(x);
            assert!((share - cumulative(x)).abs() < 1e-8, "{x}: {share}");
            assert!((slope - density(x)).abs() < 1e-8, "{x}: {slope}");
            let a = x.abs() * 1.6;
            assert!((tables.exp(a) - (-a).exp()).abs() < 4e-7, "{a}");
        }
        assert_eq!(tables.normal(f64::NAN), (0.0, 0.0));
        assert_eq!(tables.exp(f64::NAN), 0.0);
    }

    #[test]
    fn known_values() {
        assert!((cumulative(0.0) - 0.5).abs() < 1e-15);
        assert!((cumulative(1.959_963_984_540_054) - 0.975).abs() < 1e-12);
        assert!((density(0.0) - 0.398_942_280_401_432_7).abs() < 1e-15);
        // Orthant probability: 1/4 + asin(rho) / 2 pi.
        for rho in [-0.9f64, -0.5, 0.0, 0.3, 0.95] {
            let exact = 0.25 + rho.asin() / (2.0 * PI);
            let found = Pair::new(rho).below(0.0, 0.0, Tables::get());
            assert!((found.share - exact).abs() < 1e-7, "{rho}");
        }
        // With one bound at infinity the other distribution remains.
        let pair = Pair::new(0.6);
        let alone = pair.below(0.7, 7.9, Tables::get());
        assert!((alone.share - cumulative(0.7)).abs() < 1e-7);
        let step = 1e-4;
        let moved = |h: f64, k: f64| pair.either(h, k, Tables::get());
        let (here, up) = (moved(0.4, -0.3), moved(0.4, -0.3 + step));
        assert!((here.by[1] - (up.share - here.share) / step).abs() < 1e-4);
    }
}
