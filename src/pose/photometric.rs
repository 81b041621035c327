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

use super::normal::{cumulative, cumulative2, density};
use super::outline::{Edge, Outline, Surfaces};
use super::sheet::SheetTable;
use hydroline_calib::Pose;
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use std::sync::Arc;

/// x, y, z, φ, θ, ψ, brightness, thickness, background.
pub(super) const PARAMETERS: usize = 9;
pub(super) const BRIGHTNESS: usize = 6;
pub(super) const THICKNESS: usize = 7;
pub(super) const BACKGROUND: usize = 8;

/// Reach of the light, standard deviations.
const REACH: f64 = 4.3;
/// Farther from every edge than this a hit is wholly in or out \[m\].
const EDGE_REACH_M: f64 = 0.009;
/// Room for the pose to move after the pixels were chosen \[m\], \[px\].
const MOVE_M: f64 = 0.004;
const MOVE_PX: f64 = 2.0;
/// Points this near the ends of the fan are not used, as a tangent.
const FAN_MARGIN: f64 = 0.012;

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

/// Pixels of one column that are compared.
#[derive(Debug, Clone, Copy)]
struct Strip {
    column: usize,
    first_row: usize,
    end_row: usize,
    /// Bit k = top k, bit 31 = floor.
    levels: u32,
    /// An edge passes: visibility is computed per pixel.
    edges: bool,
}

const FLOOR_BIT: u32 = 31;

/// Which pixels a frame is judged by.
#[derive(Debug, Clone, Default)]
pub(super) struct Plan {
    strips: Vec<Strip>,
}

/// Sums over the pixels.
#[derive(Debug, Clone)]
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

/// Rotation with its derivatives.
struct Turned {
    r: Matrix3<f64>,
    by: [Matrix3<f64>; 3],
    position: Vector3<f64>,
}

impl Turned {
    fn new(pose: &Pose) -> Self {
        let (sf, cf) = pose.phi_rad.sin_cos();
        let (st, ct) = pose.theta_rad.sin_cos();
        let (sp, cp) = pose.psi_rad.sin_cos();
        let rz = Matrix3::new(cp, -sp, 0.0, sp, cp, 0.0, 0.0, 0.0, 1.0);
        let ry = Matrix3::new(ct, 0.0, st, 0.0, 1.0, 0.0, -st, 0.0, ct);
        let rx = Matrix3::new(1.0, 0.0, 0.0, 0.0, cf, -sf, 0.0, sf, cf);
        let dz = Matrix3::new(-sp, -cp, 0.0, cp, -sp, 0.0, 0.0, 0.0, 0.0);
        let dy = Matrix3::new(-st, 0.0, ct, 0.0, 0.0, 0.0, -ct, 0.0, -st);
        let dx = Matrix3::new(0.0, 0.0, 0.0, 0.0, -sf, -cf, 0.0, cf, -sf);
        Turned { r: rz * ry * rx, by: [rz * ry * dx, rz * dy * rx, dz * ry * rx], position: pose.position_m() }
    }
}

/// A ray at one height.
#[derive(Clone, Copy)]
struct Hit {
    t: f64,
    t_slope: [f64; 2],
    /// dt/d(z, φ, θ).
    dt: [f64; 3],
    /// Tank X, Y.
    p: [f64; 2],
}

/// How much of the light of a pixel passes, with what moves it.
#[derive(Clone, Copy)]
struct Passing {
    share: f64,
    /// d share / d pose.
    by_pose: [f64; 6],
    /// d share / d thickness.
    by_thickness: f64,
}

impl Passing {
    const ALL: Passing = Passing { share: 1.0, by_pose: [0.0; 6], by_thickness: 0.0 };
    const NONE: Passing = Passing { share: 0.0, ..Passing::ALL };

    fn blocked(self) -> Passing {
        Passing { share: 1.0 - self.share, by_pose: self.by_pose.map(|d| -d), by_thickness: -self.by_thickness }
    }

    fn and(self, other: Passing) -> Passing {
        Passing {
            share: self.share * other.share,
            by_pose: std::array::from_fn(|i| self.by_pose[i] * other.share + self.share * other.by_pose[i]),
            by_thickness: self.by_thickness * other.share + self.share * other.by_thickness,
        }
    }
}

/// What an edge needs to know of the stripe at a pixel.
struct Stripe {
    s: f64,
    s_slope: [f64; 2],
    ds: [f64; 3],
    total2: f64,
    sigma: f64,
    spread: f64,
}

/// The distance from an edge in units of its spread, given the stripe's light.
struct Standard {
    x: f64,
    sd: f64,
    slope: [f64; 2],
    mixed: f64,
    dx: [f64; 6],
    dx_thickness: f64,
}

impl Photometric {
    pub fn new(surfaces: Surfaces, table: Arc<SheetTable>, blur_px: f64, fan_rad: f64) -> Self {
        // The pixel's box has variance 1/12 px² per axis.
        let spread_px2 = blur_px * blur_px + 1.0 / 12.0;
        Photometric { surfaces, table, spread_px2, tan_half_fan: (0.5 * fan_rad).tan() }
    }

    /// The same camera and light over a bare floor.
    pub fn bare(&self) -> Self {
        Photometric { surfaces: Surfaces::new(None), ..self.clone() }
    }

    fn height(&self, bit: u32) -> f64 {
        self.surfaces.tops.get(bit as usize).map_or(0.0, |t| t.height_m)
    }

    fn albedo(&self, bit: u32) -> f64 {
        self.surfaces.tops.get(bit as usize).map_or(1.0, |t| t.albedo)
    }

    /// Bits of all levels.
    fn all_levels(&self) -> impl Iterator<Item = u32> {
        (0..self.surfaces.tops.len().min(FLOOR_BIT as usize) as u32).chain([FLOOR_BIT])
    }

    fn hit(&self, turned: &Turned, sight: &[Vector3<f64>; 3], height_m: f64) -> Option<Hit> {
        let [d, du, dv] = sight;
        let r3 = turned.r.row(2);
        let down = (r3 * d)[0];
        let eye = &self.table.eye_m;
        let t = (-height_m - turned.position.z - (r3 * eye)[0]) / down;
        if !(t.is_finite() && t > 0.0 && down > 0.0) {
            return None;
        }
        let x = eye + t * d;
        let q = turned.r * x;
        Some(Hit {
            t,
            t_slope: [-t * (r3 * du)[0] / down, -t * (r3 * dv)[0] / down],
            dt: [-1.0 / down, -(turned.by[0].row(2) * x)[0] / down, -(turned.by[1].row(2) * x)[0] / down],
            p: [turned.position.x + q.x, turned.position.y + q.y],
        })
    }

    /// The pixels a state calls for: along each level where it could be lit.
    pub fn plan(&self, state: &State) -> Plan {
        let turned = Turned::new(&state.pose);
        let mut strips = Vec::with_capacity(self.table.width_px);
        for column in 1..self.table.width_px.saturating_sub(1) {
            self.plan_column(&turned, state, column, &mut strips);
        }
        Plan { strips }
    }

    fn plan_column(&self, turned: &Turned, state: &State, column: usize, strips: &mut Vec<Strip>) {
        let lever = self.table.l_laser_m - self.table.eye_m.x;
        let first = strips.len();
        for bit in self.all_levels() {
            let height = self.height(bit);
            // Row at which s = 0, by Newton from the middle of the image.
            let mut row = self.table.height_px as f64 * 0.5;
            let mut hit = None;
            for _ in 0..8 {
                let at = row.round().clamp(1.0, self.table.height_px as f64 - 2.0) as usize;
                let sight = self.table.sight_with_slopes(column, at);
                hit = self.hit(turned, &sight, height).map(|h| (h, at, sight));
                let Some((h, at, _)) = &hit else { break };
                let next = *at as f64 - (h.t - 1.0) / h.t_slope[1];
                let done = (next - row).abs() < 0.3;
                row = next;
                if done || !row.is_finite() {
                    break;
                }
            }
            let Some((h, _, sight)) = hit.filter(|_| row.is_finite()) else { continue };
            let body = self.table.eye_m + h.t * sight[0];
            // NaN (no map there) is outside too.
            if !(body.y.abs() <= (self.tan_half_fan - FAN_MARGIN) * body.z) {
                continue;
            }
            let metres_per_row = (lever * h.t_slope[1]).abs();
            let total = state.thickness_m.hypot(metres_per_row * self.spread_px2.sqrt());
            let reach_m = REACH * total;
            let half = reach_m / metres_per_row + MOVE_PX;
            let (low, high) = ((row - half).ceil().max(1.0), (row + half).floor().min(self.table.height_px as f64 - 2.0));
            if low > high {
                continue;
            }
            let near_m = EDGE_REACH_M + MOVE_M + reach_m;
            let Some(edges) = self.may_be_lit(turned, &sight, bit, h.p, near_m) else { continue };
            strips.push(Strip { column, first_row: low as usize, end_row: high as usize + 1, levels: 1 << bit, edges });
        }
        merge(strips, first);
    }

    /// Whether level `bit` can be lit about `p` (`None`: surely not) and whether an edge is near.
    fn may_be_lit(&self, turned: &Turned, sight: &[Vector3<f64>; 3], bit: u32, p: [f64; 2], near_m: f64) -> Option<bool> {
        let near = |outline: &Outline, p: [f64; 2]| outline.nearest(p).is_some_and(|(_, d)| d < near_m);
        let mut edges = false;
        if let Some(top) = self.surfaces.tops.get(bit as usize) {
            edges = near(&top.outline, p);
            if !edges && !top.outline.contains(p) {
                return None;
            }
        }
        for higher in self.surfaces.tops.iter().take(bit as usize).filter(|t| t.height_m > self.height(bit)) {
            let above = self.hit(turned, sight, higher.height_m)?.p;
            let touched = near(&higher.outline, p) || near(&higher.outline, above);
            if !touched && (higher.outline.contains(p) || higher.outline.contains(above)) {
                return None;
            }
            edges |= touched;
        }
        Some(edges)
    }

    /// Compares a frame with a state.
    pub fn compare(&self, plan: &Plan, pixels: &[u8], state: &State, weighting: &Weighting, derivatives: bool) -> Sums {
        let mut sums = Sums {
            information: Square::zeros(),
            gradient: Column::zeros(),
            cost: 0.0,
            pixels: 0,
            bright_square: 0.0,
            bright_count: 0,
            edge_cost: 0.0,
            edge_count: 0,
            rejected: 0,
        };
        let turned = Turned::new(&state.pose);
        let width = self.table.width_px;
        let bright = 0.15 * state.brightness;
        for strip in &plan.strips {
            for row in strip.first_row..strip.end_row {
                let Some(&grey) = pixels.get(row * width + strip.column) else { continue };
                if grey >= weighting.saturation {
                    continue;
                }
                let mut j = Column::zeros();
                let Some(light) = self.light(&turned, state, strip, row, &mut j) else { continue };
                // A sensor gives no negative level: E max(0, m + n) = m Φ(m/σ) + σ φ(m/σ).
                let level = light + state.background;
                j[BACKGROUND] = 1.0;
                let noise = weighting.noise_sd;
                let mut expected = level;
                if level < 4.0 * noise {
                    let x = level / noise;
                    let share = cumulative(x);
                    expected = level * share + noise * density(x);
                    j *= share;
                }
                let residual = f64::from(grey) - expected;
                let scaled = residual / noise;
                let (cost, weight) = weigh(scaled, weighting);
                sums.cost += cost;
                sums.pixels += 1;
                if strip.edges {
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
                    for a in 0..PARAMETERS {
                        if j[a] == 0.0 {
                            continue;
                        }
                        let wj = w * j[a];
                        sums.gradient[a] += wj * residual;
                        for b in a..PARAMETERS {
                            sums.information[(b, a)] += wj * j[b];
                        }
                    }
                }
            }
        }
        for a in 0..PARAMETERS {
            for b in a + 1..PARAMETERS {
                sums.information[(a, b)] = sums.information[(b, a)];
            }
        }
        sums
    }

    /// Laser light of one pixel, and its derivatives added to `j`.
    fn light(&self, turned: &Turned, state: &State, strip: &Strip, row: usize, j: &mut Column) -> Option<f64> {
        let sight = self.table.sight_with_slopes(strip.column, row);
        let lever = self.table.l_laser_m - self.table.eye_m.x;
        let sigma = state.thickness_m;
        let mut sum = 0.0;
        let mut bits = strip.levels;
        while bits != 0 {
            let bit = bits.trailing_zeros();
            bits &= bits - 1;
            let hit = self.hit(turned, &sight, self.height(bit))?;
            let s = lever * (hit.t - 1.0);
            let s_slope = [lever * hit.t_slope[0], lever * hit.t_slope[1]];
            let total2 = sigma * sigma + self.spread_px2 * (s_slope[0] * s_slope[0] + s_slope[1] * s_slope[1]);
            let exponent = 0.5 * s * s / total2;
            if !(exponent < 14.0) {
                if exponent.is_nan() {
                    return None;
                }
                continue;
            }
            let bare = self.albedo(bit) * sigma / total2.sqrt() * (-exponent).exp();
            let stripe = Stripe { s, s_slope, ds: hit.dt.map(|d| lever * d), total2, sigma, spread: self.spread_px2 };
            let passing = if strip.edges { self.passing(turned, &sight, bit, &hit, &stripe) } else { Passing::ALL };
            if passing.share == 0.0 {
                continue;
            }
            let light = state.brightness * bare * passing.share;
            sum += light;
            for (k, ds) in stripe.ds.iter().enumerate() {
                j[2 + k] -= light * s / total2 * ds;
            }
            if strip.edges {
                for (k, d) in passing.by_pose.iter().enumerate() {
                    j[k] += state.brightness * bare * d;
                }
            }
            j[BRIGHTNESS] += bare * passing.share;
            j[THICKNESS] += light * (1.0 / sigma - sigma / total2 + s * s * sigma / (total2 * total2))
                + state.brightness * bare * passing.by_thickness;
        }
        Some(sum)
    }

    /// What passes of the light of level `bit`: on its top, and in front of nothing higher.
    fn passing(&self, turned: &Turned, sight: &[Vector3<f64>; 3], bit: u32, hit: &Hit, stripe: &Stripe) -> Passing {
        let mut passing = Passing::ALL;
        if let Some(top) = self.surfaces.tops.get(bit as usize) {
            passing = self.inside(turned, sight, &top.outline, hit, stripe);
        }
        for higher in self.surfaces.tops.iter().take(bit as usize).filter(|t| t.height_m > self.height(bit)) {
            if passing.share == 0.0 {
                break;
            }
            // The slab hides what lies under its top and, seen from the side, behind it: in the
            // image the union of its foot and its top, of which the one that reaches farther decides.
            let foot = self.inside(turned, sight, &higher.outline, hit, stripe);
            let hidden = match self.hit(turned, sight, higher.height_m) {
                Some(above) if foot.share < 1.0 => {
                    let head = self.inside(turned, sight, &higher.outline, &above, stripe);
                    if head.share > foot.share { head } else { foot }
                }
                _ => foot,
            };
            passing = passing.and(hidden.blocked());
        }
        passing
    }

    /// Share of the light that falls inside an outline.
    fn inside(&self, turned: &Turned, sight: &[Vector3<f64>; 3], outline: &Outline, hit: &Hit, stripe: &Stripe) -> Passing {
        let Some((nearest, distance)) = outline.nearest(hit.p) else { return Passing::NONE };
        if distance > EDGE_REACH_M {
            return if outline.contains(hit.p) { Passing::ALL } else { Passing::NONE };
        }
        let n = outline.edges.len();
        let edge = &outline.edges[nearest];
        let along = edge.along_m(hit.p);
        let first = self.standard(turned, sight, edge, hit, stripe);
        let neighbour = if along < EDGE_REACH_M && along < 0.5 * edge.length_m {
            Some(((nearest + n - 1) % n, edge.convex_at_start))
        } else if edge.length_m - along < EDGE_REACH_M {
            let next = (nearest + 1) % n;
            Some((next, outline.edges[next].convex_at_start))
        } else {
            None
        };
        let Some((other, convex)) = neighbour else {
            let slope = density(first.x);
            return Passing {
                share: cumulative(first.x),
                by_pose: first.dx.map(|d| slope * d),
                by_thickness: slope * first.dx_thickness,
            };
        };
        let second = self.standard(turned, sight, &outline.edges[other], hit, stripe);
        corner(&first, &second, convex, stripe)
    }

    fn standard(&self, turned: &Turned, sight: &[Vector3<f64>; 3], edge: &Edge, hit: &Hit, stripe: &Stripe) -> Standard {
        let [d, du, dv] = sight;
        let [nx, ny] = edge.inward;
        let n = Vector3::new(nx, ny, 0.0);
        // n·R as a row: what a body direction adds to the distance.
        let row = n.transpose() * turned.r;
        let toward = (row * d)[0];
        let slope = [hit.t * (row * du)[0] + toward * hit.t_slope[0], hit.t * (row * dv)[0] + toward * hit.t_slope[1]];
        let x = self.table.eye_m + hit.t * d;
        let turn = |k: usize| (n.transpose() * turned.by[k] * x)[0];
        let de = [nx, ny, toward * hit.dt[0], turn(0) + toward * hit.dt[1], turn(1) + toward * hit.dt[2], turn(2)];
        let mixed = stripe.spread * (slope[0] * stripe.s_slope[0] + slope[1] * stripe.s_slope[1]);
        let of_s = mixed / stripe.total2;
        let variance = stripe.spread * (slope[0] * slope[0] + slope[1] * slope[1]) - mixed * of_s;
        let sd = variance.max(1e-12).sqrt();
        let mut dx = de;
        for (k, ds) in stripe.ds.iter().enumerate() {
            dx[2 + k] -= of_s * ds;
        }
        Standard {
            x: (edge.inside_m(hit.p) - stripe.s * of_s) / sd,
            sd,
            slope,
            mixed,
            dx: dx.map(|v| v / sd),
            dx_thickness: 2.0 * stripe.s * of_s * stripe.sigma / stripe.total2 / sd,
        }
    }
}

/// Two edges at a corner: inside both (convex) or either (concave).
fn corner(first: &Standard, second: &Standard, convex: bool, stripe: &Stripe) -> Passing {
    let across = stripe.spread * (first.slope[0] * second.slope[0] + first.slope[1] * second.slope[1]);
    let rho = ((across - first.mixed * second.mixed / stripe.total2) / (first.sd * second.sd)).clamp(-0.97, 0.97);
    let (h, k) = (first.x, second.x);
    let both = cumulative2(h, k, rho);
    let across_sd = (1.0 - rho * rho).sqrt();
    let mut by_first = density(h) * cumulative((k - rho * h) / across_sd);
    let mut by_second = density(k) * cumulative((h - rho * k) / across_sd);
    let mut share = both;
    if !convex {
        share = (cumulative(h) + cumulative(k) - both).clamp(0.0, 1.0);
        by_first = density(h) - by_first;
        by_second = density(k) - by_second;
    }
    Passing {
        share,
        by_pose: std::array::from_fn(|i| by_first * first.dx[i] + by_second * second.dx[i]),
        by_thickness: by_first * first.dx_thickness + by_second * second.dx_thickness,
    }
}

/// Cost and weight of a residual in units of the noise.
fn weigh(scaled: f64, weighting: &Weighting) -> (f64, f64) {
    let c = weighting.cut;
    if weighting.redescending {
        // Tukey's biweight, scaled so that ρ = r²/2 near zero.
        let u = (scaled / c).powi(2);
        if u >= 1.0 { (c * c / 6.0, 0.0) } else { (c * c / 6.0 * (1.0 - (1.0 - u).powi(3)), (1.0 - u).powi(2)) }
    } else {
        let a = scaled.abs();
        if a <= c { (0.5 * a * a, 1.0) } else { (c * a - 0.5 * c * c, c / a) }
    }
}

/// Joins overlapping strips of one column from `first` on: each pixel is compared once.
fn merge(strips: &mut Vec<Strip>, first: usize) {
    strips[first..].sort_by_key(|s| s.first_row);
    let mut kept = first;
    for i in first..strips.len() {
        let next = strips[i];
        if kept > first && next.first_row <= strips[kept - 1].end_row {
            let last = &mut strips[kept - 1];
            last.end_row = last.end_row.max(next.end_row);
            last.levels |= next.levels;
            last.edges |= next.edges;
        } else {
            strips[kept] = next;
            kept += 1;
        }
    }
    strips.truncate(kept);
}
