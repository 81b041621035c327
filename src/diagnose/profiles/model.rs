//! Measured against predicted for one frame: rows and widths of the bins, columns of the edges.

use super::geometry::{Geometry, Placed, Ray};
use super::observe::{Bin, Edge, Seen};
use hydroline_numerics::cancel;
use hydroline_pose::outline::Edge as Side;

/// Numbers shared by all frames whatever the hypothesis, with the spread of their priors.
///
/// Extraction and blur are not perfect; what they do wrong they do in every frame alike, so it
/// does not average out and must be free, or it passes for physics.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shared {
    /// ln of the sheet's thickness over the rig's.
    Thickness,
    /// ln of the point spread's variance over the rig's.
    Spread,
    /// Rows of one height \[px\].
    Rows(usize),
    /// Columns of one height's ends, to port or starboard \[px\].
    Ends(usize, bool),
}

impl Shared {
    /// All for a number of heights (floor first).
    pub fn all(heights: usize) -> Vec<Shared> {
        let mut all = vec![Shared::Thickness, Shared::Spread];
        all.extend((0..heights).map(Shared::Rows));
        for h in 1..heights {
            all.extend([Shared::Ends(h, false), Shared::Ends(h, true)]);
        }
        all
    }

    /// Spread of the prior.
    pub fn prior_sd(self) -> f64 {
        match self {
            Shared::Thickness => 0.1,
            Shared::Spread => 0.4,
            Shared::Rows(_) => 0.01,
            Shared::Ends(..) => 0.05,
        }
    }
}

/// Kind of measurement that a residual is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Row of a bin.
    Row,
    /// Width of a bin.
    Width,
    /// Column of an edge.
    End,
}

impl Kind {
    /// All kinds, in the order of a fit's floors.
    pub const ALL: [Kind; 3] = [Kind::Row, Kind::Width, Kind::End];

    /// Share of measurements that are something else, and how far off they may be \[px\].
    pub fn stray(self) -> (f64, f64) {
        match self {
            Kind::Row => (0.01, 40.0),
            Kind::Width => (0.03, 4.0),
            Kind::End => (0.05, 40.0),
        }
    }

    /// Least and first spread beyond the measurement's own \[px\].
    pub fn floors(self) -> (f64, f64) {
        match self {
            Kind::Row => (0.003, 0.05),
            Kind::Width => (0.005, 0.05),
            Kind::End => (0.02, 0.1),
        }
    }
}

/// Rays of a frame's measurements under one optics.
#[derive(Debug, Clone)]
pub struct Rays {
    bins: Vec<[Ray; 2]>,
    edges: Vec<[Ray; 4]>,
}

impl Rays {
    /// Half a row above and below each; for edges half a column to either side too.
    pub fn new(geometry: &Geometry, seen: &Seen) -> Self {
        let pair = |c: f64, r: f64| [geometry.ray(c, r - 0.5), geometry.ray(c, r + 0.5)];
        Rays {
            bins: seen
                .bins
                .iter()
                .map(|b| pair(b.column_px, b.row_px))
                .collect(),
            edges: seen
                .edges
                .iter()
                .map(|e| {
                    let [up, down] = pair(e.column_px, e.row_px);
                    let beside = |d: f64| geometry.ray(e.column_px + d, e.row_px + d * e.slope);
                    [up, down, beside(-0.5), beside(0.5)]
                })
                .collect(),
        }
    }
}

/// Height, top and side that each measurement of a frame belongs to.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Belongs {
    /// Index into the heights per bin.
    pub bins: Vec<usize>,
    /// (height, top, side of its outline) per edge; `None`: none that could be it.
    pub edges: Vec<Option<(usize, usize, usize)>>,
    /// Sd that a corner nearby adds to each edge's column \[px\].
    pub corner_sd_px: Vec<f64>,
}

impl Belongs {
    /// Whether each measurement belongs to the same height, top and side.
    pub fn agrees(&self, other: &Belongs) -> bool {
        self.bins == other.bins && self.edges == other.edges
    }
}

/// Lengths along a side within which a corner distorts what is seen of it \[m\].
const CORNER_M: f64 = 0.012;
/// Sd of an edge at a corner \[px\]: there the light's fading is no longer symmetric.
const CORNER_PX: f64 = 3.0;
/// Farthest that an edge may be from its side \[px\].
const FAR_PX: f64 = 40.0;

/// Rows by which a bin is off a height; `None` where the ray misses it.
fn row_off(g: &Geometry, p: &Placed, rays: &[Ray], height_m: f64) -> Option<(f64, f64)> {
    let [up, down, ..] = rays else { return None };
    let (a, b) = (
        g.meet(p, up, height_m)?.off_m,
        g.meet(p, down, height_m)?.off_m,
    );
    let slope = b - a;
    let off = 0.5 * (a + b) / slope;
    off.is_finite().then_some((off, slope))
}

/// Where an edge's measured point lies on its height, and how that moves per column.
fn foot(g: &Geometry, p: &Placed, rays: &[Ray; 4], height_m: f64) -> Option<([f64; 2], [f64; 2])> {
    let [up, down, left, right] = rays;
    let (a, b) = (g.meet(p, up, height_m)?, g.meet(p, down, height_m)?);
    let share = -a.off_m / (b.off_m - a.off_m);
    let at: [f64; 2] = std::array::from_fn(|i| a.at_m[i] + share * (b.at_m[i] - a.at_m[i]));
    let (l, r) = (g.meet(p, left, height_m)?, g.meet(p, right, height_m)?);
    // Along the stripe: what the pair drifts off the sheet is taken out by moving along the column.
    let drift = (r.off_m - l.off_m) / (b.off_m - a.off_m);
    let per = std::array::from_fn(|i| r.at_m[i] - l.at_m[i] - drift * (b.at_m[i] - a.at_m[i]));
    Some((at, per))
}

/// Columns by which an edge is off a side; the side must face the right way.
fn column_off(side: &Side, at: [f64; 2], per: [f64; 2], to_starboard: bool) -> Option<f64> {
    let fall = side.inward[0] * per[0] + side.inward[1] * per[1];
    // To starboard the inside ends: the distance inside falls with the column.
    let faces = if to_starboard { fall < 0.0 } else { fall > 0.0 };
    let off = side.inside_m(at) / fall;
    (faces && off.is_finite()).then_some(off)
}

/// Gives each measurement to the height, top and side that it is nearest to.
pub fn belongs(g: &Geometry, p: &Placed, rays: &Rays, seen: &Seen) -> Belongs {
    let nearest = |rays: &[Ray]| {
        g.heights_m
            .iter()
            .enumerate()
            .filter_map(|(k, h)| Some((k, row_off(g, p, rays, *h)?.0.abs())))
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .map_or(0, |(k, _)| k)
    };
    let mut out = Belongs {
        bins: rays.bins.iter().map(|r| nearest(r)).collect(),
        ..Belongs::default()
    };
    for (edge, r) in seen.edges.iter().zip(&rays.edges) {
        let level = nearest(r);
        let height_m = g.heights_m.get(level).copied().unwrap_or(0.0);
        let side = foot(g, p, r, height_m).and_then(|(at, per)| {
            g.surfaces
                .faces
                .iter()
                .enumerate()
                .filter(|(_, t)| (t.height_m - height_m).abs() < 1e-9)
                .flat_map(|(k, t)| t.outline.edges.iter().enumerate().map(move |s| (k, s)))
                .filter_map(|(k, (s, side))| {
                    let off = column_off(side, at, per, edge.to_starboard)?;
                    // Where along the side the stripe crosses it.
                    let cross = [at[0] - off * per[0], at[1] - off * per[1]];
                    let along = side.along_m(cross);
                    let inside = along.min(side.length_m - along);
                    let near = off.abs() < FAR_PX && inside > -0.008;
                    near.then_some((k, s, off.abs() + 1e3 * (-inside).max(0.0), inside))
                })
                .min_by(|a, b| a.2.total_cmp(&b.2))
        });
        out.edges.push(side.map(|(k, s, ..)| (level, k, s)));
        out.corner_sd_px.push(side.map_or(0.0, |(.., inside)| {
            CORNER_PX * (1.0 - inside / CORNER_M).clamp(0.0, 1.0).powi(2)
        }));
    }
    out
}

/// One measurement of a frame: kind, own sd, and sd of what else is uncertain.
pub fn kinds(seen: &Seen, belongs: &Belongs) -> Vec<(Kind, f64)> {
    let rows = seen.bins.iter().map(|b: &Bin| (Kind::Row, b.sd_px));
    let widths = seen.bins.iter().map(|b| (Kind::Width, b.sigma_sd_px));
    let ends = seen
        .edges
        .iter()
        .zip(&belongs.corner_sd_px)
        .map(|(e, corner_sd_px): (&Edge, &f64)| (Kind::End, e.sd_px.hypot(*corner_sd_px)));
    rows.chain(widths).chain(ends).collect()
}

/// Constants of the widths.
#[derive(Debug, Clone, Copy)]
pub struct Widths {
    /// Sheet's thickness by the rig \[m\].
    pub sheet_m: f64,
    /// Variance of blur and pixel box by the rig \[px²\].
    pub spread_px2: f64,
}

/// Residuals (measured − predicted \[px\]) of a frame: rows, widths, columns, in the order of
/// [`kinds`]; NaN where the ray meets nothing.
#[allow(clippy::too_many_arguments)]
pub fn residuals(
    g: &Geometry,
    p: &Placed,
    rays: &Rays,
    seen: &Seen,
    to: &Belongs,
    widths: &Widths,
    shared: (&[Shared], &[f64]),
    out: &mut Vec<f64>,
) {
    cancel::check();
    out.clear();
    let value = |which: Shared| {
        let place = shared.0.iter().position(|s| *s == which);
        place.and_then(|i| shared.1.get(i)).copied().unwrap_or(0.0)
    };
    let sheet_m = widths.sheet_m * value(Shared::Thickness).exp();
    let spread_px2 = widths.spread_px2 * value(Shared::Spread).exp();
    let biases: Vec<f64> = (0..g.heights_m.len())
        .map(|h| value(Shared::Rows(h)))
        .collect();
    let mut broad = Vec::with_capacity(seen.bins.len());
    for ((bin, r), level) in seen.bins.iter().zip(&rays.bins).zip(&to.bins) {
        let height_m = g.heights_m.get(*level).copied().unwrap_or(0.0);
        match row_off(g, p, r, height_m) {
            Some((off, slope)) => {
                out.push(off - biases.get(*level).copied().unwrap_or(0.0));
                // Vertical width of a line aslant: the point spread acts across it.
                let blur = spread_px2 * (1.0 + bin.slope * bin.slope);
                broad.push(bin.sigma_px - (sheet_m * sheet_m / (slope * slope) + blur).sqrt());
            }
            None => {
                out.push(f64::NAN);
                broad.push(f64::NAN);
            }
        }
    }
    out.append(&mut broad);
    for ((edge, r), side) in seen.edges.iter().zip(&rays.edges).zip(&to.edges) {
        let off = side.and_then(|(level, top, side)| {
            let side = g.surfaces.faces.get(top)?.outline.edges.get(side)?;
            let (at, per) = foot(g, p, r, *g.heights_m.get(level)?)?;
            let bias = value(Shared::Ends(level, edge.to_starboard));
            Some(column_off(side, at, per, edge.to_starboard)? - bias)
        });
        out.push(off.unwrap_or(f64::NAN));
    }
}
