//! A set and a free function as one least-squares problem.

use std::ops::AddAssign;

use hydroline_sim::{Dual, Real};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::linear::mark;
use super::{Family, FamilyFit, Touched};
use crate::bank::{View, basis, outside};
use crate::descent::{Linear, Linearised};
use crate::fit::{Fit, Posed};
use crate::setting::Setting;
use crate::weights::Weights;
use hydroline_identify::forward::ForwardError;

/// Least squares of a set's unknowns, then a function's amplitudes.
pub struct Joint<'a> {
    setting: &'a Setting,
    weights: &'a Weights,
    set: &'a [usize],
    family: &'a Family,
    pub(super) posed: Posed<'a>,
    /// Prior precision of the amplitudes.
    precision: DMatrix<f64>,
    /// Half the logarithm of its determinant.
    pub(super) prior_half_log: f64,
    /// Globals, unknowns of the set with the starts, amplitudes.
    pub(super) sizes: (usize, usize, usize),
}

impl<'a> Joint<'a> {
    /// The problem of a set (as it stands in `fit`) and a function.
    pub fn new(
        setting: &'a Setting,
        weights: &'a Weights,
        fit: &'a Fit,
        function: &'a FamilyFit,
    ) -> Joint<'a> {
        let (precision, prior_half_log) = function.prior.precision(&function.family);
        Joint {
            setting,
            weights,
            set: &fit.set,
            family: &function.family,
            posed: Posed::new(setting, weights, &fit.set),
            precision,
            prior_half_log,
            sizes: (
                fit.globals(setting).len(),
                fit.at.len(),
                function.family.knots.len(),
            ),
        }
    }

    /// The set's unknowns of one run: globals, its start.
    fn own(&self, run: usize, at: &[f64]) -> Vec<f64> {
        let g = self.sizes.0;
        at[..g]
            .iter()
            .copied()
            .chain([at[g + 2 * run], at[g + 2 * run + 1]])
            .collect()
    }

    /// Motion of a run in a scalar; `own` and marks carry what derivatives there are.
    fn motion<T: Real>(
        &self,
        run: usize,
        own: &[T],
        amplitudes: &[f64],
        mark: &impl Fn(T, usize, f64) -> T,
    ) -> Vec<T> {
        let g = self.sizes.0;
        let start = (own[g], own[g + 1]);
        self.family.drive(
            self.setting,
            run,
            self.set,
            &own[..g],
            start,
            amplitudes,
            mark,
        )
    }

    /// Predicted minus measured per run, unweighted \[m, rad\].
    pub fn raw(&self, at: &[f64]) -> Vec<Vec<f64>> {
        let n = self.sizes.1;
        (0..self.setting.tracks.len())
            .map(|run| {
                let values = self.motion(run, &self.own(run, at), &at[n..], &|v, _, _| v);
                let measured = &self.setting.tracks[run].measured;
                values.iter().zip(measured).map(|(v, y)| v - y).collect()
            })
            .collect()
    }

    /// Motion of all runs less that of the set alone \[m, rad\].
    pub(super) fn response(&self, at: &[f64]) -> DVector<f64> {
        let (g, n, _) = self.sizes;
        let all: Vec<f64> = (0..self.setting.tracks.len())
            .flat_map(|run| {
                let own = self.own(run, at);
                let with = self.motion(run, &own, &at[n..], &|v, _, _| v);
                let start = (own[g], own[g + 1]);
                let without = self.setting.values(run, self.set, &own[..g], start);
                with.into_iter()
                    .zip(without)
                    .map(|(w, o)| w - o)
                    .collect::<Vec<_>>()
            })
            .collect();
        DVector::from_vec(all)
    }

    /// Whitened residual and Jacobian of one run: globals, its start, amplitudes.
    fn of_run(&self, run: usize, at: &[f64]) -> (DVector<f64>, DMatrix<f64>) {
        let (g, n, m) = self.sizes;
        let own = self.own(run, at);
        // A plain motion tells which hats it comes by, at a tenth of the cost of their derivatives.
        let touched = Touched::none();
        let values = self.motion(run, &own, &at[n..], &|v, hat, share| {
            touched.by(hat, share);
            v
        });
        let track = &self.setting.tracks[run];
        let mut r = DVector::from_iterator(
            values.len(),
            values.iter().zip(&track.measured).map(|(v, y)| v - y),
        );
        let mut j = DMatrix::zeros(track.times_s.len(), g + 2 + m);
        let (low, count) = touched.range();
        let amplitudes = &at[n..];
        match g + 2 + count {
            0..=12 => self.passes::<12>(run, &own, amplitudes, (low, count), &mut j),
            13..=16 | 25..=32 => self.passes::<16>(run, &own, amplitudes, (low, count), &mut j),
            _ => self.passes::<24>(run, &own, amplitudes, (low, count), &mut j),
        }
        self.weights.whiten(run, r.iter_mut());
        let moved = (0..g + 2).chain(g + 2 + low..g + 2 + low + count);
        for i in moved {
            self.weights.whiten(run, j.column_mut(i).iter_mut());
        }
        (r, j)
    }

    /// Raw derivatives of one run with respect to its own unknowns and the hats it comes by, `N` at a time.
    fn passes<const N: usize>(
        &self,
        run: usize,
        own: &[f64],
        amplitudes: &[f64],
        (low, count): (usize, usize),
        j: &mut DMatrix<f64>,
    ) {
        let before = own.len();
        for first in (0..before + count).step_by(N) {
            let duals = Dual::<N>::pass(own, first);
            let out = self.motion(run, &duals, amplitudes, &|mut v, hat, share| {
                mark(&mut v, first + low, before + hat, 1.0 - share);
                mark(&mut v, first + low, before + hat + 1, share);
                v
            });
            for (row, v) in out.iter().enumerate() {
                for (i, s) in v.slope.iter().take(before + count - first).enumerate() {
                    let unknown = first + i;
                    let column = unknown + if unknown < before { 0 } else { low };
                    j[(row, column)] = *s;
                }
            }
        }
    }

    /// Column of a run's Jacobian among all unknowns.
    fn column(&self, run: usize, i: usize) -> usize {
        let (g, n, _) = self.sizes;
        match i {
            i if i < g => i,
            i if i < g + 2 => g + 2 * run + (i - g),
            i => n + i - g - 2,
        }
    }

    fn prior_cost(&self, at: &[f64]) -> f64 {
        let n = self.sizes.1;
        let amplitudes = DVector::from_column_slice(&at[n..]);
        self.posed.prior_at(&at[..n]) + 0.5 * amplitudes.dot(&(&self.precision * &amplitudes))
    }

    /// Adds the priors' share to a gradient.
    fn pull(&self, at: &[f64], gradient: &mut DVector<f64>) {
        let n = self.sizes.1;
        for (i, (centre, k)) in self.posed.precisions(&at[..n]).into_iter().enumerate() {
            gradient[i] += (at[i] - centre) * k;
        }
        let pull = &self.precision * DVector::from_column_slice(&at[n..]);
        gradient.rows_mut(n, pull.len()).add_assign(&pull);
    }

    /// Whitened derivatives with respect to all unknowns, runs end to end.
    pub fn columns(&self, at: &[f64]) -> DMatrix<f64> {
        let (_, n, m) = self.sizes;
        let blocks: Vec<DMatrix<f64>> = (0..self.setting.tracks.len())
            .into_par_iter()
            .map(|run| self.of_run(run, at).1)
            .collect();
        let mut all = DMatrix::zeros(blocks.iter().map(DMatrix::nrows).sum(), n + m);
        let mut first = 0;
        for (run, j) in blocks.iter().enumerate() {
            for i in 0..j.ncols() {
                all.view_mut((first, self.column(run, i)), (j.nrows(), 1))
                    .copy_from(&j.column(i));
            }
            first += j.nrows();
        }
        all
    }

    /// Seen from candidates: what they would add to set and function. The function's prior stands as
    /// one more row per amplitude.
    pub fn view(&self, at: &[f64]) -> View {
        let (_, n, m) = self.sizes;
        let blocks: Vec<(DVector<f64>, DMatrix<f64>)> = (0..self.setting.tracks.len())
            .into_par_iter()
            .map(|run| self.of_run(run, at))
            .collect();
        let rows: usize = blocks.iter().map(|b| b.0.len()).sum();
        let mut all = DMatrix::zeros(rows + m, n + m);
        let mut residual = DVector::zeros(rows + m);
        let mut first = 0;
        for (run, (r, j)) in blocks.iter().enumerate() {
            residual.rows_mut(first, r.len()).copy_from(r);
            for i in 0..j.ncols() {
                all.view_mut((first, self.column(run, i)), (r.len(), 1))
                    .copy_from(&j.column(i));
            }
            first += r.len();
        }
        // The rows' sum of squares is the prior's: a root of the precision.
        if let Some(root) = self.precision.clone().cholesky() {
            let root = root.l().transpose();
            residual
                .rows_mut(rows, m)
                .copy_from(&(&root * DVector::from_column_slice(&at[n..])));
            all.view_mut((rows, n), (m, m)).copy_from(&root);
        }
        let basis = basis(&all);
        View {
            residual: outside(&basis, &residual),
            basis,
        }
    }
}

impl Linearised for Joint<'_> {
    fn bounds(&self, i: usize) -> (f64, f64) {
        if i < self.sizes.1 {
            self.posed.bounds(i)
        } else {
            (f64::NEG_INFINITY, f64::INFINITY)
        }
    }

    fn residuals(&self, at: &[f64]) -> (f64, Vec<Vec<f64>>) {
        let n = self.sizes.1;
        let all: Vec<Vec<f64>> = (0..self.setting.tracks.len())
            .into_par_iter()
            .map(|run| {
                let mut values = self.motion(run, &self.own(run, at), &at[n..], &|v, _, _| v);
                for (v, y) in values.iter_mut().zip(&self.setting.tracks[run].measured) {
                    *v -= y;
                }
                self.weights.whiten(run, values.iter_mut());
                values
            })
            .collect();
        let squares: f64 = all.iter().flatten().map(|v| 0.5 * v * v).sum();
        let total = squares + self.prior_cost(at);
        let total = if total.is_finite() {
            total
        } else {
            f64::INFINITY
        };
        (total, all)
    }

    fn linearise(&self, at: &[f64]) -> Result<Linear, ForwardError> {
        let (_, n, m) = self.sizes;
        let blocks: Vec<(DVector<f64>, DMatrix<f64>)> = (0..self.setting.tracks.len())
            .into_par_iter()
            .map(|run| self.of_run(run, at))
            .collect();
        let mut cost = self.prior_cost(at);
        let mut gradient = DVector::zeros(n + m);
        let mut hessian = DMatrix::zeros(n + m, n + m);
        let mut jacobians = Vec::with_capacity(blocks.len());
        for (run, (r, j)) in blocks.into_iter().enumerate() {
            let (c, gr, h) = (0.5 * r.norm_squared(), j.tr_mul(&r), j.tr_mul(&j));
            if !c.is_finite() || h.iter().any(|v| !v.is_finite()) {
                return Err(ForwardError {
                    run,
                    reason: format!(
                        "{}: the motion grows without bounds",
                        self.setting.tracks[run].name
                    ),
                });
            }
            cost += c;
            for i in 0..gr.len() {
                gradient[self.column(run, i)] += gr[i];
                for k in 0..gr.len() {
                    hessian[(self.column(run, i), self.column(run, k))] += h[(i, k)];
                }
            }
            jacobians.push(j);
        }
        self.pull(at, &mut gradient);
        for (i, (_, k)) in self.posed.precisions(&at[..n]).into_iter().enumerate() {
            hessian[(i, i)] += k;
        }
        hessian.view_mut((n, n), (m, m)).add_assign(&self.precision);
        Ok(Linear {
            cost,
            gradient,
            hessian,
            jacobians,
        })
    }

    fn gradient(
        &self,
        at: &[f64],
        residuals: &[Vec<f64>],
        jacobians: &[DMatrix<f64>],
    ) -> DVector<f64> {
        let mut gradient = DVector::zeros(at.len());
        for (run, (r, j)) in residuals.iter().zip(jacobians).enumerate() {
            for (i, column) in j.column_iter().enumerate() {
                gradient[self.column(run, i)] +=
                    column.iter().zip(r).map(|(a, b)| a * b).sum::<f64>();
            }
        }
        self.pull(at, &mut gradient);
        gradient
    }
}
