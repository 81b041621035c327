//! One adjustment: models weighed by their evidence, residuals by their scatter.

use hydroline_numerics::least_squares::{Options, minimise};
use nalgebra::{DMatrix, SVector, Vector2};

use super::bundle::{Bundle, LineTerm, NodeTerm, Residuals, SHARED, State, ViewTerms};
use super::camera::{ASPECT, CAMERA, CENTRE, FOCAL, LENS, MEDIUM, PORT};
use super::sheet::CONE;
use super::{CameraPrior, Seen};
use crate::map::geometry::whitener;
use crate::map::lm::{LmError, SEARCH};
use crate::map::refractive::Known;

pub(super) type Free = [bool; SHARED];

/// Residuals beyond so many of their own scales weigh less (Huber 1964: 95 % efficient at 1.345; 2.5 keeps all but the
/// wildest nodes at full weight, whose sds the detector gives).
const HUBER: f64 = 2.5;

/// A gain of a thousandth in ln Z changes no model's weight.
const FIT: Options = Options {
    iterations_max: 60,
    decrease_relative: 1e-7,
    decrease_absolute: 1e-3,
    ..SEARCH
};

/// Terms of the views, all at full weight.
pub(super) fn terms(views: &[&Seen]) -> Vec<ViewTerms> {
    let of = |view: &&Seen| ViewTerms {
        nodes: (view.nodes.iter())
            .map(|n| NodeTerm {
                board_m: n.board_m,
                pixel: Vector2::from(n.pixel),
                whitener: whitener(&n.covariance_px2),
                weight: 1.0,
            })
            .collect(),
        line: (view.line.iter())
            .map(|p| LineTerm {
                pixel: Vector2::from(p.pixel),
                across: Vector2::from(p.across),
                sd_px: p.sd_px,
                weight: 1.0,
            })
            .collect(),
    };
    views.iter().map(of).collect()
}

/// Priors of all shared numbers; `far_m`: how far away the sheet is, which says how large a cone's numbers are.
pub(super) fn priors(camera: &CameraPrior, far_m: f64) -> [Known; SHARED] {
    let nothing = Known::new(0.0, f64::INFINITY);
    std::array::from_fn(|k| match k.checked_sub(CAMERA) {
        None => camera.numbers[k],
        // A fan 5° off its window's normal departs from a plane by 0.1 t²/far.
        Some(CONE) => Known::new(0.0, 0.1 / far_m),
        Some(s) if s == CONE + 1 => Known::new(0.0, 0.1 / (far_m * far_m)),
        Some(_) => nothing,
    })
}

/// Numbers that every model has: what is known with an sd, or not at all, and is no lens.
fn always(camera: &CameraPrior, sheet: bool) -> Free {
    std::array::from_fn(|k| {
        let uncertain = k < CAMERA && camera.numbers[k].sd > 0.0;
        match k {
            FOCAL => uncertain,
            k if k == CENTRE || k == CENTRE + 1 => uncertain,
            PORT | MEDIUM => uncertain && camera.plate.is_some(),
            k if (PORT..MEDIUM).contains(&k) => uncertain && camera.plate.is_some(),
            k if (ASPECT..PORT).contains(&k) => uncertain && camera.imported,
            k => sheet && (CAMERA..CAMERA + CONE).contains(&k),
        }
    })
}

/// Everything that may be fitted.
pub(super) fn fullest(camera: &CameraPrior, sheet: bool) -> Free {
    let mut free = always(camera, sheet);
    for (free, number) in free.iter_mut().zip(&camera.numbers).take(PORT).skip(ASPECT) {
        *free |= number.sd > 0.0;
    }
    if sheet {
        free[CAMERA + CONE] = true;
        free[CAMERA + CONE + 1] = true;
    }
    free
}

/// Lenses of growing freedom, then the sheet's: each adds to the one before.
pub(super) fn lens_models(camera: &CameraPrior, sheet: bool) -> Vec<Free> {
    let mut free = always(camera, sheet);
    if camera.imported {
        return vec![free];
    }
    let steps: [&[usize]; 5] = [
        &[LENS],
        &[LENS + 1],
        &[LENS + 2, LENS + 3],
        &[LENS + 4],
        &[ASPECT],
    ];
    (steps.iter())
        .map(|added| {
            added.iter().for_each(|k| free[*k] = true);
            free
        })
        .collect()
}

/// A model at its minimum.
pub(super) struct Solved {
    pub state: State,
    pub hessian: DMatrix<f64>,
    pub residuals: Residuals,
    pub ln_evidence: f64,
}

/// Minimises one model's sum of squares, from a state whose fixed numbers are those of the prior.
pub(super) fn solve(
    state: &State,
    views: &[ViewTerms],
    prior: &[Known; SHARED],
    free: Free,
) -> Result<Solved, LmError> {
    let mut start = state.clone();
    for k in (0..SHARED).filter(|k| !free[*k]) {
        match (k.checked_sub(CAMERA), &mut start.sheet) {
            (None, _) => start.lens.numbers[k] = prior[k].value,
            (Some(s), Some(sheet)) if s >= CONE => sheet.numbers[s] = 0.0,
            _ => {}
        }
    }
    let mut bundle = Bundle { views, prior, free };
    let found = minimise(&mut bundle, start, &FIT)?;
    if !found.ended.converged() {
        return Err(LmError::NoMinimum {
            iterations: found.iterations,
            cost: 2.0 * found.normal.cost,
        });
    }
    let half_det: f64 = match found.normal.hessian.clone().cholesky() {
        Some(factor) => factor.l_dirty().diagonal().iter().map(|d| d.ln()).sum(),
        None => f64::INFINITY,
    };
    let widths: f64 = (0..SHARED)
        .filter(|k| free[*k] && prior[*k].sd.is_finite())
        .map(|k| prior[k].sd.ln())
        .sum();
    Ok(Solved {
        ln_evidence: -found.normal.cost - half_det - widths,
        state: found.at,
        hessian: found.normal.hessian,
        residuals: found.evaluated,
    })
}

/// Sizes of the residuals of nodes (length over √2) and of the line, each in sds and without weights, by view.
pub(super) fn sizes(
    views: &[ViewTerms],
    residuals: &Residuals,
    sheet: bool,
) -> Vec<(Vec<[f64; 2]>, Vec<f64>)> {
    let mut values = residuals.values.iter();
    let mut next = |weight: f64| values.next().copied().unwrap_or(0.0) / weight;
    (views.iter())
        .map(|view| {
            let nodes = view
                .nodes
                .iter()
                .map(|n| [next(n.weight), next(n.weight)])
                .collect();
            let line = match sheet {
                true => view.line.iter().map(|l| next(l.weight)).collect(),
                false => Vec::new(),
            };
            (nodes, line)
        })
        .collect()
}

/// Median of sizes that are |N(0, s)|, as s; 0 of none.
pub(super) fn scale(mut sizes: Vec<f64>, share: f64) -> f64 {
    sizes.sort_by(f64::total_cmp);
    sizes.get(sizes.len() / 2).map_or(0.0, |m| m / share)
}

/// New Huber weights; true where any changed by more than a fiftieth.
pub(super) fn reweight(views: &mut [ViewTerms], residuals: &Residuals, sheet: bool) -> bool {
    let sizes = sizes(views, residuals, sheet);
    let lengths = |n: &[f64; 2]| n[0].hypot(n[1]);
    // Median of a Rayleigh 1.1774 s, of a half-normal 0.6745 s.
    let nodes = scale(
        sizes.iter().flat_map(|s| s.0.iter().map(lengths)).collect(),
        1.1774,
    )
    .max(1e-9);
    let line = scale(
        sizes
            .iter()
            .flat_map(|s| s.1.iter().map(|r| r.abs()))
            .collect(),
        0.6745,
    )
    .max(1e-9);
    let mut changed = false;
    let mut set = |weight: &mut f64, size: f64| {
        let new = (HUBER / size.max(1e-12)).min(1.0).sqrt();
        changed |= (new - *weight).abs() > 0.02;
        *weight = new;
    };
    for (view, (node_sizes, line_sizes)) in views.iter_mut().zip(&sizes) {
        for (term, size) in view.nodes.iter_mut().zip(node_sizes) {
            set(&mut term.weight, lengths(size) / nodes);
        }
        for (term, size) in view.line.iter_mut().zip(line_sizes) {
            set(&mut term.weight, size.abs() / line);
        }
    }
    changed
}

/// Rounds of weights: they settle in three or four.
const ROUNDS: usize = 6;

/// Fits with weights until they settle.
pub(super) fn settle(
    state: &State,
    views: &mut [ViewTerms],
    prior: &[Known; SHARED],
    free: Free,
) -> Result<Solved, LmError> {
    let sheet = state.sheet.is_some();
    let mut solved = solve(state, views, prior, free)?;
    for _ in 0..ROUNDS {
        if !reweight(views, &solved.residuals, sheet) {
            break;
        }
        solved = solve(&solved.state, views, prior, free)?;
    }
    Ok(solved)
}

/// Mean and covariance of the shared numbers over models, by their evidence (Hoeting et al. 1999): the spread between
/// models is in it. The state of the likeliest model holds the mean's numbers.
pub(super) fn average(models: Vec<(Free, Solved)>) -> Option<(State, DMatrix<f64>, Solved, Free)> {
    let best = models
        .iter()
        .map(|m| m.1.ln_evidence)
        .fold(f64::NEG_INFINITY, f64::max);
    let mut mean = SVector::<f64, SHARED>::zeros();
    let mut parts = Vec::with_capacity(models.len());
    let mut total = 0.0;
    for (free, solved) in &models {
        let share = (solved.ln_evidence - best).exp();
        if share.is_nan() || share <= 1e-9 {
            continue;
        }
        let inverse = solved.hessian.clone().cholesky()?.inverse();
        let covariance = DMatrix::from_fn(SHARED, SHARED, |i, k| {
            if free[i] && free[k] {
                inverse[(i, k)]
            } else {
                0.0
            }
        });
        let x = SVector::<f64, SHARED>::from_fn(|k, _| match k.checked_sub(CAMERA) {
            None => solved.state.lens.numbers[k],
            Some(s) => solved.state.sheet.map_or(0.0, |sheet| sheet.numbers[s]),
        });
        mean += x * share;
        total += share;
        parts.push((share, x, covariance));
    }
    mean /= total;
    let mut covariance = DMatrix::zeros(SHARED, SHARED);
    for (share, x, own) in parts {
        let off = x - mean;
        covariance += (own + off * off.transpose()) * (share / total);
    }
    let likeliest = models
        .into_iter()
        .max_by(|a, b| a.1.ln_evidence.total_cmp(&b.1.ln_evidence))?;
    let mut state = likeliest.1.state.clone();
    state.lens.numbers = std::array::from_fn(|k| mean[k]);
    if let Some(sheet) = &mut state.sheet {
        sheet.numbers = std::array::from_fn(|k| mean[CAMERA + k]);
    }
    Some((state, covariance, likeliest.1, likeliest.0))
}
