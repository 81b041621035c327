//! Which pixels a frame is judged by, and which edges can cut their light.

use super::passing::{Doubt, upright_corner};
use super::turned::{Hit, Turned};
use super::{Column, Photometric, State};
use crate::pose::outline::Outline;
use nalgebra::Vector3;

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

/// Pixels with this much light torn by an edge say how good the edges are \[grey levels\].
const TORN: f64 = 20.0;
/// Residuals beyond this share of the torn light are particles, not edges.
const EXCESS_MOST: f64 = 0.15;
/// Least and greatest doubt: what is found from a thousand pixels is uncertain itself.
const DOUBT_RANGE: [f64; 2] = [0.005, 0.1];

/// Steps higher than this hide more of the lower level than one corner of the outline \[m\].
const TALL_STEP_M: f64 = 0.05;

/// Edges of one outline that pass near a strip.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Near {
    /// In [`Plan::edges`].
    pub from: u32,
    pub to: u32,
    /// Whether the strip lies inside, where no edge is near.
    pub inside: bool,
}

/// Pixels of one column about one level.
#[derive(Debug, Clone, Copy)]
pub(super) struct Strip {
    pub column: usize,
    pub first_row: usize,
    pub end_row: usize,
    /// Index of the top; the number of tops = floor.
    pub level: usize,
    /// What cuts the level here, in [`Plan::cuts`]; empty = nothing.
    pub cuts: (u32, u32),
    /// The next strip covers the same pixels: their light adds up.
    pub shares: bool,
}

/// One thing that cuts a strip's light.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cut {
    /// Index of the top whose outline it is.
    pub top: usize,
    /// Own outline, or one above.
    pub own: bool,
    /// At the level's own height.
    pub foot: Near,
    /// At the height of `top`, for one above.
    pub head: Near,
    /// An upright edge of the slab may stand between the two.
    pub upright: bool,
}

/// Which pixels a frame is judged by.
#[derive(Debug, Clone, Default)]
pub(in crate::pose) struct Plan {
    pub(super) strips: Vec<Strip>,
    pub(super) cuts: Vec<Cut>,
    edges: Vec<u16>,
    /// Distance from an edge beyond which a hit is wholly in or out \[m\].
    pub edge_reach_m: f64,
    /// Standard deviation of each pixel, in the order of [`Photometric::compare`], beyond its noise
    /// \[grey levels\]; empty = none. Held fixed, or the fit would flee into doubtful pixels.
    pub doubts: Vec<f32>,
}

impl Plan {
    /// The same with about every `keep`-th of the columns that no edge crosses.
    pub fn thinned(&self, keep: usize) -> Plan {
        // Half the column: plans of every second column have odd ones only.
        let strips = self
            .strips
            .iter()
            .filter(|s| s.cuts.0 != s.cuts.1 || s.shares || (s.column / 2) % keep == 0);
        Plan {
            strips: strips.copied().collect(),
            ..self.clone()
        }
    }

    pub(super) fn near(&self, near: &Near) -> &[u16] {
        &self.edges[near.from as usize..near.to as usize]
    }
}

impl Photometric {
    /// The pixels a state calls for: along each level where it could be lit.
    pub fn plan(&self, state: &State) -> Plan {
        self.plan_every(state, 1)
    }

    /// The same for every `step`-th column.
    pub fn plan_every(&self, state: &State, step: usize) -> Plan {
        let turned = Turned::new(&state.pose);
        let mut plan = Plan {
            edge_reach_m: self.edge_reach_m(&turned),
            ..Plan::default()
        };
        for column in (1..self.table.width_px.saturating_sub(1)).step_by(step.max(1)) {
            self.plan_column(&turned, state, column, &mut plan);
        }
        plan
    }

    /// Gives pixels that an edge cuts a standard deviation of their own, and returns it as a share
    /// of the light of a pixel cut in half. No edge is machined, nor any image formed, to a
    /// hundredth of a pixel: how well these are is seen in what the edges' pixels leave over at
    /// `state` beyond the noise.
    pub fn doubt_edges(&self, plan: &mut Plan, pixels: &[u8], state: &State, noise_sd: f64) -> f64 {
        let turned = Turned::new(&state.pose);
        let mut open: Vec<Doubt> = Vec::with_capacity(16384);
        let (mut excess, mut weight) = (0.0, 0.0);
        for strips in groups(&plan.strips) {
            let cut = strips.iter().any(|s| s.cuts.0 != s.cuts.1);
            let Some(strip) = strips.first() else {
                continue;
            };
            for row in strip.first_row..strip.end_row {
                let mut doubt = Doubt::default();
                if cut {
                    let mut j = Column::zeros();
                    let light = self.light(&turned, state, plan, strips, row, &mut j, &mut doubt);
                    let grey = pixels.get(row * self.table.width_px + strip.column);
                    if let (Some(light), Some(grey)) = (light, grey)
                        && doubt.edge > TORN
                        && doubt.corner < 1.0
                    {
                        let residual = f64::from(*grey) - light - state.background;
                        if residual.abs() < EXCESS_MOST * doubt.edge + 4.0 * noise_sd {
                            excess += residual * residual - noise_sd * noise_sd;
                            weight += doubt.edge * doubt.edge;
                        }
                    }
                }
                open.push(doubt);
            }
        }
        let found = if weight > 0.0 {
            (excess / weight).max(0.0).sqrt()
        } else {
            0.0
        };
        let share = found.clamp(DOUBT_RANGE[0], DOUBT_RANGE[1]);
        plan.doubts = open
            .iter()
            .map(|d| (share * d.edge).hypot(d.corner) as f32)
            .collect();
        share
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
                    upright: false,
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
            if top.height_m - self.height(level) > TALL_STEP_M {
                // Between its foot and its top a tall slab may hide the line with corners in
                // between: where it can, the level is not looked at at all.
                let between = |t: f64| [p[0] + t * (above[0] - p[0]), p[1] + t * (above[1] - p[1])];
                dark |= (0..=8).any(|i| {
                    let q = between(f64::from(i) / 8.0);
                    let room_m = room_m + reach_m;
                    top.outline.contains(q) || top.outline.nearest(q).is_some_and(|n| n.1 < room_m)
                });
                continue;
            }
            let foot = look(&top.outline, p, &mut plan.edges);
            let head = look(&top.outline, above, &mut plan.edges);
            if foot.from == foot.to && head.from == head.to {
                dark |= foot.inside || head.inside;
            } else {
                let near = plan.near(&foot).iter().chain(plan.near(&head));
                let room_m = 1.5 * plan.edge_reach_m + MOVE_M + reach_m;
                let upright =
                    upright_corner(&top.outline, near.copied(), p, above, room_m).is_some();
                plan.cuts.push(Cut {
                    top: k,
                    own: false,
                    foot,
                    head,
                    upright,
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
}

/// Strips that share their pixels, together.
pub(super) fn groups(strips: &[Strip]) -> impl Iterator<Item = &[Strip]> {
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
