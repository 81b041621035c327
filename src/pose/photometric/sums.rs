//! What a comparison adds up, and how a residual counts.

pub(super) use super::doubts::Torn;
use super::doubts::{EdgeName, EdgeSums, EdgesSeen};
use super::lanes::Lanes;
use super::{BACKGROUND, BRIGHTNESS, Column, PARAMETERS, Square, THICKNESS};
use crate::normal::Tables;

/// Beyond so many noise sds a residual counts less and less in what the noise is found from.
const OUTLYING: f64 = 4.0;
/// Light above this share of the line's brightness counts as lit.
const LIT: f64 = 0.15;

/// What moves light that no edge cuts: x, y and ψ move edges only.
pub(super) const BULK: [usize; 6] = [2, 3, 4, BRIGHTNESS, THICKNESS, BACKGROUND];

/// Sums over the pixels.
#[derive(Debug, Clone, Default)]
pub(crate) struct Sums {
    /// Jᵀ W J.
    pub information: Square,
    /// Jᵀ W r.
    pub gradient: Column,
    /// Σ ρ(r / noise).
    pub cost: f64,
    /// Pixels.
    pub pixels: usize,
    /// Squared residuals of lit pixels away from edges, robustly cut, and their number.
    pub bright_square: f64,
    pub bright_count: usize,
    /// Weights of lit and edge pixels, and what their weighted residuals change by per residual.
    pub weights: f64,
    pub slopes: f64,
    /// Number of edge pixels.
    pub edge_count: usize,
    /// Pixels whose weight is below one half.
    pub rejected: usize,
    /// The edges met.
    pub edges: EdgesSeen,
}

/// How residuals count.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Weighting {
    /// Pixel noise \[grey levels\].
    pub noise_sd: f64,
    /// Beyond this many noise sds a residual counts less and less (Tukey) or linearly (Huber).
    pub cut: f64,
    pub redescending: bool,
    /// Level from which a pixel counts as clipped.
    pub saturation: u8,
}

impl Weighting {
    /// Cost, weight and d(weight r)/dr of a residual, squared, in units of the noise.
    #[inline]
    fn weigh(&self, square: f64) -> (f64, f64, f64) {
        let c2 = self.cut * self.cut;
        if self.redescending {
            // Tukey's biweight, scaled so that ρ = r²/2 near zero.
            let share = square / c2;
            let rest = 1.0 - share;
            if rest <= 0.0 {
                (c2 / 6.0, 0.0, 0.0)
            } else {
                let rest2 = rest * rest;
                (
                    c2 / 6.0 * (1.0 - rest2 * rest),
                    rest2,
                    rest2 - 4.0 * share * rest,
                )
            }
        } else if square <= c2 {
            (0.5 * square, 1.0, 1.0)
        } else {
            let a = square.sqrt();
            (self.cut * a - 0.5 * c2, self.cut / a, 0.0)
        }
    }
}

/// A pixel judged.
pub(super) struct Judged {
    pub residual: f64,
    /// Weight over variance.
    pub weight: f64,
    /// d expected / d light: below one where the sensor cuts off at zero.
    pub share: f64,
}

/// Adds pixels up.
pub(super) struct Counter<'a> {
    weighting: &'a Weighting,
    tables: &'static Tables,
    bright: f64,
    /// 1 / noise².
    of_variance: f64,
    pub sums: Sums,
    waiting: Lanes<PARAMETERS>,
    /// Lower triangle of the information.
    pub information: [[f64; PARAMETERS]; PARAMETERS],
    pub gradient: [f64; PARAMETERS],
    edges: Vec<EdgeSums>,
    /// Share of the blur that the light was taken to get on the pixel grid.
    pub grid_share: f64,
    /// The one of them whose pixels are at hand.
    edge: usize,
}

impl<'a> Counter<'a> {
    pub fn new(weighting: &'a Weighting, tables: &'static Tables, brightness: f64) -> Self {
        Counter {
            weighting,
            tables,
            bright: LIT * brightness,
            of_variance: 1.0 / (weighting.noise_sd * weighting.noise_sd),
            sums: Sums::default(),
            waiting: Lanes::new(),
            information: [[0.0; PARAMETERS]; PARAMETERS],
            gradient: [0.0; PARAMETERS],
            edges: Vec::new(),
            grid_share: 0.0,
            edge: 0,
        }
    }

    /// What comes next is cut by this edge.
    pub fn at_edge(&mut self, name: EdgeName) {
        self.edge = self
            .edges
            .iter()
            .position(|e| e.name == name)
            .unwrap_or_else(|| {
                self.edges.push(EdgeSums::new(name));
                self.edges.len() - 1
            });
        if let Some(edge) = self.edges.get_mut(self.edge) {
            edge.next_column();
        }
    }

    /// The next pixel of the edge is not looked at.
    pub fn skip(&mut self) {
        if let Some(edge) = self.edges.get_mut(self.edge) {
            edge.skip();
        }
    }

    /// Judges a pixel that no edge cuts; `None` where it is clipped.
    #[inline]
    pub fn bulk(&mut self, grey: u8, light: f64, background: f64) -> Option<Judged> {
        let (residual, share) = self.residual(grey, light + background)?;
        let (cost, weight, slope) = self.weighting.weigh(residual * residual * self.of_variance);
        self.sums.cost += cost;
        self.sums.pixels += 1;
        if light > self.bright {
            let square = residual * residual;
            let most = OUTLYING * self.weighting.noise_sd;
            self.sums.bright_square += if square <= most * most {
                square
            } else {
                most * residual.abs()
            };
            self.sums.bright_count += 1;
            self.sums.weights += weight;
            self.sums.slopes += slope;
            self.sums.rejected += usize::from(weight < 0.5);
        }
        Some(Judged {
            residual,
            weight: weight * self.of_variance,
            share,
        })
    }

    /// Judges a pixel that an edge may cut: what is `torn` of its light (all of one cut in half) hangs on
    /// where exactly, and by that it is doubted (`doubt_sd`) beyond its noise.
    pub fn edge(
        &mut self,
        grey: u8,
        light: f64,
        background: f64,
        torn: Option<Torn>,
        doubt_sd: f64,
    ) -> Option<Judged> {
        let Some((residual, share)) = self.residual(grey, light + background) else {
            self.skip();
            return None;
        };
        let noise_sd = self.weighting.noise_sd;
        let of_variance = if doubt_sd == 0.0 {
            self.of_variance
        } else {
            1.0 / (noise_sd * noise_sd + doubt_sd * doubt_sd)
        };
        let (cost, weight, slope) = self.weighting.weigh(residual * residual * of_variance);
        self.sums.cost += cost;
        self.sums.pixels += 1;
        self.sums.edge_count += 1;
        self.sums.weights += weight;
        self.sums.slopes += slope;
        self.sums.rejected += usize::from(weight < 0.5);
        match (torn, self.edges.get_mut(self.edge)) {
            (Some(torn), Some(edge)) => {
                // Where the sensor cuts off at zero, less of it shows.
                let bent = torn.bent * share;
                edge.see(Torn { bent, ..torn }, residual, noise_sd);
            }
            _ => self.skip(),
        }
        Some(Judged {
            residual,
            weight: weight * of_variance,
            share,
        })
    }

    /// Residual against what a sensor that gives no negative level would show of `level`:
    /// E max(0, m + n) = m Φ(m/σ) + σ φ(m/σ), derivative Φ(m/σ).
    #[inline]
    fn residual(&self, grey: u8, level: f64) -> Option<(f64, f64)> {
        if grey >= self.weighting.saturation {
            return None;
        }
        let noise_sd = self.weighting.noise_sd;
        if level >= 4.0 * noise_sd {
            return Some((f64::from(grey) - level, 1.0));
        }
        let (share, density) = self.tables.normal(level / noise_sd);
        let expected = level * share + noise_sd * density;
        Some((f64::from(grey) - expected, share))
    }

    /// Adds one pixel to the normal equations.
    #[inline]
    pub fn add(&mut self, j: &[f64; PARAMETERS], weight: f64, residual: f64) {
        if self.waiting.push(j, weight, residual) {
            self.waiting
                .empty_into(&mut self.information, &mut self.gradient);
        }
    }

    /// Adds one pixel that no laser light reaches: it tells of the background alone.
    #[inline]
    pub fn add_dark(&mut self, judged: &Judged) {
        let weighted = judged.weight * judged.share;
        self.information[BACKGROUND][BACKGROUND] += weighted * judged.share;
        self.gradient[BACKGROUND] += weighted * judged.residual;
    }

    pub fn done(mut self) -> Sums {
        self.waiting
            .empty_into(&mut self.information, &mut self.gradient);
        Sums {
            information: Square::from_fn(|a, b| self.information[a.max(b)][a.min(b)]),
            gradient: Column::from_column_slice(&self.gradient),
            edges: EdgesSeen {
                edges: self.edges,
                grid_share: self.grid_share,
            },
            ..self.sums
        }
    }
}
