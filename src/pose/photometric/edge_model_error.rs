//! Model error of the target's edges, estimated from their residuals.
//!
//! No edge is machined, nor any image formed, to a hundredth of a pixel. The model error of an edge is the
//! standard deviation, beyond its noise, of a pixel cut in half, as a share of its light. Each edge has its
//! own: one along the pixels' columns shows every step of a sampled image, one aslant averages over them.
//! Such steps extend over several rows, so that residuals of one column are correlated and carry less information than as
//! many independent ones: the model error contains their covariance over two rows, which is three times the variance of one
//! pixel at most. Where a whole column of an upright edge is off alike that is still too little (1.9 times the sd over ten
//! rows). The systematic part that all edges share, blur that is formed on the pixel grid ([`super::grid`]), is estimated first.

/// Least [`EdgeLight`] of the pixels from which an edge's model error is estimated \[grey levels\].
const EDGE_LIGHT_LEAST: f64 = 20.0;
/// Prior sd of the share of blur that is formed on the pixel grid.
const GRID_SHARE_SD: f64 = 0.5;
/// Residuals beyond this share of the light that an edge cuts are particles, not edges.
const EXCESS_MOST: f64 = 0.15;
/// Least and greatest model error: an estimate from some hundred pixels is uncertain itself. The least
/// is that of an edge that lies off by a hundredth of a pixel.
const MODEL_ERROR_RANGE: [f64; 2] = [0.005, 0.1];

/// Light of a pixel that an edge cuts.
#[derive(Debug, Clone, Copy)]
pub(super) struct EdgeLight {
    /// All of a pixel's light where it is cut in half \[grey levels\].
    pub light: f64,
    /// Derivative of the light by the share of blur that is formed on the pixel grid \[grey levels\].
    pub by_grid: f64,
}

/// Weights of the covariance of pixels one and two rows apart (Newey and West 1987, two lags).
const BY_LAG: [f64; 2] = [2.0 / 3.0, 1.0 / 3.0];

/// One edge of one upper face.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct EdgeName {
    pub face: u16,
    pub edge: u16,
}

/// Model error of a frame's edges, and of its pixels.
#[derive(Debug, Clone, Default)]
pub(crate) struct EdgeModelError {
    /// `None`: not estimated yet.
    pub(super) edges: Option<Vec<(EdgeName, f64)>>,
    /// Of each pixel that an edge may cut, in their order \[grey levels\]: found at the first
    /// state compared and held fixed after that: otherwise the fit could lower its cost by raising the model error.
    pub(super) of_pixels: Vec<f32>,
    /// Share of the blur that is formed on the pixel grid.
    pub(super) grid_share: f64,
}

impl EdgeModelError {
    /// Of the edges, from their residuals: none below that of all edges together,
    /// since few pixels may have small residuals by chance.
    pub fn found(sums: &EdgesSeen, noise_sd: f64) -> EdgeModelError {
        EdgeModelError::of_edges(&sums.edges, sums, noise_sd)
    }

    /// The same without the correlation along the column: while the geometry of the sheet is refined, residuals of an edge
    /// are correlated because of the geometry, which must not be absorbed as model error.
    pub fn found_apart(sums: &EdgesSeen, noise_sd: f64) -> EdgeModelError {
        let apart = sums.edges.iter().map(|e| EdgeSums {
            along: [0.0; 3],
            ..e.clone()
        });
        EdgeModelError::of_edges(&apart.collect::<Vec<_>>(), sums, noise_sd)
    }

    fn of_edges(edges: &[EdgeSums], sums: &EdgesSeen, noise_sd: f64) -> EdgeModelError {
        let grid_share = sums.grid_share(noise_sd);
        let more = grid_share - sums.grid_share;
        let all = all(edges).model_error_sd(noise_sd, more);
        EdgeModelError {
            edges: Some(
                edges
                    .iter()
                    .map(|e| (e.name, e.model_error_sd(noise_sd, more).max(all)))
                    .collect(),
            ),
            of_pixels: Vec::new(),
            grid_share,
        }
    }

    pub(super) fn known(&self) -> bool {
        self.edges.is_some()
    }

    /// Of one edge; of one that no pixel has shown yet the least, until the next estimate.
    pub(super) fn of(&self, name: EdgeName) -> Option<f64> {
        let edges = self.edges.as_ref()?;
        let found = edges.iter().find(|(n, _)| *n == name);
        Some(found.map_or(MODEL_ERROR_RANGE[0], |(_, q)| *q))
    }
}

/// The edges that a comparison has met.
#[derive(Debug, Clone, Default)]
pub(crate) struct EdgesSeen {
    pub(super) edges: Vec<EdgeSums>,
    /// Share of the blur that the light was taken to get on the pixel grid.
    pub(super) grid_share: f64,
}

impl EdgesSeen {
    /// Model error of all edges taken together.
    pub fn model_error_sd(&self, noise_sd: f64) -> f64 {
        let more = self.grid_share(noise_sd) - self.grid_share;
        all(&self.edges).model_error_sd(noise_sd, more)
    }

    /// Share of the edges' squared model error that the pixels of an edge have alike: near one where edges as a whole lie
    /// elsewhere than the target's or the camera's curve is another, near zero where pixels scatter, as compression leaves them.
    pub fn alike(&self, noise_sd: f64) -> f64 {
        let (mut alike, mut excess) = (0.0, 0.0);
        for e in self.edges.iter().filter(|e| e.light2 > 0.0) {
            // Scatter alone leaves one pixel's square.
            alike += e.residual_by_light.powi(2) / e.light2 - e.square / e.count as f64;
            excess += e.square - e.count as f64 * noise_sd * noise_sd;
        }
        match excess > 0.0 {
            true => (alike / excess).clamp(0.0, 1.0),
            false => 0.0,
        }
    }

    /// Squared shift of the edges as a whole over the variance that the fit's weights give it, mean of the edges; at least one
    /// (Birge 1932): what the pixels of an edge have alike does not average out over them.
    pub fn birge2(&self) -> f64 {
        let seen = self.edges.iter().filter(|e| e.weighed[1] > 0.0);
        let (sum, n) = seen.fold((0.0, 0.0), |(sum, n), e| {
            (sum + e.weighed[0] * e.weighed[0] / e.weighed[1], n + 1.0)
        });
        (sum / f64::max(n, 1.0)).max(1.0)
    }

    /// Share of the blur that is formed on the pixel grid, by least squares of the edges' residuals:
    /// within 0.04 from one frame of two edges along the columns, shrunk to zero where pixels are few. It holds
    /// if the rig's blur does: edges a tenth sharper than that count as 0.2 of it along the columns and as all aslant,
    /// where κ has the shape of a narrower spread; to the pose the two are then the same.
    pub fn grid_share(&self, noise_sd: f64) -> f64 {
        let all = all(&self.edges);
        let known = all.by_grid2 + (noise_sd / GRID_SHARE_SD).powi(2);
        (self.grid_share * (all.by_grid2 / known) + all.residual_by_grid / known).clamp(0.0, 1.0)
    }
}

/// Edges taken together.
fn all(edges: &[EdgeSums]) -> EdgeSums {
    let mut all = EdgeSums::default();
    for e in edges {
        all.square += e.square;
        all.light2 += e.light2;
        all.residual_by_grid += e.residual_by_grid;
        all.residual_by_light += e.residual_by_light;
        all.by_grid2 += e.by_grid2;
        for (a, b) in all.along.iter_mut().zip(e.along) {
            *a += b;
        }
        all.count += e.count;
    }
    all
}

/// Sums over the pixels of an edge.
#[derive(Debug, Clone, Default)]
pub(super) struct EdgeSums {
    pub name: EdgeName,
    /// Squared residuals, [`EdgeLight::light`] squared.
    square: f64,
    light2: f64,
    /// Products of residuals and what grid blur would add, and the square of the latter.
    residual_by_grid: f64,
    by_grid2: f64,
    /// Products of residuals and [`EdgeLight::light`]; and of their weighted sums, as the fit weighs these pixels, the product and
    /// the light squared.
    residual_by_light: f64,
    weighed: [f64; 2],
    /// Σ w (rᵢ rⱼ, rᵢ bⱼ + bᵢ rⱼ, bᵢ bⱼ) over pixels one and two rows apart: r residual, b what grid blur would add.
    along: [f64; 3],
    /// The last pixels of the column, the nearest first.
    before: [Option<[f64; 2]>; 2],
    count: usize,
}

impl EdgeSums {
    pub fn new(name: EdgeName) -> Self {
        EdgeSums {
            name,
            ..EdgeSums::default()
        }
    }

    /// Begins another column.
    pub fn next_column(&mut self) {
        self.before = [None; 2];
    }

    /// The next pixel of the column is not counted.
    pub fn skip(&mut self) {
        self.before = [None, self.before[0]];
    }

    /// Counts a pixel that the edge cuts, one row after the last one; `of_variance` is what the fit weighs it by.
    #[inline]
    pub fn see(&mut self, edge_light: EdgeLight, residual: f64, noise_sd: f64, of_variance: f64) {
        let light = edge_light.light;
        if light > EDGE_LIGHT_LEAST && residual.abs() < EXCESS_MOST * light + 4.0 * noise_sd {
            self.square += residual * residual;
            self.light2 += light * light;
            self.residual_by_light += light * residual;
            self.weighed[0] += light * residual * of_variance;
            self.weighed[1] += light * light * of_variance;
            self.residual_by_grid += edge_light.by_grid * residual;
            self.by_grid2 += edge_light.by_grid * edge_light.by_grid;
            self.count += 1;
            for (before, weight) in self.before.iter().zip(BY_LAG) {
                if let Some([r, b]) = before {
                    self.along[0] += weight * r * residual;
                    self.along[1] += weight * (r * edge_light.by_grid + b * residual);
                    self.along[2] += weight * b * edge_light.by_grid;
                }
            }
            self.before = [Some([residual, edge_light.by_grid]), self.before[0]];
        } else {
            self.skip();
        }
    }

    /// Standard deviation of pixels beyond their noise, as a share of the light of a pixel cut in half,
    /// once so much more of the blur is taken to be formed on the pixel grid.
    fn model_error_sd(&self, noise_sd: f64, more: f64) -> f64 {
        let square = self.square - more * (2.0 * self.residual_by_grid - more * self.by_grid2);
        let [residuals, mixed, by_grid] = self.along;
        let along = residuals - more * (mixed - more * by_grid);
        let excess = square - self.count as f64 * noise_sd * noise_sd + 2.0 * along.max(0.0);
        let found = if self.light2 > 0.0 {
            (excess / self.light2).max(0.0).sqrt()
        } else {
            0.0
        };
        found.clamp(MODEL_ERROR_RANGE[0], MODEL_ERROR_RANGE[1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn model_error_sd(residuals: &[Option<f64>], columns: usize) -> f64 {
        let mut sums = EdgeSums::default();
        for _ in 0..columns {
            sums.next_column();
            for r in residuals {
                match r {
                    Some(r) => sums.see(
                        EdgeLight {
                            light: 100.0,
                            by_grid: 0.0,
                        },
                        *r,
                        1.0,
                        1.0,
                    ),
                    None => sums.skip(),
                }
            }
        }
        sums.model_error_sd(1.0, 0.0)
    }

    #[test]
    fn correlated_residuals_raise_the_model_error() {
        let same = [Some(3.0); 6];
        let turns = [3.0, -3.0, 3.0, -3.0, 3.0, -3.0].map(Some);
        // Σr² − n, and by two lags Σ w rᵢrⱼ twice: 54 − 6, + 2·9·(5·2/3 + 4/3).
        let light2: f64 = 6.0 * 1e4;
        assert!((model_error_sd(&turns, 1) - (48.0 / light2).sqrt()).abs() < 1e-12);
        assert!((model_error_sd(&same, 1) - ((48.0 + 84.0) / light2).sqrt()).abs() < 1e-12);
        // Another column is another matter, and so are pixels three rows apart.
        assert!((model_error_sd(&[Some(3.0)], 6) - (48.0 / light2).sqrt()).abs() < 1e-12);
        let apart = [Some(3.0), None, None, Some(3.0)];
        assert!((model_error_sd(&apart, 3) - (48.0 / light2).sqrt()).abs() < 1e-12);
    }

    #[test]
    fn a_shift_of_a_whole_edge_is_not_scatter() {
        let seen = |residual: fn(i32) -> f64| {
            let mut sums = EdgeSums::default();
            for k in 0..40 {
                sums.next_column();
                let edge_light = EdgeLight {
                    light: 100.0,
                    by_grid: 0.0,
                };
                sums.see(edge_light, residual(k), 1.0, 1.0 / 9.0);
            }
            EdgesSeen {
                edges: vec![sums],
                grid_share: 0.0,
            }
        };
        let scatter = seen(|k| if k % 2 == 0 { 3.0 } else { -3.0 });
        assert_eq!((scatter.alike(1.0), scatter.birge2()), (0.0, 1.0));
        // Of 40 · 9 − 40 that they have beyond the noise 40 · 9 − 9 are alike: all of it. A shift of √40 of its sds.
        let shift = seen(|_| 3.0);
        assert_eq!(shift.alike(1.0), 1.0);
        assert!((shift.birge2() - 40.0).abs() < 1e-9, "{}", shift.birge2());
    }

    #[test]
    fn blur_on_the_grid_is_not_model_error() {
        let mut sums = EdgeSums::default();
        for k in 0..40 {
            let by_grid = 8.0 * f64::from(k).sin();
            sums.see(
                EdgeLight {
                    light: 100.0,
                    by_grid,
                },
                0.7 * by_grid,
                1.0,
                1.0,
            );
        }
        let seen = EdgesSeen {
            edges: vec![sums],
            grid_share: 0.2,
        };
        // 0.2 was taken already: 0.9, shrunk a little.
        let found = seen.grid_share(1.0);
        assert!((found - 0.9).abs() < 0.01, "{found}");
        assert_eq!(seen.model_error_sd(1.0), MODEL_ERROR_RANGE[0]);
        assert!(EdgeModelError::found(&seen, 1.0).grid_share == found);
    }
}
