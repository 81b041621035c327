//! Strips that edges and their corners cut, upright ones apart.
//!
//! Over the rows of a strip the distance from an edge is curved by the square of the share that the
//! strip has of the focal length: a parabola through three rows holds it to a micrometre, and a
//! line its derivatives to 1e-4. So an edge is evaluated three times per strip instead of once
//! per pixel, and [`Photometric::light`] is left for upright corners.

use super::across::{ACROSS, Across, Faded};
use super::grid::GridDeviation;
use super::plan::{Near, Plan, Strip};
use super::pose_geometry::{Hit, PoseGeometry, Ray, dot};
use super::sums::{Counter, EdgeLight};
use super::visibility::{CornerShare, FAR, Standard, Stripe, correlation, standard};
use super::{
    BACKGROUND, BRIGHTNESS, DARK, LINE, LOCAL, Photometric, Sensitivity, State, THICKNESS, TONE,
};
use crate::normal::{Pair, Tables};

/// Value in the middle, and gain per row.
type Line = [f64; 2];

fn line(first: f64, last: f64, rows: f64) -> Line {
    [0.5 * (first + last), (last - first) / rows]
}

fn at(line: &Line, u: f64) -> f64 {
    line[0] + line[1] * u
}

/// How light is cut.
#[derive(Clone, Copy)]
struct Shading {
    tables: &'static Tables,
    /// Share of the blur that is formed on the pixel grid.
    grid_share: f64,
}

/// An edge along a strip.
struct Edge<'a> {
    /// Distance in spreads: a + b u + c u².
    x: [f64; 3],
    /// Deviation of the grid's edge response.
    deviation: GridDeviation<'a>,
    /// Its derivatives by the parameters in the middle, and what they gain per row: those by pose and
    /// thickness, the brightness' is zero.
    dx: [[f64; THICKNESS + 1]; 2],
}

/// The edges of one outline near a strip: one, or two that meet at a corner.
struct Border<'a> {
    first: Edge<'a>,
    /// The second; how the two hang together; whether both must hold (convex) or either.
    second: Option<(Edge<'a>, &'static Pair, bool)>,
}

/// Visible fraction, and its slopes by the distances of the edges that bound it.
struct Visible<'a> {
    share: f64,
    by: [(f64, Option<&'a Edge<'a>>); 2],
    /// d share / d share of the blur that is formed on the pixel grid.
    by_grid: f64,
}

impl Visible<'_> {
    const ALL: Visible<'static> = Visible {
        share: 1.0,
        by: [(0.0, None), (0.0, None)],
        by_grid: 0.0,
    };

    /// Adds what the edges move of so much light.
    #[inline]
    fn add(&self, j: &mut [f64; LOCAL], light: f64, u: f64) {
        for (slope, edge) in self.by {
            if let Some(edge) = edge.filter(|_| slope != 0.0) {
                edge.add(j, light * slope, u);
            }
        }
    }
}

/// Visible fraction behind several cuts, and what their edges move of so much light.
fn visibility_of_all(
    cuts: &[Cut<'_>],
    j: &mut [f64; LOCAL],
    full: f64,
    u: f64,
    shading: &Shading,
) -> (f64, f64) {
    let mut visible = [const { Visible::ALL }; CUTS_MOST];
    let mut share = 1.0;
    for (cut, own) in cuts.iter().zip(&mut visible) {
        *own = cut.visibility(u, shading);
        share *= own.share;
    }
    let mut by_grid = 0.0;
    if share > 0.0 && share < 1.0 {
        for own in visible.iter().take(cuts.len()) {
            own.add(j, full * share / own.share, u);
            by_grid += own.by_grid * share / own.share;
        }
    }
    (share, by_grid)
}

/// First and last place along a strip where its light counts, from the stripe at two places, between which the distance from the sheet is nearly a line.
pub(super) fn lit(u: [f64; 2], first: &Stripe, last: &Stripe) -> [f64; 2] {
    let slope = (last.s - first.s) / (u[1] - u[0]);
    let centre = u[0] - first.s / slope;
    let half = ((2.0 * DARK * first.total2.max(last.total2)).sqrt() / slope).abs();
    // A strip of one row has no slope.
    if half.is_finite() && centre.is_finite() {
        [centre - half, centre + half]
    } else {
        [f64::NEG_INFINITY, f64::INFINITY]
    }
}

/// Cut of a strip by its own outline or by a higher slab.
struct Cut<'a> {
    own: bool,
    /// At the level's own height, and for a higher slab also at its upper face's.
    borders: [Option<Border<'a>>; 2],
    /// A higher slab hides the strip wholly.
    hidden: bool,
}

/// A strip made ready for its rows.
struct Ready {
    over: f64,
    /// Albedo times σ/S.
    height: Line,
    total2: Line,
    ds: [Line; 3],
    /// First and last place about the middle that it lights.
    lit: [f64; 2],
    /// In [`Scratch::cuts`].
    cuts: (usize, usize),
    /// The line's transverse profile.
    faded: Faded,
}

/// Memory that is used again from strip to strip.
#[derive(Default)]
pub(super) struct Scratch<'a> {
    strips: Vec<Ready>,
    cuts: Vec<Cut<'a>>,
}

/// A strip at one row.
struct Node {
    hit: Hit,
    stripe: Stripe,
}

/// Most cuts of a strip.
pub(super) const CUTS_MOST: usize = 4;

/// Arguments of a comparison of strips: pose, plan, strips, pixels, light, whether derivatives are wanted, and the
/// share of the blur that is formed on the pixel grid.
type Compared<'a> = (
    &'a PoseGeometry,
    &'a Plan,
    &'a [Strip],
    &'a [u8],
    &'a State,
    bool,
    f64,
);

/// Three rows of a strip, their places about the middle, and the pose that sees them.
struct Rows<'a> {
    geometry: &'a PoseGeometry,
    plan: &'a Plan,
    rays: [Ray; 3],
    u: [f64; 3],
}

impl Photometric {
    /// Adds strips that share their rows and that no upright corner cuts, RUN: with the derivatives by the run's parameters; `model_error_sd`
    /// gives each row's pixel its model error, in turn, from its sensitivity.
    pub(super) fn compare_edge_strips<'a, const RUN: bool>(
        &'a self,
        (geometry, plan, strips, pixels, state, derivatives, grid_share): Compared<'_>,
        counter: &mut Counter<'_>,
        scratch: &mut Scratch<'a>,
        mut model_error_sd: impl FnMut(&Sensitivity) -> f64,
    ) {
        let Some(strip) = strips.first() else {
            return;
        };
        let (first, end) = (strip.first_row, strip.end_row);
        let cut = strips.iter().any(Strip::cut);
        let rows = self.table.sound_rows(strip.column, first, end);
        let ready = |rows: &[usize; 2]| {
            self.ready(geometry, plan, strips, *rows, state, scratch)
                .is_some()
        };
        let Some([from, to]) = rows.filter(ready) else {
            (first..end).filter(|_| cut).for_each(|_| {
                model_error_sd(&Sensitivity::default());
            });
            return;
        };
        let tables = Tables::get();
        let shading = Shading { tables, grid_share };
        let lever = self.table.lever_m;
        let r3 = &geometry.r[2];
        let ahead = r3[0] * lever;
        let sigma = state.thickness_m;
        let of_sigma = 1.0 / sigma;
        let across = Across::new(&state.across, sigma);
        let middle = 0.5 * (from + to) as f64;
        let sights = self.table.sights(strip.column, first, end);
        for (row, [y, z]) in (first..end).zip(sights) {
            let u = row as f64 - middle;
            let down = ahead + r3[1] * y + r3[2] * z;
            let mut sensitivity = Sensitivity::default();
            let mut j = [0.0; LOCAL];
            let mut level = 0.0;
            let mut by_grid = 0.0;
            for ready in &scratch.strips {
                if u < ready.lit[0] || u > ready.lit[1] {
                    continue;
                }
                let total2 = at(&ready.total2, u);
                let both = 1.0 / (down * total2);
                let of_total2 = both * down;
                let s = lever * (ready.over - down) * (both * total2);
                let off = s * s * of_total2;
                let round = tables.exp(0.5 * off) * at(&ready.height, u);
                if round == 0.0 {
                    continue;
                }
                let mut by_terms = [0.0; ACROSS];
                let line = if RUN {
                    across.at_by(s, of_total2, &mut by_terms)
                } else {
                    ready.faded.at(s, of_total2)
                };
                let bare = round * line.light;
                let full = state.brightness * bare;
                let cuts = scratch.cuts.get(ready.cuts.0..ready.cuts.1).unwrap_or(&[]);
                let share = match cuts {
                    [] => 1.0,
                    [only] => {
                        let visible = only.visibility(u, &shading);
                        by_grid += full * visible.by_grid;
                        if derivatives && visible.share > 0.0 {
                            visible.add(&mut j, full, u);
                        }
                        visible.share
                    }
                    several => {
                        let (share, grid_slope) =
                            visibility_of_all(several, &mut j, full, u, &shading);
                        by_grid += full * grid_slope;
                        share
                    }
                };
                if share == 0.0 {
                    continue;
                }
                let light = full * share;
                level += light;
                sensitivity.edge += light * 4.0 * (1.0 - share);
                if derivatives {
                    let of_line = state.brightness * round * share;
                    let by_s = of_line * line.slope - light * s * of_total2;
                    for (j, ds) in j[2..5].iter_mut().zip(&ready.ds) {
                        *j += by_s * at(ds, u);
                    }
                    j[BRIGHTNESS] += bare * share;
                    j[THICKNESS] += light * (of_sigma - sigma * of_total2 * (1.0 - off))
                        + of_line * line.by_sigma;
                    if RUN {
                        for (j, by) in j[LINE..].iter_mut().zip(&by_terms) {
                            *j += of_line * by;
                        }
                    }
                }
            }
            let model_error_sd = if cut {
                model_error_sd(&sensitivity)
            } else {
                0.0
            };
            let Some(&grey) = pixels.get(row * self.table.width_px + strip.column) else {
                continue;
            };
            if row < from || row > to {
                counter.skip();
                continue;
            }
            let background = counter.background(state.background, row);
            let judged = if cut {
                let edge_light = EdgeLight {
                    light: sensitivity.edge,
                    by_grid,
                };
                counter.edge::<RUN>(grey, level, background, Some(edge_light), model_error_sd)
            } else {
                let mut tally = counter.sums.tally;
                let judged = counter.interior::<RUN>(grey, level, background, &mut tally);
                counter.sums.tally = tally;
                judged
            };
            let Some(judged) = judged.filter(|_| derivatives) else {
                continue;
            };
            if level == 0.0 {
                counter.add_dark(&judged);
                continue;
            }
            j[BACKGROUND] = 1.0;
            if judged.share != 1.0 {
                for j in &mut j[..if RUN { LOCAL } else { TONE }] {
                    *j *= judged.share;
                }
            }
            if RUN {
                counter.put_run(&mut j, judged.by_camera);
            }
            counter.add(&j, judged.weight, judged.residual);
        }
    }

    /// Makes strips ready; `None` where a ray of theirs does not meet its level.
    fn ready<'a>(
        &'a self,
        geometry: &PoseGeometry,
        plan: &Plan,
        strips: &[Strip],
        [from, to]: [usize; 2],
        state: &State,
        scratch: &mut Scratch<'a>,
    ) -> Option<()> {
        scratch.strips.clear();
        scratch.cuts.clear();
        let column = strips.first()?.column;
        let nodes = [from, (from + to) / 2, to];
        let middle = 0.5 * (from + to) as f64;
        let count = (to - from).max(1) as f64;
        let rows = Rows {
            geometry,
            plan,
            rays: nodes.map(|row| self.ray(column, row)),
            u: nodes.map(|row| row as f64 - middle),
        };
        let across = Across::new(&state.across, state.thickness_m);
        let eye = self.table.eye_m;
        let fallen = geometry.position[2] + dot(&geometry.r[2], &[eye.x, eye.y, eye.z]);
        for strip in strips {
            let own_m = self.height(strip.level);
            let nodes = self.nodes(&rows, own_m, state)?;
            let first_cut = scratch.cuts.len();
            for cut in plan.cuts(strip) {
                let mut borders = [None, None];
                borders[0] = self.border(&rows, cut.face, &cut.foot, &nodes, &nodes);
                if !cut.own && !plan.near(&cut.head).is_empty() {
                    let above = self.nodes(&rows, self.surfaces.faces[cut.face].height_m, state)?;
                    borders[1] = self.border(&rows, cut.face, &cut.head, &above, &nodes);
                }
                scratch.cuts.push(Cut {
                    own: cut.own,
                    borders,
                    hidden: !cut.own && (cut.foot.inside || cut.head.inside),
                });
            }
            let [a, _, c] = &nodes;
            let (a, c) = (&a.stripe, &c.stripe);
            let lit = lit([rows.u[0], rows.u[2]], a, c);
            let full = self.albedo(strip.level) * state.thickness_m;
            scratch.strips.push(Ready {
                over: -own_m - fallen,
                height: line(full / a.total2.sqrt(), full / c.total2.sqrt(), count),
                total2: line(a.total2, c.total2, count),
                ds: std::array::from_fn(|i| line(a.ds[i], c.ds[i], count)),
                lit,
                cuts: (first_cut, scratch.cuts.len()),
                faded: across.faded(2.0 / (a.total2 + c.total2)),
            });
        }
        Some(())
    }

    fn nodes(&self, rows: &Rows<'_>, height_m: f64, state: &State) -> Option<[Node; 3]> {
        let node = |ray: &Ray| {
            let hit = self.hit(rows.geometry, ray, height_m)?;
            let stripe = self.stripe(&hit, state);
            Some(Node { hit, stripe })
        };
        let [a, b, c] = &rows.rays;
        Some([node(a)?, node(b)?, node(c)?])
    }

    /// The edges of an upper face that are near, where the rays hit (`at`), under the stripe of a level (`of`).
    fn border(
        &self,
        rows: &Rows<'_>,
        face: usize,
        near: &Near,
        at: &[Node; 3],
        of: &[Node; 3],
    ) -> Option<Border<'_>> {
        let near = rows.plan.near(near);
        let standards = |k: usize| -> [Standard; 3] {
            let edge = rows.geometry.edge(face, k);
            std::array::from_fn(|i| standard(&rows.rays[i], edge, &at[i].hit, &of[i].stripe))
        };
        let one = usize::from(*near.first()?);
        let first = standards(one);
        let second = near.get(1).map(|other| {
            let other = usize::from(*other);
            let second = standards(other);
            let edges = &self.surfaces.faces[face].outline.edges;
            // The later of two neighbours begins at the corner.
            let later = if (one + 1) % edges.len() == other {
                other
            } else {
                one
            };
            let rho = correlation(&first[1], &second[1], &of[1].stripe);
            let convex = edges[later].convex_at_start;
            (self.edge_through(rows.u, &second), Pair::near(rho), convex)
        });
        Some(Border {
            first: self.edge_through(rows.u, &first),
            second,
        })
    }

    pub(super) fn stripe(&self, hit: &Hit, state: &State) -> Stripe {
        let lever = self.table.lever_m;
        let s_slope = hit.t_slope.map(|t| lever * t);
        let sigma = state.thickness_m;
        let spread = self.spread_px2;
        Stripe {
            s: lever * (hit.t - 1.0),
            s_slope,
            ds: hit.dt.map(|d| lever * d),
            total2: sigma * sigma + spread * (s_slope[0] * s_slope[0] + s_slope[1] * s_slope[1]),
            sigma,
            spread,
        }
    }
}

impl Photometric {
    fn edge_through(&self, u: [f64; 3], [a, b, c]: &[Standard; 3]) -> Edge<'_> {
        let rows = (u[2] - u[0]).max(1.0);
        Edge {
            deviation: self.grid.across(b.slope),
            x: parabola(u, [a.x, b.x, c.x]),
            dx: {
                let mut dx = [[0.0; THICKNESS + 1]; 2];
                let mut put = |i: usize, a: f64, c: f64| {
                    [dx[0][i], dx[1][i]] = line(a, c, rows);
                };
                for i in 0..6 {
                    put(i, a.dx[i], c.dx[i]);
                }
                put(THICKNESS, a.dx_thickness, c.dx_thickness);
                dx
            },
        }
    }
}

impl Edge<'_> {
    /// Share inside this edge alone, at so many spreads from it.
    #[inline]
    fn alone(&self, x: f64, shading: &Shading) -> Visible<'_> {
        let (share, slope) = shading.tables.normal(x);
        let (by_grid, by_grid_slope) = self.deviation.at(x);
        Visible {
            share: share + shading.grid_share * by_grid,
            by: [
                (slope + shading.grid_share * by_grid_slope, Some(self)),
                (0.0, None),
            ],
            by_grid,
        }
    }

    fn distance(&self, u: f64) -> f64 {
        self.x[0] + u * (self.x[1] + u * self.x[2])
    }

    /// Adds `gain` times the distance's derivatives.
    #[inline]
    fn add(&self, j: &mut [f64; LOCAL], gain: f64, u: f64) {
        let per_row = gain * u;
        let [middle, slope] = &self.dx;
        for i in 0..=THICKNESS {
            j[i] += gain * middle[i] + per_row * slope[i];
        }
    }
}

impl Border<'_> {
    fn inside(&self, u: f64, shading: &Shading) -> Visible<'_> {
        let Shading { tables, grid_share } = *shading;
        let h = self.first.distance(u);
        let Some((second, pair, convex)) = &self.second else {
            return self.first.alone(h, shading);
        };
        let k = second.distance(u);
        // As in `corner`: the other one bounds the light.
        let idle = |x: f64| if *convex { x > FAR } else { x < -FAR };
        if idle(k) {
            return self.first.alone(h, shading);
        }
        if idle(h) {
            return second.alone(k, shading);
        }
        let found = if *convex {
            pair.below(h, k, tables)
        } else {
            pair.either(h, k, tables)
        };
        let deviations = [self.first.deviation.at(h), second.deviation.at(k)];
        let found = CornerShare::of(found, [h, k], deviations, *convex, grid_share, tables);
        Visible {
            share: found.share,
            by: [
                (found.by[0], Some(&self.first)),
                (found.by[1], Some(second)),
            ],
            by_grid: found.by_grid,
        }
    }
}

impl Cut<'_> {
    fn visibility(&self, u: f64, shading: &Shading) -> Visible<'_> {
        let nothing = |share: f64| Visible {
            share,
            ..Visible::ALL
        };
        if self.hidden {
            return nothing(0.0);
        }
        if self.own {
            return self.borders[0]
                .as_ref()
                .map_or_else(|| nothing(1.0), |b| b.inside(u, shading));
        }
        let [foot, head] = self
            .borders
            .each_ref()
            .map(|b| b.as_ref().map(|b| b.inside(u, shading)));
        // Of the slab's foot and its upper face the one that reaches farther counts.
        let covered = match (foot, head) {
            (Some(foot), Some(head)) => {
                if head.share > foot.share {
                    head
                } else {
                    foot
                }
            }
            (Some(one), None) | (None, Some(one)) => one,
            (None, None) => return nothing(1.0),
        };
        Visible {
            share: 1.0 - covered.share,
            by: covered.by.map(|(slope, edge)| (-slope, edge)),
            by_grid: -covered.by_grid,
        }
    }
}

/// a, b, c of a + b u + c u² through three points.
fn parabola(u: [f64; 3], x: [f64; 3]) -> [f64; 3] {
    let [u0, u1, u2] = u;
    if u1 == u0 || u2 == u1 {
        let b = if u2 == u0 {
            0.0
        } else {
            (x[2] - x[0]) / (u2 - u0)
        };
        return [x[0] - b * u0, b, 0.0];
    }
    let first = (x[1] - x[0]) / (u1 - u0);
    let second = ((x[2] - x[1]) / (u2 - u1) - first) / (u2 - u0);
    [
        x[0] - first * u0 + second * u0 * u1,
        first - second * (u0 + u1),
        second,
    ]
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_parabola_goes_through_its_points() {
        let of = |u: f64| 0.3 - 0.2 * u + 0.05 * u * u;
        let [a, b, c] = super::parabola([-7.5, 0.5, 7.5], [of(-7.5), of(0.5), of(7.5)]);
        assert!((a - 0.3).abs() < 1e-12 && (b + 0.2).abs() < 1e-12 && (c - 0.05).abs() < 1e-12);
    }
}
