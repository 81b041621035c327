//! Appearance of a mark through a blur: line crossing, dot and chessboard corner in a local perspective.

use std::sync::OnceLock;

use hydroline_rigs::{Board, BoardPattern};
use nalgebra::Matrix2;

/// Steps of the table of the normal distribution, and how far it reaches.
const STEPS: usize = 1024;
const REACH: f64 = 4.5;

/// Normal distribution and density by table: the fit asks some 100 000 times per image.
type Table = [(f64, f64); STEPS + 2];

fn normal_table() -> &'static Table {
    static TABLE: OnceLock<Table> = OnceLock::new();
    TABLE.get_or_init(|| {
        // Trapezoids of the density from −REACH; the step is 0.009, the error 1e-6.
        let step = 2.0 * REACH / STEPS as f64;
        let density = |x: f64| (-0.5 * x * x).exp() / (2.0 * std::f64::consts::PI).sqrt();
        let mut sum = 0.0;
        std::array::from_fn(|k| {
            let x = -REACH + k as f64 * step;
            let value = (sum, density(x));
            sum += 0.5 * step * (density(x) + density(x + step));
            value
        })
    })
}

#[inline(always)]
fn normal(table: &Table, x: f64) -> (f64, f64) {
    let at = (x + REACH) * (STEPS as f64 / (2.0 * REACH));
    if at <= 0.0 {
        return (0.0, 0.0);
    }
    if at >= STEPS as f64 {
        return (1.0, 0.0);
    }
    let k = (at as usize).min(STEPS);
    let f = at - k as f64;
    let (a, b) = (table[k], table[k + 1]);
    (a.0 + f * (b.0 - a.0), a.1 + f * (b.1 - a.1))
}

/// Appearance of a node under a blur: all that its pixels share, divisions done.
pub(super) struct Local {
    table: &'static Table,
    kind: Marks,
    /// Image to lattice, and its rows' inverse lengths: \[px\] per unit of u and v.
    m: Matrix2<f64>,
    per: [f64; 2],
    /// The rows of `m`, of length 1.
    normals: [[f64; 2]; 2],
    /// 1 / blur across the lattice's two families of rims \[1/px\].
    per_blur: [f64; 2],
}

enum Marks {
    Corner,
    /// A corner with a marker's dark border in its light squares, this far from both rims in pitches.
    CornerBeforeMarkers {
        gap: f64,
    },
    /// Half widths of the two lines over the blur.
    Lines([f64; 2]),
    /// In pitches.
    Dot {
        radius: f64,
    },
}

impl Local {
    pub fn new(board: &Board, m: &Matrix2<f64>, blur_px: [f64; 2]) -> Self {
        let per = [0, 1].map(|k| 1.0 / m.row(k).norm());
        Local {
            table: normal_table(),
            kind: match board.pattern {
                BoardPattern::Chessboard => Marks::Corner,
                BoardPattern::Charuco { marker_m, .. } => Marks::CornerBeforeMarkers {
                    gap: 0.5 * (1.0 - marker_m / board.pitch_m),
                },
                BoardPattern::Lines { line_m } => {
                    let half = 0.5 * line_m / board.pitch_m;
                    Marks::Lines([0, 1].map(|k| half * per[k] / blur_px[k]))
                }
                BoardPattern::Dots { diameter_m } => Marks::Dot {
                    radius: 0.5 * diameter_m / board.pitch_m,
                },
            },
            m: *m,
            per,
            normals: [0, 1].map(|k| [m[(k, 0)] * per[k], m[(k, 1)] * per[k]]),
            per_blur: blur_px.map(|s| 1.0 / s),
        }
    }

    /// Least value of the pattern, and how much more the largest is.
    #[inline(always)]
    pub fn range(&self) -> [f64; 2] {
        match self.kind {
            Marks::Corner | Marks::CornerBeforeMarkers { .. } => [-1.0, 2.0],
            _ => [0.0, 1.0],
        }
    }

    /// A line of half width w at distance d from its middle, both over the blur, and its slope
    /// per blur.
    #[inline(always)]
    fn band(&self, d: f64, w: f64) -> (f64, f64) {
        // Most of a patch is plain face. At 3.8 blurs a ten-thousandth of the line is left.
        if d.abs() > w + 3.8 {
            return (0.0, 0.0);
        }
        let (p, dp) = normal(self.table, d + w);
        let (q, dq) = normal(self.table, d - w);
        (p - q, dp - dq)
    }

    /// 1 / blur across a rim whose normal has these shares of the two families' normals \[1/px\].
    #[inline(always)]
    fn towards(&self, u: f64, v: f64) -> f64 {
        let [a, b] = self.per_blur;
        if a == b {
            return a;
        }
        let (p, q) = ((u / self.per[0]).powi(2), (v / self.per[1]).powi(2));
        ((p + q) / (p / (a * a) + q / (b * b))).sqrt()
    }

    /// The two lines of a crossing at (u, v), if it is one.
    pub fn lines(&self, u: f64, v: f64) -> Option<[f64; 2]> {
        let Marks::Lines(half) = self.kind else {
            return None;
        };
        let [a, b] = [0, 1].map(|k| [u, v][k] * self.per[k] * self.per_blur[k]);
        Some([self.band(a, half[0]).0, self.band(b, half[1]).0])
    }

    /// Pattern at lattice coordinates (u, v) from its node, and its gradient per pixel; `light`: whether its positive part
    /// is the light one, which is where markers are.
    #[inline(always)]
    pub fn pattern_of(&self, u: f64, v: f64, light: bool) -> (f64, [f64; 2]) {
        let (mut value, mut gradient) = self.pattern(u, v);
        if let Marks::CornerBeforeMarkers { gap } = self.kind {
            let [n1, n2] = self.normals;
            let sides = if light { 1.0 } else { -1.0 };
            for side in [1.0, -1.0] {
                let along = |k: usize, sign: f64, w: f64| {
                    let scale = self.per[k] * self.per_blur[k];
                    let (p, dp) = normal(self.table, (sign * w - gap) * scale);
                    (p, dp * sign * self.per_blur[k])
                };
                let (p, dp) = along(0, side, u);
                let (q, dq) = along(1, side * sides, v);
                value -= 2.0 * sides * p * q;
                for (k, g) in gradient.iter_mut().enumerate() {
                    *g -= 2.0 * sides * (dp * q * n1[k] + dq * p * n2[k]);
                }
            }
        }
        (value, gradient)
    }

    /// The same without markers: before it is known which squares are light.
    #[inline(always)]
    pub fn pattern(&self, u: f64, v: f64) -> (f64, [f64; 2]) {
        let [n1, n2] = self.normals;
        let d1 = u * self.per[0] * self.per_blur[0];
        let d2 = v * self.per[1] * self.per_blur[1];
        match self.kind {
            Marks::Corner | Marks::CornerBeforeMarkers { .. } => {
                let (a, da) = normal(self.table, d1);
                let (b, db) = normal(self.table, d2);
                let (a, b) = (2.0 * a - 1.0, 2.0 * b - 1.0);
                let (da, db) = (
                    2.0 * da * self.per_blur[0] * b,
                    2.0 * db * self.per_blur[1] * a,
                );
                (a * b, [0, 1].map(|k| da * n1[k] + db * n2[k]))
            }
            Marks::Lines(half) => {
                let (a, da) = self.band(d1, half[0]);
                let (b, db) = self.band(d2, half[1]);
                let (da, db) = (
                    da * self.per_blur[0] * (1.0 - b),
                    db * self.per_blur[1] * (1.0 - a),
                );
                (a + b - a * b, [0, 1].map(|k| da * n1[k] + db * n2[k]))
            }
            Marks::Dot { radius } => {
                let rho = (u * u + v * v).sqrt();
                if rho < 1e-9 {
                    return (1.0, [0.0, 0.0]);
                }
                let g = [0, 1].map(|k| (u * self.m[(0, k)] + v * self.m[(1, k)]) / rho);
                let per_size = 1.0 / (g[0] * g[0] + g[1] * g[1]).sqrt();
                let per_blur = self.towards(u / rho, v / rho);
                let (p, dp) = normal(self.table, (radius - rho) * per_size * per_blur);
                let slope = -dp * per_blur * per_size;
                (p, [slope * g[0], slope * g[1]])
            }
        }
    }
}
