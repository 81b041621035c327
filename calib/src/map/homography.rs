//! One homography, Brown's lens distortion with a free centre, and a flat port's share.
//!
//! Everything measured lies on the sheet, so a map from plane to plane needs no single
//! viewpoint: a flat port's refraction is absorbed by the distortion terms and one more
//! ([`lens`]) to 0.01 mm (the lab compares all maps). How many of them are used is decided by the
//! nodes themselves ([`fitting`]).

mod fitting;
mod lens;

use nalgebra::{DMatrix, Matrix2, Matrix2xX, SMatrix};
use serde::{Deserialize, Serialize};

use super::geometry::{homography, rows, whitener};
use super::{MapError, Node, PointAndSlopes, Region};
use crate::plane::{ImageSize, PlanePoint};
use fitting::Pair;
use lens::PARAMETERS;

/// Refraction of a flat port that the model leaves, standard deviation \[px\]: 0.002 px rms on exact
/// nodes of the study's rig, more behind a tilted port. It does not average out
/// over nodes, so it is added to the parameters' covariance.
const MODEL_SD_PX: f64 = 0.005;

/// Fewest nodes: twice the parameters, so that residuals mean something.
const FEWEST: usize = 16;

/// Motion of a sheet point with each parameter \[m\].
type Moved = SMatrix<f64, 2, PARAMETERS>;

/// Homography and Brown distortion, with the covariance of their parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HomographyMap {
    plane_centre_m: [f64; 2],
    plane_scale_m: f64,
    image_centre_px: [f64; 2],
    image_scale_px: f64,
    parameters: [f64; PARAMETERS],
    /// √(χ²/dof) of the fit, at least 1: the covariance is scaled with its square, so
    /// that a model which does not fit says so.
    pub noise_scale: f64,
    region: Region,
    #[serde(with = "rows")]
    covariance: DMatrix<f64>,
}

impl HomographyMap {
    /// Fits homography and distortion to the nodes; outliers weigh less (Huber, 5 σ: what is
    /// left of a port's refraction at the corners is no outlier).
    ///
    /// # Errors
    /// [`MapError::TooFewNodes`], [`MapError::Degenerate`] or [`MapError::Fit`].
    pub fn fit(nodes: &[Node], image: Option<ImageSize>) -> Result<Self, MapError> {
        if nodes.len() < FEWEST {
            return Err(MapError::TooFewNodes {
                method: "homography",
                found: nodes.len(),
                needed: FEWEST,
            });
        }
        let (plane_centre_m, plane_scale_m) = spread(nodes.iter().map(|n| [n.xi_m, n.eta_m]));
        let (node_centre, image_scale_px) = spread(nodes.iter().map(|n| [n.column_px, n.row_px]));
        if !(plane_scale_m > 1e-9 && image_scale_px > 1e-9) {
            return Err(MapError::Degenerate);
        }
        // A lens is centred on its image, not on what it happens to see.
        let image_centre_px = image.map_or(node_centre, |i| {
            [
                0.5 * (f64::from(i.width_px) - 1.0),
                0.5 * (f64::from(i.height_px) - 1.0),
            ]
        });
        let mut map = HomographyMap {
            plane_centre_m,
            plane_scale_m,
            image_centre_px,
            image_scale_px,
            parameters: [0.0; PARAMETERS],
            noise_scale: 1.0,
            region: Region::hull(nodes.iter().map(|n| [n.xi_m, n.eta_m])),
            covariance: DMatrix::zeros(PARAMETERS, PARAMETERS),
        };
        let pairs: Vec<_> = nodes
            .iter()
            .map(|n| {
                (
                    map.scaled_plane(n.xi_m, n.eta_m),
                    map.scaled_image(n.column_px, n.row_px),
                )
            })
            .collect();
        let h = homography(&pairs).ok_or(MapError::Degenerate)?;
        if h[(2, 2)].abs() < 1e-9 {
            return Err(MapError::Degenerate);
        }
        for k in 0..8 {
            map.parameters[k] = h[(k / 3, k % 3)] / h[(2, 2)];
        }
        let mut pairs: Vec<Pair> = nodes
            .iter()
            .zip(&pairs)
            .map(|(n, (plane, image))| Pair {
                plane: *plane,
                image: (*image).into(),
                whitener: whitener(&n.covariance_px2) * image_scale_px,
            })
            .collect();
        let fitted = fitting::fit(map.parameters, &mut pairs).map_err(|source| MapError::Fit {
            method: "homography",
            source,
        })?;
        map.parameters = fitted.parameters;
        map.noise_scale = fitted.noise_scale;
        map.covariance = DMatrix::from_fn(PARAMETERS, PARAMETERS, |i, k| fitted.covariance[(i, k)]);
        Ok(map)
    }

    fn scaled_plane(&self, xi_m: f64, eta_m: f64) -> [f64; 2] {
        [
            (xi_m - self.plane_centre_m[0]) / self.plane_scale_m,
            (eta_m - self.plane_centre_m[1]) / self.plane_scale_m,
        ]
    }

    fn scaled_image(&self, column_px: f64, row_px: f64) -> [f64; 2] {
        [
            (column_px - self.image_centre_px[0]) / self.image_scale_px,
            (row_px - self.image_centre_px[1]) / self.image_scale_px,
        ]
    }

    /// The pixel of a sheet point, whether or not it lies in the region: for predicting
    /// where a node of the same board must be.
    pub fn project_anywhere(&self, xi_m: f64, eta_m: f64) -> Option<(f64, f64)> {
        let p = lens::project(&self.parameters, self.scaled_plane(xi_m, eta_m))?;
        Some((
            self.image_centre_px[0] + self.image_scale_px * p[0],
            self.image_centre_px[1] + self.image_scale_px * p[1],
        ))
    }

    /// The sheet point at a pixel, in the region or not.
    fn invert(&self, column_px: f64, row_px: f64) -> Option<[f64; 2]> {
        let q = lens::unproject(&self.parameters, self.scaled_image(column_px, row_px))?;
        let point = [
            self.plane_centre_m[0] + self.plane_scale_m * q[0],
            self.plane_centre_m[1] + self.plane_scale_m * q[1],
        ];
        // Far from the nodes the distortion may fold back: then this is another pixel's point.
        let back = self.project_anywhere(point[0], point[1])?;
        ((back.0 - column_px).hypot(back.1 - row_px) < 1e-6).then_some(point)
    }

    /// See [`super::FittedMap::to_plane`].
    pub fn to_plane(&self, column_px: f64, row_px: f64) -> Option<PlanePoint> {
        let [xi_m, eta_m] = self.invert(column_px, row_px)?;
        if !self.region.contains(xi_m, eta_m) {
            return None;
        }
        let (inverse, g) = self.moved(xi_m, eta_m)?;
        let mut covariance = Matrix2::zeros();
        for i in 0..PARAMETERS {
            for k in 0..PARAMETERS {
                let c = self.covariance[(i, k)];
                covariance += g.column(i) * g.column(k).transpose() * c;
            }
        }
        let model = inverse * inverse.transpose() * (MODEL_SD_PX / self.image_scale_px).powi(2);
        Some(PlanePoint {
            xi_m,
            eta_m,
            covariance_m2: covariance + model,
        })
    }

    /// d(ξ, η)/d(scaled pixel), and how the point seen at a pixel moves with the parameters.
    fn moved(&self, xi_m: f64, eta_m: f64) -> Option<(Matrix2<f64>, Moved)> {
        let seen = lens::see(&self.parameters, self.scaled_plane(xi_m, eta_m))?;
        let inverse = seen.by_point.try_inverse()? * self.plane_scale_m;
        // The pixel is given, the parameters move: dX = -J⁻¹ (∂p/∂θ) dθ.
        Some((inverse, -(inverse * seen.by_parameters)))
    }

    /// See [`super::FittedMap::point_and_slopes`].
    pub fn point_and_slopes(&self, column_px: f64, row_px: f64) -> Option<PointAndSlopes> {
        let [xi_m, eta_m] = self.invert(column_px, row_px)?;
        self.region.contains(xi_m, eta_m).then_some(())?;
        let (_, by) = self.moved(xi_m, eta_m)?;
        let slopes = Matrix2xX::from_fn(PARAMETERS, |i, k| by[(i, k)]);
        Some(([xi_m, eta_m], slopes))
    }

    /// See [`crate::plane::PlaneMap::parameter_covariance`].
    pub fn parameter_covariance(&self) -> &DMatrix<f64> {
        &self.covariance
    }

    /// See [`super::FittedMap::to_image`].
    pub fn to_image(&self, xi_m: f64, eta_m: f64) -> Option<(f64, f64)> {
        self.project_anywhere(xi_m, eta_m)
    }

    /// See [`super::FittedMap::jacobian`].
    pub fn jacobian(&self, column_px: f64, row_px: f64) -> Option<Matrix2<f64>> {
        let [xi_m, eta_m] = self.invert(column_px, row_px)?;
        self.region.contains(xi_m, eta_m).then_some(())?;
        let seen = lens::see(&self.parameters, self.scaled_plane(xi_m, eta_m))?;
        Some(seen.by_point.try_inverse()? * (self.plane_scale_m / self.image_scale_px))
    }

    /// Where the map holds.
    pub fn region(&self) -> &Region {
        &self.region
    }

    /// Numbers that a fit can have; for files.
    pub(crate) fn is_sound(&self) -> bool {
        self.covariance.nrows() == PARAMETERS
            && self.parameters.iter().all(|v| v.is_finite())
            && [self.plane_scale_m, self.image_scale_px, self.noise_scale]
                .iter()
                .all(|v| v.is_finite() && *v > 0.0)
            && self
                .plane_centre_m
                .iter()
                .chain(&self.image_centre_px)
                .all(|v| v.is_finite())
    }
}

/// Centre and half the larger extent.
fn spread(points: impl Iterator<Item = [f64; 2]>) -> ([f64; 2], f64) {
    let mut low = [f64::INFINITY; 2];
    let mut high = [f64::NEG_INFINITY; 2];
    for p in points {
        for k in 0..2 {
            low[k] = low[k].min(p[k]);
            high[k] = high[k].max(p[k]);
        }
    }
    (
        [0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])],
        0.5 * (high[0] - low[0]).max(high[1] - low[1]),
    )
}

/// New Huber weights (as factors on the residual, √w) from residuals that carry the old
/// ones; true when any changed noticeably. The scale is the median of the residuals'
/// lengths (Rayleigh: 1.1774 σ), never below one standard deviation.
pub(super) fn reweight(weighted: &[f64], weights: &mut [f64]) -> bool {
    const HUBER: f64 = 5.0;
    let lengths: Vec<f64> = weights
        .iter()
        .enumerate()
        .map(|(i, w)| weighted[2 * i].hypot(weighted[2 * i + 1]) / w)
        .collect();
    let mut sorted = lengths.clone();
    sorted.sort_by(f64::total_cmp);
    let scale = (sorted[sorted.len() / 2] / 1.1774).max(1.0);
    let mut changed = false;
    for (w, length) in weights.iter_mut().zip(lengths) {
        let new = (HUBER * scale / length.max(1e-12)).sqrt().min(1.0);
        changed |= (new - *w).abs() > 0.02;
        *w = new;
    }
    changed
}
