//! Cholesky factors of matrices whose rows differ by orders of magnitude.
//!
//! Scaling a positive definite matrix to unit diagonal is within √n of the best diagonal scaling
//! (van der Sluis 1969). Cholesky itself does not need it: its rounding errors are the same in any
//! scaling (Higham, Accuracy and Stability of Numerical Algorithms, 2nd ed., theorem 10.6). What needs it is
//! anything added to the diagonal: damping and jitter then mean the same for a mass and for a drag coefficient.

use nalgebra::allocator::Allocator;
use nalgebra::{Cholesky, DefaultAllocator, Dim, OMatrix, OVector, U1};

/// Added to the unit diagonal where no caller says otherwise.
///
/// Cholesky succeeds when the smallest eigenvalue of the scaled matrix is above about n² ε (Higham, theorem
/// 10.7: n γₙ₊₁); this covers n = 30 and moves a solution by less than 1e-12 of itself per unit of condition.
pub const JITTER: f64 = 1e-13;

/// Added to the unit diagonal of derivatives that something is projected off: two that do the same are one there.
///
/// Columns whose angle is below its root (1e-5) count as one. Derivatives by finite differences and whitened columns agree no
/// better than that; larger, and unknowns that the data do distinguish lose part of what they take up.
pub const PROJECTION_JITTER: f64 = 1e-10;

/// How rows and columns are scaled before anything is added to the diagonal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scaling {
    /// To unit diagonal: for unknowns in any units. Damping and jitter are added to the ones.
    UnitDiagonal,
    /// Not at all: for unknowns that are already in units of their own size, and for small matrices in inner loops
    /// whose n square roots would be felt. Damping and jitter multiply the diagonal, which is the same.
    AsGiven,
}

/// L Lᵀ = S A S + jitter, S diagonal.
#[derive(Debug, Clone)]
pub struct ScaledCholesky<D: Dim>
where
    DefaultAllocator: Allocator<D> + Allocator<D, D>,
{
    factor: Cholesky<f64, D>,
    /// Diagonal of S; 0 where the matrix has nothing in a row.
    scale: OVector<f64, D>,
}

impl<D: Dim> ScaledCholesky<D>
where
    DefaultAllocator: Allocator<D> + Allocator<D, D>,
{
    /// Of a symmetric matrix scaled to unit diagonal, with `jitter` added to the ones ([`JITTER`] unless there is a
    /// reason for another). Only rows of zeros are let through beside positive ones: their solution is zero.
    ///
    /// `None` where the matrix is not positive definite, or not finite.
    pub fn new(matrix: &OMatrix<f64, D, D>, jitter: f64) -> Option<Self> {
        let size = matrix.shape_generic().0;
        Self::of_rows(matrix, size, Some, Scaling::UnitDiagonal, 0.0, jitter)
    }

    /// The same of the rows and columns that are free; in the others it is the identity, and solutions and the inverse
    /// are zero.
    pub fn of_free(
        matrix: &OMatrix<f64, D, D>,
        free: impl Fn(usize) -> bool,
        scaling: Scaling,
        jitter: f64,
    ) -> Option<Self> {
        let size = matrix.shape_generic().0;
        Self::of_rows(matrix, size, |k| free(k).then_some(k), scaling, 0.0, jitter)
    }

    /// Of the rows and columns that `row` names for 0, 1, .. up to `size`; `None` = a row of the identity.
    pub(crate) fn of_rows<E: Dim>(
        matrix: &OMatrix<f64, E, E>,
        size: D,
        row: impl Fn(usize) -> Option<usize>,
        scaling: Scaling,
        damping: f64,
        jitter: f64,
    ) -> Option<Self>
    where
        DefaultAllocator: Allocator<E, E>,
    {
        let mut sound = true;
        let scale = OVector::<f64, D>::from_fn_generic(size, U1, |a, _| {
            let Some(i) = row(a) else {
                return 0.0;
            };
            let diagonal = matrix[(i, i)];
            sound &= diagonal >= 0.0;
            match scaling {
                Scaling::AsGiven => 1.0,
                Scaling::UnitDiagonal if diagonal > 0.0 => 1.0 / diagonal.sqrt(),
                Scaling::UnitDiagonal => 0.0,
            }
        });
        if !sound {
            return None;
        }
        let scaled = OMatrix::<f64, D, D>::from_fn_generic(size, size, |a, b| {
            let (Some(i), Some(j)) = (row(a), row(b)) else {
                return if a == b { 1.0 } else { 0.0 };
            };
            let entry = matrix[(i, j)] * scale[a] * scale[b];
            match scaling {
                _ if a != b => entry,
                Scaling::AsGiven => entry * (1.0 + damping + jitter),
                Scaling::UnitDiagonal if scale[a] > 0.0 => entry + damping + jitter,
                Scaling::UnitDiagonal => 1.0,
            }
        });
        let factor = Cholesky::new(scaled)?;
        Some(ScaledCholesky { factor, scale })
    }

    /// A⁻¹ b, zero where A has nothing in a row.
    pub fn solve(&self, right: &OVector<f64, D>) -> OVector<f64, D> {
        let mut x = right.component_mul(&self.scale);
        self.factor.solve_mut(&mut x);
        x.component_mul_assign(&self.scale);
        x
    }

    /// A⁻¹ B.
    pub fn solve_columns<C: Dim>(&self, right: &OMatrix<f64, D, C>) -> OMatrix<f64, D, C>
    where
        DefaultAllocator: Allocator<D, C>,
    {
        let mut x = right.clone();
        for mut column in x.column_iter_mut() {
            column.component_mul_assign(&self.scale);
        }
        self.factor.solve_mut(&mut x);
        for mut column in x.column_iter_mut() {
            column.component_mul_assign(&self.scale);
        }
        x
    }

    /// A⁻¹, zero in rows and columns where A has nothing.
    pub fn inverse(&self) -> OMatrix<f64, D, D> {
        let mut inverse = self.factor.inverse();
        for j in 0..self.scale.len() {
            for i in 0..self.scale.len() {
                inverse[(i, j)] *= self.scale[i] * self.scale[j];
            }
        }
        inverse
    }

    /// ln det A over the rows that have something in them.
    pub fn ln_determinant(&self) -> f64 {
        let scales = self.scale.iter().filter(|s| **s > 0.0);
        ln_determinant(&self.factor) - 2.0 * scales.map(|s| s.ln()).sum::<f64>()
    }

    /// vᵀ A⁻¹ v: the squared Mahalanobis distance where A is a covariance.
    pub fn squared_norm(&self, v: &OVector<f64, D>) -> f64 {
        v.dot(&self.solve(v))
    }
}

/// Log determinant of the matrix that a factor is of.
pub fn ln_determinant<D: Dim>(root: &Cholesky<f64, D>) -> f64
where
    DefaultAllocator: Allocator<D, D>,
{
    let lower = root.l_dirty();
    let pivots = (0..lower.nrows()).map(|k| 2.0 * lower[(k, k)].ln());
    pivots.sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
    use proptest::prelude::*;

    /// A positive definite matrix with units that differ by 10^`spread` from row to row.
    fn matrix(entries: &[f64], units: &[f64]) -> DMatrix<f64> {
        let n = units.len();
        let root = DMatrix::from_fn(n, n, |i, j| {
            entries[n * i + j] + if i == j { 3.0 } else { 0.0 }
        });
        let unit = DMatrix::from_diagonal(&DVector::from_fn(n, |i, _| 10f64.powf(units[i])));
        &unit * (root.transpose() * root) * &unit
    }

    proptest! {
        #[test]
        fn solves_inverts_and_measures_in_any_units(
            entries in prop::collection::vec(-1.0..1.0f64, 16),
            units in prop::collection::vec(-8.0..8.0f64, 4),
            truth in prop::collection::vec(-1.0..1.0f64, 4),
        ) {
            let a = matrix(&entries, &units);
            let factor = ScaledCholesky::new(&a, 0.0).unwrap();
            let x = DVector::from_fn(4, |i, _| truth[i] * 10f64.powf(-units[i]));
            let right = &a * &x;
            let found = factor.solve(&right);
            for i in 0..4 {
                prop_assert!((found[i] - x[i]).abs() < 1e-9 * 10f64.powf(-units[i]), "{found} {x}");
            }
            let columns = DMatrix::from_columns(&[right.clone(), 2.0 * &right]);
            let both = factor.solve_columns(&columns);
            prop_assert!((both.column(0) - &found).norm() <= 1e-12 * found.norm());
            prop_assert!((both.column(1) - 2.0 * &found).norm() <= 1e-12 * found.norm());
            prop_assert!((factor.squared_norm(&right) - right.dot(&x)).abs() < 1e-9 * right.dot(&x).abs().max(1e-9));
            let inverse = factor.inverse();
            for j in 0..4 {
                let unit = DVector::from_fn(4, |i, _| if i == j { 1.0 } else { 0.0 });
                let column = factor.solve(&unit);
                for i in 0..4 {
                    prop_assert!((inverse[(i, j)] - column[i]).abs() < 1e-9 * 10f64.powf(-units[i] - units[j]));
                }
            }
            let logs = 2.0 * std::f64::consts::LN_10 * units.iter().sum::<f64>();
            let plain = matrix(&entries, &[0.0; 4]).determinant().ln();
            prop_assert!((factor.ln_determinant() - plain - logs).abs() < 1e-8);
        }
    }

    #[test]
    fn a_row_of_zeros_has_no_say_and_gets_none() {
        let a = Matrix3::new(4.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 2.0);
        let factor = ScaledCholesky::new(&a, 0.0).unwrap();
        let x = factor.solve(&Vector3::new(4.0, 7.0, 1.0));
        assert!((x - Vector3::new(1.0, 0.0, 0.0)).norm() < 1e-15, "{x}");
        assert!((factor.ln_determinant() - 7f64.ln()).abs() < 1e-14);
        assert_eq!(factor.inverse().row(1).norm(), 0.0);
    }

    #[test]
    fn jitter_makes_a_singular_matrix_definite_and_hardly_moves_what_is_determined() {
        // Only the sum of the first two is known: 2, and the third.
        let a = Matrix3::new(1e8, 1e2, 0.0, 1e2, 1e-4, 0.0, 0.0, 0.0, 1.0);
        assert!(ScaledCholesky::new(&(-a), JITTER).is_none());
        let factor = ScaledCholesky::new(&a, JITTER).unwrap();
        let x = factor.solve(&Vector3::new(2e4, 2e-2, 3.0));
        assert!((x[0] * 1e4 + x[1] * 1e-2 - 2.0).abs() < 1e-3, "{x}");
        assert!((x[2] - 3.0).abs() < 1e-12, "{x}");
        let nan = Matrix3::from_element(f64::NAN);
        assert!(ScaledCholesky::new(&nan, JITTER).is_none());
    }
}
