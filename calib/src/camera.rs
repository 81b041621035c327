//! The pinhole camera on its mount.

use hydroline_rigs::{Camera, Mounts};
use nalgebra::{Matrix3, Vector3};

use crate::frames::{camera_position_m, camera_to_body_rotation};
use crate::plane::ImageSize;

/// The laser sheet as a plane in the body frame: x_b = offset + slope_y y_b + slope_z z_b.
///
/// The ideal sheet has no slopes; a tilted one (`laser_plane_tilt`) has
/// slope_z = tan(pitch), slope_y = tan(yaw).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sheet {
    /// x_b at y_b = z_b = 0, l_laser \[m\].
    pub offset_m: f64,
    /// dx_b/dy_b.
    pub slope_y: f64,
    /// dx_b/dz_b.
    pub slope_z: f64,
}

impl Sheet {
    /// The upright sheet of a rig.
    pub fn of(mounts: &Mounts) -> Self {
        Sheet {
            offset_m: mounts.l_laser_m,
            slope_y: 0.0,
            slope_z: 0.0,
        }
    }

    /// Distance of a body point \[m\] in front of the sheet, along the sheet's normal \[m\].
    pub fn distance_m(&self, body_m: &Vector3<f64>) -> f64 {
        let n = self.normal();
        (n.dot(body_m) - self.offset_m) / n.norm()
    }

    /// Where a ray from `origin_m` meets the sheet, body frame \[m\]; `None` when it runs
    /// along the sheet or away from it.
    pub fn meet(&self, origin_m: &Vector3<f64>, direction: &Vector3<f64>) -> Option<Vector3<f64>> {
        let n = self.normal();
        let along = (self.offset_m - n.dot(origin_m)) / n.dot(direction);
        (along.is_finite() && along > 0.0).then(|| origin_m + direction * along)
    }

    /// n with n·b = offset on the sheet; not of unit length.
    fn normal(&self) -> Vector3<f64> {
        Vector3::new(1.0, -self.slope_y, -self.slope_z)
    }
}

/// A pinhole camera at its place on the body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pinhole {
    /// Focal length along columns \[px\].
    pub fx_px: f64,
    /// Focal length along rows \[px\].
    pub fy_px: f64,
    /// Principal point, column \[px\].
    pub cx_px: f64,
    /// Principal point, row \[px\].
    pub cy_px: f64,
    /// Image size.
    pub size: ImageSize,
    /// Position in the body frame \[m\].
    pub position_m: Vector3<f64>,
    /// Camera to body rotation (columns: camera X, Y, Z in the body frame).
    pub rotation: Matrix3<f64>,
}

impl Pinhole {
    /// The camera of a rig, where the rig's mounts put it.
    pub fn new(camera: &Camera, mounts: &Mounts) -> Self {
        Pinhole {
            fx_px: camera.fx_px,
            fy_px: camera.fy_px,
            cx_px: camera.cx_px,
            cy_px: camera.cy_px,
            size: ImageSize::of(camera),
            position_m: camera_position_m(mounts),
            rotation: camera_to_body_rotation(mounts.camera_tilt_rad),
        }
    }

    /// Pixel (column, row) \[px\] of a body point \[m\], also beyond the image's edge; `None`
    /// when the point is not in front of the camera.
    pub fn project(&self, body_m: &Vector3<f64>) -> Option<(f64, f64)> {
        let c = self.rotation.tr_mul(&(body_m - self.position_m));
        // A positive denominator, not a tolerance: any point ahead has an image.
        (c.z > 0.0).then(|| {
            (
                self.cx_px + self.fx_px * c.x / c.z,
                self.cy_px + self.fy_px * c.y / c.z,
            )
        })
    }

    /// Direction of a pixel's ray in the body frame, unit length.
    pub fn ray(&self, column_px: f64, row_px: f64) -> Vector3<f64> {
        let in_camera = Vector3::new(
            (column_px - self.cx_px) / self.fx_px,
            (row_px - self.cy_px) / self.fy_px,
            1.0,
        );
        (self.rotation * in_camera).normalize()
    }

    /// Whether a pixel coordinate lies on the image.
    pub fn sees(&self, column_px: f64, row_px: f64) -> bool {
        self.size.contains(column_px, row_px)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_rigs::Rig;
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;

    fn lshpi() -> Pinhole {
        let rig = Rig::builtin("lshpi").unwrap();
        Pinhole::new(&rig.camera, &rig.mounts)
    }

    proptest! {
    #![proptest_config(ProptestConfig { rng_seed: RngSeed::Fixed(1), failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn a_ray_projects_back_to_its_pixel(col in -0.5..719.5, row in -0.5..575.5, far in 0.01..5.0) {
            let camera = lshpi();
            let body = camera.position_m + camera.ray(col, row) * far;
            let (c, r) = camera.project(&body).unwrap();
            prop_assert!((c - col).abs() < 1e-9 && (r - row).abs() < 1e-9);
        }

        #[test]
        fn a_met_point_lies_in_the_tilted_sheet(col in 0.0..719.0, row in 0.0..575.0, sy in -0.1..0.1, sz in -0.1..0.1) {
            let sheet = Sheet { offset_m: 0.27, slope_y: sy, slope_z: sz };
            let camera = lshpi();
            let met = sheet.meet(&camera.position_m, &camera.ray(col, row)).unwrap();
            prop_assert!((met.x - (0.27 + sy * met.y + sz * met.z)).abs() < 1e-12);
            prop_assert!(sheet.distance_m(&met).abs() < 1e-12);
            let (c, r) = camera.project(&met).unwrap();
            prop_assert!((c - col).abs() < 1e-8 && (r - row).abs() < 1e-8);
        }
    }

    #[test]
    fn the_image_is_the_right_way_round() {
        let camera = lshpi();
        let (c0, r0) = camera.project(&Vector3::new(0.27, 0.0, 0.68)).unwrap();
        assert!((c0 - 359.5).abs() < 1e-9 && (r0 - 287.5).abs() < 1e-9);
        // Starboard is right, up in the sheet is up in the image.
        assert!(camera.project(&Vector3::new(0.27, 0.1, 0.68)).unwrap().0 > c0);
        assert!(camera.project(&Vector3::new(0.27, 0.0, 0.58)).unwrap().1 < r0);
    }

    #[test]
    fn behind_the_camera_nothing_is_seen() {
        let camera = lshpi();
        assert_eq!(camera.project(&Vector3::new(-1.0, 0.0, -1.0)), None);
        // A ray that looks aft of straight down runs away from the sheet ahead.
        assert_eq!(
            Sheet {
                offset_m: 0.27,
                slope_y: 0.0,
                slope_z: 0.0
            }
            .meet(&camera.position_m, &Vector3::new(-0.1, 0.0, 1.0)),
            None
        );
    }
}
