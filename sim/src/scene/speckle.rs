//! Speckle: a grainy factor on the laser's light, reproducible per seed, frame and pixel.

use super::noise::{hash, mix, normal};

/// The grains of one camera.
#[derive(Debug, Clone)]
pub(super) struct Speckle {
    seed: u64,
    /// Standard deviation of the factor's logarithm.
    sigma: f32,
    per_grain: f32,
}

impl Speckle {
    /// `None` without contrast.
    pub fn new(contrast: f64, grain_px: f64, seed: u64) -> Option<Self> {
        // Lognormal with mean 1: sigma^2 = ln(1 + contrast^2).
        (contrast > 0.0).then(|| Speckle {
            seed,
            sigma: (contrast * contrast).ln_1p().sqrt() as f32,
            per_grain: (1.0 / grain_px) as f32,
        })
    }

    /// Factor on the laser's light of one pixel.
    pub fn factor(&self, frame_index: u64, row: usize, column: usize) -> f32 {
        let key = mix(mix(self.seed ^ 0x5be0_cd19_137e_2179).wrapping_add(mix(frame_index)));
        let (x, y) = (column as f32 * self.per_grain, row as f32 * self.per_grain);
        let (i, j) = (x.floor(), y.floor());
        let (fx, fy) = (x - i, y - j);
        let (mut sum, mut squares) = (0.0f32, 0.0f32);
        for (di, wx) in [(0u64, 1.0 - fx), (1, fx)] {
            for (dj, wy) in [(0u64, 1.0 - fy), (1, fy)] {
                let w = wx * wy;
                let node = ((j as u64 + dj) << 32) | (i as u64 + di);
                sum += w * normal(hash(key, node) as usize);
                squares += w * w;
            }
        }
        // The grid's interpolation alone would make the field quieter between its nodes.
        let n = sum / squares.sqrt();
        (self.sigma * n - 0.5 * self.sigma * self.sigma).exp()
    }
}
