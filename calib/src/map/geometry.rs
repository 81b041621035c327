//! Plain projective geometry: the homography of point pairs and how it is applied.

use nalgebra::{Matrix2, Matrix3, SMatrix, Vector2, Vector3};

/// The homography taking `from` to `to`, by the normalised direct linear transform
/// (Hartley and Zisserman, Multiple View Geometry, 2nd ed., algorithm 4.2).
///
/// `None` for fewer than 4 pairs or points on one line.
pub fn homography(pairs: &[([f64; 2], [f64; 2])]) -> Option<Matrix3<f64>> {
    if pairs.len() < 4 {
        return None;
    }
    let from = normaliser(pairs.iter().map(|p| p.0))?;
    let to = normaliser(pairs.iter().map(|p| p.1))?;
    let mut normal = SMatrix::<f64, 9, 9>::zeros();
    for (a, b) in pairs {
        let x = from * Vector3::new(a[0], a[1], 1.0);
        let y = to * Vector3::new(b[0], b[1], 1.0);
        let rows = [
            [
                x[0],
                x[1],
                1.0,
                0.0,
                0.0,
                0.0,
                -y[0] * x[0],
                -y[0] * x[1],
                -y[0],
            ],
            [
                0.0,
                0.0,
                0.0,
                x[0],
                x[1],
                1.0,
                -y[1] * x[0],
                -y[1] * x[1],
                -y[1],
            ],
        ];
        for row in rows {
            let r = SMatrix::<f64, 9, 1>::from(row);
            normal += r * r.transpose();
        }
    }
    let eigen = normal.symmetric_eigen();
    let mut order: Vec<usize> = (0..9).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
    // A second vanishing eigenvalue: the points lie on a line and fix nothing.
    if eigen.eigenvalues[order[1]] < 1e-9 * eigen.eigenvalues[order[8]] {
        return None;
    }
    let h = eigen.eigenvectors.column(order[0]);
    let inner = Matrix3::new(h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], h[8]);
    let mut full = to.try_inverse()? * inner * from;
    // Sign: the points lie in front (third component positive at the first of them).
    if (full * Vector3::new(pairs[0].0[0], pairs[0].0[1], 1.0))[2] < 0.0 {
        full = -full;
    }
    full.iter().all(|v| v.is_finite()).then_some(full)
}

/// Applies a homography; `None` behind the horizon.
#[inline]
pub fn apply(h: &Matrix3<f64>, p: [f64; 2]) -> Option<[f64; 2]> {
    let w = h[(2, 0)] * p[0] + h[(2, 1)] * p[1] + h[(2, 2)];
    (w > 1e-12).then(|| {
        [
            (h[(0, 0)] * p[0] + h[(0, 1)] * p[1] + h[(0, 2)]) / w,
            (h[(1, 0)] * p[0] + h[(1, 1)] * p[1] + h[(1, 2)]) / w,
        ]
    })
}

/// Jacobian of a homography at a point.
pub fn homography_jacobian(h: &Matrix3<f64>, p: [f64; 2]) -> Option<Matrix2<f64>> {
    let q = apply(h, p)?;
    let w = h[(2, 0)] * p[0] + h[(2, 1)] * p[1] + h[(2, 2)];
    Some(Matrix2::from_fn(|i, k| (h[(i, k)] - q[i] * h[(2, k)]) / w))
}

/// Translation and scale to zero mean and mean distance √2.
fn normaliser(points: impl Iterator<Item = [f64; 2]> + Clone) -> Option<Matrix3<f64>> {
    let n = points.clone().count() as f64;
    let sum = points
        .clone()
        .fold(Vector2::zeros(), |s, p| s + Vector2::new(p[0], p[1]));
    let mean = sum / n;
    let spread = points
        .map(|p| (Vector2::new(p[0], p[1]) - mean).norm())
        .sum::<f64>()
        / n;
    (spread > 1e-12 && spread.is_finite()).then(|| {
        let s = std::f64::consts::SQRT_2 / spread;
        Matrix3::new(s, 0.0, -s * mean[0], 0.0, s, -s * mean[1], 0.0, 0.0, 1.0)
    })
}

/// Lower Cholesky factor's inverse of a 2 × 2 covariance: what turns a residual into
/// units of its standard deviation. The covariance must be positive definite.
pub fn whitener(covariance: &Matrix2<f64>) -> Matrix2<f64> {
    let a = covariance[(0, 0)].max(1e-30).sqrt();
    let b = covariance[(1, 0)] / a;
    let c = (covariance[(1, 1)] - b * b).max(1e-30).sqrt();
    Matrix2::new(1.0 / a, 0.0, -b / (a * c), 1.0 / c)
}

/// Serde for matrices: a list of rows.
pub(crate) mod rows {
    use nalgebra::DMatrix;
    use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};

    pub fn serialize<S: Serializer>(m: &DMatrix<f64>, s: S) -> Result<S::Ok, S::Error> {
        let rows: Vec<Vec<f64>> = m.row_iter().map(|r| r.iter().copied().collect()).collect();
        rows.serialize(s)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(d: D) -> Result<DMatrix<f64>, D::Error> {
        let rows = Vec::<Vec<f64>>::deserialize(d)?;
        let n = rows.len();
        if let Some(row) = rows.iter().find(|r| r.len() != n) {
            return Err(D::Error::custom(format!(
                "a covariance of {n} rows has a row of {} numbers",
                row.len()
            )));
        }
        let m = DMatrix::from_fn(n, n, |i, k| rows[i][k]);
        if m.iter().any(|v| !v.is_finite()) || (0..n).any(|k| m[(k, k)] < 0.0) {
            return Err(D::Error::custom(
                "a covariance holds a number that is not finite, or a negative variance",
            ));
        }
        Ok(m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn finds_the_homography_it_is_shown(
            h in prop::array::uniform8(-0.3..0.3f64),
        ) {
            let truth = Matrix3::new(
                1.0 + h[0], h[1], 300.0 * h[2], h[3], 1.0 + h[4], 300.0 * h[5],
                1e-3 * h[6], 1e-3 * h[7], 1.0,
            );
            let pairs: Vec<_> = (0..16)
                .map(|k| [40.0 * f64::from(k % 4), 60.0 * f64::from(k / 4)])
                .map(|p| (p, apply(&truth, p).unwrap()))
                .collect();
            let found = homography(&pairs).unwrap();
            for (p, q) in pairs {
                let r = apply(&found, p).unwrap();
                prop_assert!((r[0] - q[0]).abs() < 1e-6 && (r[1] - q[1]).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn points_on_a_line_fix_nothing() {
        let pairs: Vec<_> = (0..9)
            .map(|k| ([f64::from(k), 1.0], [f64::from(2 * k), 3.0]))
            .collect();
        assert_eq!(homography(&pairs), None);
    }

    #[test]
    fn whitener_makes_unit_covariance() {
        let c = Matrix2::new(0.04, 0.01, 0.01, 0.09);
        let w = whitener(&c);
        assert!((w * c * w.transpose() - Matrix2::identity()).norm() < 1e-12);
    }
}
