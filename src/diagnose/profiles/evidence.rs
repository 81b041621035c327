//! Evidence of a Gaussian problem: a quadratic log likelihood under a normal prior.

use hydroline_numerics::cholesky::ln_determinant;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// log likelihood about 0: c + bᵀx − xᵀAx/2.
#[derive(Debug, Clone)]
pub struct Quadratic {
    /// A: minus the second derivative.
    pub a: DMatrix<f64>,
    /// b: gradient at 0.
    pub b: DVector<f64>,
    /// c: value at 0.
    pub c: f64,
}

/// Inverse of a covariance and half its log determinant; `None` where it is no covariance.
pub fn precision(k: DMatrix<f64>) -> Option<(DMatrix<f64>, f64)> {
    let l = Cholesky::new(k)?;
    let half = 0.5 * ln_determinant(&l);
    Some((l.inverse(), half))
}

/// L⁻¹ of a factor L: the inverse's entries are dot products of its columns.
pub fn inverse_factor(l: &Cholesky<f64, Dyn>) -> Option<DMatrix<f64>> {
    let lower = l.l_dirty();
    let n = lower.nrows();
    let mut out = DMatrix::identity(n, n);
    for j in 0..n {
        // Nothing stands above the diagonal.
        let rest = lower.view((j, j), (n - j, n - j));
        if !rest.solve_lower_triangular_mut(&mut out.view_mut((j, j), (n - j, 1))) {
            return None;
        }
    }
    Some(out)
}

impl Quadratic {
    /// Most probable point, log evidence and posterior precision's factor under a prior with this
    /// precision; `half_log_k` = half the log determinant of the prior's covariance.
    pub fn solved(
        &self,
        prior: &DMatrix<f64>,
        half_log_k: f64,
    ) -> Option<(DVector<f64>, f64, Cholesky<f64, Dyn>)> {
        let l = Cholesky::new(&self.a + prior)?;
        let x = l.solve(&self.b);
        let value = self.c + 0.5 * self.b.dot(&x) - 0.5 * ln_determinant(&l) - half_log_k;
        value.is_finite().then_some((x, value, l))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Dot products of the columns of L⁻¹ are the inverse.
    #[test]
    fn the_inverse_from_its_factor() {
        let root = DMatrix::from_fn(5, 5, |i, j| ((3 * i + 7 * j) as f64).sin());
        let l = Cholesky::new(&root * root.transpose() + DMatrix::identity(5, 5)).unwrap();
        let r = inverse_factor(&l).unwrap();
        assert!((r.tr_mul(&r) - l.inverse()).amax() < 1e-12);
    }

    /// One number measured once: evidence is the density of the measurement, N(y; 0, s² + k).
    #[test]
    fn evidence_of_one_number() {
        let (y, s, k) = (1.3f64, 0.4f64, 2.0f64);
        let log_normal = |x: f64, v: f64| -0.5 * (x * x / v + v.ln() + std::f64::consts::TAU.ln());
        let q = Quadratic {
            a: DMatrix::from_element(1, 1, 1.0 / (s * s)),
            b: DVector::from_element(1, y / (s * s)),
            c: log_normal(y, s * s),
        };
        let (p, half) = precision(DMatrix::from_element(1, 1, k)).unwrap();
        let (x, value, _) = q.solved(&p, half).unwrap();
        assert!((value - log_normal(y, s * s + k)).abs() < 1e-12, "{value}");
        assert!((x[0] - y * k / (k + s * s)).abs() < 1e-12);
    }
}
