//! A free function beside a fitted set, linearly: what every function is asked first.

use hydroline_sim::Dual;
use hydroline_sim::single::Instant;
use nalgebra::{DMatrix, DVector, Dyn, SymmetricEigen};
use rayon::prelude::*;

use super::prior::{LENGTHS, Prior};
use super::{Acts, Family, FamilyFit, PENALTY, Touched};
use crate::bank::{View, outside, whitened};
use crate::fit::Fit;
use crate::setting::{PASS, Setting};
use crate::weights::Weights;

/// Largest prior sd of the logarithm of the factor on a law that is near the vocabulary's.
const NEAR_A_LAW: f64 = 0.4;

impl Family {
    /// Derivatives of the motion with respect to the amplitudes, all runs end to end.
    pub fn columns(&self, setting: &Setting, fit: &Fit) -> DMatrix<f64> {
        let m = self.knots.len();
        let blocks: Vec<DMatrix<f64>> = (0..setting.tracks.len())
            .into_par_iter()
            .map(|run| self.columns_of(setting, fit, run))
            .collect();
        let rows = blocks.iter().map(DMatrix::nrows).sum();
        let mut all = DMatrix::zeros(rows, m);
        let mut first = 0;
        for block in &blocks {
            all.view_mut((first, 0), (block.nrows(), m))
                .copy_from(block);
            first += block.nrows();
        }
        all
    }

    fn columns_of(&self, setting: &Setting, fit: &Fit, run: usize) -> DMatrix<f64> {
        let m = self.knots.len();
        let mut block = DMatrix::zeros(setting.tracks[run].times_s.len(), m);
        if !self.acts_in(run) {
            return block;
        }
        // A plain motion tells which hats it comes by: a tenth of the cost of their derivatives.
        let touched = Touched::none();
        let begin = fit.start(setting, run);
        let _ = setting.simulate(run, &fit.set, fit.globals(setting), begin, |h| {
            let (hat, share) = self.between(self.value(setting, run, h));
            touched.by(hat, share);
            0.0
        });
        let (low, count) = touched.range();
        let globals: Vec<Dual<PASS>> = fit
            .globals(setting)
            .iter()
            .map(|v| Dual::constant(*v))
            .collect();
        let start = (Dual::constant(begin.0), Dual::constant(begin.1));
        for first in (low..low + count).step_by(PASS) {
            let push = |here: &Instant<Dual<PASS>>, base: f64| {
                let mut made = Dual::constant(base);
                let (hat, share) = self.between(self.value(setting, run, here).value);
                let factor = self.factor(&setting.tracks[run], here).value;
                mark(&mut made, first, hat, factor * (1.0 - share));
                mark(&mut made, first, hat + 1, factor * share);
                made
            };
            let out = match self.acts {
                Acts::Force => setting.simulate(run, &fit.set, &globals, start, |h| push(h, 0.0)),
                Acts::Bends(candidate) => {
                    let Some(member) = fit.set.iter().position(|c| *c == candidate) else {
                        return block;
                    };
                    setting.simulate_bent(run, &fit.set, &globals, start, member, |h| push(h, 1.0))
                }
            };
            for (row, value) in out.iter().enumerate() {
                for (j, slope) in value.slope.iter().take(low + count - first).enumerate() {
                    block[(row, first + j)] = *slope;
                }
            }
        }
        block
    }

    /// Fits the amplitudes linearly beside a set; `None` where the function does nothing.
    pub fn fit(
        &self,
        setting: &Setting,
        weights: &Weights,
        fit: &Fit,
        view: &View,
    ) -> Option<FamilyFit> {
        let raw = self.columns(setting, fit);
        if raw.iter().any(|v| !v.is_finite()) {
            return None;
        }
        let m = raw.ncols();
        let columns: Vec<DVector<f64>> = (0..m)
            .map(|j| {
                outside(
                    &view.basis,
                    &whitened(setting, weights, &raw.column(j).into_owned()),
                )
            })
            .collect();
        let matrix = DMatrix::from_columns(&columns);
        let (squares, product) = (matrix.tr_mul(&matrix), matrix.tr_mul(&view.residual));
        let best = Smooth::best(self, setting, &squares, &product)?;
        let (amplitudes, sds) = best.amplitudes();
        Some(FamilyFit {
            family: self.clone(),
            response: &raw * &amplitudes,
            amplitudes: amplitudes.iter().copied().collect(),
            sds,
            gain: best.gain - PENALTY - self.choice(),
            prior: best.prior(),
        })
    }
}

/// Amplitudes alike over a length, with the prior variance that the evidence chooses.
pub(super) struct Smooth {
    length: f64,
    variance: f64,
    /// Log evidence over no function.
    gain: f64,
    /// Root of the correlation.
    root: DMatrix<f64>,
    eigen: SymmetricEigen<f64, Dyn>,
    /// Projections of the residual.
    product: DVector<f64>,
}

impl Smooth {
    /// The likeliest length and variance for half a' `squares` a + `product`' a, the cost over amplitudes a.
    pub(super) fn best(
        family: &Family,
        setting: &Setting,
        squares: &DMatrix<f64>,
        product: &DVector<f64>,
    ) -> Option<Smooth> {
        // A law that bends by far more than a third of its own size is another law.
        let largest_load = setting
            .tracks
            .iter()
            .flat_map(|t| &t.edges)
            .map(|e| e.1.abs())
            .fold(1.0, f64::max);
        let most = match family.acts {
            Acts::Bends(_) => NEAR_A_LAW * NEAR_A_LAW,
            // Nor is a force beyond what drives it.
            Acts::Force => largest_load * largest_load,
        };
        LENGTHS
            .iter()
            .filter_map(|share| {
                let length = Prior::length(family, *share, setting.tracks.len());
                Smooth::new(family, squares, product, length, most)
            })
            .max_by(|a, b| a.gain.total_cmp(&b.gain))
    }

    /// The prior it has.
    pub(super) fn prior(&self) -> Prior {
        Prior {
            sd: self.variance.sqrt(),
            length: self.length,
        }
    }

    /// `squares`, `product` = of the columns with themselves and with the residual; `most` = largest variance.
    fn new(
        family: &Family,
        squares: &DMatrix<f64>,
        product: &DVector<f64>,
        length: f64,
        most: f64,
    ) -> Option<Smooth> {
        let root = Prior::correlation(length, family).cholesky()?.unpack();
        // Amplitudes = root x numbers that are all alike and by themselves.
        let eigen = SymmetricEigen::new(root.transpose() * squares * &root);
        if eigen.eigenvalues.max() <= 0.0 {
            return None;
        }
        let product = eigen.eigenvectors.tr_mul(&root.tr_mul(product));
        let gain = |variance: f64| -> f64 {
            eigen
                .eigenvalues
                .iter()
                .zip(product.iter())
                .map(|(v, b)| {
                    let v = v.max(0.0);
                    0.5 * b * b / (v + 1.0 / variance) - 0.5 * (1.0 + v * variance).ln()
                })
                .sum()
        };
        let (gain, variance) = (0..60)
            .map(|k| 10f64.powf(-12.0 + 0.3 * f64::from(k)))
            .filter(|v| *v <= most)
            .map(|v| (gain(v), v))
            .max_by(|a, b| a.0.total_cmp(&b.0))?;
        Some(Smooth {
            length,
            variance,
            gain,
            root,
            eigen,
            product,
        })
    }

    /// Best amplitudes, and the sd of each.
    fn amplitudes(&self) -> (DVector<f64>, Vec<f64>) {
        let width = |i: usize| 1.0 / (self.eigen.eigenvalues[i].max(0.0) + 1.0 / self.variance);
        let rotated = DVector::from_fn(self.product.len(), |i, _| -self.product[i] * width(i));
        let turned = &self.root * &self.eigen.eigenvectors;
        let sds = (0..turned.nrows())
            .map(|j| {
                (0..turned.ncols())
                    .map(|i| turned[(j, i)].powi(2) * width(i))
                    .sum::<f64>()
                    .sqrt()
            })
            .collect();
        (turned * rotated, sds)
    }
}

/// Adds a derivative with respect to an unknown (a hat, by its number) where this pass, from `first` on, holds it.
pub(super) fn mark<const N: usize>(made: &mut Dual<N>, first: usize, hat: usize, by: f64) {
    if let Some(slope) = hat.checked_sub(first).and_then(|i| made.slope.get_mut(i)) {
        *slope += by;
    }
}
