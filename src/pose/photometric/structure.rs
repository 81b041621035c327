//! Residuals of the line that hang together along it: what tells a model that does not hold from noise.
//!
//! Grain of laser light on a rough face is noise, however strong: residuals a few columns apart have nothing to do with each
//! other, and the sds that follow from their size are right. Haze, particles, and a line that is uneven in itself leave residuals
//! that are alike over columns: there no number of pixels makes the pose better. Looked at only where residuals are large.

use super::lighting::Cell;
use super::pose_geometry::PoseGeometry;
use super::sums::Counter;
use super::{Photometric, Picture, Plan, State, Strip, Tables, Weighting, groups};

/// Columns between which residuals are compared: beyond the point spread and the grain that it makes, within what is a
/// structure of the line.
const LAGS: std::ops::RangeInclusive<usize> = 3..=8;

impl Photometric {
    /// Sd of what lit pixels' residuals away from edges have in common with those some columns on \[levels of light\].
    pub(crate) fn structure_sd(
        &self,
        plan: &Plan,
        picture: &Picture<'_>,
        state: &State,
        weighting: &Weighting,
    ) -> f64 {
        let geometry = PoseGeometry::new(&state.pose, &self.surfaces);
        let mut counter = Counter::new(weighting, Tables::get(), state);
        counter.uneven = picture.lit(&weighting.response);
        let width = self.table.width_px;
        let mut residuals = vec![0.0_f32; picture.pixels.len()];
        for strips in groups(&plan.strips) {
            if strips.iter().any(Strip::cut) {
                continue;
            }
            let cell: Cell = self.cell(plan, strips);
            counter.enter(&cell);
            counter.strips(strips, false);
            let state = &cell.of(state);
            self.each_row(&geometry, plan, state, strips, 0.0, false, |row, light| {
                let at = row * width + strips[0].column;
                let (Some(light), Some(&grey)) = (light, picture.pixels.get(at)) else {
                    return;
                };
                let background = counter.background(state.background, row);
                let mut tally = Default::default();
                let judged = counter.interior::<false>(grey, light.level, background, &mut tally);
                if let Some(judged) = judged.filter(|_| tally.bright_count > 0) {
                    residuals[at] = judged.residual as f32;
                }
            });
        }
        let most = 4.0 * weighting.noise_sd;
        let cut = |r: f32| f64::from(r).clamp(-most, most);
        let (mut product, mut count) = (0.0, 0usize);
        for row in residuals.chunks_exact(width) {
            for lag in LAGS {
                for (a, b) in row.iter().zip(&row[lag.min(width)..]) {
                    if *a != 0.0 && *b != 0.0 {
                        product += cut(*a) * cut(*b);
                        count += 1;
                    }
                }
            }
        }
        (product / count.max(1) as f64).max(0.0).sqrt()
    }
}
