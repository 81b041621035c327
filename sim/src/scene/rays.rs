//! Rays of pixels and the linear forms along them, for one pose.
//!
//! With a pinhole the direction of the ray of pixel (column u, row v) is A + u B + v C, so
//! every affine coordinate of a point on it (x, y, height, distance to the sheet, body y
//! and z) is `at_eye + t (a + u b + v c)`: no matrix product per pixel.

use super::Pose6;
use super::solid::Line;
use crate::effect::Optics;
use crate::vehicle::kinematics;
use nalgebra::{Matrix3, Vector3};

/// An affine coordinate along the rays of all pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Form {
    /// Value at the pinhole.
    pub at_eye: f64,
    /// Rate per t at (u, v) = (0, 0), and its slopes in u and v.
    pub a: f64,
    pub b: f64,
    pub c: f64,
}

impl Form {
    /// Rate per t of pixel (u, v).
    pub fn rate(&self, u: f64, v: f64) -> f64 {
        self.a + u * self.b + v * self.c
    }
}

/// How the pixels of one pose see the scene.
pub(super) trait Sight: Sync {
    /// One pixel's ray, ready to be asked.
    type Ray;
    /// Ray of pixel (column u, row v).
    fn ray(&self, u: f64, v: f64) -> Self::Ray;
    /// The ray in (x, y, height).
    fn line(&self, ray: &Self::Ray) -> Line;
    /// Distance off the sheet at the ray's parameter t, forward positive \[m\].
    fn off_m(&self, ray: &Self::Ray, t: f64) -> f64;
    /// Body y and z from the laser's apex at t \[m\].
    fn fan(&self, ray: &Self::Ray, t: f64) -> [f64; 2];
    /// Laser's apex in (x, y, height) \[m\].
    fn apex(&self) -> [f64; 3];
    /// Row at which column `u` sees the points `sheet_m` off the sheet at height `height_m`, with t there.
    fn row_of(&self, u: f64, height_m: f64, sheet_m: f64) -> Option<(f64, f64)>;
}

/// Affine coordinates of body points for one pose: unit normal (or gradient) and offset each.
#[derive(Debug, Clone)]
pub(super) struct Frames {
    pub x: (Vector3<f64>, f64),
    pub y: (Vector3<f64>, f64),
    pub height: (Vector3<f64>, f64),
    pub sheet: (Vector3<f64>, f64),
    pub apex: [f64; 3],
}

impl Frames {
    /// `target_origin`: X, Y, heading of the target in the tank frame.
    pub fn new(optics: &Optics, target_origin: [f64; 3], pose: &Pose6) -> Self {
        let rows = kinematics::rotation(pose.phi_rad, pose.theta_rad, pose.psi_rad);
        let to_tank = Matrix3::from_fn(|i, j| rows[i][j]);
        let cg = Vector3::new(pose.x_m, pose.y_m, pose.z_m);
        let tank = |normal: Vector3<f64>, offset: f64| {
            (to_tank.transpose() * normal, normal.dot(&cg) + offset)
        };

        let [ox, oy, heading] = target_origin;
        let (st, ct) = heading.sin_cos();
        let along = Vector3::new(ct, st, 0.0);
        let across = Vector3::new(-st, ct, 0.0);
        let x_offset = -(ct * ox + st * oy);
        let y_offset = st * ox - ct * oy;
        // Surface at z = -slope X: height above it = -z - slope X (theory/physics.md, measurement: floor_slope).
        let up = Vector3::new(-optics.floor_slope, 0.0, -1.0);
        // Sheet x_b = l_laser + tan(pitch) z_b + tan(yaw) y_b (theory/physics.md, measurement: laser_plane_tilt).
        let normal = Vector3::new(1.0, -optics.sheet_tan_yaw, -optics.sheet_tan_pitch);
        let length = normal.norm();

        let apex_body = Vector3::new(optics.l_laser_m, 0.0, 0.0);
        let apex = to_tank * apex_body + cg;
        Frames {
            x: tank(along, x_offset),
            y: tank(across, y_offset),
            height: tank(up, 0.0),
            sheet: (normal / length, -optics.l_laser_m / length),
            apex: [
                along.dot(&apex) + x_offset,
                across.dot(&apex) + y_offset,
                up.dot(&apex),
            ],
        }
    }
}

/// One pose's view of the scene by straight rays.
#[derive(Debug, Clone)]
pub(super) struct View {
    /// Target frame, along its centre line \[m\].
    pub x: Form,
    /// Target frame, to starboard \[m\].
    pub y: Form,
    /// Above the floor \[m\].
    pub height: Form,
    /// Signed distance from the sheet, forward positive \[m\].
    pub sheet: Form,
    /// Body frame, to starboard of the laser's apex \[m\].
    pub fan_y: Form,
    /// Body frame, below the laser's apex \[m\].
    pub fan_z: Form,
    /// Laser's apex in (x, y, height) \[m\].
    pub apex: [f64; 3],
}

impl View {
    /// `target_origin`: X, Y, heading of the target in the tank frame.
    pub fn new(optics: &Optics, target_origin: [f64; 3], pose: &Pose6) -> Self {
        let (eye, [a, b, c]) = camera(optics);
        let form = |(normal, offset): (Vector3<f64>, f64)| Form {
            at_eye: normal.dot(&eye) + offset,
            a: normal.dot(&a),
            b: normal.dot(&b),
            c: normal.dot(&c),
        };
        let frames = Frames::new(optics, target_origin, pose);
        View {
            x: form(frames.x),
            y: form(frames.y),
            height: form(frames.height),
            sheet: form(frames.sheet),
            fan_y: form((Vector3::y(), 0.0)),
            fan_z: form((Vector3::z(), 0.0)),
            apex: frames.apex,
        }
    }
}

/// A pixel of the plain view, with the rate of its distance to the sheet.
#[derive(Debug, Clone, Copy)]
pub(super) struct PlainRay {
    u: f64,
    v: f64,
    sheet_rate: f64,
}

impl Sight for View {
    type Ray = PlainRay;

    #[inline]
    fn ray(&self, u: f64, v: f64) -> PlainRay {
        PlainRay {
            u,
            v,
            sheet_rate: self.sheet.rate(u, v),
        }
    }

    #[inline]
    fn line(&self, ray: &PlainRay) -> Line {
        let &PlainRay { u, v, .. } = ray;
        Line {
            origin: [self.x.at_eye, self.y.at_eye, self.height.at_eye],
            direction: [self.x.rate(u, v), self.y.rate(u, v), self.height.rate(u, v)],
        }
    }

    #[inline]
    fn off_m(&self, ray: &PlainRay, t: f64) -> f64 {
        self.sheet.at_eye + t * ray.sheet_rate
    }

    #[inline]
    fn fan(&self, ray: &PlainRay, t: f64) -> [f64; 2] {
        [&self.fan_y, &self.fan_z].map(|f| f.at_eye + t * f.rate(ray.u, ray.v))
    }

    fn apex(&self) -> [f64; 3] {
        self.apex
    }

    /// Row at which column `u` sees the points `sheet_m` off the sheet at height `height_m`,
    /// with the ray parameter t there. Exact: both conditions are linear along the column.
    ///
    /// `None` where the column's plane never meets that line, or meets it behind the camera.
    fn row_of(&self, u: f64, height_m: f64, sheet_m: f64) -> Option<(f64, f64)> {
        let (h, s) = (&self.height, &self.sheet);
        let (dh, ds) = (height_m - h.at_eye, sheet_m - s.at_eye);
        let v = (dh * (s.a + u * s.b) - ds * (h.a + u * h.b)) / (ds * h.c - dh * s.c);
        let t = dh / h.rate(u, v);
        (v.is_finite() && t.is_finite() && t > 0.0).then_some((v, t))
    }
}

/// The camera's axes in the body frame: Z (looks forward and down), X to starboard, Y = Z x X.
pub(super) fn axes(optics: &Optics) -> (Vector3<f64>, Vector3<f64>, Vector3<f64>) {
    let (sin, cos) = optics.camera_tilt_rad.sin_cos();
    let axis = Vector3::new(sin, 0.0, cos);
    let right = Vector3::new(0.0, 1.0, 0.0);
    (axis, right, axis.cross(&right))
}

/// Pinhole and ray directions A + u B + v C of its pixels, in the body frame.
pub(super) fn camera(optics: &Optics) -> (Vector3<f64>, [Vector3<f64>; 3]) {
    let (axis, right, down) = axes(optics);
    let [fx, fy] = optics.focal_px;
    let [cx, cy] = optics.centre_px;
    let (b, c) = (right / fx, down / fy);
    (
        Vector3::from(optics.camera_m),
        [axis - b * cx - c * cy, b, c],
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::lshpi_rig;
    use proptest::prelude::*;

    fn view(pose: Pose6) -> View {
        View::new(&Optics::new(&lshpi_rig()), [0.0; 3], &pose)
    }

    #[test]
    fn the_axis_meets_the_sheet_at_eta_zero() {
        // theory/geometry.md, camera: with H = h_centre the middle of the image is the stripe on the floor.
        let v = view(Pose6 {
            z_m: -0.68,
            ..Pose6::default()
        });
        let (row, t) = v.row_of(359.5, 0.0, 0.0).unwrap();
        assert!((row - 287.5).abs() < 1e-9, "{row}");
        assert!((v.x.at_eye + t * v.x.rate(359.5, row) - 0.27).abs() < 1e-12);
    }

    #[test]
    fn paper_eq_11_and_12() {
        // (eta, xi) of a pixel by the paper's formulas against the ray's hit on the sheet.
        let rig = lshpi_rig();
        let (eta_c, zeta_c, alpha) = (0.46f64, -0.46f64, std::f64::consts::FRAC_PI_4);
        for (u, v) in [(10.0, 20.0), (359.5, 287.5), (700.0, 500.0)] {
            let (x_left, y_up) = (rig.camera.cx_px - u, rig.camera.cy_px - v);
            let h = rig.camera.fx_px;
            let (near, far) = (
                h * alpha.sin() + y_up * alpha.cos(),
                h * alpha.cos() - y_up * alpha.sin(),
            );
            let eta = eta_c + far / near * zeta_c;
            let xi = (zeta_c.powi(2) + (eta_c - eta).powi(2)).sqrt() / near.hypot(far) * x_left;
            let w = view(Pose6 {
                z_m: -0.68,
                ..Pose6::default()
            });
            let t = -w.sheet.at_eye / w.sheet.rate(u, v);
            let (y_b, z_b) = (
                w.fan_y.at_eye + t * w.fan_y.rate(u, v),
                w.fan_z.at_eye + t * w.fan_z.rate(u, v),
            );
            assert!(
                (-y_b - xi).abs() < 1e-12 && (0.68 - z_b - eta).abs() < 1e-12,
                "{u} {v}"
            );
        }
    }

    proptest! {
        #[test]
        fn rows_fulfil_both_conditions(
            u in 0.0..720.0f64, height in 0.0..0.05f64, off in -0.01..0.01f64,
            phi in -0.2..0.2f64, theta in -0.2..0.2f64, psi in -0.5..0.5f64,
        ) {
            let v = view(Pose6 { x_m: 0.1, y_m: 0.02, z_m: -0.8, phi_rad: phi, theta_rad: theta, psi_rad: psi });
            let (row, t) = v.row_of(u, height, off).unwrap();
            prop_assert!((v.height.at_eye + t * v.height.rate(u, row) - height).abs() < 1e-12);
            prop_assert!((v.sheet.at_eye + t * v.sheet.rate(u, row) - off).abs() < 1e-12);
        }
    }
}
