//! Visible fraction of a pixel's light: inside its own upper face's edges, and not hidden by higher ones.

use super::Photometric;
use super::grid::Grid;
use super::plan::{Cut, Near, Plan, Strip};
use super::pose_geometry::{EdgeGeometry, Hit, PoseGeometry, Ray, dot};
use crate::normal::{Both, Pair, Tables};
use crate::outline::{Edge, Outline};

/// Visible fraction of a pixel's light, with its derivatives.
#[derive(Clone, Copy)]
pub(super) struct Visibility {
    pub share: f64,
    /// d share / d pose.
    pub by_pose: [f64; 6],
    /// d share / d thickness.
    pub by_thickness: f64,
    /// d share / d share of the blur that is formed on the pixel grid.
    pub by_grid: f64,
    /// Dependence of the share on what stands at an upright corner.
    pub uncertain: f64,
    /// An edge is near enough to cut the light.
    pub cut: bool,
}

impl Visibility {
    const ALL: Visibility = Visibility {
        share: 1.0,
        by_pose: [0.0; 6],
        by_thickness: 0.0,
        by_grid: 0.0,
        uncertain: 0.0,
        cut: false,
    };
    const NONE: Visibility = Visibility {
        share: 0.0,
        ..Visibility::ALL
    };

    fn blocked(self) -> Visibility {
        Visibility {
            share: 1.0 - self.share,
            by_pose: self.by_pose.map(|d| -d),
            by_thickness: -self.by_thickness,
            by_grid: -self.by_grid,
            ..self
        }
    }

    fn and(self, other: Visibility) -> Visibility {
        if !other.cut && other.share == 1.0 {
            return self;
        }
        if !self.cut && self.share == 1.0 {
            return other;
        }
        Visibility {
            share: self.share * other.share,
            by_pose: std::array::from_fn(|i| {
                self.by_pose[i] * other.share + self.share * other.by_pose[i]
            }),
            by_thickness: self.by_thickness * other.share + self.share * other.by_thickness,
            by_grid: self.by_grid * other.share + self.share * other.by_grid,
            uncertain: self.uncertain * other.share + self.share * other.uncertain,
            cut: self.cut || other.cut,
        }
    }
}

/// Dependence of a pixel's light on the places of edges and corners \[grey levels\].
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sensitivity {
    /// By edges: all of its light where it is cut in half.
    pub edge: f64,
    /// By upright corners: seen past one or not.
    pub corner: f64,
}

/// The stripe at a pixel, as an edge's distance depends on it.
pub(super) struct Stripe {
    pub s: f64,
    pub s_slope: [f64; 2],
    pub ds: [f64; 3],
    pub total2: f64,
    pub sigma: f64,
    pub spread: f64,
}

/// The distance from an edge in units of its spread, given the stripe's light.
pub(super) struct Standard {
    pub x: f64,
    sd: f64,
    pub slope: [f64; 2],
    mixed: f64,
    pub dx: [f64; 6],
    pub dx_thickness: f64,
}

/// All that a pixel's visible fraction depends on.
pub(super) struct PixelContext<'a> {
    pub geometry: &'a PoseGeometry,
    pub plan: &'a Plan,
    pub ray: &'a Ray,
    pub tables: &'static Tables,
    pub grid: &'a Grid,
    /// Share of the blur that is formed on the pixel grid.
    pub grid_share: f64,
    /// Whether derivatives by the run's parameters are wanted.
    pub of_run: bool,
}

impl Photometric {
    /// Visible fraction of a strip's light: on its own upper face, and behind nothing higher.
    pub(super) fn visibility(
        &self,
        context: &PixelContext<'_>,
        strip: &Strip,
        hit: &Hit,
        stripe: &Stripe,
    ) -> Visibility {
        let mut visibility = Visibility::ALL;
        for cut in context.plan.cuts(strip) {
            if visibility.share == 0.0 {
                break;
            }
            let face = &self.surfaces.faces[cut.face];
            let foot = self.inside(context, cut.face, &cut.foot, hit, stripe);
            if cut.own {
                visibility = visibility.and(foot);
                continue;
            }
            // The slab hides what lies under its upper face and, seen from the side, behind it: in the
            // image the union of its foot and its upper face, of which the one that reaches farther counts.
            let hidden = match self.hit(context.geometry, context.ray, face.height_m) {
                Some(above) if foot.share < 1.0 => {
                    let head = self.inside(context, cut.face, &cut.head, &above, stripe);
                    let covered = if head.share > foot.share { head } else { foot };
                    // Past an upright corner light shows or not by how sharp the corner is: the
                    // difference of the two results is uncertain, and is counted as such.
                    let swept = cut
                        .upright
                        .then(|| self.swept(context, cut, [hit, &above], stripe))
                        .flatten();
                    match swept {
                        Some(swept) => Visibility {
                            uncertain: swept.uncertain + (swept.share - covered.share).abs(),
                            ..swept
                        },
                        None => covered,
                    }
                }
                _ => foot,
            };
            visibility = visibility.and(hidden.blocked());
        }
        visibility
    }

    /// Share that a slab hides about an upright edge of its silhouette: where a convex corner has one face
    /// towards the camera and one away from it, the foot of the first, the upper face of the second and
    /// the upright edge between them bound the dark. `None` where no such corner is near.
    fn swept(
        &self,
        context: &PixelContext<'_>,
        cut: &Cut,
        [foot, head]: [&Hit; 2],
        stripe: &Stripe,
    ) -> Option<Visibility> {
        let outline = &self.surfaces.faces[cut.face].outline;
        let n = outline.edges.len();
        let near = context.plan.near(&cut.foot).iter();
        let near = near.chain(context.plan.near(&cut.head));
        let reach_m = 1.5 * context.plan.edge_reach_m;
        let (k, upright) = upright_corner(outline, near.copied(), foot.p, head.p, [reach_m; 2])?;
        let along = upright.along;
        let toward = |e: &Edge| e.inward[0] * along[0] + e.inward[1] * along[1];
        let (before, after) = ((k + n - 1) % n, k);
        let (facing, averted) = if toward(&outline.edges[before]) > 0.0 {
            (before, after)
        } else {
            (after, before)
        };
        let own = |k: usize| context.geometry.edge(cut.face, k);
        let upright = context.geometry.edge_of(upright.from_m, upright.inward);
        let mut sides = [
            standard(context.ray, own(facing), foot, stripe),
            standard(context.ray, own(averted), head, stripe),
            standard(context.ray, &upright, foot, stripe),
        ];
        sides.sort_by(|a, b| a.x.total_cmp(&b.x));
        let [first, second, third] = &sides;
        Some(corner(first, second, true, stripe, context).and(third.alone(context)))
    }

    /// Share of the light that falls inside an upper face's outline.
    fn inside(
        &self,
        context: &PixelContext<'_>,
        face: usize,
        near: &Near,
        hit: &Hit,
        stripe: &Stripe,
    ) -> Visibility {
        let wholly = |inside: bool| {
            if inside {
                Visibility::ALL
            } else {
                Visibility::NONE
            }
        };
        let outline = &self.surfaces.faces[face].outline;
        let mut nearest: Option<(f64, usize, f64, f64)> = None;
        for k in context.plan.near(near).iter().map(|k| usize::from(*k)) {
            let edge = &outline.edges[k];
            let (along, inside) = (edge.along_m(hit.p), edge.inside_m(hit.p));
            let beyond = (-along).max(along - edge.length_m).max(0.0);
            let square = inside * inside + beyond * beyond;
            if nearest.is_none_or(|n| square < n.0) {
                nearest = Some((square, k, along, inside));
            }
        }
        let Some((square, nearest, along, inside)) = nearest else {
            return wholly(near.inside);
        };
        let reach_m = context.plan.edge_reach_m;
        let edge = &outline.edges[nearest];
        if square > reach_m * reach_m {
            // Beside the nearest edge its side counts; beyond its ends the whole outline.
            return wholly(if along > 0.0 && along < edge.length_m {
                inside > 0.0
            } else {
                outline.contains(hit.p)
            });
        }
        let n = outline.edges.len();
        let first = standard(
            context.ray,
            context.geometry.edge(face, nearest),
            hit,
            stripe,
        );
        let neighbour = if along < reach_m && along < 0.5 * edge.length_m {
            Some(((nearest + n - 1) % n, edge.convex_at_start))
        } else if edge.length_m - along < reach_m {
            let next = (nearest + 1) % n;
            Some((next, outline.edges[next].convex_at_start))
        } else {
            None
        };
        let Some((other, convex)) = neighbour else {
            return first.alone(context);
        };
        let second = standard(context.ray, context.geometry.edge(face, other), hit, stripe);
        corner(&first, &second, convex, stripe, context)
    }
}

pub(super) fn standard(ray: &Ray, edge: &EdgeGeometry, hit: &Hit, stripe: &Stripe) -> Standard {
    // Distance per metre along each body axis.
    let row = &edge.row;
    let toward = dot(row, &ray.sight);
    let slope: [f64; 2] = std::array::from_fn(|k| {
        let [y, z] = ray.slopes[k];
        hit.t * (row[1] * y + row[2] * z) + toward * hit.t_slope[k]
    });
    let [nx, ny] = edge.inward;
    let mixed = stripe.spread * (slope[0] * stripe.s_slope[0] + slope[1] * stripe.s_slope[1]);
    let of_s = mixed / stripe.total2;
    let variance = stripe.spread * (slope[0] * slope[0] + slope[1] * slope[1]) - mixed * of_s;
    let variance = variance.max(1e-12);
    let sd = variance.sqrt();
    let inverse = 1.0 / sd;
    let [dz, dphi, dtheta]: [f64; 3] =
        std::array::from_fn(|k| toward * hit.dt[k] - of_s * stripe.ds[k]);
    let x = (edge.offset_m + dot(row, &hit.x) - stripe.s * of_s) * inverse;
    Standard {
        x,
        sd,
        slope,
        mixed,
        dx: [
            nx * inverse,
            ny * inverse,
            dz * inverse,
            (dot(&edge.by[0], &hit.x) + dphi) * inverse,
            (dot(&edge.by[1], &hit.x) + dtheta) * inverse,
            dot(&edge.by[2], &hit.x) * inverse,
        ],
        // Of e' and of τ.
        dx_thickness: of_s
            * stripe.sigma
            * (2.0 * stripe.s / stripe.total2 * inverse - x * of_s * inverse * inverse),
    }
}

impl Standard {
    /// Share inside this edge alone.
    fn alone(&self, context: &PixelContext<'_>) -> Visibility {
        let (share, slope) = context.tables.normal(self.x);
        let (by_grid, by_grid_slope) = context.grid.across(self.slope).at(self.x);
        let slope = slope + context.grid_share * by_grid_slope;
        Visibility {
            share: share + context.grid_share * by_grid,
            by_grid,
            by_pose: self.dx.map(|d| slope * d),
            by_thickness: slope * self.dx_thickness,
            uncertain: 0.0,
            cut: true,
        }
    }
}

/// An edge this many spreads away decides nothing at a corner.
pub(super) const FAR: f64 = 5.5;

/// Two edges at a corner: inside both (convex) or either (concave).
fn corner(
    first: &Standard,
    second: &Standard,
    convex: bool,
    stripe: &Stripe,
    context: &PixelContext<'_>,
) -> Visibility {
    let tables = context.tables;
    let (h, k) = (first.x, second.x);
    // Far inside one of two that must both hold, or far outside one of two of which either will do:
    // the other one bounds the light.
    let idle = |x: f64| if convex { x > FAR } else { x < -FAR };
    if idle(k) {
        return first.alone(context);
    }
    if idle(h) {
        return second.alone(context);
    }
    let pair = Pair::near(correlation(first, second, stripe));
    let found = if convex {
        pair.below(h, k, tables)
    } else {
        pair.either(h, k, tables)
    };
    let deviations = [first, second].map(|e| context.grid.across(e.slope).at(e.x));
    let found = CornerShare::of(
        found,
        [h, k],
        deviations,
        convex,
        context.grid_share,
        tables,
    );
    let [a, b] = found.by;
    Visibility {
        share: found.share,
        by_grid: found.by_grid,
        by_pose: std::array::from_fn(|i| a * first.dx[i] + b * second.dx[i]),
        by_thickness: a * first.dx_thickness + b * second.dx_thickness,
        uncertain: 0.0,
        cut: true,
    }
}

/// Two edges at a corner with part of the blur on the pixel grid. What that part, κ, adds to one edge is taken where the
/// other lets it pass, as if the two did not hang together: inside both Φ₂(h, k) + g κ(h) Φ(k) + g κ(k) Φ(h) + g² κ(h) κ(k).
pub(super) struct CornerShare {
    pub share: f64,
    pub by: [f64; 2],
    pub by_grid: f64,
}

impl CornerShare {
    pub fn of(
        both: Both,
        x: [f64; 2],
        deviations: [(f64, f64); 2],
        convex: bool,
        grid_share: f64,
        tables: &Tables,
    ) -> CornerShare {
        // Inside either is not inside neither: the same with all signs changed.
        let sign = if convex { 1.0 } else { -1.0 };
        let [(pass_h, at_h), (pass_k, at_k)] = x.map(|x| tables.normal(sign * x));
        let [(a, da), (b, db)] = deviations;
        let g = grid_share;
        CornerShare {
            share: (both.share + g * (a * pass_k + b * pass_h) + sign * g * g * a * b)
                .clamp(0.0, 1.0),
            by: [
                both.by[0] + g * (da * pass_k + sign * (b * at_h + g * da * b)),
                both.by[1] + g * (db * pass_h + sign * (a * at_k + g * db * a)),
            ],
            by_grid: a * pass_k + b * pass_h + sign * 2.0 * g * a * b,
        }
    }
}

/// Of the distances from two edges, given the stripe's light.
pub(super) fn correlation(first: &Standard, second: &Standard, stripe: &Stripe) -> f64 {
    let across =
        stripe.spread * (first.slope[0] * second.slope[0] + first.slope[1] * second.slope[1]);
    (across - first.mixed * second.mixed / stripe.total2) / (first.sd * second.sd)
}

/// The upright edge of a slab's silhouette nearest to where a ray passes, and the corner it stands
/// on: a convex one with one face towards the camera and one away from it, between where the ray
/// meets the upper face (`head`) and where it meets the level below (`foot`). `None` where none is near: so
/// far beside the sight, or beyond its ends.
pub(super) fn upright_corner(
    outline: &Outline,
    near: impl Iterator<Item = u16>,
    foot: [f64; 2],
    head: [f64; 2],
    [beside_m, beyond_m]: [f64; 2],
) -> Option<(usize, Edge)> {
    let n = outline.edges.len();
    let away = [foot[0] - head[0], foot[1] - head[1]];
    let length_m = away[0].hypot(away[1]);
    if length_m < 1e-6 {
        return None;
    }
    let away = away.map(|v| v / length_m);
    let toward = |e: &Edge| e.inward[0] * away[0] + e.inward[1] * away[1];
    let mut best: Option<(f64, usize, Edge)> = None;
    for k in near.map(usize::from).flat_map(|k| [k, (k + 1) % n]) {
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
            x_range_m: [after.from_m[0]; 2],
            inward,
            along: away,
            length_m,
            convex_at_start: true,
        };
        // Along the sight the corner must lie between upper face and foot.
        let beside = upright.inside_m(foot).abs();
        let behind = upright.along_m(foot);
        let between = behind > -beyond_m && behind < length_m + beyond_m;
        if between && beside < beside_m && best.as_ref().is_none_or(|b| beside < b.0) {
            best = Some((beside, k, upright));
        }
    }
    best.map(|(_, k, upright)| (k, upright))
}
