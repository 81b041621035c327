//! A calibration made with a board, as the map the chain uses.
//!
//! pixel → (fitted map) point of the face → (coplanarity) point of the sheet →
//! (placement) coordinates of the sheet. The covariance gathers all three.

use std::sync::OnceLock;

use nalgebra::{DMatrix, Matrix2, Matrix2x3, Matrix2xX, Matrix3, Matrix3xX, Rotation2, Vector2};
use serde::{Deserialize, Serialize};

use super::{Calibration, MapParameters, Medium, Residuals};
use crate::board::coplanarity::Coplanarity;
use crate::map::{FittedMap, Node, PointAndSlopes};
use crate::plane::{ImageSize, PlaneMap, PlanePoint};

/// So far inside of the outer line its derivatives are taken \[px\]: far beyond rounding (1e-12 px), far below any
/// change of the derivatives (a cell is tens of pixels wide).
const BORDER_PX: f64 = 1e-3;

/// Offset and two tilts of the sheet against the board's face.
const GAP: usize = 3;

/// Where the board's middle stood in the sheet, and how it was rotated.
///
/// The board says where things are on the board; where the board hangs below the laser
/// must be measured. An error here shifts everything alike and changes no length.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Placement {
    /// ξ of the board's middle \[m\].
    pub xi_m: f64,
    /// η of the board's middle \[m\].
    pub eta_m: f64,
    /// Turn of the board's ξ from the sheet's, towards η \[rad\].
    pub turn_rad: f64,
    /// The rig's mounts placed it: by the rigid motion that brings the nodes nearest to where the rig sees them, so that no error of the
    /// calibration moves all nodes alike. Default: false, a person measured it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_by_rig: bool,
}

impl Placement {
    fn to_sheet(self, p: [f64; 2]) -> [f64; 2] {
        let q = Rotation2::new(self.turn_rad) * Vector2::new(p[0], p[1]);
        [q[0] + self.xi_m, q[1] + self.eta_m]
    }

    fn to_board(self, p: [f64; 2]) -> [f64; 2] {
        let q = Rotation2::new(-self.turn_rad) * Vector2::new(p[0] - self.xi_m, p[1] - self.eta_m);
        [q[0], q[1]]
    }
}

/// Residual of the map at a node, in board coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NodeResidual {
    /// ξ of the node \[m\].
    pub xi_m: f64,
    /// η of the node \[m\].
    pub eta_m: f64,
    /// Map minus node, ξ \[m\].
    pub dxi_m: f64,
    /// Map minus node, η \[m\].
    pub deta_m: f64,
}

/// Circumstances of a calibration, stored beside its map and nodes.
#[derive(Debug, Clone, PartialEq)]
pub struct Provenance {
    /// Medium that the light went through.
    pub medium: Medium,
    /// RFC 3339, from the caller: this crate has no clock.
    pub date: Option<String>,
    /// Board's name.
    pub board: String,
    /// Where the board stood.
    pub placement: Placement,
    /// Board against sheet.
    pub coplanarity: Coplanarity,
    /// Size of the images.
    pub image: Option<ImageSize>,
    /// Requirements not yet met, in words; empty = accepted.
    pub missing: Vec<String>,
}

impl Calibration {
    /// A calibration from a map and the nodes it was fitted to.
    pub fn of_board(map: FittedMap, nodes: &[Node], provenance: Provenance) -> Self {
        let (n, sum) = nodes
            .iter()
            .fold((0.0, Vector2::zeros()), |(n, sum), node| {
                (n + 1.0, sum + Vector2::new(node.column_px, node.row_px))
            });
        let middle_px: Vector2<f64> = sum / f64::max(n, 1.0);
        let jacobian =
            |at_px| at_or_inside(at_px, middle_px, |column, row| map.jacobian(column, row));
        let residuals: Vec<NodeResidual> = nodes
            .iter()
            .filter_map(|n| {
                // Not by the pixel: where it falls outside the map's region there is no answer, and
                // the worst nodes of the border would be discarded.
                let (column_px, row_px) = map.to_image(n.xi_m, n.eta_m)?;
                let off = jacobian(Vector2::new(column_px, row_px))?
                    * Vector2::new(n.column_px - column_px, n.row_px - row_px);
                Some(NodeResidual {
                    xi_m: n.xi_m,
                    eta_m: n.eta_m,
                    dxi_m: off[0],
                    deta_m: off[1],
                })
            })
            .collect();
        let count = residuals.len().max(1) as f64;
        let rms = |f: fn(&NodeResidual) -> f64| {
            (residuals.iter().map(|r| f(r).powi(2)).sum::<f64>() / count).sqrt()
        };
        let max_m = residuals
            .iter()
            .map(|r| r.dxi_m.abs().max(r.deta_m.abs()))
            .fold(0.0, f64::max);
        Calibration {
            medium: provenance.medium,
            date: provenance.date,
            board: Some(provenance.board),
            missing: provenance.missing,
            image: provenance.image,
            residuals: Some(Residuals {
                nodes: residuals.len() as u32,
                rms_xi_m: rms(|r| r.dxi_m),
                rms_eta_m: rms(|r| r.deta_m),
                max_m,
            }),
            placement: Some(provenance.placement),
            coplanarity: Some(provenance.coplanarity),
            map: match map {
                #[cfg(feature = "lab")]
                FittedMap::Grid(m) => MapParameters::Grid(Box::new(m)),
                FittedMap::Homography(m) => MapParameters::Homography(Box::new(m)),
                FittedMap::Refractive(m) => MapParameters::Refractive(Box::new(m)),
                FittedMap::Free(m) => MapParameters::Free(Box::new(m)),
            },
            nodes: residuals,
        }
    }
}

pub(super) struct BoardMap {
    calibration: Calibration,
    map: FittedMap,
    placement: Placement,
    /// Change of the placement with each parameter, where the nodes place the board.
    replaced: OnceLock<Matrix3xX<f64>>,
}

/// The answer at a pixel, or a little nearer to the middle: on the outer line itself rounding decides whether a map has one.
fn at_or_inside<T>(
    at_px: Vector2<f64>,
    middle_px: Vector2<f64>,
    answer: impl Fn(f64, f64) -> Option<T>,
) -> Option<T> {
    answer(at_px[0], at_px[1]).or_else(|| {
        let inside = at_px + (middle_px - at_px).try_normalize(0.0)? * BORDER_PX;
        answer(inside[0], inside[1])
    })
}

/// Motion of a point with a rigid motion: shift along ξ, along η, turn.
fn rigid([xi_m, eta_m]: [f64; 2]) -> Matrix2x3<f64> {
    Matrix2x3::new(1.0, 0.0, -eta_m, 0.0, 1.0, xi_m)
}

impl BoardMap {
    pub(super) fn new(calibration: Calibration, map: FittedMap) -> Self {
        BoardMap {
            placement: calibration.placement.unwrap_or_default(),
            calibration,
            map,
            replaced: OnceLock::new(),
        }
    }

    /// The point seen at a pixel, and its motion with each parameter, in the board's coordinates.
    fn on_board(&self, column_px: f64, row_px: f64) -> Option<PointAndSlopes> {
        let (at, mut slopes) = self.map.point_and_slopes(column_px, row_px)?;
        let Some(gap) = &self.calibration.coplanarity else {
            return Some((at, slopes));
        };
        // The gap's own share of what a point moves by is some thousandths.
        let from = slopes.ncols();
        slopes = slopes.resize_horizontally(from + GAP, 0.0);
        slopes
            .fixed_columns_mut::<GAP>(from)
            .copy_from(&gap.slopes(at[0], at[1]));
        Some((gap.face_to_sheet(at[0], at[1]), slopes))
    }

    /// Change of the placement with each parameter: the nodes are brought back to where the rig sees them.
    fn replaced(&self) -> Matrix3xX<f64> {
        let count = self.parameter_covariance().nrows();
        let (mut square, mut pulled) = (Matrix3::zeros(), Matrix3xX::zeros(count));
        let nodes = self.calibration.nodes.iter();
        let pixels: Vec<Vector2<f64>> = nodes
            .filter_map(|n| Some(<[f64; 2]>::from(self.map.to_image(n.xi_m, n.eta_m)?).into()))
            .collect();
        let middle_px = pixels.iter().sum::<Vector2<f64>>() / pixels.len().max(1) as f64;
        for at_px in pixels {
            let seen = at_or_inside(at_px, middle_px, |column, row| self.on_board(column, row));
            if let Some((at, slopes)) = seen {
                square += rigid(at).transpose() * rigid(at);
                pulled += rigid(at).transpose() * slopes;
            }
        }
        match square.try_inverse() {
            Some(inverse) => -(inverse * pulled),
            None => Matrix3xX::zeros(count),
        }
    }
}

impl PlaneMap for BoardMap {
    fn to_plane(&self, column_px: f64, row_px: f64) -> Option<PlanePoint> {
        let mut point = self.map.to_plane(column_px, row_px)?;
        let mut at = [point.xi_m, point.eta_m];
        if let Some(gap) = &self.calibration.coplanarity {
            point.covariance_m2 += gap.covariance_m2(at[0], at[1]);
            at = gap.face_to_sheet(at[0], at[1]);
        }
        let turn = Rotation2::new(self.placement.turn_rad);
        let [xi_m, eta_m] = self.placement.to_sheet(at);
        Some(PlanePoint {
            xi_m,
            eta_m,
            covariance_m2: turn.matrix() * point.covariance_m2 * turn.matrix().transpose(),
        })
    }

    fn parameter_slopes(&self, column_px: f64, row_px: f64) -> Option<Matrix2xX<f64>> {
        let (at, mut slopes) = self.on_board(column_px, row_px)?;
        if self.placement.is_by_rig {
            slopes += rigid(at) * self.replaced.get_or_init(|| self.replaced());
        }
        Some(Rotation2::new(self.placement.turn_rad).matrix() * slopes)
    }

    fn parameter_covariance(&self) -> DMatrix<f64> {
        let of_map = self.map.parameter_covariance();
        let Some(gap) = &self.calibration.coplanarity else {
            return of_map;
        };
        let from = of_map.nrows();
        let mut all = of_map.resize(from + GAP, from + GAP, 0.0);
        all.fixed_view_mut::<GAP, GAP>(from, from)
            .copy_from(&gap.covariance());
        all
    }

    fn to_image(&self, xi_m: f64, eta_m: f64) -> Option<(f64, f64)> {
        let mut at = self.placement.to_board([xi_m, eta_m]);
        if let Some(gap) = &self.calibration.coplanarity {
            at = gap.sheet_to_face(at[0], at[1]);
        }
        self.map.to_image(at[0], at[1])
    }

    fn jacobian(&self, column_px: f64, row_px: f64) -> Option<Matrix2<f64>> {
        let inner = self.map.jacobian(column_px, row_px)?;
        let at = self.map.to_plane(column_px, row_px)?;
        let mut outer = Matrix2::identity();
        if let Some(gap) = &self.calibration.coplanarity {
            let h = 1e-4;
            let to = |x: f64, y: f64| gap.face_to_sheet(at.xi_m + x, at.eta_m + y);
            let (e, w, n, s) = (to(h, 0.0), to(-h, 0.0), to(0.0, h), to(0.0, -h));
            outer = Matrix2::new(e[0] - w[0], n[0] - s[0], e[1] - w[1], n[1] - s[1]) / (2.0 * h);
        }
        Some(Rotation2::new(self.placement.turn_rad).matrix() * outer * inner)
    }

    fn describe(&self) -> Calibration {
        self.calibration.clone()
    }
}

/// A map that has no answers.
pub(super) struct NoMap(pub(super) Calibration);

impl PlaneMap for NoMap {
    fn to_plane(&self, _: f64, _: f64) -> Option<PlanePoint> {
        None
    }
    fn to_image(&self, _: f64, _: f64) -> Option<(f64, f64)> {
        None
    }
    fn jacobian(&self, _: f64, _: f64) -> Option<Matrix2<f64>> {
        None
    }
    fn describe(&self) -> Calibration {
        self.0.clone()
    }
}
