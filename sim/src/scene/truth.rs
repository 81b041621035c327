//! The analytic stripe: where the sheet's middle plane meets the surfaces, projected.
//!
//! Independent of the rasteriser: closed form per column and height, then three tests
//! (the surface there has that height, the camera sees it, the fan reaches it).

use super::frame_poses::FramePoses;
use super::rays::Sight;
use super::sheet::Light;
use super::solid::{Hit, Surface};
use super::{Pose6, Renderer};

/// Columns from a step within which blur and the sheet's thickness mix both sides.
pub const NEAR_STEP_PX: f64 = 8.0;

/// One point of the stripe's centre line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColumnTruth {
    /// Column \[px\].
    pub column_px: u32,
    /// Row of the centre line \[px\], 0 = centre of the top row.
    pub row_px: f64,
    /// Where it lies.
    pub surface: Surface,
    /// Laser plane, to port \[m\].
    pub xi_m: f64,
    /// Laser plane, up \[m\].
    pub eta_m: f64,
    /// Columns to the nearest step, occlusion or end of the fan on this surface \[px\].
    pub step_distance_px: f64,
    /// Closer than [`NEAR_STEP_PX`] to one, or with another surface within 3 sigma of the sheet's thickness.
    pub near_step: bool,
}

impl Renderer {
    /// The stripe's centre line for every column, columns ascending, rows ascending within one.
    ///
    /// A column may hold no point (outside the fan, hidden) or several (both sides of a step are seen).
    /// Interlaced: the mean of both fields, which is where the centre of both together lies.
    pub fn profile_truth(&self, poses: &FramePoses) -> Vec<ColumnTruth> {
        if self.is_straight() {
            self.profile_by(poses, |pose| self.view(pose))
        } else {
            self.profile_by(poses, |pose| self.refracted_view(pose))
        }
    }

    fn profile_by<S: Sight>(
        &self,
        poses: &FramePoses,
        sight: impl Fn(&Pose6) -> S,
    ) -> Vec<ColumnTruth> {
        let still = poses.still().map(&sight);
        // Once per frame: it takes a tangent and a logarithm.
        let still_light = still.as_ref().map(|view| self.light(view));
        let mut points = Vec::with_capacity(self.width_px + 16);
        let levels: Vec<(f64, Surface)> = self.solid.levels().collect();
        // A fan that ends just outside the image still cuts the stripe's oblique end inside it:
        // look beyond the borders, keep what is inside.
        let margin = NEAR_STEP_PX.ceil() as i64 + 2;
        for column in -margin..self.width_px as i64 + margin {
            let first = points.len();
            for &(height_m, surface) in &levels {
                let point = match &still_light {
                    Some(light) => self.point(light, column, height_m, surface),
                    None => {
                        let view = self.sight_at_stripe(poses, &sight, column, height_m);
                        view.and_then(|v| self.point(&self.light(&v), column, height_m, surface))
                    }
                };
                points.extend(point.map(|p| (column, p)));
            }
            points[first..].sort_by(|a: &(i64, ColumnTruth), b| a.1.row_px.total_cmp(&b.1.row_px));
        }
        self.mark_steps(&mut points, margin);
        let inside = |p: &(i64, ColumnTruth)| (0..self.width_px as i64).contains(&p.0);
        points.into_iter().filter(inside).map(|p| p.1).collect()
    }

    /// The view of the very row that shows this column's stripe at this height.
    fn sight_at_stripe<S: Sight>(
        &self,
        poses: &FramePoses,
        sight: &impl Fn(&Pose6) -> S,
        column: i64,
        height_m: f64,
    ) -> Option<S> {
        let mut row = self.height_px as f64 / 2.0;
        // The stripe moves by some thousandths of a row from one row to the next: a quick fixed point.
        for _ in 0..6 {
            let view = sight(&poses.at_row(row));
            row = view.row_of(column as f64, height_m, 0.0)?.0;
        }
        Some(sight(&poses.at_row(row)))
    }

    fn point<S: Sight>(
        &self,
        light: &Light<'_, S>,
        column: i64,
        height_m: f64,
        surface: Surface,
    ) -> Option<ColumnTruth> {
        let view = light.view;
        let u = column as f64;
        let (row_px, t) = view.row_of(u, height_m, 0.0)?;
        if !(-0.5..=self.height_px as f64 - 0.5).contains(&row_px) {
            return None;
        }
        let seen = |row: f64| self.solid.first_hit(&view.line(&view.ray(u, row)));
        let same = |hit: Option<Hit>| hit.is_some_and(|h| h.surface == surface && !h.face);
        let hit = seen(row_px)?;
        if !same(Some(hit)) || (hit.t - t).abs() > 1e-9 * t {
            return None;
        }
        let ray = view.ray(u, row_px);
        let line = view.line(&ray);
        let [fan_y, fan_z] = view.fan(&ray, t);
        let point = std::array::from_fn(|i| line.origin[i] + t * line.direction[i]);
        if !light.reaches(fan_y, fan_z, point) {
            return None;
        }
        // Across the sheet's thickness the same surface must be seen, or the stripe's centre is not its middle.
        let sigma_m = self.optics.sheet_sigma_m;
        let whole = [-3.0, -1.5, 1.5, 3.0].iter().all(|k| {
            view.row_of(u, height_m, k * sigma_m)
                .is_some_and(|(row, _)| same(seen(row)))
        });
        Some(ColumnTruth {
            column_px: column as u32,
            row_px,
            surface,
            xi_m: -fan_y,
            eta_m: self.h_centre_m - fan_z,
            step_distance_px: f64::INFINITY,
            near_step: !whole,
        })
    }

    /// Distance along each surface's unbroken run of columns to its ends; where the search itself ends is no step.
    fn mark_steps(&self, points: &mut [(i64, ColumnTruth)], margin: i64) {
        let searched = -margin..self.width_px as i64 + margin;
        let beside = |points: &[(i64, ColumnTruth)], column: i64, surface: Surface| {
            let from = points.partition_point(|p| p.0 < column);
            let there = points[from..].iter().take_while(|p| p.0 == column);
            there.map(|p| p.1).find(|p| p.surface == surface)
        };
        // Sweep in both directions, carrying the distance from the last break of the same surface.
        for forward in [true, false] {
            for n in 0..points.len() {
                let i = if forward { n } else { points.len() - 1 - n };
                let (column, own) = points[i];
                let before = column + if forward { -1 } else { 1 };
                let distance = if !searched.contains(&before) {
                    f64::INFINITY
                } else {
                    beside(points, before, own.surface).map_or(0.5, |p| p.step_distance_px + 1.0)
                };
                points[i].1.step_distance_px = distance.min(own.step_distance_px);
            }
        }
        for (_, p) in points {
            p.near_step |= p.step_distance_px < NEAR_STEP_PX;
        }
    }
}
