//! The grey levels along the stripe as a closed form of the pose, with derivatives.
//!
//! A pixel's ray meets the top at height h at the body point e + t d (e = camera, d = from it to
//! the pixel's sheet point, t = 1 in the sheet), s = (l_laser − e_x)(t − 1) before the sheet. It
//! is lit by A exp(−s²/2σ²) where that point lies on the top and in sight. Under a Gaussian point
//! spread (blur and the pixel's own box, variance b² per axis) s and the distance e from an edge
//! are jointly normal about their values at the pixel's centre, so that with S² = σ² + b²|∇s|²
//!
//! light = A (σ/S) exp(−s²/2S²) Φ(e'/τ),  e' = e − s c/S²,  τ² = b²|∇e|² − c²/S²,  c = b² ∇s·∇e
//!
//! and with the bivariate normal in place of Φ where two edges meet. Exact up to the curvature of
//! perspective within one point spread; no sampling, so derivatives along the weak direction
//! (δz = l δθ, δx = −H δθ) are those of the image and not of a lattice.

mod passing;
mod plan;
mod turned;

pub(super) use plan::Plan;

use super::normal::{cumulative, density};
use super::outline::Surfaces;
use super::sheet::SheetTable;
use hydroline_calib::Pose;
use nalgebra::{SMatrix, SVector};
use passing::{Doubt, Stripe};
use plan::{Strip, groups};
use std::sync::Arc;
use turned::Turned;

/// x, y, z, φ, θ, ψ, brightness, thickness, background.
pub(super) const PARAMETERS: usize = 9;
pub(super) const BRIGHTNESS: usize = 6;
pub(super) const THICKNESS: usize = 7;
pub(super) const BACKGROUND: usize = 8;

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
}

impl State {
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
        }
    }
}

/// Sums over the pixels.
#[derive(Debug, Clone, Default)]
pub(super) struct Sums {
    /// Jᵀ W J.
    pub information: Square,
    /// Jᵀ W r.
    pub gradient: Column,
    /// Σ ρ(r / noise).
    pub cost: f64,
    /// Pixels.
    pub pixels: usize,
    /// Squared residuals of lit pixels away from edges, robustly cut, and their number.
    pub bright_square: f64,
    pub bright_count: usize,
    /// Σ ρ over edge pixels and their number.
    pub edge_cost: f64,
    pub edge_count: usize,
    /// Share of the edge pixels whose weight is below one half.
    pub rejected: usize,
}

/// How residuals count.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Weighting {
    /// Pixel noise \[grey levels\].
    pub noise_sd: f64,
    /// Beyond this many noise sds a residual counts less and less (Tukey) or linearly (Huber).
    pub cut: f64,
    pub redescending: bool,
    /// Level from which a pixel counts as clipped.
    pub saturation: u8,
}

/// The forward model of one rig.
#[derive(Debug, Clone)]
pub(super) struct Photometric {
    pub surfaces: Surfaces,
    pub table: Arc<SheetTable>,
    /// Variance of point spread and pixel box per axis \[px²\].
    spread_px2: f64,
    tan_half_fan: f64,
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
        }
    }

    /// The same camera and light over a bare floor.
    pub fn bare(&self) -> Self {
        Photometric {
            surfaces: Surfaces::new(None),
            ..self.clone()
        }
    }

    fn height(&self, level: usize) -> f64 {
        self.surfaces.tops.get(level).map_or(0.0, |t| t.height_m)
    }

    fn albedo(&self, level: usize) -> f64 {
        self.surfaces.tops.get(level).map_or(1.0, |t| t.albedo)
    }

    /// Compares a frame with a state.
    pub fn compare(
        &self,
        plan: &Plan,
        pixels: &[u8],
        state: &State,
        weighting: &Weighting,
        derivatives: bool,
    ) -> Sums {
        let mut sums = Sums::default();
        let turned = Turned::new(&state.pose);
        let width = self.table.width_px;
        let bright = 0.15 * state.brightness;
        let noise = weighting.noise_sd;
        let mut index = 0;
        for strips in groups(&plan.strips) {
            let cut = strips.iter().any(|s| s.cuts.0 != s.cuts.1);
            let Some(strip) = strips.first() else {
                continue;
            };
            for row in strip.first_row..strip.end_row {
                let doubt = plan.doubts.get(index).map_or(0.0, |d| f64::from(*d));
                index += 1;
                let Some(&grey) = pixels.get(row * width + strip.column) else {
                    continue;
                };
                if grey >= weighting.saturation {
                    continue;
                }
                let mut j = Column::zeros();
                let Some(light) = self.light(
                    &turned,
                    state,
                    plan,
                    strips,
                    row,
                    &mut j,
                    &mut Doubt::default(),
                ) else {
                    continue;
                };
                // A sensor gives no negative level: E max(0, m + n) = m Φ(m/σ) + σ φ(m/σ).
                let level = light + state.background;
                j[BACKGROUND] = 1.0;
                let mut expected = level;
                if level < 4.0 * noise {
                    let x = level / noise;
                    let share = cumulative(x);
                    expected = level * share + noise * density(x);
                    j *= share;
                }
                let residual = f64::from(grey) - expected;
                let noise = noise.hypot(doubt);
                let (cost, weight) = weigh(residual / noise, weighting);
                sums.cost += cost;
                sums.pixels += 1;
                if cut {
                    sums.edge_cost += cost;
                    sums.edge_count += 1;
                    sums.rejected += usize::from(weight < 0.5);
                } else if light > bright {
                    sums.bright_square += weight * residual * residual;
                    sums.bright_count += 1;
                    sums.rejected += usize::from(weight < 0.5);
                }
                if derivatives {
                    let w = weight / (noise * noise);
                    // x, y and ψ move edges only.
                    if cut {
                        add::<PARAMETERS>(&mut sums, &ALL, &j, w, residual)
                    } else {
                        add::<6>(&mut sums, &BULK, &j, w, residual)
                    }
                }
            }
        }
        mirror(&mut sums.information);
        sums
    }

    /// Fisher's information of a frame's pixels about pose and light at a state.
    pub fn information(&self, plan: &Plan, state: &State, noise_sd: f64) -> Square {
        let turned = Turned::new(&state.pose);
        let mut sums = Sums::default();
        for strips in groups(&plan.strips) {
            let Some(strip) = strips.first() else {
                continue;
            };
            for row in strip.first_row..strip.end_row {
                let (mut j, mut doubt) = (Column::zeros(), Doubt::default());
                let light = self.light(&turned, state, plan, strips, row, &mut j, &mut doubt);
                let Some(light) = light.filter(|_| doubt.corner < 0.1) else {
                    continue;
                };
                j[BACKGROUND] = 1.0;
                // A level cut off at zero: I = (Φ − xφ + φ²/Φ(−x)) / σ² of a censored normal.
                let x = (light + state.background) / noise_sd;
                let share = if x > 5.0 {
                    1.0
                } else {
                    let (p, d) = (cumulative(x), density(x));
                    p - x * d + d * d / cumulative(-x).max(1e-12)
                };
                add::<PARAMETERS>(&mut sums, &ALL, &j, share / (noise_sd * noise_sd), 0.0);
            }
        }
        mirror(&mut sums.information);
        sums.information
    }

    /// Laser light of one pixel, its derivatives added to `j`, and to `doubt` how much of it hangs on edges.
    #[allow(clippy::too_many_arguments)]
    fn light(
        &self,
        turned: &Turned,
        state: &State,
        plan: &Plan,
        strips: &[Strip],
        row: usize,
        j: &mut Column,
        doubt: &mut Doubt,
    ) -> Option<f64> {
        let column = strips.first()?.column;
        let sight = self.table.sight_with_slopes(column, row);
        let lever = self.table.l_laser_m - self.table.eye_m.x;
        let sigma = state.thickness_m;
        let mut sum = 0.0;
        for strip in strips {
            let hit = self.hit(turned, &sight, self.height(strip.level))?;
            let s = lever * (hit.t - 1.0);
            let s_slope = [lever * hit.t_slope[0], lever * hit.t_slope[1]];
            let total2 = sigma * sigma
                + self.spread_px2 * (s_slope[0] * s_slope[0] + s_slope[1] * s_slope[1]);
            let exponent = 0.5 * s * s / total2;
            if exponent.is_nan() {
                return None;
            }
            if exponent > 14.0 {
                continue;
            }
            let bare = self.albedo(strip.level) * sigma / total2.sqrt() * (-exponent).exp();
            let ds = hit.dt.map(|d| lever * d);
            let mut share = 1.0;
            if strip.cuts.0 != strip.cuts.1 {
                let stripe = Stripe {
                    s,
                    s_slope,
                    ds,
                    total2,
                    sigma,
                    spread: self.spread_px2,
                };
                let passing = self.passing(turned, &sight, plan, strip, &hit, &stripe);
                share = passing.share;
                doubt.corner += state.brightness * bare * passing.unsure;
                if share == 0.0 {
                    continue;
                }
                doubt.edge += state.brightness * bare * 4.0 * share * (1.0 - share);
                for (k, d) in passing.by_pose.iter().enumerate() {
                    j[k] += state.brightness * bare * d;
                }
                j[THICKNESS] += state.brightness * bare * passing.by_thickness;
            }
            let light = state.brightness * bare * share;
            sum += light;
            for (k, ds) in ds.iter().enumerate() {
                j[2 + k] -= light * s / total2 * ds;
            }
            j[BRIGHTNESS] += bare * share;
            j[THICKNESS] +=
                light * (1.0 / sigma - sigma / total2 + s * s * sigma / (total2 * total2));
        }
        Some(sum)
    }
}

/// Cost and weight of a residual in units of the noise.
fn weigh(scaled: f64, weighting: &Weighting) -> (f64, f64) {
    let c = weighting.cut;
    if weighting.redescending {
        // Tukey's biweight, scaled so that ρ = r²/2 near zero.
        let u = (scaled / c).powi(2);
        if u >= 1.0 {
            (c * c / 6.0, 0.0)
        } else {
            (c * c / 6.0 * (1.0 - (1.0 - u).powi(3)), (1.0 - u).powi(2))
        }
    } else {
        let a = scaled.abs();
        if a <= c {
            (0.5 * a * a, 1.0)
        } else {
            (c * a - 0.5 * c * c, c / a)
        }
    }
}

const ALL: [usize; PARAMETERS] = [0, 1, 2, 3, 4, 5, 6, 7, 8];
const BULK: [usize; 6] = [2, 3, 4, BRIGHTNESS, THICKNESS, BACKGROUND];

/// Fills the upper triangle from the lower.
fn mirror(information: &mut Square) {
    for a in 0..PARAMETERS {
        for b in a + 1..PARAMETERS {
            information[(a, b)] = information[(b, a)];
        }
    }
}

/// Adds one pixel to the lower triangle of the normal equations, for the parameters in `which`.
fn add<const N: usize>(
    sums: &mut Sums,
    which: &[usize; N],
    j: &Column,
    weight: f64,
    residual: f64,
) {
    for (n, &a) in which.iter().enumerate() {
        let wj = weight * j[a];
        sums.gradient[a] += wj * residual;
        for &b in &which[n..] {
            sums.information[(b, a)] += wj * j[b];
        }
    }
}

#[cfg(test)]
mod tests;
