//! The forward model: one homography, Brown's distortion, and the flat port's share.
//!
//! X = (ξ − ξ₀)/S, Y = (η − η₀)/S, (u, v) = H (X, Y), h₃₃ = 1, d = (u − c_x, v − c_y), r² = |d|²,
//! x = c + d (1 + (k₁ + κ(1/w − 1)) r² + k₂r⁴ + k₃r⁶)
//!     + (2p₁d_x d_y + p₂(r² + 2d_x²), p₁(r² + 2d_y²) + 2p₂d_x d_y) (Brown 1971), w = h₃₁X + h₃₂Y + 1.
//!
//! κ is a flat port's: to third order a ray through the port meets depth z at
//! tan t_w + (d/z)(tan t_a − tan t_w); the part linear in the angle shifts the pupil (H takes it), the
//! cubic part is a k₁ that goes with 1/z, and on a plane z is proportional to w. On the study's
//! exact nodes k₁ k₂ k₃ alone leave 0.08 mm at most, with κ 0.01 mm.

use nalgebra::{Matrix2, Matrix3, SMatrix, Vector2};

use crate::map::geometry::apply;

/// h₁₁ h₁₂ h₁₃ h₂₁ h₂₂ h₂₃ h₃₁ h₃₂, k₁ k₂ k₃ p₁ p₂ c_x c_y κ.
pub(super) const PARAMETERS: usize = 16;

/// Derivatives of the scaled pixel at which a point is seen.
pub(super) struct Seen {
    /// ∂(column, row)/∂(X, Y).
    pub by_point: Matrix2<f64>,
    /// ∂(column, row)/∂parameters.
    pub by_parameters: SMatrix<f64, 2, PARAMETERS>,
}

/// An undistorted place after distortion, with its derivative.
struct Distorted {
    at: Vector2<f64>,
    /// From the centre.
    d: Vector2<f64>,
    r2: f64,
    /// ∂at/∂d with κ's factor held.
    by_d: Matrix2<f64>,
}

fn distort(x: &[f64; PARAMETERS], u: Vector2<f64>, nearness: f64) -> Distorted {
    let [k1, k2, k3, p1, p2, cx, cy, kappa] = [8, 9, 10, 11, 12, 13, 14, 15].map(|k| x[k]);
    let d = u - Vector2::new(cx, cy);
    let r2 = d.norm_squared();
    let first = k1 + kappa * nearness;
    let radial = 1.0 + r2 * (first + r2 * (k2 + r2 * k3));
    let slope = first + r2 * (2.0 * k2 + 3.0 * r2 * k3);
    let decentred = Vector2::new(
        2.0 * p1 * d[0] * d[1] + p2 * (r2 + 2.0 * d[0] * d[0]),
        p1 * (r2 + 2.0 * d[1] * d[1]) + 2.0 * p2 * d[0] * d[1],
    );
    let cross = 2.0 * (p1 * d[0] + p2 * d[1]);
    let by_decentring = Matrix2::new(
        2.0 * p1 * d[1] + 6.0 * p2 * d[0],
        cross,
        cross,
        6.0 * p1 * d[1] + 2.0 * p2 * d[0],
    );
    Distorted {
        at: u - d + d * radial + decentred,
        d,
        r2,
        by_d: Matrix2::identity() * radial + d * d.transpose() * (2.0 * slope) + by_decentring,
    }
}

/// The plane's point by the homography alone, and its depth over the origin's; `None` behind the camera.
fn flat(x: &[f64; PARAMETERS], [a, b]: [f64; 2]) -> Option<(Vector2<f64>, f64)> {
    let w = x[6] * a + x[7] * b + 1.0;
    if w < 1e-6 {
        return None;
    }
    let u = Vector2::new(
        (x[0] * a + x[1] * b + x[2]) / w,
        (x[3] * a + x[4] * b + x[5]) / w,
    );
    Some((u, w))
}

/// The scaled pixel of the scaled sheet point (a, b); `None` behind the camera.
#[inline]
pub(super) fn project(x: &[f64; PARAMETERS], [a, b]: [f64; 2]) -> Option<[f64; 2]> {
    let (u, w) = flat(x, [a, b])?;
    let at = distort(x, u, 1.0 / w - 1.0).at;
    Some([at[0], at[1]])
}

/// Derivatives of [`project`].
pub(super) fn see(x: &[f64; PARAMETERS], [a, b]: [f64; 2]) -> Option<Seen> {
    let (u, w) = flat(x, [a, b])?;
    let nearness = 1.0 / w - 1.0;
    let Distorted { d, r2, by_d, .. } = distort(x, u, nearness);
    // Derivative by 1/w, through κ.
    let by_nearness = d * (r2 * x[15]);
    let by_w = -(by_d * u) / w - by_nearness / (w * w);
    let mut by = SMatrix::<f64, 2, PARAMETERS>::zeros();
    for (k, part) in [a / w, b / w, 1.0 / w].into_iter().enumerate() {
        by.set_column(k, &(by_d.column(0) * part));
        by.set_column(3 + k, &(by_d.column(1) * part));
    }
    by.set_column(6, &(by_w * a));
    by.set_column(7, &(by_w * b));
    by.set_column(8, &(d * r2));
    by.set_column(9, &(d * (r2 * r2)));
    by.set_column(10, &(d * (r2 * r2 * r2)));
    by.set_column(11, &Vector2::new(2.0 * d[0] * d[1], r2 + 2.0 * d[1] * d[1]));
    by.set_column(12, &Vector2::new(r2 + 2.0 * d[0] * d[0], 2.0 * d[0] * d[1]));
    by.set_column(13, &Vector2::new(1.0 - by_d[(0, 0)], -by_d[(1, 0)]));
    by.set_column(14, &Vector2::new(-by_d[(0, 1)], 1.0 - by_d[(1, 1)]));
    by.set_column(15, &(d * (r2 * nearness)));
    let along = |p: f64, q: f64, g: f64| by_d * Vector2::new(p, q) / w + by_w * g;
    let (da, db) = (along(x[0], x[3], x[6]), along(x[1], x[4], x[7]));
    Some(Seen {
        by_point: Matrix2::new(da[0], db[0], da[1], db[1]),
        by_parameters: by,
    })
}

/// The scaled sheet point seen at a scaled pixel; no check that the distortion is one to one.
pub(super) fn unproject(x: &[f64; PARAMETERS], target: [f64; 2]) -> Option<[f64; 2]> {
    let h = Matrix3::new(x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7], 1.0);
    let mut inverse = h.try_inverse()?;
    // 1/w of the point seen at u is linear in u.
    let near = |inverse: &Matrix3<f64>, u: &Vector2<f64>| {
        inverse[(2, 0)] * u[0] + inverse[(2, 1)] * u[1] + inverse[(2, 2)]
    };
    let target = Vector2::from(target);
    // Newton on the distortion alone: close to the identity, so from the pixel itself.
    let mut u = target;
    for _ in 0..12 {
        let distorted = distort(x, u, near(&inverse, &u) - 1.0);
        let e = distorted.at - target;
        if e.norm() < 1e-13 {
            break;
        }
        let by_nearness = distorted.d * (distorted.r2 * x[15]);
        let slope = nalgebra::RowVector2::new(inverse[(2, 0)], inverse[(2, 1)]);
        u -= (distorted.by_d + by_nearness * slope).try_inverse()? * e;
    }
    if near(&inverse, &u) < 0.0 {
        // The inverse of a homography is one only up to its sign.
        inverse = -inverse;
    }
    apply(&inverse, [u[0], u[1]])
}

#[cfg(test)]
mod tests {
    use super::*;

    const X: [f64; PARAMETERS] = [
        1.1, 0.05, 0.02, -0.03, 0.9, 0.1, 0.04, 0.3, 0.05, -0.02, 0.01, 0.004, -0.003, 0.1, -0.05,
        0.02,
    ];

    #[test]
    fn derivatives_are_those_of_the_model() {
        let p = [0.4, -0.6];
        let seen = see(&X, p).unwrap();
        let h = 1e-6;
        let difference = |up: [f64; 2], down: [f64; 2]| {
            Vector2::new(up[0] - down[0], up[1] - down[1]) / (2.0 * h)
        };
        for k in 0..PARAMETERS {
            let moved = |by: f64| {
                let mut x = X;
                x[k] += by;
                project(&x, p).unwrap()
            };
            let off = difference(moved(h), moved(-h)) - seen.by_parameters.column(k);
            assert!(off.norm() < 1e-8, "{k}: {off}");
        }
        for k in 0..2 {
            let moved = |by: f64| {
                let mut q = p;
                q[k] += by;
                project(&X, q).unwrap()
            };
            let off = difference(moved(h), moved(-h)) - seen.by_point.column(k);
            assert!(off.norm() < 1e-8, "{k}: {off}");
        }
    }

    #[test]
    fn goes_back_where_it_came_from() {
        for p in [[0.0, 0.0], [0.9, -0.8], [-0.7, 0.9]] {
            let back = unproject(&X, project(&X, p).unwrap()).unwrap();
            assert!((back[0] - p[0]).hypot(back[1] - p[1]) < 1e-10, "{back:?}");
        }
    }
}
