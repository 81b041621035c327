//! The literal readings of Wang and Cheng (2007): maps made of grid lines and cells.

mod cells;
mod lines;

use nalgebra::{Matrix2, Matrix3};
use serde::{Deserialize, Serialize};

use super::geometry::{apply, homography, homography_jacobian};
use super::{MapError, Node, Region, check_nodes};
use crate::plane::PlanePoint;
use cells::Cells;
use lines::Lines;

/// Reading of the method.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum GridKind {
    /// Quadratic longitudes and latitudes, linear between neighbours.
    Graticule,
    /// Inverse bilinear per cell.
    Bilinear,
    /// Least-squares affine per cell.
    Affine,
    /// One homography first, then the graticule in what it straightened.
    RectifiedGraticule,
}

impl GridKind {
    /// Name of the method.
    pub fn name(self) -> &'static str {
        match self {
            GridKind::Graticule => "graticule",
            GridKind::Bilinear => "bilinear",
            GridKind::Affine => "affine",
            GridKind::RectifiedGraticule => "rectified-graticule",
        }
    }
}

/// A grid map: its nodes, and what was made of them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "GridParameters", into = "GridParameters")]
pub struct GridMap {
    parameters: GridParameters,
    region: Region,
    /// Image to the rectified plane; identity for the literal readings.
    rectify: Matrix3<f64>,
    unrectify: Matrix3<f64>,
    /// Along ξ the image runs down rather than across: column and row change places.
    transposed: bool,
    body: Body,
}

#[derive(Debug, Clone, PartialEq)]
enum Body {
    Lines(Lines),
    Cells(Cells),
}

/// A grid map in a file: its nodes determine everything.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct GridParameters {
    kind: GridKind,
    nodes: Vec<Node>,
}

impl TryFrom<GridParameters> for GridMap {
    type Error = MapError;
    fn try_from(p: GridParameters) -> Result<Self, MapError> {
        check_nodes(&p.nodes)?;
        GridMap::fit(p.kind, &p.nodes)
    }
}

impl From<GridMap> for GridParameters {
    fn from(map: GridMap) -> Self {
        map.parameters
    }
}

/// Nodes by line: `at[row][column]`, rows by η, columns by ξ.
pub(super) struct Table {
    xi_m: Vec<f64>,
    eta_m: Vec<f64>,
    at: Vec<Vec<Option<Node>>>,
}

impl Table {
    fn new(nodes: &[Node]) -> Self {
        let (xi_m, eta_m) = (
            levels(nodes.iter().map(|n| n.xi_m)),
            levels(nodes.iter().map(|n| n.eta_m)),
        );
        let mut at = vec![vec![None; xi_m.len()]; eta_m.len()];
        for node in nodes {
            let (i, j) = (nearest(&xi_m, node.xi_m), nearest(&eta_m, node.eta_m));
            at[j][i] = Some(*node);
        }
        Table { xi_m, eta_m, at }
    }
}

/// Distinct values, ascending; closer than 0.1 mm is the same line.
fn levels(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_by(f64::total_cmp);
    sorted.dedup_by(|b, a| *b - *a < 1e-4);
    sorted
}

fn nearest(levels: &[f64], value: f64) -> usize {
    let after = levels.partition_point(|&l| l < value);
    match (after.checked_sub(1), levels.get(after)) {
        (Some(before), Some(&next)) if value - levels[before] < next - value => before,
        (Some(before), None) => before,
        _ => after,
    }
}

impl GridMap {
    /// Makes the map of the nodes.
    ///
    /// # Errors
    /// [`MapError::NotAGrid`] or [`MapError::Degenerate`].
    pub fn fit(kind: GridKind, nodes: &[Node]) -> Result<Self, MapError> {
        let pairs: Vec<_> = nodes
            .iter()
            .map(|n| ([n.column_px, n.row_px], [n.xi_m, n.eta_m]))
            .collect();
        let to_plane = homography(&pairs).ok_or(MapError::Degenerate)?;
        let rectify = match kind {
            GridKind::RectifiedGraticule => to_plane,
            _ => Matrix3::identity(),
        };
        let unrectify = rectify.try_inverse().ok_or(MapError::Degenerate)?;
        // Rectified coordinates are those of the plane: never transposed.
        let middle = pairs[pairs.len() / 2].0;
        let j = homography_jacobian(&to_plane, middle).ok_or(MapError::Degenerate)?;
        let transposed = kind != GridKind::RectifiedGraticule && j[(0, 0)].abs() < j[(0, 1)].abs();
        let seen: Option<Vec<Node>> = nodes
            .iter()
            .map(|n| {
                let p = [n.column_px, n.row_px];
                let q = apply(&rectify, p)?;
                let j = homography_jacobian(&rectify, p)?;
                let c = j * n.covariance_px2 * j.transpose();
                let mut seen = *n;
                (seen.column_px, seen.row_px, seen.covariance_px2) = if transposed {
                    (
                        q[1],
                        q[0],
                        Matrix2::new(c[(1, 1)], c[(0, 1)], c[(0, 1)], c[(0, 0)]),
                    )
                } else {
                    (q[0], q[1], c)
                };
                Some(seen)
            })
            .collect();
        let table = Table::new(&seen.ok_or(MapError::Degenerate)?);
        let body = match kind {
            GridKind::Graticule | GridKind::RectifiedGraticule => {
                Body::Lines(Lines::new(&table, kind == GridKind::RectifiedGraticule)?)
            }
            GridKind::Bilinear => Body::Cells(Cells::new(table, false)?),
            GridKind::Affine => Body::Cells(Cells::new(table, true)?),
        };
        Ok(GridMap {
            region: Region::hull(nodes.iter().map(|n| [n.xi_m, n.eta_m])),
            parameters: GridParameters {
                kind,
                nodes: nodes.to_vec(),
            },
            rectify,
            unrectify,
            transposed,
            body,
        })
    }

    /// Reading of the method that this map is.
    pub fn kind(&self) -> GridKind {
        self.parameters.kind
    }

    /// The nodes it was made of.
    pub fn nodes(&self) -> &[Node] {
        &self.parameters.nodes
    }

    fn inner(&self, column_px: f64, row_px: f64) -> Option<[f64; 2]> {
        let q = apply(&self.rectify, [column_px, row_px])?;
        Some(if self.transposed { [q[1], q[0]] } else { q })
    }

    /// See [`super::FittedMap::to_plane`].
    pub fn to_plane(&self, column_px: f64, row_px: f64) -> Option<PlanePoint> {
        let [u, v] = self.inner(column_px, row_px)?;
        let point = match &self.body {
            Body::Lines(lines) => lines.to_plane(u, v),
            Body::Cells(cells) => cells.to_plane(u, v),
        }?;
        self.region
            .contains(point.xi_m, point.eta_m)
            .then_some(point)
    }

    /// See [`super::FittedMap::to_image`].
    pub fn to_image(&self, xi_m: f64, eta_m: f64) -> Option<(f64, f64)> {
        let [u, v] = match &self.body {
            Body::Lines(lines) => lines.to_image(xi_m, eta_m),
            Body::Cells(cells) => cells.to_image(xi_m, eta_m),
        }?;
        let p = if self.transposed { [v, u] } else { [u, v] };
        // Like every inverse homography, up to its sign.
        let q = apply(&self.unrectify, p).or_else(|| apply(&-self.unrectify, p))?;
        Some((q[0], q[1]))
    }

    /// See [`super::FittedMap::jacobian`]. One-sided at the border of the region.
    pub fn jacobian(&self, column_px: f64, row_px: f64) -> Option<Matrix2<f64>> {
        let at = self.to_plane(column_px, row_px)?;
        let h = 1e-4;
        let mut j = Matrix2::zeros();
        for (k, (dc, dr)) in [(h, 0.0), (0.0, h)].into_iter().enumerate() {
            let plus = self.to_plane(column_px + dc, row_px + dr);
            let minus = self.to_plane(column_px - dc, row_px - dr);
            let (a, b, run) = match (plus, minus) {
                (Some(a), Some(b)) => (a, b, 2.0 * h),
                (Some(a), None) => (a, at, h),
                (None, Some(b)) => (at, b, h),
                (None, None) => return None,
            };
            j[(0, k)] = (a.xi_m - b.xi_m) / run;
            j[(1, k)] = (a.eta_m - b.eta_m) / run;
        }
        Some(j)
    }

    /// Where the map holds.
    pub fn region(&self) -> &Region {
        &self.region
    }
}

/// Error of a linear step between two lines, from the neighbours on both sides: the
/// second divided difference times (s − s₁)(s − s₂), what a quadratic would have added.
/// `s` and `value` at four consecutive lines, the step between the middle two.
pub(super) fn scallop(lines: [Option<(f64, f64)>; 4], s: f64) -> f64 {
    let (Some(b), Some(c)) = (lines[1], lines[2]) else {
        return 0.0;
    };
    let second = |x: (f64, f64), y: (f64, f64), z: (f64, f64)| {
        ((z.1 - y.1) / (z.0 - y.0) - (y.1 - x.1) / (y.0 - x.0)) / (z.0 - x.0)
    };
    let terms: Vec<f64> = [
        lines[0].map(|a| second(a, b, c)),
        lines[3].map(|d| second(b, c, d)),
    ]
    .into_iter()
    .flatten()
    .filter(|v| v.is_finite())
    .collect();
    if terms.is_empty() {
        return 0.0;
    }
    terms.iter().sum::<f64>() / terms.len() as f64 * (s - b.0) * (s - c.0)
}
