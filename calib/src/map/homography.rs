//! One homography and Brown's lens distortion with a free centre.
//!
//! Everything measured lies on the sheet, so a map from plane to plane needs no single
//! viewpoint: the bend of a flat port is absorbed by the distortion terms to ≤ 0.05 mm
//! (see [`crate::study`]). Parameters live in coordinates scaled to about ±1:
//!
//! X = (ξ − ξ₀)/S, Y = (η − η₀)/S, (u, v) = H (X, Y), h₃₃ = 1,
//! d = (u − c_x, v − c_y), r² = |d|²,
//! x = c + d (1 + k₁r² + k₂r⁴ + k₃r⁶) + (2p₁d_x d_y + p₂(r² + 2d_x²), p₁(r² + 2d_y²) + 2p₂d_x d_y)
//! (Brown 1971), pixel = image centre + s·x.
//! In place of p₁, p₂ stand p₁ + q₁r², p₂ + q₂r² (Brown's P₃): behind a flat port the bend
//! depends on the distance, which on a slanted sheet is a decentring that grows outwards.
//! Without q the largest error on exact nodes is 0.055 mm, with it 0.042 mm.

use nalgebra::{DMatrix, Matrix2, Matrix3, Vector2};
use serde::{Deserialize, Serialize};

use super::geometry::{apply, homography, rows, whitener};
use super::lm::minimise;
use super::{MapError, Node, Region};
use crate::plane::{ImageSize, PlanePoint};

/// h₁₁ h₁₂ h₁₃ h₂₁ h₂₂ h₂₃ h₃₁ h₃₂, k₁ k₂ k₃ p₁ p₂ c_x c_y q₁ q₂.
const PARAMETERS: usize = 17;

/// Standard deviations of the priors on k₁ k₂ k₃ p₁ p₂ c_x c_y q₁ q₂ (scaled units). A plane
/// seen once cannot tell a decentred lens from a shifted centre; priors decide.
/// With a board that fills half the field they allow k₁ = 1, k₂ = 0.7, k₃ = 0.3, p = 0.01 in
/// units of the focal length, far beyond real lenses; wider ones only let noise bend the
/// corners. The one on q is tight on purpose: nodes
/// good to 0.2 px must not spend two more parameters on a bend of some 0.1 px.
const PRIOR_SD: [f64; 9] = [0.3, 0.05, 0.005, 0.005, 0.005, 0.3, 0.3, 2e-4, 2e-4];

/// What Brown's terms leave of a flat port's bend, standard deviation \[px\]: 0.010 mm rms on
/// exact nodes of the study's rig at 0.8 px/mm ([`crate::study`]). It does not average out
/// over nodes, so it stands beside the parameters' covariance.
const MODEL_SD_PX: f64 = 0.01;

/// Fewest nodes: twice the parameters, so that residuals mean something.
const FEWEST: usize = 16;

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
    /// left of a port's bend at the corners is no outlier).
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

        let whiteners: Vec<Matrix2<f64>> =
            nodes.iter().map(|n| whitener(&n.covariance_px2)).collect();
        let mut weights = vec![1.0; nodes.len()];
        let count = 2 * nodes.len();
        let mut start = map.parameters;
        let mut fitted = None;
        for _round in 0..4 {
            let fit = minimise(
                &start,
                &[1e-5; PARAMETERS],
                count + PRIOR_SD.len(),
                |x, out| {
                    for (i, node) in nodes.iter().enumerate() {
                        let Some(p) = map.project(x, node.xi_m, node.eta_m) else {
                            return false;
                        };
                        let e =
                            whiteners[i] * Vector2::new(p[0] - node.column_px, p[1] - node.row_px);
                        out[2 * i] = weights[i] * e[0];
                        out[2 * i + 1] = weights[i] * e[1];
                    }
                    for (k, sd) in PRIOR_SD.iter().enumerate() {
                        out[count + k] = x[8 + k] / sd;
                    }
                    true
                },
            )
            .map_err(|source| MapError::Fit {
                method: "homography",
                source,
            })?;
            start.copy_from_slice(fit.parameters.as_slice());
            let changed = reweight(&fit.residuals.as_slice()[..count], &mut weights);
            fitted = Some(fit);
            if !changed {
                break;
            }
        }
        if let Some(fit) = fitted {
            let free = (count - PARAMETERS) as f64;
            let chi2 = fit.residuals.as_slice()[..count]
                .iter()
                .map(|r| r * r)
                .sum::<f64>();
            map.noise_scale = (chi2 / free).sqrt().max(1.0);
            map.covariance = fit.covariance * map.noise_scale.powi(2);
            map.parameters = start;
        }
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

    /// Pixel of a sheet point with the parameters `x`, without the limits of the region.
    #[inline]
    fn project(&self, x: &[f64], xi_m: f64, eta_m: f64) -> Option<[f64; 2]> {
        let [a, b] = self.scaled_plane(xi_m, eta_m);
        let w = x[6] * a + x[7] * b + 1.0;
        if w < 1e-6 {
            return None;
        }
        let u = [
            (x[0] * a + x[1] * b + x[2]) / w,
            (x[3] * a + x[4] * b + x[5]) / w,
        ];
        let p = distort(&x[8..], u);
        Some([
            self.image_centre_px[0] + self.image_scale_px * p[0],
            self.image_centre_px[1] + self.image_scale_px * p[1],
        ])
    }

    /// The pixel of a sheet point, whether or not it lies in the region: for predicting
    /// where a node of the same board must be.
    pub fn project_anywhere(&self, xi_m: f64, eta_m: f64) -> Option<(f64, f64)> {
        self.project(&self.parameters, xi_m, eta_m)
            .map(|p| (p[0], p[1]))
    }

    /// d(column, row)/d(ξ, η) \[px/m\] at a sheet point.
    fn forward_jacobian(&self, xi_m: f64, eta_m: f64) -> Option<Matrix2<f64>> {
        let h = 1e-6 * self.plane_scale_m;
        let at = |a, b| self.project(&self.parameters, a, b);
        let (e, w) = (at(xi_m + h, eta_m)?, at(xi_m - h, eta_m)?);
        let (n, s) = (at(xi_m, eta_m + h)?, at(xi_m, eta_m - h)?);
        Some(Matrix2::new(e[0] - w[0], n[0] - s[0], e[1] - w[1], n[1] - s[1]) / (2.0 * h))
    }

    fn invert(&self, column_px: f64, row_px: f64) -> Option<[f64; 2]> {
        let x = &self.parameters;
        let target = self.scaled_image(column_px, row_px);
        // Newton on the distortion alone: close to the identity, so from the pixel itself.
        let mut u = target;
        for _ in 0..12 {
            let p = distort(&x[8..], u);
            let e = Vector2::new(p[0] - target[0], p[1] - target[1]);
            if e.norm() < 1e-13 {
                break;
            }
            let h = 1e-6;
            let (r, l) = (
                distort(&x[8..], [u[0] + h, u[1]]),
                distort(&x[8..], [u[0] - h, u[1]]),
            );
            let (d, t) = (
                distort(&x[8..], [u[0], u[1] + h]),
                distort(&x[8..], [u[0], u[1] - h]),
            );
            let j = Matrix2::new(r[0] - l[0], d[0] - t[0], r[1] - l[1], d[1] - t[1]) / (2.0 * h);
            let step = j.try_inverse()? * e;
            u = [u[0] - step[0], u[1] - step[1]];
        }
        let h = Matrix3::new(x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7], 1.0);
        // The inverse of a homography is one only up to its sign.
        let inverse = h.try_inverse()?;
        let q = apply(&inverse, u).or_else(|| apply(&-inverse, u))?;
        let point = [
            self.plane_centre_m[0] + self.plane_scale_m * q[0],
            self.plane_centre_m[1] + self.plane_scale_m * q[1],
        ];
        // Far from the nodes the distortion may fold back: then this is another pixel's point.
        let back = self.project(x, point[0], point[1])?;
        ((back[0] - column_px).hypot(back[1] - row_px) < 1e-6).then_some(point)
    }

    /// See [`super::FittedMap::to_plane`].
    pub fn to_plane(&self, column_px: f64, row_px: f64) -> Option<PlanePoint> {
        let [xi_m, eta_m] = self.invert(column_px, row_px)?;
        if !self.region.contains(xi_m, eta_m) {
            return None;
        }
        let inverse = self.forward_jacobian(xi_m, eta_m)?.try_inverse()?;
        let mut sensitivity = nalgebra::SMatrix::<f64, 2, PARAMETERS>::zeros();
        let mut x = self.parameters;
        for k in 0..PARAMETERS {
            let h = 1e-6;
            x[k] = self.parameters[k] + h;
            let up = self.project(&x, xi_m, eta_m)?;
            x[k] = self.parameters[k] - h;
            let down = self.project(&x, xi_m, eta_m)?;
            x[k] = self.parameters[k];
            sensitivity[(0, k)] = (up[0] - down[0]) / (2.0 * h);
            sensitivity[(1, k)] = (up[1] - down[1]) / (2.0 * h);
        }
        // The pixel is given, the parameters move: dX = -J⁻¹ (∂p/∂θ) dθ.
        let g = inverse * sensitivity;
        let product = DMatrix::from_fn(2, PARAMETERS, |i, k| g[(i, k)]);
        let covariance = &product * &self.covariance * product.transpose();
        let model = inverse * inverse.transpose() * MODEL_SD_PX.powi(2);
        Some(PlanePoint {
            xi_m,
            eta_m,
            covariance_m2: Matrix2::from_fn(|i, k| covariance[(i, k)]) + model,
        })
    }

    /// See [`super::FittedMap::to_image`].
    pub fn to_image(&self, xi_m: f64, eta_m: f64) -> Option<(f64, f64)> {
        self.project_anywhere(xi_m, eta_m)
    }

    /// See [`super::FittedMap::jacobian`].
    pub fn jacobian(&self, column_px: f64, row_px: f64) -> Option<Matrix2<f64>> {
        let [xi_m, eta_m] = self.invert(column_px, row_px)?;
        self.region.contains(xi_m, eta_m).then_some(())?;
        self.forward_jacobian(xi_m, eta_m)?.try_inverse()
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

/// Brown's distortion; `q` = k₁ k₂ k₃ p₁ p₂ c_x c_y q₁ q₂.
#[inline]
fn distort(q: &[f64], u: [f64; 2]) -> [f64; 2] {
    let (dx, dy) = (u[0] - q[5], u[1] - q[6]);
    let r2 = dx * dx + dy * dy;
    let radial = 1.0 + r2 * (q[0] + r2 * (q[1] + r2 * q[2]));
    let (p1, p2) = (q[3] + q[7] * r2, q[4] + q[8] * r2);
    [
        q[5] + dx * radial + 2.0 * p1 * dx * dy + p2 * (r2 + 2.0 * dx * dx),
        q[6] + dy * radial + p1 * (r2 + 2.0 * dy * dy) + 2.0 * p2 * dx * dy,
    ]
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
