//! A settled fit in numbers and words: intervals, noise, runs, residuals.

use super::fit::{Fit, NOT_WHITE, beside};
use super::{IdentifyError, Options};
use crate::adopt::ZERO_WITHIN_SD;
use crate::figures::edges;
use crate::outcome::{Estimate, Identification, Logged, Residuals, RunSummary, SlotNoise, Trace};
use crate::parameter::{Coefficient, Term};
use crate::problem::Objective;
use crate::seen::seen;
use crate::uncertainty::{PROFILE_EVALUATIONS, Profile, Ridge, covariance, profile};
use hydroline_core::run::{Channel, Run};
use hydroline_numerics::information::correlation;
use hydroline_numerics::noise::Noise;
use hydroline_numerics::statistics::{Correlogram, LAGS, Whiteness, ljung_box, median, t95};
use hydroline_report::significant;
use hydroline_rigs::Rig;
use nalgebra::{Cholesky, DMatrix};
use std::collections::BTreeMap;

/// Relative sd above which a coefficient is weakly determined: the interval comes from the profile.
const WEAK: f64 = 0.2;
/// Correlation with another coefficient above which the same holds.
const TIED: f64 = 0.95;
/// sd above which a coefficient counts as not excited, over its size or what the rig takes for its size, whichever is larger:
/// a coefficient that is 0 is determined where its interval is narrow beside what was thought of it.
pub(super) const UNEXCITED: f64 = 0.5;
/// Residual variance over that of the noise at rest below which it is not worth a note.
const LARGER: f64 = 1.2;
/// Logged sd over scatter below which it is not worth a note.
const SHORT: f64 = 1.2;

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
        let of_data = self.problem.normal(&self.at)?.hessian;
        let prior_sds: Vec<f64> = coefficients.iter().map(|c| c.prior_sd(rig)).collect();
        // A held coefficient is known no better than the rig knows it: carried into the others' intervals.
        for i in (0..coefficients.len()).filter(|i| self.held[*i]) {
            if coefficients[i].of_vehicle(&rig.vehicle) == 0.0
                && coefficients[i].identified_sd(rig).is_none()
            {
                self.notes.push(format!(
                    "{}: the rig file knows no number; held at 0 and taken as 0 +- {:.3} {} (Table 9's range for this mass) in the other intervals",
                    coefficients[i].key(), prior_sds[i], coefficients[i].unit()
                ));
            }
        }
        // Measured noise that is too small for the residuals does not make intervals narrower than they are.
        let scale = if self.measured_noise.is_some() {
            variance.max(1.0)
        } else {
            variance
        };
        // Uncertainty of the rig does not grow with the noise.
        let beside_held = covariance(&beside(&of_data, &self.held)) * scale;
        let count = coefficients.len();
        let mut all = if self.held.iter().any(|h| *h) {
            self.with_prior_sds(&of_data, &prior_sds, scale)
        } else {
            beside_held.clone()
        };
        all += self.alike(&of_data, &beside_held)? / scale;
        let block: DMatrix<f64> = all.view((0, 0), (count, count)).into_owned();
        let correlations = correlation(&block);
        let quantile = t95(freedom);
        let mut profiles = self.profiles(&beside_held, count, (scale, freedom), options)?;
        let mut parameters = BTreeMap::new();
        for (i, c) in coefficients.iter().enumerate() {
            let free = &self.problem.free()[i];
            let value = self.at[i];
            let sd = block[(i, i)].sqrt();
            let size = value.abs().max(c.size(rig));
            let excited = !self.held[i] && sd.is_finite() && sd < UNEXCITED * size;
            // The held coefficients widen the profile's interval as they widen the sd.
            let wider = sd / beside_held[(i, i)].sqrt();
            let profile = profiles.remove(&i).map(|p| Profile {
                low: value + (p.low - value) * wider,
                high: value + (p.high - value) * wider,
                ..p
            });
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
            } else if excited && c.term != Term::Added && value.abs() < ZERO_WITHIN_SD * sd {
                self.notes.push(format!(
                    "{}: zero within ±{} {}, and these runs do show it: the vehicle may have no such drag",
                    c.key(),
                    significant(ZERO_WITHIN_SD * sd),
                    c.unit()
                ));
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
            variance_ratio: self.ratio_at_rest.unwrap_or(variance),
            residuals: Vec::new(),
            misfit: Vec::new(),
            cross_validation: Vec::new(),
            blind_spots: Vec::new(),
            held_effects: Vec::new(),
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

    /// 95 % intervals by profile likelihood of the coefficients that are weakly determined, the weakest first;
    /// what is held stays held.
    fn profiles(
        &mut self,
        beside_held: &DMatrix<f64>,
        count: usize,
        (scale, freedom): (f64, f64),
        options: &Options<'_>,
    ) -> Result<BTreeMap<usize, Profile>, IdentifyError> {
        let mut found = BTreeMap::new();
        if options.method.name() != "lm" || options.objective != Objective::LeastSquares {
            return Ok(found);
        }
        let correlations = correlation(beside_held);
        let share = |i: usize| beside_held[(i, i)].sqrt() / self.at[i].abs();
        let tied = |i: usize| (0..count).any(|j| j != i && correlations[(i, j)].abs() > TIED);
        let mut weak: Vec<usize> = (0..count)
            .filter(|i| !self.held[*i] && beside_held[(*i, *i)].is_finite())
            .filter(|i| share(*i) > WEAK || tied(*i))
            .collect();
        weak.sort_by(|a, b| share(*b).total_cmp(&share(*a)));
        let mut left = PROFILE_EVALUATIONS;
        let mut linear = Vec::new();
        for i in weak {
            if left == 0 {
                linear.push(self.problem.free()[i].name.clone());
                continue;
            }
            let column: Vec<f64> = beside_held.column(i).iter().copied().collect();
            let ridge = Ridge {
                index: i,
                sd: beside_held[(i, i)].sqrt(),
                column: &column,
                held: &self.held,
            };
            let (ends, evaluations) = profile(&self.problem, &self.at, ridge, scale, freedom)?;
            left = left.saturating_sub(evaluations);
            self.evaluations += evaluations;
            found.insert(i, ends);
        }
        if !linear.is_empty() {
            self.notes.push(format!(
                "{}: weakly determined too, but interval from the sd: {PROFILE_EVALUATIONS} evaluations were spent on the profiles of the weaker ones",
                linear.join(", ")
            ));
        }
        Ok(found)
    }

    /// Covariance that the estimates gain where a slot scatters less than the logs' own sd: the rest of that sd is
    /// an error that samples have alike (of the calibration, of the camera's response), which no scatter shows. Its shape in
    /// time is not known, and so it counts like more of the noise: C (M - H) C with M the information of noise `short`
    /// times smaller.
    fn alike(
        &mut self,
        hessian: &DMatrix<f64>,
        beside_held: &DMatrix<f64>,
    ) -> Result<DMatrix<f64>, IdentifyError> {
        let short: Vec<f64> = (0..self.noises.len())
            .map(|slot| self.logged(slot).map_or(1.0, |l| l.scale.recip().max(1.0)))
            .collect();
        let n = hessian.nrows();
        if short.iter().all(|s| *s == 1.0) {
            return Ok(DMatrix::zeros(n, n));
        }
        for (slot, short) in short.iter().enumerate().filter(|(_, s)| **s > SHORT) {
            self.notes.push(format!(
                "{}: scatters by only {:.2} of the sd in the logs; the rest may be alike in all samples: intervals are as wide as the logs' sd makes them",
                self.forward.slots()[slot],
                short.recip()
            ));
        }
        let weights = self.problem.whiteners().to_vec();
        let noises = self.noises.iter().zip(&short);
        let quieter: Vec<Noise> = noises
            .map(|(noise, short)| noise.times(1.0 / short))
            .collect();
        self.problem
            .set_noise(&quieter, |run, slot, k| weights[run][slot].counts(k));
        let more = self.problem.normal(&self.at)?.hessian - hessian;
        self.problem
            .set_noise(&self.noises, |run, slot, k| weights[run][slot].counts(k));
        let known = beside_held.map(|v| if v.is_finite() { v } else { 0.0 });
        Ok(&known * more * &known)
    }

    /// Covariance where what is held is as uncertain as the rig's uncertainty about it and these data leave it
    /// (V = (S / scale + prior_sd^-2)^-1, S the Schur complement of the held), from the covariance beside the held
    /// values and how the estimates move with them: C + D V D^T, D = - C H_held. The sum of information and
    /// uncertainty would be the same, but the data may be so much sharper that rounding eats the uncertainty.
    fn with_prior_sds(
        &self,
        hessian: &DMatrix<f64>,
        prior_sds: &[f64],
        scale: f64,
    ) -> DMatrix<f64> {
        let n = hessian.nrows();
        let held: Vec<usize> = (0..n).filter(|i| self.held[*i]).collect();
        let mut beside = covariance(&beside(hessian, &self.held));
        let open: Vec<usize> = (0..n).filter(|i| beside[(*i, *i)].is_infinite()).collect();
        for i in held.iter().chain(&open) {
            beside[(*i, *i)] = 0.0;
        }
        let mut moves = DMatrix::zeros(n, held.len());
        for (k, h) in held.iter().enumerate() {
            moves.set_column(k, &(-(&beside * hessian.column(*h))));
            moves[(*h, k)] = 1.0;
        }
        // S = H_hh + H_hf D_f = H_h D, rows h.
        let precision = DMatrix::from_fn(held.len(), held.len(), |a, b| {
            let schur = hessian
                .row(held[a])
                .transpose()
                .dot(&moves.column(b))
                .max(if a == b { 0.0 } else { f64::NEG_INFINITY });
            let information = if a == b {
                prior_sds[held[a]].max(1e-9).powi(-2)
            } else {
                0.0
            };
            schur / scale + information
        });
        let mut all = beside * scale;
        let posterior = Cholesky::new(precision).map_or_else(
            // Rounding: then the uncertainty alone.
            || {
                DMatrix::from_fn(held.len(), held.len(), |a, b| {
                    if a == b {
                        prior_sds[held[a]].powi(2)
                    } else {
                        0.0
                    }
                })
            },
            |c| c.inverse(),
        );
        all += &moves * posterior * moves.transpose();
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
                noise: self.noise_of(slot),
                outliers: self.outliers[slot],
                source: source.to_owned(),
                logged: self.logged(slot),
            };
            result.noise.insert(name.clone(), noise);
        }
        if self.measured_noise.is_none() {
            result.notes.push(
                "noise estimated from the residuals: what the model lacks counts as noise; a `still` run (>= 20 s at rest) measures it".to_owned(),
            );
            return;
        }
        let measured = |slot: &usize| self.is_measured(*slot);
        let (known, unknown): (Vec<usize>, Vec<usize>) = (0..self.forward.slots().len())
            .filter(measured)
            .partition(|slot| self.measured_at_rest(*slot).is_some());
        let name = |slot: usize| self.forward.slots()[slot].as_str();
        if !unknown.is_empty() {
            result.notes.push(format!(
                "{}: not measured at rest; noise estimated from the residuals",
                unknown.into_iter().map(name).collect::<Vec<_>>().join(", ")
            ));
        }
        let threshold = NOT_WHITE / known.len().max(1) as f64;
        for slot in known {
            // A short stretch at rest knows the level only so well.
            let by_chance = self.level_p[slot].is_some_and(|p| p >= threshold);
            if self.louder[slot].powi(2) > LARGER && !by_chance {
                result.misfit.push(format!(
                    "{}: residuals are {:.2} times the noise measured at rest: the model lacks something",
                    name(slot),
                    self.louder[slot]
                ));
            }
        }
    }

    /// sd of a slot as the logs say it, beside the noise found; `None` where they say none.
    fn logged(&self, slot: usize) -> Option<Logged> {
        let median_sd = self.problem.references()[slot]?;
        let slots = self.forward.slots().len();
        let said = (0..self.forward.runs()).flat_map(|run| {
            let sds = self.forward.logged_sd(run).iter().skip(slot).step_by(slots);
            sds.copied().filter(|sd| sd.is_finite())
        });
        let (least_sd, greatest_sd) = said.fold((f64::INFINITY, 0.0_f64), |(l, g), sd| {
            (l.min(sd), g.max(sd))
        });
        Some(Logged {
            median_sd,
            least_sd,
            greatest_sd,
            scale: self.noise_of(slot).total_sd() / median_sd,
        })
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
                seen: seen(run),
                notes: run.notes.clone(),
                start,
            });
            for c in channels {
                let channel = Channel::named(&c.name);
                let commands = run.commands.iter().map(|c| (c.t_s, c.wrench));
                result.traces.push(Trace {
                    run: run.name.clone(),
                    edges: channel.map_or(Vec::new(), |c| edges(commands, c.dof().index())),
                    noise_sd: self.channel_sd(run, &c.name, channel),
                    channel: c.name,
                    times_s: self.forward.times_s(i).to_vec(),
                    measured: c.measured,
                    fitted: c.predicted,
                });
            }
        }
        Ok(())
    }

    /// Noise of a physical channel of a run \[SI\]; where its slot is in units of the logged sd, that sd's median
    /// times what was found.
    fn channel_sd(&self, run: &Run, name: &str, channel: Option<Channel>) -> Option<f64> {
        let slots = self.forward.slots();
        let of = |slot: usize| self.noise_of(slot).total_sd();
        if let Some(slot) = slots.iter().position(|s| s == name) {
            return Some(of(slot));
        }
        let whitened = format!("whitened {name}");
        let slot = slots.iter().position(|s| *s == whitened)?;
        let channel = channel?;
        let variances = run.samples.iter().filter_map(|s| s.variance(channel));
        let mut sds: Vec<f64> = variances.map(f64::sqrt).collect();
        Some(of(slot) * median(&mut sds)?)
    }

    fn describe_residuals(
        &self,
        runs: &[Run],
        result: &mut Identification,
    ) -> Result<(), IdentifyError> {
        let mut worst: BTreeMap<String, (Whiteness, String, f64, bool)> = BTreeMap::new();
        let slots: Vec<usize> = (0..self.forward.slots().len())
            .filter(|slot| self.is_measured(*slot))
            .collect();
        let threshold = self.threshold();
        for (i, run) in runs.iter().enumerate() {
            let raw = self.problem.raw_residuals(i, &self.at)?;
            let plain = self.problem.weighed_residuals(i, &self.at)?;
            let whitened = self.problem.whitened(i, &self.at)?;
            for &slot in &slots {
                let name = &self.forward.slots()[slot];
                let kept = |series: &[f64]| self.innovations(i, slot, series);
                let (sum, n) = kept(&raw[slot])
                    .iter()
                    .filter(|v| v.is_finite())
                    .fold((0.0, 0usize), |(s, n), v| (s + v * v, n + 1));
                let filtered = kept(&whitened[slot]);
                // Colour that was measured at rest is no misfit: it is taken out first, of the stretch at rest too.
                let rest = self.measured_at_rest(slot);
                let compared = self.beside_rest.get(i).and_then(|slots| slots[slot]);
                let at_rest = compared.or_else(|| {
                    let left = rest?.left_of(self.noise_of(slot))?;
                    Correlogram::of(&[self.driven(i, slot, &whitened[slot])], LAGS)?.against(&left)
                });
                let entry = Residuals {
                    run: run.name.clone(),
                    slot: name.clone(),
                    rms: (sum / n.max(1) as f64).sqrt(),
                    plain: ljung_box(&kept(&plain[slot]), LAGS),
                    filtered: ljung_box(&filtered, LAGS),
                    at_rest,
                };
                let judged = match rest {
                    Some(_) => at_rest.or(entry.filtered),
                    None => entry.plain,
                };
                if let Some(w) = judged.filter(|w| w.p_value < threshold) {
                    let before = worst.get(name).map_or(f64::INFINITY, |w| w.0.p_value);
                    if w.p_value <= before {
                        worst.insert(
                            name.clone(),
                            (w, run.name.clone(), entry.rms, rest.is_some()),
                        );
                    }
                }
                result.residuals.push(entry);
            }
        }
        for (slot, (Whiteness { p_value, lag1, .. }, run, rms, colour_known)) in worst {
            let (taken_out, test, why) = if colour_known {
                (
                    " although the colour measured at rest was taken out",
                    "beside the stretch at rest",
                    "the model lacks something, or the noise was another one",
                )
            } else {
                (
                    "",
                    "Ljung-Box",
                    "either the noise is coloured or the model lacks something",
                )
            };
            result.misfit.push(format!(
                "{slot}: residuals are far from white{taken_out} (worst run {run}: {test} p = {p_value:.1e}, neighbours correlate {lag1:.2}, rms {rms:.3e}); {why}: hydroline diagnose"
            ));
        }
        Ok(())
    }
}
