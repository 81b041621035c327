//! From an information matrix to a covariance, where some directions may have no information.

use nalgebra::{DMatrix, SymmetricEigen};

/// Covariance of unknowns, from their information matrix.
#[derive(Debug, Clone)]
pub struct Covariance {
    /// Pseudo-inverse: what directions without information would add is left out.
    pub matrix: DMatrix<f64>,
    /// Unknowns that take part in a direction without information: their variance is infinite.
    pub undetermined: Vec<bool>,
}

/// Share of a direction without information that an unknown must have to count as undetermined: what rounding
/// mixes into an eigenvector is orders of magnitude less.
const TAKES_PART: f64 = 1e-3;

impl Covariance {
    /// Of JᵀJ (residuals in units of their sd). After scaling the diagonal to one, a direction counts as without
    /// information when its eigenvalue is at most `rank` of the largest: below about 1e-13 of it an eigenvalue
    /// is rounding of the matrix (n ε, Weyl's theorem; Golub and Van Loan, 4th ed., section 8.1); a caller whose
    /// derivatives have more error than that gives more.
    pub fn of_information(information: &DMatrix<f64>, rank: f64) -> Self {
        let n = information.nrows();
        let scale: Vec<f64> = (0..n)
            .map(|i| information[(i, i)].max(0.0).sqrt())
            .map(|s| if s > 0.0 { 1.0 / s } else { 0.0 })
            .collect();
        let scaled = DMatrix::from_fn(n, n, |i, j| information[(i, j)] * scale[i] * scale[j]);
        let eigen = SymmetricEigen::new(scaled);
        let largest = eigen.eigenvalues.max().max(f64::MIN_POSITIVE);
        let mut inverse = DMatrix::<f64>::zeros(n, n);
        let mut undetermined: Vec<bool> = scale.iter().map(|s| *s == 0.0).collect();
        for (k, value) in eigen.eigenvalues.iter().enumerate() {
            let direction = eigen.eigenvectors.column(k);
            if *value > rank * largest {
                inverse.ger(1.0 / value, &direction, &direction, 1.0);
            } else {
                for (lost, share) in undetermined.iter_mut().zip(direction.iter()) {
                    *lost |= share.abs() > TAKES_PART;
                }
            }
        }
        let matrix = DMatrix::from_fn(n, n, |i, j| inverse[(i, j)] * scale[i] * scale[j]);
        Covariance {
            matrix,
            undetermined,
        }
    }

    /// With infinite variances where undetermined, and no covariance with anything.
    pub fn with_infinities(mut self) -> DMatrix<f64> {
        let n = self.undetermined.len();
        for i in (0..n).filter(|i| self.undetermined[*i]) {
            self.matrix.row_mut(i).fill(0.0);
            self.matrix.column_mut(i).fill(0.0);
            self.matrix[(i, i)] = f64::INFINITY;
        }
        self.matrix
    }
}

/// Correlations of a covariance; 0 where a variance is zero or infinite.
pub fn correlation(covariance: &DMatrix<f64>) -> DMatrix<f64> {
    DMatrix::from_fn(covariance.nrows(), covariance.ncols(), |i, j| {
        let size = (covariance[(i, i)] * covariance[(j, j)]).sqrt();
        if i == j {
            1.0
        } else if size.is_finite() && size > 0.0 {
            (covariance[(i, j)] / size).clamp(-1.0, 1.0)
        } else {
            0.0
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Unknowns 0 and 1 only as a sum; 2 alone; 3 not at all.
    fn example() -> DMatrix<f64> {
        let j = DMatrix::from_row_slice(
            3,
            4,
            &[1.0, 1.0, 0.0, 0.0, 2.0, 2.0, 0.0, 0.0, 0.0, 0.0, 4.0, 0.0],
        );
        j.transpose() * &j
    }

    #[test]
    fn a_direction_without_information_is_infinite_and_the_rest_is_not() {
        let c = Covariance::of_information(&example(), 1e-11);
        assert_eq!(c.undetermined, [true, true, false, true]);
        assert!((c.matrix[(2, 2)] - 1.0 / 16.0).abs() < 1e-12);
        // The pseudo-inverse: the sum has variance 1/5, its halves share it.
        assert!((c.matrix[(0, 0)] - 0.05).abs() < 1e-12 && c.matrix[(3, 3)] == 0.0);
        let infinite = c.with_infinities();
        for k in [0, 1, 3] {
            assert!(infinite[(k, k)].is_infinite());
            assert_eq!(infinite[(k, 2)], 0.0);
        }
        let r = correlation(&infinite);
        assert_eq!((r[(0, 0)], r[(0, 1)], r[(2, 2)]), (1.0, 0.0, 1.0));
    }

    #[test]
    fn it_is_the_inverse_where_there_is_one_whatever_the_units() {
        let units = [1e-6, 1.0, 1e5];
        let plain = DMatrix::from_row_slice(3, 3, &[4.0, 1.0, 0.5, 1.0, 3.0, -0.2, 0.5, -0.2, 2.0]);
        let a = DMatrix::from_fn(3, 3, |i, j| plain[(i, j)] * units[i] * units[j]);
        let c = Covariance::of_information(&a, 1e-13);
        let inverse = plain.try_inverse().unwrap();
        for i in 0..3 {
            for j in 0..3 {
                let want = inverse[(i, j)] / (units[i] * units[j]);
                assert!((c.matrix[(i, j)] - want).abs() < 1e-12 / (units[i] * units[j]));
            }
        }
    }
}
