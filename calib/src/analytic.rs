//! The paper's Eqs. 11 and 12: image to laser plane for an ideal camera.

use hydroline_rigs::{Camera, Laser, Mounts, Rig};
use nalgebra::Matrix2;

use crate::calibration::{Calibration, IdealParameters, MapParameters, Medium};
use crate::plane::{Fan, ImageSize, PlaneMap, PlanePoint};

/// Eqs. 11–12: a pinhole without lens errors or water, an upright sheet.
///
/// With h = 1, x̃ = −(column − cx)/fx (left, to port) and ỹ = −(row − cy)/fy (up):
///
/// η = η_c + ζ_c (cos α − ỹ sin α) / (sin α + ỹ cos α)                         (11)
/// ξ = x̃ √(ζ_c² + (η_c − η)²) / √((sin α + ỹ cos α)² + (cos α − ỹ sin α)²)    (12)
///
/// where (η_c, ζ_c) = (h_centre − h_camera, −(l_laser + l_camera)) is the camera. Its own
/// covariance is zero: it is exact by definition, and its errors are those of the rig.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IdealMap {
    parameters: IdealParameters,
    sin_a: f64,
    cos_a: f64,
    medium: Medium,
}

impl IdealMap {
    /// The ideal map of a rig's camera and mounts.
    pub fn new(camera: &Camera, mounts: &Mounts, laser: &Laser) -> Self {
        Self::from_parameters(
            IdealParameters {
                image: ImageSize::of(camera),
                fan: Fan::of(laser, mounts),
                fx_px: camera.fx_px,
                fy_px: camera.fy_px,
                cx_px: camera.cx_px,
                cy_px: camera.cy_px,
                eta_c_m: mounts.h_centre_m - mounts.h_camera_m,
                zeta_c_m: -(mounts.l_laser_m + mounts.l_camera_m),
                camera_tilt_rad: mounts.camera_tilt_rad,
            },
            Medium::Air,
        )
    }

    /// The ideal map of a rig.
    pub fn of(rig: &Rig) -> Self {
        Self::new(&rig.camera, &rig.mounts, &rig.laser)
    }

    pub(crate) fn from_parameters(parameters: IdealParameters, medium: Medium) -> Self {
        let (sin_a, cos_a) = parameters.camera_tilt_rad.sin_cos();
        IdealMap {
            parameters,
            sin_a,
            cos_a,
            medium,
        }
    }

    /// (x̃, ỹ) of a pixel at h = 1: left and up positive.
    fn near_plane(&self, column_px: f64, row_px: f64) -> (f64, f64) {
        let p = &self.parameters;
        (
            -(column_px - p.cx_px) / p.fx_px,
            -(row_px - p.cy_px) / p.fy_px,
        )
    }

    /// Components of the ray (x̃, ỹ): (forward, down) at h = 1.
    fn forward_down(&self, y: f64) -> (f64, f64) {
        (self.sin_a + y * self.cos_a, self.cos_a - y * self.sin_a)
    }

    /// Eqs. 11–12 without the limits of image and fan; `None` only where the ray does not
    /// meet the sheet.
    pub fn unlimited(&self, column_px: f64, row_px: f64) -> Option<(f64, f64)> {
        let p = &self.parameters;
        let (x, y) = self.near_plane(column_px, row_px);
        let (forward, down) = self.forward_down(y);
        if !self.ahead(forward) {
            return None;
        }
        let eta_m = p.eta_c_m + down / forward * p.zeta_c_m; // (11)
        let xi_m = p.zeta_c_m.hypot(p.eta_c_m - eta_m) / forward.hypot(down) * x; // (12)
        Some((xi_m, eta_m))
    }

    /// The sheet lies on the side of the camera to which the ray runs.
    fn ahead(&self, forward: f64) -> bool {
        -self.parameters.zeta_c_m * forward > 0.0
    }
}

impl PlaneMap for IdealMap {
    fn to_plane(&self, column_px: f64, row_px: f64) -> Option<PlanePoint> {
        if !self.parameters.image.contains(column_px, row_px) {
            return None;
        }
        let (xi_m, eta_m) = self.unlimited(column_px, row_px)?;
        self.parameters
            .fan
            .contains(xi_m, eta_m)
            .then(|| PlanePoint {
                xi_m,
                eta_m,
                covariance_m2: Matrix2::zeros(),
            })
    }

    fn to_image(&self, xi_m: f64, eta_m: f64) -> Option<(f64, f64)> {
        let p = &self.parameters;
        if !p.fan.contains(xi_m, eta_m) {
            return None;
        }
        // The sheet point seen from the camera: forward, down, to port.
        let (forward, down) = (-p.zeta_c_m, p.eta_c_m - eta_m);
        let depth = forward * self.sin_a + down * self.cos_a;
        let up = forward * self.cos_a - down * self.sin_a;
        if depth <= 0.0 {
            return None;
        }
        let column_px = p.cx_px - p.fx_px * xi_m / depth;
        let row_px = p.cy_px - p.fy_px * up / depth;
        p.image
            .contains(column_px, row_px)
            .then_some((column_px, row_px))
    }

    fn jacobian(&self, column_px: f64, row_px: f64) -> Option<Matrix2<f64>> {
        let p = &self.parameters;
        self.to_plane(column_px, row_px)?;
        let (x, y) = self.near_plane(column_px, row_px);
        let (forward, _) = self.forward_down(y);
        // forward² + down² = 1 + ỹ² makes (12) ξ = |ζ_c| x̃ / |forward|, and
        // d(down/forward)/dỹ = −1/forward².
        let distance = p.zeta_c_m.abs() / forward.abs();
        let dxi_dx = distance;
        let dxi_dy = -distance * x * self.cos_a / forward;
        let deta_dy = -p.zeta_c_m / (forward * forward);
        let (dx_dcolumn, dy_drow) = (-1.0 / p.fx_px, -1.0 / p.fy_px);
        Some(Matrix2::new(
            dxi_dx * dx_dcolumn,
            dxi_dy * dy_drow,
            0.0,
            deta_dy * dy_drow,
        ))
    }

    fn describe(&self) -> Calibration {
        Calibration {
            missing: Vec::new(),
            image: None, // stands in the parameters
            medium: self.medium,
            date: None,
            board: None,
            residuals: None,
            placement: None,
            coplanarity: None,
            nodes: Vec::new(),
            map: MapParameters::Ideal(self.parameters),
        }
    }
}

#[cfg(test)]
mod tests;
