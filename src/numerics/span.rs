//! Spans of columns, and what lies outside of them.

use nalgebra::{DMatrix, DVector};

/// Orthonormal columns that span those of a matrix.
pub fn basis(matrix: &DMatrix<f64>) -> DMatrix<f64> {
    let mut kept: Vec<DVector<f64>> = Vec::new();
    for column in matrix.column_iter() {
        let norm = column.norm();
        if norm <= 0.0 || !norm.is_finite() {
            continue;
        }
        let mut v = column / norm;
        // Twice is enough (Kahan).
        for _ in 0..2 {
            for q in &kept {
                let along = v.dot(q);
                v.axpy(-along, q, 1.0);
            }
        }
        let left = v.norm();
        if left > 1e-9 {
            kept.push(v / left);
        }
    }
    if kept.is_empty() {
        return DMatrix::zeros(matrix.nrows(), 0);
    }
    DMatrix::from_columns(&kept)
}

/// Part of a column outside of a span.
pub fn outside(basis: &DMatrix<f64>, column: &DVector<f64>) -> DVector<f64> {
    let mut left = column.clone();
    for _ in 0..2 {
        let along = basis.tr_mul(&left);
        left.gemv(-1.0, basis, &along, 1.0);
    }
    left
}

/// Root mean square of a column; 0 of an empty one.
pub fn rms(column: &DVector<f64>) -> f64 {
    column.norm() / (column.len().max(1) as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Nothing of a combination of columns is left outside of their span, and what is left of any other stands upright.
        #[test]
        fn outside_is_upright(values in proptest::collection::vec(-1.0..1.0f64, 40), a in -3.0..3.0f64, b in -3.0..3.0f64) {
            let matrix = DMatrix::from_column_slice(10, 3, &values[..30]);
            let span = basis(&matrix);
            let within = matrix.column(0) * a + matrix.column(2) * b;
            prop_assert!(outside(&span, &within).norm() < 1e-9);
            let left = outside(&span, &DVector::from_column_slice(&values[30..]));
            prop_assert!(matrix.tr_mul(&left).norm() < 1e-9);
        }
    }
}
