//! Points of the laser sheet that the pixels see, as a table: the map is evaluated once per pixel, not once per frame.

use hydroline_calib::plane::PlaneMap;
use hydroline_rigs::{Camera, Mounts};
use nalgebra::{Rotation3, Vector3};
use std::sync::Arc;

/// Sheet points of all pixels, seen from the camera.
#[derive(Debug, Clone)]
pub struct SheetTable {
    /// Image width \[px\].
    pub width_px: usize,
    /// Image height \[px\].
    pub height_px: usize,
    /// y and z of the way from the camera to each pixel's sheet point, body frame \[m\], column by
    /// column (a stripe is looked at along columns); NaN where the map is not defined.
    sights_m: Vec<[f64; 2]>,
    /// Of each pixel whether the map is defined there and beside it.
    sound: Arc<[bool]>,
    /// Camera in the body frame \[m\].
    pub eye_m: Vector3<f64>,
    /// CG to the sheet, forward \[m\].
    pub l_laser_m: f64,
    /// Camera to the sheet, forward \[m\]: x of every sight.
    pub lever_m: f64,
}

/// d(sight's y, z) per column and per row \[m/px\] over the rows of a strip, linear between its ends.
#[derive(Debug, Clone, Copy)]
pub(super) struct Slopes {
    first_row: f64,
    at_first: [[f64; 2]; 2],
    per_row: [[f64; 2]; 2],
}

impl Slopes {
    /// At a row: along columns, along rows.
    pub fn at(&self, row: usize) -> [[f64; 2]; 2] {
        let u = row as f64 - self.first_row;
        std::array::from_fn(|k| {
            std::array::from_fn(|i| self.at_first[k][i] + u * self.per_row[k][i])
        })
    }
}

impl SheetTable {
    /// Tabulates a map for a camera on its mounts. The effective ray of a pixel runs from the
    /// camera through the sheet point that the map names: exact for a pinhole, and for a
    /// camera behind a port right in the sheet itself and to first order beside it.
    pub fn new(map: &dyn PlaneMap, camera: &Camera, mounts: &Mounts) -> Self {
        let (width_px, height_px) = (camera.width_px as usize, camera.height_px as usize);
        let eye_m = hydroline_calib::frames::camera_position_m(mounts);
        let mut sights_m = Vec::with_capacity(width_px * height_px);
        for column in 0..width_px {
            for row in 0..height_px {
                let p = map.to_plane(column as f64, row as f64);
                sights_m.push(p.map_or([f64::NAN; 2], |p| {
                    [-p.xi_m - eye_m.y, mounts.h_centre_m - p.eta_m - eye_m.z]
                }));
            }
        }
        let mut table = SheetTable {
            width_px,
            height_px,
            sights_m,
            sound: Arc::default(),
            eye_m,
            l_laser_m: mounts.l_laser_m,
            lever_m: mounts.l_laser_m - eye_m.x,
        };
        let places = (0..width_px).flat_map(|c| (0..height_px).map(move |r| (c, r)));
        table.sound = places
            .map(|(column, row)| {
                let [a, b] = table.slopes(column, row);
                (a[0] + a[1] + b[0] + b[1] + table.sight(column, row)[0]).is_finite()
            })
            .collect();
        table
    }

    /// The same rays seen from a rotated body frame in which the sheet stands upright `l_laser_m` ahead.
    pub(super) fn rotated(&self, turn: &Rotation3<f64>, l_laser_m: f64) -> SheetTable {
        let eye_m = turn * self.eye_m;
        let lever_m = l_laser_m - eye_m.x;
        let sights = self.sights_m.iter().map(|[y, z]| {
            let ray = turn * Vector3::new(self.lever_m, *y, *z);
            let reach = lever_m / ray.x;
            [ray.y * reach, ray.z * reach]
        });
        SheetTable {
            sights_m: sights.collect(),
            sound: self.sound.clone(),
            eye_m,
            l_laser_m,
            lever_m,
            width_px: self.width_px,
            height_px: self.height_px,
        }
    }

    /// From the camera to a pixel's sheet point: y, z in the body frame \[m\]; NaN where there is none.
    pub fn sight(&self, column: usize, row: usize) -> [f64; 2] {
        self.sights_m
            .get(column * self.height_px + row)
            .copied()
            .unwrap_or([f64::NAN; 2])
    }

    /// The same for the rows `first..end` of a column; empty outside the image.
    pub(super) fn sights(&self, column: usize, first: usize, end: usize) -> &[[f64; 2]] {
        let from = column * self.height_px;
        self.sights_m
            .get(from + first..from + end.min(self.height_px))
            .unwrap_or(&[])
    }

    /// Derivatives of a sight along columns and rows \[m/px\].
    pub(super) fn slopes(&self, column: usize, row: usize) -> [[f64; 2]; 2] {
        let (left, right) = (
            column.saturating_sub(1),
            (column + 1).min(self.width_px - 1),
        );
        let (up, down) = (row.saturating_sub(1), (row + 1).min(self.height_px - 1));
        let per_px = |a: [f64; 2], b: [f64; 2], px: usize| {
            let px = px.max(1) as f64;
            [(b[0] - a[0]) / px, (b[1] - a[1]) / px]
        };
        [
            per_px(self.sight(left, row), self.sight(right, row), right - left),
            per_px(self.sight(column, up), self.sight(column, down), down - up),
        ]
    }

    /// First and last of the rows `first..end` of a column in which the map is defined.
    pub(super) fn sound_rows(&self, column: usize, first: usize, end: usize) -> Option<[usize; 2]> {
        let sound = |row: &usize| self.sound.get(column * self.height_px + row) == Some(&true);
        let from = (first..end).find(sound)?;
        Some([from, (from..end).rev().find(sound)?])
    }

    /// Slopes over the rows `first..end` of a column: their curvature is less than 1e-4 over a stripe.
    /// `None` where the map is defined nowhere in them.
    pub(super) fn slopes_over(&self, column: usize, first: usize, end: usize) -> Option<Slopes> {
        let [from, to] = self.sound_rows(column, first, end)?;
        let (at_first, at_last) = (self.slopes(column, from), self.slopes(column, to));
        let rows = (to - from).max(1) as f64;
        Some(Slopes {
            first_row: from as f64,
            at_first,
            per_row: std::array::from_fn(|k| {
                std::array::from_fn(|i| (at_last[k][i] - at_first[k][i]) / rows)
            }),
        })
    }
}
