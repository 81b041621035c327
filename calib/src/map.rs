//! Maps from image to laser plane, fitted to the nodes of a board that stands in the sheet.
//!
//! | method | what it is |
//! |---|---|
//! | `graticule` | Wang and Cheng's reading: quadratic longitudes and latitudes, linear between neighbours |
//! | `bilinear`, `affine` | the other literal readings of "linear mappings in the regions": per cell |
//! | `rectified-graticule` | one homography first, then `graticule` |
//! | `homography` | one homography and Brown's distortion with free centre |
//! | `refractive` | a camera behind a flat port, by Snell's law |
//!
//! The literal maps carry a bias that no careful work removes: perspective makes the
//! image of equally spaced lines unequally spaced, and a linear step from one line to
//! the next ignores that. The error is zero on the grid lines, of one sign between
//! them, up to 0.9 mm in the middle of a 50 mm cell seen at 45°: a scallop with the
//! grid's period, growing with the pitch squared. Each grid map measures its own scallop
//! from the spacing of neighbouring lines and counts it into its covariance.
//!
//! Every map answers with the covariance that its own parameters have from the nodes,
//! and answers nothing outside the hull of the nodes.

pub mod geometry;
#[cfg(feature = "lab")]
pub mod grid;
pub mod homography;
pub mod lm;
pub mod refractive;
pub mod region;

#[cfg(feature = "lab")]
pub use grid::{GridKind, GridMap};
pub use homography::HomographyMap;
pub use refractive::{RefractiveMap, RefractivePrior};
pub use region::Region;

use nalgebra::{DMatrix, Matrix2, Matrix2xX};
use serde::{Deserialize, Serialize};

use crate::free::SheetMap;
use crate::plane::{ImageSize, PlanePoint};
use lm::LmError;

/// A node of a board: where it is on the sheet and where it was seen.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Node {
    /// ξ, to port \[m\].
    pub xi_m: f64,
    /// η, up \[m\].
    pub eta_m: f64,
    /// Column seen at \[px\].
    pub column_px: f64,
    /// Row seen at \[px\].
    pub row_px: f64,
    /// Covariance of (column, row) \[px²\].
    pub covariance_px2: Matrix2<f64>,
}

impl Node {
    fn is_sound(&self) -> bool {
        let c = &self.covariance_px2;
        [self.xi_m, self.eta_m, self.column_px, self.row_px]
            .iter()
            .all(|v| v.is_finite() && v.abs() < 1e6)
            && c.iter().all(|v| v.is_finite())
            && c[(0, 0)] > 0.0
            && c.determinant() > 0.0
    }
}

/// Name of a map, as `--method` takes it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Quadratic longitudes and latitudes, linear between neighbours (Wang and Cheng).
    #[cfg(feature = "lab")]
    Graticule,
    /// Inverse bilinear in each cell.
    #[cfg(feature = "lab")]
    Bilinear,
    /// Least-squares affine in each cell.
    #[cfg(feature = "lab")]
    Affine,
    /// One homography, then the graticule.
    #[cfg(feature = "lab")]
    RectifiedGraticule,
    /// Homography and Brown distortion with free centre.
    Homography,
    /// Flat port by Snell's law.
    Refractive,
    /// Camera and sheet from boards held in the hand ([`crate::free`]); not from one board's nodes.
    Free,
}

impl Method {
    /// All methods, literal ones first; those of the feature `lab` are kept to be compared with.
    pub const ALL: &[Method] = &[
        #[cfg(feature = "lab")]
        Method::Affine,
        #[cfg(feature = "lab")]
        Method::Bilinear,
        #[cfg(feature = "lab")]
        Method::Graticule,
        #[cfg(feature = "lab")]
        Method::RectifiedGraticule,
        Method::Homography,
        Method::Refractive,
    ];

    /// Name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            #[cfg(feature = "lab")]
            Method::Graticule => "graticule",
            #[cfg(feature = "lab")]
            Method::Bilinear => "bilinear",
            #[cfg(feature = "lab")]
            Method::Affine => "affine",
            #[cfg(feature = "lab")]
            Method::RectifiedGraticule => "rectified-graticule",
            Method::Homography => "homography",
            Method::Refractive => "refractive",
            Method::Free => "free",
        }
    }

    /// The method of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|m| m.name() == name)
    }
}

/// Why no map could be made of the nodes.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum MapError {
    #[error(
        "{found} nodes are too few for `{method}`, which needs {needed}; show more of the board"
    )]
    TooFewNodes {
        method: &'static str,
        found: usize,
        needed: usize,
    },
    #[error(
        "node {index} at pixel ({column_px}, {row_px}) has a coordinate or covariance that is not a sound number"
    )]
    BadNode {
        index: usize,
        column_px: f64,
        row_px: f64,
    },
    #[error(
        "the nodes lie on {columns} longitudes and {rows} latitudes with enough nodes each; a grid map needs at least 3 of both"
    )]
    NotAGrid { columns: usize, rows: usize },
    #[error("the nodes lie on one line or on top of each other; they do not span the sheet")]
    Degenerate,
    #[error(
        "`refractive` needs an approximate focal length, port and water index (rig file: camera, port); none was given"
    )]
    PriorMissing,
    #[error("`{method}` could not be fitted: {source}")]
    Fit {
        method: &'static str,
        source: LmError,
    },
    #[error(
        "`free` needs boards in many poses, not the nodes of one: `hydroline calibrate --free`"
    )]
    ManyBoards,
}

/// Options of a fit beside the nodes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FitOptions {
    /// Image size: centre of the distortion's prior. Without it the nodes' centre is taken.
    pub image: Option<ImageSize>,
    /// Approximate knowledge of camera, port and water; needed by `refractive` only.
    pub refractive: Option<RefractivePrior>,
}

/// A map fitted to nodes.
#[derive(Debug, Clone, PartialEq)]
pub enum FittedMap {
    /// A literal reading of Wang and Cheng, rectified first or not.
    #[cfg(feature = "lab")]
    Grid(GridMap),
    /// Homography and Brown distortion.
    Homography(HomographyMap),
    /// Flat port.
    Refractive(RefractiveMap),
    /// Camera and sheet from boards held in the hand.
    Free(SheetMap),
}

/// Fits the map `method` to the nodes.
///
/// # Errors
/// [`MapError`] says what the nodes lack.
pub fn fit(method: Method, nodes: &[Node], options: &FitOptions) -> Result<FittedMap, MapError> {
    check_nodes(nodes)?;
    Ok(match method {
        #[cfg(feature = "lab")]
        Method::Graticule => FittedMap::Grid(GridMap::fit(GridKind::Graticule, nodes)?),
        #[cfg(feature = "lab")]
        Method::Bilinear => FittedMap::Grid(GridMap::fit(GridKind::Bilinear, nodes)?),
        #[cfg(feature = "lab")]
        Method::Affine => FittedMap::Grid(GridMap::fit(GridKind::Affine, nodes)?),
        #[cfg(feature = "lab")]
        Method::RectifiedGraticule => {
            FittedMap::Grid(GridMap::fit(GridKind::RectifiedGraticule, nodes)?)
        }
        Method::Homography => FittedMap::Homography(HomographyMap::fit(nodes, options.image)?),
        Method::Refractive => FittedMap::Refractive(RefractiveMap::fit(
            nodes,
            &options.refractive.ok_or(MapError::PriorMissing)?,
        )?),
        Method::Free => return Err(MapError::ManyBoards),
    })
}

fn check_nodes(nodes: &[Node]) -> Result<(), MapError> {
    match nodes.iter().position(|n| !n.is_sound()) {
        Some(index) => Err(MapError::BadNode {
            index,
            column_px: nodes[index].column_px,
            row_px: nodes[index].row_px,
        }),
        None => Ok(()),
    }
}

/// The same question to whichever map it is.
macro_rules! each {
    ($fitted:expr, $map:ident => $answer:expr) => {
        match $fitted {
            #[cfg(feature = "lab")]
            FittedMap::Grid($map) => $answer,
            FittedMap::Homography($map) => $answer,
            FittedMap::Refractive($map) => $answer,
            FittedMap::Free($map) => $answer,
        }
    };
}

/// A sheet point (ξ, η) \[m\], and its motion with each parameter of a map.
pub(crate) type PointAndSlopes = ([f64; 2], Matrix2xX<f64>);

impl FittedMap {
    /// The method this map was fitted with.
    pub fn method(&self) -> Method {
        match self {
            #[cfg(feature = "lab")]
            FittedMap::Grid(map) => match map.kind() {
                GridKind::Graticule => Method::Graticule,
                GridKind::Bilinear => Method::Bilinear,
                GridKind::Affine => Method::Affine,
                GridKind::RectifiedGraticule => Method::RectifiedGraticule,
            },
            FittedMap::Homography(_) => Method::Homography,
            FittedMap::Refractive(_) => Method::Refractive,
            FittedMap::Free(_) => Method::Free,
        }
    }

    /// The sheet point seen at a pixel, with the covariance the parameters leave.
    pub fn to_plane(&self, column_px: f64, row_px: f64) -> Option<PlanePoint> {
        if !(column_px.is_finite() && row_px.is_finite()) {
            return None;
        }
        each!(self, map => map.to_plane(column_px, row_px))
    }

    /// The sheet point (ξ, η) \[m\] seen at a pixel, and its [motion with each parameter](crate::plane::PlaneMap::parameter_slopes).
    pub fn point_and_slopes(&self, column_px: f64, row_px: f64) -> Option<PointAndSlopes> {
        if !(column_px.is_finite() && row_px.is_finite()) {
            return None;
        }
        match self {
            // The paper's own methods: each cell has its own, and none is shared by all.
            #[cfg(feature = "lab")]
            FittedMap::Grid(map) => {
                let at = map.to_plane(column_px, row_px)?;
                Some(([at.xi_m, at.eta_m], Matrix2xX::zeros(0)))
            }
            FittedMap::Homography(map) => map.point_and_slopes(column_px, row_px),
            FittedMap::Refractive(map) => map.point_and_slopes(column_px, row_px),
            FittedMap::Free(map) => map.point_and_slopes(column_px, row_px),
        }
    }

    /// See [`crate::plane::PlaneMap::parameter_covariance`].
    pub fn parameter_covariance(&self) -> DMatrix<f64> {
        match self {
            #[cfg(feature = "lab")]
            FittedMap::Grid(_) => DMatrix::zeros(0, 0),
            FittedMap::Homography(map) => map.parameter_covariance().clone(),
            FittedMap::Refractive(map) => map.parameter_covariance().clone(),
            FittedMap::Free(map) => map.covariance().clone(),
        }
    }

    /// The pixel at which a sheet point is seen.
    pub fn to_image(&self, xi_m: f64, eta_m: f64) -> Option<(f64, f64)> {
        if !self.region().contains(xi_m, eta_m) {
            return None;
        }
        each!(self, map => map.to_image(xi_m, eta_m))
    }

    /// d(ξ, η)/d(column, row) \[m/px\].
    pub fn jacobian(&self, column_px: f64, row_px: f64) -> Option<Matrix2<f64>> {
        if !(column_px.is_finite() && row_px.is_finite()) {
            return None;
        }
        each!(self, map => map.jacobian(column_px, row_px))
    }

    /// Where the map holds.
    pub fn region(&self) -> &Region {
        each!(self, map => map.region())
    }
}
