//! A set of effects fitted together with the vehicle's own coefficients and each run's start.

use nalgebra::{DMatrix, DVector, Dyn};
use rayon::prelude::*;

use super::candidate::Candidate;
use super::descent::{Effort, Linear, Linearised, descend};
use super::setting::{COEFFICIENTS, Setting};
use super::weights::Weights;
use hydroline_identify::forward::ForwardError;
use hydroline_identify::lm::Squares;
use hydroline_identify::parameter::{Coefficient, Free, free};
use hydroline_identify::uncertainty::covariance;
use hydroline_numerics::least_squares::Normal;
use hydroline_sim::effect::ParameterInfo;

/// Relative sd of the rig's coefficients as a prior: a rig file is some 20 % off, a few are worse; what data
/// cannot see stays at the rig's.
const COEFFICIENT_PRIOR: f64 = 0.5;
/// Relative sd of a coefficient that the rig says is exactly 0: the model lacks it (physics.md, `quadratic_damping`).
const LACKING: f64 = 1e-6;
/// Prior log odds of one effect being there: in a tank several of thirty are, most of them small.
pub const INCLUSION: f64 = -1.0;
/// Own share of the information below which a parameter is nobody's to know.
const OWN_SHARE: f64 = 1e-7;
/// Beyond its plausible range a size's prior falls off as a normal one with this share of the range
/// as sd: a range is no limit, but what the data do not know must not wander.
const TAIL: f64 = 0.5;
/// The same for what is no size (a place, a period): a tether that would be taut long before the
/// start is a constant force.
const TAIL_ELSEWHERE: f64 = 0.15;

/// A fitted set.
#[derive(Debug, Clone)]
pub struct Fit {
    /// Candidates by index, ascending.
    pub set: Vec<usize>,
    /// Coefficients, effect parameters, then (position, rate) of each run's start.
    pub at: Vec<f64>,
    /// Half chi-square with the priors' share.
    pub cost: f64,
    /// Second derivatives with the priors' share.
    pub hessian: DMatrix<f64>,
    /// Laplace's log evidence with the prior of the set.
    pub log_evidence: f64,
    /// Stopped before its minimum: far from the best, right to a percent of its cost.
    pub rough: bool,
}

impl Fit {
    /// Coefficients and effect parameters.
    pub fn globals(&self, setting: &Setting) -> &[f64] {
        &self.at[..COEFFICIENTS + setting.parameters(&self.set)]
    }

    /// A run's start.
    pub fn start(&self, setting: &Setting, run: usize) -> (f64, f64) {
        let first = COEFFICIENTS + setting.parameters(&self.set) + 2 * run;
        (self.at[first], self.at[first + 1])
    }

    /// Parameters of a member (by its place in the set).
    pub fn member<'a>(&'a self, setting: &Setting, member: usize) -> &'a [f64] {
        let first = setting.places(&self.set)[member];
        let n = setting.vocabulary[self.set[member]].info.parameters.len();
        &self.at[first..first + n]
    }

    /// Members whose every parameter the other unknowns can do the work of, or that the data leave as
    /// open as their prior has it: no explanation.
    pub fn confounded(&self, setting: &Setting) -> Vec<usize> {
        let n = self.hessian.nrows();
        // What the data say, without the rig's say on its coefficients.
        let mut own = self.hessian.clone();
        for (i, c) in setting.coefficients().into_iter().enumerate() {
            if c != 0.0 {
                let k = 1.0 / (COEFFICIENT_PRIOR * c.abs()).max(1e-9);
                own[(i, i)] = (own[(i, i)] - k * k).max(1e-3 * k * k);
            }
        }
        let scale: Vec<f64> = (0..n).map(|i| own[(i, i)].sqrt().max(1e-150)).collect();
        let scaled = DMatrix::from_fn(n, n, |i, j| {
            own[(i, j)] / (scale[i] * scale[j]) + if i == j { 1e-12 } else { 0.0 }
        });
        let Some(inverse) = scaled.try_inverse() else {
            return self.set.clone();
        };
        // 1 / (H^-1)_kk over H_kk: the share of a parameter's information that is its own.
        self.set
            .iter()
            .zip(setting.places(&self.set))
            .filter(|(c, place)| {
                let widths = &setting.vocabulary[**c].widths;
                widths.iter().enumerate().all(|(i, width)| {
                    let k = *place + i;
                    let sd = inverse[(k, k)].sqrt() / scale[k];
                    1.0 / inverse[(k, k)] < OWN_SHARE || sd > *width
                })
            })
            .map(|(c, _)| *c)
            .collect()
    }

    /// Half chi-square of each member's size against nothing; 0 where it is not known, or not what
    /// its first parameter says.
    pub fn sizes(&self, setting: &Setting) -> Vec<f64> {
        let covariance = self.covariance();
        self.set
            .iter()
            .zip(setting.places(&self.set))
            .map(|(c, k)| {
                let sure = setting.vocabulary[*c].size.map_or(0.0, |size| {
                    0.5 * (self.at[k] - size.nothing).powi(2) / covariance[(k, k)].max(1e-300)
                });
                if sure.is_finite() { sure } else { 0.0 }
            })
            .collect()
    }

    /// Widths of the priors of the set's parameters.
    fn widths<'a>(&'a self, setting: &'a Setting) -> impl Iterator<Item = f64> + 'a {
        let of = |c: &usize| setting.vocabulary[*c].widths.iter().copied();
        self.set.iter().flat_map(of)
    }

    /// Information that each effect parameter's prior stands for where the data have none; a normal one is in the second
    /// derivatives as it is.
    pub fn prior_floors(&self, setting: &Setting) -> Vec<f64> {
        let of = |c: &Candidate| -> Vec<f64> {
            let floor = |i: usize| match c.normal_sd(i) {
                Some(_) => 0.0,
                None => std::f64::consts::TAU / c.widths[i].powi(2),
            };
            (0..c.widths.len()).map(floor).collect()
        };
        let candidates = self.set.iter().map(|c| &setting.vocabulary[*c]);
        candidates.flat_map(of).collect()
    }

    /// Second derivatives under which what the data leave open is no wider than its prior.
    pub fn hessian_within_priors(&self, setting: &Setting) -> DMatrix<f64> {
        let mut h = self.hessian.clone();
        for (i, floor) in self.prior_floors(setting).into_iter().enumerate() {
            h[(COEFFICIENTS + i, COEFFICIENTS + i)] += floor;
        }
        h
    }

    /// Covariance of all unknowns.
    pub fn covariance(&self) -> DMatrix<f64> {
        covariance(&self.hessian)
    }

    /// Predicted minus measured per run, unweighted.
    pub fn residuals(&self, setting: &Setting) -> Vec<Vec<f64>> {
        (0..setting.tracks.len())
            .map(|run| {
                let values = setting.values(
                    run,
                    &self.set,
                    self.globals(setting),
                    self.start(setting, run),
                );
                values
                    .iter()
                    .zip(&setting.tracks[run].measured)
                    .map(|(v, m)| v - m)
                    .collect()
            })
            .collect()
    }
}

/// Least squares of one set.
pub struct Posed<'a> {
    setting: &'a Setting,
    weights: &'a Weights,
    set: &'a [usize],
    free: Vec<Free>,
    /// Prior (from, to, 1 / sd) per unknown, flat in between; (_, _, 0) = none.
    priors: Vec<(f64, f64, f64)>,
}

impl<'a> Posed<'a> {
    /// The problem of a set.
    pub fn new(setting: &'a Setting, weights: &'a Weights, set: &'a [usize]) -> Posed<'a> {
        let mut frees: Vec<Free> = Coefficient::of(setting.dof)
            .iter()
            .map(|c| free(*c, &setting.vehicle))
            .collect();
        let mut priors: Vec<(f64, f64, f64)> = frees
            .iter()
            .map(|f| {
                let k = 1.0 / (COEFFICIENT_PRIOR * f.start.abs()).max(1e-9);
                (f.start, f.start, k)
            })
            .collect();
        for (f, p) in frees.iter().zip(&mut priors) {
            if f.start == 0.0 {
                // The rig's model lacks the term: it stays out, and is a candidate like any other.
                *p = (0.0, 0.0, 1.0 / (LACKING * f.high.max(1.0)));
            }
        }
        for c in set {
            let candidate = &setting.vocabulary[*c];
            for (i, ((p, (low, high)), (from, to))) in candidate
                .info
                .parameters
                .iter()
                .zip(&candidate.bounds)
                .zip(&candidate.flat)
                .enumerate()
            {
                let tail = if i == 0 { TAIL } else { TAIL_ELSEWHERE };
                frees.push(Free {
                    name: p.name.to_owned(),
                    start: p.typical,
                    low: *low,
                    high: *high,
                });
                // A phase's range is the whole circle: nothing lies outside of it.
                let precision = match candidate.normal_sd(i) {
                    Some(sd) => 1.0 / sd,
                    None if is_phase(p) => 0.0,
                    None => 1.0 / (tail * (to - from)).max(1e-12),
                };
                priors.push((*from, *to, precision));
            }
        }
        for track in &setting.tracks {
            let first = track.measured.first().copied().unwrap_or(0.0);
            let spread = track
                .measured
                .iter()
                .fold(0.1_f64, |m, v| m.max((v - first).abs()));
            let mut any = |start: f64, range: f64| {
                frees.push(Free {
                    name: String::new(),
                    start,
                    low: start - range,
                    high: start + range,
                });
            };
            any(first, 2.0 * spread);
            let moves = track.starts_under_way(setting.tolerance);
            let cut = moves && !track.edges.is_empty();
            let rate = if cut { track.rate_at_start() } else { None };
            any(rate.unwrap_or(0.0), 3.0 * spread);
            priors.push((0.0, 0.0, 0.0));
            let rest = if moves {
                0.0
            } else {
                weights.rest_precision(setting.tolerance).sqrt()
            };
            priors.push((0.0, 0.0, rest));
        }
        Posed {
            setting,
            weights,
            set,
            free: frees,
            priors,
        }
    }

    /// Starting values: the rig's coefficients, typical effects, rest.
    pub fn start(&self) -> Vec<f64> {
        self.free.iter().map(|f| f.start).collect()
    }

    fn globals(&self) -> usize {
        COEFFICIENTS + self.setting.parameters(self.set)
    }

    fn whitened(&self, run: usize, at: &[f64]) -> Vec<f64> {
        let g = self.globals();
        let start = (at[g + 2 * run], at[g + 2 * run + 1]);
        let mut values = self.setting.values(run, self.set, &at[..g], start);
        for (v, m) in values.iter_mut().zip(&self.setting.tracks[run].measured) {
            *v -= m;
        }
        self.weights.whiten(run, values.iter_mut());
        values
    }

    /// Whitened residual and Jacobian of one run (columns: globals, its start).
    pub fn linearised(&self, run: usize, at: &[f64]) -> (DVector<f64>, DMatrix<f64>) {
        let g = self.globals();
        let start = (at[g + 2 * run], at[g + 2 * run + 1]);
        let (mut values, mut jacobian) = self.setting.sensitivities(run, self.set, &at[..g], start);
        for (v, m) in values.iter_mut().zip(&self.setting.tracks[run].measured) {
            *v -= m;
        }
        self.weights.whiten(run, values.iter_mut());
        for mut column in jacobian.column_iter_mut() {
            self.weights.whiten(run, column.iter_mut());
        }
        (DVector::from_vec(values), jacobian)
    }

    /// The whole whitened Jacobian, runs end to end.
    pub fn jacobian(&self, at: &[f64]) -> DMatrix<f64> {
        let g = self.globals();
        let blocks: Vec<DMatrix<f64>> = (0..self.setting.tracks.len())
            .into_par_iter()
            .map(|run| self.linearised(run, at).1)
            .collect();
        let rows = blocks.iter().map(DMatrix::nrows).sum();
        let mut all = DMatrix::zeros(rows, at.len());
        let mut first = 0;
        for (run, block) in blocks.iter().enumerate() {
            all.view_mut((first, 0), (block.nrows(), g))
                .copy_from(&block.columns(0, g));
            all.view_mut((first, g + 2 * run), (block.nrows(), 2))
                .copy_from(&block.columns(g, 2));
            first += block.nrows();
        }
        all
    }

    fn prior_cost(&self, at: &[f64]) -> f64 {
        at.iter()
            .zip(&self.priors)
            .map(|(v, (from, to, k))| 0.5 * ((v - v.clamp(*from, *to)) * k).powi(2))
            .sum()
    }

    /// Fits from a point to the minimum.
    ///
    /// # Errors
    /// [`ForwardError`] when the motion diverges there.
    pub fn fit(&self, from: Vec<f64>) -> Result<Fit, ForwardError> {
        self.fit_with(from, Effort::FULL)
    }

    /// Fits from a point as far as is worth it.
    ///
    /// # Errors
    /// [`ForwardError`] when the motion diverges there.
    pub fn fit_with(&self, from: Vec<f64>, effort: Effort) -> Result<Fit, ForwardError> {
        let found = descend(self, from, effort)?;
        let mut fit = Fit {
            set: self.set.to_vec(),
            at: self.wrapped(found.at),
            cost: found.cost,
            hessian: found.hessian,
            log_evidence: 0.0,
            rough: found.rough,
        };
        fit.log_evidence = self.log_evidence(&fit);
        Ok(fit)
    }

    /// Phases back into the circle that their plausible range is.
    fn wrapped(&self, mut at: Vec<f64>) -> Vec<f64> {
        use std::f64::consts::TAU;
        for (c, place) in self.set.iter().zip(self.setting.places(self.set)) {
            for (i, p) in self.setting.vocabulary[*c]
                .info
                .parameters
                .iter()
                .enumerate()
            {
                if is_phase(p) {
                    at[place + i] -= TAU * (at[place + i] / TAU).round();
                }
            }
        }
        at
    }

    /// Prior (centre, precision) of each unknown as felt at a point.
    pub fn precisions(&self, at: &[f64]) -> Vec<(f64, f64)> {
        at.iter()
            .zip(&self.priors)
            .map(|(v, (from, to, k))| {
                let centre = v.clamp(*from, *to);
                let felt = from == to || centre != *v;
                (centre, if felt { k * k } else { 0.0 })
            })
            .collect()
    }

    /// Half the priors' squares at a point.
    pub fn prior_at(&self, at: &[f64]) -> f64 {
        self.prior_cost(at)
    }

    /// Laplace: -cost - 1/2 log det H + sum of log(sqrt(2 pi) / width) + log prior odds of the set
    /// (MacKay 2003, ch. 28), with sizes spread over decades. A parameter the data leave open has the
    /// width of its prior.
    pub fn log_evidence(&self, fit: &Fit) -> f64 {
        // The Hessian may hold more unknowns behind these (a free function's, with their prior).
        let n = fit.hessian.nrows();
        let widths: Vec<f64> = fit.widths(self.setting).collect();
        let h = fit.hessian_within_priors(self.setting);
        let scale: Vec<f64> = (0..n).map(|i| h[(i, i)].sqrt().max(1e-150)).collect();
        let scaled = DMatrix::from_fn(n, n, |i, j| {
            h[(i, j)] / (scale[i] * scale[j]) + if i == j { 1e-13 } else { 0.0 }
        });
        let cholesky = scaled.cholesky();
        let logs = cholesky.as_ref().map_or(0.0, |c| {
            2.0 * c.l().diagonal().iter().map(|d| d.ln()).sum::<f64>()
        });
        let inverse = cholesky.map(|c| c.inverse());
        let sizes: f64 = self
            .set
            .iter()
            .zip(self.setting.places(self.set))
            .filter_map(|(c, k)| {
                let size = self.setting.vocabulary[*c].size?;
                let sd = inverse.as_ref()?[(k, k)].sqrt() / scale[k];
                Some(size.log_prior(fit.at[k], sd))
            })
            .sum();
        let log_det = logs + 2.0 * scale.iter().map(|s| s.ln()).sum::<f64>();
        let widths: f64 = widths
            .iter()
            .map(|w| 0.5 * std::f64::consts::TAU.ln() - w.ln())
            .sum();
        -fit.cost - 0.5 * log_det + widths + sizes + INCLUSION * self.set.len() as f64
    }
}

impl Squares for Posed<'_> {
    fn free(&self) -> &[Free] {
        &self.free
    }

    fn cost(&self, at: &[f64]) -> f64 {
        let squares: f64 = (0..self.setting.tracks.len())
            .into_par_iter()
            .map(|run| 0.5 * self.whitened(run, at).iter().map(|v| v * v).sum::<f64>())
            .sum();
        let total = squares + self.prior_cost(at);
        if total.is_finite() {
            total
        } else {
            f64::INFINITY
        }
    }

    fn normal(&self, at: &[f64]) -> Result<Normal<Dyn>, ForwardError> {
        let made = self.linearise(at)?;
        Ok(Normal {
            cost: made.cost,
            gradient: made.gradient,
            hessian: made.hessian,
        })
    }
}

impl Linearised for Posed<'_> {
    fn bounds(&self, i: usize) -> (f64, f64) {
        (self.free[i].low, self.free[i].high)
    }

    fn residuals(&self, at: &[f64]) -> (f64, Vec<Vec<f64>>) {
        let all: Vec<Vec<f64>> = (0..self.setting.tracks.len())
            .into_par_iter()
            .map(|run| self.whitened(run, at))
            .collect();
        let squares: f64 = all.iter().flatten().map(|v| 0.5 * v * v).sum();
        let total = squares + self.prior_cost(at);
        (
            if total.is_finite() {
                total
            } else {
                f64::INFINITY
            },
            all,
        )
    }

    fn linearise(&self, at: &[f64]) -> Result<Linear, ForwardError> {
        let n = at.len();
        let g = self.globals();
        let (mut cost, mut gradient, mut hessian) =
            (self.prior_cost(at), DVector::zeros(n), DMatrix::zeros(n, n));
        let blocks: Vec<(DVector<f64>, DMatrix<f64>)> = (0..self.setting.tracks.len())
            .into_par_iter()
            .map(|run| self.linearised(run, at))
            .collect();
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
            let column = |i: usize| if i < g { i } else { g + 2 * run + (i - g) };
            for i in 0..gr.len() {
                gradient[column(i)] += gr[i];
                for j in 0..gr.len() {
                    hessian[(column(i), column(j))] += h[(i, j)];
                }
            }
            jacobians.push(j);
        }
        for (i, (centre, k2)) in self.precisions(at).into_iter().enumerate() {
            gradient[i] += (at[i] - centre) * k2;
            hessian[(i, i)] += k2;
        }
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
        let g = self.globals();
        let mut gradient = DVector::zeros(at.len());
        for (run, (r, j)) in residuals.iter().zip(jacobians).enumerate() {
            for (i, column) in j.column_iter().enumerate() {
                let k = if i < g { i } else { g + 2 * run + (i - g) };
                gradient[k] += column.iter().zip(r).map(|(a, b)| a * b).sum::<f64>();
            }
        }
        for (i, (centre, k2)) in self.precisions(at).into_iter().enumerate() {
            gradient[i] += (at[i] - centre) * k2;
        }
        gradient
    }
}
/// Whether a parameter is an angle whose plausible range is the whole circle.
pub fn is_phase(p: &ParameterInfo) -> bool {
    use std::f64::consts::PI;
    p.unit == "rad" && p.plausible == (-PI, PI)
}
