//! Maps per cell: inverse bilinear, or least-squares affine through the four corners.

use nalgebra::{Matrix2, Matrix3, Matrix3x2, Vector2, Vector3};

use super::super::{MapError, Node};
use super::{Table, scallop};
use crate::plane::PlanePoint;

/// All cells whose four corners were seen.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Cells {
    cells: Vec<Cell>,
    affine: bool,
}

#[derive(Debug, Clone, PartialEq)]
struct Cell {
    /// (0,0), (1,0), (0,1), (1,1): first along ξ.
    corners: [Node; 4],
    /// Distances along the image of the four lines around the cell, in ξ and in η, with
    /// the lines' levels: for the scallop.
    lines: [[Option<(f64, f64)>; 4]; 2],
    /// Image (1, u, v) to plane, least squares, with (ΦᵀΦ)⁻¹.
    plane: Matrix3x2<f64>,
    inverse: Matrix3<f64>,
    /// rms of the affine's misfit at the four corners (ξ, η) \[m\].
    misfit_m: [f64; 2],
    centre: [f64; 2],
}

impl Cells {
    pub(super) fn new(table: Table, affine: bool) -> Result<Self, MapError> {
        let mut cells = Vec::new();
        let (columns, rows) = (table.xi_m.len(), table.eta_m.len());
        for j in 0..rows.saturating_sub(1) {
            for i in 0..columns.saturating_sub(1) {
                let corner = |a: usize, b: usize| table.at[j + b][i + a];
                if let (Some(a), Some(b), Some(c), Some(d)) =
                    (corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1))
                {
                    cells.extend(Cell::new([a, b, c, d], neighbours(&table, i, j)));
                }
            }
        }
        if cells.is_empty() {
            return Err(MapError::NotAGrid { columns, rows });
        }
        Ok(Cells { cells, affine })
    }

    pub(super) fn to_plane(&self, u: f64, v: f64) -> Option<PlanePoint> {
        let cell = self.cells.iter().find(|c| c.holds(u, v))?;
        if self.affine {
            cell.affine(u, v)
        } else {
            cell.bilinear(u, v)
        }
    }

    pub(super) fn to_image(&self, xi_m: f64, eta_m: f64) -> Option<[f64; 2]> {
        let inside = |low: f64, high: f64, x: f64| x >= low - 2e-4 && x <= high + 2e-4;
        let cell = self.cells.iter().find(|c| {
            inside(c.corners[0].xi_m, c.corners[3].xi_m, xi_m)
                && inside(c.corners[0].eta_m, c.corners[3].eta_m, eta_m)
        })?;
        if self.affine {
            let m = Matrix2::new(
                cell.plane[(1, 0)],
                cell.plane[(2, 0)],
                cell.plane[(1, 1)],
                cell.plane[(2, 1)],
            );
            let p = m.try_inverse()?
                * Vector2::new(xi_m - cell.plane[(0, 0)], eta_m - cell.plane[(0, 1)]);
            Some([p[0] + cell.centre[0], p[1] + cell.centre[1]])
        } else {
            let [a, .., d] = &cell.corners;
            let s = (xi_m - a.xi_m) / (d.xi_m - a.xi_m);
            let t = (eta_m - a.eta_m) / (d.eta_m - a.eta_m);
            Some(cell.blend(s, t))
        }
    }
}

/// Image distances of the lines i−1 … i+2 (and j−1 … j+2) from the cell's lower line,
/// along the cell's own side.
fn neighbours(table: &Table, i: usize, j: usize) -> [[Option<(f64, f64)>; 4]; 2] {
    let at = |i: Option<usize>, j: Option<usize>| -> Option<Node> { *table.at.get(j?)?.get(i?)? };
    let along = |node: Option<Node>, from: &Node, to: &Node| -> Option<f64> {
        let side = [to.column_px - from.column_px, to.row_px - from.row_px];
        let length = side[0].hypot(side[1]);
        node.map(|n| {
            ((n.column_px - from.column_px) * side[0] + (n.row_px - from.row_px) * side[1]) / length
        })
    };
    let mut lines = [[None; 4]; 2];
    let [across, up] = &mut lines;
    for (k, (across, up)) in across.iter_mut().zip(up).enumerate() {
        let (ik, jk) = ((i + k).checked_sub(1), (j + k).checked_sub(1));
        if let (Some(a), Some(b)) = (at(Some(i), Some(j)), at(Some(i + 1), Some(j))) {
            let level = ik.and_then(|n| table.xi_m.get(n)).copied();
            *across = along(at(ik, Some(j)), &a, &b).zip(level);
        }
        if let (Some(a), Some(b)) = (at(Some(i), Some(j)), at(Some(i), Some(j + 1))) {
            let level = jk.and_then(|n| table.eta_m.get(n)).copied();
            *up = along(at(Some(i), jk), &a, &b).zip(level);
        }
    }
    lines
}

impl Cell {
    fn new(corners: [Node; 4], lines: [[Option<(f64, f64)>; 4]; 2]) -> Option<Self> {
        let centre = [
            corners.iter().map(|n| n.column_px).sum::<f64>() / 4.0,
            corners.iter().map(|n| n.row_px).sum::<f64>() / 4.0,
        ];
        let regressor = |n: &Node| Vector3::new(1.0, n.column_px - centre[0], n.row_px - centre[1]);
        let (mut normal, mut right) = (Matrix3::zeros(), Matrix3x2::zeros());
        for n in &corners {
            let p = regressor(n);
            normal += p * p.transpose();
            right += p * Vector2::new(n.xi_m, n.eta_m).transpose();
        }
        let inverse = normal.try_inverse()?;
        let plane = inverse * right;
        let mut misfit_m = [0.0f64; 2];
        for n in &corners {
            let e = plane.transpose() * regressor(n) - Vector2::new(n.xi_m, n.eta_m);
            misfit_m[0] += e[0] * e[0] / 4.0;
            misfit_m[1] += e[1] * e[1] / 4.0;
        }
        Some(Cell {
            corners,
            lines,
            plane,
            inverse,
            misfit_m: misfit_m.map(f64::sqrt),
            centre,
        })
    }

    /// Inside the quadrilateral (its sides included).
    fn holds(&self, u: f64, v: f64) -> bool {
        let [a, b, c, d] = &self.corners;
        let ring = [a, b, d, c];
        let mut signs = [0.0; 4];
        for k in 0..4 {
            let (p, q) = (ring[k], ring[(k + 1) % 4]);
            signs[k] = (q.column_px - p.column_px) * (v - p.row_px)
                - (q.row_px - p.row_px) * (u - p.column_px);
        }
        signs.iter().all(|s| *s >= -1e-9) || signs.iter().all(|s| *s <= 1e-9)
    }

    fn blend(&self, s: f64, t: f64) -> [f64; 2] {
        let w = [(1.0 - s) * (1.0 - t), s * (1.0 - t), (1.0 - s) * t, s * t];
        let mut p = [0.0; 2];
        for (n, w) in self.corners.iter().zip(w) {
            p[0] += w * n.column_px;
            p[1] += w * n.row_px;
        }
        p
    }

    fn bilinear(&self, u: f64, v: f64) -> Option<PlanePoint> {
        let [a, b, c, d] = &self.corners;
        let (mut s, mut t) = (0.5, 0.5);
        let mut j = Matrix2::identity();
        for _ in 0..20 {
            let p = self.blend(s, t);
            let side =
                |x: &Node, y: &Node| Vector2::new(y.column_px - x.column_px, y.row_px - x.row_px);
            j = Matrix2::from_columns(&[
                side(a, b) * (1.0 - t) + side(c, d) * t,
                side(a, c) * (1.0 - s) + side(b, d) * s,
            ]);
            let step = j.try_inverse()? * Vector2::new(p[0] - u, p[1] - v);
            s -= step[0];
            t -= step[1];
            if step.norm() < 1e-13 {
                break;
            }
        }
        let size = Vector2::new(d.xi_m - a.xi_m, d.eta_m - a.eta_m);
        let w = [(1.0 - s) * (1.0 - t), s * (1.0 - t), (1.0 - s) * t, s * t];
        let seen = self
            .corners
            .iter()
            .zip(w)
            .fold(Matrix2::zeros(), |sum, (n, w)| {
                sum + n.covariance_px2 * (w * w)
            });
        let to_plane = Matrix2::from_diagonal(&size) * j.try_inverse()?;
        Some(self.with_bias(
            a.xi_m + s * size[0],
            a.eta_m + t * size[1],
            to_plane * seen * to_plane.transpose(),
            [s, t],
        ))
    }

    fn affine(&self, u: f64, v: f64) -> Option<PlanePoint> {
        let p = Vector3::new(1.0, u - self.centre[0], v - self.centre[1]);
        let at = self.plane.transpose() * p;
        let hat = self.inverse * p;
        let mut seen = Matrix2::zeros();
        for n in &self.corners {
            let w = hat[0]
                + hat[1] * (n.column_px - self.centre[0])
                + hat[2] * (n.row_px - self.centre[1]);
            seen += n.covariance_px2 * (w * w);
        }
        let m = Matrix2::new(
            self.plane[(1, 0)],
            self.plane[(2, 0)],
            self.plane[(1, 1)],
            self.plane[(2, 1)],
        );
        let [a, .., d] = &self.corners;
        let s = ((at[0] - a.xi_m) / (d.xi_m - a.xi_m)).clamp(0.0, 1.0);
        let t = ((at[1] - a.eta_m) / (d.eta_m - a.eta_m)).clamp(0.0, 1.0);
        let mut point = self.with_bias(at[0], at[1], m * seen * m.transpose(), [s, t]);
        point.covariance_m2[(0, 0)] += self.misfit_m[0].powi(2);
        point.covariance_m2[(1, 1)] += self.misfit_m[1].powi(2);
        Some(point)
    }

    fn with_bias(
        &self,
        xi_m: f64,
        eta_m: f64,
        noise: Matrix2<f64>,
        fraction: [f64; 2],
    ) -> PlanePoint {
        let mut covariance_m2 = noise;
        for k in 0..2 {
            if let (Some(low), Some(high)) = (self.lines[k][1], self.lines[k][2]) {
                let s = low.0 + fraction[k] * (high.0 - low.0);
                covariance_m2[(k, k)] += scallop(self.lines[k], s).powi(2);
            }
        }
        PlanePoint {
            xi_m,
            eta_m,
            covariance_m2,
        }
    }
}
