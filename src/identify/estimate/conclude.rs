//! A settled fit in numbers and words: intervals, noise, runs, residuals.

use super::fit::{Fit, beside};
use super::{IdentifyError, Options};
use crate::identify::data::Run;
use crate::identify::outcome::{Estimate, Identification, Residuals, RunSummary, SlotNoise, Trace};
use crate::identify::parameter::Coefficient;
use crate::identify::problem::Objective;
use crate::identify::statistics::{ljung_box, t95};
use crate::identify::uncertainty::{correlation, covariance, profile};
use hydroline_rigs::Rig;
use nalgebra::DMatrix;
use std::collections::BTreeMap;

/// Relative sd above which a direction is weak: the interval comes from the profile.
const WEAK: f64 = 0.05;
/// sd over size above which a coefficient counts as not excited.
pub(super) const UNEXCITED: f64 = 0.5;
/// p below which residuals are called not white.
const NOT_WHITE: f64 = 1e-3;
/// Lags of the whiteness test.
const LAGS: usize = 20;

impl Fit<'_> {
    /// The result of a fit that has settled.
    ///
    /// # Errors
    /// [`IdentifyError`] where the motion cannot be computed.
    pub(super) fn conclude(
        &mut self,
        runs: &[Run],
        rig: &Rig,
        coefficients: &[Coefficient],
        options: &Options<'_>,
    ) -> Result<Identification, IdentifyError> {
        let (variance, freedom) = self.variance()?;
        let mut normal = self.problem.normal(&self.at)?;
        let of_data = normal.hessian.clone();
        for (i, held) in self.held.iter().enumerate() {
            if *held {
                // What is held is known no better than to its own size: carried into the others' intervals.
                normal.hessian[(i, i)] +=
                    1.0 / self.forward.globals()[i].start.abs().max(1e-9).powi(2);
            }
        }
        // Measured noise that is too small for the residuals does not make intervals narrower than they are.
        let scale = if self.measured_noise.is_some() {
            variance.max(1.0)
        } else {
            variance
        };
        let mut all = covariance(&normal.hessian) * scale;
        let count = coefficients.len();
        let open = (0..count).any(|i| all[(i, i)].is_infinite());
        if open && self.held.iter().any(|h| *h) {
            // The data are so much sharper than the size of what is held that rounding eats it.
            all = self.beside_held(&of_data, scale);
        }
        let block: DMatrix<f64> = all.view((0, 0), (count, count)).into_owned();
        let correlations = correlation(&block);
        let quantile = t95(freedom);
        let mut parameters = BTreeMap::new();
        for (i, c) in coefficients.iter().enumerate() {
            let free = &self.problem.free()[i];
            let value = self.at[i];
            let sd = block[(i, i)].sqrt();
            let excited = !self.held[i] && sd.is_finite() && sd < UNEXCITED * value.abs();
            let weak = sd.is_finite() && !self.held[i] && sd > WEAK * value.abs();
            let cheap = count <= 3;
            let profile = if weak
                && cheap
                // A profile would set free what is held.
                && !self.held.iter().any(|h| *h)
                && options.method.name() == "lm"
                && options.objective == Objective::LeastSquares
            {
                Some(profile(&self.problem, &self.at, i, sd, scale, freedom)?)
            } else {
                None
            };
            let ends = sd
                .is_finite()
                .then_some((value - quantile * sd, value + quantile * sd));
            let estimate = Estimate {
                symbol: c.symbol().to_owned(),
                unit: c.unit().to_owned(),
                value,
                sd: sd.is_finite().then_some(sd),
                low: profile.map(|p| p.low).or(ends.map(|e| e.0)),
                high: profile.map(|p| p.high).or(ends.map(|e| e.1)),
                profile,
                rig: c.of_vehicle(&rig.vehicle),
                excited,
                at_bound: !self.held[i] && (value <= free.low || value >= free.high),
            };
            if estimate.at_bound {
                self.notes.push(format!("{}: ended on its search range {:.4} .. {:.4}; the interval is not to be trusted", c.key(), free.low, free.high));
            } else if value > 0.0 && sd.is_finite() && value > 2.0 * sd {
                self.notes.push(format!("{}: {value:.4} is positive, which no hull has; something is missing from the model", c.key()));
            }
            parameters.insert(c.key().to_owned(), estimate);
        }
        for (free, value) in self.problem.free().iter().zip(&self.at).skip(count) {
            if *value <= free.low || *value >= free.high {
                self.notes.push(format!(
                    "{}: ended on its range {:.4} .. {:.4}; what follows from this run is not to be trusted",
                    free.name, free.low, free.high
                ));
            }
        }
        let finite = |v: f64| v.is_finite().then_some(v);
        let mut result = Identification {
            model: self.name.clone(),
            method: options.method.name().to_owned(),
            objective: options.objective,
            objective_value: self.objective_value,
            evaluations: self.evaluations,
            converged: self.converged,
            parameters,
            order: coefficients.iter().map(|c| c.key().to_owned()).collect(),
            covariance: block
                .row_iter()
                .map(|r| r.iter().map(|v| finite(*v)).collect())
                .collect(),
            correlation: correlations
                .row_iter()
                .map(|r| r.iter().copied().collect())
                .collect(),
            noise: BTreeMap::new(),
            variance_ratio: variance,
            residuals: Vec::new(),
            misfit: Vec::new(),
            cross_validation: Vec::new(),
            blind_spots: Vec::new(),
            runs: Vec::new(),
            notes: self.notes.clone(),
            traces: Vec::new(),
        };
        self.describe_noise(&mut result);
        self.describe_runs(runs, &all, &mut result)?;
        self.describe_residuals(runs, &mut result)?;
        if !self.converged {
            result.notes.push("the search ended before it converged; give it another start (rig file) or --method cmaes".to_owned());
        }
        Ok(result)
    }

    /// Whether any run measured this slot; a model of rates has its position as a slot all the same.
    fn is_measured(&self, slot: usize) -> bool {
        let slots = self.forward.slots().len();
        (0..self.forward.runs()).any(|run| {
            let values = self.forward.measured(run).iter().skip(slot).step_by(slots);
            values.into_iter().any(|v| v.is_finite())
        })
    }

    /// Covariance where what is held is known to its own size only, from the covariance beside the
    /// held values and how the estimates move with them: d = - C H_held, C + d size^2 d^T.
    fn beside_held(&self, hessian: &DMatrix<f64>, scale: f64) -> DMatrix<f64> {
        let n = hessian.nrows();
        let mut all = covariance(&beside(hessian, &self.held));
        let open: Vec<usize> = (0..n).filter(|i| all[(*i, *i)].is_infinite()).collect();
        for i in (0..n).filter(|i| self.held[*i] || open.contains(i)) {
            all[(i, i)] = 0.0;
        }
        let beside = all.clone();
        all *= scale;
        for h in (0..n).filter(|h| self.held[*h]) {
            let size = self.forward.globals()[h].start.abs().max(1e-9);
            let mut moves = -(&beside * hessian.column(h));
            moves[h] = 1.0;
            all.ger(size * size, &moves, &moves, 1.0);
        }
        for i in open {
            all[(i, i)] = f64::INFINITY;
        }
        all
    }

    fn describe_noise(&self, result: &mut Identification) {
        for (slot, name) in self.forward.slots().iter().enumerate() {
            if !self.is_measured(slot) {
                continue;
            }
            let source = if self.measured_at_rest(slot).is_some() {
                "measured at rest"
            } else {
                "residuals"
            };
            let noise = SlotNoise {
                noise: self.noises[slot],
                outliers: self.outliers[slot],
                source: source.to_owned(),
            };
            result.noise.insert(name.clone(), noise);
        }
        if self.measured_noise.is_none() {
            result.notes.push(
                "noise estimated from the residuals: what the model lacks counts as noise; a `still` run (>= 20 s at rest) measures it".to_owned(),
            );
        } else if result.variance_ratio > 1.2 {
            result.misfit.push(format!(
                "residuals are {:.1} times the noise measured at rest: the model lacks something",
                result.variance_ratio.sqrt()
            ));
        }
    }

    fn describe_runs(
        &self,
        runs: &[Run],
        all: &DMatrix<f64>,
        result: &mut Identification,
    ) -> Result<(), IdentifyError> {
        for (i, run) in runs.iter().enumerate() {
            let channels = self
                .forward
                .channels(i, &self.problem.of_run(i, &self.at))?;
            let columns = self.problem.columns(i);
            let start = self
                .forward
                .locals(i)
                .iter()
                .zip(columns.into_iter().skip(self.forward.globals().len()))
                .map(|(f, c)| {
                    let sd = all[(c, c)].sqrt();
                    let name = f
                        .name
                        .strip_prefix(&format!("{}.", run.name))
                        .unwrap_or(&f.name)
                        .to_owned();
                    (name, (self.at[c], sd.is_finite().then_some(sd)))
                })
                .collect();
            result.runs.push(RunSummary {
                name: run.name.clone(),
                samples: run.samples.len(),
                length_s: run.end_s(),
                rms: channels
                    .iter()
                    .filter(|c| c.measured.iter().any(|v| v.is_finite()))
                    .map(|c| (c.name.clone(), c.rms()))
                    .collect(),
                notes: run.notes.clone(),
                start,
            });
            for c in channels {
                result.traces.push(Trace {
                    run: run.name.clone(),
                    channel: c.name,
                    times_s: self.forward.times_s(i).to_vec(),
                    measured: c.measured,
                    fitted: c.predicted,
                });
            }
        }
        Ok(())
    }

    fn describe_residuals(
        &self,
        runs: &[Run],
        result: &mut Identification,
    ) -> Result<(), IdentifyError> {
        let mut worst: BTreeMap<String, (f64, String, f64, f64, bool)> = BTreeMap::new();
        for (i, run) in runs.iter().enumerate() {
            let plain = self.problem.raw_residuals(i, &self.at)?;
            let filtered = self.problem.whitened(i, &self.at)?;
            for (slot, name) in self.forward.slots().iter().enumerate() {
                if !self.is_measured(slot) {
                    continue;
                }
                let filter = &self.problem.whiteners()[i][slot];
                let kept = |series: &[f64]| -> Vec<f64> {
                    series
                        .iter()
                        .enumerate()
                        .map(|(k, v)| if filter.counts(k) { *v } else { f64::NAN })
                        .collect()
                };
                let plain_kept = kept(&plain[slot]);
                let (sum, n) = plain_kept
                    .iter()
                    .filter(|v| v.is_finite())
                    .fold((0.0, 0usize), |(s, n), v| (s + v * v, n + 1));
                let entry = Residuals {
                    run: run.name.clone(),
                    slot: name.clone(),
                    rms: (sum / n.max(1) as f64).sqrt(),
                    plain: ljung_box(&plain_kept, LAGS),
                    filtered: ljung_box(&kept(&filtered[slot]), LAGS),
                };
                // Colour that was measured at rest is no misfit: it is taken out first.
                let colour_known = self.measured_at_rest(slot).is_some();
                let judged = if colour_known {
                    entry.filtered
                } else {
                    entry.plain
                };
                if let Some(w) = judged.filter(|w| w.p_value < NOT_WHITE) {
                    let before = worst.get(name).map_or(f64::INFINITY, |w| w.0);
                    if w.p_value <= before {
                        worst.insert(
                            name.clone(),
                            (w.p_value, run.name.clone(), w.lag1, entry.rms, colour_known),
                        );
                    }
                }
                result.residuals.push(entry);
            }
        }
        for (slot, (p, run, lag1, rms, colour_known)) in worst {
            let (taken_out, why) = if colour_known {
                (
                    " although the colour measured at rest was taken out",
                    "the model lacks something, or the noise was another one",
                )
            } else {
                (
                    "",
                    "either the noise is coloured or the model lacks something",
                )
            };
            result.misfit.push(format!(
                "{slot}: residuals are far from white{taken_out} (worst run {run}: Ljung-Box p = {p:.1e}, neighbours correlate {lag1:.2}, rms {rms:.3e}); {why}: hydroline diagnose"
            ));
        }
        Ok(())
    }
}
