//! The grey levels along the stripe as a closed form of the pose, with derivatives.
//!
//! A pixel's ray meets the upper face at height h at the body point e + t d (e = camera, d = from it to
//! the pixel's sheet point, t = 1 in the sheet), s = (l_laser − e_x)(t − 1) before the sheet. It
//! is lit by A exp(−s²/2σ²) where that point lies on the upper face and in sight. Under a Gaussian point
//! spread (blur and the pixel's own box, variance b² per axis) s and the distance e from an edge
//! are jointly normal about their values at the pixel's centre, so that with S² = σ² + b²|∇s|²
//!
//! light = A (σ/S) exp(−s²/2S²) Φ(e'/τ),  e' = e − s c/S²,  τ² = b²|∇e|² − c²/S²,  c = b² ∇s·∇e
//!
//! and with the bivariate normal in place of Φ where two edges meet. Exact up to the curvature of
//! perspective within one point spread; no sampling, so derivatives along the weak direction
//! (δz = l δθ, δx = −H δθ) are those of the image and not of a lattice.

mod across;
mod edge_model_error;
mod edge_strips;
mod flicker;
mod grid;
mod interior_strips;
mod lanes;
mod lighting;
mod picture;
mod plan;
mod pose_geometry;
mod response;
mod structure;
mod sums;
mod visibility;

pub(crate) use across::ACROSS;
pub use across::LineResiduals;
pub(super) use edge_model_error::EdgeModelError;
pub(crate) use picture::Picture;
pub(super) use plan::{Choice, Plan};
pub(crate) use response::{Response, light_per_grey};
pub(super) use sums::{ByMap, RunParameters, Sums, Weighting};

use super::normal::{Tables, cumulative, density};
use super::outline::Surfaces;
use super::sheet::SheetTable;
use across::Across;
use edge_strips::{Scratch, lit};
use grid::Grid;
use hydroline_calib::Pose;
use hydroline_calib::plane::MapErrors;
use interior_strips::InteriorStrip;
use lighting::Cell;
pub(crate) use lighting::{PRIOR_SD, line_range};
pub use lighting::{UNEVEN, Uneven};
use nalgebra::{SMatrix, SVector};
use plan::{Strip, groups};
use pose_geometry::{PoseGeometry, Ray};
use std::sync::Arc;
use sums::{Counter, EdgeLight, MapMoves};
use visibility::{PixelContext, Sensitivity};

/// x, y, z, φ, θ, ψ, brightness, thickness, background, tone, black, and what the line has [`across`]: what moves a pixel's
/// level.
pub(super) const LOCAL: usize = 11 + ACROSS;
/// The same, and what makes brightness and background [`lighting`] uneven.
pub(super) const PARAMETERS: usize = LOCAL + UNEVEN;
pub(super) const BRIGHTNESS: usize = 6;
pub(super) const THICKNESS: usize = 7;
pub(super) const BACKGROUND: usize = 8;
/// ln γ of the camera's [`response`].
pub(super) const TONE: usize = 9;
/// Its black level \[grey levels\].
pub(super) const BLACK: usize = 10;
/// The first of the line's transverse profile.
pub(super) const LINE: usize = 11;
/// Number of the parameters that all frames of a run share: the camera's response and the line's transverse profile.
pub const OF_RUN: usize = LOCAL - TONE;

/// Light of less than exp(−this) of the line's, 5 standard deviations off, is none.
const DARK: f64 = 12.5;

/// Normal equations' matrix and vectors.
pub(super) type Square = SMatrix<f64, PARAMETERS, PARAMETERS>;
pub(super) type Column = SVector<f64, PARAMETERS>;

/// Pose and light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct State {
    pub pose: Pose,
    /// Grey levels of the line on albedo 1, before the point spread.
    pub brightness: f64,
    /// Sheet's standard deviation \[m\].
    pub thickness_m: f64,
    /// Grey level without laser light.
    pub background: f64,
    /// ln γ of the camera's response.
    pub tone: f64,
    /// Grey level of no light at all.
    pub black: f64,
    /// The line's transverse profile: cₙ of [`across`].
    pub across: [f64; ACROSS],
    /// Change of brightness and background over the image: coefficients of [`lighting`].
    pub uneven: Uneven,
}

impl State {
    /// The same light seen from another pose.
    pub fn at(&self, pose: Pose) -> State {
        let mut there = *self;
        there.pose = pose;
        there
    }

    pub fn moved(&self, step: &Column) -> State {
        let mut pose = self.pose.to_array();
        for (p, d) in pose.iter_mut().zip(step.iter()) {
            *p += d;
        }
        State {
            pose: Pose::from_array(pose),
            brightness: self.brightness + step[BRIGHTNESS],
            thickness_m: self.thickness_m + step[THICKNESS],
            background: self.background + step[BACKGROUND],
            tone: self.tone + step[TONE],
            black: self.black + step[BLACK],
            across: std::array::from_fn(|k| self.across[k] + step[LINE + k]),
            uneven: std::array::from_fn(|k| self.uneven[k] + step[LOCAL + k]),
        }
    }
}

/// The forward model of one rig.
#[derive(Debug, Clone)]
pub(super) struct Photometric {
    pub surfaces: Surfaces,
    pub table: Arc<SheetTable>,
    /// Variance of point spread and pixel box per axis \[px²\].
    spread_px2: f64,
    tan_half_fan: f64,
    /// Edge response where the blur is formed on the pixel grid.
    grid: Arc<Grid>,
    /// Errors that all sights of the table share, where their loadings are wanted.
    map_errors: Arc<MapErrors>,
}

impl Photometric {
    pub fn new(surfaces: Surfaces, table: Arc<SheetTable>, blur_px: f64, fan_rad: f64) -> Self {
        // The pixel's box has variance 1/12 px² per axis.
        let spread_px2 = blur_px * blur_px + 1.0 / 12.0;
        Photometric {
            surfaces,
            table,
            spread_px2,
            tan_half_fan: (0.5 * fan_rad).tan(),
            grid: Arc::new(Grid::new(blur_px)),
            map_errors: Arc::default(),
        }
    }

    /// The same seen by a map that has these errors: comparisons then state what each of them changes.
    pub fn with_map_errors(&self, map_errors: Arc<MapErrors>) -> Self {
        Photometric {
            map_errors,
            ..self.clone()
        }
    }

    /// The same light and target seen otherwise.
    pub fn seen_by(&self, table: Arc<SheetTable>) -> Self {
        Photometric {
            table,
            ..self.clone()
        }
    }

    /// The same camera and light over a bare floor.
    pub fn bare(&self) -> Self {
        Photometric {
            surfaces: Surfaces::new(None),
            ..self.clone()
        }
    }

    /// Where some strips that share their rows lie, as far as light goes.
    fn cell(&self, plan: &Plan, strips: &[Strip]) -> Cell {
        let size_px = (self.table.width_px, self.table.height_px);
        let about = plan.middle_row;
        strips
            .first()
            .map_or(Cell::at([0, 0], about, 0, size_px), |s| {
                Cell::at(
                    [s.column, (s.first_row + s.end_row) / 2],
                    about,
                    s.level,
                    size_px,
                )
            })
    }

    fn height(&self, level: usize) -> f64 {
        self.surfaces.faces.get(level).map_or(0.0, |t| t.height_m)
    }

    fn albedo(&self, level: usize) -> f64 {
        self.surfaces.faces.get(level).map_or(1.0, |t| t.albedo)
    }

    pub fn compare(
        &self,
        plan: &Plan,
        picture: &Picture<'_>,
        state: &State,
        weighting: &Weighting,
        model_error: &mut EdgeModelError,
        derivatives: bool,
    ) -> Sums {
        let geometry = PoseGeometry::new(&state.pose, &self.surfaces);
        let mut counter = Counter::new(weighting, Tables::get(), state);
        let one_cell = weighting.even && picture.uneven.is_none();
        counter.grid_share = model_error.grid_share;
        let grid_share = model_error.grid_share;
        counter.uneven = picture.lit(&weighting.response);
        // One cell of all columns has no place.
        counter.map_moves = (!one_cell && !self.map_errors.is_empty()).then(|| MapMoves {
            errors: &self.map_errors,
            attitude: state.pose.body_to_tank_rotation(),
        });
        let pixels = picture.pixels;
        let mut downweighted = model_error.of_pixels.iter();
        let mut found = Vec::new();
        let first = model_error.known() && model_error.of_pixels.is_empty();
        let mut share = None;
        // Of one pixel after the other.
        let mut model_error_sd = |sensitivity: &Sensitivity, share: Option<f64>| match share {
            Some(share) => {
                let edge = share * sensitivity.edge;
                let sd = (edge * edge + sensitivity.corner * sensitivity.corner).sqrt() as f32;
                found.push(sd);
                f64::from(sd)
            }
            None => downweighted.next().map_or(0.0, |sd| f64::from(*sd)),
        };
        let mut scratch = Scratch::default();
        for strips in groups(&plan.strips) {
            let cut = strips.iter().any(Strip::cut);
            let even = *state;
            let state = if one_cell {
                counter.enter(&Cell::EVEN);
                &even
            } else {
                let cell = self.cell(plan, strips);
                counter.enter(&cell);
                &cell.of(state)
            };
            counter.strips(strips, cut);
            if let ([strip], false) = (strips, cut) {
                let all = InteriorStrip {
                    geometry: &geometry,
                    strip,
                    pixels,
                    state,
                    derivatives,
                };
                self.compare_interior(all, &mut counter);
                continue;
            }
            if let Some(name) = strips.iter().find_map(|s| plan.edge(s)) {
                counter.at_edge(name);
                share = model_error.of(name).filter(|_| first);
            }
            if strips.iter().all(|s| s.simple) {
                let of_pixel = |sensitivity: &Sensitivity| model_error_sd(sensitivity, share);
                let all = (
                    &geometry,
                    plan,
                    strips,
                    pixels,
                    state,
                    derivatives,
                    grid_share,
                );
                if counter.run_parameters() != RunParameters::Known {
                    self.compare_edge_strips::<true>(all, &mut counter, &mut scratch, of_pixel);
                } else {
                    self.compare_edge_strips::<false>(all, &mut counter, &mut scratch, of_pixel);
                }
                continue;
            }
            let of_run = derivatives && counter.run_parameters() != RunParameters::Known;
            self.each_row(
                &geometry,
                plan,
                state,
                strips,
                grid_share,
                of_run,
                |row, light| {
                    let model_error_sd = match (cut, &light) {
                        (true, Some(light)) => model_error_sd(&light.sensitivity, share),
                        (true, None) => model_error_sd(&Sensitivity::default(), share),
                        _ => 0.0,
                    };
                    let (Some(light), Some(&grey)) = (
                        light,
                        pixels.get(row * self.table.width_px + strips[0].column),
                    ) else {
                        counter.skip();
                        return;
                    };
                    let background = counter.background(state.background, row);
                    let judged = if cut {
                        let edge_light =
                            Some(light.sensitivity.edge).filter(|_| light.sensitivity.corner < 1.0);
                        let seen = edge_light.map(|edge_light| EdgeLight {
                            light: edge_light,
                            by_grid: light.by_grid,
                        });
                        counter.edge::<true>(grey, light.level, background, seen, model_error_sd)
                    } else {
                        let mut tally = counter.sums.tally;
                        let judged =
                            counter.interior::<true>(grey, light.level, background, &mut tally);
                        counter.sums.tally = tally;
                        judged
                    };
                    let Some(judged) = judged.filter(|_| derivatives) else {
                        return;
                    };
                    let mut j = light.j;
                    j[BACKGROUND] = 1.0;
                    if judged.share != 1.0 {
                        j = j.map(|d| d * judged.share);
                    }
                    if of_run {
                        counter.put_run(&mut j, judged.by_camera);
                    }
                    counter.add(&j, judged.weight, judged.residual);
                },
            );
        }
        if first {
            model_error.of_pixels = found;
        }
        counter.done()
    }

    /// Fisher's information of a frame's pixels about pose and light at a state.
    pub fn information(&self, plan: &Plan, state: &State, noise_sd: f64) -> Square {
        let geometry = PoseGeometry::new(&state.pose, &self.surfaces);
        let weighting = Weighting {
            noise_sd,
            cut: f64::INFINITY,
            redescending: false,
            response: Response::linear(u8::MAX),
            run_parameters: RunParameters::Known,
            even: false,
        };
        let mut counter = Counter::new(&weighting, Tables::get(), state);
        for strips in groups(&plan.strips) {
            let cell = self.cell(plan, strips);
            counter.enter(&cell);
            let state = &cell.of(state);
            self.each_row(&geometry, plan, state, strips, 0.0, false, |_, light| {
                let Some(light) = light.filter(|l| l.sensitivity.corner < 0.1) else {
                    return;
                };
                let mut j = light.j;
                j[BACKGROUND] = 1.0;
                // A level cut off at zero: I = (Φ − xφ + φ²/Φ(−x)) / σ² of a censored normal.
                let x = (light.level + state.background) / noise_sd;
                let share = if x > 5.0 {
                    1.0
                } else {
                    let (p, d) = (cumulative(x), density(x));
                    p - x * d + d * d / cumulative(-x).max(1e-12)
                };
                counter.add(&j, share / (noise_sd * noise_sd), 0.0);
            });
        }
        counter.done().information
    }

    /// The light of each row that some strips share; `None` where a row sees none of their levels.
    #[allow(clippy::too_many_arguments)]
    fn each_row(
        &self,
        geometry: &PoseGeometry,
        plan: &Plan,
        state: &State,
        strips: &[Strip],
        grid_share: f64,
        of_run: bool,
        mut then: impl FnMut(usize, Option<Light>),
    ) {
        let Some(strip) = strips.first() else {
            return;
        };
        let slopes = self
            .table
            .slopes_over(strip.column, strip.first_row, strip.end_row);
        let lit: Vec<[f64; 2]> = strips
            .iter()
            .map(|strip| self.lit_rows(geometry, strip, state))
            .collect();
        for row in strip.first_row..strip.end_row {
            let light = slopes.as_ref().and_then(|slopes| {
                let [y, z] = self.table.sight(strip.column, row);
                let ray = Ray {
                    sight: [self.table.lever_m, y, z],
                    slopes: slopes.at(row),
                };
                let tables = Tables::get();
                let context = PixelContext {
                    geometry,
                    plan,
                    ray: &ray,
                    tables,
                    grid: &self.grid,
                    grid_share,
                    of_run,
                };
                let at = row as f64;
                let lit = strips
                    .iter()
                    .zip(&lit)
                    .filter(|(_, lit)| at >= lit[0] && at <= lit[1]);
                self.light(&context, state, lit.map(|(strip, _)| strip))
            });
            then(row, light);
        }
    }

    /// First and last row of a strip where its light counts.
    fn lit_rows(&self, geometry: &PoseGeometry, strip: &Strip, state: &State) -> [f64; 2] {
        let everywhere = [f64::NEG_INFINITY, f64::INFINITY];
        let rows = self
            .table
            .sound_rows(strip.column, strip.first_row, strip.end_row);
        let Some([first, last]) = rows else {
            return everywhere;
        };
        let stripe = |row: usize| {
            let hit = self.hit(
                geometry,
                &self.ray(strip.column, row),
                self.height(strip.level),
            )?;
            Some(self.stripe(&hit, state))
        };
        match (stripe(first), stripe(last)) {
            (Some(a), Some(b)) => lit([first as f64, last as f64], &a, &b),
            _ => everywhere,
        }
    }

    /// Laser light of one pixel.
    fn light<'a>(
        &self,
        context: &PixelContext<'_>,
        state: &State,
        strips: impl Iterator<Item = &'a Strip>,
    ) -> Option<Light> {
        let sigma = state.thickness_m;
        let across = Across::new(&state.across, sigma);
        let mut out = Light::default();
        for strip in strips {
            let hit = self.hit(context.geometry, context.ray, self.height(strip.level))?;
            let stripe = self.stripe(&hit, state);
            let s = stripe.s;
            let of_total2 = 1.0 / stripe.total2;
            let exponent = 0.5 * s * s * of_total2;
            if exponent.is_nan() {
                return None;
            }
            if exponent > DARK {
                continue;
            }
            let of_total = of_total2.sqrt();
            let mut by_terms = [0.0; ACROSS];
            let line = if context.of_run {
                across.at_by(s, of_total2, &mut by_terms)
            } else {
                across.at(s, of_total2)
            };
            let round = self.albedo(strip.level) * sigma * of_total * context.tables.exp(exponent);
            let bare = round * line.light;
            let mut share = 1.0;
            let full = state.brightness * bare;
            if strip.cut() {
                let visibility = self.visibility(context, strip, &hit, &stripe);
                share = visibility.share;
                out.sensitivity.corner += full * visibility.uncertain;
                if share == 0.0 {
                    continue;
                }
                if visibility.cut {
                    out.sensitivity.edge += full * 4.0 * share * (1.0 - share);
                    for (k, d) in visibility.by_pose.iter().enumerate() {
                        out.j[k] += full * d;
                    }
                    out.j[THICKNESS] += full * visibility.by_thickness;
                    out.by_grid += full * visibility.by_grid;
                }
            }
            let light = full * share;
            out.level += light;
            let of_line = state.brightness * round * share;
            let by_s = of_line * line.slope - light * s * of_total2;
            for (k, ds) in stripe.ds.iter().enumerate() {
                out.j[2 + k] += by_s * ds;
            }
            out.j[BRIGHTNESS] += bare * share;
            out.j[THICKNESS] += light * (1.0 / sigma - sigma * of_total2 * (1.0 - 2.0 * exponent))
                + of_line * line.by_sigma;
            if context.of_run {
                for (j, by) in out.j[LINE..].iter_mut().zip(&by_terms) {
                    *j += of_line * by;
                }
            }
        }
        Some(out)
    }
}

#[derive(Debug, Clone, Copy, Default)]
struct Light {
    /// \[grey levels\].
    level: f64,
    /// Derivatives but that by the background.
    j: [f64; LOCAL],
    /// Derivative of the light by the share of blur that is formed on the pixel grid.
    by_grid: f64,
    /// Dependence of the light on edges and corners.
    sensitivity: Sensitivity,
}

#[cfg(test)]
mod tests;
