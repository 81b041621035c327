//! How much of a pixel's light passes the edges of the tops: its own, and those before it.

use super::Photometric;
use super::plan::{Cut, Near, Plan, Strip};
use super::turned::{Hit, Turned};
use crate::pose::normal::{cumulative, cumulative2, density};
use crate::pose::outline::{Edge, Outline};
use nalgebra::Vector3;

/// How much of the light of a pixel passes, with what moves it.
#[derive(Clone, Copy)]
pub(super) struct Passing {
    pub share: f64,
    /// d share / d pose.
    pub by_pose: [f64; 6],
    /// d share / d thickness.
    pub by_thickness: f64,
    /// How far the share hangs on what stands at an upright corner.
    pub unsure: f64,
}

impl Passing {
    const ALL: Passing = Passing {
        share: 1.0,
        by_pose: [0.0; 6],
        by_thickness: 0.0,
        unsure: 0.0,
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
            unsure: self.unsure,
        }
    }

    fn and(self, other: Passing) -> Passing {
        Passing {
            share: self.share * other.share,
            by_pose: std::array::from_fn(|i| {
                self.by_pose[i] * other.share + self.share * other.by_pose[i]
            }),
            by_thickness: self.by_thickness * other.share + self.share * other.by_thickness,
            unsure: self.unsure * other.share + self.share * other.unsure,
        }
    }
}

/// How much of a pixel's light is open \[grey levels\].
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Doubt {
    /// Cut by edges: all of it where one is cut in half.
    pub edge: f64,
    /// Seen past an upright corner or not.
    pub corner: f64,
}

/// What an edge needs to know of the stripe at a pixel.
pub(super) struct Stripe {
    pub s: f64,
    pub s_slope: [f64; 2],
    pub ds: [f64; 3],
    pub total2: f64,
    pub sigma: f64,
    pub spread: f64,
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
    /// What passes of a strip's light: on its own top, and in front of nothing higher.
    pub(super) fn passing(
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
                    let head =
                        self.inside(turned, sight, plan, &cut.head, &top.outline, &above, stripe);
                    let covered = if head.share > foot.share { head } else { foot };
                    // Past an upright corner light shows or not by how sharp the corner is: what
                    // the two answers differ by is not known, and is said to be not known.
                    let swept = cut
                        .upright
                        .then(|| self.swept(turned, sight, plan, cut, [hit, &above], stripe))
                        .flatten();
                    match swept {
                        Some(swept) => Passing {
                            unsure: swept.unsure + (swept.share - covered.share).abs(),
                            ..swept
                        },
                        None => covered,
                    }
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
        let near = plan.near(&cut.foot).iter().chain(plan.near(&cut.head));
        let reach_m = 1.5 * plan.edge_reach_m;
        let (k, upright) = upright_corner(outline, near.copied(), foot.p, head.p, reach_m)?;
        let along = upright.along;
        let toward = |e: &Edge| e.inward[0] * along[0] + e.inward[1] * along[1];
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
            // Beside the nearest edge its side decides; beyond its ends the whole outline.
            let edge = &outline.edges[nearest];
            let along = edge.along_m(hit.p);
            return wholly(if along > 0.0 && along < edge.length_m {
                edge.inside_m(hit.p) > 0.0
            } else {
                outline.contains(hit.p)
            });
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
            unsure: 0.0,
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
        unsure: 0.0,
    }
}

/// The upright edge of a slab's silhouette nearest to where a ray passes, and the corner it stands
/// on: a convex one with one face towards the camera and one away from it, between where the ray
/// meets the top (`head`) and where it meets the level below (`foot`). `None` where none is near.
pub(super) fn upright_corner(
    outline: &Outline,
    near: impl Iterator<Item = u16>,
    foot: [f64; 2],
    head: [f64; 2],
    reach_m: f64,
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
            inward,
            along: away,
            length_m,
            convex_at_start: true,
        };
        // Along the sight the corner must lie between top and foot.
        let beside = upright.inside_m(foot).abs();
        let behind = upright.along_m(foot);
        let between = behind > -reach_m && behind < length_m + reach_m;
        if between && beside < reach_m && best.as_ref().is_none_or(|b| beside < b.0) {
            best = Some((beside, k, upright));
        }
    }
    best.map(|(_, k, upright)| (k, upright))
}
