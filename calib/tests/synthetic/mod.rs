//! Images of boards, and of what is no board, for tests and benches.
//!
//! Shares nothing with the detector but the board's dimensions (`hydroline_calib::board`): the
//! detector fits blurred patterns in a local perspective, here every subsample is a ray
//! traced through lens, port and water ([`View`]) to solids and laser light (`world`), then
//! blurred, lit, made noisy and quantised ([`finish`]).

#![allow(dead_code, unused_imports)]
#![allow(clippy::unwrap_used, clippy::panic)]

mod clutter;
pub mod hand;
pub mod hard;
mod jpeg;
/// The camera of the lab's comparison of maps, which no map knows.
#[path = "../../../src/lab/maps/truth.rs"]
pub mod truth;
mod view;
mod world;

pub use clutter::{CLUTTER_KINDS, clutter};
pub use view::View;
pub use world::render;

use rand::{SeedableRng, rngs::StdRng};
use rand_distr::{Distribution, Normal};

/// A laser sheet: height over the board's face = offset + tilt_xi·ξ + tilt_eta·η.
#[derive(Debug, Clone, Copy)]
pub struct LaserSheet {
    /// Sheet over the face at the board's middle, towards the camera \[m\].
    pub offset_m: f64,
    /// d height / dξ.
    pub tilt_xi: f64,
    /// d height / dη.
    pub tilt_eta: f64,
    /// Gaussian thickness \[m\].
    pub sigma_m: f64,
    /// Grey levels on a white surface facing the laser.
    pub peak: f64,
    /// Apex above the board's middle \[m\].
    pub apex_m: f64,
}

/// Response of a camera to light: levels run from `black` to `ceiling` as light^γ, between them nothing clips but
/// at the ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tone {
    /// Exponent: below 1 shadows are lifted, above 1 they are pressed.
    pub gamma: f64,
    /// Level without light.
    pub black: f64,
    /// Level of 255 and more.
    pub ceiling: f64,
    /// Noise comes with the light, before the curve; else it is added to the levels.
    pub noise_before: bool,
}

impl Tone {
    /// Levels are light.
    pub const LINEAR: Tone = Tone {
        gamma: 1.0,
        black: 0.0,
        ceiling: 255.0,
        noise_before: false,
    };

    fn level(&self, light: f64) -> f64 {
        let share = (light / 255.0).clamp(0.0, 1.0).powf(self.gamma);
        self.black + (self.ceiling - self.black) * share
    }
}

/// Everything in front of the camera.
#[derive(Debug, Clone)]
pub struct Scene {
    /// Image width and height \[px\].
    pub size: [usize; 2],
    /// Whether the key is on the board.
    pub key: bool,
    /// Grey of the face, of the marks, of what is behind the board.
    pub greys: [f64; 3],
    /// Light at the image's left, right, top, bottom relative to 1: products.
    pub light: [f64; 4],
    /// A stripe across: pixel offset of its middle from the image's middle, slope, σ px, grey levels.
    pub stripe: Option<[f64; 4]>,
    /// Rectangles in front: column, row, width, height \[px\], grey.
    pub occluders: Vec<[f64; 5]>,
    /// The sheet.
    pub laser: Option<LaserSheet>,
    /// Lens blur, σ \[px\].
    pub blur_px: f64,
    /// Camera noise, σ \[grey levels\].
    pub noise: f64,
    /// Factor on the whole image before noise: over 1 saturates.
    pub exposure: f64,
    /// The camera's curve.
    pub tone: Tone,
    /// Noise seed.
    pub seed: u64,
}

impl Default for Scene {
    fn default() -> Self {
        Scene {
            size: [720, 576],
            key: true,
            greys: [190.0, 30.0, 70.0],
            light: [1.0; 4],
            stripe: None,
            occluders: Vec::new(),
            laser: None,
            blur_px: 0.7,
            noise: 2.0,
            exposure: 1.0,
            tone: Tone::LINEAR,
            seed: 1,
        }
    }
}

/// Light, stripe, occluders, blur, noise and quantisation.
pub fn finish(mut image: Vec<f64>, scene: &Scene) -> Vec<u8> {
    let [w, h] = scene.size;
    for r in 0..h {
        let v = r as f64 / (h as f64 - 1.0);
        for c in 0..w {
            let u = c as f64 / (w as f64 - 1.0);
            let light = (scene.light[0] * (1.0 - u) + scene.light[1] * u)
                * (scene.light[2] * (1.0 - v) + scene.light[3] * v);
            let pixel = &mut image[r * w + c];
            *pixel *= light;
            if let Some([offset, slope, sigma, peak]) = scene.stripe {
                let d = r as f64 - 0.5 * h as f64 - offset - slope * (c as f64 - 0.5 * w as f64);
                *pixel += peak * (-0.5 * (d / sigma).powi(2)).exp();
            }
            for &[x, y, width, height, grey] in &scene.occluders {
                let (dx, dy) = (c as f64 - x, r as f64 - y);
                if (0.0..width).contains(&dx) && (0.0..height).contains(&dy) {
                    *pixel = grey;
                }
            }
        }
    }
    let image = gauss(image, w, h, scene.blur_px);
    let mut rng = StdRng::seed_from_u64(scene.seed);
    let noise = Normal::new(0.0, scene.noise.max(0.0)).ok();
    image
        .iter()
        .map(|v| {
            let n = noise.map_or(0.0, |n| n.sample(&mut rng));
            let lit = v * scene.exposure;
            let level = match scene.tone {
                Tone::LINEAR => lit + n,
                tone if tone.noise_before => tone.level(lit + n),
                tone => (tone.level(lit) + n).min(tone.ceiling),
            };
            level.round().clamp(0.0, 255.0) as u8
        })
        .collect()
}

fn gauss(image: Vec<f64>, w: usize, h: usize, sigma: f64) -> Vec<f64> {
    if sigma < 0.05 {
        return image;
    }
    let reach = (4.0 * sigma).ceil() as i64;
    let mut taps: Vec<f64> = (-reach..=reach)
        .map(|k| (-0.5 * (k as f64 / sigma).powi(2)).exp())
        .collect();
    let sum: f64 = taps.iter().sum();
    taps.iter_mut().for_each(|t| *t /= sum);
    let pass =
        |from: &[f64], step: usize, count: usize, line: &dyn Fn(usize) -> usize, lines: usize| {
            let mut out = vec![0.0; from.len()];
            for l in 0..lines {
                let base = line(l);
                for k in 0..count {
                    out[base + k * step] = taps
                        .iter()
                        .enumerate()
                        .map(|(n, t)| {
                            let at =
                                (k as i64 + n as i64 - reach).clamp(0, count as i64 - 1) as usize;
                            t * from[base + at * step]
                        })
                        .sum();
                }
            }
            out
        };
    let across = pass(&image, 1, w, &|r| r * w, h);
    pass(&across, w, h, &|c| c, w)
}
