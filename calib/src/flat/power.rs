//! γ: the slope of the exposures' ratios over their times, in logarithms.
//!
//! Lamp and exposure clock scatter from exposure to exposure by some share of the light: how much is not known and is
//! integrated over, by the residuals about the line.

use super::exposure::{Exposure, Field};
use super::ratios::Ratios;
use super::{FlatError, Options};
use hydroline_numerics::cholesky::ScaledCholesky;
use nalgebra::{DMatrix, DVector, Matrix2, Vector2};

/// Scatters that are tried: from, to, each by so much larger \[share of the light\].
const SCATTERS: [f64; 3] = [1e-4, 1.0, 1.2];
/// Half-normal scale of the scatter beforehand: lamps on mains hold 1 to 2 %, exposure clocks a line in hundreds.
const SCATTER_USUAL: f64 = 0.02;
/// Powers of cameras.
const GAMMAS: [f64; 2] = [0.2, 5.0];

#[derive(Debug, Clone)]
pub(super) struct Power {
    /// γ, b.
    pub mean: Vector2<f64>,
    pub covariance: Matrix2<f64>,
    /// Scatter of the light of the exposures about their times.
    pub scatter: f64,
    /// Share by which each exposure is brighter than by its exposure time.
    pub off_times: Vec<f64>,
}

impl Power {
    pub fn gamma(&self) -> f64 {
        self.mean[0]
    }
}

pub(super) fn fit(
    exposures: &[&Exposure],
    field: &Field,
    found: &Ratios,
    options: &Options,
) -> Result<Power, FlatError> {
    let reference = found.reference;
    let others: Vec<usize> = (0..exposures.len()).filter(|j| *j != reference).collect();
    let n = found.mean.len();
    let over = |j: usize| (exposures[j].time_s / exposures[reference].time_s).ln();
    // Columns γ and b; rows b and the ln s of the others.
    let design = DMatrix::from_fn(n, 2, |i, k| match (i, k) {
        (0, 1) => 1.0,
        (0, _) | (_, 1) => 0.0,
        (i, _) => over(others[i - 1]),
    });
    let scattered = |own: f64, size: f64| {
        let share = |j: usize| own * own * size * size + field.flicker[j].powi(2);
        let mut covariance = found.covariance.clone();
        for i in 1..n {
            for j in 1..n {
                covariance[(i, j)] += share(reference);
            }
            covariance[(i, i)] += share(others[i - 1]);
        }
        covariance
    };
    let solved = |covariance: &DMatrix<f64>| {
        let factor = ScaledCholesky::new(covariance, 0.0)?;
        let weighted = factor.solve_columns(&design);
        let information = design.transpose() * &weighted;
        let inner = ScaledCholesky::new(&information, 0.0)?;
        let mean: DVector<f64> = inner.solve(&(weighted.transpose() * &found.mean));
        let left = &found.mean - &design * &mean;
        // Restricted likelihood (Patterson and Thompson 1971).
        let ln_likelihood =
            -0.5 * (factor.ln_determinant() + inner.ln_determinant() + factor.squared_norm(&left));
        Some((mean, inner.inverse(), ln_likelihood))
    };
    let first = solved(&scattered(1.0, SCATTER_USUAL)).ok_or(FlatError::Undetermined)?;
    let gamma = first.0[0];
    if !(GAMMAS[0]..=GAMMAS[1]).contains(&gamma) {
        return Err(FlatError::NoCamera { gamma });
    }
    let [from, to, by] = SCATTERS;
    let (mut all, mut size) = (Vec::new(), from);
    while size <= to {
        let (mean, covariance, ln) =
            solved(&scattered(gamma, size)).ok_or(FlatError::Undetermined)?;
        // Steps are equal in the logarithm.
        let beforehand = size.ln() - 0.5 * (size / SCATTER_USUAL).powi(2);
        all.push((ln + beforehand, ln, mean, covariance, size));
        size *= by;
    }
    let best = all.iter().map(|a| a.0).fold(f64::NEG_INFINITY, f64::max);
    let weight = |ln: f64| (ln - best).exp();
    let sum: f64 = all.iter().map(|a| weight(a.0)).sum();
    let (mut mean, mut scatter) = (Vector2::zeros(), 0.0);
    for (ln, _, of, _, size) in &all {
        mean += Vector2::new(of[0], of[1]) * (weight(*ln) / sum);
        scatter += size * size * (weight(*ln) / sum);
    }
    let mut covariance = Matrix2::zeros();
    for (ln, _, of, inner, _) in &all {
        let apart = Vector2::new(of[0], of[1]) - mean;
        let inner = Matrix2::from_fn(|i, j| inner[(i, j)]);
        covariance += (inner + apart * apart.transpose()) * (weight(*ln) / sum);
    }
    let off_times = off_times(&others, reference, found, mean[0], &over);
    // By likelihood alone: the prior of a usual scatter is not to hide an unusual one.
    let likeliest = all
        .iter()
        .max_by(|a, b| a.1.total_cmp(&b.1))
        .map_or(0.0, |a| a.4);
    if likeliest > options.scatter_most {
        let far = |a: &&usize, b: &&usize| off_times[**a].abs().total_cmp(&off_times[**b].abs());
        let all: Vec<usize> = (0..exposures.len()).collect();
        let worst = all.iter().max_by(far).copied().unwrap_or(reference);
        return Err(FlatError::OffTime {
            name: exposures[worst].name.clone(),
            share: off_times[worst],
            most: options.scatter_most,
        });
    }
    Ok(Power {
        mean,
        covariance,
        scatter: scatter.sqrt(),
        off_times,
    })
}

/// Of each exposure, by what share its light differs from that by its exposure time, about the median.
fn off_times(
    others: &[usize],
    reference: usize,
    found: &Ratios,
    gamma: f64,
    over: &dyn Fn(usize) -> f64,
) -> Vec<f64> {
    let mut off = vec![0.0; others.len() + 1];
    for (i, j) in others.iter().enumerate() {
        off[*j] = (found.mean[i + 1] - gamma * over(*j)) / gamma;
    }
    off[reference] = 0.0;
    let middle = hydroline_numerics::statistics::median(&mut off.clone()).unwrap_or(0.0);
    off.iter().map(|o| (o - middle).exp_m1()).collect()
}
