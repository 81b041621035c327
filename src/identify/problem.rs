//! Parameters of all runs in one vector, residuals whitened run by run, objectives.

use std::sync::atomic::{AtomicU64, Ordering};

use hydroline_numerics::least_squares::Normal;
use hydroline_numerics::noise::{Noise, Series, Whitener, estimate, mask};
use hydroline_numerics::statistics::median;
use hydroline_numerics::{cancel, parallel};
use nalgebra::{DMatrix, DVector, Dyn};

use super::forward::{Forward, ForwardError};
use super::parameter::Free;
use hydroline_core::run::rest_noise::{Stretch, series};

/// Function of the residuals that a fit minimises.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Objective {
    /// Half the sum of squared whitened residuals.
    LeastSquares,
    /// Sum over runs of the paper's Eq. 10, each normalised: mean |x_eof - x_img| over the run's
    /// measured range. (The paper says "normalised", not by what; this is our choice.) Samples count alike,
    /// whatever sd their logs say.
    SumOfAbsolute,
}

/// A model, its data, and how residuals are weighted.
pub struct Problem<'a> {
    forward: &'a dyn Forward,
    /// `[run][slot]`
    whiteners: Vec<Vec<Whitener>>,
    /// Per slot the logged sd that the slot's noise belongs to; `None` = the log says none.
    references: Vec<Option<f64>>,
    /// Per run reference over logged sd of every prediction; empty = all alike.
    precision: Vec<Vec<f64>>,
    first_local: Vec<usize>,
    free: Vec<Free>,
    /// Weight of one residual in the L1 objective, `[run][slot]`.
    l1_weight: Vec<Vec<f64>>,
    evaluations: AtomicU64,
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
            references: Vec::new(),
            precision: Vec::new(),
            first_local,
            free,
            l1_weight,
            evaluations: AtomicU64::new(0),
        };
        problem.weigh(median_logged_sd(forward));
        problem.set_white(sds);
        problem
    }

    /// Weighs every sample by its logged sd: a slot's noise is that of a sample whose logged sd is the
    /// slot's reference, others have more or less of it in proportion. Samples without one count as the reference.
    pub fn weigh(&mut self, references: Vec<Option<f64>>) {
        self.precision = (0..self.forward.runs())
            .map(|run| precision(self.forward, run, &references))
            .collect();
        self.references = references;
    }

    /// Per slot the logged sd that the slot's noise belongs to: the median, unless [`Problem::weigh`] gave another.
    pub fn references(&self) -> &[Option<f64>] {
        &self.references
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

    /// Number of times that the objective was asked for until now: shows that a slow search goes on.
    pub fn evaluations(&self) -> u64 {
        self.evaluations.load(Ordering::Relaxed)
    }

    /// Leaves a number nothing but its starting value, for every method of search.
    pub fn pin(&mut self, index: usize) {
        let free = &mut self.free[index];
        (free.low, free.high) = (free.start, free.start);
    }

    /// The model.
    pub fn forward(&self) -> &dyn Forward {
        self.forward
    }

    /// The filters, `[run][slot]`.
    pub fn whiteners(&self) -> &[Vec<Whitener>] {
        &self.whiteners
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

    /// The same, each for the sd that its log says: as if all had the slot's reference.
    ///
    /// # Errors
    /// [`ForwardError`].
    pub fn weighed_residuals(
        &self,
        run: usize,
        parameters: &[f64],
    ) -> Result<Vec<Vec<f64>>, ForwardError> {
        let mut series = self.raw_residuals(run, parameters)?;
        let slots = series.len();
        for (slot, values) in series.iter_mut().enumerate() {
            let factors = self.precision[run].iter().skip(slot).step_by(slots);
            for (value, factor) in values.iter_mut().zip(factors) {
                *value *= factor;
            }
        }
        Ok(series)
    }

    /// Whitened residuals of a run, `[slot]` of series; 0 where nothing counts.
    ///
    /// # Errors
    /// [`ForwardError`].
    pub fn whitened(&self, run: usize, parameters: &[f64]) -> Result<Vec<Vec<f64>>, ForwardError> {
        let mut series = self.weighed_residuals(run, parameters)?;
        for (values, filter) in series.iter_mut().zip(&self.whiteners[run]) {
            filter.apply(values.iter_mut());
        }
        Ok(series)
    }

    /// The objective; infinite where the motion diverges or a bound is left.
    pub fn objective(&self, kind: Objective, parameters: &[f64]) -> f64 {
        self.evaluations.fetch_add(1, Ordering::Relaxed);
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
                for (row, factor) in self.precision[run].iter().enumerate() {
                    residual[row] *= factor;
                    jacobian.row_mut(row).scale_mut(*factor);
                }
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

    /// Derivatives per run over all parameters, weighed as residuals are, where there is one slot; else none:
    /// with several the restricted likelihood does not fall apart by slot, and each has so many
    /// samples per unknown that the plain one serves.
    fn all_columns(&self, parameters: &[f64]) -> Result<Vec<DMatrix<f64>>, ForwardError> {
        if self.forward.slots().len() != 1 {
            return Ok(Vec::new());
        }
        let mut values = Vec::new();
        (0..self.forward.runs())
            .map(|run| {
                let own =
                    self.forward
                        .sensitivities(run, &self.of_run(run, parameters), &mut values)?;
                let mut all = DMatrix::zeros(own.nrows(), self.free.len());
                for (local, column) in self.columns(run).into_iter().enumerate() {
                    all.set_column(column, &own.column(local));
                }
                for (row, factor) in self.precision[run].iter().enumerate() {
                    all.row_mut(row).scale_mut(*factor);
                }
                Ok(all)
            })
            .collect()
    }

    /// Noise of each slot from the residuals at a point, pooled over runs and over what `beside(slot)` was seen
    /// at rest, and which samples count. Where a slot has such a stretch, a run's samples before `opening_s[run]`
    /// are left out of the residuals: they are that stretch.
    ///
    /// # Errors
    /// [`ForwardError`].
    #[allow(clippy::type_complexity)]
    pub fn noise_of_residuals<'s>(
        &self,
        parameters: &[f64],
        beside: impl Fn(usize) -> &'s [Stretch],
        opening_s: &[Option<f64>],
    ) -> Result<(Vec<Option<Noise>>, Vec<Vec<Vec<bool>>>), ForwardError> {
        let residuals: Result<Vec<_>, _> = (0..self.forward.runs())
            .map(|r| self.weighed_residuals(r, parameters))
            .collect();
        let residuals = residuals?;
        let slots = self.forward.slots().len();
        let jacobians = self.all_columns(parameters)?;
        let mut noises = Vec::new();
        let mut used = vec![vec![Vec::new(); slots]; self.forward.runs()];
        for slot in 0..slots {
            let at_rest = beside(slot);
            let twice = |run: usize| {
                let end_s = opening_s.get(run).copied().flatten();
                end_s.filter(|_| !at_rest.is_empty())
            };
            let once: Vec<Vec<f64>> = residuals
                .iter()
                .enumerate()
                .map(|(run, r)| from(self.forward.times_s(run), &r[slot], twice(run)))
                .collect();
            let view = |(run, values)| Series {
                times_s: self.forward.times_s(run),
                values,
                jacobian: jacobians.get(run),
            };
            let all_series: Vec<Series<'_>> = once
                .iter()
                .map(Vec::as_slice)
                .enumerate()
                .map(view)
                .chain(at_rest.iter().map(series))
                .collect();
            let found = estimate(&all_series);
            let masks = found.as_ref().map(|(noise, masks)| {
                if (0..once.len()).all(|run| twice(run).is_none()) {
                    return masks.clone();
                }
                // Samples that the noise estimate left out count in the fit.
                let all = residuals.iter().map(|r| r[slot].as_slice()).enumerate();
                mask(&all.map(view).collect::<Vec<_>>(), *noise)
            });
            for (run, r) in residuals.iter().enumerate() {
                used[run][slot] = masks.as_ref().map_or_else(
                    || r[slot].iter().map(|v| v.is_finite()).collect(),
                    |m| m[run].clone(),
                );
            }
            noises.push(found.map(|(noise, _)| noise));
        }
        Ok((noises, used))
    }
}

/// A series with NaN before `first_s`.
pub(super) fn from(times_s: &[f64], values: &[f64], first_s: Option<f64>) -> Vec<f64> {
    let first_s = first_s.unwrap_or(f64::NEG_INFINITY);
    let pairs = times_s.iter().zip(values);
    pairs
        .map(|(t_s, v)| if *t_s < first_s { f64::NAN } else { *v })
        .collect()
}

/// A logged sd this many times below or above the reference counts as that far: one frame that claims to be
/// perfect must not carry a run.
const PRECISION_MAX: f64 = 20.0;

/// Per slot the median of what the logs say of its samples' sd.
pub(super) fn median_logged_sd(forward: &dyn Forward) -> Vec<Option<f64>> {
    let slots = forward.slots().len();
    (0..slots)
        .map(|slot| {
            let of = |run: usize| {
                let said = forward.logged_sd(run).iter().skip(slot).step_by(slots);
                let measured = forward.measured(run).iter().skip(slot).step_by(slots);
                said.zip(measured)
                    .filter(|(sd, m)| sd.is_finite() && m.is_finite())
                    .map(|(sd, _)| *sd)
            };
            median(&mut (0..forward.runs()).flat_map(of).collect::<Vec<f64>>())
        })
        .collect()
}

/// Reference over logged sd of one sample; 1 where one of them is not known.
pub(super) fn precision_of(reference: Option<f64>, sd: f64) -> f64 {
    match reference {
        Some(reference) if sd.is_finite() => {
            (reference / sd).clamp(1.0 / PRECISION_MAX, PRECISION_MAX)
        }
        _ => 1.0,
    }
}

/// Reference over logged sd of every prediction of a run; empty where all are alike.
pub(super) fn precision(forward: &dyn Forward, run: usize, references: &[Option<f64>]) -> Vec<f64> {
    let slots = forward.slots().len();
    let factor =
        |(k, sd): (usize, &f64)| precision_of(references.get(k % slots).copied().flatten(), *sd);
    let all: Vec<f64> = forward
        .logged_sd(run)
        .iter()
        .enumerate()
        .map(factor)
        .collect();
    if all.iter().all(|f| (f - 1.0).abs() < 1e-9) {
        return Vec::new();
    }
    all
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
