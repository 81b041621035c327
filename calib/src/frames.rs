//! Frames and poses.
//!
//! | frame | origin | axes |
//! |---|---|---|
//! | tank | floor, start of the target | X along the target's centre line, Y to starboard of it, Z DOWN (floor 0, vehicle negative) |
//! | body | centre of gravity | x forward, y starboard, z down (SNAME) |
//! | laser plane | body (l_laser, 0, h_centre) | ξ to PORT, η up, ζ forward (paper Fig. 2; right-handed) |
//! | camera | body (−l_camera, 0, h_camera) | X right in the image = starboard, Y down in the image, Z along the optical axis |

use hydroline_rigs::Mounts;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// Position of the CG in the tank frame and Euler angles ZYX (yaw ψ, then pitch θ, then roll φ).
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Pose {
    /// x, along the tank \[m\].
    pub x_m: f64,
    /// y, to starboard \[m\].
    pub y_m: f64,
    /// z, down; −0.83 is 0.83 m above the floor \[m\].
    pub z_m: f64,
    /// φ, roll \[rad\].
    pub phi_rad: f64,
    /// θ, pitch, nose up positive \[rad\].
    pub theta_rad: f64,
    /// ψ, yaw \[rad\].
    pub psi_rad: f64,
}

impl Pose {
    /// From x, y, z \[m\], φ, θ, ψ \[rad\] (`Tank::start_pose`, one row of a state).
    pub fn from_array([x_m, y_m, z_m, phi_rad, theta_rad, psi_rad]: [f64; 6]) -> Self {
        Pose {
            x_m,
            y_m,
            z_m,
            phi_rad,
            theta_rad,
            psi_rad,
        }
    }

    /// x, y, z \[m\], φ, θ, ψ \[rad\].
    pub fn to_array(self) -> [f64; 6] {
        [
            self.x_m,
            self.y_m,
            self.z_m,
            self.phi_rad,
            self.theta_rad,
            self.psi_rad,
        ]
    }

    /// Position of the CG in the tank frame \[m\].
    pub fn position_m(&self) -> Vector3<f64> {
        Vector3::new(self.x_m, self.y_m, self.z_m)
    }

    /// Rotation that turns body coordinates into tank coordinates.
    pub fn body_to_tank_rotation(&self) -> Matrix3<f64> {
        body_to_tank_rotation(self.phi_rad, self.theta_rad, self.psi_rad)
    }

    /// A body point \[m\] in the tank frame \[m\].
    pub fn body_to_tank(&self, body_m: &Vector3<f64>) -> Vector3<f64> {
        self.position_m() + self.body_to_tank_rotation() * body_m
    }

    /// Where a level surface `height_m` above the floor meets the laser plane.
    ///
    /// Puts body point (l_laser, −ξ, h_centre − η) at tank height −z = height:
    /// η = h_centre − (H − height + l_laser sin θ) / (cos θ cos φ) − ξ tan φ with H = −z,
    /// which is Eq. 4 of the paper at θ = 0 and Eq. 5 at φ = 0. `None` when the sheet
    /// does not point down at it (|φ| or |θ| of 90° or more).
    pub fn level_in_plane(&self, mounts: &Mounts, height_m: f64) -> Option<LevelLine> {
        let down = self.theta_rad.cos() * self.phi_rad.cos();
        if !(down > 1e-9 && self.phi_rad.cos() > 0.0) {
            return None;
        }
        let clearance_m = -self.z_m - height_m + mounts.l_laser_m * self.theta_rad.sin();
        Some(LevelLine {
            eta_at_zero_m: mounts.h_centre_m - clearance_m / down,
            slope: -self.phi_rad.tan(),
        })
    }
}

/// The straight line η = `eta_at_zero_m` + `slope` ξ in the laser plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LevelLine {
    /// η at ξ = 0 \[m\].
    pub eta_at_zero_m: f64,
    /// dη/dξ, −tan φ.
    pub slope: f64,
}

/// R = R_z(ψ) R_y(θ) R_x(φ), body to tank (Fossen 2011, Eq. 2.18).
pub fn body_to_tank_rotation(phi_rad: f64, theta_rad: f64, psi_rad: f64) -> Matrix3<f64> {
    let (sf, cf) = phi_rad.sin_cos();
    let (st, ct) = theta_rad.sin_cos();
    let (sp, cp) = psi_rad.sin_cos();
    Matrix3::new(
        cp * ct,
        cp * st * sf - sp * cf,
        cp * st * cf + sp * sf,
        sp * ct,
        sp * st * sf + cp * cf,
        sp * st * cf - cp * sf,
        -st,
        ct * sf,
        ct * cf,
    )
}

/// A point in laser-plane coordinates; in the sheet itself ζ = 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaneCoordinates {
    /// ξ, to port \[m\].
    pub xi_m: f64,
    /// η, up \[m\].
    pub eta_m: f64,
    /// ζ, forward of the sheet \[m\].
    pub zeta_m: f64,
}

/// Sheet point (ξ, η) \[m\] in the body frame \[m\]: (l_laser, −ξ, h_centre − η).
pub fn plane_to_body(mounts: &Mounts, xi_m: f64, eta_m: f64) -> Vector3<f64> {
    Vector3::new(mounts.l_laser_m, -xi_m, mounts.h_centre_m - eta_m)
}

/// Body point \[m\] in laser-plane coordinates: ξ = −y_b, η = h_centre − z_b, ζ = x_b − l_laser.
pub fn body_to_plane(mounts: &Mounts, body_m: &Vector3<f64>) -> PlaneCoordinates {
    PlaneCoordinates {
        xi_m: -body_m.y,
        eta_m: mounts.h_centre_m - body_m.z,
        zeta_m: body_m.x - mounts.l_laser_m,
    }
}

/// Camera position in the body frame \[m\]: (−l_camera, 0, h_camera).
pub fn camera_position_m(mounts: &Mounts) -> Vector3<f64> {
    Vector3::new(-mounts.l_camera_m, 0.0, mounts.h_camera_m)
}

/// Rotation that turns camera coordinates into body coordinates. Its columns are the
/// camera's X (starboard), Y (down in the image) and Z (optical axis, α from the vertical
/// towards forward) in the body frame.
pub fn camera_to_body_rotation(camera_tilt_rad: f64) -> Matrix3<f64> {
    let (sin_a, cos_a) = camera_tilt_rad.sin_cos();
    Matrix3::new(
        0.0, -cos_a, sin_a, //
        1.0, 0.0, 0.0, //
        0.0, sin_a, cos_a,
    )
}

#[cfg(test)]
mod tests;
