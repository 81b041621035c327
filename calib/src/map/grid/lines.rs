//! Longitudes and latitudes as least-squares quadratics; linear between neighbours.
//!
//! In the rectified plane what is left of a line is the lens and the port, both odd about
//! the image's centre: there a cubic is used, since a quadratic would leave 0.055 mm rms.

use nalgebra::{Matrix2, Matrix4, Vector4};

use super::super::MapError;
use super::{Table, scallop};
use crate::plane::PlanePoint;

/// One fitted line: dependent = c₀ + c₁ t + c₂ t² (+ c₃ t³), t the scaled other coordinate.
#[derive(Debug, Clone, PartialEq)]
struct Curve {
    /// Where on the sheet \[m\].
    level_m: f64,
    coefficients: Vector4<f64>,
    covariance: Matrix4<f64>,
    cubic: bool,
}

impl Curve {
    fn at(&self, t: f64) -> f64 {
        self.coefficients.dot(&powers(t, self.cubic))
    }

    fn variance(&self, t: f64) -> f64 {
        let p = powers(t, self.cubic);
        (p.transpose() * self.covariance * p)[0]
    }
}

/// Both families of lines.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Lines {
    /// Constant η: v over u.
    latitudes: Vec<Curve>,
    /// Constant ξ: u over v.
    longitudes: Vec<Curve>,
    centre: [f64; 2],
    scale: f64,
}

impl Lines {
    pub(super) fn new(table: &Table, cubic: bool) -> Result<Self, MapError> {
        let seen = || table.at.iter().flatten().flatten();
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for n in seen() {
            for (k, v) in [n.column_px, n.row_px].into_iter().enumerate() {
                low[k] = low[k].min(v);
                high[k] = high[k].max(v);
            }
        }
        let centre = [0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])];
        let scale = 0.5 * (high[0] - low[0]).max(high[1] - low[1]);
        let latitudes: Vec<Curve> = table
            .eta_m
            .iter()
            .enumerate()
            .filter_map(|(j, &level_m)| {
                curve(
                    level_m,
                    cubic,
                    table.at[j].iter().flatten().map(|n| {
                        (
                            (n.column_px - centre[0]) / scale,
                            n.row_px,
                            n.covariance_px2[(1, 1)],
                        )
                    }),
                )
            })
            .collect();
        let longitudes: Vec<Curve> = table
            .xi_m
            .iter()
            .enumerate()
            .filter_map(|(i, &level_m)| {
                curve(
                    level_m,
                    cubic,
                    table.at.iter().filter_map(|row| row[i]).map(|n| {
                        (
                            (n.row_px - centre[1]) / scale,
                            n.column_px,
                            n.covariance_px2[(0, 0)],
                        )
                    }),
                )
            })
            .collect();
        if latitudes.len() < 3 || longitudes.len() < 3 {
            return Err(MapError::NotAGrid {
                columns: longitudes.len(),
                rows: latitudes.len(),
            });
        }
        Ok(Lines {
            latitudes,
            longitudes,
            centre,
            scale,
        })
    }

    pub(super) fn to_plane(&self, u: f64, v: f64) -> Option<PlanePoint> {
        let (eta_m, var_eta) = between(&self.latitudes, (u - self.centre[0]) / self.scale, v)?;
        let (xi_m, var_xi) = between(&self.longitudes, (v - self.centre[1]) / self.scale, u)?;
        Some(PlanePoint {
            xi_m,
            eta_m,
            covariance_m2: Matrix2::new(var_xi, 0.0, 0.0, var_eta),
        })
    }

    pub(super) fn to_image(&self, xi_m: f64, eta_m: f64) -> Option<[f64; 2]> {
        // The two curves cross at nearly a right angle: alternating between them converges.
        let mut p = self.centre;
        for _ in 0..60 {
            let v = blend(&self.latitudes, eta_m, (p[0] - self.centre[0]) / self.scale)?;
            let u = blend(&self.longitudes, xi_m, (v - self.centre[1]) / self.scale)?;
            let moved = (u - p[0]).abs() + (v - p[1]).abs();
            p = [u, v];
            if moved < 1e-10 * self.scale {
                return Some(p);
            }
        }
        None
    }
}

/// Powers of t up to the degree.
fn powers(t: f64, cubic: bool) -> Vector4<f64> {
    Vector4::new(1.0, t, t * t, if cubic { t * t * t } else { 0.0 })
}

/// Weighted least-squares line through (t, value, variance); `None` with too few nodes.
fn curve(
    level_m: f64,
    cubic: bool,
    nodes: impl Iterator<Item = (f64, f64, f64)> + Clone,
) -> Option<Curve> {
    let count = nodes.clone().count();
    // Too few for a cubic: a quadratic line is better than none.
    let cubic = cubic && count > 5;
    let degree = if cubic { 3 } else { 2 };
    if count < 3 {
        return None;
    }
    let (mut normal, mut right) = (Matrix4::zeros(), Vector4::zeros());
    if !cubic {
        normal[(3, 3)] = 1.0; // the unused coefficient: zero, and tied to nothing
    }
    for (t, value, variance) in nodes.clone() {
        let p = powers(t, cubic);
        normal += p * p.transpose() / variance;
        right += p * (value / variance);
    }
    let inverse = normal.try_inverse()?;
    let coefficients = inverse * right;
    let chi2: f64 = nodes
        .map(|(t, value, variance)| {
            let e = value - coefficients.dot(&powers(t, cubic));
            e * e / variance
        })
        .sum();
    // A line that is no polynomial (lens, port) says so in its covariance.
    let free = count - degree - 1;
    let scale = if free > 0 {
        (chi2 / free as f64).max(1.0)
    } else {
        1.0
    };
    Some(Curve {
        level_m,
        coefficients,
        covariance: inverse * scale,
        cubic,
    })
}

/// Level and variance at `value`, between the two neighbouring lines at `t`.
fn between(lines: &[Curve], t: f64, value: f64) -> Option<(f64, f64)> {
    let k = (0..lines.len() - 1).find(|&k| {
        let (a, b) = (lines[k].at(t), lines[k + 1].at(t));
        (a <= value && value <= b) || (b <= value && value <= a)
    })?;
    let (below, above) = (&lines[k], &lines[k + 1]);
    let (a, b) = (below.at(t), above.at(t));
    let pitch = above.level_m - below.level_m;
    let fraction = (value - a) / (b - a);
    let gain = pitch / (b - a);
    let noise = gain
        * gain
        * ((1.0 - fraction).powi(2) * below.variance(t) + fraction.powi(2) * above.variance(t));
    let neighbour = |index: Option<usize>| {
        index
            .and_then(|i| lines.get(i))
            .map(|l| (l.at(t), l.level_m))
    };
    let bias = scallop(
        [
            neighbour(k.checked_sub(1)),
            neighbour(Some(k)),
            neighbour(Some(k + 1)),
            neighbour(Some(k + 2)),
        ],
        value,
    );
    let answer = (below.level_m + pitch * fraction, noise + bias * bias);
    answer.0.is_finite().then_some(answer)
}

/// The interpolated line of a level at `t`.
fn blend(lines: &[Curve], level_m: f64, t: f64) -> Option<f64> {
    let last = lines.len() - 1;
    // The region's slack reaches a hair beyond the outer lines.
    let k = lines
        .partition_point(|l| l.level_m <= level_m)
        .clamp(1, last)
        - 1;
    let fraction = (level_m - lines[k].level_m) / (lines[k + 1].level_m - lines[k].level_m);
    Some(lines[k].at(t) + fraction * (lines[k + 1].at(t) - lines[k].at(t)))
}
