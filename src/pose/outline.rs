//! The target as the stripe meets it: flat upper faces with straight edges, in the tank frame.

use hydroline_calib::map::Region;
use hydroline_rigs::{Slab, SlabOutline, Target};

/// A straight edge of an outline; the inside lies to the left of `from` → `to`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Edge {
    /// Start, tank X, Y \[m\].
    pub from_m: [f64; 2],
    /// End \[m\].
    pub to_m: [f64; 2],
    /// Unit normal, inwards.
    pub inward: [f64; 2],
    /// Unit direction.
    pub along: [f64; 2],
    /// Length \[m\].
    pub length_m: f64,
    /// Least and greatest X \[m\].
    pub x_range_m: [f64; 2],
    /// The corner at `from_m` is convex.
    pub convex_at_start: bool,
}

impl Edge {
    /// Distance of a point from the edge's line, positive inside \[m\].
    pub fn inside_m(&self, p: [f64; 2]) -> f64 {
        self.inward[0] * (p[0] - self.from_m[0]) + self.inward[1] * (p[1] - self.from_m[1])
    }

    /// Distance along the edge from its start \[m\].
    pub fn along_m(&self, p: [f64; 2]) -> f64 {
        self.along[0] * (p[0] - self.from_m[0]) + self.along[1] * (p[1] - self.from_m[1])
    }

    /// Distance of a point from the edge itself, squared \[m²\].
    pub fn distance2_m2(&self, p: [f64; 2]) -> f64 {
        let along = self.along_m(p);
        let beyond = (-along).max(along - self.length_m).max(0.0);
        let inside = self.inside_m(p);
        inside * inside + beyond * beyond
    }

    /// Distance of the line between two points from the edge, squared \[m²\]: zero where they cross.
    pub fn distance2_to_line_m2(&self, [a, b]: [[f64; 2]; 2]) -> f64 {
        let (inside_a, inside_b) = (self.inside_m(a), self.inside_m(b));
        let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
        let length2 = dx * dx + dy * dy;
        if inside_a * inside_b < 0.0 {
            let t = inside_a / (inside_a - inside_b);
            let along = self.along_m([a[0] + t * dx, a[1] + t * dy]);
            if along >= 0.0 && along <= self.length_m {
                return 0.0;
            }
        }
        let from_line = |p: [f64; 2]| {
            let t = ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / length2.max(1e-18);
            let t = t.clamp(0.0, 1.0);
            (a[0] + t * dx - p[0]).powi(2) + (a[1] + t * dy - p[1]).powi(2)
        };
        self.distance2_m2(a)
            .min(self.distance2_m2(b))
            .min(from_line(self.from_m))
            .min(from_line(self.to_m))
    }
}

/// A closed outline, counter-clockwise as seen with X right and Y up.
#[derive(Debug, Clone, PartialEq)]
pub struct Outline {
    /// Its edges in order; the end of one is the start of the next.
    pub edges: Vec<Edge>,
}

impl Outline {
    /// Its least width \[m\]: between two parallels, one of which lies on an edge of its convex hull.
    pub fn width_m(&self) -> f64 {
        let hull = Region::hull(self.edges.iter().map(|e| e.from_m));
        let corners = hull.corners_m();
        let sides = corners.iter().zip(corners.iter().cycle().skip(1));
        let across = |(a, b): (&[f64; 2], &[f64; 2])| {
            let [dx, dy] = [b[0] - a[0], b[1] - a[1]];
            let away = |c: &[f64; 2]| ((c[1] - a[1]) * dx - (c[0] - a[0]) * dy).abs();
            corners.iter().map(away).fold(0.0, f64::max) / dx.hypot(dy)
        };
        sides.map(across).fold(f64::INFINITY, f64::min)
    }

    /// From corners in either order. Fewer than three corners, or none enclosed, give no edges.
    pub fn new(mut corners_m: Vec<[f64; 2]>) -> Self {
        let n = corners_m.len();
        let cross = |a: [f64; 2], b: [f64; 2]| a[0] * b[1] - a[1] * b[0];
        let area: f64 = (0..n)
            .map(|i| cross(corners_m[i], corners_m[(i + 1) % n]))
            .sum();
        if n < 3 || area == 0.0 {
            return Outline { edges: Vec::new() };
        }
        if area < 0.0 {
            corners_m.reverse();
        }
        let direction = |i: usize| {
            let (a, b) = (corners_m[i % n], corners_m[(i + 1) % n]);
            let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
            let length = dx.hypot(dy).max(1e-12);
            ([dx / length, dy / length], length)
        };
        let edges = (0..n)
            .map(|i| {
                let (along, length_m) = direction(i);
                let (before, _) = direction(i + n - 1);
                let (from_m, to_m) = (corners_m[i], corners_m[(i + 1) % n]);
                Edge {
                    from_m,
                    to_m,
                    x_range_m: [from_m[0].min(to_m[0]), from_m[0].max(to_m[0])],
                    inward: [-along[1], along[0]],
                    along,
                    length_m,
                    convex_at_start: cross(before, along) >= 0.0,
                }
            })
            .collect();
        Outline { edges }
    }

    /// Whether a point lies inside.
    pub fn contains(&self, p: [f64; 2]) -> bool {
        self.edges.iter().fold(false, |inside, e| {
            let (a, b) = (e.from_m, e.to_m);
            let crosses = (a[1] > p[1]) != (b[1] > p[1])
                && p[0] < a[0] + (p[1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0]);
            inside != crosses
        })
    }
}

/// A flat upper face.
#[derive(Debug, Clone, PartialEq)]
pub struct UpperFace {
    /// Height above the floor \[m\].
    pub height_m: f64,
    /// Brightness against the floor's.
    pub albedo: f64,
    /// Where it is.
    pub outline: Outline,
}

/// Floor and target.
#[derive(Debug, Clone, PartialEq)]
pub struct Surfaces {
    /// Upper faces, highest first; the floor (height 0, everywhere) is not among them.
    pub faces: Vec<UpperFace>,
    /// Distance along X after which the target looks the same \[m\]; `None` where it never does.
    pub period_m: Option<f64>,
    /// Where the target lies along X: least and greatest \[m\].
    pub span_m: [f64; 2],
}

impl Surfaces {
    /// The target of a rig on its floor; `None` = bare floor.
    pub fn new(target: Option<&Target>) -> Self {
        let Some(target) = target else {
            return Surfaces {
                faces: Vec::new(),
                period_m: None,
                span_m: [0.0; 2],
            };
        };
        let [ox, oy, heading] = target.origin;
        let (sin, cos) = heading.sin_cos();
        let mut faces: Vec<UpperFace> = target
            .slabs
            .iter()
            .map(|slab| UpperFace {
                height_m: slab.top_m,
                albedo: slab.albedo,
                outline: Outline::new(
                    corners(slab)
                        .into_iter()
                        .map(|[x, y]| [ox + cos * x - sin * y, oy + sin * x + cos * y])
                        .collect(),
                ),
            })
            .collect();
        faces.sort_by(|a, b| b.height_m.total_cmp(&a.height_m));
        let xs = || {
            faces
                .iter()
                .flat_map(|t| t.outline.edges.iter().map(|e| e.from_m[0]))
        };
        let span_m = [
            xs().fold(f64::INFINITY, f64::min),
            xs().fold(f64::NEG_INFINITY, f64::max),
        ];
        let period_m = target.slabs.iter().find_map(|s| match s.outline {
            SlabOutline::HexagonChain { side_m, count, .. } if count > 1 => {
                Some(3f64.sqrt() * side_m * heading.cos().abs())
            }
            _ => None,
        });
        Surfaces {
            faces,
            period_m,
            span_m,
        }
    }

    /// The heights that occur, floor first \[m\].
    pub fn heights_m(&self) -> Vec<f64> {
        let mut heights: Vec<f64> = std::iter::once(0.0)
            .chain(self.faces.iter().map(|t| t.height_m))
            .collect();
        heights.sort_by(f64::total_cmp);
        heights.dedup_by(|a, b| (*a - *b).abs() < 1e-6);
        heights
    }

    /// Height of the surface at a place \[m\].
    pub fn height_at_m(&self, p: [f64; 2]) -> f64 {
        self.faces
            .iter()
            .find(|t| t.outline.contains(p))
            .map_or(0.0, |t| t.height_m)
    }
}

/// Corners of a slab's outline in the target frame \[m\].
fn corners(slab: &Slab) -> Vec<[f64; 2]> {
    match &slab.outline {
        SlabOutline::Rectangle {
            x0_m,
            x1_m,
            width_m,
        } => {
            let half = 0.5 * width_m;
            vec![[*x0_m, -half], [*x1_m, -half], [*x1_m, half], [*x0_m, half]]
        }
        SlabOutline::HexagonChain {
            x0_m,
            side_m,
            count,
        } => {
            let pitch = 3f64.sqrt() * side_m;
            // Half widths: half a side at the joints, a whole side half way between them.
            let starboard: Vec<[f64; 2]> = (0..=2 * count)
                .map(|k| {
                    [
                        x0_m + 0.5 * pitch * f64::from(k),
                        side_m * if k % 2 == 0 { 0.5 } else { 1.0 },
                    ]
                })
                .collect();
            let port = starboard.iter().rev().map(|[x, y]| [*x, -y]);
            starboard.iter().copied().chain(port).collect()
        }
        SlabOutline::Polygon { points_m } => points_m.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::hexagon_target;

    #[test]
    fn a_line_is_as_far_from_an_edge_as_its_nearest_point() {
        let s = Surfaces::new(Some(&hexagon_target()));
        let e = &s.faces[0].outline.edges[3];
        let at =
            |t: f64, off: f64| [0, 1].map(|i| e.from_m[i] + t * e.along[i] + off * e.inward[i]);
        for (a, b) in [
            (at(0.02, 0.01), at(0.05, -0.01)),
            (at(0.02, 0.03), at(0.05, 0.01)),
            (at(-0.02, 0.03), at(-0.01, -0.01)),
            (at(-0.02, -0.02), at(0.4, -0.02)),
        ] {
            let least = (0..=2000)
                .map(|k| f64::from(k) / 2000.0)
                .map(|t| e.distance2_m2([a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]))
                .fold(f64::INFINITY, f64::min);
            let found = e.distance2_to_line_m2([a, b]);
            assert!(
                (found.sqrt() - least.sqrt()).abs() < 1e-4,
                "{found} {least}"
            );
        }
    }

    #[test]
    fn hexagons_are_as_wide_as_the_paper_says() {
        let s = Surfaces::new(Some(&hexagon_target()));
        assert_eq!(s.heights_m(), [0.0, 0.02, 0.04]);
        let pitch = 3f64.sqrt() * 0.12;
        assert!((s.period_m.unwrap() - pitch).abs() < 1e-12);
        assert_eq!(s.height_at_m([0.5 * pitch, 0.119]), 0.04);
        assert_eq!(s.height_at_m([0.5 * pitch, 0.121]), 0.02);
        assert_eq!(s.height_at_m([pitch, 0.061]), 0.02);
        assert_eq!(s.height_at_m([pitch, 0.151]), 0.0);
        let hexagons = &s.faces[0].outline;
        let concave = hexagons.edges.iter().filter(|e| !e.convex_at_start).count();
        assert_eq!(concave, 10, "five joints, two sides");
        for e in &hexagons.edges {
            let middle = [
                0.5 * (e.from_m[0] + e.to_m[0]) + 1e-4 * e.inward[0],
                0.5 * (e.from_m[1] + e.to_m[1]) + 1e-4 * e.inward[1],
            ];
            assert!(hexagons.contains(middle));
        }
    }
}
