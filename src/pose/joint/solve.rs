//! Normal equations of the free parameters, and their inverse.

use super::super::photometric::{Column, PARAMETERS, Square, Sums, THICKNESS};
use super::Matrix7;

/// Scales of the parameters, for a well-conditioned solve.
const SCALES: [f64; PARAMETERS] = [1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1.0, 1e-4, 1.0];

fn scaled(information: &Square, free: &[bool; PARAMETERS]) -> Square {
    let mut a = Square::identity();
    for i in (0..PARAMETERS).filter(|i| free[*i]) {
        for j in (0..PARAMETERS).filter(|j| free[*j]) {
            a[(i, j)] = information[(i, j)] * SCALES[i] * SCALES[j];
        }
    }
    a
}

pub(super) fn solve(sums: &Sums, free: &[bool; PARAMETERS], damping: f64) -> Option<Column> {
    let mut a = scaled(&sums.information, free);
    let mut g = Column::zeros();
    for i in (0..PARAMETERS).filter(|i| free[*i]) {
        a[(i, i)] *= 1.0 + damping;
        g[i] = sums.gradient[i] * SCALES[i];
    }
    let mut step = a.cholesky()?.solve(&g);
    for (s, scale) in step.iter_mut().zip(SCALES) {
        *s *= scale;
    }
    Some(step)
}

/// Covariance of pose and thickness with brightness and background marginalised; zero where held.
pub(super) fn covariance(sums: &Sums, free: &[bool; PARAMETERS]) -> Option<Matrix7> {
    let inverse = scaled(&sums.information, free).cholesky()?.inverse();
    let place = |i: usize| if i == 6 { THICKNESS } else { i };
    Some(Matrix7::from_fn(|i, j| {
        let (i, j) = (place(i), place(j));
        if free[i] && free[j] {
            0.5 * (inverse[(i, j)] + inverse[(j, i)]) * SCALES[i] * SCALES[j]
        } else {
            0.0
        }
    }))
}
