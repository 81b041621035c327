//! The laser sheet in the camera's frame: a plane, or a weak cone where the plane does not do.
//!
//! A fan that leaves its window at an angle is refracted to a cone (Palomer et al. 2019). Of a weak one remains, over a plane
//! m·X = 1, the height ζ = t² (κ₀ + κ₁ s), t along the line as it falls on boards, s across it within the plane.

use nalgebra::{Matrix3x2, SVector, Vector3};
use serde::{Deserialize, Serialize};

/// Numbers of a sheet: m (3) \[1/m\], κ₀ \[1/m\], κ₁ \[1/m²\].
pub const SHEET: usize = 5;
/// κ₀, then κ₁.
pub const CONE: usize = 3;

/// A laser sheet.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LaserSurface {
    /// Its numbers, as [`SHEET`] lists them.
    pub numbers: [f64; SHEET],
    /// Zero of t and s \[m\].
    pub origin_m: [f64; 3],
    /// Directions of t and s, unit length.
    pub axes: [[f64; 3]; 2],
}

impl LaserSurface {
    /// A plane m·X = 1, with t and s from `origin` along and across `along`.
    pub fn plane(m: Vector3<f64>, origin: Vector3<f64>, along: Vector3<f64>) -> Option<Self> {
        let normal = m.try_normalize(1e-12)?;
        let t = (along - normal * normal.dot(&along)).try_normalize(1e-9)?;
        let s = normal.cross(&t);
        Some(LaserSurface {
            numbers: [m[0], m[1], m[2], 0.0, 0.0],
            origin_m: origin.into(),
            axes: [t.into(), s.into()],
        })
    }

    fn m(&self) -> Vector3<f64> {
        Vector3::new(self.numbers[0], self.numbers[1], self.numbers[2])
    }

    /// Unit normal of the plane, away from the camera.
    pub fn normal(&self) -> Vector3<f64> {
        self.m().normalize()
    }

    fn coordinates(&self, point: &Vector3<f64>) -> (f64, f64) {
        let d = point - Vector3::from(self.origin_m);
        let [t, s] = self.axes.map(Vector3::from);
        (d.dot(&t), d.dot(&s))
    }

    /// Distance of a point from the sheet, away from the camera positive \[m\].
    pub fn distance_m(&self, point: &Vector3<f64>) -> f64 {
        let m = self.m();
        let (t, s) = self.coordinates(point);
        (m.dot(point) - 1.0) / m.norm() - t * t * (self.numbers[CONE] + self.numbers[CONE + 1] * s)
    }

    /// Derivative of the distance by the point.
    pub fn gradient(&self, point: &Vector3<f64>) -> Vector3<f64> {
        let (t, s) = self.coordinates(point);
        let [at, across] = self.axes.map(Vector3::from);
        let [k0, k1] = [self.numbers[CONE], self.numbers[CONE + 1]];
        self.normal() - at * (2.0 * t * (k0 + k1 * s)) - across * (t * t * k1)
    }

    /// Derivative of the distance by the sheet's numbers.
    pub fn by_numbers(&self, point: &Vector3<f64>) -> SVector<f64, SHEET> {
        let m = self.m();
        let size = m.norm();
        let off = (m.dot(point) - 1.0) / size;
        let by_m = (point - m * (off / size)) / size;
        let (t, s) = self.coordinates(point);
        SVector::from([by_m[0], by_m[1], by_m[2], -t * t, -t * t * s])
    }

    /// Where a ray meets the sheet \[m\]; `None` where it runs along it or away.
    pub fn meet(&self, from: &Vector3<f64>, along: &Vector3<f64>) -> Option<Vector3<f64>> {
        let m = self.m();
        let slope = m.dot(along);
        let mut far = (1.0 - m.dot(from)) / slope;
        // The cone is weak: a few steps of Newton from the plane.
        for _ in 0..20 {
            let point = from + along * far;
            let step = self.distance_m(&point) / self.gradient(&point).dot(along);
            far -= step;
            if step.abs() < 1e-13 {
                break;
            }
        }
        (far.is_finite() && far > 0.0 && slope.abs() > 1e-9).then(|| from + along * far)
    }

    /// The sheet's own axes ξ, η in the camera's frame: ξ to the image's left, η up, ζ away from the camera.
    pub fn frame(&self) -> Matrix3x2<f64> {
        let normal = self.normal();
        let within = |v: Vector3<f64>| v - normal * normal.dot(&v);
        let left = within(Vector3::new(-1.0, 0.0, 0.0));
        // Of a sheet that faces sideways left is short and up is not.
        let xi = if left.norm() > 0.3 {
            left.normalize()
        } else {
            within(Vector3::new(0.0, -1.0, 0.0))
                .cross(&normal)
                .normalize()
        };
        Matrix3x2::from_columns(&[xi, normal.cross(&xi)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cone() -> LaserSurface {
        let m = Vector3::new(0.1, -1.2, 1.5);
        let mut sheet =
            LaserSurface::plane(m, Vector3::new(0.0, 0.0, 0.66), Vector3::new(1.0, 0.1, 0.0))
                .unwrap();
        sheet.numbers[CONE] = 0.08;
        sheet.numbers[CONE + 1] = -0.1;
        sheet
    }

    #[test]
    fn derivatives_are_those_of_the_distance() {
        let sheet = cone();
        let point = Vector3::new(0.12, -0.05, 0.55);
        let h = 1e-6;
        for k in 0..3 {
            let mut d = Vector3::zeros();
            d[k] = h;
            let by = (sheet.distance_m(&(point + d)) - sheet.distance_m(&(point - d))) / (2.0 * h);
            assert!((by - sheet.gradient(&point)[k]).abs() < 1e-8);
        }
        for k in 0..SHEET {
            let moved = |by: f64| {
                let mut other = sheet;
                other.numbers[k] += by;
                other.distance_m(&point)
            };
            let by = (moved(h) - moved(-h)) / (2.0 * h);
            assert!((by - sheet.by_numbers(&point)[k]).abs() < 1e-8);
        }
    }

    #[test]
    fn a_ray_ends_on_the_sheet_and_the_frame_is_right_handed() {
        let sheet = cone();
        let met = sheet
            .meet(&Vector3::zeros(), &Vector3::new(0.2, 0.1, 1.0).normalize())
            .unwrap();
        assert!(sheet.distance_m(&met).abs() < 1e-12);
        let frame = sheet.frame();
        let (xi, eta) = (frame.column(0), frame.column(1));
        assert!((xi.cross(&eta) - sheet.normal()).norm() < 1e-12);
        assert!(xi[0] < 0.0 && eta[1] < 0.0);
    }
}
