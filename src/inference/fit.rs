//! The mode of one model, and its log evidence.
//!
//! Given sizes of the random forces, the mode over all numbers by Levenberg–Marquardt on the whitened residuals and the
//! prior; given the mode, the sizes that the data say (restricted likelihood, numbers integrated out); in turn, until
//! neither moves. Evidence: Laplace over the numbers, a sum over sizes and correlation times.
//! References: Levenberg 1944, Marquardt 1963; Patterson and Thompson 1971 (REML); MacKay 2003, ch. 27 (Laplace).

use std::collections::BTreeMap;

use hydroline_numerics::cholesky::ln_determinant;
use hydroline_numerics::noise::Noise;
use hydroline_numerics::parallel;
use nalgebra::{Cholesky, DMatrix, DVector};

use super::body::{Body, Point, Simulated};
use super::equations::Equations;
use super::filter::Filter;
use super::hyper::{Cell, Cells, Forces, Noises, Worth, filters, ln_prior, ln_sum};
use super::noise::estimate;
use super::number_prior::NumberPrior;
use super::prior::PriorTable;
use super::recording::Recording;
use super::term::{Candidate, Kind};
use hydroline_core::run::{Channel, PerChannel, Run};
use hydroline_rigs::Rig;
use hydroline_sim::effect::EffectError;

/// Body, noise and priors that all fits of one search share.
#[derive(Debug, Clone)]
pub struct Problem {
    /// Rig and recorded runs, prepared for the likelihood.
    pub body: Body,
    /// Noise, one for all models.
    pub noises: Noises,
    /// Acceleration per DOF whose response is as large as the tolerance.
    pub worth: Worth,
}

/// Limits at which a fit stops.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Effort {
    /// Steps for given sizes of the random forces.
    pub steps: usize,
    /// Times that the sizes are chosen anew.
    pub rounds: usize,
    /// A step that gains less than this in log posterior is the last one.
    pub decrement: f64,
    /// The first steps are made under the random forces given, whatever residuals say of them at the start: a small force
    /// looks for the mode that explains the motion, and a large one forgives all.
    pub as_given: bool,
    /// Random forces stay as they are given, and are not summed over: for fits that know of none.
    pub forces_held: bool,
}

impl Effort {
    /// Limits that suffice for most fits.
    pub const DEFAULT: Effort = Effort {
        steps: 15,
        rounds: 4,
        decrement: 0.02,
        as_given: false,
        forces_held: false,
    };
}

impl Default for Effort {
    fn default() -> Self {
        Effort::DEFAULT
    }
}

/// Normal equations of one DOF under one cell.
#[derive(Debug, Clone)]
pub struct Normal {
    /// Information of the numbers.
    pub information: DMatrix<f64>,
    /// Gradient of the log likelihood.
    pub gradient: DVector<f64>,
    /// Half energy and half log variance: minus the log likelihood, without the constant.
    pub cost: f64,
    /// Sum of squares of the whitened residuals.
    pub energy: f64,
    /// Samples that count.
    pub used: usize,
}

/// A model at its mode.
#[derive(Debug, Clone)]
pub struct Fit {
    /// Its effects, ascending.
    pub terms: Vec<usize>,
    /// Scaled numbers.
    pub point: Point,
    /// Random forces, and sizes of tables.
    pub cells: Cells,
    /// Log evidence.
    pub ln_evidence: f64,
    /// With the model's prior.
    pub ln_score: f64,
    /// Posterior covariance of the scaled numbers.
    pub covariance: DMatrix<f64>,
    /// Minus log posterior density at the mode, without the constant.
    pub cost: f64,
    /// Per DOF the random force's cells with their probabilities, the others as they are chosen.
    pub forces: Forces,
}

impl Fit {
    /// The vehicle alone at a point: where fits begin, of which nothing is known yet.
    pub fn begin(point: Point, cells: Cells) -> Fit {
        Fit {
            terms: Vec::new(),
            covariance: DMatrix::zeros(point.len(), point.len()),
            point,
            cells,
            ln_evidence: f64::NEG_INFINITY,
            ln_score: f64::NEG_INFINITY,
            cost: f64::INFINITY,
            forces: Vec::new(),
        }
    }
}

/// Steps without success after which a descent ends.
const FAILED_MOST: usize = 8;

/// A model on its way to a mode (Levenberg-Marquardt, Marquardt's scaling).
struct Descent<'a> {
    problem: &'a Problem,
    terms: &'a [usize],
    number_prior: NumberPrior,
    bounds: Vec<(f64, f64)>,
    effort: Effort,
    all: Vec<Simulated>,
    equations: Equations<'a>,
    at: Point,
}

impl Descent<'_> {
    /// Cells that are likeliest where it is; random forces that are held stay.
    fn choose(&mut self, cells: &Cells) -> Cells {
        let (all, number_prior, at) = (&self.all, &self.number_prior, &self.at);
        let dofs: &[usize] = match self.effort.forces_held {
            true => &[],
            false => &self.problem.body.dofs,
        };
        self.equations
            .choose_in(dofs, all, cells.clone(), number_prior, at)
            .0
    }

    /// Numbers at a limit that the likelihood would move beyond it: they stay there for a step.
    fn held(&self, gradient: &DVector<f64>) -> Vec<usize> {
        let is_held = |i: &usize| {
            let (v, (low, high), slope) = (self.at[*i], self.bounds[*i], gradient[*i]);
            (v <= low && slope < 0.0) || (v >= high && slope > 0.0)
        };
        (0..self.at.len()).filter(is_held).collect()
    }

    /// Down to the mode under these cells; `None` where the model gives no finite motion.
    fn run(&mut self, cells: &Cells) -> Option<()> {
        let Problem {
            body,
            worth,
            noises,
            ..
        } = self.problem;
        let of = |d: &usize| (*d, filters(body, worth, noises, *d, cells.misfit[*d]));
        let filters: BTreeMap<usize, Vec<Filter>> = body.dofs.iter().map(of).collect();
        let (mut damping, mut failed) = (1e-3, 0);
        let (mut information, mut gradient, mut cost) =
            self.equations
                .sum(&self.all, cells, &self.number_prior, &self.at);
        for _ in 0..self.effort.steps {
            let mut damped = information.clone();
            for i in 0..self.at.len() {
                damped[(i, i)] *= 1.0 + damping;
            }
            let mut uphill = gradient.clone();
            for i in self.held(&gradient) {
                damped.fill_row(i, 0.0);
                damped.fill_column(i, 0.0);
                damped[(i, i)] = 1.0;
                uphill[i] = 0.0;
            }
            let Some(root) = Cholesky::new(damped) else {
                damping = (damping * 10.0_f64).max(1e-6);
                failed += 1;
                if failed > FAILED_MOST {
                    break;
                }
                continue;
            };
            let move_by = root.solve(&uphill);
            let predicted = 0.5 * move_by.dot(&uphill);
            let moved = self.at.iter().zip(move_by.iter()).zip(&self.bounds);
            let tried: Point = moved
                .map(|((v, d), (low, high))| (v + d).clamp(*low, *high))
                .collect();
            let values = self.problem.predicted(self.terms, &tried);
            let new = self.problem.cost(&values, &filters) - self.number_prior.ln(&tried, cells);
            if new.is_finite() && new <= cost + 1e-9 {
                let gained = cost - new;
                self.at = tried;
                self.all = self.problem.simulate(self.terms, &self.at)?;
                self.equations.clear();
                (information, gradient, cost) =
                    self.equations
                        .sum(&self.all, cells, &self.number_prior, &self.at);
                damping = (damping * 0.2).max(1e-9);
                failed = 0;
                if gained < self.effort.decrement && predicted < 2.0 * self.effort.decrement {
                    break;
                }
            } else {
                if predicted < 0.1 * self.effort.decrement {
                    break;
                }
                damping = (damping * 8.0).max(1e-4);
                failed += 1;
                if failed > FAILED_MOST {
                    break;
                }
            }
        }
        Some(())
    }
}

impl Problem {
    /// The problem of some runs against a rig: noise as it is beside the rig's own prediction.
    ///
    /// # Errors
    /// [`EffectError`] for a bad `[[physics]]` entry of the rig.
    pub fn new(
        runs: &[Run],
        rig: &Rig,
        dofs: &[usize],
        prior: PriorTable,
    ) -> Result<Problem, EffectError> {
        Problem::beside(runs, rig, dofs, &[], prior)
    }

    /// The same beside DOFs that move as they were measured instead of being explained.
    ///
    /// # Errors
    /// [`EffectError`] for a bad `[[physics]]` entry of the rig.
    pub fn beside(
        runs: &[Run],
        rig: &Rig,
        dofs: &[usize],
        given: &[usize],
        prior: PriorTable,
    ) -> Result<Problem, EffectError> {
        let recording = Recording::new(runs, rig.tank.start_pose[5]);
        let body = Body::new(recording, rig, dofs, given, prior)?;
        Ok(Problem::of(body, PerChannel::splat(None)))
    }

    /// The problem of a body; `at_rest` = noise of each channel at rest, below which none is looked for in motion.
    pub fn of(body: Body, at_rest: PerChannel<Option<Noise>>) -> Problem {
        let begin = body.begin();
        let all = parallel::map(body.recording.runs.len(), |run| {
            body.simulated(run, &[], &begin)
        });
        let mut made = Problem {
            worth: Worth::new(&body, &all),
            body,
            noises: Noises::none(),
        };
        let predicted = made.predicted(&[], &begin);
        made.noises = estimate(&made.body, &predicted, None);
        made.noises.at_rest = at_rest;
        // Once more without outliers and with the rig's numbers as near as the data want them.
        if let Some(closest) = made.closest(&[], &begin) {
            made.noises = estimate(&made.body, &closest, Some(&made.noises));
        }
        made
    }

    /// The problem of a body under a noise that is known, without random forces.
    pub fn under(body: Body, channels: PerChannel<Option<Noise>>) -> Problem {
        Problem {
            worth: Worth::none(),
            noises: Noises {
                channels,
                used: body.recording.measured_of(&channels),
                has_force: false,
                ..Noises::none()
            },
            body,
        }
    }

    /// Names of a model's terms.
    pub(super) fn names(&self, fit: &Fit) -> Vec<String> {
        let each = fit.terms.iter();
        each.map(|t| self.body.candidates[*t].name()).collect()
    }

    fn runs(&self) -> usize {
        self.body.recording.runs.len()
    }

    /// All runs with derivatives; `None` where the motion is not finite.
    pub fn simulate(&self, terms: &[usize], point: &[f64]) -> Option<Vec<Simulated>> {
        let all = parallel::map(self.runs(), |run| self.body.simulated(run, terms, point));
        let finite = |s: &Simulated| s.values.iter().flatten().all(|v| v.is_finite());
        let slopes = |s: &Simulated| {
            s.columns
                .iter()
                .flat_map(|c| &c.1)
                .flatten()
                .all(|v| v.is_finite())
        };
        all.iter().all(|s| finite(s) && slopes(s)).then_some(all)
    }

    /// All runs.
    pub fn predicted(&self, terms: &[usize], point: &[f64]) -> Vec<Vec<PerChannel<f64>>> {
        parallel::map(self.runs(), |run| self.body.values(run, terms, point))
    }

    /// Channels of one DOF that are measured, by their places among its two.
    fn measured(&self, dof: usize) -> Vec<usize> {
        let both = Channel::of(dof);
        (0..2)
            .filter(|c| self.noises.channels[both[*c]].is_some())
            .collect()
    }

    /// Residual of a run's DOF, whitened.
    pub(super) fn white_residual(
        &self,
        run: usize,
        dof: usize,
        values: &[PerChannel<f64>],
        filter: &Filter,
    ) -> Vec<[f64; 2]> {
        let r = &self.body.recording.runs[run];
        let used = &self.noises.used[run];
        let mut series: Vec<[f64; 2]> = values
            .iter()
            .enumerate()
            .map(|(k, p)| {
                let m = r.measured(k);
                Channel::of(dof).map(|c| if used[k][c] { m[c] - p[c] } else { 0.0 })
            })
            .collect();
        filter.apply(&mut series);
        series
    }

    /// A column of derivatives or a response, whitened; `None` where it does nothing in this DOF.
    pub fn white_column(
        &self,
        dof: usize,
        column: &[PerChannel<f64>],
        filter: &Filter,
    ) -> Option<Vec<[f64; 2]>> {
        let mut series = self.of_dof(dof, column)?;
        filter.apply(&mut series);
        Some(series)
    }

    /// A column's channels of a DOF; `None` where it does nothing there.
    fn of_dof(&self, dof: usize, column: &[PerChannel<f64>]) -> Option<Vec<[f64; 2]>> {
        let both = Channel::of(dof);
        let measured = |c: &&Channel| self.noises.channels[**c].is_some();
        let mut each = column.iter();
        let acts = each.any(|v| both.iter().filter(measured).any(|c| v[*c] != 0.0));
        acts.then(|| column.iter().map(|v| both.map(|c| v[c])).collect())
    }

    /// Normal equations of one DOF under one cell.
    pub fn normal(&self, all: &[Simulated], dof: usize, cell: Cell, size: usize) -> Normal {
        let filters = filters(&self.body, &self.worth, &self.noises, dof, cell);
        self.normal_with(all, dof, &filters, size)
    }

    /// The same under any filters.
    pub fn normal_with(
        &self,
        all: &[Simulated],
        dof: usize,
        filters: &[Filter],
        size: usize,
    ) -> Normal {
        let mut made = Normal {
            information: DMatrix::zeros(size, size),
            gradient: DVector::zeros(size),
            cost: 0.0,
            energy: 0.0,
            used: 0,
        };
        let measured = self.measured(dof);
        for (run, (sim, filter)) in all.iter().zip(filters).enumerate() {
            let residual = self.white_residual(run, dof, &sim.values, filter);
            let flat = |series: &[[f64; 2]]| -> Vec<f64> {
                series
                    .iter()
                    .flat_map(|p| measured.iter().map(|c| p[*c]))
                    .collect()
            };
            let right = DVector::from_vec(flat(&residual));
            made.cost += 0.5 * (right.norm_squared() + filter.ln_variance);
            made.energy += right.norm_squared();
            made.used += filter.used;
            let acting = sim.columns.iter();
            let acting = acting.filter_map(|(i, column)| Some((*i, self.of_dof(dof, column)?)));
            let (places, mut columns): (Vec<usize>, Vec<Vec<[f64; 2]>>) = acting.unzip();
            if places.is_empty() {
                continue;
            }
            filter.apply_all(&mut columns);
            let data: Vec<f64> = columns.iter().flat_map(|c| flat(c)).collect();
            let matrix = DMatrix::from_vec(right.len(), places.len(), data);
            // nalgebra's `tr_mul` is a dot product per number; this is one matrix product.
            let square = matrix.transpose() * &matrix;
            let slope = matrix.tr_mul(&right);
            for (a, i) in places.iter().enumerate() {
                made.gradient[*i] += slope[a];
                for (b, j) in places.iter().enumerate() {
                    made.information[(*i, *j)] += square[(a, b)];
                }
            }
        }
        made
    }

    /// Minus the log likelihood of a motion as the instruments saw it, summed over all random forces by their prior,
    /// without the constant.
    ///
    /// `values` = channels per run and sample, rotated as measured ones are.
    pub fn cost_of(&self, values: &[Vec<PerChannel<f64>>]) -> f64 {
        let prior = &self.body.prior;
        let cells: Vec<Cell> = Cell::all().collect();
        let of = |dof: &usize| {
            let each = parallel::map_slice(&cells, |&cell| {
                let filters = filters(&self.body, &self.worth, &self.noises, *dof, cell);
                let cost = self.cost(values, &BTreeMap::from([(*dof, filters)]));
                ln_prior(cell, prior) - cost
            });
            -ln_sum(&each)
        };
        self.body.dofs.iter().map(of).sum()
    }

    /// Minus the log likelihood of a motion through these filters, without the constant.
    pub(super) fn cost(
        &self,
        values: &[Vec<PerChannel<f64>>],
        filters: &BTreeMap<usize, Vec<Filter>>,
    ) -> f64 {
        let mut sum = 0.0;
        for (dof, filters) in filters {
            for (run, (v, filter)) in values.iter().zip(filters).enumerate() {
                let white = self.white_residual(run, *dof, v, filter);
                sum +=
                    0.5 * (white.iter().flatten().map(|v| v * v).sum::<f64>() + filter.ln_variance);
            }
        }
        sum
    }

    /// Fits a model from a point.
    pub fn fit(&self, terms: &[usize], start: &[f64], cells: Cells, effort: Effort) -> Option<Fit> {
        let at: Point = start.to_vec();
        let effort = Effort {
            forces_held: effort.forces_held || !self.noises.has_force,
            ..effort
        };
        let mut descent = Descent {
            problem: self,
            terms,
            number_prior: self.number_prior(terms),
            bounds: self.body.bounds(terms),
            effort,
            all: self.simulate(terms, &at)?,
            equations: Equations::new(self, at.len()),
            at,
        };
        let mut cells = cells;
        let mut seen: Vec<Cells> = Vec::new();
        for round in 0..effort.rounds {
            let is_fixed = effort.forces_held && descent.number_prior.blocks.is_empty();
            let chosen = if is_fixed || round == 0 && effort.as_given {
                cells.clone()
            } else {
                descent.choose(&cells)
            };
            if round > 0 && (chosen == cells || seen.contains(&chosen)) {
                break;
            }
            seen.push(chosen.clone());
            cells = chosen;
            descent.run(&cells)?;
        }
        let Descent {
            number_prior,
            all,
            mut equations,
            at,
            ..
        } = descent;
        let (information, _, cost) = equations.sum(&all, &cells, &number_prior, &at);
        let root = Cholesky::new(information)?;
        let (forces, more) = match effort.forces_held {
            true => (Vec::new(), 0.0),
            false => equations.forces(&all, &cells, &number_prior, &at),
        };
        let used: usize = self
            .noises
            .used
            .iter()
            .flatten()
            .flatten()
            .filter(|u| **u)
            .count();
        let tau = std::f64::consts::TAU.ln();
        let ln_evidence = -cost + 0.5 * (at.len() as f64 - used as f64) * tau
            - 0.5 * ln_determinant(&root)
            + more;
        let mut made = Fit {
            terms: terms.to_vec(),
            point: at,
            cells,
            ln_evidence,
            ln_score: 0.0,
            covariance: root.inverse(),
            cost,
            forces,
        };
        made.ln_score = made.ln_evidence + self.ln_prior(terms);
        made.ln_score.is_finite().then_some(made)
    }

    /// Log prior odds of a set of effects over none.
    pub fn ln_prior(&self, terms: &[usize]) -> f64 {
        let all = &self.body.candidates;
        let effects = || all.iter().filter(|c| c.kind == Kind::Effect);
        let ids: std::collections::BTreeSet<&str> = effects().map(|c| c.info.id).collect();
        let prior = &self.body.prior;
        let one = |t: &usize| {
            let p = match all[*t].kind {
                Kind::Effect => {
                    let places = effects().filter(|c| c.info.id == all[*t].info.id).count();
                    return prior.ln_odds_of_effect(ids.len(), places);
                }
                Kind::Force { .. } => {
                    let force = |c: &&Candidate| matches!(c.kind, Kind::Force { .. });
                    prior.unnamed / all.iter().filter(force).count() as f64
                }
                // As its table, with what the form itself is worth: no probability that others could be counted by.
                Kind::Form { table, ln_odds, .. } => return self.ln_prior(&[table]) + ln_odds,
                kind => prior.inexact / all.iter().filter(|c| c.kind == kind).count() as f64,
            };
            (p / (1.0 - p)).ln()
        };
        terms.iter().map(one).sum()
    }
}
