//! Floor and target slabs as upright prisms, and the first of them that a ray meets.

use super::SceneError;
use hydroline_rigs::{Slab, SlabOutline, Target};

/// Slabs a target may have: their ids share a byte with the flags of the rasteriser.
pub(super) const SLABS_MAX: usize = 100;

/// Surface that a stripe point lies on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Surface {
    /// The tank floor.
    Floor,
    /// The top of the target's slab with this index.
    Slab(usize),
}

/// First thing a ray meets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Hit {
    /// Along the ray.
    pub t: f64,
    pub surface: Surface,
    /// A vertical face of it instead of its top.
    pub face: bool,
    /// Diffuse reflectance there.
    pub albedo: f64,
}

/// A line of sight or of light in (x, y, height): `origin + t * direction`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Line {
    pub origin: [f64; 3],
    pub direction: [f64; 3],
}

impl Line {
    pub fn xy(&self, t: f64) -> [f64; 2] {
        [
            self.origin[0] + t * self.direction[0],
            self.origin[1] + t * self.direction[1],
        ]
    }
}

#[derive(Debug, Clone)]
enum Inside {
    Rectangle,
    Hexagons { x0: f64, side: f64, length: f64 },
    Polygon(Vec<[f64; 2]>),
}

#[derive(Debug, Clone)]
pub(super) struct Prism {
    pub top_m: f64,
    pub albedo: f64,
    index: usize,
    inside: Inside,
    /// x min, x max, y min, y max.
    bounds: [f64; 4],
    /// Outline edges, from and to.
    edges: Vec<[[f64; 2]; 2]>,
}

/// Floor and prisms, highest first.
#[derive(Debug, Clone)]
pub(super) struct Solid {
    pub prisms: Vec<Prism>,
}

impl Solid {
    /// Takes a target over; lengths along its centre line times `scale`.
    pub fn new(target: Option<&Target>, scale: f64) -> Result<Self, SceneError> {
        let slabs = target.map_or(&[][..], |t| &t.slabs);
        if slabs.len() > SLABS_MAX {
            return Err(SceneError::TooManySlabs {
                slabs: slabs.len(),
                limit: SLABS_MAX,
            });
        }
        let mut prisms = Vec::with_capacity(slabs.len());
        for (index, slab) in slabs.iter().enumerate() {
            prisms.push(Prism::new(index, slab, scale)?);
        }
        // Where slabs overlap the highest counts; among equals the first in the file.
        prisms.sort_by(|a: &Prism, b: &Prism| b.top_m.total_cmp(&a.top_m));
        Ok(Solid { prisms })
    }

    /// All heights a stripe can lie at, with their surface and albedo; floor last.
    pub fn levels(&self) -> impl Iterator<Item = (f64, Surface)> + '_ {
        let floor = (0.0, Surface::Floor);
        self.prisms
            .iter()
            .map(|p| (p.top_m, Surface::Slab(p.index)))
            .chain([floor])
    }

    /// Whether a point could lie on this surface (its bounding box, grown by `margin_m`).
    pub fn near(&self, surface: Surface, xy: [f64; 2], margin_m: f64) -> bool {
        match surface {
            Surface::Floor => true,
            Surface::Slab(i) => self.prisms.iter().filter(|p| p.index == i).any(|p| {
                let [x0, x1, y0, y1] = p.bounds;
                xy[0] >= x0 - margin_m
                    && xy[0] <= x1 + margin_m
                    && xy[1] >= y0 - margin_m
                    && xy[1] <= y1 + margin_m
            }),
        }
    }

    /// Whether the top of `prisms[level]` (or the floor, `level == prisms.len()`) is what the
    /// line meets at its parameter `t`: the point is on it and nothing higher stands before it.
    ///
    /// The same answer as [`Solid::first_hit`] at that point, for a fraction of its work.
    pub fn sees(&self, line: &Line, level: usize, t: f64) -> bool {
        let end = line.xy(t);
        let higher = match self.prisms.get(level) {
            Some(prism) if !prism.contains(end) => return false,
            Some(_) => &self.prisms[..level],
            None => &self.prisms[..],
        };
        // Whoever contains the end of the sight hides it: it is higher, or as high and first in the file.
        let [.., h0] = line.origin;
        for prism in higher {
            if prism.contains(end) {
                return false;
            }
            let top_t = ((prism.top_m - h0) / line.direction[2]).max(0.0);
            if top_t >= t {
                continue;
            }
            let start = line.xy(top_t);
            if !prism.clear_of(start, end)
                && (prism.contains(start) || prism.first_crossing(start, end).is_some())
            {
                return false;
            }
        }
        true
    }

    /// Whether a rectangle (x min, x max, y min, y max) of `prisms[level]`'s height lies wholly under a
    /// higher prism, so that nobody can see it. `false` may also mean "not sure".
    pub fn buried(&self, level: usize, area: [f64; 4]) -> bool {
        self.prisms[..level.min(self.prisms.len())]
            .iter()
            .any(|p| p.covers(area))
    }

    /// First hit of a descending line, `None` when it never comes down.
    pub fn first_hit(&self, line: &Line) -> Option<Hit> {
        let [.., h0] = line.origin;
        let [.., dh] = line.direction;
        // A NaN is no hit either.
        let descends = dh < -1e-9 && h0 > 0.0;
        if !descends {
            return None;
        }
        let floor_t = -h0 / dh;
        let floor_xy = line.xy(floor_t);
        let mut best = Hit {
            t: floor_t,
            surface: Surface::Floor,
            face: false,
            albedo: 1.0,
        };
        for prism in &self.prisms {
            let top_t = ((prism.top_m - h0) / dh).max(0.0);
            if top_t >= best.t {
                continue;
            }
            let top_xy = line.xy(top_t);
            if prism.clear_of(top_xy, floor_xy) {
                continue;
            }
            let surface = Surface::Slab(prism.index);
            if prism.contains(top_xy) {
                best = Hit {
                    t: top_t,
                    surface,
                    face: false,
                    albedo: prism.albedo,
                };
            } else if let Some(s) = prism.first_crossing(top_xy, floor_xy) {
                let t = top_t + s * (floor_t - top_t);
                if t < best.t {
                    best = Hit {
                        t,
                        surface,
                        face: true,
                        albedo: prism.albedo,
                    };
                }
            }
        }
        Some(best)
    }
}

impl Prism {
    fn new(index: usize, slab: &Slab, scale: f64) -> Result<Self, SceneError> {
        let bad = |reason| SceneError::Outline {
            slab: slab.name.clone(),
            reason,
        };
        if !(slab.top_m > 0.0 && slab.top_m.is_finite()) {
            return Err(bad("has its top at or below the floor"));
        }
        let (inside, points) = match &slab.outline {
            SlabOutline::Rectangle {
                x0_m,
                x1_m,
                width_m,
            } => {
                let (x0, x1, half) = (x0_m * scale, x1_m * scale, width_m / 2.0);
                (
                    Inside::Rectangle,
                    vec![[x0, -half], [x1, -half], [x1, half], [x0, half]],
                )
            }
            SlabOutline::HexagonChain {
                x0_m,
                side_m,
                count,
            } => {
                let (x0, side) = (x0_m * scale, side_m * scale);
                let length = 3f64.sqrt() * side;
                // Up along starboard, back along port: joints half a side wide, middles a whole one.
                let flank: Vec<[f64; 2]> = (0..=2 * count)
                    .map(|k| {
                        [
                            x0 + f64::from(k) * length / 2.0,
                            if k % 2 == 0 { side / 2.0 } else { side },
                        ]
                    })
                    .collect();
                let back = flank.iter().rev().map(|[x, y]| [*x, -y]);
                (
                    Inside::Hexagons { x0, side, length },
                    flank.iter().copied().chain(back).collect(),
                )
            }
            SlabOutline::Polygon { points_m } => {
                let points: Vec<[f64; 2]> = points_m.iter().map(|p| [p[0] * scale, p[1]]).collect();
                (Inside::Polygon(points.clone()), points)
            }
        };
        if points.len() < 3 || points.iter().flatten().any(|v| !v.is_finite()) {
            return Err(bad("has fewer than three finite corners"));
        }
        let range = |axis: usize| {
            let low = points.iter().map(|p| p[axis]).fold(f64::INFINITY, f64::min);
            let high = points
                .iter()
                .map(|p| p[axis])
                .fold(f64::NEG_INFINITY, f64::max);
            (low, high)
        };
        let ((x0, x1), (y0, y1)) = (range(0), range(1));
        if x1 <= x0 || y1 <= y0 {
            return Err(bad("encloses no area"));
        }
        let edges = (0..points.len())
            .map(|i| [points[i], points[(i + 1) % points.len()]])
            .collect();
        Ok(Prism {
            top_m: slab.top_m,
            albedo: slab.albedo,
            index,
            inside,
            bounds: [x0, x1, y0, y1],
            edges,
        })
    }

    /// Whether a segment lies wholly on one side of the bounding box (or of a hexagon chain's flanks).
    fn clear_of(&self, p: [f64; 2], q: [f64; 2]) -> bool {
        let [x0, x1, y0, y1] = self.bounds;
        if (p[0] < x0 && q[0] < x0)
            || (p[0] > x1 && q[0] > x1)
            || (p[1] < y0 && q[1] < y0)
            || (p[1] > y1 && q[1] > y1)
        {
            return true;
        }
        let Inside::Hexagons { x0, side, length } = self.inside else {
            return false;
        };
        // Widest half width the segment can meet: the flanks rise at 1/sqrt(3) per metre.
        let half_width = |x: f64| {
            // Outside of the chain its end's width: it cannot grow faster than the slope from there.
            let along = (x.clamp(self.bounds[0], self.bounds[1]) - x0) / length;
            side - (fraction(along) - 0.5).abs() * length / 3f64.sqrt()
        };
        let slope = 1.0 / 3f64.sqrt();
        let widest =
            (half_width(p[0]).min(half_width(q[0])) + slope * (q[0] - p[0]).abs()).min(side);
        (p[1] > widest && q[1] > widest) || (p[1] < -widest && q[1] < -widest)
    }

    /// Whether an upright rectangle (x min, x max, y min, y max) lies inside; `false` may mean "not sure".
    fn covers(&self, [ax0, ax1, ay0, ay1]: [f64; 4]) -> bool {
        let [x0, x1, y0, y1] = self.bounds;
        if !(ax0 >= x0 && ax1 <= x1 && ay0 >= y0 && ay1 <= y1) {
            return false;
        }
        match self.inside {
            Inside::Rectangle => true,
            Inside::Hexagons { x0, side, length } => {
                let half_width = |x: f64| {
                    side - (fraction((x - x0) / length) - 0.5).abs() * length / 3f64.sqrt()
                };
                let narrowest = half_width(ax0).min(half_width(ax1)) - (ax1 - ax0) / 3f64.sqrt();
                ay1.max(-ay0) <= narrowest
            }
            Inside::Polygon(_) => false,
        }
    }

    fn contains(&self, [x, y]: [f64; 2]) -> bool {
        let [x0, x1, y0, y1] = self.bounds;
        if !(x >= x0 && x <= x1 && y >= y0 && y <= y1) {
            return false;
        }
        match &self.inside {
            Inside::Rectangle => true,
            Inside::Hexagons { x0, side, length } => {
                let along = (x - x0) / length;
                let from_middle = (fraction(along) - 0.5).abs() * length;
                y.abs() <= side - from_middle / 3f64.sqrt()
            }
            Inside::Polygon(points) => {
                // Even-odd rule.
                let mut inside = false;
                let mut j = points.len() - 1;
                for i in 0..points.len() {
                    let ([xi, yi], [xj, yj]) = (points[i], points[j]);
                    if (yi > y) != (yj > y) && x < (xj - xi) * (y - yi) / (yj - yi) + xi {
                        inside = !inside;
                    }
                    j = i;
                }
                inside
            }
        }
    }

    /// Smallest fraction of the way p -> q at which the outline is crossed.
    fn first_crossing(&self, p: [f64; 2], q: [f64; 2]) -> Option<f64> {
        let d = [q[0] - p[0], q[1] - p[1]];
        let (low_x, high_x) = (p[0].min(q[0]), p[0].max(q[0]));
        let (low_y, high_y) = (p[1].min(q[1]), p[1].max(q[1]));
        let mut first: Option<f64> = None;
        let mut cross = |[a, b]: &[[f64; 2]; 2]| {
            if a[0].max(b[0]) < low_x
                || a[0].min(b[0]) > high_x
                || a[1].max(b[1]) < low_y
                || a[1].min(b[1]) > high_y
            {
                return;
            }
            let e = [b[0] - a[0], b[1] - a[1]];
            let det = d[0] * e[1] - d[1] * e[0];
            let w = [a[0] - p[0], a[1] - p[1]];
            // Parallel: det = 0, s and r are not finite and fail the tests.
            let s = (w[0] * e[1] - w[1] * e[0]) / det;
            let r = (w[0] * d[1] - w[1] * d[0]) / det;
            if (0.0..=1.0).contains(&s) && (0.0..=1.0).contains(&r) && first.is_none_or(|f| s < f) {
                first = Some(s);
            }
        };
        if let Inside::Hexagons { x0, length, .. } = self.inside {
            // Edges: 2n starboard flanks forward, the far end, 2n port flanks back, the near end.
            let flanks = (self.edges.len() - 2) / 2;
            let from = (((low_x - x0) / (length / 2.0)).floor().max(0.0) as usize).min(flanks - 1);
            let to = (((high_x - x0) / (length / 2.0)).floor().max(0.0) as usize).min(flanks - 1);
            for k in from..=to {
                cross(&self.edges[k]);
                cross(&self.edges[2 * flanks - k]);
            }
            cross(&self.edges[flanks]);
            cross(&self.edges[2 * flanks + 1]);
        } else {
            self.edges.iter().for_each(cross);
        }
        first
    }
}

/// Fractional part of a number that is not negative: a truncation, where `floor` is a call.
fn fraction(value: f64) -> f64 {
    value - (value as i64) as f64
}

#[cfg(test)]
mod tests;
