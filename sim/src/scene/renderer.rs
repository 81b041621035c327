//! From a pose to 8-bit pixels.
//!
//! 1. Per column, the rows that can see the sheet within 4.5 sigma at any of the scene's
//!    heights (closed form); nothing else is traced.
//! 2. Per pixel there, the pixel integral by 2 x 2 Gauss points (error of a stripe of
//!    sigma >= 1 px: < 1e-3 of its peak, odd part zero); where the rays of a pixel or of
//!    its neighbours end at different things, 89 points of a Fibonacci lattice instead.
//! 3. Point spread, ambient, lens, noise, tone curve, range, rounding (`exposure`, `noise`).
//!
//! Work is cut into strips of columns, then into blocks of rows; each pixel's value
//! depends on the pose, seed and frame index alone, not on the number of threads.

use std::ops::Range;

use super::exposure::Exposure;
use super::frame_poses::{Field, FramePoses};
use super::lens::Lens;
use super::noise::Noise;
use super::rays::{Sight, View};
use super::refracted::RefractedView;
use super::sheet::{CUT_SIGMA, Code, Light, far_m};
use super::solid::Solid;
use super::speckle::Speckle;
use super::{Pose6, SceneError, psf};
use crate::effect::{EffectStack, Optics};
use hydroline_rigs::Rig;
use rayon::prelude::*;

/// Columns per strip.
const STRIP_PX: usize = 48;
/// Rows per block of the noise pass.
const BLOCK_PX: usize = 16;
/// Gauss-Legendre: +-1/(2 sqrt 3) of a pixel.
const GAUSS_PX: f64 = 0.288_675_134_594_812_9;
/// Fibonacci lattice for edge pixels: 89 points with generator 55. A prime number of points, so that
/// none lie behind each other along a diagonal: 55 points with generator 34 stand on five lines
/// there (55 and 34 − 1 share 11), and an edge along the diagonal, which meets all of its pixels
/// alike, was off by up to a tenth of a pixel all along.
const LATTICE: usize = 89;
const LATTICE_STEP: usize = 55;
/// Grey levels that never show in 8 bits.
const DARK: f32 = 0.02;

/// Row-major 8-bit grey levels.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GreyPixels(pub Vec<u8>);

/// Renders one rig's images.
#[derive(Debug, Clone)]
pub struct Renderer {
    pub(super) optics: Optics,
    pub(super) solid: Solid,
    pub(super) target_origin: [f64; 3],
    pub(super) shadows: bool,
    pub(super) width_px: usize,
    pub(super) height_px: usize,
    pub(super) kernel: Vec<f32>,
    pub(super) noise: Noise,
    pub(super) h_centre_m: f64,
    pub(super) speckle: Option<Speckle>,
}

/// Laser light of some columns, after the point spread.
struct Strip {
    first_column: usize,
    first_row: usize,
    rows: usize,
    /// Column-major grey levels.
    light: Vec<f32>,
}

impl Renderer {
    /// Prepares a rig, with the measurement effects that it switches on.
    ///
    /// # Errors
    /// [`SceneError`] naming the number, slab or effect that cannot be rendered.
    pub fn new(rig: &Rig) -> Result<Self, SceneError> {
        let optics = EffectStack::build(&rig.physics)?.optics(Optics::new(rig));
        Self::with_optics(rig, optics)
    }

    /// Prepares a rig whose light takes another way than the rig file says.
    ///
    /// # Errors
    /// As [`Renderer::new`].
    pub fn with_optics(rig: &Rig, optics: Optics) -> Result<Self, SceneError> {
        let camera = &rig.camera;
        in_range(
            "camera width [px]",
            f64::from(camera.width_px),
            1.0,
            16384.0,
        )?;
        in_range(
            "camera height [px]",
            f64::from(camera.height_px),
            1.0,
            16384.0,
        )?;
        in_range("camera.fx_px", optics.focal_px[0], 1.0, 1e6)?;
        in_range("camera.fy_px", optics.focal_px[1], 1.0, 1e6)?;
        in_range("camera.cx_px", optics.centre_px[0], -1e6, 1e6)?;
        in_range("camera.cy_px", optics.centre_px[1], -1e6, 1e6)?;
        in_range("camera.noise.blur_px", camera.noise.blur_px, 0.0, 20.0)?;
        in_range("camera.noise.read_sd", camera.noise.read_sd, 0.0, 255.0)?;
        in_range("camera.noise.shot_gain", camera.noise.shot_gain, 0.0, 100.0)?;
        in_range("camera.noise.ambient", camera.noise.ambient, 0.0, 255.0)?;
        in_range("laser.sigma_m", optics.sheet_sigma_m, 1e-5, 0.1)?;
        in_range("laser fan / 2 [rad]", optics.half_fan_rad, 1e-3, 1.56)?;
        in_range("laser.peak", optics.peak, 0.0, 1e5)?;
        in_range("target scale", optics.target_scale, 0.1, 10.0)?;
        in_range("floor slope", optics.floor_slope, -1.0, 1.0)?;
        in_range("camera tilt [rad]", optics.camera_tilt_rad, -1.6, 3.2)?;
        for k in optics.distortion {
            in_range("lens distortion", k, -2.0, 2.0)?;
        }
        in_range("n_water", optics.n_water, 1.0, 2.0)?;
        in_range("port_m", optics.port_m, 0.0, 10.0)?;
        in_range("n_water of the laser's port", optics.cone_n_water, 1.0, 2.0)?;
        in_range("sine of the fan's tilt", optics.cone_sin, -0.9, 0.9)?;
        in_range("haze fraction", optics.haze_fraction, 0.0, 1.0)?;
        in_range("haze length [m]", optics.haze_length_m, 1e-4, 10.0)?;
        in_range("speckle contrast", optics.speckle_contrast, 0.0, 10.0)?;
        in_range("speckle grain [px]", optics.speckle_grain_px, 0.05, 1000.0)?;
        in_range("attenuation [1/m]", optics.attenuation_pm, 0.0, 1000.0)?;
        let b = &optics.brightness;
        in_range("loss at the ends of the fan", b.line_end_loss, 0.0, 1.0)?;
        in_range("tilt of the fan's light", b.line_tilt, -2.0, 2.0)?;
        in_range("loss in the image's corner", b.corner_loss, 0.0, 1.0)?;
        for rise in b.ambient_rise_grey {
            in_range("rise of the background [grey levels]", rise, -255.0, 255.0)?;
        }
        in_range(
            "levels of the bands [grey levels]",
            b.banding_grey,
            0.0,
            255.0,
        )?;
        in_range("mains frequency [Hz]", b.mains_hz, 1.0, 1000.0)?;
        in_range("row time of the bands [s]", b.banding_row_s, 0.0, 1e-3)?;
        in_range(
            "phase of the bands [rad]",
            b.banding_phase_rad,
            -1000.0,
            1000.0,
        )?;
        in_range("gamma", b.gamma, 0.1, 10.0)?;
        for [floor, ceiling] in [b.scaled_grey, b.clipped_grey] {
            in_range("ceiling of the grey levels", ceiling, 1.0, 255.0)?;
            in_range("floor of the grey levels", floor, 0.0, ceiling)?;
        }
        for what in optics.camera_m.iter().chain([
            &optics.l_laser_m,
            &optics.sheet_tan_pitch,
            &optics.sheet_tan_yaw,
        ]) {
            in_range("mount or sheet", *what, -100.0, 100.0)?;
        }
        Ok(Renderer {
            solid: Solid::new(rig.target.as_ref(), optics.target_scale)?,
            target_origin: rig.target.as_ref().map_or([0.0; 3], |t| t.origin),
            shadows: rig.laser.shadows,
            width_px: camera.width_px as usize,
            height_px: camera.height_px as usize,
            kernel: psf::kernel(camera.noise.blur_px),
            noise: Noise::new(&camera.noise, camera.seed, optics.saturation)
                .under(Exposure::new(&optics, camera)),
            h_centre_m: rig.mounts.h_centre_m,
            speckle: Speckle::new(
                optics.speckle_contrast,
                optics.speckle_grain_px,
                camera.seed,
            ),
            optics,
        })
    }

    /// Image width \[px\].
    pub fn width_px(&self) -> usize {
        self.width_px
    }

    /// Image height \[px\].
    pub fn height_px(&self) -> usize {
        self.height_px
    }

    /// Whether rays and sheet are straight, so that everything along a ray is linear in its pixel.
    pub(super) fn is_straight(&self) -> bool {
        Lens::is_pinhole(&self.optics) && self.optics.cone_sin == 0.0
    }

    pub(super) fn view(&self, pose: &Pose6) -> View {
        View::new(&self.optics, self.target_origin, pose)
    }

    pub(super) fn refracted_view(&self, pose: &Pose6) -> RefractedView {
        RefractedView::new(&self.optics, self.target_origin, pose)
    }

    pub(super) fn light<'a, S: Sight>(&'a self, view: &'a S) -> Light<'a, S> {
        Light::new(view, &self.solid, &self.optics, self.shadows)
    }

    /// One frame: row-major 8-bit grey levels.
    pub fn render(&self, pose: &Pose6, frame_index: u64) -> GreyPixels {
        let mut pixels = vec![0; self.width_px * self.height_px];
        self.render_into(pose, frame_index, &mut pixels);
        GreyPixels(pixels)
    }

    /// One frame into a buffer of width x height bytes (a shorter or longer one is filled as far as it goes).
    pub fn render_into(&self, pose: &Pose6, frame_index: u64, pixels: &mut [u8]) {
        self.render_frame_into(&FramePoses::from(*pose), frame_index, pixels);
    }

    /// One frame whose rows may show different times ([`crate::World::frame_poses`]): row-major 8-bit grey levels.
    pub fn render_frame(&self, poses: &FramePoses, frame_index: u64) -> GreyPixels {
        let mut pixels = vec![0; self.width_px * self.height_px];
        self.render_frame_into(poses, frame_index, &mut pixels);
        GreyPixels(pixels)
    }

    /// As [`Renderer::render_frame`], into a buffer (see [`Renderer::render_into`]).
    pub fn render_frame_into(&self, poses: &FramePoses, frame_index: u64, pixels: &mut [u8]) {
        let fields: Vec<Vec<Strip>> = poses.fields().iter().map(|f| self.strips(f)).collect();
        self.develop(frame_index, pixels, |row, line| {
            // Two fields: even and odd rows.
            if let Some(strips) = fields.get(row % fields.len().max(1)) {
                self.lay_strips(strips, frame_index, row, line);
            }
        });
    }

    /// Laser light alone: grey levels without ambient, noise, rounding or saturation, nor what lens and camera make of them, row-major.
    pub fn render_clean(&self, pose: &Pose6) -> Vec<f32> {
        let mut picture = vec![0.0; self.width_px * self.height_px];
        for strip in self.strips(&Field::Still(*pose)) {
            for (i, column) in strip.light.chunks_exact(strip.rows.max(1)).enumerate() {
                for (j, &light) in column.iter().enumerate() {
                    picture[(strip.first_row + j) * self.width_px + strip.first_column + i] = light;
                }
            }
        }
        picture
    }

    /// Dark noise everywhere, then `lay(row, pixels of the row)`.
    pub(super) fn develop(
        &self,
        frame_index: u64,
        pixels: &mut [u8],
        lay: impl Fn(usize, &mut [u8]) + Sync,
    ) {
        pixels
            .par_chunks_mut(self.width_px * BLOCK_PX)
            .enumerate()
            .for_each(|(block, lines)| {
                for (i, line) in lines.chunks_mut(self.width_px).enumerate() {
                    let row = block * BLOCK_PX + i;
                    self.noise.dark_row(frame_index, row, line);
                    lay(row, line);
                }
            });
    }

    fn lay_strips(&self, strips: &[Strip], frame_index: u64, row: usize, line: &mut [u8]) {
        for strip in strips {
            let Some(at) = row
                .checked_sub(strip.first_row)
                .filter(|&at| at < strip.rows)
            else {
                continue;
            };
            for (i, column) in strip.light.chunks_exact(strip.rows).enumerate() {
                let light = column[at];
                if light > 0.0 {
                    let c = strip.first_column + i;
                    let light = match &self.speckle {
                        Some(speckle) => light * speckle.factor(frame_index, row, c),
                        None => light,
                    };
                    if let Some(pixel) = line.get_mut(c) {
                        *pixel = self.noise.pixel(frame_index, row, c, self.width_px, light);
                    }
                }
            }
        }
    }

    fn strips(&self, field: &Field) -> Vec<Strip> {
        if self.is_straight() {
            self.strips_by(field, |pose| self.view(pose))
        } else {
            self.strips_by(field, |pose| self.refracted_view(pose))
        }
    }

    fn strips_by<S: Sight>(&self, field: &Field, sight: impl Fn(&Pose6) -> S) -> Vec<Strip> {
        match field {
            Field::Still(pose) => {
                let view = sight(pose);
                let light = self.light(&view);
                self.traced(&[&view], &|u, v| light.shade(u, v))
            }
            Field::Rows(poses) => {
                let views: Vec<S> = poses.iter().map(sight).collect();
                let lights: Vec<Light<'_, S>> = views.iter().map(|v| self.light(v)).collect();
                let last = views.len().saturating_sub(1);
                // A ray within a pixel belongs to the pixel's row; the blur's surroundings to the nearest row.
                let shade =
                    |u: f64, v: f64| lights[(v.round().max(0.0) as usize).min(last)].shade(u, v);
                let few = [&views[0], &views[last / 2], &views[last]];
                self.traced(&few, &shade)
            }
        }
    }

    /// `views`: one, or the first, middle and last of those that `shade` takes.
    fn traced<S: Sight>(
        &self,
        views: &[&S],
        shade: &(impl Fn(f64, f64) -> (Code, f64) + Sync),
    ) -> Vec<Strip> {
        let starts: Vec<usize> = (0..self.width_px).step_by(STRIP_PX).collect();
        starts
            .par_iter()
            .map(|&first| self.strip(views, shade, first))
            .collect()
    }

    /// Light of the columns `first ..`; the point spread's surroundings are traced too, even outside the image.
    fn strip<S: Sight>(
        &self,
        views: &[&S],
        shade: &impl Fn(f64, f64) -> (Code, f64),
        first: usize,
    ) -> Strip {
        let margin = self.kernel.len() / 2;
        let columns = STRIP_PX.min(self.width_px - first);
        let bands: Vec<Vec<Range<i64>>> = (0..columns + 2 * margin)
            .map(|i| self.bands(views, (first + i) as f64 - margin as f64))
            .collect();
        let low = bands.iter().flatten().map(|b| b.start).min().unwrap_or(0);
        let high = bands.iter().flatten().map(|b| b.end).max().unwrap_or(0);
        let (low, high) = (low - margin as i64, high + margin as i64);
        let rows = (high - low).max(0) as usize;

        let hazy = self.optics.haze_fraction > 0.0;
        let mut picture = vec![0.0f32; rows * bands.len()];
        let mut codes = vec![Code::NONE; rows * bands.len()];
        for (i, column) in bands.iter().enumerate() {
            let u = (first + i) as f64 - margin as f64;
            for row in column.iter().flat_map(Range::clone) {
                let at = i * rows + (row - low) as usize;
                (codes[at], picture[at]) = gauss(shade, u, row as f64);
                if hazy {
                    picture[at] = fine(shade, u, row as f64);
                }
            }
        }
        let mut refined: Vec<(usize, f32)> = Vec::new();
        for (i, column) in bands.iter().enumerate() {
            let u = (first + i) as f64 - margin as f64;
            for row in column.iter().flat_map(Range::clone) {
                let at = i * rows + (row - low) as usize;
                if is_edge(&codes, at, rows) && is_lit(&picture, at, rows) {
                    refined.push((at, lattice(shade, u, row as f64)));
                }
            }
        }
        for (at, light) in refined {
            picture[at] = light;
        }
        let blurred = psf::blur(&picture, rows.max(1), &self.kernel);
        let inside = low.clamp(0, self.height_px as i64)..high.clamp(0, self.height_px as i64);
        let kept = (inside.end - inside.start) as usize;
        let skip = (inside.start - low) as usize;
        let light = if kept == 0 {
            Vec::new()
        } else {
            blurred
                .chunks_exact(rows)
                .flat_map(|c| c[skip..skip + kept].iter().copied())
                .collect()
        };
        Strip {
            first_column: first,
            first_row: inside.start as usize,
            rows: kept,
            light,
        }
    }

    /// Rows of column `u` that can see the sheet within reach, disjoint and ascending.
    fn bands<S: Sight>(&self, views: &[&S], u: f64) -> Vec<Range<i64>> {
        let margin = (self.kernel.len() / 2) as i64;
        let all = -margin..self.height_px as i64 + margin;
        let reach_m = CUT_SIGMA * self.optics.sheet_sigma_m;
        let far_m = far_m(&self.optics);
        // Between the poses of a rolling shutter's first, middle and last row the stripe moves evenly, but not quite.
        let slack = if views.len() > 1 { 2 } else { 0 };
        let mut bands: Vec<Range<i64>> = Vec::new();
        for (level, (height_m, surface)) in self.solid.levels().enumerate() {
            let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
            let mut area = [
                f64::INFINITY,
                f64::NEG_INFINITY,
                f64::INFINITY,
                f64::NEG_INFINITY,
            ];
            let mut near = false;
            let mut open = false;
            for (view, (du, off_m)) in views.iter().flat_map(|view| {
                let corners = [
                    (-0.5, -reach_m),
                    (-0.5, far_m),
                    (0.5, -reach_m),
                    (0.5, far_m),
                ];
                corners.map(|corner| (view, corner))
            }) {
                let Some((row, t)) = view.row_of(u + du, height_m, off_m) else {
                    open = true;
                    continue;
                };
                let [x, y] = view.line(&view.ray(u + du, row)).xy(t);
                near |= self.solid.near(surface, [x, y], 0.005 + 2.0 * far_m);
                area = [
                    area[0].min(x),
                    area[1].max(x),
                    area[2].min(y),
                    area[3].max(y),
                ];
                (low, high) = (low.min(row), high.max(row));
            }
            // A millimetre more, so that a pixel beside an edge is never left out.
            let area = [
                area[0] - 0.001,
                area[1] + 0.001,
                area[2] - 0.001,
                area[3] + 0.001,
            ];
            if open && low.is_finite() {
                // Part of the column looks past this height: no closed form for where the light ends.
                bands.push(all.clone());
            } else if near && !self.solid.buried(level, area) {
                let (low, high) = (
                    low.floor() as i64 - 1 - slack,
                    high.ceil() as i64 + 2 + slack,
                );
                let band = low.max(all.start)..high.min(all.end);
                if band.start < band.end {
                    bands.push(band);
                }
            }
        }
        bands.sort_by_key(|b| b.start);
        let mut merged: Vec<Range<i64>> = Vec::with_capacity(bands.len());
        for band in bands {
            match merged.last_mut() {
                Some(last) if band.start <= last.end => last.end = last.end.max(band.end),
                _ => merged.push(band),
            }
        }
        merged
    }
}

/// Mean over a pixel by 2 x 2 Gauss points; MIXED when they end at different things.
pub(super) fn gauss(shade: &impl Fn(f64, f64) -> (Code, f64), u: f64, v: f64) -> (Code, f32) {
    let mut sum = 0.0;
    let mut code = Code::NONE;
    for (du, dv) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
        let (ray, light) = shade(u + du * GAUSS_PX, v + dv * GAUSS_PX);
        sum += light;
        code = code.joined(ray);
    }
    (code, (sum / 4.0) as f32)
}

/// Mean over a pixel by 2 Gauss points across and 8 midpoints down: the haze jumps where the sheet's middle is.
fn fine(shade: &impl Fn(f64, f64) -> (Code, f64), u: f64, v: f64) -> f32 {
    let sum: f64 = (0..8)
        .flat_map(|i| {
            let dv = (f64::from(i) + 0.5) / 8.0 - 0.5;
            [-GAUSS_PX, GAUSS_PX].map(|du| shade(u + du, v + dv).1)
        })
        .sum();
    (sum / 16.0) as f32
}

/// Mean over a pixel by the Fibonacci lattice.
pub(super) fn lattice(shade: &impl Fn(f64, f64) -> (Code, f64), u: f64, v: f64) -> f32 {
    let n = LATTICE as f64;
    let sum: f64 = (0..LATTICE)
        .map(|i| {
            let a = (i as f64 + 0.5) / n - 0.5;
            let b = ((i * LATTICE_STEP % LATTICE) as f64 + 0.5) / n - 0.5;
            shade(u + b, v + a).1
        })
        .sum();
    (sum / n) as f32
}

/// Whether a pixel or the step to one of its four neighbours crosses an edge.
pub(super) fn is_edge(codes: &[Code], at: usize, rows: usize) -> bool {
    let own = codes[at];
    let row = at % rows;
    let differs = |i: Option<usize>| {
        i.and_then(|i| codes.get(i))
            .is_some_and(|&c| c.differs(own))
    };
    own == Code::MIXED
        || differs(at.checked_sub(rows))
        || differs(Some(at + rows))
        || (row > 0 && differs(at.checked_sub(1)))
        || (row + 1 < rows && differs(Some(at + 1)))
}

/// Whether a pixel or one of its four neighbours has light worth refining: an edge between dark things does not show.
fn is_lit(picture: &[f32], at: usize, rows: usize) -> bool {
    let lit = |i: Option<usize>| i.and_then(|i| picture.get(i)).is_some_and(|&v| v > DARK);
    lit(Some(at))
        || lit(at.checked_sub(rows))
        || lit(Some(at + rows))
        || lit(at.checked_sub(1))
        || lit(Some(at + 1))
}

fn in_range(what: &'static str, value: f64, low: f64, high: f64) -> Result<(), SceneError> {
    // Written so that NaN fails.
    if (low..=high).contains(&value) {
        Ok(())
    } else {
        Err(SceneError::Range {
            what,
            value,
            low,
            high,
        })
    }
}

#[cfg(test)]
mod tests;
