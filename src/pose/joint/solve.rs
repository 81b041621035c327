//! Normal equations of a frame in units of its unknowns' size, and their inverse.

use super::super::photometric::{
    ACROSS, BACKGROUND, BLACK, BRIGHTNESS, ByMap, Column, LINE, LOCAL, OF_RUN, PARAMETERS,
    PRIOR_SD, Square, State, Sums, THICKNESS, TONE, UNEVEN,
};
use super::camera::{self, OfRun, OfRun2, ResponsePrior, ResponseSeen};
use super::weak_direction::WeakDirection;
use super::{MapLoadings, Matrix7};
use hydroline_numerics::cholesky::{ScaledCholesky, Scaling};
use hydroline_numerics::least_squares::Normal;
use nalgebra::Const;

/// Size of a step of each parameter: mm, mrad, a grey level, 0.1 mm of thickness, a hundredth of γ, a thousandth of what the
/// line has across, a hundredth of what uneven light may be. With them the equations need no other scaling.
const SIZES: [f64; PARAMETERS] = {
    let mut sizes = [1e-3; PARAMETERS];
    (sizes[BRIGHTNESS], sizes[THICKNESS], sizes[BACKGROUND]) = (1.0, 1e-4, 1.0);
    (sizes[TONE], sizes[BLACK]) = (0.01, 1.0);
    let mut k = 0;
    while k < ACROSS {
        sizes[LINE + k] = 0.02 * camera::PRIOR_SD[2 + k];
        k += 1;
    }
    k = 0;
    while k < UNEVEN {
        sizes[LOCAL + k] = 0.01 * PRIOR_SD[k];
        k += 1;
    }
    sizes
};

/// Information in units of the parameters' sizes.
fn sized(information: &Square) -> Square {
    Square::from_fn(|i, j| information[(i, j)] * SIZES[i] * SIZES[j])
}

/// The normal equations of a frame in [`WeakDirection`]'s coordinates, in units of the parameters' sizes.
pub(super) fn equations(sums: &Sums, weak_direction: &WeakDirection) -> Normal<Const<PARAMETERS>> {
    let (information, gradient) = weak_direction.transformed(sums);
    Normal {
        cost: sums.cost,
        // The sums' residuals are seen minus model, their derivatives are the model's.
        gradient: Column::from_fn(|i, _| -(gradient[i] * SIZES[i])),
        hessian: sized(&information),
    }
}

/// gᵀH⁻¹g, twice what a full step gains: by some unknowns where others are held, and by these, all of the former following.
/// Each may come once.
pub(super) fn squared_decrement(
    equations: &Normal<Const<PARAMETERS>>,
    first: impl Iterator<Item = usize>,
    then: impl Iterator<Item = usize>,
) -> Option<[f64; 2]> {
    let Normal {
        gradient, hessian, ..
    } = equations;
    // L y = g by rows of Cholesky's L, in this order.
    let mut lower = [[0.0; PARAMETERS]; PARAMETERS];
    let mut order = [0; PARAMETERS];
    let mut y = [0.0; PARAMETERS];
    let mut sums = [0.0; 2];
    let parts = first.map(|k| (0, k)).chain(then.map(|k| (1, k)));
    for (n, (part, k)) in parts.take(PARAMETERS).enumerate() {
        let (above, own) = lower.split_at_mut(n);
        let own = &mut own[0];
        let mut left = hessian[(k, k)];
        let mut by = gradient[k];
        for (m, (row, y)) in above.iter().zip(&y).enumerate() {
            let products = own[..m].iter().zip(&row[..m]).map(|(a, b)| a * b);
            let entry = (hessian[(k, order[m])] - products.sum::<f64>()) / row[m];
            own[m] = entry;
            left -= entry * entry;
            by -= entry * y;
        }
        // NaN is no sound pivot either.
        if left.is_nan() || left <= 0.0 {
            return None;
        }
        own[n] = left.sqrt();
        order[n] = k;
        y[n] = by / own[n];
        sums[part] += y[n] * y[n];
    }
    Some(sums)
}

/// A step in SI from one in units of the parameters' sizes.
pub(super) fn in_si(step: &Column) -> Column {
    Column::from_fn(|i, _| step[i] * SIZES[i])
}

/// Estimate of the camera's response from the sums at a state, all that is free marginalised.
pub(super) fn response_seen(
    sums: &Sums,
    state: &State,
    free: &[bool; PARAMETERS],
    response_prior: &ResponsePrior,
) -> Option<ResponseSeen> {
    let sized = sized(&sums.information);
    let inverse = ScaledCholesky::of_free(&sized, |i| free[i], Scaling::AsGiven, 0.0)?.inverse();
    // The inverse is zero where nothing is free.
    let gradient = Column::from_fn(|i, _| sums.gradient[i] * SIZES[i]);
    let at = |k: usize| TONE + k;
    let step = OfRun::from_fn(|k, _| (inverse.row(at(k)) * gradient)[0] * SIZES[at(k)]);
    let covariance = OfRun2::from_fn(|i, j| inverse[(at(i), at(j))] * SIZES[at(i)] * SIZES[at(j)]);
    Some(ResponseSeen {
        mean: camera::of_run(state) + step,
        information: covariance.try_inverse()? - response_prior.information,
        line_residuals: sums.line_residuals,
    })
}

/// Covariance that uncertain considered parameters add: G Σ Gᵀ with G = −P J, P that of what is free, J the information of
/// what is free by what is held (Schmidt's consider parameters).
fn considered_covariance(inverse: &Square, sized: &Square, considered: &OfRun2) -> Square {
    let of_run = OfRun::from_fn(|k, _| 1.0 / SIZES[TONE + k]);
    let by = inverse * sized.fixed_columns::<OF_RUN>(TONE) * OfRun2::from_diagonal(&of_run);
    by * considered * by.transpose()
}

/// Error of pose and thickness for an error of one standard deviation in each displacement that the map may have: P Jᵀ W dr, of what
/// is free.
pub(super) fn loadings(sums: &Sums, free: &[bool; PARAMETERS]) -> Option<MapLoadings> {
    if sums.by_map.iter().all(|v| *v == 0.0) {
        return Some(MapLoadings::zeros());
    }
    let sized = sized(&sums.information);
    let inverse = ScaledCholesky::of_free(&sized, |i| free[i], Scaling::AsGiven, 0.0)?.inverse();
    let by = ByMap::from_fn(|i, k| sums.by_map[(i, k)] * SIZES[i]);
    let moved = inverse * by;
    Some(MapLoadings::from_fn(|i, k| {
        let i = if i == 6 { THICKNESS } else { i };
        moved[(i, k)] * SIZES[i]
    }))
}

/// Covariance of pose and thickness with all light marginalised; zero where held: from the frame's own pixels, and the
/// same with the uncertainty of the camera's response.
pub(super) fn covariances(
    sums: &Sums,
    free: &[bool; PARAMETERS],
    considered: Option<&OfRun2>,
) -> Option<[Matrix7; 2]> {
    let sized = sized(&sums.information);
    let alone = ScaledCholesky::of_free(&sized, |i| free[i], Scaling::AsGiven, 0.0)?.inverse();
    let all = match considered {
        Some(considered) => alone + considered_covariance(&alone, &sized, considered),
        None => alone,
    };
    let place = |i: usize| if i == 6 { THICKNESS } else { i };
    Some([alone, all].map(|inverse| {
        Matrix7::from_fn(|i, j| {
            let (i, j) = (place(i), place(j));
            0.5 * (inverse[(i, j)] + inverse[(j, i)]) * SIZES[i] * SIZES[j]
        })
    }))
}
