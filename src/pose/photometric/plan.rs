//! Pixels that a frame is judged by, and edges that can cut their light.

use super::edge_model_error::EdgeName;
use super::edge_strips::CUTS_MOST;
use super::pose_geometry::{Hit, PoseGeometry, Ray};
use super::visibility::upright_corner;
use super::{Photometric, State};
use crate::outline::Outline;

/// Reach of the light, standard deviations.
const REACH: f64 = 3.7;
/// Room for the pose to move after the pixels were chosen \[px\].
const MOVE_PX: f64 = 1.0;
/// A hit this many spreads of its pixel from an edge, and this far, is wholly in or out (to 1e-4 of the light).
const EDGE_SPREADS: f64 = 3.8;
const EDGE_SHIFT_M: f64 = 0.0015;
/// Points this near the ends of the fan are not used, as a tangent.
const FAN_MARGIN: f64 = 0.012;

/// A column need not be looked at again until the line has gone this far, if no edge is near \[m\].
const LOOK_AHEAD_M: f64 = 0.03;

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
    /// Index of the upper face; the number of upper faces = floor.
    pub level: usize,
    /// Range in [`Plan::cuts`] of those that cut the level here; empty = nothing does.
    pub cuts: (u32, u32),
    /// The next strip covers the same pixels: their light adds up.
    pub shares: bool,
    /// Nothing but single edges and corners of two cuts it, and nothing upright.
    pub simple: bool,
}

/// One thing that cuts a strip's light.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cut {
    /// Index of the upper face whose outline it is.
    pub face: usize,
    /// Own outline, or one above.
    pub own: bool,
    /// At the level's own height.
    pub foot: Near,
    /// At the height of `face`, for one above.
    pub head: Near,
    /// An upright edge of the slab may stand between the two.
    pub upright: bool,
}

/// Pixels that a frame is judged by.
#[derive(Debug, Clone, Default)]
pub(crate) struct Plan {
    pub(super) strips: Vec<Strip>,
    cuts: Vec<Cut>,
    edges: Vec<u16>,
    /// Distance from an edge beyond which a hit is wholly in or out \[m\].
    pub edge_reach_m: f64,
    room_m: f64,
    /// Mean row of the strips.
    pub middle_row: f64,
}

impl Strip {
    /// Whether something may cut its light.
    pub fn cut(&self) -> bool {
        self.cuts.0 != self.cuts.1
    }
}

impl Plan {
    /// The same with every `keep`-th only of the columns that no edge crosses.
    pub(crate) fn thinned(&self, keep: usize) -> Plan {
        let columns = self.strips.chunk_by(|a, b| a.column == b.column);
        let mut plain = 0;
        let kept = columns.filter(|strips| {
            let crossed = strips.iter().any(|s| s.cut() || s.shares);
            plain += usize::from(!crossed);
            crossed || plain % keep.max(1) == 0
        });
        Plan {
            strips: kept.flatten().copied().collect(),
            ..self.clone()
        }
    }

    /// The same without what edges may cut.
    pub(crate) fn uncut(&self) -> Plan {
        let groups = groups(&self.strips).filter(|strips| !strips.iter().any(Strip::cut));
        Plan {
            strips: groups.flatten().copied().collect(),
            ..self.clone()
        }
    }

    /// Cuts of a strip.
    pub(super) fn cuts(&self, strip: &Strip) -> &[Cut] {
        &self.cuts[strip.cuts.0 as usize..strip.cuts.1 as usize]
    }

    /// The edge that cuts a strip, the first where there are several.
    pub(super) fn edge(&self, strip: &Strip) -> Option<EdgeName> {
        let near = |c: &Cut| {
            let head = self.near(&c.head).iter();
            let edge = self.near(&c.foot).iter().chain(head).next();
            edge.map(|e| (c.face as u16, *e))
        };
        let (face, edge) = self.cuts(strip).iter().find_map(near)?;
        Some(EdgeName { face, edge })
    }

    pub(super) fn near(&self, near: &Near) -> &[u16] {
        &self.edges[near.from as usize..near.to as usize]
    }
}

/// Columns that a plan takes, and room for the pose to move.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Choice {
    /// Every so many columns.
    pub step: usize,
    /// Of those that no edge crosses, every so many.
    pub keep: usize,
    /// Room for the pose to move after the pixels were chosen \[m\].
    pub room_m: f64,
}

impl Choice {
    /// Every column.
    pub const ALL: Choice = Choice {
        step: 1,
        keep: 1,
        room_m: 0.003,
    };
}

/// Place and light of a level in a column before: they hold until the line has gone `slack_m` on.
#[derive(Debug, Clone, Copy)]
struct Found {
    row: f64,
    p: [f64; 2],
    slack_m: f64,
    lit: bool,
}

/// Where a column meets a level.
struct Meeting {
    hit: Hit,
    row: f64,
    ray: Ray,
}

impl Photometric {
    /// The pixels a state calls for: along each level where it could be lit.
    pub fn plan(&self, state: &State, choice: Choice) -> Plan {
        let geometry = PoseGeometry::new(&state.pose, &self.surfaces);
        let mut plan = Plan {
            edge_reach_m: self.edge_reach_m(&geometry),
            room_m: choice.room_m,
            ..Plan::default()
        };
        let setting = Setting {
            geometry: &geometry,
            state,
            reachable: self.reachable(&geometry, state, &plan),
        };
        let mut found = vec![None; self.surfaces.faces.len() + 1];
        let columns = (1..self.table.width_px.saturating_sub(1)).step_by(choice.step.max(1));
        for (k, column) in columns.enumerate() {
            let interior = k % choice.keep.max(1) == 0;
            self.plan_column(&setting, column, interior, &mut found, &mut plan);
        }
        let rows = plan
            .strips
            .iter()
            .map(|s| 0.5 * (s.first_row + s.end_row) as f64);
        plan.middle_row = rows.sum::<f64>() / plan.strips.len().max(1) as f64;
        plan
    }

    /// Of each upper face the edges to which the sheet's line comes nearer than what is looked ahead.
    fn reachable(&self, geometry: &PoseGeometry, state: &State, plan: &Plan) -> Vec<Vec<u16>> {
        let start = 0.5 * self.table.height_px as f64;
        let highest_m = self.surfaces.faces.first().map_or(0.0, |t| t.height_m);
        let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
        // Between so many columns the line, a straight one, goes less far along X than it is looked ahead.
        for column in (1..self.table.width_px).step_by(16) {
            for height_m in [0.0, highest_m] {
                if let Some(met) = self.row_of_level(geometry, column, height_m, start) {
                    least = least.min(met.hit.p[0]);
                    most = most.max(met.hit.p[0]);
                }
            }
        }
        // By no more than its height a sight moves from an upper face to the level below it.
        let across_m = LOOK_AHEAD_M
            + plan.edge_reach_m
            + plan.room_m
            + 2.0 * REACH * state.thickness_m
            + highest_m;
        let faces = self.surfaces.faces.iter();
        faces
            .map(|face| {
                (0u16..)
                    .zip(&face.outline.edges)
                    .filter(|(_, e)| {
                        let [low, high] = e.x_range_m;
                        low < most + across_m && high > least - across_m
                    })
                    .map(|(k, _)| k)
                    .collect()
            })
            .collect()
    }

    /// Some spreads of the coarsest pixel along the floor, and what the stripe's thickness shifts.
    fn edge_reach_m(&self, geometry: &PoseGeometry) -> f64 {
        let middle = self.table.width_px / 2;
        let start = 0.5 * (self.table.height_px as f64 - 2.0);
        let metres_per_px = self
            .row_of_level(geometry, middle, 0.0, start)
            .map_or(0.0015, |m| {
                let [y, z] = m.ray.slopes[0];
                let across = m.hit.t * y.hypot(z);
                across.max((self.table.lever_m * m.hit.t_slope[1]).abs())
            });
        EDGE_SPREADS * self.spread_px2.sqrt() * metres_per_px.clamp(1e-5, 0.01) + EDGE_SHIFT_M
    }

    /// Row at which a column sees the middle of the sheet on a level, with the hit at the nearest pixel.
    fn row_of_level(
        &self,
        geometry: &PoseGeometry,
        column: usize,
        height_m: f64,
        start_row: f64,
    ) -> Option<Meeting> {
        let last = self.table.height_px as f64 - 2.0;
        let mut row = start_row;
        for again in (0..8).rev() {
            // The nearest one; casts go down.
            let at = (row + 0.5).clamp(1.0, last) as usize;
            let ray = self.ray(column, at);
            let hit = self.hit(geometry, &ray, height_m)?;
            let next = at as f64 - (hit.t - 1.0) / hit.t_slope[1];
            if !next.is_finite() {
                return None;
            }
            // Newton's method: from within 4 rows it is right to a hundredth.
            let done = (next - row).abs() < 4.0;
            row = next;
            if done || again == 0 {
                return Some(Meeting { hit, row, ray });
            }
        }
        None
    }

    fn plan_column(
        &self,
        setting: &Setting<'_>,
        column: usize,
        interior: bool,
        found: &mut [Option<Found>],
        plan: &mut Plan,
    ) {
        let Setting {
            geometry, state, ..
        } = *setting;
        let first = plan.strips.len();
        for (level, found) in found.iter_mut().enumerate() {
            let start_row = found.map_or(0.5 * self.table.height_px as f64, |f| f.row);
            let Some(met) = self.row_of_level(geometry, column, self.height(level), start_row)
            else {
                *found = None;
                continue;
            };
            let (hit, row) = (met.hit, met.row);
            // NaN (no map there) is outside too.
            let in_fan = hit.x[1].abs() <= (self.tan_half_fan - FAN_MARGIN) * hit.x[2];
            if !in_fan {
                *found = None;
                continue;
            }
            let metres_per_row = (self.table.lever_m * hit.t_slope[1]).abs();
            let thickness2 = state.thickness_m * state.thickness_m;
            let reach_m =
                REACH * (thickness2 + metres_per_row * metres_per_row * self.spread_px2).sqrt();
            let half = reach_m / metres_per_row + MOVE_PX;
            // The first and last whole rows between; casts go down, and to zero from below it.
            let last = self.table.height_px.saturating_sub(2);
            let low = ((row - half).max(0.0) as usize + 1).max(1);
            let high = ((row + half).max(0.0) as usize).min(last);
            if low > high {
                *found = None;
                continue;
            }
            let cuts = match *found {
                // Nothing cuts it as far as the line has come since.
                Some(old) if distance2(old.p, hit.p) < old.slack_m * old.slack_m => {
                    *found = Some(Found { row, ..old });
                    old.lit.then_some(((0, 0), true))
                }
                _ => {
                    let mut slack_m = LOOK_AHEAD_M;
                    let span = Span {
                        column,
                        rows: [low, high],
                        middle: met.ray,
                        p: hit.p,
                        reach_m,
                    };
                    let cuts = self.cuts(setting, &span, level, &mut slack_m, plan);
                    *found = Some(Found {
                        row,
                        p: hit.p,
                        // Higher levels move no faster than the floor; a tenth is for the perspective.
                        slack_m: 0.9 * slack_m.max(0.0),
                        lit: cuts.is_some(),
                    });
                    cuts
                }
            };
            let Some((cuts, simple)) = cuts else {
                continue;
            };
            plan.strips.push(Strip {
                column,
                first_row: low,
                end_row: high + 1,
                level,
                cuts,
                shares: false,
                simple,
            });
        }
        join(&mut plan.strips, first);
        if !interior {
            let plain = plan.strips[first..].iter().all(|s| !s.cut() && !s.shares);
            if plain {
                plan.strips.truncate(first);
            }
        }
    }

    /// Cuts that the light of a level may have, and whether they are single edges only; `None`: it is
    /// surely dark there. `slack_m` is lowered to how far the line may go before an edge comes near.
    fn cuts(
        &self,
        setting: &Setting<'_>,
        span: &Span,
        level: usize,
        slack_m: &mut f64,
        plan: &mut Plan,
    ) -> Option<((u32, u32), bool)> {
        let geometry = setting.geometry;
        let start = (plan.cuts.len(), plan.edges.len());
        let (p, reach_m) = (span.p, span.reach_m);
        let room_m = plan.edge_reach_m + plan.room_m;
        let mut simple = true;
        // Where the strip's first and last pixels meet a height.
        let ends = |height_m: f64| -> Option<[[f64; 2]; 2]> {
            let [a, b] = span.rows.map(|row| {
                let hit = self.hit(geometry, &self.ray(span.column, row), height_m);
                hit.map(|hit| hit.p)
            });
            Some([a?, b?])
        };
        let mut look =
            |k: usize, p: [f64; 2], height_m: f64, edges: &mut Vec<u16>, slack_m: &mut f64| {
                let outline = &self.surfaces.faces[k].outline;
                let from = edges.len();
                let mut line = None;
                for k in setting.reachable_of(k) {
                    let e = &outline.edges[usize::from(*k)];
                    // Most edges are too far along X to matter to either.
                    let [low, high] = e.x_range_m;
                    let beside = (low - p[0]).max(p[0] - high);
                    if beside > room_m + reach_m + slack_m.max(0.0) {
                        continue;
                    }
                    let along = e.along_m(p);
                    // Distance from a box about the edge.
                    let beyond = (-along).max(along - e.length_m).max(e.inside_m(p).abs());
                    *slack_m = slack_m.min(beyond - room_m - reach_m);
                    if beyond > room_m + reach_m {
                        continue;
                    }
                    let line = *line.get_or_insert_with(|| ends(height_m).unwrap_or([p; 2]));
                    if e.distance2_to_line_m2(line) > room_m * room_m {
                        continue;
                    }
                    edges.push(*k);
                }
                simple &= at_most_a_corner(outline, &edges[from..], line, room_m);
                Near {
                    from: from as u32,
                    to: edges.len() as u32,
                    inside: from == edges.len() && outline.contains(p),
                }
            };
        let own_m = self.height(level);
        if level < self.surfaces.faces.len() {
            let foot = look(level, p, own_m, &mut plan.edges, slack_m);
            if foot.from != foot.to {
                plan.cuts.push(Cut {
                    face: level,
                    own: true,
                    foot,
                    head: Near::default(),
                    upright: false,
                });
            } else if !foot.inside {
                *slack_m = slack_m.max(0.0);
                return None;
            }
        }
        let mut dark = false;
        let mut uprights = false;
        let higher = self
            .surfaces
            .faces
            .iter()
            .enumerate()
            .take(level)
            .filter(|(_, t)| t.height_m > own_m);
        for (k, face) in higher {
            let above = self.hit(geometry, &span.middle, face.height_m)?.p;
            if face.height_m - own_m > TALL_STEP_M {
                // Between its foot and its upper face a tall slab may hide the line with corners in
                // between: where it can, the level is not looked at at all.
                let between = |t: f64| [p[0] + t * (above[0] - p[0]), p[1] + t * (above[1] - p[1])];
                dark |= (0..=8).any(|i| {
                    let q = between(f64::from(i) / 8.0);
                    let room_m = room_m + reach_m;
                    let edges = setting.reachable_of(k).iter();
                    let edge_m = edges
                        .map(|e| face.outline.edges[usize::from(*e)].distance2_m2(q))
                        .fold(f64::INFINITY, f64::min)
                        .sqrt();
                    *slack_m = slack_m.min((edge_m - room_m).abs());
                    face.outline.contains(q) || edge_m < room_m
                });
                continue;
            }
            let foot = look(k, p, own_m, &mut plan.edges, slack_m);
            let head = look(k, above, face.height_m, &mut plan.edges, slack_m);
            if foot.from == foot.to && head.from == head.to {
                dark |= foot.inside || head.inside;
            } else {
                let near = plan.near(&foot).iter().chain(plan.near(&head));
                // The pixels of a strip lie one behind the other, along the sight.
                let room_m = 1.5 * plan.edge_reach_m + plan.room_m;
                let room_m = [room_m, room_m + reach_m];
                let upright =
                    upright_corner(&face.outline, near.copied(), p, above, room_m).is_some();
                uprights |= upright;
                plan.cuts.push(Cut {
                    face: k,
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
        let cuts = (start.0 as u32, plan.cuts.len() as u32);
        // More cuts than the fast way provides for do not occur on flat targets of a few levels.
        let simple = simple && !uprights && cuts.1 - cuts.0 <= CUTS_MOST as u32;
        Some((cuts, simple))
    }

    pub(super) fn ray(&self, column: usize, row: usize) -> Ray {
        let [y, z] = self.table.sight(column, row);
        Ray {
            sight: [self.table.lever_m, y, z],
            slopes: self.table.slopes(column, row),
        }
    }
}

/// State that a plan is made for, with the edges in reach.
struct Setting<'a> {
    geometry: &'a PoseGeometry,
    state: &'a State,
    /// Of each upper face the edges that any column can come near.
    reachable: Vec<Vec<u16>>,
}

impl Setting<'_> {
    fn reachable_of(&self, face: usize) -> &[u16] {
        self.reachable.get(face).map_or(&[], Vec::as_slice)
    }
}

/// A strip on its level before it is known what cuts it.
struct Span {
    column: usize,
    /// First and last pixel.
    rows: [usize; 2],
    /// Where the sheet's middle meets the level.
    middle: Ray,
    p: [f64; 2],
    /// How far its light reaches from there.
    reach_m: f64,
}

/// Whether the edges near a line are one, or two that meet at a corner, and no other corner is near.
fn at_most_a_corner(
    outline: &Outline,
    near: &[u16],
    line: Option<[[f64; 2]; 2]>,
    room_m: f64,
) -> bool {
    let n = outline.edges.len();
    // Whether a line's end comes near the edge's start, or its end.
    let ends = |k: usize| {
        let e = &outline.edges[k];
        let along = line.into_iter().flatten().map(|p| e.along_m(p));
        along.fold((false, false), |(start, end), along| {
            (
                start | (along < room_m),
                end | (along > e.length_m - room_m),
            )
        })
    };
    match near {
        [] => true,
        [one] => ends(usize::from(*one)) == (false, false),
        [one, other] => {
            let (one, other) = (usize::from(*one), usize::from(*other));
            // The earlier of the two ends where the later begins.
            let (earlier, later) = if (one + 1) % n == other {
                (one, other)
            } else if (other + 1) % n == one {
                (other, one)
            } else {
                return false;
            };
            !ends(earlier).0 && !ends(later).1
        }
        _ => false,
    }
}

fn distance2(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)
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
