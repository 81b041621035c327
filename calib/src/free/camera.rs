//! The camera: pinhole, Brown's lens, and a flat port by Snell's law.
//!
//! Camera frame: X right, Y down, Z along the optical axis, origin in the entrance pupil, metres. With x = X/Z, y = Y/Z
//! of the ray in the housing's air, r² = x² + y²:
//!
//! x_d = x (1 + k₁r² + k₂r⁴ + k₃r⁶) + 2p₁xy + p₂(r² + 2x²), y_d = y (…) + p₁(r² + 2y²) + 2p₂xy (Brown 1971, in
//! OpenCV's order of p), column = f x_d + c_x, row = a f y_d + c_y.
//!
//! The port is a plate of glass with normal ∝ (tilt_x, tilt_y, 1), its inner face `distance` from the pupil along the
//! normal. A point at height h over the pupil and ρ off the normal is seen at the tangent t of the angle in air with
//! d t + g tan g(t) + (h − d − g) tan w(t) = ρ, n_a sin = n_g sin = n_w sin (Treibitz et al. 2012).

use nalgebra::{Matrix2, Vector2, Vector3};
use serde::{Deserialize, Serialize};

/// Numbers of a camera: f, aspect, c_x, c_y, k₁, k₂, p₁, p₂, k₃, port distance, tilt x, tilt y, index of the medium.
pub const CAMERA: usize = 13;
/// Focal length along columns \[px\].
pub const FOCAL: usize = 0;
/// Focal length along rows over that along columns.
pub const ASPECT: usize = 1;
/// Principal point, column, then row \[px\].
pub const CENTRE: usize = 2;
/// k₁, then k₂, p₁, p₂, k₃.
pub const LENS: usize = 4;
/// Pupil to the port's inner face \[m\], then tilts.
pub const PORT: usize = 9;
/// Refractive index of the medium beyond the port.
pub const MEDIUM: usize = 12;

/// Half widths of central differences: some 1e-6 of what a number may be.
pub const STEPS: [f64; CAMERA] = [
    1e-3, 1e-6, 1e-3, 1e-3, 1e-6, 1e-6, 1e-7, 1e-7, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6,
];

/// A plate of glass in front of the camera.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plate {
    /// Thickness \[m\].
    pub glass_m: f64,
    /// Refractive index (acrylic 1.49, glass 1.52).
    pub n_glass: f64,
}

/// A camera.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lens {
    /// Its numbers, as [`CAMERA`] lists them.
    pub numbers: [f64; CAMERA],
    /// Port; `None` = the camera looks straight into the medium.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plate: Option<Plate>,
}

impl Lens {
    fn normal(&self) -> Vector3<f64> {
        Vector3::new(self.numbers[PORT + 1], self.numbers[PORT + 2], 1.0).normalize()
    }

    /// The pixel of a point \[m\]; `None` where it is not in front of the camera, or out of reach of any ray.
    pub fn project(&self, point: &Vector3<f64>) -> Option<Vector2<f64>> {
        let air = match &self.plate {
            None => *point,
            Some(plate) => self.through(plate, point)?,
        };
        if air[2].is_nan() || air[2] <= 1e-9 {
            return None;
        }
        let at = Vector2::new(air[0] / air[2], air[1] / air[2]);
        let [f, a, cx, cy] = [0, 1, 2, 3].map(|k| self.numbers[k]);
        let d = self.distort(at).0;
        let pixel = Vector2::new(cx + f * d[0], cy + a * f * d[1]);
        pixel.iter().all(|v| v.is_finite()).then_some(pixel)
    }

    /// Direction in the housing's air in which a point beyond the port is seen.
    fn through(&self, plate: &Plate, point: &Vector3<f64>) -> Option<Vector3<f64>> {
        let normal = self.normal();
        let height = normal.dot(point);
        let aside = point - normal * height;
        let radius = aside.norm();
        let (distance, glass) = (self.numbers[PORT], plate.glass_m);
        let beyond = height - distance - glass;
        if beyond <= 0.0 {
            return None;
        }
        if radius < 1e-12 {
            return Some(normal);
        }
        // tan of the angle in a medium of index n, and its derivative by the sine in air.
        let tan = |sin: f64, n: f64| {
            let root = (n * n - sin * sin).sqrt();
            (sin / root, n * n / (root * root * root))
        };
        let mut t = radius * self.numbers[MEDIUM] / height;
        for _ in 0..30 {
            let cos = 1.0 / (1.0 + t * t).sqrt();
            let sin = t * cos;
            let ((g, dg), (w, dw)) = (tan(sin, plate.n_glass), tan(sin, self.numbers[MEDIUM]));
            let off = distance * t + glass * g + beyond * w - radius;
            let slope = distance + (glass * dg + beyond * dw) * cos * cos * cos;
            let step = off / slope;
            t = (t - step).max(0.5 * t);
            if !t.is_finite() {
                return None;
            }
            if step.abs() < 1e-14 * (1.0 + t) {
                break;
            }
        }
        Some(normal + aside * (t / radius))
    }

    /// An undistorted place after distortion, and its derivative.
    fn distort(&self, at: Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let [k1, k2, p1, p2, k3] = [0, 1, 2, 3, 4].map(|k| self.numbers[LENS + k]);
        let (x, y) = (at[0], at[1]);
        let r2 = at.norm_squared();
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3));
        let out = Vector2::new(
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        );
        let cross = slope * x * y + 2.0 * (p1 * x + p2 * y);
        let by = Matrix2::new(
            radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x,
            cross,
            cross,
            radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x,
        );
        (out, by)
    }

    /// Start \[m\] and unit direction of a pixel's ray in the medium; `None` where the lens has no such ray.
    pub fn ray(&self, pixel: &Vector2<f64>) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let [f, a, cx, cy] = [0, 1, 2, 3].map(|k| self.numbers[k]);
        let target = Vector2::new((pixel[0] - cx) / f, (pixel[1] - cy) / (a * f));
        let mut at = target;
        let mut left = f64::INFINITY;
        for _ in 0..30 {
            let (seen, by) = self.distort(at);
            // Beyond the fold of a polynomial lens there is no ray.
            if by.determinant() < 0.02 {
                return None;
            }
            let off = seen - target;
            left = off.norm();
            if left < 1e-13 {
                break;
            }
            let step = by.try_inverse()? * off;
            at -= step * (0.5 / step.norm()).min(1.0);
        }
        if left.is_nan() || left >= 1e-9 {
            return None;
        }
        let air = Vector3::new(at[0], at[1], 1.0).normalize();
        let Some(plate) = &self.plate else {
            return Some((Vector3::zeros(), air));
        };
        let normal = self.normal();
        let cos = air.dot(&normal);
        if cos < 0.1 {
            return None;
        }
        let inner = air * (self.numbers[PORT] / cos);
        let glass = refract(&air, &normal, 1.0 / plate.n_glass)?;
        let outer = inner + glass * (plate.glass_m / glass.dot(&normal));
        let beyond = refract(&glass, &normal, plate.n_glass / self.numbers[MEDIUM])?;
        Some((outer, beyond))
    }

    /// The same with one number moved.
    pub fn moved(&self, number: usize, by: f64) -> Self {
        let mut other = *self;
        other.numbers[number] += by;
        other
    }
}

/// Snell's law for vectors: w = μ a + (√(1 − μ²(1 − c²)) − μ c) n, c = a·n (Glassner 1989).
fn refract(a: &Vector3<f64>, n: &Vector3<f64>, mu: f64) -> Option<Vector3<f64>> {
    let c = a.dot(n);
    let inside = 1.0 - mu * mu * (1.0 - c * c);
    (inside > 0.0).then(|| a * mu + n * (inside.sqrt() - mu * c))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn behind_port() -> Lens {
        Lens {
            numbers: [
                590.0, 1.01, 355.0, 290.0, -0.15, 0.03, 1e-3, -5e-4, 0.01, 0.03, 0.02, -0.01, 1.335,
            ],
            plate: Some(Plate {
                glass_m: 0.01,
                n_glass: 1.49,
            }),
        }
    }

    #[test]
    fn a_ray_comes_back_to_its_pixel_with_and_without_a_port() {
        let wet = behind_port();
        let dry = Lens { plate: None, ..wet };
        for lens in [wet, dry] {
            for pixel in [[0.0, 0.0], [719.0, 30.0], [355.0, 290.0], [100.0, 575.0]] {
                let pixel = Vector2::from(pixel);
                let (from, along) = lens.ray(&pixel).unwrap();
                for far in [0.05, 0.4, 2.0] {
                    let back = lens.project(&(from + along * far)).unwrap();
                    assert!((back - pixel).norm() < 1e-7, "{pixel}: {back}");
                }
            }
        }
    }

    #[test]
    fn what_no_ray_reaches_has_no_pixel() {
        let lens = behind_port();
        assert_eq!(lens.project(&Vector3::new(0.0, 0.0, -1.0)), None);
        assert_eq!(lens.project(&Vector3::new(0.0, 0.0, 0.035)), None);
        let folded = Lens {
            numbers: [
                300.0, 1.0, 320.0, 240.0, -0.6, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0,
            ],
            plate: None,
        };
        assert_eq!(folded.ray(&Vector2::new(0.0, 0.0)), None);
    }
}
