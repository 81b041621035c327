//! Two calibrations held against each other: two boards, two poses, or drift.

use nalgebra::{Matrix2, Rotation2, Vector2};

use super::Calibration;

/// Differences of two calibrations over what both cover, B minus A, on the sheet.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Comparison {
    /// Points compared.
    pub points: usize,
    /// Mean difference in ξ and η \[m\].
    pub mean_m: [f64; 2],
    /// Root mean square difference in ξ and η \[m\].
    pub rms_m: [f64; 2],
    /// Largest difference \[m\] and where (ξ, η).
    pub max_m: f64,
    /// Place of the largest difference.
    pub worst_m: [f64; 2],
    /// Standard deviation expected of a difference, rms over the points \[m\].
    pub expected_m: [f64; 2],
    /// rms of difference over its expected deviation: near 1 for two calibrations of the
    /// same thing, well above 2 for a drift.
    pub ratio: f64,
    /// Rigid motion taken out first (ξ, η, turn): two poses of a board hang at two places.
    pub removed: Option<[f64; 3]>,
}

impl Comparison {
    /// Whether more changed than the calibrations' own uncertainty explains.
    pub fn drifted(&self) -> bool {
        self.ratio > 2.0
    }

    /// In words.
    pub fn words(&self) -> String {
        format!(
            "{} points differ by {:.3} mm in xi and {:.3} mm in eta rms, {:.3} mm at most (at {:.2}, {:.2} m); expected {:.3} and {:.3} mm: {}",
            self.points,
            1e3 * self.rms_m[0],
            1e3 * self.rms_m[1],
            1e3 * self.max_m,
            self.worst_m[0],
            self.worst_m[1],
            1e3 * self.expected_m[0],
            1e3 * self.expected_m[1],
            if self.drifted() {
                "more than their own uncertainties explain"
            } else {
                "as their own uncertainties explain"
            }
        )
    }
}

/// The same pixel on the sheet by A and by B, and the covariance of the difference.
type Pair = ([f64; 2], [f64; 2], Matrix2<f64>);

/// Compares over a grid of pixels that both calibrations answer for; `align` takes the
/// best rigid motion out first. `None` where fewer than 10 pixels are common.
pub fn compare(a: &Calibration, b: &Calibration, align: bool) -> Option<Comparison> {
    let (map_a, map_b) = (a.to_map(), b.to_map());
    let region = a.map.fitted()?.region().clone();
    let placement = a.placement.unwrap_or_default();
    let turn = Rotation2::new(placement.turn_rad);
    let (low, high) = region.bounds_m()?;
    const STEPS: usize = 25;
    let mut pairs: Vec<Pair> = Vec::new();
    for j in 0..STEPS {
        for i in 0..STEPS {
            let at =
                |k: usize, n: usize| low[k] + (n as f64 + 0.5) / STEPS as f64 * (high[k] - low[k]);
            let p = turn * Vector2::new(at(0, i), at(1, j));
            let seen = map_a.to_image(p[0] + placement.xi_m, p[1] + placement.eta_m);
            if let Some((column, row)) = seen
                && let (Some(p), Some(q)) =
                    (map_a.to_plane(column, row), map_b.to_plane(column, row))
            {
                pairs.push((
                    [p.xi_m, p.eta_m],
                    [q.xi_m, q.eta_m],
                    p.covariance_m2 + q.covariance_m2,
                ));
            }
        }
    }
    if pairs.len() < 10 {
        return None;
    }
    let n = pairs.len() as f64;
    let removed = align.then(|| {
        let mean = |f: fn(&Pair) -> [f64; 2]| {
            pairs.iter().fold(Vector2::zeros(), |s, p| {
                let v = f(p);
                s + Vector2::new(v[0], v[1])
            }) / n
        };
        let (ma, mb) = (mean(|p| p.0), mean(|p| p.1));
        let (mut cross, mut dot) = (0.0, 0.0);
        for (p, q, _) in &pairs {
            let u = Vector2::new(q[0], q[1]) - mb;
            let v = Vector2::new(p[0], p[1]) - ma;
            cross += u[0] * v[1] - u[1] * v[0];
            dot += u.dot(&v);
        }
        let angle = cross.atan2(dot);
        let shift = ma - Rotation2::new(angle) * mb;
        [shift[0], shift[1], angle]
    });
    let mut result = Comparison {
        points: pairs.len(),
        removed,
        ..Comparison::default()
    };
    let mut chi2 = 0.0;
    for (p, q, covariance) in &pairs {
        let mut q = Vector2::new(q[0], q[1]);
        if let Some([x, y, angle]) = removed {
            q = Rotation2::new(angle) * q + Vector2::new(x, y);
        }
        let d = q - Vector2::new(p[0], p[1]);
        for k in 0..2 {
            result.mean_m[k] += d[k] / n;
            result.rms_m[k] += d[k] * d[k] / n;
            result.expected_m[k] += covariance[(k, k)].max(0.0) / n;
        }
        if d.norm() > result.max_m {
            result.max_m = d.norm();
            result.worst_m = *p;
        }
        // A hundredth of a millimetre is beyond any claim made here.
        let floor = Matrix2::identity() * 1e-10;
        if let Some(inverse) = (covariance + floor).try_inverse() {
            chi2 += (d.transpose() * inverse * d)[0] / (2.0 * n);
        }
    }
    result.rms_m = result.rms_m.map(f64::sqrt);
    result.expected_m = result.expected_m.map(f64::sqrt);
    result.ratio = chi2.sqrt();
    Some(result)
}
