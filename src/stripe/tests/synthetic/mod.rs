//! Stripes with known truth and the Cramér-Rao bound that goes with them, for tests and benches: the model is written here once more,
//! apart from the extractor's.
#![allow(dead_code)]

use hydroline_core::frame::GreyImage;
use nalgebra::{Matrix4, Vector4};
use rand::{RngExt, SeedableRng, rngs::StdRng};

/// One synthetic frame: a straight stripe with a vertical Gaussian profile integrated over pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct StripeImage {
    /// Width \[px\].
    pub width_px: usize,
    /// Height \[px\].
    pub height_px: usize,
    /// Row of the stripe in column 0 \[px\].
    pub row0_px: f64,
    /// Rows per column.
    pub slope: f64,
    /// Standard deviation of the vertical profile \[px\].
    pub sigma_px: f64,
    /// Height above the background before clipping at 255 \[grey levels\].
    pub peak: f64,
    /// Constant background \[grey levels\].
    pub background: f64,
    /// Gaussian noise before rounding \[grey levels\].
    pub noise_sd: f64,
    /// One-sided haze: level at the stripe as a fraction of the peak (physics: `backscatter_haze`).
    pub haze_fraction: f64,
    /// Decay length of the haze \[px\]; positive = above the stripe (smaller rows), negative = below.
    pub haze_length_px: f64,
    /// Seed of the noise.
    pub seed: u64,
}

impl Default for StripeImage {
    fn default() -> Self {
        Self {
            width_px: 720,
            height_px: 576,
            row0_px: 287.3,
            slope: 0.0,
            sigma_px: 2.0,
            peak: 180.0,
            background: 14.0,
            noise_sd: 2.0,
            haze_fraction: 0.0,
            haze_length_px: 80.0,
            seed: 0,
        }
    }
}

impl StripeImage {
    /// True row of the stripe in a column \[px\].
    pub fn row_px(&self, column_px: f64) -> f64 {
        self.row0_px + self.slope * column_px
    }
}

/// Haze integrated over the pixel at `distance_px` below the stripe: exp(-d/length) on one side.
fn haze_over_pixel(distance_px: f64, length_px: f64) -> f64 {
    let along = distance_px * -length_px.signum();
    let length = length_px.abs().max(1e-9);
    let (from, to) = ((along - 0.5).max(0.0), (along + 0.5).max(0.0));
    length * ((-from / length).exp() - (-to / length).exp())
}

/// Renders the frame: 8-bit, rounded, clipped to 0..=255, reproducible from the seed.
pub fn render(stripe: &StripeImage) -> GreyImage {
    let mut rng = StdRng::seed_from_u64(stripe.seed);
    let mut pixels = Vec::with_capacity(stripe.width_px * stripe.height_px);
    // Twelve uniforms are not a Gaussian in the tails: Box-Muller, both halves used.
    let mut spare = None;
    let mut normal = || {
        spare.take().unwrap_or_else(|| {
            let (u, v): (f64, f64) = (1.0 - rng.random::<f64>(), rng.random());
            let (radius, angle) = ((-2.0 * u.ln()).sqrt(), std::f64::consts::TAU * v);
            spare = Some(radius * angle.sin());
            radius * angle.cos()
        })
    };
    for row in 0..stripe.height_px {
        for column in 0..stripe.width_px {
            let d = row as f64 - stripe.row_px(column as f64);
            let mut light = stripe.background;
            if d.abs() < 8.0 * stripe.sigma_px + 1.0 {
                light += stripe.peak * profile(d, stripe.sigma_px)[0];
            }
            if stripe.haze_fraction != 0.0 {
                light +=
                    stripe.haze_fraction * stripe.peak * haze_over_pixel(d, stripe.haze_length_px);
            }
            pixels.push(
                (light + stripe.noise_sd * normal())
                    .round()
                    .clamp(0.0, 255.0) as u8,
            );
        }
    }
    GreyImage {
        width_px: stripe.width_px,
        height_px: stripe.height_px,
        pixels,
    }
}

/// Integral over the pixel at `distance_px`: Gauss-Legendre of five points.
fn over_pixel(distance_px: f64, f: impl Fn(f64) -> f64) -> f64 {
    const NODES: [(f64, f64); 5] = [
        (-0.906_179_845_938_664, 0.236_926_885_056_189),
        (-0.538_469_310_105_683, 0.478_628_670_499_366),
        (0.0, 0.568_888_888_888_889),
        (0.538_469_310_105_683, 0.478_628_670_499_366),
        (0.906_179_845_938_664, 0.236_926_885_056_189),
    ];
    let each = NODES.iter();
    each.map(|(x, w)| 0.5 * w * f(distance_px + 0.5 * x)).sum()
}

/// P, dP/dc and dP/ds at pixel distance `d` from the stripe's centre.
fn profile(d: f64, s: f64) -> [f64; 3] {
    let gauss = |t: f64| (-0.5 * t * t / (s * s)).exp();
    [
        over_pixel(d, gauss),
        over_pixel(d, |t| t / (s * s) * gauss(t)),
        over_pixel(d, |t| t * t / (s * s * s) * gauss(t)),
    ]
}

/// Cramér-Rao bound on the row of one column \[px\]: background, height, row and width all
/// unknown, pixel-integrated profile, noise variance = noise² + 1/12 for rounding, no clipping.
pub fn row_bound_px(sigma_px: f64, peak: f64, noise_sd: f64, row_px: f64) -> f64 {
    let offset = row_px - row_px.round();
    let reach = (6.0 * sigma_px).ceil() as i64 + 2;
    let information: Matrix4<f64> = (-reach..=reach)
        .map(|k| {
            let [p, pc, ps] = profile(k as f64 - offset, sigma_px);
            let g = Vector4::new(1.0, p, peak * pc, peak * ps);
            g * g.transpose()
        })
        .sum();
    let variance = noise_sd * noise_sd + 1.0 / 12.0;
    information
        .try_inverse()
        .map_or(f64::INFINITY, |c| (variance * c[(2, 2)]).sqrt())
}
