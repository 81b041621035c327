//! The scene through a lens with distortion, through a flat port, or lit by a curved sheet.

use super::Pose6;
use super::lens::Lens;
use super::rays::{Frames, Sight, View};
use super::solid::Line;
use crate::effect::Optics;
use nalgebra::Vector3;

/// One pose's view of the scene along rays that are no linear function of the pixel.
#[derive(Debug, Clone)]
pub(super) struct RefractedView {
    lens: Lens,
    frames: Frames,
    optics: Optics,
    /// Length of the sheet's normal (1, -tan yaw, -tan pitch).
    normal: f64,
    /// The straight rays of the same camera: where a search starts.
    straight: View,
}

#[derive(Debug, Clone, Copy)]
pub(super) struct RefractedRay {
    origin: Vector3<f64>,
    direction: Vector3<f64>,
}

impl RefractedView {
    /// As [`View::new`].
    pub fn new(optics: &Optics, target_origin: [f64; 3], pose: &Pose6) -> Self {
        let (yaw, pitch) = (optics.sheet_tan_yaw, optics.sheet_tan_pitch);
        RefractedView {
            lens: Lens::new(optics),
            frames: Frames::new(optics, target_origin, pose),
            optics: *optics,
            normal: (1.0 + yaw * yaw + pitch * pitch).sqrt(),
            straight: View::new(optics, target_origin, pose),
        }
    }
}

impl Sight for RefractedView {
    type Ray = RefractedRay;

    fn ray(&self, u: f64, v: f64) -> RefractedRay {
        let (origin, direction) = self.lens.ray(u, v);
        RefractedRay { origin, direction }
    }

    fn line(&self, ray: &RefractedRay) -> Line {
        let f = &self.frames;
        Line {
            origin: [f.x, f.y, f.height].map(|(n, offset)| n.dot(&ray.origin) + offset),
            direction: [f.x, f.y, f.height].map(|(n, _)| n.dot(&ray.direction)),
        }
    }

    fn off_m(&self, ray: &RefractedRay, t: f64) -> f64 {
        let (n, offset) = self.frames.sheet;
        let plane = n.dot(&ray.origin) + offset + t * n.dot(&ray.direction);
        if self.optics.cone_sin == 0.0 {
            return plane;
        }
        let [y, z] = self.fan(ray, t);
        plane - self.optics.cone_m(y, z) / self.normal
    }

    fn fan(&self, ray: &RefractedRay, t: f64) -> [f64; 2] {
        [
            ray.origin.y + t * ray.direction.y,
            ray.origin.z + t * ray.direction.z,
        ]
    }

    fn apex(&self) -> [f64; 3] {
        self.frames.apex
    }

    /// By the secant method from the straight ray's row: the sheet's distance is nearly linear in the row.
    fn row_of(&self, u: f64, height_m: f64, sheet_m: f64) -> Option<(f64, f64)> {
        let at = |v: f64| {
            let ray = self.ray(u, v);
            let line = self.line(&ray);
            let t = (height_m - line.origin[2]) / line.direction[2];
            (t, self.off_m(&ray, t) - sheet_m)
        };
        let (mut v0, _) = self.straight.row_of(u, height_m, sheet_m)?;
        let mut f0 = at(v0).1;
        let mut v1 = v0 + 1.0;
        for _ in 0..60 {
            let (t, f1) = at(v1);
            if !(f1.is_finite() && f0.is_finite()) {
                return None;
            }
            if f1 == 0.0 || (v1 - v0).abs() < 1e-11 {
                return (t > 0.0).then_some((v1, t));
            }
            // Bounded, so that a start far outside the image comes back step by step.
            let step = (f1 * (v1 - v0) / (f1 - f0)).clamp(-200.0, 200.0);
            if !step.is_finite() {
                return (f1.abs() < 1e-12 && t > 0.0).then_some((v1, t));
            }
            (v0, f0) = (v1, f1);
            v1 -= step;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::lshpi_rig;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn rows_fulfil_both_conditions(
            u in 0.0..720.0f64, height in 0.0..0.05f64, off in -0.01..0.01f64,
            phi in -0.1..0.1f64, theta in -0.1..0.1f64, psi in -0.5..0.5f64,
            n in 1.0..1.4f64, k1 in -0.1..0.1f64, cone in -0.08..0.08f64, tilt in -0.02..0.02f64,
        ) {
            let mut optics: Optics = Optics::new(&lshpi_rig());
            (optics.n_water, optics.port_m, optics.distortion[0]) = (n, 0.02, k1);
            (optics.cone_sin, optics.sheet_tan_pitch) = (cone, tilt);
            let pose = Pose6 { x_m: 0.1, y_m: 0.02, z_m: -0.8, phi_rad: phi, theta_rad: theta, psi_rad: psi };
            let view = RefractedView::new(&optics, [0.1, 0.0, 0.2], &pose);
            let (row, t) = view.row_of(u, height, off).unwrap();
            let ray = view.ray(u, row);
            let line = view.line(&ray);
            prop_assert!((line.origin[2] + t * line.direction[2] - height).abs() < 1e-12);
            prop_assert!((view.off_m(&ray, t) - off).abs() < 1e-12);
        }

        /// Without refraction it is the plain view.
        #[test]
        fn without_refraction_it_is_the_plain_view(u in 0.0..720.0f64, v in 0.0..576.0f64, theta in -0.1..0.1f64) {
            let optics: Optics = Optics::new(&lshpi_rig());
            let pose = Pose6 { z_m: -0.8, theta_rad: theta, psi_rad: 0.3, ..Pose6::default() };
            let (refracted, plain) = (RefractedView::new(&optics, [0.0; 3], &pose), View::new(&optics, [0.0; 3], &pose));
            let (a, b) = (refracted.ray(u, v), plain.ray(u, v));
            let (la, lb) = (refracted.line(&a), plain.line(&b));
            for i in 0..3 {
                prop_assert!((la.origin[i] - lb.origin[i]).abs() < 1e-12);
                prop_assert!((la.direction[i] - lb.direction[i]).abs() < 1e-12);
            }
            prop_assert!((refracted.off_m(&a, 0.7) - plain.off_m(&b, 0.7)).abs() < 1e-12);
        }
    }
}
