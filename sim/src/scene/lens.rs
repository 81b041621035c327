//! Rays of pixels through a lens with distortion and through a flat port, body frame.
//!
//! Only rigs with such an effect come here; the plain pinhole keeps its linear forms ([`super::rays`]).

use super::rays::axes;
use crate::effect::Optics;
use nalgebra::{Matrix2, Vector2, Vector3};

/// A camera behind a flat port across its axis.
#[derive(Debug, Clone)]
pub(super) struct Lens {
    eye: Vector3<f64>,
    axis: Vector3<f64>,
    right: Vector3<f64>,
    down: Vector3<f64>,
    focal_px: [f64; 2],
    centre_px: [f64; 2],
    /// Brown's k1, k2, p1, p2.
    distortion: [f64; 4],
    port_m: f64,
    n_water: f64,
}

impl Lens {
    pub fn new(optics: &Optics) -> Self {
        let (axis, right, down) = axes(optics);
        Lens {
            eye: Vector3::from(optics.camera_m),
            axis,
            right,
            down,
            focal_px: optics.focal_px,
            centre_px: optics.centre_px,
            distortion: optics.distortion,
            port_m: optics.port_m,
            n_water: optics.n_water,
        }
    }

    /// Whether these optics need no more than a pinhole's straight rays.
    pub fn is_pinhole(optics: &Optics) -> bool {
        optics.distortion == [0.0; 4] && optics.n_water == 1.0
    }

    /// Where the ray of pixel (u, v) starts in the water and where it goes (not of unit length without a port).
    pub fn ray(&self, u: f64, v: f64) -> (Vector3<f64>, Vector3<f64>) {
        let [x, y] = self.straightened([
            (u - self.centre_px[0]) / self.focal_px[0],
            (v - self.centre_px[1]) / self.focal_px[1],
        ]);
        let air = self.right * x + self.down * y + self.axis;
        if self.n_water == 1.0 {
            return (self.eye, air);
        }
        // n_air sin = n_water sin: the part along the port is divided by n, the rest follows from length 1.
        let along = 1.0 / ((1.0 + x * x + y * y).sqrt() * self.n_water);
        let (sx, sy) = (x * along, y * along);
        let through = (1.0 - sx * sx - sy * sy).sqrt();
        (
            self.eye + air * self.port_m,
            self.right * sx + self.down * sy + self.axis * through,
        )
    }

    /// Brown 1971 on normalised coordinates, x right, y down.
    fn distorted(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [k1, k2, p1, p2] = self.distortion;
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * k2);
        [
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        ]
    }

    /// Its inverse by Newton from the distorted point itself; where the lens folds back, the last iterate.
    fn straightened(&self, d: [f64; 2]) -> [f64; 2] {
        if self.distortion == [0.0; 4] {
            return d;
        }
        let [k1, k2, p1, p2] = self.distortion;
        let mut at = Vector2::from(d);
        for _ in 0..12 {
            let [x, y] = [at.x, at.y];
            let off = Vector2::from(self.distorted([x, y])) - Vector2::from(d);
            let r2 = x * x + y * y;
            let radial = 1.0 + r2 * (k1 + r2 * k2);
            let slope = 2.0 * k1 + 4.0 * k2 * r2; // d(radial)/dx = slope x
            let cross = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y;
            let jacobian = Matrix2::new(
                radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x,
                cross,
                cross,
                radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x,
            );
            let Some(step) = jacobian.try_inverse().map(|inverse| inverse * off) else {
                break;
            };
            at -= step;
            if step.amax() < 1e-15 {
                break;
            }
        }
        at.into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::lshpi_rig;
    use proptest::prelude::*;

    impl Lens {
        /// Pixel of a body point; `None` behind the pinhole or its port.
        pub(in crate::scene) fn project(&self, point: &Vector3<f64>) -> Option<[f64; 2]> {
            let d = point - self.eye;
            let (x, y, z) = (d.dot(&self.right), d.dot(&self.down), d.dot(&self.axis));
            let ahead = if self.n_water == 1.0 {
                0.0
            } else {
                self.port_m
            };
            if z <= ahead || z.is_nan() {
                return None;
            }
            let (x, y) = if self.n_water == 1.0 {
                (x / z, y / z)
            } else {
                let radius = x.hypot(y);
                let tan = self.tangent(radius, z)?;
                let share = if radius > 0.0 { tan / radius } else { 0.0 };
                (x * share, y * share)
            };
            let [x, y] = self.distorted([x, y]);
            Some([
                self.centre_px[0] + self.focal_px[0] * x,
                self.centre_px[1] + self.focal_px[1] * y,
            ])
        }

        /// Tangent in air of the ray that reaches `radius` at depth `z`, by bisection on the sine in air.
        fn tangent(&self, radius: f64, z: f64) -> Option<f64> {
            let tan = |s: f64| s / (1.0 - s * s).sqrt();
            let reach = |s: f64| self.port_m * tan(s) + (z - self.port_m) * tan(s / self.n_water);
            let (mut low, mut high) = (0.0f64, 1.0 - 1e-12);
            if reach(high) < radius {
                return None;
            }
            loop {
                let middle = 0.5 * (low + high);
                if middle <= low || middle >= high {
                    return Some(tan(middle));
                }
                if reach(middle) < radius {
                    low = middle;
                } else {
                    high = middle;
                }
            }
        }
    }

    proptest! {
        /// The ray of a pixel and the pixel of a point are found in different ways; they must agree.
        #[test]
        fn pixels_and_rays_are_inverse(
            u in 0.0..719.0f64, v in 0.0..575.0f64, far in 0.3..2.0f64, n in 1.0..1.4f64, port in 0.0..0.1f64,
            k1 in -0.2..0.2f64, k2 in -0.05..0.05f64, p1 in -0.005..0.005f64, p2 in -0.005..0.005f64,
        ) {
            let mut optics: Optics = Optics::new(&lshpi_rig());
            (optics.distortion, optics.n_water, optics.port_m) = ([k1, k2, p1, p2], n, port);
            let lens = Lens::new(&optics);
            let (origin, direction) = lens.ray(u, v);
            let [column, row] = lens.project(&(origin + direction.normalize() * far)).unwrap();
            prop_assert!((column - u).abs() < 1e-8 && (row - v).abs() < 1e-8, "{column} {u}, {row} {v}");
        }
    }

    #[test]
    fn without_port_and_distortion_it_is_the_pinhole() {
        let optics: Optics = Optics::new(&lshpi_rig());
        let lens = Lens::new(&optics);
        let (eye, [a, b, c]) = super::super::rays::camera(&optics);
        let (origin, direction) = lens.ray(100.0, 500.0);
        assert!(Lens::is_pinhole(&optics) && origin == eye);
        assert!((direction - (a + b * 100.0 + c * 500.0)).norm() < 1e-14);
    }
}
