//! Predictions of runs that a model has not seen, and how well its numbers are known for that.

use hydroline_core::run::{Channel, PerChannel};
use hydroline_numerics::cholesky::{PROJECTION_JITTER, ScaledCholesky};
use nalgebra::{Cholesky, DMatrix, DVector};
use std::collections::BTreeMap;
use std::f64::consts::TAU;

use super::body::Point;
use super::filter::{Filter, Force};
use super::fit::{Effort, Fit, Problem};
use super::hyper::with_force;
use super::limit::Limit;
use super::summary::Rms;

/// Steps of the fit of a run's start.
const START_STEPS: usize = 6;
/// Share of a step of a start's fit below which it ends.
const SMALLEST_STEP: f64 = 1e-3;

/// A prediction of runs that a model has not seen.
#[derive(Debug, Clone, Default)]
pub struct Prediction {
    /// Channels per run and sample.
    pub values: Vec<Vec<PerChannel<f64>>>,
    /// Per run the rms over its samples of the sd that the model's numbers leave; NaN = not measured.
    pub sd: Vec<Rms>,
}

/// Runs are predicted worse where the error, in tolerances and noise, grows by more than this share: less is what a number that
/// is fitted too costs.
const WORSE: f64 = 0.1;

impl Problem {
    /// Error of a channel that matters to nobody: the noise's sd or the tolerance, whichever is larger; `None` = not measured.
    pub(super) fn noise_or_tolerance(&self, channel: Channel) -> Option<f64> {
        let noise = self.noises.channels[channel].as_ref()?;
        Some(noise.total_sd().max(self.body.tolerance[channel]))
    }

    /// Whether runs are predicted worse than by another prediction: each error in units of noise, tolerance and of what the
    /// model's own numbers leave open. An effect that one run alone shows is not known to the others, and says so.
    pub fn predicts_worse(&self, of: &Prediction, than: &Prediction) -> bool {
        // (squared error within noise and tolerance alone, twice minus the log score but for its constant).
        let size = |of: &Prediction| -> (f64, f64) {
            let left = self.left_by_run(&of.values);
            let runs = left.len().max(1) as f64;
            let each = left.iter().zip(&of.sd).flat_map(|(rms, sd)| {
                let channels = self.noises.channels.each();
                channels.filter_map(|(c, _)| {
                    let least = self.noise_or_tolerance(c)?;
                    let (error, open) = ((rms[c] / least).powi(2), (sd[c] / least).powi(2));
                    let score = error / (1.0 + open) + open.ln_1p();
                    score.is_finite().then_some((error / runs, score / runs))
                })
            });
            each.fold((0.0, 0.0), |sum, e| (sum.0 + e.0, sum.1 + e.1))
        };
        let (than, of) = (size(than), size(of));
        // Within noise and tolerance nobody is worse.
        let channels = self.noises.channels.iter().flatten().count() as f64;
        of.0 > channels && of.1 > (1.0 + WORSE) * than.1
    }

    /// Numbers of these runs with what was found elsewhere and starts fitted here; the motion is then predicted but for
    /// where it began.
    pub fn with_starts(&self, terms: &[usize], globals: &[f64]) -> Option<Point> {
        let places = self.body.start_places(terms);
        let mut at: Point = globals[..places[0]].to_vec();
        for (run, free) in self.body.starts.iter().enumerate() {
            at.extend(free.iter().map(|c| self.body.rest[run][*c]));
        }
        let n = at.len() - places[0];
        let number_prior = self.number_prior(terms);
        let filters: BTreeMap<usize, Vec<Filter>> = self
            .body
            .dofs
            .iter()
            .map(|d| (*d, with_force(&self.body, &self.noises, *d, Force::NONE)))
            .collect();
        let cost = |at: &Point| {
            let starts = number_prior.ln_starts(places[0], at);
            self.cost(&self.predicted(terms, at), &filters) - starts
        };
        let mut here = cost(&at);
        'steps: for _ in 0..START_STEPS {
            let all = self.simulate(terms, &at)?;
            let mut information = DMatrix::zeros(n, n);
            let mut gradient = DVector::zeros(n);
            for (&d, filters) in &filters {
                let normal = self.normal_with(&all, d, filters, at.len());
                information += normal.information.view((places[0], places[0]), (n, n));
                gradient += normal.gradient.rows(places[0], n);
            }
            let first = places[0];
            number_prior.add_starts(first, &at, &mut information, &mut gradient);
            let step = Cholesky::new(information)?.solve(&gradient);
            // A whole step may overshoot: friction that sticks is anything but linear.
            let mut share = 1.0;
            let (next, there) = loop {
                let mut tried = at.clone();
                for i in 0..n {
                    tried[places[0] + i] += share * step[i];
                }
                let there = cost(&tried);
                if there <= here {
                    break (tried, there);
                }
                share *= 0.25;
                if share < SMALLEST_STEP {
                    break 'steps;
                }
            };
            (at, here) = (next, there);
        }
        Some(at)
    }

    /// Predicts runs that a model has not seen: their starts are fitted, all other numbers are the fit's.
    pub fn predict(&self, fit: &Fit) -> Option<Prediction> {
        let point = self.with_starts(&fit.terms, &fit.point)?;
        Some(Prediction {
            values: self.predicted(&fit.terms, &point),
            sd: self.prediction_sd(fit, &point)?,
        })
    }

    /// Per run and channel the sd of the motion that a fit's numbers leave, but for what a run's start takes up.
    fn prediction_sd(&self, fit: &Fit, point: &[f64]) -> Option<Vec<Rms>> {
        let places = self.body.start_places(&fit.terms);
        let globals = places[0];
        let covariance = fit.covariance.view((0, 0), (globals, globals));
        let all = self.simulate(&fit.terms, point)?;
        let each = all.iter().enumerate().map(|(run, s)| {
            let used = &self.noises.used[run];
            let rows: Vec<(usize, Channel)> = (0..used.len())
                .flat_map(|k| {
                    Channel::ALL
                        .into_iter()
                        .filter(move |c| used[k][*c])
                        .map(move |c| (k, c))
                })
                .collect();
            // All channels in units of their noise.
            let noise = |c: Channel| self.noises.channels[c].map_or(1.0, |n| n.total_sd());
            let starts = places[run]..places[run + 1];
            let mut known = DMatrix::<f64>::zeros(rows.len(), globals);
            let mut start = DMatrix::<f64>::zeros(rows.len(), starts.len());
            for (i, column) in &s.columns {
                for (row, (k, c)) in rows.iter().enumerate() {
                    let slope = column[*k][*c] / noise(*c);
                    if *i < globals {
                        known[(row, *i)] = slope;
                    } else if starts.contains(i) {
                        start[(row, i - starts.start)] = slope;
                    }
                }
            }
            let root = ScaledCholesky::new(&start.tr_mul(&start), PROJECTION_JITTER)?;
            let taken = root.solve_columns(&start.tr_mul(&known));
            known -= start * taken;
            let spread = &known * covariance;
            let mut sum = PerChannel::splat((0.0, 0usize));
            for (row, (_, c)) in rows.iter().enumerate() {
                let variance = spread.row(row).dot(&known.row(row)) * noise(*c).powi(2);
                sum[*c].0 += variance.max(0.0);
                sum[*c].1 += 1;
            }
            Some(sum.map(|(sum, n)| match n {
                0 => f64::NAN,
                n => (sum / n as f64).sqrt(),
            }))
        });
        each.collect()
    }

    /// Log density of each run's samples under a prediction: each sample by itself, normal with the variance of its noise and
    /// of the prediction \[nat\].
    pub fn log_density(&self, prediction: &Prediction) -> Vec<f64> {
        let left = self.left_by_run(&prediction.values);
        let each = left.iter().zip(&prediction.sd).zip(&self.noises.used);
        each.map(|((rms, sd), used)| {
            let channels = self.noises.channels.each();
            let densities = channels.filter_map(|(c, noise)| {
                let samples = used.iter().filter(|u| u[c]).count() as f64;
                let variance = noise.as_ref()?.total_sd().powi(2) + sd[c].powi(2);
                let mean = (TAU * variance).ln() + rms[c].powi(2) / variance;
                mean.is_finite().then_some(-0.5 * samples * mean)
            });
            densities.sum()
        })
        .collect()
    }

    /// The problem of all runs but one, and a fit's numbers for it.
    pub fn without_run(&self, fit: &Fit, out: usize) -> (Problem, Point) {
        let places = self.body.start_places(&fit.terms);
        let runs = 0..self.body.recording.runs.len();
        let others: Vec<usize> = runs.filter(|r| *r != out).collect();
        let mut from = fit.point[..places[0]].to_vec();
        for r in &others {
            from.extend(&fit.point[places[*r]..places[r + 1]]);
        }
        (self.only(&others), from)
    }

    /// Every run as the others predict it, each model fitted anew without it.
    pub fn one_run_out(&self, fit: &Fit) -> Option<Prediction> {
        self.one_run_out_within(fit, Limit::NONE)
    }

    /// The same; `None` as well where the limit is over before the last run.
    pub fn one_run_out_within(&self, fit: &Fit, limit: Limit) -> Option<Prediction> {
        let mut all = Prediction::default();
        for out in 0..self.body.recording.runs.len() {
            if limit.is_over() {
                return None;
            }
            let (part, from) = self.without_run(fit, out);
            let made = part.fit(&fit.terms, &from, fit.cells.clone(), Effort::default())?;
            let of = self.only(&[out]).predict(&made)?;
            all.values.extend(of.values);
            all.sd.extend(of.sd);
        }
        Some(all)
    }
}
