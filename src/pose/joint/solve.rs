//! Normal equations of a frame in units of its unknowns' size, and their inverse.

use super::super::photometric::{Column, PARAMETERS, Square, Sums, THICKNESS};
use super::Matrix7;
use super::valley::Valley;
use hydroline_numerics::cholesky::{ScaledCholesky, Scaling};
use hydroline_numerics::least_squares::Normal;
use nalgebra::Const;

/// Size of a step of each parameter: mm, mrad, a grey level, 0.1 mm of thickness. With them the equations need
/// no other scaling.
const SIZES: [f64; PARAMETERS] = [1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1.0, 1e-4, 1.0];

/// Information in units of the parameters' sizes.
fn sized(information: &Square) -> Square {
    Square::from_fn(|i, j| information[(i, j)] * SIZES[i] * SIZES[j])
}

/// The normal equations of a frame in the coordinates of its valley, in units of the parameters' sizes.
pub(super) fn equations(sums: &Sums, valley: &Valley) -> Normal<Const<PARAMETERS>> {
    let (information, gradient) = valley.turn(sums);
    Normal {
        cost: sums.cost,
        // The sums' residuals are seen minus model, their derivatives are the model's.
        gradient: Column::from_fn(|i, _| -(gradient[i] * SIZES[i])),
        hessian: sized(&information),
    }
}

/// A step in SI from one in units of the parameters' sizes.
pub(super) fn in_si(step: &Column) -> Column {
    Column::from_fn(|i, _| step[i] * SIZES[i])
}

/// Covariance of pose and thickness with brightness and background marginalised; zero where held.
pub(super) fn covariance(sums: &Sums, free: &[bool; PARAMETERS]) -> Option<Matrix7> {
    let sized = sized(&sums.information);
    let inverse = ScaledCholesky::of_free(&sized, |i| free[i], Scaling::AsGiven, 0.0)?.inverse();
    let place = |i: usize| if i == 6 { THICKNESS } else { i };
    Some(Matrix7::from_fn(|i, j| {
        let (i, j) = (place(i), place(j));
        0.5 * (inverse[(i, j)] + inverse[(j, i)]) * SIZES[i] * SIZES[j]
    }))
}
