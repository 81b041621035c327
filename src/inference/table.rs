//! Prior of a table: a Gaussian process over its points, of any size and smoothness.
//!
//! Matérn's kernel with nu = 5/2 (Rasmussen and Williams 2006, eq. 4.17): twice differentiable, as forces of water are.
//! Given size and length its points are integrated out exactly, for they are linear; both are summed over.

use std::sync::OnceLock;

use hydroline_numerics::cholesky::ln_determinant;
use hydroline_sim::effect::covariate_table::POINTS;
use nalgebra::{Cholesky, DMatrix, DVector, DVectorView};

/// Correlation lengths over the range of the covariate: from a bump at one place to a law over all of it.
pub const LENGTHS: [f64; 5] = [0.06, 0.13, 0.3, 0.7, 1.6];
/// Sizes over the unit: half-decades.
pub const SIZES: [f64; 12] = [
    0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1e3, 3e3,
];
/// On the diagonal of a kernel: long ones are all but singular.
const JITTER: f64 = 1e-6;

/// Size and length of a table, by their places.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct TableCell {
    /// Place in [`SIZES`].
    pub size: usize,
    /// Place in [`LENGTHS`].
    pub length: usize,
}

impl TableCell {
    /// Where a search begins: of the unit's size, a third of the range long.
    pub const BEGIN: TableCell = TableCell { size: 4, length: 2 };

    /// Every one.
    pub fn all() -> impl Iterator<Item = TableCell> {
        (0..SIZES.len())
            .flat_map(|size| (0..LENGTHS.len()).map(move |length| TableCell { size, length }))
    }

    /// Log prior probability: half-Cauchy sizes about a median \[units\], every length alike.
    pub fn ln_prior(self, median: f64) -> f64 {
        super::hyper::ln_half_cauchy(&SIZES, self.size, median) - (LENGTHS.len() as f64).ln()
    }
}

/// A kernel of unit size.
pub(super) struct Kernel {
    pub(super) precision: DMatrix<f64>,
    ln_determinant: f64,
}

/// Information of the mean of a table that is to have none, over that of its size.
const NO_MEAN: f64 = 1e4;

/// Kernels of any function, and of functions without a mean.
pub(super) fn kernels(centred: bool) -> &'static [Kernel; LENGTHS.len()] {
    static PLAIN: OnceLock<[Kernel; LENGTHS.len()]> = OnceLock::new();
    static CENTRED: OnceLock<[Kernel; LENGTHS.len()]> = OnceLock::new();
    if centred {
        return CENTRED.get_or_init(|| std::array::from_fn(|l| without_mean(&kernels(false)[l])));
    }
    PLAIN.get_or_init(|| {
        LENGTHS.map(|length| {
            let last = (POINTS - 1) as f64;
            let k = DMatrix::from_fn(POINTS, POINTS, |i, j| {
                let r = 5f64.sqrt() * (i as f64 - j as f64).abs() / last / length;
                let jitter = if i == j { JITTER } else { 0.0 };
                (1.0 + r + r * r / 3.0) * (-r).exp() + jitter
            });
            match Cholesky::new(k) {
                Some(root) => Kernel {
                    ln_determinant: ln_determinant(&root),
                    precision: root.inverse(),
                },
                // A kernel with its jitter has a root; without one it would be no correlation at all.
                None => Kernel {
                    precision: DMatrix::identity(POINTS, POINTS),
                    ln_determinant: 0.0,
                },
            }
        })
    })
}

/// The same kernel, of functions whose mean over the points is 0: a law's number has the mean already.
fn without_mean(kernel: &Kernel) -> Kernel {
    let mean = DMatrix::from_element(POINTS, POINTS, NO_MEAN / POINTS as f64);
    let precision = &kernel.precision + mean;
    match Cholesky::new(precision.clone()) {
        Some(root) => Kernel {
            ln_determinant: -ln_determinant(&root),
            precision,
        },
        None => Kernel {
            ln_determinant: kernel.ln_determinant,
            precision: kernel.precision.clone(),
        },
    }
}

/// A table among the numbers of a model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Block {
    /// Place of the table among the body's candidates.
    pub candidate: usize,
    /// Place of its first point among the numbers.
    pub first: usize,
    /// Unit of its sizes: \[N, N m\] of a force, 1 of a trend.
    pub unit: f64,
    /// Median of the size, in units.
    pub median: f64,
    /// Its points have no mean.
    pub centred: bool,
}

impl Block {
    fn scale(&self, cell: TableCell) -> f64 {
        (self.unit * SIZES[cell.size]).powi(-2)
    }

    fn points<'a>(&self, point: &'a [f64]) -> DVectorView<'a, f64> {
        DVectorView::from_slice(&point[self.first..self.first + POINTS], POINTS)
    }

    /// Log density of its points.
    pub fn ln(&self, cell: TableCell, point: &[f64]) -> f64 {
        let (kernel, scale) = (&kernels(self.centred)[cell.length], self.scale(cell));
        let w = self.points(point);
        let square = w.dot(&(&kernel.precision * w));
        let n = POINTS as f64;
        -0.5 * (scale * square
            + kernel.ln_determinant
            + n * (std::f64::consts::TAU.ln() - scale.ln()))
    }

    /// Adds what the prior says to normal equations.
    pub fn add(
        &self,
        cell: TableCell,
        point: &[f64],
        information: &mut DMatrix<f64>,
        gradient: &mut DVector<f64>,
    ) {
        let (kernel, scale) = (&kernels(self.centred)[cell.length], self.scale(cell));
        let slope = &kernel.precision * self.points(point) * scale;
        let mut g = gradient.rows_mut(self.first, POINTS);
        g -= slope;
        let mut block = information.view_mut((self.first, self.first), (POINTS, POINTS));
        block += &kernel.precision * scale;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_share_all_probability() {
        let sum: f64 = TableCell::all().map(|c| c.ln_prior(3.0).exp()).sum();
        assert!((sum - 1.0).abs() < 1e-9, "{sum}");
    }

    #[test]
    fn slope_and_curvature_are_those_of_the_density() {
        let block = Block {
            candidate: 0,
            first: 1,
            unit: 0.3,
            median: 1.0,
            centred: true,
        };
        let cell = TableCell { size: 5, length: 2 };
        let mut point: Vec<f64> = (0..POINTS + 2).map(|k| (0.2 * k as f64).sin()).collect();
        let n = point.len();
        let (mut information, mut gradient) = (DMatrix::zeros(n, n), DVector::zeros(n));
        block.add(cell, &point, &mut information, &mut gradient);
        let here = block.ln(cell, &point);
        let step = 1e-3;
        point[7] += step;
        let up = block.ln(cell, &point) - here;
        let expected = gradient[7] * step - 0.5 * information[(7, 7)] * step * step;
        assert!(
            (up - expected).abs() < 1e-6 * expected.abs().max(1.0),
            "{up} {expected}"
        );
        assert!(gradient[0] == 0.0 && information[(0, 0)] == 0.0);
    }

    /// Density of a draw's points: one half per point below the mode on average.
    #[test]
    fn it_is_normalised() {
        // At the mode the density is (2 pi)^-n/2 |K|^-1/2 s^-n.
        let block = Block {
            candidate: 0,
            first: 0,
            unit: 2.0,
            median: 1.0,
            centred: true,
        };
        let at = |size| block.ln(TableCell { size, length: 1 }, &[0.0; POINTS]);
        let ratio = (at(4) - at(6)) / POINTS as f64;
        assert!((ratio - 10f64.ln()).abs() < 1e-9, "{ratio}");
    }
}
