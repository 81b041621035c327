//! Runs that were not fitted, predicted.

use nalgebra::{DMatrix, DVector};

use super::descent::{self, Effort, Linear, Linearised};
use super::family::{FamilyFit, Joint, Variable};
use super::fit::{Fit, Posed};
use super::setting::{COEFFICIENTS, Setting, Track};
use super::weights::Weights;
use crate::identify::forward::ForwardError;
use crate::identify::lm::descend;
use crate::identify::noise::{Noise, Series, mask};

/// rms of held-out tracks with coefficients and effects as fitted, each run's start free \[m, rad\]
/// (samples that are outliers under the noise left out); `None` when nothing can be predicted.
pub fn held_out(setting: &Setting, tracks: &[Track], fit: &Fit, noise: Noise) -> Option<f64> {
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

/// The same of a set beside a free function; `None` for one of time, which tells nothing of other runs.
pub fn predicted_beside(
    setting: &Setting,
    tracks: &[Track],
    fit: &Fit,
    function: &FamilyFit,
    noise: Noise,
) -> Option<f64> {
    if tracks.is_empty() || function.family.variable.kind() == Variable::TimeEach {
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
            fixed: there
                .at
                .iter()
                .chain(&function.amplitudes)
                .copied()
                .collect(),
            range: g..there.at.len(),
        };
        let from = there.at[g..].to_vec();
        let found = descent::descend(&starts, from, Effort::FULL).ok()?;
        Some(joint.raw(&starts.full(&found.at)))
    })
}

/// A joint problem of which only the runs' starts are free.
struct Starts<'a> {
    joint: &'a Joint<'a>,
    fixed: Vec<f64>,
    range: std::ops::Range<usize>,
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
) -> Option<f64> {
    let mut weights = Weights::first(&other.tracks);
    weights = Weights::new(&other.tracks, noise, weights.used);
    let mut last = f64::NAN;
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
        let used: Vec<Vec<bool>> = weights
            .used
            .iter()
            .zip(&allowed)
            .map(|(a, b)| a.iter().zip(b).map(|(x, y)| *x && *y).collect())
            .collect();
        let kept: Vec<f64> = residuals
            .iter()
            .zip(&used)
            .flat_map(|(r, u)| r.iter().zip(u).filter(|(_, u)| **u).map(|(r, _)| *r))
            .collect();
        last = (kept.iter().map(|v| v * v).sum::<f64>() / kept.len().max(1) as f64).sqrt();
        weights = Weights::new(&other.tracks, noise, used);
    }
    Some(last)
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
        let rest_weights = Weights::new(&rest.tracks, weights.noise, used);
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
