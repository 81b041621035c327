//! The noise under which sets are compared: found beside the richest model there is at the time, a set with
//! linearised responses and free forces, or a set and a fitted free function.

use nalgebra::{DMatrix, DVector};

use super::Search;
use crate::bank::{View, pursue, whitened};
use crate::explain::{Care, look};
use crate::family::{FamilyFit, Joint, regimes};
use crate::fit::Fit;
use crate::rest::{Rates, places};
use crate::weights::{Weights, noise_beyond};
use hydroline_numerics::noise::Noise;

/// Gain of a column that counts as structure when the noise is estimated (chi-square 16).
const STRUCTURE_GAIN: f64 = 8.0;
/// Most columns taken out before the noise is estimated.
const STRUCTURE_MOST: usize = 40;
/// Noise beside a free function over that without it from which it is taken over.
const SMALLER: f64 = 0.85;
/// Half chi-square per sample below which a set leaves only noise, which leaves 0.5.
const NAMED_TO_THE_NOISE: f64 = 0.6;
/// Share of a run's length that noise must be shorter than: what drifts as slowly as the vehicle moves
/// may as well be a force.
const SLOW: f64 = 0.1;
/// The same above which it is no noise at all.
const AS_SLOW_AS_THE_RUN: f64 = 0.15;
/// Slow over white part that says the same.
const ALL_SLOW: f64 = 10.0;

impl<'a> Search<'a> {
    /// Noise from what no candidate, no free force and no coefficient explains beside a set
    /// (the richest model, linearised), then everything is fitted again under it.
    pub fn reweigh(&mut self, set: &[usize]) {
        if self.noise_stands {
            return;
        }
        for _ in 0..3 {
            let Some(fit) = self.get(set).cloned() else {
                return;
            };
            let view = View::new(self.setting, &self.weights, &fit);
            // Columns raw, to be whitened by whatever noise is tried.
            let mut raw: Vec<DVector<f64>> = self.bank.iter().map(|r| r.column.clone()).collect();
            let mut white = self.whitened.clone();
            for family in regimes(self.setting, &fit) {
                for column in family.columns(self.setting, &fit).column_iter() {
                    let column = column.into_owned();
                    white.push(whitened(self.setting, &self.weights, &column));
                    raw.push(column);
                }
            }
            let chosen = pursue(&view, &white, STRUCTURE_GAIN, STRUCTURE_MOST);
            let own = self.raw_jacobian(&fit);
            let mut columns: Vec<DVector<f64>> =
                own.column_iter().map(|c| c.into_owned()).collect();
            columns.extend(chosen.iter().map(|i| raw[*i].clone()));
            // What the chosen columns explain, found by whitened least squares, is taken out of the raw residual.
            let residuals = fit.residuals(self.setting);
            let all: Vec<f64> = residuals.iter().flatten().copied().collect();
            let matrix = DMatrix::from_columns(&columns);
            let whitened_columns: Vec<DVector<f64>> = columns
                .iter()
                .map(|c| whitened(self.setting, &self.weights, c))
                .collect();
            let whitened_columns = DMatrix::from_columns(&whitened_columns);
            let step = solve(&whitened_columns, &self.weights.stack(residuals.clone()));
            let rest_sd = self.rest_sd(&fit, &whitened_columns, step.as_ref());
            let left = match step {
                Some(step) => DVector::from_vec(all) - &matrix * step,
                None => DVector::from_vec(all),
            };
            let mut first = 0;
            let left: Vec<Vec<f64>> = residuals
                .iter()
                .map(|r| {
                    let part = left.rows(first, r.len()).iter().copied().collect();
                    first += r.len();
                    part
                })
                .collect();
            let Some((noise, used)) = noise_beyond(self.setting, &left, &matrix) else {
                return;
            };
            let before = self.weights.noise;
            let settled = (noise.total_sd() / before.total_sd() - 1.0).abs() < 0.02
                && (noise.white_sd / before.white_sd - 1.0).abs() < 0.02
                && used == self.weights.used
                && rest_sd == self.weights.rest_sd;
            tracing::debug!(
                "{} columns beside {set:?}: noise {noise:?}, rest {rest_sd:?}, outliers {}",
                chosen.len(),
                self.weights.outliers()
            );
            if self
                .least_noise
                .is_none_or(|n| noise.total_sd() < n.total_sd())
            {
                self.least_noise = Some(noise);
            }
            if self
                .sharpest
                .is_none_or(|n| noise.total_sd() < n.total_sd())
            {
                self.sharpest = Some(noise);
            }
            self.weights = Weights::new(&self.setting.tracks, noise, used).at_rest(rest_sd);
            self.looked_beside = None;
            self.rewhiten();
            let warm: Vec<(Vec<usize>, Vec<f64>)> = vec![(fit.set.clone(), fit.at.clone())];
            self.fits.clear();
            self.ways.clear();
            self.fit(warm);
            if settled {
                break;
            }
        }
    }

    /// How still the runs begin that begin at rest, beside the richest model: a fit's own derivatives, then more
    /// columns, whitened, and the step along all of them to the least residual.
    fn rest_sd(
        &self,
        fit: &Fit,
        columns: &DMatrix<f64>,
        step: Option<&DVector<f64>>,
    ) -> Option<f64> {
        let now = self.weights.rest_sd;
        let Some(step) = step.filter(|_| !self.held_still) else {
            return now;
        };
        let places = places(self.setting, fit.globals(self.setting).len());
        // The step goes from predicted towards measured.
        let rates: Vec<f64> = places.iter().map(|k| fit.at[*k] - step[*k]).collect();
        Rates::new(&columns.tr_mul(columns), &places, &rates)
            .map_or(now, |r| Some(r.believed(self.setting.tolerance)))
    }

    /// Raw derivatives with respect to all unknowns of a fit, runs end to end.
    fn raw_jacobian(&self, fit: &Fit) -> DMatrix<f64> {
        let g = fit.globals(self.setting).len();
        let rows: usize = self.setting.tracks.iter().map(|t| t.times_s.len()).sum();
        let mut all = DMatrix::zeros(rows, fit.at.len());
        let mut first = 0;
        for run in 0..self.setting.tracks.len() {
            let (_, j) = self.setting.sensitivities(
                run,
                &fit.set,
                fit.globals(self.setting),
                fit.start(self.setting, run),
            );
            all.view_mut((first, 0), (j.nrows(), g))
                .copy_from(&j.columns(0, g));
            all.view_mut((first, g + 2 * run), (j.nrows(), 2))
                .copy_from(&j.columns(g, 2));
            first += j.nrows();
        }
        all
    }

    /// Noise and a first set: looks, estimates the noise beside what was found, looks again.
    pub fn prepare(&mut self) {
        self.refresh(&[]);
        self.reweigh(&[]);
        (self.progress)("noise");
        for _ in 0..2 {
            let set = self.glance(4);
            self.refresh(&set);
            self.reweigh(&set);
            self.nothing();
            self.doubt();
            (self.progress)("noise");
            if self.unnamed_is_better(true) {
                self.hopeless = true;
                break;
            }
        }
    }

    /// The noise once more, beside the best set; where it changed, the front runners are fitted again.
    pub fn settle(&mut self) {
        if self.hopeless {
            self.finish();
            return;
        }
        let Some(best) = self.best().cloned() else {
            return;
        };
        if self.noise_stands && best.cost > NAMED_TO_THE_NOISE * self.weights.samples() as f64 {
            self.finish();
            return;
        }
        self.noise_stands = false;
        let best = best.set;
        let before = self.weights.clone();
        let front: Vec<(Vec<usize>, Vec<f64>)> = self
            .ranked()
            .iter()
            .take(80)
            .map(|f| (f.set.clone(), f.at.clone()))
            .collect();
        self.refresh(&best);
        self.reweigh(&best);
        let change = (self.weights.noise.total_sd() / before.noise.total_sd() - 1.0).abs()
            + (self.weights.noise.white_sd / before.noise.white_sd - 1.0).abs();
        let otherwise = self.weights.rest_sd != before.rest_sd;
        tracing::debug!("noise changed by {change:.3}, rest: {otherwise}");
        self.fit(front);
        self.nothing();
        if change > 0.05 || otherwise {
            self.exchange();
        }
        self.finish();
    }

    /// Longest run \[s\].
    fn span_s(&self) -> f64 {
        let tracks = &self.setting.tracks;
        tracks.iter().fold(0.0, |m, t| m.max(t.end_s() - t.start_s))
    }

    /// Whether what passes for noise is as slow as the runs are long and has hardly a white part: the error
    /// of the best law there is. Likelihoods under it compare errors of laws.
    pub fn no_law_is_exact(&self) -> bool {
        let noise = self.weights.noise;
        noise.correlation_s > AS_SLOW_AS_THE_RUN * self.span_s()
            && noise.coloured_sd > ALL_SLOW * noise.white_sd
    }

    /// A search under the least noise that was seen on the way, where the one in use is slow and clearly more.
    pub fn under_less_noise(&self) -> Option<Search<'a>> {
        let noise = self.weights.noise;
        let less = self.sharpest?;
        if noise.correlation_s < SLOW * self.span_s()
            || less.total_sd() > SMALLER * noise.total_sd()
        {
            return None;
        }
        let mut other = Search::new(self.setting, self.progress);
        other.weights = Weights::new(&self.setting.tracks, less, self.weights.used.clone())
            .at_rest(self.weights.rest_sd);
        other.noise_stands = true;
        Some(other)
    }

    /// Slow noise may be a force that the columns had no gain for, one by one. So the least noise that was
    /// found on the way is tried: where a free function beside nothing or the best set, as sharp as that noise
    /// lets it be, leaves clearly less than the noise in use, that is the noise.
    fn doubt(&mut self) {
        if self.noise_stands || self.weights.noise.correlation_s < SLOW * self.span_s() {
            return;
        }
        let Some(least) = self.least_noise.take() else {
            return;
        };
        let before = self.weights.noise;
        let best = self.best().cloned();
        let kept = (self.weights.clone(), std::mem::take(&mut self.fits));
        self.weights =
            Weights::new(&self.setting.tracks, least, kept.0.used.clone()).at_rest(kept.0.rest_sd);
        self.looked_beside = None;
        self.ways.clear();
        self.rewhiten();
        self.nothing();
        if let Some(best) = best.filter(|b| !b.set.is_empty()) {
            self.fit(vec![(best.set, best.at)]);
        }
        let tried: Vec<Fit> = self.fits.values().cloned().collect();
        for fit in tried {
            let seen = look(self, &fit, Care::Glance);
            let (true, Some(function)) = (seen.unnamed(), seen.family) else {
                continue;
            };
            let (joint, function) =
                FamilyFit::sharpen(self.setting, &self.weights, &fit, (seen.fit, function));
            if self.reweigh_beside(&joint, &function, before) {
                return;
            }
        }
        (self.weights, self.fits) = kept;
        self.ways.clear();
        self.looked_beside = None;
        self.rewhiten();
    }

    /// The noise beside a set and a function fitted together; `true` where it is clearly smaller than another,
    /// and in use from then on (sets are to be fitted again).
    pub fn reweigh_beside(&mut self, joint: &Fit, function: &FamilyFit, before: Noise) -> bool {
        let all: Vec<Vec<bool>> = self
            .weights
            .used
            .iter()
            .map(|u| vec![true; u.len()])
            .collect();
        let raw = Weights::new(&self.setting.tracks, Noise::white(1.0), all);
        let problem = Joint::new(self.setting, &raw, joint, function);
        let at = function.unknowns(joint);
        let (residuals, columns) = (problem.raw(&at), problem.columns(&at));
        if columns.iter().any(|v| !v.is_finite()) {
            return false;
        }
        let Some((noise, used)) = noise_beyond(self.setting, &residuals, &columns) else {
            return false;
        };
        tracing::debug!(
            "beside {:?} and a function of {:?}: noise {noise:?} for {before:?}",
            joint.set,
            function.family.variable
        );
        if noise.total_sd() > SMALLER * before.total_sd() {
            return false;
        }
        self.weights =
            Weights::new(&self.setting.tracks, noise, used).at_rest(self.weights.rest_sd);
        self.noise_stands = true;
        self.rewhiten();
        self.fits.clear();
        self.ways.clear();
        self.hopeless = false;
        self.instead = None;
        self.looked_beside = None;
        self.nothing();
        true
    }
}

/// Least squares by a scaled Cholesky with a trace of ridge; `None` when nothing is to be solved.
fn solve(columns: &DMatrix<f64>, right: &DVector<f64>) -> Option<DVector<f64>> {
    let n = columns.ncols();
    let mut h = columns.tr_mul(columns);
    let g = columns.tr_mul(right);
    let scale: Vec<f64> = (0..n)
        .map(|i| h[(i, i)].sqrt())
        .map(|d| if d > 0.0 { 1.0 / d } else { 0.0 })
        .collect();
    for i in 0..n {
        for j in 0..n {
            h[(i, j)] *= scale[i] * scale[j];
        }
        h[(i, i)] += 1e-10;
    }
    let scaled = DVector::from_fn(n, |i, _| g[i] * scale[i]);
    let x = h.cholesky()?.solve(&scaled);
    Some(DVector::from_fn(n, |i, _| x[i] * scale[i]))
}
