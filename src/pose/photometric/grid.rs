//! Blur that is formed on the pixel grid.
//!
//! Blur by lens and water is smooth, and then each pixel takes its box of it: a Gaussian of variance
//! b² + 1/12 to a thousandth of the light. Blur by demosaicing, scaling, noise filters of the camera
//! (or of a renderer) spreads from pixel to pixel AFTER the box: the same variance (for blurs of half a pixel and more), but
//! the response to an edge is a sum of boxes at whole pixels,
//!
//! E(d, α) = Σ_kl g_k g_l B(d − k cos α − l sin α),  B the edge response of the pixel's box along α,
//!
//! which for an edge along the columns is a chain of straight pieces, off the Gaussian's by up to 4 %
//! of the light (10 grey levels, a tenth of a pixel). Which of the two a camera does is not known
//! beforehand and is seen in the edges' pixels of every frame: κ = E − Φ is odd about the edge, so where the edge
//! lies and how much of the blur is of this kind do not hang together (slanted-edge analysis, ISO 12233).

/// Directions by the tangent of the angle to the nearer of columns and rows.
const DIRECTIONS: usize = 48;
/// Distances kept ready: to this many pixels, so many per pixel.
const REACH_PX: f64 = 4.0;
const PER_PX: f64 = 16.0;
const NODES: usize = (2.0 * REACH_PX * PER_PX) as usize + 1;
/// Pixels that a grid's kernel reaches: 5 sds of the widest blur.
const KERNEL: i32 = 6;
/// Beyond this spread κ is below 0.014 in every direction and is neglected \[px\].
const WIDEST_PX: f64 = 1.2;

/// κ of edges of one direction, between two that are kept ready: without steps from one to the next, by which costs
/// of poses near each other would differ.
#[derive(Clone, Copy)]
pub(super) struct GridDeviation<'a> {
    sides: [&'a Response; 2],
    /// How far from the first towards the second.
    between: f64,
}

/// κ and dκ/dd of one direction of edges.
struct Response {
    nodes: Vec<[f64; 2]>,
    /// Pixels per spread of [`super::Photometric`]'s Gaussian.
    spread_px: f64,
}

/// Deviation of the grid's edge response from the Gaussian's.
pub(super) struct Grid {
    directions: Vec<Response>,
}

impl std::fmt::Debug for Grid {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Grid")
            .field("directions", &self.directions.len())
            .finish()
    }
}

impl Grid {
    /// For a blur of this sd \[px\], the pixel's box not counted.
    pub fn new(blur_px: f64) -> Grid {
        let kernel = kernel(blur_px);
        let spread_px = (blur_px * blur_px + 1.0 / 12.0).sqrt();
        let directions = (0..=DIRECTIONS)
            .map(|k| {
                let (sin, cos) = (k as f64 / DIRECTIONS as f64).atan().sin_cos();
                Response::new(&kernel, spread_px, cos, sin)
            })
            .collect();
        Grid { directions }
    }

    /// Of edges whose distance grows by so much per column and per row.
    pub fn across(&self, slope: [f64; 2]) -> GridDeviation<'_> {
        let [a, b] = slope.map(f64::abs);
        // NaN (an edge without a slope) counts as along the columns.
        let place = (a.min(b) / a.max(b)).max(0.0) * DIRECTIONS as f64;
        let k = (place as usize).min(DIRECTIONS - 1);
        GridDeviation {
            sides: [&self.directions[k], &self.directions[k + 1]],
            between: place - k as f64,
        }
    }
}

impl GridDeviation<'_> {
    /// κ and dκ/dx at a distance of x spreads inside the edge.
    #[inline]
    pub fn at(&self, x: f64) -> (f64, f64) {
        let [one, other] = self.sides;
        let place = (x * one.spread_px + REACH_PX) * PER_PX;
        let inside = place > 0.0 && place < (NODES - 1) as f64;
        if !inside {
            return (0.0, 0.0);
        }
        let k = place as usize;
        let t = place - k as f64;
        let mix = |k: usize| {
            let ([a, da], [b, db]) = (one.nodes[k], other.nodes[k]);
            (a + self.between * (b - a), da + self.between * (db - da))
        };
        let ((a, da), (b, db)) = (mix(k), mix(k + 1));
        (a + t * (b - a), (da + t * (db - da)) * one.spread_px)
    }
}

impl Response {
    fn new(kernel: &[f64], spread_px: f64, cos: f64, sin: f64) -> Response {
        let edge = |d: f64| -> f64 {
            let mut sum = 0.0;
            for (k, gk) in (-KERNEL..).zip(kernel) {
                for (l, gl) in (-KERNEL..).zip(kernel) {
                    sum += gk * gl * boxed(d - f64::from(k) * cos - f64::from(l) * sin, cos, sin);
                }
            }
            if spread_px > WIDEST_PX {
                return 0.0;
            }
            sum - super::cumulative(d / spread_px)
        };
        let values: Vec<f64> = (0..NODES)
            .map(|i| edge(i as f64 / PER_PX - REACH_PX))
            .collect();
        let slope = |i: usize| match (i.checked_sub(1), values.get(i + 1)) {
            (Some(before), Some(after)) => 0.5 * PER_PX * (after - values[before]),
            _ => 0.0,
        };
        Response {
            nodes: (0..NODES).map(|i| [values[i], slope(i)]).collect(),
            spread_px,
        }
    }
}

/// A Gaussian at whole pixels, of sum one.
fn kernel(blur_px: f64) -> Vec<f64> {
    let of = |k: i32| (-0.5 * (f64::from(k) / blur_px.max(1e-3)).powi(2)).exp();
    let all: Vec<f64> = (-KERNEL..=KERNEL).map(of).collect();
    let sum: f64 = all.iter().sum();
    all.iter().map(|v| v / sum).collect()
}

/// Share of a pixel's box that lies before a line at distance `d` along (cos, sin).
fn boxed(d: f64, cos: f64, sin: f64) -> f64 {
    if sin < 1e-6 {
        return (d / cos + 0.5).clamp(0.0, 1.0);
    }
    // The box seen along the normal: a uniform width cos and one of sin on top of each other.
    let square = |v: f64| 0.5 * v.max(0.0).powi(2);
    let (outer, inner) = (0.5 * (cos + sin), 0.5 * (cos - sin));
    (square(d + outer) - square(d + inner) - square(d - inner) + square(d - outer)) / (cos * sin)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_is_cut_by_area() {
        for (cos, sin) in [(1.0f64, 0.0f64), (0.8, 0.6), (0.995, 0.0998749)] {
            assert!(
                boxed(-2.0, cos, sin).abs() < 1e-9 && (boxed(2.0, cos, sin) - 1.0).abs() < 1e-9
            );
            assert!((boxed(0.0, cos, sin) - 0.5).abs() < 1e-9);
            // By counting points of the box.
            let d = 0.3;
            let n = 400;
            let inside = (0..n * n).filter(|i| {
                let at = |k: usize| (k as f64 + 0.5) / f64::from(n as u32) - 0.5;
                at(i % n) * cos + at(i / n) * sin < d
            });
            let share = inside.count() as f64 / (n * n) as f64;
            assert!((share - boxed(d, cos, sin)).abs() < 3e-3, "{cos} {sin}");
        }
    }

    /// A step drawn pixel by pixel and then blurred with the discrete kernel.
    #[test]
    fn edges_along_columns_are_what_a_blurred_row_of_pixels_shows() {
        let blur_px = 0.7;
        let grid = Grid::new(blur_px);
        let kernel = kernel(blur_px);
        let spread_px = (blur_px * blur_px + 1.0 / 12.0f64).sqrt();
        for edge_px in [20.0, 20.1, 20.37, 20.5, 20.8] {
            // Lit right of the edge.
            let row: Vec<f64> = (0..41)
                .map(|c| (f64::from(c) + 0.5 - edge_px).clamp(0.0, 1.0))
                .collect();
            for c in 15..26usize {
                let seen: f64 = (-KERNEL..)
                    .zip(&kernel)
                    .map(|(k, g)| g * row[(c as i32 + k) as usize])
                    .sum();
                let d = c as f64 - edge_px;
                let x = d / spread_px;
                let found = super::super::cumulative(x) + grid.across([1.0, 0.0]).at(x).0;
                assert!((found - seen).abs() < 2e-3, "{edge_px} {c}: {found} {seen}");
            }
        }
        // Aslant the pixels' steps average out.
        let (most, least) = (grid.across([1.0, 0.0]), grid.across([0.7, -0.9]));
        assert!(most.at(0.66).0.abs() > 0.035 && least.at(0.66).0.abs() < 0.01);
        assert_eq!(grid.across([f64::NAN, 0.0]).at(f64::NAN), (0.0, 0.0));
    }
}
