//! What the figures show: each run measured, and as the model has it without and with the effects.

use std::sync::Arc;

use crate::bank::View;
use crate::family::{Acts, FamilyFit, Variable, laid_out, regimes};
use crate::fit::{Fit, Posed};
use crate::locate::stands_out;
use crate::setting::{COEFFICIENTS, Setting, Track};
use crate::weights::Weights;
use hydroline_identify::lm::descend;
use hydroline_numerics::noise::Noise;

/// One DOF's problem and its two answers, kept for the report.
#[derive(Debug)]
pub struct Explained {
    /// The problem.
    pub setting: Setting,
    /// Noise and samples in use.
    pub weights: Weights,
    /// The vehicle refitted, no effect.
    pub plain: Fit,
    /// With the first explanation's effects.
    pub first: Fit,
    /// Runs only predicted.
    pub held: Vec<Track>,
}

/// A channel in the report's figures.
#[derive(Debug, Clone)]
pub struct Shown {
    /// Its name.
    pub channel: String,
    /// Noise of a sample \[SI\].
    pub noise_sd: f64,
    /// Runs predicted, only their starts fitted.
    pub predicted: Vec<Trace>,
    /// Runs fitted.
    pub fitted: Vec<Trace>,
    /// The free force that explains most of what the model without effects misses.
    pub regime: Option<Regime>,
}

/// One run under both models.
#[derive(Debug, Clone)]
pub struct Trace {
    /// The run.
    pub name: String,
    /// Stamps \[s\].
    pub times_s: Vec<f64>,
    /// (time, load) of the commands in its DOF \[s; N, N m\].
    pub edges: Vec<(f64, f64)>,
    /// Measured; NaN = not \[SI\].
    pub measured: Vec<f64>,
    /// Without effects \[SI\].
    pub before: Vec<f64>,
    /// With them \[SI\].
    pub after: Vec<f64>,
    /// Samples that are no outliers.
    pub used: Vec<bool>,
}

/// The free force that explains most of what the model without effects misses.
#[derive(Debug, Clone)]
pub struct Regime {
    /// Its fit.
    pub found: FamilyFit,
    /// Range of its variable in which it is strong.
    pub range: [f64; 2],
    /// Where each run begins when their times are laid end to end \[s\].
    pub laid_out_s: Vec<f64>,
}

impl Trace {
    fn of(track: &Track, before: Vec<f64>, after: Vec<f64>, used: Vec<bool>) -> Trace {
        Trace {
            name: track.name.clone(),
            times_s: track.times_s.clone(),
            edges: track.edges.clone(),
            measured: track.measured.clone(),
            before,
            after,
            used,
        }
    }

    /// Measured minus model, outliers as NaN; \[m, rad\].
    pub fn residual(&self, model: &[f64]) -> Vec<f64> {
        self.measured
            .iter()
            .zip(model)
            .zip(&self.used)
            .map(|((m, v), used)| if *used { m - v } else { f64::NAN })
            .collect()
    }

    /// Outliers: (time, measured minus the model with effects).
    pub fn outliers(&self) -> Vec<(f64, f64)> {
        self.times_s
            .iter()
            .zip(self.measured.iter().zip(&self.after))
            .zip(&self.used)
            .filter(|((_, (m, _)), used)| !**used && m.is_finite())
            .map(|((t, (m, v)), _)| (*t, m - v))
            .collect()
    }

    /// rms without and with effects.
    pub fn rms(&self) -> (f64, f64) {
        let of = |model: &[f64]| {
            let r: Vec<f64> = self
                .residual(model)
                .into_iter()
                .filter(|v| v.is_finite())
                .collect();
            (r.iter().map(|v| v * v).sum::<f64>() / r.len().max(1) as f64).sqrt()
        };
        (of(&self.before), of(&self.after))
    }
}

impl Explained {
    /// Keeps a DOF's answers.
    pub fn new(
        setting: &Setting,
        weights: &Weights,
        plain: &Fit,
        first: &Fit,
        held: &[Track],
    ) -> Arc<Explained> {
        Arc::new(Explained {
            setting: setting.with_tracks(setting.tracks.clone()),
            weights: weights.clone(),
            plain: plain.clone(),
            first: first.clone(),
            held: held.to_vec(),
        })
    }

    /// The runs fitted.
    pub fn fitted(&self) -> Vec<Trace> {
        let values = |fit: &Fit, run: usize| {
            self.setting.values(
                run,
                &fit.set,
                fit.globals(&self.setting),
                fit.start(&self.setting, run),
            )
        };
        (0..self.setting.tracks.len())
            .map(|run| {
                Trace::of(
                    &self.setting.tracks[run],
                    values(&self.plain, run),
                    values(&self.first, run),
                    self.weights.used[run].clone(),
                )
            })
            .collect()
    }

    /// Runs predicted: those held out, or without any, each run by the others. Only the start is fitted.
    pub fn predicted(&self) -> Vec<Trace> {
        if !self.held.is_empty() {
            return self
                .held
                .iter()
                .filter_map(|t| {
                    predict(
                        &self.setting,
                        t,
                        &self.plain,
                        &self.first,
                        self.weights.noise,
                    )
                })
                .collect();
        }
        let runs = self.setting.tracks.len();
        if runs < 2 {
            return Vec::new();
        }
        (0..runs)
            .filter_map(|run| {
                let keep = |i: &usize| *i != run;
                let tracks = (0..runs)
                    .filter(keep)
                    .map(|i| self.setting.tracks[i].clone())
                    .collect();
                let used = (0..runs)
                    .filter(keep)
                    .map(|i| self.weights.used[i].clone())
                    .collect();
                let rest = self.setting.with_tracks(tracks);
                let weights = Weights::new(&rest.tracks, self.weights.noise, used)
                    .at_rest(self.weights.rest_sd);
                let refit = |fit: &Fit| -> Option<Fit> {
                    let g = COEFFICIENTS + rest.parameters(&fit.set);
                    let mut at = fit.at.clone();
                    at.drain(g + 2 * run..g + 2 * run + 2);
                    Posed::new(&rest, &weights, &fit.set).fit(at).ok()
                };
                let track = &self.setting.tracks[run];
                let (plain, first) = (refit(&self.plain)?, refit(&self.first)?);
                predict(&rest, track, &plain, &first, self.weights.noise)
            })
            .collect()
    }

    /// For the figures.
    pub fn shown(&self) -> Shown {
        Shown {
            channel: self.setting.channel().to_owned(),
            noise_sd: self.weights.noise.total_sd(),
            predicted: self.predicted(),
            fitted: self.fitted(),
            regime: self.regime(),
        }
    }

    /// Where the mismatch acts: the best free force beside the model without effects.
    pub fn regime(&self) -> Option<Regime> {
        let view = View::new(&self.setting, &self.weights, &self.plain);
        let found = regimes(&self.setting, &self.plain)
            .iter()
            .filter(|f| f.acts == Acts::Force)
            .filter_map(|f| f.fit(&self.setting, &self.weights, &self.plain, &view))
            .filter(|f| f.gain > 5.0)
            .max_by(|a, b| a.gain.total_cmp(&b.gain))?;
        let (range, _) = stands_out(&self.setting, &found);
        Some(Regime {
            found,
            range,
            laid_out_s: laid_out(&self.setting),
        })
    }
}

impl Regime {
    /// Times of a run in which the variable lies in the range.
    pub fn windows(&self, run: usize, trace: &Trace) -> Vec<[f64; 2]> {
        let t = &trace.times_s;
        let load_at = |s: f64| {
            let after = trace.edges.partition_point(|e| e.0 <= s);
            after.checked_sub(1).map(|i| trace.edges[i])
        };
        let value = |k: usize| -> f64 {
            match self.found.family.variable {
                Variable::Place | Variable::PlaceAgainst => trace.before[k],
                Variable::Rate
                | Variable::Speed
                | Variable::SpeedRatio
                | Variable::SpeedAgainst => {
                    let (a, b) = (k.saturating_sub(1), (k + 1).min(t.len() - 1));
                    let rate = (trace.before[b] - trace.before[a]) / (t[b] - t[a]).max(1e-9);
                    if self.found.family.variable == Variable::Rate {
                        rate
                    } else {
                        rate.abs()
                    }
                }
                Variable::Load => load_at(t[k]).map_or(0.0, |e| e.1),
                Variable::LoadSize | Variable::LoadRatio => {
                    load_at(t[k]).map_or(0.0, |e| e.1.abs())
                }
                Variable::Time => t[k],
                Variable::TimeIn(only) if only == run => t[k],
                Variable::TimeIn(_) => f64::NAN,
                Variable::TimeEach => t[k] + self.laid_out_s.get(run).copied().unwrap_or(f64::NAN),
                Variable::SinceEdge | Variable::AfterEdge => {
                    load_at(t[k]).map_or(f64::NAN, |e| t[k] - e.0)
                }
            }
        };
        let mut windows: Vec<[f64; 2]> = Vec::new();
        let mut open = false;
        for (k, t_s) in t.iter().enumerate() {
            let inside = (self.range[0]..=self.range[1]).contains(&value(k));
            match windows.last_mut().filter(|_| open && inside) {
                Some(last) => last[1] = *t_s,
                None if inside => windows.push([*t_s, *t_s]),
                None => {}
            }
            open = inside;
        }
        windows
    }
}

/// One run from coefficients and effects that were fitted elsewhere: only its start is free.
fn predict(like: &Setting, track: &Track, plain: &Fit, first: &Fit, noise: Noise) -> Option<Trace> {
    let there = like.with_tracks(vec![track.clone()]);
    let used = Weights::first(&there.tracks).used;
    let weights = Weights::new(&there.tracks, noise, used.clone());
    let values = |fit: &Fit| -> Option<Vec<f64>> {
        let posed = Posed::new(&there, &weights, &fit.set);
        let g = COEFFICIENTS + there.parameters(&fit.set);
        let mut at = posed.start();
        at[..g].copy_from_slice(&fit.at[..g]);
        let held: Vec<bool> = (0..at.len()).map(|i| i < g).collect();
        let (found, _) = descend(&posed, at, &held, 0.01).ok()?;
        let p = found.parameters;
        Some(there.values(0, &fit.set, &p[..g], (p[g], p[g + 1])))
    };
    Some(Trace::of(
        track,
        values(plain)?,
        values(first)?,
        used.into_iter().next()?,
    ))
}
