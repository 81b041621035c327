//! What a comparison adds up, and how a residual counts.

use super::{BACKGROUND, BRIGHTNESS, Column, PARAMETERS, Square, THICKNESS};
use crate::pose::normal::Tables;

/// Pixels with this much light torn by an edge say how good the edges are \[grey levels\].
const TORN: f64 = 20.0;
/// Residuals beyond this share of the torn light are particles, not edges.
const EXCESS_MOST: f64 = 0.15;
/// Least and greatest doubt: what is found from a thousand pixels is uncertain itself.
const DOUBT_RANGE: [f64; 2] = [0.005, 0.1];
/// Pixels of a block: about the area 4πb² (b² = 0.57 px²) within which all that comes through one
/// point spread deviates together, along and across the edge.
const BLOCK_PX: usize = 4;

/// Light above this share of the line's brightness counts as lit.
const LIT: f64 = 0.15;

pub(super) const ALL: [usize; PARAMETERS] = [0, 1, 2, 3, 4, 5, 6, 7, 8];
/// What moves light that no edge cuts: x, y and ψ move edges only.
pub(super) const BULK: [usize; 6] = [2, 3, 4, BRIGHTNESS, THICKNESS, BACKGROUND];

/// Sums over the pixels.
#[derive(Debug, Clone, Default)]
pub(in crate::pose) struct Sums {
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
    /// Number of edge pixels.
    pub edge_count: usize,
    /// Pixels whose weight is below one half.
    pub rejected: usize,
    /// Squared residuals of pixels that an edge tears, their torn light squared, and their number.
    pub torn_square: f64,
    pub torn_light2: f64,
    pub torn_count: usize,
    /// Of `information`, what pixels give that an edge tears.
    pub torn_information: Square,
    /// Σ g gᵀ over blocks of such pixels, g = Jᵀ W r of a block, and the number of blocks.
    pub torn_scores: Square,
    pub blocks: usize,
}

impl Sums {
    /// Standard deviation of pixels that an edge cuts beyond their noise, as a share of the light
    /// of a pixel cut in half. No edge is machined, nor any image formed, to a hundredth of a
    /// pixel: how well these are is seen in what the edges' pixels leave over.
    pub fn edge_doubt(&self, noise_sd: f64) -> f64 {
        let excess = self.torn_square - self.torn_count as f64 * noise_sd * noise_sd;
        let found = if self.torn_light2 > 0.0 {
            (excess / self.torn_light2).max(0.0).sqrt()
        } else {
            0.0
        };
        found.clamp(DOUBT_RANGE[0], DOUBT_RANGE[1])
    }
}

/// How residuals count.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::pose) struct Weighting {
    /// Pixel noise \[grey levels\].
    pub noise_sd: f64,
    /// Beyond this many noise sds a residual counts less and less (Tukey) or linearly (Huber).
    pub cut: f64,
    pub redescending: bool,
    /// Level from which a pixel counts as clipped.
    pub saturation: u8,
}

impl Weighting {
    /// Cost and weight of a residual in units of the noise.
    #[inline]
    fn weigh(&self, scaled: f64) -> (f64, f64) {
        let c = self.cut;
        if self.redescending {
            // Tukey's biweight, scaled so that ρ = r²/2 near zero.
            let rest = 1.0 - scaled * scaled / (c * c);
            if rest <= 0.0 {
                (c * c / 6.0, 0.0)
            } else {
                let rest2 = rest * rest;
                (c * c / 6.0 * (1.0 - rest2 * rest), rest2)
            }
        } else {
            let a = scaled.abs();
            if a <= c {
                (0.5 * a * a, 1.0)
            } else {
                (c * a - 0.5 * c * c, c / a)
            }
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
    pub sums: Sums,
    /// Lower triangle of the information.
    pub information: [[f64; PARAMETERS]; PARAMETERS],
    pub gradient: [f64; PARAMETERS],
    torn_information: [[f64; PARAMETERS]; PARAMETERS],
    torn_scores: [[f64; PARAMETERS]; PARAMETERS],
    /// Scores of the blocks of the columns that are at hand, by row; those begun.
    blocks: Vec<[f64; PARAMETERS]>,
    begun: Vec<usize>,
    block_column: usize,
}

impl<'a> Counter<'a> {
    pub fn new(weighting: &'a Weighting, tables: &'static Tables, brightness: f64) -> Self {
        Counter {
            weighting,
            tables,
            bright: LIT * brightness,
            sums: Sums::default(),
            information: [[0.0; PARAMETERS]; PARAMETERS],
            gradient: [0.0; PARAMETERS],
            torn_information: [[0.0; PARAMETERS]; PARAMETERS],
            torn_scores: [[0.0; PARAMETERS]; PARAMETERS],
            blocks: Vec::new(),
            begun: Vec::new(),
            block_column: 0,
        }
    }

    /// Judges a pixel that no edge cuts; `None` where it is clipped.
    #[inline]
    pub fn bulk(&mut self, grey: u8, light: f64, background: f64) -> Option<Judged> {
        let (residual, share) = self.residual(grey, light + background)?;
        let inverse = 1.0 / self.weighting.noise_sd;
        let (cost, weight) = self.weighting.weigh(residual * inverse);
        self.sums.cost += cost;
        self.sums.pixels += 1;
        if light > self.bright {
            self.sums.bright_square += weight * residual * residual;
            self.sums.bright_count += 1;
            self.sums.rejected += usize::from(weight < 0.5);
        }
        Some(Judged {
            residual,
            weight: weight * inverse * inverse,
            share,
        })
    }

    /// Judges a pixel that an edge may cut: `torn` of its light (all of one cut in half) hangs on
    /// where exactly, and by that it is doubted (`doubt_sd`) beyond its noise.
    pub fn edge(
        &mut self,
        grey: u8,
        light: f64,
        background: f64,
        torn: Option<f64>,
        doubt_sd: f64,
    ) -> Option<Judged> {
        let (residual, share) = self.residual(grey, light + background)?;
        let noise_sd = self.weighting.noise_sd;
        let variance = noise_sd * noise_sd + doubt_sd * doubt_sd;
        let (cost, weight) = self.weighting.weigh(residual / variance.sqrt());
        self.sums.cost += cost;
        self.sums.pixels += 1;
        self.sums.edge_count += 1;
        self.sums.rejected += usize::from(weight < 0.5);
        if let Some(torn) = torn.filter(|t| *t > TORN)
            && residual.abs() < EXCESS_MOST * torn + 4.0 * noise_sd
        {
            self.sums.torn_square += residual * residual;
            self.sums.torn_light2 += torn * torn;
            self.sums.torn_count += 1;
        }
        Some(Judged {
            residual,
            weight: weight / variance,
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

    /// Adds one pixel to the lower triangle of the normal equations, for the parameters in `which`.
    #[inline]
    pub fn add<const N: usize>(
        &mut self,
        which: &[usize; N],
        j: &[f64; PARAMETERS],
        weight: f64,
        residual: f64,
    ) {
        for (n, &a) in which.iter().enumerate() {
            let wj = weight * j[a];
            self.gradient[a] += wj * residual;
            for &b in &which[..=n] {
                self.information[a][b] += wj * j[b];
            }
        }
    }

    /// Adds a pixel that an edge tears, at its column and row; columns come in ascending order.
    pub fn add_torn(
        &mut self,
        [column, row]: [usize; 2],
        j: &[f64; PARAMETERS],
        weight: f64,
        residual: f64,
    ) {
        if column / BLOCK_PX != self.block_column {
            self.end_blocks();
            self.block_column = column / BLOCK_PX;
        }
        let block = row / BLOCK_PX;
        if self.blocks.len() <= block {
            self.blocks.resize(block + 1, [0.0; PARAMETERS]);
        }
        if !self.begun.contains(&block) {
            self.begun.push(block);
        }
        let score = &mut self.blocks[block];
        for a in 0..PARAMETERS {
            let wj = weight * j[a];
            self.gradient[a] += wj * residual;
            score[a] += wj * residual;
            for (sum, j) in self.torn_information[a].iter_mut().zip(&j[..=a]) {
                *sum += wj * j;
            }
        }
    }

    fn end_blocks(&mut self) {
        for block in self.begun.drain(..) {
            let score = std::mem::replace(&mut self.blocks[block], [0.0; PARAMETERS]);
            for a in 0..PARAMETERS {
                for b in 0..=a {
                    self.torn_scores[a][b] += score[a] * score[b];
                }
            }
            self.sums.blocks += 1;
        }
    }

    pub fn done(mut self) -> Sums {
        self.end_blocks();
        let square =
            |m: &[[f64; PARAMETERS]; PARAMETERS]| Square::from_fn(|a, b| m[a.max(b)][a.min(b)]);
        let mut sums = self.sums;
        sums.torn_information = square(&self.torn_information);
        sums.torn_scores = square(&self.torn_scores);
        sums.information = square(&self.information) + sums.torn_information;
        sums.gradient = Column::from_column_slice(&self.gradient);
        sums
    }
}
