//! What views leave: their sizes, how alike neighbours are, and what one more number per view would explain.

use nalgebra::{DMatrix, DVector, Vector2};

use super::bundle::{Pose, State, ViewTerms};
use super::camera::{FOCAL, Lens, STEPS};

/// Node residuals of a view, seen minus predicted \[px\].
pub(super) fn nodes_px(lens: &Lens, pose: &Pose, view: &ViewTerms) -> Vec<Vector2<f64>> {
    let of = |n: &super::bundle::NodeTerm| Some(n.pixel - lens.project(&pose.at(n.board_m))?);
    view.nodes
        .iter()
        .map(|n| of(n).unwrap_or_else(|| Vector2::repeat(f64::NAN)))
        .collect()
}

/// Root mean square of a coordinate of residuals.
pub(super) fn rms(residuals: &[Vector2<f64>]) -> f64 {
    let sum: f64 = residuals.iter().map(|r| r.norm_squared()).sum();
    (sum / (2.0 * residuals.len().max(1) as f64)).sqrt()
}

/// Line residuals of a view: distance from the sheet \[m\], and in the image across the line \[px\].
pub(super) fn line(state: &State, pose: &Pose, view: &ViewTerms) -> Vec<(f64, f64)> {
    let Some(sheet) = &state.sheet else {
        return Vec::new();
    };
    let distance = |pixel: Vector2<f64>| {
        let (from, along) = state.lens.ray(&pixel)?;
        Some(sheet.distance_m(&pose.meet(&from, &along)?))
    };
    (view.line.iter())
        .filter_map(|p| {
            let off = distance(p.pixel)?;
            let slope =
                (distance(p.pixel + p.across * 0.05)? - distance(p.pixel - p.across * 0.05)?) / 0.1;
            Some((off, off / slope))
        })
        .collect()
}

/// Factor on a variance for what neighbours have in common: residuals with correlation ρ from one to the next count as
/// (1 − ρ)/(1 + ρ) of their number in each direction (Bartlett 1946).
pub(super) fn alike(rows: &[Vec<Vector2<f64>>]) -> f64 {
    let (mut product, mut square) = (0.0, 0.0);
    for row in rows {
        for pair in row.windows(2) {
            product += pair[0].dot(&pair[1]);
            square += 0.5 * (pair[0].norm_squared() + pair[1].norm_squared());
        }
    }
    let rho = (product / f64::max(square, 1e-300)).clamp(0.0, 0.9);
    ((1.0 + rho) / (1.0 - rho)).powi(2)
}

/// Residuals of a view in runs of neighbouring nodes.
pub(super) fn runs(view: &ViewTerms, residuals: &[Vector2<f64>]) -> Vec<Vec<Vector2<f64>>> {
    let mut runs: Vec<Vec<Vector2<f64>>> = Vec::new();
    let mut last: Option<f64> = None;
    for (node, r) in view.nodes.iter().zip(residuals) {
        if last != Some(node.board_m[1]) {
            runs.push(Vec::new());
        }
        last = Some(node.board_m[1]);
        if let Some(run) = runs.last_mut() {
            run.push(*r);
        }
    }
    runs
}

/// Numbers that one view alone would like changed, its pose free, with their sds in the view's own scatter.
pub(super) struct Wish {
    pub value: f64,
    pub sd: f64,
}

/// What a view would add to its pixels beside its pose.
#[derive(Clone, Copy)]
pub(super) enum Extra {
    /// Another focal length, as a share.
    Focal,
    /// A shift along columns, then along rows, that grows with the row \[px over the board's height\]: a rolling
    /// shutter before a moving board.
    Shear(usize),
}

/// The wish of one view; `None` where its nodes do not say.
pub(super) fn wish(lens: &Lens, pose: &Pose, view: &ViewTerms, extra: Extra) -> Option<Wish> {
    let n = view.nodes.len();
    let rows = view.nodes.iter().map(|n| n.pixel[1]);
    let (low, high) = rows.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), r| {
        (a.min(r), b.max(r))
    });
    let mut j = DMatrix::zeros(2 * n, 7);
    let mut e = DVector::zeros(2 * n);
    for (i, node) in view.nodes.iter().enumerate() {
        let point = pose.at(node.board_m);
        let at = lens.project(&point)?;
        let w = node.weight;
        let arm = point - pose.translation;
        for k in 0..6 {
            let h = 1e-6;
            let mut d = nalgebra::Vector3::zeros();
            d[k % 3] = h;
            let step = if k < 3 { d.cross(&arm) } else { d };
            let by = (lens.project(&(point + step))? - lens.project(&(point - step))?) / (2.0 * h);
            j.view_mut((2 * i, k), (2, 1)).copy_from(&(by * w));
        }
        let by = match extra {
            Extra::Focal => {
                let moved = |s: f64| lens.moved(FOCAL, s * STEPS[FOCAL]).project(&point);
                (moved(1.0)? - moved(-1.0)?) * (lens.numbers[FOCAL] / (2.0 * STEPS[FOCAL]))
            }
            Extra::Shear(axis) => {
                let share = (node.pixel[1] - 0.5 * (low + high)) / (high - low).max(1.0);
                let mut v = Vector2::zeros();
                v[axis] = share;
                v
            }
        };
        j.view_mut((2 * i, 6), (2, 1)).copy_from(&(by * w));
        e.rows_mut(2 * i, 2).copy_from(&((node.pixel - at) * w));
    }
    let inverse = (j.transpose() * &j).try_inverse()?;
    let x = &inverse * (j.transpose() * &e);
    let left = (&e - &j * &x).norm_squared() / (2 * n).checked_sub(7)?.max(1) as f64;
    Some(Wish {
        value: x[6],
        sd: (left * inverse[(6, 6)]).sqrt().max(1e-12),
    })
}
