//! The interface of every map from image to laser plane.

use hydroline_rigs::{Camera, Laser, Mounts};
use nalgebra::{DMatrix, Matrix2, Matrix2xX};
use serde::{Deserialize, Serialize};

use crate::Calibration;

pub mod errors;

pub use errors::MapErrors;

/// A point in the laser sheet with its uncertainty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanePoint {
    /// ξ, to port \[m\].
    pub xi_m: f64,
    /// η, up \[m\].
    pub eta_m: f64,
    /// Covariance of (ξ, η) \[m²\].
    pub covariance_m2: Matrix2<f64>,
}

/// Maps pixels to the laser sheet and back.
///
/// A map never extrapolates: outside the region where it holds (image, fan, nodes of a
/// board) it answers `None`.
pub trait PlaneMap: Send + Sync {
    /// The sheet point seen at a pixel. Its covariance is that of the map alone; see
    /// [`PlaneMap::measured`] for a pixel that is itself uncertain.
    fn to_plane(&self, column_px: f64, row_px: f64) -> Option<PlanePoint>;

    /// The pixel (column, row) \[px\] at which a sheet point \[m\] is seen.
    fn to_image(&self, xi_m: f64, eta_m: f64) -> Option<(f64, f64)>;

    /// d(ξ, η)/d(column, row) \[m/px\], rows ξ and η, columns column and row.
    fn jacobian(&self, column_px: f64, row_px: f64) -> Option<Matrix2<f64>>;

    /// Motion of the sheet point seen at a pixel with each of the map's m parameters, d(ξ, η)/d(parameter), 2 × m; `None`
    /// where the map does not hold. A map that takes its numbers as exact has no parameters.
    fn parameter_slopes(&self, column_px: f64, row_px: f64) -> Option<Matrix2xX<f64>> {
        self.to_plane(column_px, row_px)?;
        Some(Matrix2xX::zeros(0))
    }

    /// Covariance of these parameters, m × m.
    fn parameter_covariance(&self) -> DMatrix<f64> {
        DMatrix::zeros(0, 0)
    }

    /// Method, parameters and provenance, as stored in logs and files.
    fn describe(&self) -> Calibration;

    /// The sheet point seen at an uncertain pixel: covariance = map + J Σ Jᵀ, with Σ the
    /// covariance of (column, row) \[px²\].
    fn measured(
        &self,
        column_px: f64,
        row_px: f64,
        pixel_covariance_px2: &Matrix2<f64>,
    ) -> Option<PlanePoint> {
        let mut point = self.to_plane(column_px, row_px)?;
        let j = self.jacobian(column_px, row_px)?;
        point.covariance_m2 += j * pixel_covariance_px2 * j.transpose();
        Some(point)
    }
}

/// Size of an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImageSize {
    /// Width \[px\].
    pub width_px: u32,
    /// Height \[px\].
    pub height_px: u32,
}

impl ImageSize {
    /// The size of a camera's image.
    pub fn of(camera: &Camera) -> Self {
        ImageSize {
            width_px: camera.width_px,
            height_px: camera.height_px,
        }
    }

    /// Whether a pixel coordinate lies on the image: from −0.5, the outer edge of the first
    /// pixel, to size − 0.5. False for NaN.
    pub fn contains(&self, column_px: f64, row_px: f64) -> bool {
        (-0.5..=f64::from(self.width_px) - 0.5).contains(&column_px)
            && (-0.5..=f64::from(self.height_px) - 0.5).contains(&row_px)
    }
}

/// The lit part of the sheet: a fan with its apex h_centre above the plane's origin
/// (body (l_laser, 0, 0)), centred on body z.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fan {
    /// η of the apex \[m\].
    pub apex_eta_m: f64,
    /// Full angle \[rad\].
    pub angle_rad: f64,
}

impl Fan {
    /// The fan of a rig.
    pub fn of(laser: &Laser, mounts: &Mounts) -> Self {
        Fan {
            apex_eta_m: mounts.h_centre_m,
            angle_rad: laser.fan_rad,
        }
    }

    /// Whether a sheet point \[m\] is lit. False for NaN.
    pub fn contains(&self, xi_m: f64, eta_m: f64) -> bool {
        let below_m = self.apex_eta_m - eta_m;
        below_m > 0.0 && xi_m.abs() <= below_m * (0.5 * self.angle_rad).tan()
    }
}
