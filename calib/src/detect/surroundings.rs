//! What lies around a node besides its pattern: markers, the other line of a crossing, the rest of a dot.

use nalgebra::{Matrix2, SVector};

use super::marks::Local;
use super::refine::{PATCH_PITCH, Refiner};
use crate::charuco::Markers;

/// Distance in blurs from a marker's bits at which hardly any of them is left.
const CLEAR_OF_BITS: f64 = 1.5;
/// A crossing's arms are at least so wide to either side \[px\]: less shows no rim.
const NARROWEST_PX: f64 = 1.0;

impl Refiner<'_> {
    /// Half width in pitches of the arms of a corner that no marker's bits reach; infinite on boards without.
    pub fn clear_of_marker(&self, m: &Matrix2<f64>) -> f64 {
        let Some(markers) = Markers::of(self.board) else {
            return f64::INFINITY;
        };
        let per_px = m.row(0).norm().max(m.row(1).norm());
        let blur_px = self.blur_px[0].max(self.blur_px[1]);
        (markers.first_bit() - CLEAR_OF_BITS * blur_px * per_px).max(NARROWEST_PX * per_px)
    }

    /// Whether both lines of a crossing are there: each gets an amplitude of its own. A
    /// point on a single line fits the crossing nearly as well as a crossing does.
    pub fn both_lines(
        &self,
        pixels: &[[f64; 5]],
        theta: &SVector<f64, 6>,
        m: &Matrix2<f64>,
    ) -> bool {
        let local = Local::new(self.board, m, self.blur_px);
        let shift = m * nalgebra::Vector2::new(theta[4], theta[5]);
        let mut normal_matrix = Matrix2::identity() * 1e-9;
        let mut right = nalgebra::Vector2::zeros();
        for p in pixels {
            let Some(lines) = local.lines(p[2] - shift[0], p[3] - shift[1]) else {
                return true;
            };
            let row = nalgebra::Vector2::from(lines);
            let rest = p[4] - theta[0] - theta[1] * p[0] - theta[2] * p[1];
            normal_matrix += row * row.transpose();
            right += row * rest;
        }
        normal_matrix.try_inverse().is_some_and(|inverse| {
            let each = inverse * right / theta[3];
            each.min() > 0.45 && each.max() < 1.8
        })
    }

    /// Middle of what is dark around a start: the filter answers on the rim of a large dot.
    pub fn centroid(&self, start: [f64; 2], steps: [[f64; 2]; 2]) -> Option<[f64; 2]> {
        let m = Matrix2::new(steps[0][0], steps[1][0], steps[0][1], steps[1][1]).try_inverse()?;
        let half = |k: usize| (PATCH_PITCH * (steps[0][k].abs() + steps[1][k].abs())) as i64;
        let (hc, hr) = (half(0).min(40), half(1).min(40));
        let mut at = start;
        // Of a large dot every fourth pixel: a tenth of a pixel is good enough here.
        let sparse = if hc.max(hr) > 8 { 2 } else { 1 };
        for _ in 0..2 {
            let middle = [at[0].round() as i64, at[1].round() as i64];
            let rows = || (middle[1] - hr..=middle[1] + hr).step_by(sparse);
            let columns = || (middle[0] - hc..=middle[0] + hc).step_by(sparse);
            let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
            for r in rows() {
                for c in columns() {
                    let v = self.image.at(c, r);
                    low = low.min(v);
                    high = high.max(v);
                }
            }
            let threshold = 0.5 * (low + high);
            let (mut sum, mut count) = ([0.0; 2], 0.0);
            for r in rows() {
                for c in columns() {
                    // Most of a patch is face: asked for first.
                    if self.image.at(c, r) >= threshold {
                        continue;
                    }
                    let (x, y) = (c as f64 - at[0], r as f64 - at[1]);
                    let u = m * nalgebra::Vector2::new(x, y);
                    if u.amax() < PATCH_PITCH {
                        sum[0] += x;
                        sum[1] += y;
                        count += 1.0;
                    }
                }
            }
            if count > 3.0 {
                at = [at[0] + sum[0] / count, at[1] + sum[1] / count];
            }
        }
        Some(at)
    }
}
