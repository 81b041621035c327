//! What each pixel sees of the laser sheet, as a table: the map is asked once per pixel, not once per frame.

use hydroline_calib::plane::PlaneMap;
use hydroline_rigs::{Camera, Mounts};
use nalgebra::Vector3;

/// Sheet points of all pixels.
#[derive(Debug, Clone)]
pub struct SheetTable {
    /// Image width \[px\].
    pub width_px: usize,
    /// Image height \[px\].
    pub height_px: usize,
    /// ξ, η per pixel, row-major \[m\]; NaN where the map does not answer.
    points_m: Vec<[f64; 2]>,
    /// Camera in the body frame \[m\].
    pub eye_m: Vector3<f64>,
    /// CG to the sheet, forward \[m\].
    pub l_laser_m: f64,
    /// CG to η = 0, down \[m\].
    pub h_centre_m: f64,
}

impl SheetTable {
    /// Tabulates a map for a camera on its mounts. The effective ray of a pixel runs from the
    /// camera through the sheet point that the map names: exact for a pinhole, and for a
    /// camera behind a port right in the sheet itself and to first order beside it.
    pub fn new(map: &dyn PlaneMap, camera: &Camera, mounts: &Mounts) -> Self {
        let (width_px, height_px) = (camera.width_px as usize, camera.height_px as usize);
        let mut points_m = Vec::with_capacity(width_px * height_px);
        for row in 0..height_px {
            for column in 0..width_px {
                let p = map.to_plane(column as f64, row as f64);
                points_m.push(p.map_or([f64::NAN; 2], |p| [p.xi_m, p.eta_m]));
            }
        }
        SheetTable {
            width_px,
            height_px,
            points_m,
            eye_m: hydroline_calib::frames::camera_position_m(mounts),
            l_laser_m: mounts.l_laser_m,
            h_centre_m: mounts.h_centre_m,
        }
    }

    /// (ξ, η) of a pixel \[m\]; NaN where there is none.
    pub fn point_m(&self, column: usize, row: usize) -> [f64; 2] {
        self.points_m
            .get(row * self.width_px + column)
            .copied()
            .unwrap_or([f64::NAN; 2])
    }

    /// From the camera to the pixel's sheet point, body frame \[m\].
    pub fn sight(&self, column: usize, row: usize) -> Vector3<f64> {
        let [xi, eta] = self.point_m(column, row);
        Vector3::new(self.l_laser_m, -xi, self.h_centre_m - eta) - self.eye_m
    }

    /// The sight of a pixel with its derivatives along columns and rows \[m/px\].
    pub fn sight_with_slopes(&self, column: usize, row: usize) -> [Vector3<f64>; 3] {
        let at = |c: usize, r: usize| self.point_m(c, r);
        let slope = |a: [f64; 2], b: [f64; 2], px: f64| {
            Vector3::new(0.0, -(b[0] - a[0]) / px, -(b[1] - a[1]) / px)
        };
        let (left, right) = (
            column.saturating_sub(1),
            (column + 1).min(self.width_px - 1),
        );
        let (up, down) = (row.saturating_sub(1), (row + 1).min(self.height_px - 1));
        [
            self.sight(column, row),
            slope(at(left, row), at(right, row), (right - left).max(1) as f64),
            slope(at(column, up), at(column, down), (down - up).max(1) as f64),
        ]
    }
}
