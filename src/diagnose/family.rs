//! Unnamed structure: a force, or a parameter of an effect, as a free function of one variable.
//!
//! Hat functions over the variable, amplitudes with a Gaussian prior whose size is chosen by the
//! evidence (an empirical Gaussian process). Two uses: a force that nothing in the vocabulary
//! explains (`unknown`), and an effect whose law is not quite the vocabulary's (`inexact`): then
//! its first parameter depends on something it should not depend on.
//! Reference: MacKay 1992, Bayesian interpolation.

use hydroline_sim::single::Instant;
use hydroline_sim::{Dual, Real};
use nalgebra::{DMatrix, DVector, SymmetricEigen};
use rayon::prelude::*;

use super::bank::{View, outside};
use super::fit::{Fit, Posed};
use super::setting::{PASS, Setting, Track};
use super::weights::Weights;

/// What a free function depends on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Variable {
    /// Position along the line \[m, rad\].
    Place,
    /// The same, of a force against the motion \[m, rad\].
    PlaceAgainst,
    /// Rate over ground \[m/s\].
    Rate,
    /// Its size.
    Speed,
    /// Commanded load \[N\].
    Load,
    /// Its size.
    LoadSize,
    /// Time since the log's first stamp, the same in all runs \[s\].
    Time,
    /// Time since the last command edge \[s\].
    SinceEdge,
    /// The same, of a force in proportion to what the edge changed \[s\].
    AfterEdge,
    /// Time in one run only \[s\].
    TimeIn(usize),
    /// Time in each run by itself, runs end to end \[s\]: someone pulls, at another time in every run.
    TimeEach,
}

impl Variable {
    /// Name in reports, with the unit where it is linear motion.
    pub fn name(self) -> String {
        match self {
            Variable::Place => "position".to_owned(),
            Variable::PlaceAgainst => "position, against the motion".to_owned(),
            Variable::Rate => "rate".to_owned(),
            Variable::Speed => "speed".to_owned(),
            Variable::Load => "command".to_owned(),
            Variable::LoadSize => "size of the command".to_owned(),
            Variable::Time => "time since the log's start".to_owned(),
            Variable::SinceEdge => "time since the last command edge".to_owned(),
            Variable::AfterEdge => {
                "time since the last command edge, in proportion to its change".to_owned()
            }
            Variable::TimeIn(run) => format!("time in run {}", run + 1),
            Variable::TimeEach => "time in each run by itself".to_owned(),
        }
    }

    fn of<const N: usize>(self, here: &Instant<Dual<N>>) -> Dual<N> {
        let size = |v: Dual<N>| if v.value < 0.0 { -v } else { v };
        match self {
            Variable::Place | Variable::PlaceAgainst => here.position,
            Variable::Rate => here.rate,
            Variable::Speed => size(here.rate),
            Variable::Load => Dual::constant(here.load),
            Variable::LoadSize => Dual::constant(here.load.abs()),
            Variable::Time | Variable::TimeIn(_) | Variable::TimeEach => {
                Dual::constant(here.t_s.value)
            }
            Variable::SinceEdge | Variable::AfterEdge => {
                Dual::constant(here.t_s.value - here.edge_s)
            }
        }
    }

    /// What the function is multiplied by at a rate.
    fn factor<const N: usize>(self, here: &Instant<Dual<N>>, rate: Dual<N>) -> Dual<N> {
        match self {
            Variable::AfterEdge => Dual::constant(here.jump),
            Variable::PlaceAgainst => -(rate * (1.0 / TURN_MPS)).tanh(),
            _ => Dual::constant(1.0),
        }
    }
}

/// What the function acts on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Acts {
    /// A force \[N, N m\] of its own.
    Force,
    /// The logarithm of a factor on the first parameter of this candidate.
    Bends(usize),
}

/// A free function.
#[derive(Debug, Clone, PartialEq)]
pub struct Family {
    /// On what.
    pub acts: Acts,
    /// Of what.
    pub variable: Variable,
    /// Peaks of the hats, ascending.
    pub knots: Vec<f64>,
    /// Place and rate are those that were measured, not those of the model: far from the noise
    /// only so the motion is nearly linear in the function.
    pub measured: bool,
}

/// A fitted free function beside a set.
#[derive(Debug, Clone)]
pub struct FamilyFit {
    /// Which.
    pub family: Family,
    /// Amplitude at each knot \[N, N m; 1\].
    pub amplitudes: Vec<f64>,
    /// sd of each.
    pub sds: Vec<f64>,
    /// Log evidence gained over the set alone.
    pub gain: f64,
    /// Prior sd of an amplitude.
    pub prior_sd: f64,
    /// Raw response to the fitted function, runs end to end \[m, rad\].
    pub response: DVector<f64>,
}

impl Family {
    /// What the function is asked about at an instant of a run.
    fn value<const N: usize>(
        &self,
        setting: &Setting,
        run: usize,
        here: &Instant<Dual<N>>,
    ) -> Dual<N> {
        let track = &setting.tracks[run];
        match self.variable {
            Variable::TimeEach => Dual::constant(here.t_s.value + laid_out_s(setting, run)),
            Variable::Place | Variable::PlaceAgainst if self.measured => {
                Dual::constant(track.at(here.t_s.value))
            }
            Variable::Rate if self.measured => Dual::constant(track.rate_at(here.t_s.value)),
            other => other.of(here),
        }
    }

    /// What it is multiplied by.
    fn factor<const N: usize>(&self, track: &Track, here: &Instant<Dual<N>>) -> Dual<N> {
        let rate = if self.measured && self.variable == Variable::PlaceAgainst {
            Dual::constant(track.rate_at(here.t_s.value))
        } else {
            here.rate
        };
        self.variable.factor(here, rate)
    }

    /// Weight of each hat at a value; constant beyond the ends.
    fn hats(&self, value: f64) -> Vec<f64> {
        let n = self.knots.len();
        let mut weights = vec![0.0; n];
        let after = self.knots.partition_point(|k| *k <= value);
        if after == 0 {
            weights[0] = 1.0;
        } else if after == n {
            weights[n - 1] = 1.0;
        } else {
            let share =
                (value - self.knots[after - 1]) / (self.knots[after] - self.knots[after - 1]);
            weights[after - 1] = 1.0 - share;
            weights[after] = share;
        }
        weights
    }

    /// Derivatives of the motion with respect to the amplitudes, all runs end to end.
    pub fn columns(&self, setting: &Setting, fit: &Fit) -> DMatrix<f64> {
        let m = self.knots.len();
        let blocks: Vec<DMatrix<f64>> = (0..setting.tracks.len())
            .into_par_iter()
            .map(|run| {
                let rows = setting.tracks[run].times_s.len();
                let mut block = DMatrix::zeros(rows, m);
                if matches!(self.variable, Variable::TimeIn(only) if only != run) {
                    return block;
                }
                let globals: Vec<Dual<PASS>> = fit
                    .globals(setting)
                    .iter()
                    .map(|v| Dual::constant(*v))
                    .collect();
                let (position, rate) = fit.start(setting, run);
                let start = (Dual::constant(position), Dual::constant(rate));
                for first in (0..m).step_by(PASS) {
                    let push = |here: &Instant<Dual<PASS>>, base: f64| {
                        let mut made = Dual::constant(base);
                        let value = self.value(setting, run, here).value;
                        let factor = self.factor(&setting.tracks[run], here).value;
                        for (slope, hat) in made
                            .slope
                            .iter_mut()
                            .zip(self.hats(value).iter().skip(first))
                        {
                            *slope = factor * *hat;
                        }
                        made
                    };
                    let out = match self.acts {
                        Acts::Force => {
                            setting.simulate(run, &fit.set, &globals, start, |h| push(h, 0.0))
                        }
                        Acts::Bends(candidate) => {
                            let Some(member) = fit.set.iter().position(|c| *c == candidate) else {
                                return block;
                            };
                            let place = setting.places(&fit.set)[member];
                            setting.simulate_bent(run, &fit.set, &globals, start, place, |h| {
                                push(h, 1.0)
                            })
                        }
                    };
                    for (row, value) in out.iter().enumerate() {
                        for (j, slope) in value.slope.iter().take(m - first).enumerate() {
                            block[(row, first + j)] = *slope;
                        }
                    }
                }
                block
            })
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
                    &super::bank::whitened(setting, weights, &raw.column(j).into_owned()),
                )
            })
            .collect();
        let matrix = DMatrix::from_columns(&columns);
        let eigen = SymmetricEigen::new(matrix.tr_mul(&matrix));
        let product = eigen.eigenvectors.tr_mul(&matrix.tr_mul(&view.residual));
        let largest = eigen.eigenvalues.max();
        if largest <= 0.0 {
            return None;
        }
        let values: Vec<f64> = eigen.eigenvalues.iter().map(|v| v.max(0.0)).collect();
        // log evidence over no function at a prior variance of the amplitudes.
        let gain = |variance: f64| -> f64 {
            values
                .iter()
                .zip(product.iter())
                .map(|(v, b)| 0.5 * b * b / (v + 1.0 / variance) - 0.5 * (1.0 + v * variance).ln())
                .sum()
        };
        // A law that bends by more than its own size is another law.
        let largest_load = setting
            .tracks
            .iter()
            .flat_map(|t| &t.edges)
            .map(|e| e.1.abs())
            .fold(1.0, f64::max);
        let most = match self.acts {
            Acts::Bends(_) => 1.0,
            // Nor is a force beyond what drives it.
            Acts::Force => largest_load * largest_load,
        };
        let best = (0..60)
            .map(|k| 10f64.powf(-12.0 + 0.3 * f64::from(k)))
            .filter(|v| *v <= most)
            .max_by(|a, b| gain(*a).total_cmp(&gain(*b)))?;
        let rotated = DVector::from_fn(m, |i, _| -product[i] / (values[i] + 1.0 / best));
        let amplitudes = &eigen.eigenvectors * rotated;
        let sds = (0..m)
            .map(|j| {
                (0..m)
                    .map(|i| eigen.eigenvectors[(j, i)].powi(2) / (values[i] + 1.0 / best))
                    .sum::<f64>()
                    .sqrt()
            })
            .collect();
        Some(FamilyFit {
            family: self.clone(),
            response: &raw * &amplitudes,
            amplitudes: amplitudes.iter().copied().collect(),
            sds,
            gain: gain(best) - PENALTY,
            prior_sd: best.sqrt(),
        })
    }

    /// The function at an instant: value with its slope in the variable, and each hat as a derivative.
    fn profile<const N: usize>(
        &self,
        setting: &Setting,
        run: usize,
        here: &Instant<Dual<N>>,
        amplitudes: &[f64],
        first: Option<usize>,
    ) -> Dual<N> {
        let v = self.value(setting, run, here);
        let hats = self.hats(v.value);
        let mut made = Dual::constant(hats.iter().zip(amplitudes).map(|(h, a)| h * a).sum());
        let after = self.knots.partition_point(|k| *k <= v.value);
        if after > 0 && after < self.knots.len() {
            let slope = (amplitudes[after] - amplitudes[after - 1])
                / (self.knots[after] - self.knots[after - 1]);
            for (s, d) in made.slope.iter_mut().zip(v.slope) {
                *s += slope * d;
            }
        }
        if let Some(first) = first {
            for (s, h) in made.slope.iter_mut().zip(hats.iter().skip(first)) {
                *s += h;
            }
        }
        made * self.factor(&setting.tracks[run], here)
    }

    /// Motion of a run under a set and this function.
    #[allow(clippy::too_many_arguments)] // one call, five of them are the point of evaluation
    fn drive<const N: usize>(
        &self,
        setting: &Setting,
        run: usize,
        set: &[usize],
        globals: &[Dual<N>],
        start: (Dual<N>, Dual<N>),
        amplitudes: &[f64],
        first: Option<usize>,
    ) -> Vec<Dual<N>> {
        let acts_here = !matches!(self.variable, Variable::TimeIn(only) if only != run);
        match self.acts {
            Acts::Force => setting.simulate(run, set, globals, start, |h| {
                if acts_here {
                    self.profile(setting, run, h, amplitudes, first)
                } else {
                    Dual::constant(0.0)
                }
            }),
            Acts::Bends(candidate) => {
                let member = set.iter().position(|c| *c == candidate).unwrap_or(0);
                let place = setting.places(set)[member];
                // A factor e^f keeps the parameter's sign.
                setting.simulate_bent(run, set, globals, start, place, |h| {
                    self.profile(setting, run, h, amplitudes, first).exp()
                })
            }
        }
    }
}

impl FamilyFit {
    /// As [`FamilyFit::refine`]; a function of what was measured becomes one of the model's motion.
    pub fn close(
        &self,
        setting: &Setting,
        weights: &Weights,
        fit: &Fit,
    ) -> Option<(Fit, FamilyFit)> {
        let (joint, mut found) = self.refine(setting, weights, fit)?;
        if !found.family.measured {
            return Some((joint, found));
        }
        found.family.measured = false;
        let from = Fit {
            at: joint.at,
            ..fit.clone()
        };
        found.refine(setting, weights, &from)
    }

    /// A refined fit with more knots where the function bends most, as long as it is far from the
    /// noise and more knots earn their keep: what begins and ends sharply (a snag) needs them.
    pub fn sharpen(
        setting: &Setting,
        weights: &Weights,
        base: &Fit,
        mut found: (Fit, FamilyFit),
    ) -> (Fit, FamilyFit) {
        for _ in 0..SHARPENED {
            if found.0.cost < FAR_FROM_NOISE * weights.samples() as f64 {
                break;
            }
            let from = Fit {
                at: found.0.at.clone(),
                ..base.clone()
            };
            match found.1.split().refine(setting, weights, &from) {
                Some(finer) if finer.0.log_evidence > found.0.log_evidence + WORTH_KNOTS => {
                    found = finer;
                }
                _ => break,
            }
        }
        found
    }

    /// The same function with the intervals around its sharpest bends halved.
    fn split(&self) -> FamilyFit {
        let (k, a) = (&self.family.knots, &self.amplitudes);
        let slope = |i: usize| (a[i + 1] - a[i]) / (k[i + 1] - k[i]);
        let mut bends: Vec<(f64, usize)> = (1..k.len().saturating_sub(1))
            .map(|i| ((slope(i) - slope(i - 1)).abs(), i))
            .collect();
        bends.sort_by(|x, y| y.0.total_cmp(&x.0));
        let halved: std::collections::BTreeSet<usize> = bends
            .iter()
            .take(BENDS_SPLIT)
            .flat_map(|(_, i)| [i - 1, *i])
            .collect();
        let mut finer = self.clone();
        (finer.family.knots, finer.amplitudes) = (Vec::new(), Vec::new());
        for i in 0..k.len() {
            finer.family.knots.push(k[i]);
            finer.amplitudes.push(a[i]);
            if halved.contains(&i) {
                finer.family.knots.push(0.5 * (k[i] + k[i + 1]));
                finer.amplitudes.push(0.5 * (a[i] + a[i + 1]));
            }
        }
        finer
    }

    /// Fits set and function together, nonlinearly, from the linear fit; the set's evidence then
    /// includes the function's. `None` where the motion diverges.
    pub fn refine(
        &self,
        setting: &Setting,
        weights: &Weights,
        fit: &Fit,
    ) -> Option<(Fit, FamilyFit)> {
        let posed = Posed::new(setting, weights, &fit.set);
        let (g, n, m) = (
            fit.globals(setting).len(),
            fit.at.len(),
            self.amplitudes.len(),
        );
        let family = &self.family;
        let tau2 = 1.0 / (self.prior_sd * self.prior_sd);
        let cost_of = |at: &[f64], a: &[f64]| -> f64 {
            let squares: f64 = (0..setting.tracks.len())
                .into_par_iter()
                .map(|run| {
                    let globals: Vec<Dual<1>> =
                        at[..g].iter().map(|v| Dual::constant(*v)).collect();
                    let start = (
                        Dual::constant(at[g + 2 * run]),
                        Dual::constant(at[g + 2 * run + 1]),
                    );
                    let mut r: Vec<f64> = family
                        .drive(setting, run, &fit.set, &globals, start, a, None)
                        .iter()
                        .zip(&setting.tracks[run].measured)
                        .map(|(v, y)| v.value - y)
                        .collect();
                    weights.whiten(run, r.iter_mut());
                    0.5 * r.iter().map(|v| v * v).sum::<f64>()
                })
                .sum();
            squares + posed.prior_at(at) + 0.5 * tau2 * a.iter().map(|v| v * v).sum::<f64>()
        };
        let (mut at, mut a) = (fit.at.clone(), self.amplitudes.clone());
        let mut cost = cost_of(&at, &a);
        // The linear fit also moves the set's own unknowns: from the old ones it may be worse than nothing.
        let still = vec![0.0; m];
        let nothing = cost_of(&at, &still);
        if cost.is_nan() || cost >= nothing {
            (a, cost) = (still, nothing);
        }
        let mut hessian = DMatrix::zeros(n + m, n + m);
        for round in 0..7 {
            let blocks: Vec<(DVector<f64>, DMatrix<f64>)> = (0..setting.tracks.len())
                .into_par_iter()
                .map(|run| {
                    let all: Vec<f64> = at[..g]
                        .iter()
                        .copied()
                        .chain([at[g + 2 * run], at[g + 2 * run + 1]])
                        .collect();
                    let rows = setting.tracks[run].times_s.len();
                    let mut j = DMatrix::zeros(rows, g + 2 + m);
                    let mut r = DVector::zeros(rows);
                    for first in (0..all.len()).step_by(PASS) {
                        let duals: Vec<Dual<PASS>> = all
                            .iter()
                            .enumerate()
                            .map(|(i, v)| {
                                if i >= first {
                                    Dual::variable(*v, i - first)
                                } else {
                                    Dual::constant(*v)
                                }
                            })
                            .collect();
                        let out = family.drive(
                            setting,
                            run,
                            &fit.set,
                            &duals[..g],
                            (duals[g], duals[g + 1]),
                            &a,
                            None,
                        );
                        for (row, v) in out.iter().enumerate() {
                            r[row] = v.value - setting.tracks[run].measured[row];
                            for (i, s) in v.slope.iter().take(all.len() - first).enumerate() {
                                j[(row, first + i)] = *s;
                            }
                        }
                    }
                    for first in (0..m).step_by(PASS) {
                        let duals: Vec<Dual<PASS>> =
                            all.iter().map(|v| Dual::constant(*v)).collect();
                        let out = family.drive(
                            setting,
                            run,
                            &fit.set,
                            &duals[..g],
                            (duals[g], duals[g + 1]),
                            &a,
                            Some(first),
                        );
                        for (row, v) in out.iter().enumerate() {
                            for (i, s) in v.slope.iter().take(m - first).enumerate() {
                                j[(row, g + 2 + first + i)] = *s;
                            }
                        }
                    }
                    weights.whiten(run, r.iter_mut());
                    for mut column in j.column_iter_mut() {
                        weights.whiten(run, column.iter_mut());
                    }
                    (j.tr_mul(&r), j.tr_mul(&j))
                })
                .collect();
            let mut gradient: DVector<f64> = DVector::zeros(n + m);
            hessian.fill(0.0);
            for (run, (gr, h)) in blocks.iter().enumerate() {
                let column = |i: usize| match i {
                    i if i < g => i,
                    i if i < g + 2 => g + 2 * run + (i - g),
                    i => n + i - g - 2,
                };
                for i in 0..gr.len() {
                    gradient[column(i)] += gr[i];
                    for k in 0..gr.len() {
                        hessian[(column(i), column(k))] += h[(i, k)];
                    }
                }
            }
            for (i, (centre, k)) in posed.precisions(&at).into_iter().enumerate() {
                gradient[i] += (at[i] - centre) * k;
                hessian[(i, i)] += k;
            }
            for i in 0..m {
                gradient[n + i] += tau2 * a[i];
                hessian[(n + i, n + i)] += tau2;
            }
            if round == 6 {
                break;
            }
            let scale: Vec<f64> = (0..n + m)
                .map(|i| 1.0 / hessian[(i, i)].sqrt().max(1e-150))
                .collect();
            let scaled = DMatrix::from_fn(n + m, n + m, |i, k| {
                hessian[(i, k)] * scale[i] * scale[k] + if i == k { 1e-10 } else { 0.0 }
            });
            let right = DVector::from_fn(n + m, |i, _| -gradient[i] * scale[i]);
            let step = scaled.cholesky()?.solve(&right);
            let mut share = 1.0;
            let mut gained = 0.0;
            for _ in 0..8 {
                let there: Vec<f64> = (0..n).map(|i| at[i] + share * step[i] * scale[i]).collect();
                let b: Vec<f64> = (0..m)
                    .map(|i| a[i] + share * step[n + i] * scale[n + i])
                    .collect();
                let now = cost_of(&there, &b);
                if now < cost {
                    gained = cost - now;
                    (at, a, cost) = (there, b, now);
                    break;
                }
                share *= 0.3;
            }
            if gained < 0.05 {
                break;
            }
        }
        if !cost.is_finite() {
            return None;
        }
        let mut joint = Fit {
            set: fit.set.clone(),
            at: at.clone(),
            cost,
            hessian: hessian.clone(),
            log_evidence: 0.0,
            rough: false,
        };
        joint.log_evidence = posed.log_evidence(&joint) - m as f64 * self.prior_sd.ln() - PENALTY;
        let covariance = crate::identify::uncertainty::covariance(&hessian);
        let sds = (0..m)
            .map(|i| covariance[(n + i, n + i)].max(0.0).sqrt())
            .collect();
        let response: Vec<f64> = (0..setting.tracks.len())
            .flat_map(|run| {
                let globals: Vec<Dual<1>> = at[..g].iter().map(|v| Dual::constant(*v)).collect();
                let start = (
                    Dual::constant(at[g + 2 * run]),
                    Dual::constant(at[g + 2 * run + 1]),
                );
                let with = family.drive(setting, run, &fit.set, &globals, start, &a, None);
                let without =
                    setting.simulate(run, &fit.set, &globals, start, |_| Dual::constant(0.0));
                with.iter()
                    .zip(&without)
                    .map(|(w, o)| w.value - o.value)
                    .collect::<Vec<_>>()
            })
            .collect();
        // Behind here only the set's own unknowns are asked for: the function's are integrated out.
        let cross = hessian.view((0, n), (n, m)).into_owned();
        let own = hessian.view((n, n), (m, m)).into_owned();
        joint.hessian =
            hessian.view((0, 0), (n, n)) - &cross * own.cholesky()?.solve(&cross.transpose());
        let made = FamilyFit {
            gain: joint.log_evidence - fit.log_evidence,
            amplitudes: a,
            sds,
            response: DVector::from_vec(response),
            ..self.clone()
        };
        Some((joint, made))
    }
}

/// Times that the knots of a function are made denser.
const SHARPENED: usize = 5;
/// Half chi-square per sample above which a function may need more knots; noise leaves 0.5.
const FAR_FROM_NOISE: f64 = 0.53;
/// Log evidence that they must gain.
const WORTH_KNOTS: f64 = 5.0;
/// Bends about which intervals are halved at once.
const BENDS_SPLIT: usize = 6;
/// Rate at which a force against the motion has three quarters of its size, as in
/// `coulomb_friction` \[m/s, rad/s\].
const TURN_MPS: f64 = 0.004;
/// Log of the choice among a dozen functions.
const PENALTY: f64 = 3.0;

/// Range of a variable over the runs of a fit.
fn range(setting: &Setting, fit: &Fit, variable: Variable) -> Option<(f64, f64)> {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for (run, track) in setting.tracks.iter().enumerate() {
        if matches!(variable, Variable::TimeIn(only) if only != run) {
            continue;
        }
        let seen = std::cell::RefCell::new((low, high));
        let globals: Vec<Dual<1>> = fit
            .globals(setting)
            .iter()
            .map(|v| Dual::constant(*v))
            .collect();
        let (position, rate) = fit.start(setting, run);
        let _ = setting.simulate(
            run,
            &fit.set,
            &globals,
            (Dual::constant(position), Dual::constant(rate)),
            |h| {
                let v = variable.of(h).value;
                let mut seen = seen.borrow_mut();
                seen.0 = seen.0.min(v);
                seen.1 = seen.1.max(v);
                Dual::constant(0.0)
            },
        );
        (low, high) = seen.into_inner();
        if track.edges.is_empty() && matches!(variable, Variable::Load | Variable::LoadSize) {
            continue;
        }
    }
    (high > low + 1e-12).then_some((low, high))
}

/// Even knots over the range of a variable; times since an edge by ratio.
fn family(
    setting: &Setting,
    fit: &Fit,
    acts: Acts,
    variable: Variable,
    count: usize,
) -> Option<Family> {
    let (low, high) = range(setting, fit, variable)?;
    let knots = if matches!(variable, Variable::SinceEdge | Variable::AfterEdge) {
        let first: f64 = 0.15;
        if high < 4.0 * first {
            return None;
        }
        let ratio = (high / first).powf(1.0 / (count as f64 - 2.0));
        std::iter::once(0.0)
            .chain((0..count - 1).map(|k| first * ratio.powi(k as i32)))
            .collect()
    } else {
        (0..count)
            .map(|k| low + (high - low) * k as f64 / (count as f64 - 1.0))
            .collect()
    };
    Some(Family {
        acts,
        variable,
        knots,
        measured: false,
    })
}

/// What a run's times are moved by when those of all runs are laid end to end \[s\]. Asked at every instant
/// of a motion: no list is made for it.
fn laid_out_s(setting: &Setting, run: usize) -> f64 {
    let next = setting.tracks[..run]
        .iter()
        .fold(0.0, |next, t| next + (t.end_s() - t.start_s + BETWEEN_S));
    next - setting.tracks[run].start_s
}

/// The same for every run \[s\].
pub fn laid_out(setting: &Setting) -> Vec<f64> {
    (0..setting.tracks.len())
        .map(|run| laid_out_s(setting, run))
        .collect()
}

/// Knots over the time of every run.
fn each_run(setting: &Setting) -> Family {
    let knots = setting
        .tracks
        .iter()
        .zip(laid_out(setting))
        .flat_map(|(t, first)| {
            let span = t.end_s() - t.start_s;
            (0..EACH_RUN)
                .map(move |k| first + t.start_s + span * k as f64 / (EACH_RUN as f64 - 1.0))
        })
        .collect();
    Family {
        acts: Acts::Force,
        variable: Variable::TimeEach,
        knots,
        measured: false,
    }
}

/// Knots per run.
const EACH_RUN: usize = 13;
/// Between runs laid end to end \[s\].
const BETWEEN_S: f64 = 1.0;

/// Forces as functions of everything they may depend on.
pub fn forces(setting: &Setting, fit: &Fit) -> Vec<Family> {
    let mut kinds = vec![
        (Variable::Place, 32),
        (Variable::PlaceAgainst, 32),
        (Variable::Rate, 16),
        (Variable::Load, 12),
        (Variable::Time, 16),
        (Variable::SinceEdge, 10),
    ];
    kinds.extend((0..setting.tracks.len()).map(|run| (Variable::TimeIn(run), 16)));
    let mut all: Vec<Family> = kinds
        .into_iter()
        .filter_map(|(v, n)| family(setting, fit, Acts::Force, v, n))
        .collect();
    if setting.tracks.len() > 1 {
        all.push(each_run(setting));
    }
    all
}

/// The same and, in proportion to each command edge, the time since it: where the mismatch acts. That
/// one is what any lag of the thrust looks like, so it locates but is no explanation of its own.
pub fn regimes(setting: &Setting, fit: &Fit) -> Vec<Family> {
    let mut all = forces(setting, fit);
    all.extend(family(setting, fit, Acts::Force, Variable::AfterEdge, 10));
    all
}

/// Ways in which a member's law may be bent.
pub fn bends(setting: &Setting, fit: &Fit, candidate: usize) -> Vec<Family> {
    let kinds = [
        (Variable::Place, 10),
        (Variable::Rate, 10),
        (Variable::Speed, 8),
        (Variable::Load, 10),
        (Variable::LoadSize, 8),
        (Variable::Time, 8),
        (Variable::SinceEdge, 8),
    ];
    kinds
        .into_iter()
        .filter_map(|(v, n)| family(setting, fit, Acts::Bends(candidate), v, n))
        .collect()
}
