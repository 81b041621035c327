//! Parameters of all runs in one vector, residuals whitened run by run, objectives.

use hydroline_numerics::least_squares::Normal;
use hydroline_numerics::noise::{Noise, Whitener};
use hydroline_numerics::{cancel, parallel};
use nalgebra::{DMatrix, DVector, Dyn};

use super::forward::{Forward, ForwardError, Free};

/// Function of the residuals that a fit minimises.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Objective {
    /// Half the sum of squared whitened residuals.
    LeastSquares,
    /// Sum over runs of the paper's Eq. 10, each normalised: mean |x_eof - x_img| over the run's
    /// measured range. (The paper says "normalised", not by what; this is our choice.)
    SumOfAbsolute,
}

/// A model, its data, and how residuals are weighted.
pub struct Problem<'a> {
    forward: &'a dyn Forward,
    /// `[run][slot]`
    whiteners: Vec<Vec<Whitener>>,
    first_local: Vec<usize>,
    free: Vec<Free>,
    /// Weight of one residual in the L1 objective, `[run][slot]`.
    l1_weight: Vec<Vec<f64>>,
}

impl<'a> Problem<'a> {
    /// White noise of the given sd per slot.
    pub fn new(forward: &'a dyn Forward, sds: &[f64]) -> Self {
        let mut free = forward.globals().to_vec();
        let mut first_local = Vec::new();
        for run in 0..forward.runs() {
            first_local.push(free.len());
            free.extend_from_slice(forward.locals(run));
        }
        let slots = forward.slots().len();
        let l1_weight = (0..forward.runs())
            .map(|run| {
                (0..slots)
                    .map(|slot| l1_weight(forward, run, slot))
                    .collect()
            })
            .collect();
        let mut problem = Problem {
            forward,
            whiteners: Vec::new(),
            first_local,
            free,
            l1_weight,
        };
        problem.set_white(sds);
        problem
    }

    /// Weighs every slot with white noise of this sd.
    pub fn set_white(&mut self, sds: &[f64]) {
        let noises: Vec<Noise> = sds.iter().map(|sd| Noise::white(*sd)).collect();
        self.set_noise(&noises, |_, _, _| true);
    }

    /// Weighs every slot with its noise; `used(run, slot, sample)` leaves outliers out.
    pub fn set_noise(&mut self, noises: &[Noise], used: impl Fn(usize, usize, usize) -> bool) {
        let slots = self.forward.slots().len();
        self.whiteners = (0..self.forward.runs())
            .map(|run| {
                let measured = self.forward.measured(run);
                let times_s = self.forward.times_s(run);
                noises
                    .iter()
                    .enumerate()
                    .map(|(slot, noise)| {
                        Whitener::new(times_s, *noise, |k| {
                            measured[k * slots + slot].is_finite() && used(run, slot, k)
                        })
                    })
                    .collect()
            })
            .collect();
    }

    /// Every free number: globals, then each run's.
    pub fn free(&self) -> &[Free] {
        &self.free
    }

    /// The model.
    pub fn forward(&self) -> &dyn Forward {
        self.forward
    }

    /// Starting values.
    pub fn start(&self) -> Vec<f64> {
        self.free.iter().map(|f| f.start).collect()
    }

    /// Samples that count, over all slots.
    pub fn samples(&self) -> usize {
        self.whiteners.iter().flatten().map(Whitener::used).sum()
    }

    /// Where the run's own parameters stand in the vector.
    pub fn columns(&self, run: usize) -> Vec<usize> {
        let globals = 0..self.forward.globals().len();
        let first = self.first_local[run];
        globals
            .chain(first..first + self.forward.locals(run).len())
            .collect()
    }

    /// A run's parameters.
    pub fn of_run(&self, run: usize, parameters: &[f64]) -> Vec<f64> {
        self.columns(run)
            .into_iter()
            .map(|c| parameters[c])
            .collect()
    }

    /// Predicted minus measured, unweighted, `[slot]` of series; NaN where nothing was measured.
    ///
    /// # Errors
    /// [`ForwardError`].
    pub fn raw_residuals(
        &self,
        run: usize,
        parameters: &[f64],
    ) -> Result<Vec<Vec<f64>>, ForwardError> {
        cancel::check();
        let mut values = Vec::new();
        self.forward
            .values(run, &self.of_run(run, parameters), &mut values)?;
        let slots = self.forward.slots().len();
        let measured = self.forward.measured(run);
        let slot = |c: usize| {
            values
                .iter()
                .zip(measured)
                .skip(c)
                .step_by(slots)
                .map(|(v, m)| v - m)
                .collect()
        };
        Ok((0..slots).map(slot).collect())
    }

    /// Whitened residuals of a run, `[slot]` of series; 0 where nothing counts.
    ///
    /// # Errors
    /// [`ForwardError`].
    pub fn whitened(&self, run: usize, parameters: &[f64]) -> Result<Vec<Vec<f64>>, ForwardError> {
        let mut series = self.raw_residuals(run, parameters)?;
        for (values, filter) in series.iter_mut().zip(&self.whiteners[run]) {
            filter.apply(values.iter_mut());
        }
        Ok(series)
    }

    /// The objective; infinite where the motion diverges or a bound is left.
    pub fn objective(&self, kind: Objective, parameters: &[f64]) -> f64 {
        let inside = self
            .free
            .iter()
            .zip(parameters)
            .all(|(f, v)| (f.low..=f.high).contains(v));
        if !inside {
            return f64::INFINITY;
        }
        let run = |run: usize| -> Result<f64, ForwardError> {
            Ok(match kind {
                Objective::LeastSquares => {
                    0.5 * self
                        .whitened(run, parameters)?
                        .iter()
                        .flatten()
                        .map(|v| v * v)
                        .sum::<f64>()
                }
                Objective::SumOfAbsolute => self
                    .raw_residuals(run, parameters)?
                    .iter()
                    .zip(&self.l1_weight[run])
                    .map(|(series, weight)| {
                        weight
                            * series
                                .iter()
                                .map(|v| v.abs())
                                .filter(|v| v.is_finite())
                                .sum::<f64>()
                    })
                    .sum(),
            })
        };
        parallel::try_map(self.forward.runs(), run)
            .ok()
            .map(|each| each.iter().sum::<f64>())
            .filter(|v| v.is_finite())
            .unwrap_or(f64::INFINITY)
    }

    /// Weighted residuals and Jacobian of a run: whitened for least squares, Eq. 10's weights for L1.
    ///
    /// # Errors
    /// [`ForwardError`].
    pub fn linearised(
        &self,
        kind: Objective,
        run: usize,
        parameters: &[f64],
    ) -> Result<(DVector<f64>, DMatrix<f64>), ForwardError> {
        cancel::check();
        let mut values = Vec::new();
        let mut jacobian =
            self.forward
                .sensitivities(run, &self.of_run(run, parameters), &mut values)?;
        let measured = self.forward.measured(run);
        let slots = self.forward.slots().len();
        let mut residual = DVector::from_iterator(
            values.len(),
            values.iter().zip(measured).map(|(v, m)| v - m),
        );
        match kind {
            Objective::LeastSquares => {
                for (slot, filter) in self.whiteners[run].iter().enumerate() {
                    filter.apply(residual.iter_mut().skip(slot).step_by(slots));
                    for mut column in jacobian.column_iter_mut() {
                        filter.apply(column.iter_mut().skip(slot).step_by(slots));
                    }
                }
            }
            Objective::SumOfAbsolute => {
                for row in 0..residual.len() {
                    let finite = residual[row].is_finite();
                    let weight = if finite {
                        self.l1_weight[run][row % slots]
                    } else {
                        0.0
                    };
                    residual[row] = if finite { residual[row] * weight } else { 0.0 };
                    jacobian.row_mut(row).scale_mut(weight);
                }
            }
        }
        Ok((residual, jacobian))
    }

    /// Derivatives of a run's predictions over all parameters.
    ///
    /// # Errors
    /// [`ForwardError`].
    pub fn derivatives(
        &self,
        run: usize,
        parameters: &[f64],
    ) -> Result<DMatrix<f64>, ForwardError> {
        let mut values = Vec::new();
        let own = self
            .forward
            .sensitivities(run, &self.of_run(run, parameters), &mut values)?;
        let mut all = DMatrix::zeros(own.nrows(), self.free.len());
        for (local, column) in self.columns(run).into_iter().enumerate() {
            all.set_column(column, &own.column(local));
        }
        Ok(all)
    }

    /// Normal equations of the least squares at a point.
    ///
    /// # Errors
    /// [`ForwardError`].
    pub fn normal(&self, parameters: &[f64]) -> Result<Normal<Dyn>, ForwardError> {
        let p = self.free.len();
        let (mut cost, mut gradient, mut hessian) = (0.0, DVector::zeros(p), DMatrix::zeros(p, p));
        // Runs side by side, their sums in their order: the same bits on any number of cores.
        let runs = parallel::try_map(self.forward.runs(), |run| {
            let (residual, jacobian) = self.linearised(Objective::LeastSquares, run, parameters)?;
            let (g, h) = (jacobian.tr_mul(&residual), jacobian.tr_mul(&jacobian));
            Ok::<_, ForwardError>((0.5 * residual.norm_squared(), g, h))
        })?;
        for (run, (of_run, g, h)) in runs.into_iter().enumerate() {
            cost += of_run;
            let columns = self.columns(run);
            for (i, ci) in columns.iter().enumerate() {
                gradient[*ci] += g[i];
                for (j, cj) in columns.iter().enumerate() {
                    hessian[(*ci, *cj)] += h[(i, j)];
                }
            }
        }
        Ok(Normal {
            cost,
            gradient,
            hessian,
        })
    }
}

fn l1_weight(forward: &dyn Forward, run: usize, slot: usize) -> f64 {
    let measured = forward
        .measured(run)
        .iter()
        .skip(slot)
        .step_by(forward.slots().len())
        .filter(|v| v.is_finite());
    let (low, high, n) = measured.fold(
        (f64::INFINITY, f64::NEG_INFINITY, 0usize),
        |(l, h, n), v| (l.min(*v), h.max(*v), n + 1),
    );
    if n == 0 || high <= low {
        0.0
    } else {
        1.0 / (n as f64 * (high - low))
    }
}
