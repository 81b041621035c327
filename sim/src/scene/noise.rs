//! Image noise: counter-based, fast, reproducible.
//!
//! Each group of four neighbouring pixels takes one 64-bit hash of (seed, frame, group
//! number), 16 bits per pixel; the 16 bits pick a sample from a table of the normal
//! distribution's 65536 mid-quantiles. No state runs along the image, so any thread may
//! do any pixel in any order.
//!
//! Statistics of the table (asserted below): mean 0 by symmetry, variance 1 by scaling,
//! kurtosis 3 - 0.001, cut at +-4.3 sd. After rounding to 8 bits the quantisation adds
//! its 1/12. Where there is no laser light the grey level itself comes from a second
//! table of bytes, made by the same formula, so the fast path changes no pixel.

use std::sync::LazyLock;

use super::exposure::Exposure;
use hydroline_rigs::ImageNoise;

const SAMPLES: usize = 1 << 16;

/// Mid-quantiles of N(0, 1), ascending, variance exactly 1.
static NORMAL: LazyLock<Vec<f32>> = LazyLock::new(|| {
    // The quantile function solves dx/dp = 1/phi(x) from x(1/2) = 0: RK4 outwards.
    let rate = |x: f64| (0.5 * x * x).exp() * (2.0 * std::f64::consts::PI).sqrt();
    let half = SAMPLES / 2;
    let substeps = 8;
    let mut upper = Vec::with_capacity(half);
    let mut x = 0.0f64;
    let h = 1.0 / (SAMPLES * substeps) as f64;
    for i in 0..half {
        // First mid-quantile is half a cell out, the others one cell further each.
        for _ in 0..(if i == 0 { substeps / 2 } else { substeps }) {
            let k1 = rate(x);
            let k2 = rate(x + 0.5 * h * k1);
            let k3 = rate(x + 0.5 * h * k2);
            let k4 = rate(x + h * k3);
            x += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
        }
        upper.push(x);
    }
    let variance = upper.iter().map(|x| x * x).sum::<f64>() / half as f64;
    let scale = variance.sqrt().recip();
    let lower = upper.iter().rev().map(|x| -x);
    lower
        .chain(upper.iter().copied())
        .map(|x| (x * scale) as f32)
        .collect()
});

/// The noise of one camera.
#[derive(Debug, Clone)]
pub struct Noise {
    seed: u64,
    ambient: f32,
    read_variance: f32,
    shot_gain: f32,
    saturation: f32,
    normal: &'static [f32],
    /// Grey level without laser light, per 16 bits of hash.
    dark: Vec<u8>,
    /// Light that is not even, or a camera that is not linear.
    exposure: Option<Exposure>,
}

impl Noise {
    /// `saturation`: grey level at which the sensor clips (at most 255).
    pub fn new(noise: &ImageNoise, seed: u64, saturation: f64) -> Self {
        let mut made = Noise {
            seed,
            ambient: noise.ambient as f32,
            read_variance: (noise.read_sd * noise.read_sd) as f32,
            shot_gain: noise.shot_gain as f32,
            saturation: saturation.clamp(0.0, 255.0) as f32,
            normal: &NORMAL,
            dark: Vec::new(),
            exposure: None,
        };
        made.dark = (0..SAMPLES).map(|i| made.grey(0.0, i)).collect();
        made
    }

    /// The same camera under a light that is not even, or with a curve.
    pub(super) fn under(mut self, exposure: Option<Exposure>) -> Self {
        self.exposure = exposure;
        self
    }

    /// Grey level of `signal` grey levels of light plus ambient under noise sample `index`.
    fn grey(&self, signal: f32, index: usize) -> u8 {
        // `as u8` saturates at 0 and 255, and NaN gives 0.
        self.linear(self.ambient + signal, index).round() as u8
    }

    /// The same, of a pixel whose light takes another way.
    fn exposed(&self, exposure: &Exposure, light: f32, index: usize) -> u8 {
        (exposure.grey(f64::from(self.linear(light, index))) as f32).round() as u8
    }

    /// Levels of a linear sensor: `level` grey levels of light, noise sample `index`, clipped where it saturates.
    fn linear(&self, level: f32, index: usize) -> f32 {
        // Shot noise: variance proportional to the light; read noise: constant.
        let sd = (self.read_variance + self.shot_gain * level.max(0.0)).sqrt();
        (level + sd * self.normal[index & (SAMPLES - 1)]).min(self.saturation)
    }

    /// Key of a frame: frames of one seed and seeds of one frame have unrelated streams.
    fn key(&self, frame_index: u64) -> u64 {
        mix(mix(self.seed ^ 0x6a09_e667_f3bc_c909)
            .wrapping_add(mix(frame_index ^ 0xbb67_ae85_84ca_a73b)))
    }

    /// Fills one row of `out` with ambient light and noise.
    pub(super) fn dark_row(&self, frame_index: u64, row: usize, out: &mut [u8]) {
        let key = self.key(frame_index);
        let groups = out.len().div_ceil(4) as u64;
        let base = row as u64 * groups;
        if let Some(exposure) = &self.exposure {
            let light = exposure.row(frame_index, row);
            for (g, four) in out.chunks_mut(4).enumerate() {
                let bits = hash(key, base + g as u64);
                for (k, pixel) in four.iter_mut().enumerate() {
                    let level = exposure.light(&light, (4 * g + k) as f64, 0.0) as f32;
                    *pixel = self.exposed(exposure, level, (bits >> (16 * k)) as usize);
                }
            }
            return;
        }
        for (g, four) in out.chunks_mut(4).enumerate() {
            let bits = hash(key, base + g as u64);
            for (k, pixel) in four.iter_mut().enumerate() {
                *pixel = self.dark[(bits >> (16 * k)) as usize & (SAMPLES - 1)];
            }
        }
    }

    /// Grey level of one pixel that also gets `signal` grey levels of laser light.
    pub(super) fn pixel(
        &self,
        frame_index: u64,
        row: usize,
        column: usize,
        width: usize,
        signal: f32,
    ) -> u8 {
        let groups = width.div_ceil(4) as u64;
        let bits = hash(
            self.key(frame_index),
            row as u64 * groups + (column / 4) as u64,
        );
        let index = (bits >> (16 * (column % 4))) as usize & (SAMPLES - 1);
        match &self.exposure {
            None => self.grey(signal, index),
            Some(exposure) => {
                let row = exposure.row(frame_index, row);
                let light = exposure.light(&row, column as f64, f64::from(signal)) as f32;
                self.exposed(exposure, light, index)
            }
        }
    }
}

/// Standard normal sample of the low 16 bits of a hash.
pub(super) fn normal(bits: usize) -> f32 {
    NORMAL[bits & (SAMPLES - 1)]
}

/// splitmix64's finaliser (Steele, Lea, Flood 2014; Stafford's variant 13).
pub(super) fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// splitmix64 at position `counter` of the stream `key`.
pub(super) fn hash(key: u64, counter: u64) -> u64 {
    mix(key.wrapping_add(counter.wrapping_mul(0x9e37_79b9_7f4a_7c15)))
}

#[cfg(test)]
mod tests;
