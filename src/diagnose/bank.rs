//! What each candidate would do to the motion, as columns beside the residuals of a fit.

use std::collections::BTreeSet;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::fit::{Fit, Posed};
use super::rest::places;
use super::setting::{COEFFICIENTS, Setting};
use super::weights::Weights;

/// Start of a response that was taken at numbers found elsewhere.
pub const ELSEWHERE: usize = usize::MAX;

/// Motion with a candidate at one of its starting points minus motion without, runs end to end.
#[derive(Debug, Clone)]
pub struct Response {
    /// Candidate.
    pub candidate: usize,
    /// Which of its starting points, or [`ELSEWHERE`].
    pub start: usize,
    /// \[m, rad\] per sample.
    pub column: DVector<f64>,
}

/// A candidate that may be worth a fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Promise {
    /// Candidate.
    pub candidate: usize,
    /// Which of its starting points.
    pub start: usize,
    /// Expected gain of half chi-square.
    pub gain: f64,
    /// Best multiple of the response.
    pub amplitude: f64,
}

/// A fit with one more candidate at a point: its set (ascending) and its unknowns.
pub fn joined(
    setting: &Setting,
    fit: &Fit,
    candidate: usize,
    point: &[f64],
) -> (Vec<usize>, Vec<f64>) {
    let mut set = fit.set.clone();
    let member = set.partition_point(|c| *c < candidate);
    set.insert(member, candidate);
    let place = setting.places(&set)[member];
    let mut at = fit.at.clone();
    at.splice(place..place, point.iter().copied());
    (set, at)
}

/// A fit without one of its members.
pub fn without(setting: &Setting, fit: &Fit, member: usize) -> (Vec<usize>, Vec<f64>) {
    let place = setting.places(&fit.set)[member];
    let n = setting.vocabulary[fit.set[member]].info.parameters.len();
    let mut set = fit.set.clone();
    set.remove(member);
    let mut at = fit.at.clone();
    at.drain(place..place + n);
    (set, at)
}

/// Motion of all runs, end to end.
pub fn motion(
    setting: &Setting,
    set: &[usize],
    globals: &[f64],
    starts: &[(f64, f64)],
) -> DVector<f64> {
    let all: Vec<Vec<f64>> = (0..setting.tracks.len())
        .map(|run| setting.values(run, set, globals, starts[run]))
        .collect();
    DVector::from_vec(all.into_iter().flatten().collect())
}

/// Motion of all runs under a set, its globals and the runs' starts.
pub type Motion<'a> = &'a (dyn Fn(&[usize], &[f64], &[(f64, f64)]) -> DVector<f64> + Sync);

/// Responses of every candidate outside of the fit's set that moves anything.
pub fn responses(setting: &Setting, fit: &Fit) -> Vec<Response> {
    responses_by(setting, fit, &|set, globals, starts| {
        motion(setting, set, globals, starts)
    })
}

/// The same, of a motion that knows more than the set (a free function).
pub fn responses_by(setting: &Setting, fit: &Fit, motion: Motion<'_>) -> Vec<Response> {
    let points: Vec<(usize, usize, &[f64])> = (0..setting.vocabulary.len())
        .filter(|c| !fit.set.contains(c))
        .flat_map(|c| starts_of(setting, c))
        .collect();
    responses_to(setting, fit, &points, motion)
}

/// Responses of one candidate at all of its starts.
pub fn responses_of(setting: &Setting, fit: &Fit, candidate: usize) -> Vec<Response> {
    let points: Vec<(usize, usize, &[f64])> = starts_of(setting, candidate).collect();
    responses_to(setting, fit, &points, &|set, globals, starts| {
        motion(setting, set, globals, starts)
    })
}

/// Responses of candidates at points of their parameters found elsewhere ([`ELSEWHERE`] for a start).
pub fn responses_at(
    setting: &Setting,
    fit: &Fit,
    points: &[(usize, &[f64])],
    motion: Motion<'_>,
) -> Vec<Response> {
    let points: Vec<(usize, usize, &[f64])> =
        points.iter().map(|(c, p)| (*c, ELSEWHERE, *p)).collect();
    responses_to(setting, fit, &points, motion)
}

/// A candidate's starts: itself, number of the start, the parameters there.
fn starts_of(setting: &Setting, candidate: usize) -> impl Iterator<Item = (usize, usize, &[f64])> {
    let starts = setting.vocabulary[candidate].starts.iter().enumerate();
    starts.map(move |(s, point)| (candidate, s, point.as_slice()))
}

/// Responses at `points`: candidate, number of the start, the parameters there.
fn responses_to(
    setting: &Setting,
    fit: &Fit,
    points: &[(usize, usize, &[f64])],
    motion: Motion<'_>,
) -> Vec<Response> {
    let starts: Vec<(f64, f64)> = (0..setting.tracks.len())
        .map(|r| fit.start(setting, r))
        .collect();
    let plain = motion(&fit.set, fit.globals(setting), &starts);
    points
        .par_iter()
        .filter_map(|&(candidate, start, point)| {
            let (set, at) = joined(setting, fit, candidate, point);
            let globals = &at[..COEFFICIENTS + setting.parameters(&set)];
            let column = motion(&set, globals, &starts) - &plain;
            let moves = column.iter().all(|v| v.is_finite()) && column.amax() > 1e-9;
            moves.then_some(Response {
                candidate,
                start,
                column,
            })
        })
        .collect()
}

/// Where a promised candidate begins: its starting point, with the first parameter scaled to the
/// promised amplitude where the response grows in proportion to it.
pub fn begin(
    setting: &Setting,
    fit: &Fit,
    bank: &[Response],
    promise: &Promise,
    motion: Motion<'_>,
) -> Vec<f64> {
    let candidate = &setting.vocabulary[promise.candidate];
    let plain = candidate.starts[promise.start].clone();
    let full = bank
        .iter()
        .find(|r| r.candidate == promise.candidate && r.start == promise.start);
    let (Some(full), Some(first)) = (full, plain.first()) else {
        return plain;
    };
    let (low, high) = candidate.bounds[0];
    let scaled = first * promise.amplitude;
    if (0.5..2.0).contains(&promise.amplitude) || !(low..=high).contains(&scaled) {
        return plain;
    }
    let mut point = plain.clone();
    point[0] = scaled;
    let starts: Vec<(f64, f64)> = (0..setting.tracks.len())
        .map(|r| fit.start(setting, r))
        .collect();
    let (set, at) = joined(setting, fit, promise.candidate, &point);
    let globals = &at[..COEFFICIENTS + setting.parameters(&set)];
    let moved = motion(&set, globals, &starts) - motion(&fit.set, fit.globals(setting), &starts);
    let expected = &full.column * promise.amplitude;
    if (&moved - &expected).norm() < 0.5 * expected.norm() {
        point
    } else {
        plain
    }
}

/// Whitens a raw column, runs end to end.
pub fn whitened(setting: &Setting, weights: &Weights, column: &DVector<f64>) -> DVector<f64> {
    let mut first = 0;
    let series = setting
        .tracks
        .iter()
        .map(|t| {
            let n = t.times_s.len();
            let part = column.rows(first, n).iter().copied().collect();
            first += n;
            part
        })
        .collect();
    weights.stack(series)
}

/// Orthonormal columns that span those of a matrix.
pub fn basis(matrix: &DMatrix<f64>) -> DMatrix<f64> {
    let mut kept: Vec<DVector<f64>> = Vec::new();
    for column in matrix.column_iter() {
        let norm = column.norm();
        if norm <= 0.0 || !norm.is_finite() {
            continue;
        }
        let mut v = column / norm;
        // Twice is enough (Kahan).
        for _ in 0..2 {
            for q in &kept {
                let along = v.dot(q);
                v.axpy(-along, q, 1.0);
            }
        }
        let left = v.norm();
        if left > 1e-9 {
            kept.push(v / left);
        }
    }
    if kept.is_empty() {
        return DMatrix::zeros(matrix.nrows(), 0);
    }
    DMatrix::from_columns(&kept)
}

/// What is left of a column outside of a span.
pub fn outside(basis: &DMatrix<f64>, column: &DVector<f64>) -> DVector<f64> {
    let mut left = column.clone();
    for _ in 0..2 {
        let along = basis.tr_mul(&left);
        left.gemv(-1.0, basis, &along, 1.0);
    }
    left
}

/// A fit seen from its candidates: whitened residual and span of what is already fitted.
pub struct View {
    /// Whitened residual, predicted - measured.
    pub residual: DVector<f64>,
    /// Orthonormal span of the whitened Jacobian.
    pub basis: DMatrix<f64>,
}

impl View {
    /// Of a fit.
    pub fn new(setting: &Setting, weights: &Weights, fit: &Fit) -> View {
        View::but(setting, weights, fit, 0..0)
    }

    /// The same with some unknowns as they are: they may not move either way.
    pub fn but(
        setting: &Setting,
        weights: &Weights,
        fit: &Fit,
        held: std::ops::Range<usize>,
    ) -> View {
        let posed = Posed::new(setting, weights, &fit.set);
        let jacobian = posed.jacobian(&fit.at);
        // A rate of which more is believed than these data say does not move either.
        let believed = weights.rest_precision(setting.tolerance);
        let still = places(setting, fit.globals(setting).len())
            .into_iter()
            .filter(|k| believed > jacobian.column(*k).norm_squared());
        let fixed: BTreeSet<usize> = held.chain(still).collect();
        let fixed: Vec<usize> = fixed.into_iter().collect();
        let basis = basis(&jacobian.remove_columns_at(&fixed));
        let residual = weights.stack(fit.residuals(setting));
        View {
            residual: outside(&basis, &residual),
            basis,
        }
    }

    /// The best starting point of each candidate, best first; `whitened` in step with `responses`.
    pub fn promises(
        &self,
        responses: &[Response],
        whitened: &[DVector<f64>],
        set: &[usize],
    ) -> Vec<Vec<Promise>> {
        let mut best: std::collections::BTreeMap<usize, Vec<Promise>> =
            std::collections::BTreeMap::new();
        let all: Vec<Option<Promise>> = responses
            .par_iter()
            .zip(whitened)
            .map(|(r, w)| {
                if set.contains(&r.candidate) {
                    return None;
                }
                let mut left = w - &self.basis * self.basis.tr_mul(w);
                let mut energy = left.norm_squared();
                if energy < 1e-6 * w.norm_squared() {
                    // Mostly cancelled: once more, for the digits that are left.
                    left = outside(&self.basis, &left);
                    energy = left.norm_squared();
                }
                // Nothing but rounding is left: not to be told from what is already there.
                if energy < 1e-10 * w.norm_squared() || energy <= 0.0 {
                    return None;
                }
                let product = left.dot(&self.residual);
                let amplitude = -product / energy;
                (amplitude > 0.0).then_some(Promise {
                    candidate: r.candidate,
                    start: r.start,
                    gain: 0.5 * product * product / energy,
                    amplitude,
                })
            })
            .collect();
        for p in all.into_iter().flatten() {
            best.entry(p.candidate).or_default().push(p);
        }
        let mut ranked: Vec<Vec<Promise>> = best.into_values().collect();
        for list in &mut ranked {
            list.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        }
        ranked.sort_by(|a, b| b[0].gain.total_cmp(&a[0].gain));
        ranked
    }
}

/// Greedy choice of columns that explain a residual (orthogonal matching pursuit): indices.
pub fn pursue(
    view: &View,
    dictionary: &[DVector<f64>],
    least_gain: f64,
    most: usize,
) -> Vec<usize> {
    let mut residual = view.residual.clone();
    let mut left: Vec<DVector<f64>> = dictionary
        .par_iter()
        .map(|d| outside(&view.basis, d))
        .collect();
    let floor: Vec<f64> = dictionary.iter().map(|d| 1e-8 * d.norm_squared()).collect();
    let mut chosen = Vec::new();
    while chosen.len() < most {
        let gains: Vec<f64> = left
            .par_iter()
            .zip(&floor)
            .map(|(d, f)| {
                let energy = d.norm_squared();
                if energy > *f {
                    0.5 * d.dot(&residual).powi(2) / energy
                } else {
                    0.0
                }
            })
            .collect();
        let Some((best, gain)) = gains
            .iter()
            .copied()
            .enumerate()
            .max_by(|a, b| a.1.total_cmp(&b.1))
        else {
            break;
        };
        if gain < least_gain {
            break;
        }
        let direction = left[best].normalize();
        let along = residual.dot(&direction);
        residual.axpy(-along, &direction, 1.0);
        left.par_iter_mut().for_each(|d| {
            let along = d.dot(&direction);
            d.axpy(-along, &direction, 1.0);
        });
        chosen.push(best);
    }
    chosen
}
