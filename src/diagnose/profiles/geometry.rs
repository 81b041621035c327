//! Where a pixel's ray meets sheet and surfaces, for one set of optics.
//!
//! A stripe point at (column, row) on a surface at height h fulfils F = 0, F = distance of the
//! ray's point at that height from the sheet. Nothing is projected: F and its slope along the
//! column say how far a measured row is off, the same for every optics, refracted rays included.

use hydroline_calib::Pose;
use hydroline_pose::outline::Surfaces;
use hydroline_rigs::{Rig, Slab, SlabOutline, Target};
use hydroline_sim::effect::Optics;
use nalgebra::{Matrix3, Vector3};
use std::sync::Arc;

/// Length of a ray over which its run is taken, over the way to the surface: a curved sheet is straight over a thousandth.
const FARTHER: f64 = 1.001;
/// Steps of the fixed point that takes out lens distortion: each gains a factor |k1| r² < 0.05.
const STRAIGHTENING: usize = 25;

/// Camera, sheet, floor and target as one hypothesis has them.
#[derive(Debug, Clone)]
pub struct Geometry {
    optics: Optics,
    axis: Vector3<f64>,
    down: Vector3<f64>,
    /// Floor and target.
    pub surfaces: Arc<Surfaces>,
    /// Heights that occur, floor first \[m\].
    pub heights_m: Vec<f64>,
}

/// A ray in the water, body frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// A point on it \[m\].
    pub from_m: Vector3<f64>,
    /// Its direction.
    pub along: Vector3<f64>,
}

/// A pose with its rotation.
#[derive(Debug, Clone, Copy)]
pub struct Placed {
    to_tank: Matrix3<f64>,
    at_m: Vector3<f64>,
}

impl From<&Pose> for Placed {
    fn from(pose: &Pose) -> Self {
        Placed {
            to_tank: pose.body_to_tank_rotation(),
            at_m: pose.position_m(),
        }
    }
}

/// Where a ray meets a height.
#[derive(Debug, Clone, Copy)]
pub struct Meeting {
    /// Ahead of the sheet \[m\].
    pub off_m: f64,
    /// Tank X, Y \[m\].
    pub at_m: [f64; 2],
}

/// Where a ray meets a surface that is known at the sheet.
#[derive(Debug, Clone, Copy)]
pub struct Ahead {
    /// Ahead of the sheet \[m\].
    pub off_m: f64,
    /// Metres that the ray gains ahead per metre that it comes down. On a surface that rises ahead by p per metre it is
    /// `off_m` / (1 + p run) ahead.
    pub run: f64,
}

impl Geometry {
    /// The geometry of a rig under these optics.
    pub fn new(rig: &Rig, optics: Optics) -> Self {
        let target = rig
            .target
            .as_ref()
            .map(|t| stretched(t, optics.target_scale));
        let surfaces = Surfaces::new(target.as_ref());
        let heights_m = surfaces.heights_m();
        Self::over(optics, Arc::new(surfaces), heights_m)
    }

    fn over(optics: Optics, surfaces: Arc<Surfaces>, heights_m: Vec<f64>) -> Self {
        let (sin, cos) = optics.camera_tilt_rad.sin_cos();
        Geometry {
            axis: Vector3::new(sin, 0.0, cos),
            // The image's rows run aft and down: axis x starboard.
            down: Vector3::new(-cos, 0.0, sin),
            optics,
            surfaces,
            heights_m,
        }
    }

    /// The same floor and target under other optics; `None` where the target changes too.
    pub fn under(&self, optics: Optics) -> Option<Self> {
        (optics.target_scale == self.optics.target_scale)
            .then(|| Self::over(optics, Arc::clone(&self.surfaces), self.heights_m.clone()))
    }

    /// Its optics.
    pub fn optics(&self) -> &Optics {
        &self.optics
    }

    /// The ray of a pixel.
    pub fn ray(&self, column_px: f64, row_px: f64) -> Ray {
        let o = &self.optics;
        let [x, y] = straightened(
            [
                (column_px - o.centre_px[0]) / o.focal_px[0],
                (row_px - o.centre_px[1]) / o.focal_px[1],
            ],
            &o.distortion,
        );
        let air = self.axis + Vector3::y() * x + self.down * y;
        let eye = Vector3::from(o.camera_m);
        if o.n_water == 1.0 {
            return Ray {
                from_m: eye,
                along: air,
            };
        }
        // Snell at a plane with normal N (Glassner 1989): d' = d/n + (sqrt(1 - (1 - c²)/n²) - c/n) N, c = d·N.
        let d = air.normalize();
        let (c, n) = (d.dot(&self.axis), o.n_water);
        let along = d / n + self.axis * ((1.0 - (1.0 - c * c) / (n * n)).sqrt() - c / n);
        Ray {
            from_m: eye + air * o.port_m,
            along,
        }
    }

    /// Distance of a body point ahead of the sheet, along x_b \[m\].
    fn off_m(&self, p: &Vector3<f64>) -> f64 {
        let o = &self.optics;
        let flat = p.x - o.l_laser_m - o.sheet_tan_pitch * p.z - o.sheet_tan_yaw * p.y;
        if o.cone_sin == 0.0 {
            flat
        } else {
            flat - o.cone_m(p.y, p.z)
        }
    }

    /// Where a ray meets the surface at a height; `None` where it never comes down to it.
    pub fn meet(&self, placed: &Placed, ray: &Ray, height_m: f64) -> Option<Meeting> {
        let from = placed.at_m + placed.to_tank * ray.from_m;
        let along = placed.to_tank * ray.along;
        // Height above the floor: -z - slope X (theory/physics.md, measurement: floor_slope).
        let slope = self.optics.floor_slope;
        let down = along.z + slope * along.x;
        let t = (-height_m - from.z - slope * from.x) / down;
        if !(down > 1e-9 && t > 0.0) {
            return None;
        }
        Some(Meeting {
            off_m: self.off_m(&(ray.from_m + ray.along * t)),
            at_m: [from.x + t * along.x, from.y + t * along.y],
        })
    }

    /// Where a ray meets the surface through a body point that falls by `fall` per metre to starboard and does not rise ahead:
    /// how far ahead of the sheet \[m\], and how much farther it is ahead per metre that it comes down to the surface; `None`
    /// where it never does.
    pub fn ahead(&self, ray: &Ray, point_m: &Vector3<f64>, fall: f64) -> Option<Ahead> {
        let down = |v: &Vector3<f64>| v.z - fall * v.y;
        let t = down(&(point_m - ray.from_m)) / down(&ray.along);
        let (a, b) = (
            ray.from_m + ray.along * t,
            ray.from_m + ray.along * (t * FARTHER),
        );
        let (off_m, farther_m) = (self.off_m(&a), self.off_m(&b));
        (t.is_finite() && t > 0.0).then(|| Ahead {
            off_m,
            run: (farther_m - off_m) / down(&(b - a)),
        })
    }

    /// Where a ray meets the sheet, body frame \[m\].
    pub fn on_sheet(&self, ray: &Ray) -> Option<Vector3<f64>> {
        let (mut a, mut b) = (0.0, 1.0);
        let off = |t: f64| self.off_m(&(ray.from_m + ray.along * t));
        let (mut fa, mut fb) = (off(a), off(b));
        // Straight for a flat sheet, a few steps for a curved one.
        for _ in 0..12 {
            let t = b - fb * (b - a) / (fb - fa);
            if !t.is_finite() {
                return None;
            }
            (a, fa) = (b, fb);
            (b, fb) = (t, off(t));
            if fb.abs() < 1e-13 {
                break;
            }
        }
        (b > 0.0).then(|| ray.from_m + ray.along * b)
    }
}

/// A target with its lengths along the centre line times a factor, widths of rectangles unchanged.
fn stretched(target: &Target, by: f64) -> Target {
    let slab = |s: &Slab| Slab {
        outline: match &s.outline {
            SlabOutline::Rectangle {
                x0_m,
                x1_m,
                width_m,
            } => SlabOutline::Rectangle {
                x0_m: x0_m * by,
                x1_m: x1_m * by,
                width_m: *width_m,
            },
            SlabOutline::HexagonChain {
                x0_m,
                side_m,
                count,
            } => SlabOutline::HexagonChain {
                x0_m: x0_m * by,
                side_m: side_m * by,
                count: *count,
            },
            SlabOutline::Polygon { points_m } => SlabOutline::Polygon {
                points_m: points_m.iter().map(|[x, y]| [x * by, y * by]).collect(),
            },
        },
        ..s.clone()
    };
    Target {
        slabs: target.slabs.iter().map(slab).collect(),
        ..target.clone()
    }
}

/// Brown 1971, k1 k2 p1 p2 on normalised coordinates: the point that the lens shows at `seen`.
fn straightened(seen: [f64; 2], k: &[f64; 4]) -> [f64; 2] {
    if *k == [0.0; 4] {
        return seen;
    }
    let [mut x, mut y] = seen;
    for _ in 0..STRAIGHTENING {
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k[0] + r2 * k[1]);
        let dx = 2.0 * k[2] * x * y + k[3] * (r2 + 2.0 * x * x);
        let dy = k[2] * (r2 + 2.0 * y * y) + 2.0 * k[3] * x * y;
        (x, y) = ((seen[0] - dx) / radial, (seen[1] - dy) / radial);
    }
    [x, y]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::lshpi_rig;
    use hydroline_rigs::{ParameterValue, PhysicsEntry};
    use hydroline_sim::{EffectStack, Pose6, Renderer};

    fn entry(effect: &str, numbers: &[(&str, f64)]) -> PhysicsEntry {
        PhysicsEntry {
            effect: effect.to_owned(),
            parameters: numbers
                .iter()
                .map(|(n, v)| ((*n).to_owned(), ParameterValue::Number(*v)))
                .collect(),
        }
    }

    /// Written twice, once for rendering and once for fitting: both must put the stripe in the same place.
    #[test]
    fn the_stripe_lies_where_the_renderer_puts_it() {
        let all = [
            entry("refraction", &[("n_water", 1.333), ("port_m", 0.02)]),
            entry(
                "lens_distortion",
                &[("k1", -0.05), ("k2", 0.01), ("p1", 0.002), ("p2", -0.001)],
            ),
            entry(
                "camera_shift",
                &[
                    ("rotation_rad", 0.01),
                    ("dx_m", 0.004),
                    ("dy_m", -0.003),
                    ("dz_m", 0.005),
                ],
            ),
            entry(
                "laser_plane_tilt",
                &[("pitch_rad", 0.01), ("yaw_rad", -0.007)],
            ),
            entry("laser_cone", &[("tilt_rad", 0.05)]),
            entry("board_offset", &[("offset_m", 0.002)]),
            entry("target_scale", &[("gain", 1.02)]),
            entry("floor_slope", &[("slope", 0.015)]),
        ];
        let pose = Pose::from_array([0.13, 0.01, -0.82, 0.012, -0.009, -0.06]);
        for entries in all.iter().map(|e| vec![e.clone()]).chain([Vec::new()]) {
            let mut rig = lshpi_rig();
            rig.physics = entries;
            let stack = EffectStack::build(&rig.physics).unwrap();
            let geometry = Geometry::new(&rig, stack.optics(Optics::new(&rig)));
            let truth = Renderer::new(&rig)
                .unwrap()
                .profile_truth(&Pose6::from(pose.to_array()).into());
            assert!(truth.len() > 500);
            for p in truth {
                let ray = geometry.ray(f64::from(p.column_px), p.row_px);
                let best = geometry
                    .heights_m
                    .iter()
                    .filter_map(|h| geometry.meet(&Placed::from(&pose), &ray, *h))
                    .map(|m| m.off_m.abs())
                    .fold(f64::INFINITY, f64::min);
                assert!(best < 1e-9, "{:?}: {p:?} is {best} m off", rig.physics);
                let on = geometry.on_sheet(&ray).unwrap();
                assert!((-on.y - p.xi_m).abs() < 1e-9, "{:?}", rig.physics);
            }
        }
    }
}
