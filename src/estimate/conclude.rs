//! A fit in numbers and words: intervals, noise, runs, residuals.

mod coefficients;

use std::collections::BTreeMap;

use hydroline_core::run::{Channel, Run};
use hydroline_identify::figures::edges;
use hydroline_identify::parameter::Coefficient;
use hydroline_identify::{Identification, Logged, Residuals, RunSummary, SlotNoise, Trace};
use hydroline_inference::at_rest::AtRest;
use hydroline_inference::body::Own;
use hydroline_numerics::information::correlation;
use hydroline_numerics::statistics::{LAGS, ljung_box};
use hydroline_rigs::Rig;
use nalgebra::DMatrix;

use super::asked::Asked;
use super::fitted::Fitted;
use super::numbers::Numbers;

/// sd by the runs alone above which a coefficient counts as not determined, over its size or what the rig takes for its size,
/// whichever is larger: a coefficient that is 0 is determined where its interval is narrow beside what was thought of it.
pub(crate) const UNEXCITED: f64 = 0.5;
/// Noise in motion over that at rest below which it is not worth a note.
const LOUDER: f64 = 1.1;
/// Logged sd over scatter below which it is not worth a note.
const SHORT: f64 = 1.2;

/// What a result is made of.
pub(crate) struct Concluding<'a> {
    pub fitted: &'a Fitted,
    pub numbers: &'a Numbers,
    pub asked: &'a Asked,
    pub at_rest: &'a AtRest,
    pub rig: &'a Rig,
}

impl Concluding<'_> {
    /// The result; what is said of other runs than the fit's is added by who asked.
    pub fn result(&self, runs: &[Run]) -> Identification {
        let Fitted { problem, fit, .. } = self.fitted;
        let mut notes = Vec::new();
        let (short, wider) = self.alike(&mut notes);
        let mut numbers_covariance = self.numbers.covariance.clone();
        numbers_covariance += wider;
        let listed = &self.asked.coefficients;
        let block = self.listed(&numbers_covariance);
        let test = problem.model_test(fit);
        let mut result = Identification {
            model: self.asked.name.clone(),
            flat_priors: problem.body.prior.is_flat(),
            ln_evidence: fit.ln_evidence,
            fits: self.fitted.fits,
            parameters: BTreeMap::new(),
            order: listed.iter().map(|c| c.key().to_owned()).collect(),
            covariance: rows(&block, |v| v.is_finite().then_some(v)),
            correlation: rows(&correlation(&block), |v| v),
            covariance_combined: Vec::new(),
            budget: Vec::new(),
            noise: BTreeMap::new(),
            variance_ratio: 1.0,
            residuals: Vec::new(),
            misfit: test.misfit(),
            test,
            cross_validation: Vec::new(),
            blind_spots: Vec::new(),
            held_effects: Vec::new(),
            runs: Vec::new(),
            notes,
            traces: Vec::new(),
        };
        self.describe_clocks(&numbers_covariance, &mut result);
        self.describe_coefficients(&block, &mut result);
        self.describe_noise(&short, &mut result);
        self.describe_runs(runs, &numbers_covariance, &mut result);
        result
    }

    /// Place of a coefficient among the vehicle's numbers; `None` = it is none of them, since nothing moves it.
    fn place(&self, c: Coefficient) -> Option<usize> {
        let own = &self.fitted.problem.body.own;
        own.iter().position(|o| o.coefficient() == Some(c))
    }

    /// Covariance of the coefficients that are listed; those that nothing moves are as uncertain as the rig knows them.
    fn listed(&self, whole: &DMatrix<f64>) -> DMatrix<f64> {
        let listed = &self.asked.coefficients;
        let places: Vec<Option<usize>> = listed.iter().map(|c| self.place(*c)).collect();
        DMatrix::from_fn(listed.len(), listed.len(), |i, j| {
            match (places[i], places[j]) {
                (Some(a), Some(b)) => whole[(a, b)],
                _ if i == j => listed[i].prior_sd(self.rig).powi(2),
                _ => 0.0,
            }
        })
    }

    /// Per DOF how many times the logs' own sd is the scatter that was found, and the covariance that the numbers gain by it: the
    /// rest of that sd is an error that samples have alike (of the calibration, of the camera's response), which no scatter shows.
    /// Its shape in time is not known, and so it counts like more of the noise: C (M - H) C with M the information of noise
    /// so many times smaller.
    fn alike(&self, notes: &mut Vec<String>) -> ([f64; 6], DMatrix<f64>) {
        let problem = &self.fitted.problem;
        let mut short = [1.0_f64; 6];
        for d in &problem.body.dofs {
            let place = Channel::POSES[*d];
            let logged = problem.body.recording.logged_sd[*d];
            let found = problem.noises.channels[place].map_or(f64::NAN, |n| n.total_sd());
            if logged.is_finite() && found > 0.0 {
                short[*d] = (logged / found).max(1.0);
            }
            if short[*d] > SHORT {
                notes.push(format!(
                    "{}: scatters by only {:.2} of the sd in the logs; the rest may be alike in all samples: intervals are as wide as the logs' sd makes them",
                    place.name(),
                    short[*d].recip()
                ));
            }
        }
        let n = self.numbers.values.len();
        let mut more = DMatrix::<f64>::zeros(n, n);
        for (d, information) in &self.numbers.by_dof {
            more += information * (short[*d].powi(2) - 1.0);
        }
        let covariance = &self.numbers.covariance;
        let known = covariance.map(|v| if v.is_finite() { v } else { 0.0 });
        (short, &known * more * &known)
    }

    /// What the runs say of joined logs' clocks, which is in every interval.
    fn describe_clocks(&self, whole: &DMatrix<f64>, result: &mut Identification) {
        let body = &self.fitted.problem.body;
        for (i, own) in body.own.iter().enumerate() {
            let clock = match own {
                Own::ClockOffset(clock) => clock,
                _ => continue,
            };
            let of = body.recording.runs.iter().find(|r| r.clock == Some(*clock));
            result.notes.push(format!(
                "{}: commands act {:.4} s (sd {:.4}) later than the joined log says (its own sd {:.4}); the clock is one of the numbers of the fit, and in the intervals",
                of.map_or("", |r| r.name.as_str()),
                self.numbers.values[i],
                whole[(i, i)].sqrt(),
                own.unit()
            ));
        }
    }

    fn describe_noise(&self, short: &[f64; 6], result: &mut Identification) {
        let problem = &self.fitted.problem;
        let (mut at_rest, mut samples) = (0.0, 0.0);
        let mut unknown = Vec::new();
        for (c, noise) in problem.noises.channels.each() {
            let Some(noise) = *noise else { continue };
            let (mut out, mut all) = (0usize, 0usize);
            for (used, r) in problem.noises.used.iter().zip(&problem.body.recording.runs) {
                for (k, u) in used.iter().enumerate() {
                    let there = r.measured(k)[c].is_finite();
                    all += usize::from(there);
                    out += usize::from(there && !u[c]);
                }
            }
            let rest = self.at_rest.channels[c].as_ref();
            let over_rest = rest.map(|r| noise.total_sd() / r.noise.total_sd());
            let is_of_rest = problem.noises.at_rest[c] == Some(noise);
            if let Some(ratio) = over_rest.filter(|r| *r > LOUDER) {
                result.notes.push(format!(
                    "{}: the noise in motion is {ratio:.2} times that at rest, which is the least that it can be; intervals are as wide as it makes them",
                    c.name()
                ));
            }
            if over_rest.is_none() {
                unknown.push(c.name());
            }
            let count = (all - out) as f64;
            at_rest += count * over_rest.unwrap_or(1.0).powi(2);
            samples += count;
            let logged_sd = (!c.is_rate()).then(|| problem.body.recording.logged_sd[c.index()]);
            let logged = logged_sd.filter(|sd| sd.is_finite()).map(|reference_sd| {
                let said = problem
                    .body
                    .recording
                    .runs
                    .iter()
                    .flat_map(|r| &r.logged_sd);
                let said = said.map(|s| s[c.index()]).filter(|sd| sd.is_finite());
                let (least_sd, greatest_sd) = said.fold((f64::INFINITY, 0.0_f64), |(l, g), sd| {
                    (l.min(sd), g.max(sd))
                });
                Logged {
                    reference_sd,
                    least_sd,
                    greatest_sd,
                    scale: match short[c.dof().index()] > 1.0 {
                        true => short[c.dof().index()].recip(),
                        false => noise.total_sd() / reference_sd,
                    },
                }
            });
            let of = SlotNoise {
                noise,
                outliers: out as f64 / all.max(1) as f64,
                source: match is_of_rest || over_rest.is_some_and(|r| r <= LOUDER) {
                    true => "measured at rest".to_owned(),
                    false => "residuals".to_owned(),
                },
                over_rest,
                logged,
            };
            result.noise.insert(c.name().to_owned(), of);
        }
        result.variance_ratio = at_rest / f64::max(samples, 1.0);
        if !unknown.is_empty() {
            result.notes.push(format!(
                "{}: noise estimated from the residuals: a `still` run (>= 20 s at rest) shows the least that it can be",
                unknown.join(", ")
            ));
        }
    }

    fn describe_runs(&self, runs: &[Run], whole: &DMatrix<f64>, result: &mut Identification) {
        let Fitted { problem, fit, .. } = self.fitted;
        let predicted = problem.predicted(&[], &fit.point);
        let left = problem.left_by_run(&predicted);
        let innovations = problem.innovations(&[], &fit.point);
        let places = problem.body.start_places(&[]);
        for (i, run) in runs.iter().enumerate() {
            let r = &problem.body.recording.runs[i];
            let start = problem.body.starts[i].iter().enumerate().map(|(k, c)| {
                let at = places[i] + k;
                let sd = whole[(at, at)].sqrt();
                let value = (self.numbers.means[at], sd.is_finite().then_some(sd));
                (format!("{}.start", c.name()), value)
            });
            result.runs.push(RunSummary {
                name: run.name.clone(),
                samples: run.samples.len(),
                length_s: run.end_s(),
                rms: left[i].by_name(),
                seen: hydroline_identify::seen(run),
                notes: run.notes.clone(),
                start: start.collect(),
            });
            for (c, noise) in problem.noises.channels.each() {
                let Some(noise) = noise else { continue };
                let measured: Vec<f64> = (0..r.times_s.len()).map(|k| r.measured(k)[c]).collect();
                let fitted: Vec<f64> = predicted[i].iter().map(|p| p[c]).collect();
                let counting = |k: usize, v: f64| match problem.noises.used[i][k][c] {
                    true => v,
                    false => f64::NAN,
                };
                let plain: Vec<f64> = (0..measured.len())
                    .map(|k| counting(k, measured[k] - fitted[k]))
                    .collect();
                let of_dof = innovations.iter().find(|v| v.0 == c.dof().index());
                let which = usize::from(c.is_rate());
                let filtered = of_dof.map(|(_, runs)| {
                    let each = runs[i].iter().enumerate();
                    each.map(|(k, v)| counting(k, v[which]))
                        .collect::<Vec<f64>>()
                });
                result.residuals.push(Residuals {
                    run: run.name.clone(),
                    slot: c.name().to_owned(),
                    rms: left[i][c],
                    plain: ljung_box(&plain, LAGS),
                    filtered: filtered.and_then(|f| ljung_box(&f, LAGS)),
                });
                result.traces.push(Trace {
                    run: run.name.clone(),
                    channel: c.name().to_owned(),
                    times_s: r.times_s.clone(),
                    measured,
                    fitted,
                    edges: edges(r.commands.iter().copied(), c.dof().index()),
                    noise_sd: Some(noise.total_sd()),
                });
            }
        }
    }
}

fn rows<T>(matrix: &DMatrix<f64>, of: impl Fn(f64) -> T) -> Vec<Vec<T>> {
    let row = |r: nalgebra::RowDVector<f64>| r.iter().map(|v| of(*v)).collect();
    matrix.row_iter().map(|r| row(r.into_owned())).collect()
}
