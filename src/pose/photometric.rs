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
const REACH: f64 = 4.0;
/// Room for the pose to move after the pixels were chosen \[m\], \[px\].
const MOVE_M: f64 = 0.003;
const MOVE_PX: f64 = 1.0;
/// A hit this many spreads of its pixel from an edge, and this far, is wholly in or out.
const EDGE_SPREADS: f64 = 5.0;
const EDGE_SHIFT_M: f64 = 0.0015;
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

/// Edges of one outline that pass near a strip.
#[derive(Debug, Clone, Copy, Default)]
struct Near {
    /// In [`Plan::edges`].
    from: u32,
    to: u32,
    /// Whether the strip lies inside, where no edge is near.
    inside: bool,
}

/// Pixels of one column about one level.
#[derive(Debug, Clone, Copy)]
struct Strip {
    column: usize,
    first_row: usize,
    end_row: usize,
    /// Index of the top; the number of tops = floor.
    level: usize,
    /// What cuts the level here, in [`Plan::cuts`]; empty = nothing.
    cuts: (u32, u32),
    /// The next strip covers the same pixels: their light adds up.
    shares: bool,
}

/// One thing that cuts a strip's light.
#[derive(Debug, Clone, Copy)]
struct Cut {
    /// Index of the top whose outline it is.
    top: usize,
    /// Own outline, or one above.
    own: bool,
    /// At the level's own height.
    foot: Near,
    /// At the height of `top`, for one above.
    head: Near,
}

/// Which pixels a frame is judged by.
#[derive(Debug, Clone, Default)]
pub(super) struct Plan {
    strips: Vec<Strip>,
    cuts: Vec<Cut>,
    edges: Vec<u16>,
    /// Distance from an edge beyond which a hit is wholly in or out \[m\].
    edge_reach_m: f64,
    /// Standard deviation of each pixel, in the order of [`Photometric::compare`], beyond its noise
    /// \[grey levels\]; empty = none. Held fixed, or the fit would flee into doubtful pixels.
    doubts: Vec<f32>,
}

impl Plan {
    /// The same with every `keep`-th of the columns that no edge crosses.
    pub fn thinned(&self, keep: usize) -> Plan {
        let strips = self
            .strips
            .iter()
            .filter(|s| s.cuts.0 != s.cuts.1 || s.shares || s.column % keep == 0);
        Plan {
            strips: strips.copied().collect(),
            ..self.clone()
        }
    }

    fn near(&self, near: &Near) -> &[u16] {
        &self.edges[near.from as usize..near.to as usize]
    }
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
        Turned {
            r: rz * ry * rx,
            by: [rz * ry * dx, rz * dy * rx, dz * ry * rx],
            position: pose.position_m(),
        }
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
    const ALL: Passing = Passing {
        share: 1.0,
        by_pose: [0.0; 6],
        by_thickness: 0.0,
    };
    const NONE: Passing = Passing {
        share: 0.0,
        ..Passing::ALL
    };

    fn blocked(self) -> Passing {
        Passing {
            share: 1.0 - self.share,
            by_pose: self.by_pose.map(|d| -d),
            by_thickness: -self.by_thickness,
        }
    }

    fn and(self, other: Passing) -> Passing {
        Passing {
            share: self.share * other.share,
            by_pose: std::array::from_fn(|i| {
                self.by_pose[i] * other.share + self.share * other.by_pose[i]
            }),
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
            dt: [
                -1.0 / down,
                -(turned.by[0].row(2) * x)[0] / down,
                -(turned.by[1].row(2) * x)[0] / down,
            ],
            p: [turned.position.x + q.x, turned.position.y + q.y],
        })
    }

    /// The pixels a state calls for: along each level where it could be lit.
    pub fn plan(&self, state: &State) -> Plan {
        let turned = Turned::new(&state.pose);
        let mut plan = Plan {
            edge_reach_m: self.edge_reach_m(&turned),
            ..Plan::default()
        };
        for column in 1..self.table.width_px.saturating_sub(1) {
            self.plan_column(&turned, state, column, &mut plan);
        }
        plan
    }

    /// Gives pixels that an edge cuts a standard deviation of their own: `share` of the light of
    /// one cut in half. No edge is cut, nor any image formed, to a hundredth of a pixel.
    pub fn doubt_edges(&self, plan: &mut Plan, state: &State, share: f64) {
        let turned = Turned::new(&state.pose);
        let mut doubts = Vec::with_capacity(16384);
        for strips in groups(&plan.strips) {
            let cut = strips.iter().any(|s| s.cuts.0 != s.cuts.1);
            let Some(strip) = strips.first() else {
                continue;
            };
            for row in strip.first_row..strip.end_row {
                let mut torn = 0.0;
                if cut {
                    self.light(
                        &turned,
                        state,
                        plan,
                        strips,
                        row,
                        &mut Column::zeros(),
                        &mut torn,
                    );
                }
                doubts.push((share * torn) as f32);
            }
        }
        plan.doubts = doubts;
    }

    /// Five spreads of the coarsest pixel along the floor, and what the stripe's thickness shifts.
    fn edge_reach_m(&self, turned: &Turned) -> f64 {
        let middle = self.table.width_px / 2;
        let metres_per_px =
            self.row_of_level(turned, middle, 0.0)
                .map_or(0.0015, |(hit, _, sight)| {
                    let across = hit.t * sight[1].norm();
                    across.max(((self.table.l_laser_m - self.table.eye_m.x) * hit.t_slope[1]).abs())
                });
        EDGE_SPREADS * self.spread_px2.sqrt() * metres_per_px.clamp(1e-5, 0.01) + EDGE_SHIFT_M
    }

    /// Row at which a column sees the middle of the sheet on a level, with the hit at the nearest pixel.
    fn row_of_level(
        &self,
        turned: &Turned,
        column: usize,
        height_m: f64,
    ) -> Option<(Hit, f64, [Vector3<f64>; 3])> {
        let last = self.table.height_px as f64 - 2.0;
        let mut row = 0.5 * last;
        let mut found = None;
        for _ in 0..8 {
            let at = row.round().clamp(1.0, last);
            let sight = self.table.sight_with_slopes(column, at as usize);
            let hit = self.hit(turned, &sight, height_m)?;
            let next = at - (hit.t - 1.0) / hit.t_slope[1];
            if !next.is_finite() {
                return None;
            }
            let done = (next - row).abs() < 0.3;
            row = next;
            found = Some((hit, row, sight));
            if done {
                break;
            }
        }
        found
    }

    fn plan_column(&self, turned: &Turned, state: &State, column: usize, plan: &mut Plan) {
        let lever = self.table.l_laser_m - self.table.eye_m.x;
        let first = plan.strips.len();
        for level in 0..=self.surfaces.tops.len() {
            let Some((hit, row, sight)) = self.row_of_level(turned, column, self.height(level))
            else {
                continue;
            };
            let body = self.table.eye_m + hit.t * sight[0];
            // NaN (no map there) is outside too.
            let in_fan = body.y.abs() <= (self.tan_half_fan - FAN_MARGIN) * body.z;
            if !in_fan {
                continue;
            }
            let metres_per_row = (lever * hit.t_slope[1]).abs();
            let reach_m = REACH
                * state
                    .thickness_m
                    .hypot(metres_per_row * self.spread_px2.sqrt());
            let half = reach_m / metres_per_row + MOVE_PX;
            let (low, high) = (
                (row - half).ceil().max(1.0),
                (row + half).floor().min(self.table.height_px as f64 - 2.0),
            );
            if low > high {
                continue;
            }
            let Some(cuts) = self.cuts(turned, &sight, level, hit.p, reach_m, plan) else {
                continue;
            };
            plan.strips.push(Strip {
                column,
                first_row: low as usize,
                end_row: high as usize + 1,
                level,
                cuts,
                shares: false,
            });
        }
        join(&mut plan.strips, first);
    }

    /// What may cut the light of a level about `p`; `None`: it is surely dark there.
    fn cuts(
        &self,
        turned: &Turned,
        sight: &[Vector3<f64>; 3],
        level: usize,
        p: [f64; 2],
        reach_m: f64,
        plan: &mut Plan,
    ) -> Option<(u32, u32)> {
        let start = (plan.cuts.len(), plan.edges.len());
        let room_m = plan.edge_reach_m + MOVE_M;
        let look = |outline: &Outline, p: [f64; 2], edges: &mut Vec<u16>| {
            let from = edges.len() as u32;
            for (k, e) in outline.edges.iter().enumerate() {
                let along = e.along_m(p);
                let beside = e.inside_m(p).abs() < room_m + reach_m;
                if beside && along > -room_m - reach_m && along < e.length_m + room_m + reach_m {
                    edges.push(k as u16);
                }
            }
            Near {
                from,
                to: edges.len() as u32,
                inside: outline.contains(p),
            }
        };
        let mut dark = false;
        if let Some(top) = self.surfaces.tops.get(level) {
            let foot = look(&top.outline, p, &mut plan.edges);
            if foot.from != foot.to {
                plan.cuts.push(Cut {
                    top: level,
                    own: true,
                    foot,
                    head: Near::default(),
                });
            } else {
                dark = !foot.inside;
            }
        }
        let higher = self
            .surfaces
            .tops
            .iter()
            .enumerate()
            .take(level)
            .filter(|(_, t)| t.height_m > self.height(level));
        for (k, top) in higher {
            let above = self.hit(turned, sight, top.height_m)?.p;
            let foot = look(&top.outline, p, &mut plan.edges);
            let head = look(&top.outline, above, &mut plan.edges);
            if foot.from == foot.to && head.from == head.to {
                dark |= foot.inside || head.inside;
            } else {
                plan.cuts.push(Cut {
                    top: k,
                    own: false,
                    foot,
                    head,
                });
            }
        }
        if dark {
            plan.cuts.truncate(start.0);
            plan.edges.truncate(start.1);
            return None;
        }
        Some((start.0 as u32, plan.cuts.len() as u32))
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
                let Some(light) = self.light(&turned, state, plan, strips, row, &mut j, &mut 0.0)
                else {
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
        for a in 0..PARAMETERS {
            for b in a + 1..PARAMETERS {
                sums.information[(a, b)] = sums.information[(b, a)];
            }
        }
        sums
    }

    /// Laser light of one pixel, its derivatives added to `j`, and to `torn` how much of it hangs on an edge.
    #[allow(clippy::too_many_arguments)]
    fn light(
        &self,
        turned: &Turned,
        state: &State,
        plan: &Plan,
        strips: &[Strip],
        row: usize,
        j: &mut Column,
        torn: &mut f64,
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
                if share == 0.0 {
                    continue;
                }
                *torn += state.brightness * bare * 4.0 * share * (1.0 - share);
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

    /// What passes of a strip's light: on its own top, and in front of nothing higher.
    fn passing(
        &self,
        turned: &Turned,
        sight: &[Vector3<f64>; 3],
        plan: &Plan,
        strip: &Strip,
        hit: &Hit,
        stripe: &Stripe,
    ) -> Passing {
        let mut passing = Passing::ALL;
        for cut in &plan.cuts[strip.cuts.0 as usize..strip.cuts.1 as usize] {
            if passing.share == 0.0 {
                break;
            }
            let top = &self.surfaces.tops[cut.top];
            let foot = self.inside(turned, sight, plan, &cut.foot, &top.outline, hit, stripe);
            if cut.own {
                passing = passing.and(foot);
                continue;
            }
            // The slab hides what lies under its top and, seen from the side, behind it: in the
            // image the union of its foot and its top, of which the one that reaches farther decides.
            let hidden = match self.hit(turned, sight, top.height_m) {
                Some(above) if foot.share < 1.0 => {
                    let swept = self.swept(turned, sight, plan, cut, [hit, &above], stripe);
                    swept.unwrap_or_else(|| {
                        let head = self.inside(
                            turned,
                            sight,
                            plan,
                            &cut.head,
                            &top.outline,
                            &above,
                            stripe,
                        );
                        if head.share > foot.share { head } else { foot }
                    })
                }
                _ => foot,
            };
            passing = passing.and(hidden.blocked());
        }
        passing
    }

    /// What a slab hides about an upright edge of its silhouette: where a convex corner has one face
    /// towards the camera and one away from it, the foot of the first, the top of the second and
    /// the upright edge between them bound the dark. `None` where no such corner is near.
    fn swept(
        &self,
        turned: &Turned,
        sight: &[Vector3<f64>; 3],
        plan: &Plan,
        cut: &Cut,
        [foot, head]: [&Hit; 2],
        stripe: &Stripe,
    ) -> Option<Passing> {
        let outline = &self.surfaces.tops[cut.top].outline;
        let n = outline.edges.len();
        let away = [foot.p[0] - head.p[0], foot.p[1] - head.p[1]];
        let length = away[0].hypot(away[1]);
        if length < 1e-6 {
            return None;
        }
        let away = away.map(|v| v / length);
        let toward = |e: &Edge| e.inward[0] * away[0] + e.inward[1] * away[1];
        let reach_m = 1.5 * plan.edge_reach_m;
        let listed = plan
            .near(&cut.foot)
            .iter()
            .chain(plan.near(&cut.head))
            .map(|k| usize::from(*k));
        let corners = listed.flat_map(|k| [k, (k + 1) % n]);
        let mut best: Option<(f64, usize, Edge)> = None;
        for k in corners {
            let (before, after) = (&outline.edges[(k + n - 1) % n], &outline.edges[k]);
            if !after.convex_at_start || toward(before) * toward(after) >= 0.0 {
                continue;
            }
            let inner = [
                before.inward[0] + after.inward[0],
                before.inward[1] + after.inward[1],
            ];
            let mut inward = [-away[1], away[0]];
            if inward[0] * inner[0] + inward[1] * inner[1] < 0.0 {
                inward = inward.map(|v| -v);
            }
            let upright = Edge {
                from_m: after.from_m,
                to_m: after.from_m,
                inward,
                along: away,
                length_m: length,
                convex_at_start: true,
            };
            // Along the sight the corner must lie between top and foot.
            let beside = upright.inside_m(foot.p).abs();
            let behind = upright.along_m(foot.p);
            let between = behind > -reach_m && behind < length + reach_m;
            if between && beside < reach_m && best.as_ref().is_none_or(|b| beside < b.0) {
                best = Some((beside, k, upright));
            }
        }
        let (_, k, upright) = best?;
        let (before, after) = (&outline.edges[(k + n - 1) % n], &outline.edges[k]);
        let (facing, averted) = if toward(before) > 0.0 {
            (before, after)
        } else {
            (after, before)
        };
        let mut sides = [
            self.standard(turned, sight, facing, foot, stripe),
            self.standard(turned, sight, averted, head, stripe),
            self.standard(turned, sight, &upright, foot, stripe),
        ];
        sides.sort_by(|a, b| a.x.total_cmp(&b.x));
        let [first, second, third] = &sides;
        Some(corner(first, second, true, stripe).and(third.alone()))
    }

    /// Share of the light that falls inside an outline.
    #[allow(clippy::too_many_arguments)]
    fn inside(
        &self,
        turned: &Turned,
        sight: &[Vector3<f64>; 3],
        plan: &Plan,
        near: &Near,
        outline: &Outline,
        hit: &Hit,
        stripe: &Stripe,
    ) -> Passing {
        let wholly = |inside: bool| if inside { Passing::ALL } else { Passing::NONE };
        let candidates = plan.near(near).iter().map(|k| {
            (
                usize::from(*k),
                outline.edges[usize::from(*k)].distance_m(hit.p),
            )
        });
        let Some((nearest, distance)) = candidates.min_by(|a, b| a.1.total_cmp(&b.1)) else {
            return wholly(near.inside);
        };
        let reach_m = plan.edge_reach_m;
        if distance > reach_m {
            return wholly(outline.contains(hit.p));
        }
        let n = outline.edges.len();
        let edge = &outline.edges[nearest];
        let along = edge.along_m(hit.p);
        let first = self.standard(turned, sight, edge, hit, stripe);
        let neighbour = if along < reach_m && along < 0.5 * edge.length_m {
            Some(((nearest + n - 1) % n, edge.convex_at_start))
        } else if edge.length_m - along < reach_m {
            let next = (nearest + 1) % n;
            Some((next, outline.edges[next].convex_at_start))
        } else {
            None
        };
        let Some((other, convex)) = neighbour else {
            return first.alone();
        };
        let second = self.standard(turned, sight, &outline.edges[other], hit, stripe);
        corner(&first, &second, convex, stripe)
    }

    fn standard(
        &self,
        turned: &Turned,
        sight: &[Vector3<f64>; 3],
        edge: &Edge,
        hit: &Hit,
        stripe: &Stripe,
    ) -> Standard {
        let [d, du, dv] = sight;
        let [nx, ny] = edge.inward;
        let n = Vector3::new(nx, ny, 0.0);
        // n·R as a row: what a body direction adds to the distance.
        let row = n.transpose() * turned.r;
        let toward = (row * d)[0];
        let slope = [
            hit.t * (row * du)[0] + toward * hit.t_slope[0],
            hit.t * (row * dv)[0] + toward * hit.t_slope[1],
        ];
        let x = self.table.eye_m + hit.t * d;
        let turn = |k: usize| (n.transpose() * turned.by[k] * x)[0];
        let de = [
            nx,
            ny,
            toward * hit.dt[0],
            turn(0) + toward * hit.dt[1],
            turn(1) + toward * hit.dt[2],
            turn(2),
        ];
        let mixed = stripe.spread * (slope[0] * stripe.s_slope[0] + slope[1] * stripe.s_slope[1]);
        let of_s = mixed / stripe.total2;
        let variance = stripe.spread * (slope[0] * slope[0] + slope[1] * slope[1]) - mixed * of_s;
        let variance = variance.max(1e-12);
        let sd = variance.sqrt();
        let mut dx = de;
        for (k, ds) in stripe.ds.iter().enumerate() {
            dx[2 + k] -= of_s * ds;
        }
        let x = (edge.inside_m(hit.p) - stripe.s * of_s) / sd;
        Standard {
            x,
            sd,
            slope,
            mixed,
            dx: dx.map(|v| v / sd),
            // Of e' and of τ.
            dx_thickness: 2.0 * stripe.s * of_s * stripe.sigma / stripe.total2 / sd
                - x * of_s * of_s * stripe.sigma / variance,
        }
    }
}

impl Standard {
    /// Share inside this edge alone.
    fn alone(&self) -> Passing {
        let slope = density(self.x);
        Passing {
            share: cumulative(self.x),
            by_pose: self.dx.map(|d| slope * d),
            by_thickness: slope * self.dx_thickness,
        }
    }
}

/// Two edges at a corner: inside both (convex) or either (concave).
fn corner(first: &Standard, second: &Standard, convex: bool, stripe: &Stripe) -> Passing {
    let across =
        stripe.spread * (first.slope[0] * second.slope[0] + first.slope[1] * second.slope[1]);
    let rho = ((across - first.mixed * second.mixed / stripe.total2) / (first.sd * second.sd))
        .clamp(-0.97, 0.97);
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

/// Strips that share their pixels, together.
fn groups(strips: &[Strip]) -> impl Iterator<Item = &[Strip]> {
    strips.chunk_by(|a, _| a.shares)
}

/// Gives overlapping strips of one column, from `first` on, the same rows: their light adds up there.
fn join(strips: &mut [Strip], first: usize) {
    let Some(column) = strips.get_mut(first..) else {
        return;
    };
    column.sort_by_key(|s| s.first_row);
    let mut group = 0;
    for i in 1..=column.len() {
        let end = column[group..i]
            .iter()
            .map(|s| s.end_row)
            .max()
            .unwrap_or(0);
        if i < column.len() && column[i].first_row < end {
            continue;
        }
        let from = column[group].first_row;
        for (k, s) in column[group..i].iter_mut().enumerate() {
            (s.first_row, s.end_row, s.shares) = (from, end, group + k + 1 < i);
        }
        group = i;
    }
}

#[cfg(test)]
mod tests;
