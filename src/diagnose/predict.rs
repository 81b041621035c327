//! Runs that were not fitted, predicted.

use nalgebra::{DMatrix, DVector};

use super::bank::{basis, outside};
use super::descent::{self, Effort, Linear, Linearised};
use super::family::{FamilyFit, Joint};
use super::fit::{Fit, Posed};
use super::setting::{COEFFICIENTS, Setting, Track};
use super::weights::{Weights, in_both};
use hydroline_identify::forward::ForwardError;
use hydroline_identify::lm::descend;
use hydroline_identify::uncertainty::covariance;
use hydroline_numerics::noise::{Noise, Series, mask};

/// Runs predicted, and what was missed.
#[derive(Debug, Clone, PartialEq)]
pub struct Prediction {
    /// rms \[m, rad\], outliers under the noise left out.
    pub rms: f64,
    /// Predicted minus measured per run; `None` = left out.
    missed: Vec<Vec<Option<f64>>>,
}

/// Parts of each run over which squared errors are summed before two predictions are compared.
const PARTS: usize = 10;
/// t of the difference of two predictions' squared errors above which one is better: one in forty by chance
/// in the ten parts of one run, fewer in more runs.
pub const BETTER_T: f64 = 2.26;

/// The same when the best of several is asked (0.025 / n of Student's t with 9 degrees of freedom, within 0.03 up
/// to n = 10).
pub fn better_t(several: usize) -> f64 {
    BETTER_T + 0.63 * (several.max(1) as f64).ln()
}

impl Prediction {
    /// Which samples count, run by run.
    pub fn kept(&self) -> Vec<Vec<bool>> {
        let counts = |run: &Vec<Option<f64>>| run.iter().map(Option::is_some).collect();
        self.missed.iter().map(counts).collect()
    }

    /// Runs that were predicted.
    pub fn runs(&self) -> usize {
        self.missed.len()
    }

    /// How surely the other one misses by more: t of the mean difference of squared errors, tenth by tenth
    /// of each run, whose errors are correlated within but hardly between them (Diebold and Mariano 1995).
    pub fn better_than(&self, other: &Prediction) -> f64 {
        let mut differences = Vec::new();
        // Runs cut into windows are parts already.
        let parts = if self.missed.len() < PARTS { PARTS } else { 1 };
        for (own, others) in self.missed.iter().zip(&other.missed) {
            let length = own.len().div_ceil(parts).max(1);
            for (a, b) in own.chunks(length).zip(others.chunks(length)) {
                let both: Vec<f64> = a
                    .iter()
                    .zip(b)
                    .filter_map(|(a, b)| Some((*b)?.powi(2) - (*a)?.powi(2)))
                    .collect();
                if !both.is_empty() {
                    differences.push(both.iter().sum::<f64>());
                }
            }
        }
        let n = differences.len() as f64;
        if n < 4.0 {
            return 0.0;
        }
        let mean = differences.iter().sum::<f64>() / n;
        let spread = differences.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / (n - 1.0);
        mean / (spread / n).sqrt().max(1e-300)
    }
}

/// rms that the errors of held-out tracks have where the set is right: the noise's, and what the covariance of its
/// numbers makes of them in motions that the runs fitted did not show, each run from where it begins \[m, rad\].
pub fn expected(setting: &Setting, tracks: &[Track], fit: &Fit, noise: Noise) -> f64 {
    let other = setting.with_tracks(tracks.to_vec());
    let globals = fit.globals(setting);
    let g = globals.len();
    // What the data leave open is no wider than its prior, as in the evidence.
    let covariance = covariance(&fit.hessian_within_priors(setting));
    let covariance = covariance.view((0, 0), (g, g)).into_owned();
    let (mut sum, mut count) = (0.0, 0.0);
    for (run, track) in other.tracks.iter().enumerate() {
        // A driven run starts from rest: its rate takes nothing over.
        let moves = track.starts_under_way(setting.tolerance);
        let rate = if moves { track.rate_at_start() } else { None };
        let position = track.measured.first().copied().unwrap_or(0.0);
        let start = (position, rate.unwrap_or(0.0));
        let (_, jacobian) = other.sensitivities(run, &fit.set, globals, start);
        let starts = basis(&jacobian.columns(g, if moves { 2 } else { 1 }).into_owned());
        let columns: Vec<DVector<f64>> = (0..g)
            .map(|i| outside(&starts, &jacobian.column(i).into_owned()))
            .collect();
        let own = DMatrix::from_columns(&columns);
        // Trace of J C J': the variances of all samples.
        sum += (&own * &covariance).component_mul(&own).sum();
        count += own.nrows() as f64;
    }
    let spread = sum / f64::max(count, 1.0);
    let spread = if spread.is_finite() {
        spread.max(0.0)
    } else {
        0.0
    };
    (noise.total_sd().powi(2) + spread).sqrt()
}

/// rms of held-out tracks with coefficients and effects as fitted, each run's start free \[m, rad\]
/// (samples that are outliers under the noise left out); `None` when nothing can be predicted.
pub fn held_out(setting: &Setting, tracks: &[Track], fit: &Fit, noise: Noise) -> Option<f64> {
    predicted(setting, tracks, fit, noise).map(|p| p.rms)
}

/// The same with every error.
pub fn predicted(
    setting: &Setting,
    tracks: &[Track],
    fit: &Fit,
    noise: Noise,
) -> Option<Prediction> {
    if tracks.is_empty() {
        return None;
    }
    let other = setting.with_tracks(tracks.to_vec());
    let g = COEFFICIENTS + setting.parameters(&fit.set);
    judged(&other, noise, |weights| {
        let posed = Posed::new(&other, weights, &fit.set);
        let mut at = posed.start();
        at[..g].copy_from_slice(&fit.at[..g]);
        let held: Vec<bool> = (0..at.len()).map(|i| i < g).collect();
        let (found, _) = descend(&posed, at, &held, 0.01).ok()?;
        let there = Fit {
            at: found.parameters,
            ..fit.clone()
        };
        Some(there.residuals(&other))
    })
}

/// The same of a set beside a free function; `None` for a force in time, which tells nothing of other runs.
pub fn predicted_beside(
    setting: &Setting,
    tracks: &[Track],
    fit: &Fit,
    function: &FamilyFit,
    noise: Noise,
) -> Option<Prediction> {
    if tracks.is_empty() || !function.family.lasts() {
        return None;
    }
    let other = setting.with_tracks(tracks.to_vec());
    let g = COEFFICIENTS + setting.parameters(&fit.set);
    judged(&other, noise, |weights| {
        let mut at = Posed::new(&other, weights, &fit.set).start();
        at[..g].copy_from_slice(&fit.at[..g]);
        let there = Fit { at, ..fit.clone() };
        let joint = Joint::new(&other, weights, &there, function);
        let starts = Starts {
            joint: &joint,
            fixed: function.unknowns(&there),
            range: g..there.at.len(),
        };
        let from = there.at[g..].to_vec();
        let found = descent::descend(&starts, from, Effort::FULL).ok()?;
        Some(joint.raw(&starts.full(&found.at)))
    })
}

/// A joint problem of which only some unknowns are free.
pub struct Starts<'a> {
    /// The problem.
    pub joint: &'a Joint<'a>,
    /// All unknowns.
    pub fixed: Vec<f64>,
    /// Those that are free.
    pub range: std::ops::Range<usize>,
}

impl Starts<'_> {
    fn full(&self, starts: &[f64]) -> Vec<f64> {
        let mut all = self.fixed.clone();
        all[self.range.clone()].copy_from_slice(starts);
        all
    }
}

impl Linearised for Starts<'_> {
    fn bounds(&self, i: usize) -> (f64, f64) {
        self.joint.bounds(self.range.start + i)
    }

    fn residuals(&self, at: &[f64]) -> (f64, Vec<Vec<f64>>) {
        self.joint.residuals(&self.full(at))
    }

    fn linearise(&self, at: &[f64]) -> Result<Linear, ForwardError> {
        let all = self.joint.linearise(&self.full(at))?;
        let (first, n) = (self.range.start, self.range.len());
        Ok(Linear {
            gradient: all.gradient.rows(first, n).into_owned(),
            hessian: all.hessian.view((first, first), (n, n)).into_owned(),
            ..all
        })
    }

    fn gradient(
        &self,
        at: &[f64],
        residuals: &[Vec<f64>],
        jacobians: &[DMatrix<f64>],
    ) -> DVector<f64> {
        self.joint
            .gradient(&self.full(at), residuals, jacobians)
            .rows(self.range.start, self.range.len())
            .into_owned()
    }
}

/// rms of residuals over the samples that are no outliers under the noise; `residuals` are asked twice,
/// the second time with those left out.
fn judged(
    other: &Setting,
    noise: Noise,
    residuals: impl Fn(&Weights) -> Option<Vec<Vec<f64>>>,
) -> Option<Prediction> {
    let mut weights = Weights::first(&other.tracks);
    weights = Weights::new(&other.tracks, noise, weights.used);
    let mut last = None;
    for _ in 0..2 {
        let residuals = residuals(&weights)?;
        let series: Vec<Series<'_>> = other
            .tracks
            .iter()
            .zip(&residuals)
            .map(|(t, r)| Series {
                times_s: &t.times_s,
                values: r,
                jacobian: None,
            })
            .collect();
        // Local outliers stay out; a sample the noise forbids only where the model else fits.
        let allowed = mask(&series, noise);
        let used = in_both(&weights.used, &allowed);
        let missed: Vec<Vec<Option<f64>>> = residuals
            .iter()
            .zip(&used)
            .map(|(r, u)| r.iter().zip(u).map(|(r, u)| u.then_some(*r)).collect())
            .collect();
        let kept = || missed.iter().flatten().flatten();
        let rms = (kept().map(|v| v * v).sum::<f64>() / kept().count().max(1) as f64).sqrt();
        last = Some(Prediction { rms, missed });
        weights = Weights::new(&other.tracks, noise, used);
    }
    last
}

/// Each run predicted by the others: rms over all \[m, rad\].
pub fn left_out(setting: &Setting, weights: &Weights, fit: &Fit) -> Option<f64> {
    let runs = setting.tracks.len();
    if runs < 2 {
        return None;
    }
    let (mut sum, mut count) = (0.0, 0.0);
    for run in 0..runs {
        let others: Vec<Track> = setting
            .tracks
            .iter()
            .enumerate()
            .filter(|(i, _)| *i != run)
            .map(|(_, t)| t.clone())
            .collect();
        let used = weights
            .used
            .iter()
            .enumerate()
            .filter(|(i, _)| *i != run)
            .map(|(_, u)| u.clone())
            .collect();
        let rest = setting.with_tracks(others);
        let rest_weights = Weights::new(&rest.tracks, weights.noise, used).at_rest(weights.rest_sd);
        let g = COEFFICIENTS + setting.parameters(&fit.set);
        let mut at = fit.at.clone();
        at.drain(g + 2 * run..g + 2 * run + 2);
        let refit = Posed::new(&rest, &rest_weights, &fit.set).fit(at).ok()?;
        let rms = held_out(
            &rest,
            std::slice::from_ref(&setting.tracks[run]),
            &refit,
            weights.noise,
        )?;
        let n = setting.tracks[run].times_s.len() as f64;
        sum += rms * rms * n;
        count += n;
    }
    Some((sum / count).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What the runs fitted leave open widens what the run held out may show; what they know well does not.
    #[test]
    fn a_prediction_may_miss_by_its_own_covariance() {
        use crate::search::Search;
        use crate::testing::{NOISE_M, setting, surge};
        let setting = setting(&[surge(0, &[])]);
        let held = [Track::of(&surge(2, &[]), setting.dof).unwrap()];
        let mut search = Search::new(&setting, &|_| {});
        search.nothing();
        let fit = search.finished(&[]).unwrap();
        let noise = Noise::white(NOISE_M);
        let may = expected(&setting, &held, &fit, noise);
        let missed = held_out(&setting, &held, &fit, noise).unwrap();
        assert!(
            may > NOISE_M && missed < 2.0 * may && may < 20.0 * NOISE_M,
            "{missed} of {may}"
        );
        let sharper = Fit {
            hessian: &fit.hessian * 100.0,
            ..fit.clone()
        };
        let spread = |v: f64| v * v - NOISE_M * NOISE_M;
        let ratio = spread(may) / spread(expected(&setting, &held, &sharper, noise));
        assert!((ratio / 100.0 - 1.0).abs() < 1e-3, "{ratio}");
        assert_eq!(expected(&setting, &[], &fit, noise), NOISE_M);
    }

    /// Errors that come and go in long waves: a tenth more of them proves nothing, twice as many do.
    #[test]
    fn a_prediction_is_better_when_its_errors_differ_by_more_than_they_vary() {
        let made = |size: f64, phase: f64| {
            let missed: Vec<Vec<Option<f64>>> = (0..2)
                .map(|run| {
                    (0..400)
                        .map(|k| {
                            let t = 0.1 * f64::from(k) + 3.0 * f64::from(run);
                            (k % 97 != 0).then(|| size * (0.7 * t + phase).sin())
                        })
                        .collect()
                })
                .collect();
            let all: Vec<f64> = missed.iter().flatten().flatten().copied().collect();
            let rms = (all.iter().map(|v| v * v).sum::<f64>() / all.len() as f64).sqrt();
            Prediction { rms, missed }
        };
        let (small, alike, large) = (made(1.0, 0.0), made(1.02, 1.5), made(2.0, 1.0));
        assert!(small.better_than(&large) > BETTER_T);
        assert!(large.better_than(&small) < -BETTER_T);
        assert!(small.better_than(&alike).abs() < BETTER_T);
        assert_eq!(small.better_than(&small.clone()), 0.0);
    }
}
