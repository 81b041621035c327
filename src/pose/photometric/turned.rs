//! A ray against a level, with its derivatives by the pose.

use super::Photometric;
use hydroline_calib::Pose;
use nalgebra::{Matrix3, Vector3};

/// Rotation with its derivatives.
pub(super) struct Turned {
    pub r: Matrix3<f64>,
    pub by: [Matrix3<f64>; 3],
    pub position: Vector3<f64>,
}

impl Turned {
    pub fn new(pose: &Pose) -> Self {
        let (sf, cf) = pose.phi_rad.sin_cos();
        let (st, ct) = pose.theta_rad.sin_cos();
        let (sp, cp) = pose.psi_rad.sin_cos();
        let rz = Matrix3::new(cp, -sp, 0.0, sp, cp, 0.0, 0.0, 0.0, 1.0);
        let ry = Matrix3::new(ct, 0.0, st, 0.0, 1.0, 0.0, -st, 0.0, ct);
        let rx = Matrix3::new(1.0, 0.0, 0.0, 0.0, cf, -sf, 0.0, sf, cf);
        let dz = Matrix3::new(-sp, -cp, 0.0, cp, -sp, 0.0, 0.0, 0.0, 0.0);
        let dy = Matrix3::new(-st, 0.0, ct, 0.0, 0.0, 0.0, -ct, 0.0, -st);
        let dx = Matrix3::new(0.0, 0.0, 0.0, 0.0, -sf, -cf, 0.0, cf, -sf);
        Turned {
            r: rz * ry * rx,
            by: [rz * ry * dx, rz * dy * rx, dz * ry * rx],
            position: pose.position_m(),
        }
    }
}

/// A ray at one height.
#[derive(Clone, Copy)]
pub(super) struct Hit {
    pub t: f64,
    pub t_slope: [f64; 2],
    /// dt/d(z, φ, θ).
    pub dt: [f64; 3],
    /// Tank X, Y.
    pub p: [f64; 2],
}

impl Photometric {
    /// Where a ray (sight, and its slopes) meets a height.
    pub(super) fn hit(
        &self,
        turned: &Turned,
        sight: &[Vector3<f64>; 3],
        height_m: f64,
    ) -> Option<Hit> {
        let [d, du, dv] = sight;
        let r3 = turned.r.row(2);
        let down = (r3 * d)[0];
        let eye = &self.table.eye_m;
        let t = (-height_m - turned.position.z - (r3 * eye)[0]) / down;
        if !(t.is_finite() && t > 0.0 && down > 0.0) {
            return None;
        }
        let x = eye + t * d;
        let q = turned.r * x;
        Some(Hit {
            t,
            t_slope: [-t * (r3 * du)[0] / down, -t * (r3 * dv)[0] / down],
            dt: [
                -1.0 / down,
                -(turned.by[0].row(2) * x)[0] / down,
                -(turned.by[1].row(2) * x)[0] / down,
            ],
            p: [turned.position.x + q.x, turned.position.y + q.y],
        })
    }
}
