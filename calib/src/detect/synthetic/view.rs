//! The camera of the rendered images: a ray for every place in the image.

use nalgebra::{Rotation3, Vector3};

use crate::study::truth::Rig;

/// A camera looking at a board (ξ, η, ζ; the face at ζ = 0 is seen from ζ < 0).
#[derive(Debug, Clone)]
pub struct View {
    /// Camera \[m\].
    pub eye_m: Vector3<f64>,
    /// Image right, image down, optical axis in the board's frame.
    axes: [Vector3<f64>; 3],
    /// Focal length \[px\].
    pub focal_px: f64,
    /// Principal point \[px\].
    pub centre_px: [f64; 2],
    /// Port and lens; `None` = pinhole.
    port: Option<Rig>,
}

impl View {
    /// A pinhole `distance_m` from the board's middle, the board's normal `angle_rad` off the
    /// optical axis in direction `azimuth_rad` (0 = camera to port, π/2 = above), rolled.
    pub fn pinhole(
        size: [usize; 2],
        focal_px: f64,
        distance_m: f64,
        angle_rad: f64,
        azimuth_rad: f64,
        roll_rad: f64,
    ) -> Self {
        let (s, c) = angle_rad.sin_cos();
        let away = Vector3::new(s * azimuth_rad.cos(), s * azimuth_rad.sin(), -c);
        let forward = -away;
        let up = Vector3::new(0.0, 1.0, 0.0);
        let right = forward.cross(&up);
        // Right-handed ξ (port), η, ζ: looking along ζ, ξ is to the left.
        let right = if right.norm() > 1e-6 {
            right.normalize()
        } else {
            Vector3::new(-1.0, 0.0, 0.0)
        };
        let roll = Rotation3::from_axis_angle(&nalgebra::Unit::new_normalize(forward), roll_rad);
        let right = roll * right;
        View {
            eye_m: away * distance_m,
            axes: [right, forward.cross(&right), forward],
            focal_px,
            centre_px: [0.5 * (size[0] as f64 - 1.0), 0.5 * (size[1] as f64 - 1.0)],
            port: None,
        }
    }

    /// The study's rig, the board's origin at (0, `eta_m`) of its sheet.
    pub fn behind_port(rig: Rig, eta_m: f64) -> Self {
        let norm = rig.height_m.hypot(rig.distance_m);
        let (down, forward) = (rig.height_m / norm, rig.distance_m / norm);
        View {
            eye_m: Vector3::new(0.0, rig.height_m - eta_m, -rig.distance_m),
            axes: [
                Vector3::new(-1.0, 0.0, 0.0),
                Vector3::new(0.0, -forward, -down),
                Vector3::new(0.0, -down, forward),
            ],
            focal_px: rig.focal_px,
            centre_px: rig.centre_px,
            port: Some(rig),
        }
    }

    /// The true pixel of a board point (ξ, η, height towards the camera) \[m\].
    pub fn project(&self, xi_m: f64, eta_m: f64, height_m: f64) -> Option<[f64; 2]> {
        if let Some(rig) = &self.port {
            let eta_off = rig.height_m - self.eye_m[1];
            return rig.project(xi_m, eta_m + eta_off, -height_m);
        }
        let d = Vector3::new(xi_m, eta_m, -height_m) - self.eye_m;
        let z = d.dot(&self.axes[2]);
        (z > 0.0).then(|| {
            [
                self.centre_px[0] + self.focal_px * d.dot(&self.axes[0]) / z,
                self.centre_px[1] + self.focal_px * d.dot(&self.axes[1]) / z,
            ]
        })
    }

    /// Start and direction of a pixel's ray beyond the port, in the board's frame.
    pub(super) fn ray(&self, column: f64, row: f64) -> (Vector3<f64>, Vector3<f64>) {
        let (x, y) = (
            (column - self.centre_px[0]) / self.focal_px,
            (row - self.centre_px[1]) / self.focal_px,
        );
        let to_board =
            |v: Vector3<f64>| self.axes[0] * v[0] + self.axes[1] * v[1] + self.axes[2] * v[2];
        let Some(rig) = &self.port else {
            return (self.eye_m, to_board(Vector3::new(x, y, 1.0)).normalize());
        };
        // The lens inverted by fixed point, then Snell in the ray's own plane.
        let seen = x.hypot(y);
        let mut r = seen;
        for _ in 0..30 {
            r = seen / (1.0 + r * r * (rig.k[0] + rig.k[1] * r * r));
        }
        let angle = r.atan();
        let sin = angle.sin();
        let (tan_g, tan_w) = (
            (sin / rig.n_glass).asin().tan(),
            (sin / rig.n_water).asin().tan(),
        );
        let radius = rig.port_m * angle.tan() + rig.glass_m * tan_g;
        let (ux, uy) = if seen > 0.0 {
            (x / seen, y / seen)
        } else {
            (0.0, 0.0)
        };
        (
            self.eye_m
                + to_board(Vector3::new(
                    radius * ux,
                    radius * uy,
                    rig.port_m + rig.glass_m,
                )),
            to_board(Vector3::new(tan_w * ux, tan_w * uy, 1.0)).normalize(),
        )
    }
}
