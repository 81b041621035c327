//! One-sided haze: the sheet lights the water it crosses, and the camera sees that light on one
//! side of the stripe only (notes 2.4; physics: `backscatter_haze`).
//!
//! `light = fraction * peak * exp(-d / length)`, d = distance beyond the stripe on that side.
//! One column cannot tell it from the stripe's own shift; all columns together can, from the
//! pixels outside the stripe: their mean, aligned on the stripe, is fitted with a constant, a
//! slope (uneven light) and the haze, on either side and with several lengths.

use super::fit::{Fit, HazeShape};
use super::kernel::{Kernel, PHASES, phase_offset};
use super::synthetic::haze_over_pixel;
use crate::frame::GreyImage;
use nalgebra::{Matrix3, Vector3};

/// Farthest pixel looked at \[px\].
const REACH_PX: i64 = 56;
/// Columns looked at, at most.
const MAX_COLUMNS: usize = 240;
/// Decay lengths tried \[px\].
const LENGTHS_PX: [f64; 5] = [20.0, 30.0, 50.0, 90.0, 300.0];
/// A shorter length must explain the data better by this much chi², else the longest that does:
/// the level at the stripe is extrapolated, the more the shorter the length.
const CHI2_FOR_SHORTER: f64 = 4.0;
/// Least significance and least level at which a correction is worth its own noise.
const MIN_SIGNIFICANCE: f64 = 3.5;
const MIN_FRACTION: f64 = 0.002;

/// Haze of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Haze {
    /// Level at the stripe as a fraction of the peak.
    pub fraction: f64,
    /// Its standard deviation.
    pub fraction_sd: f64,
    /// Decay length \[px\], positive = above the stripe.
    pub length_px: f64,
}

/// Estimates the haze from columns `(column, fit)` that are free of steps and rivals.
pub(super) fn estimate<'a>(
    image: &GreyImage,
    columns: impl ExactSizeIterator<Item = (usize, &'a Fit)>,
    noise_sd: f64,
) -> Option<Haze> {
    const SIZE: usize = 2 * REACH_PX as usize + 1;
    let mut sums = [0.0f64; SIZE];
    let mut counts = [0.0f64; SIZE];
    let mut peaks = [0.0f64; SIZE];
    let mut widths = Vec::with_capacity(MAX_COLUMNS);
    let every = columns.len().div_ceil(MAX_COLUMNS).max(1);
    for (column, fit) in columns.step_by(every) {
        widths.push(fit.sigma_px);
        let middle = fit.row_px.round() as i64;
        let first = (middle - REACH_PX).max(0);
        let last = (middle + REACH_PX).min(image.height_px as i64 - 1);
        let clip = 4.0 * noise_sd + 0.25 * fit.peak.min(255.0);
        let start = first as usize * image.width_px + column;
        let line = image.pixels[start..].iter().step_by(image.width_px);
        for (k, pixel) in (first..=last).zip(line) {
            let above = f64::from(*pixel) - fit.background;
            // Particles, ghosts and other segments are brighter than haze can be.
            if above.abs() <= clip {
                let i = (k - middle + REACH_PX) as usize;
                sums[i] += above;
                counts[i] += 1.0;
                peaks[i] += fit.peak;
            }
        }
    }
    // Beyond 4.5 sigma nothing of the stripe is left (4e-5 of its peak).
    let middle = widths.len() / 2;
    if widths.is_empty() {
        return None;
    }
    let width = *widths.select_nth_unstable_by(middle, f64::total_cmp).1;
    let guard = (4.5 * width + 1.0).ceil() as i64;
    let most = counts.iter().fold(0.0f64, |m, c| m.max(*c));
    let samples: Vec<(f64, f64, f64)> = (-REACH_PX..=REACH_PX)
        .filter(|d| d.abs() > guard)
        .filter_map(|d| {
            let i = (d + REACH_PX) as usize;
            (counts[i] > 0.5 * most && peaks[i] > 0.0)
                .then(|| (d as f64, sums[i] / peaks[i], counts[i]))
        })
        .collect();
    let both = |sign: f64| samples.iter().filter(|s| s.0 * sign > 0.0).count() >= 6;
    if most < 8.0 || !both(1.0) || !both(-1.0) {
        return None;
    }
    let mean_peak = peaks.iter().sum::<f64>() / counts.iter().sum::<f64>();
    // In units of the noise of one pixel over the peak: the larger of what the camera gives and
    // what the best fit leaves, so that uneven light does not pass for haze.
    let fits: Vec<(f64, LevelFit)> = LENGTHS_PX
        .iter()
        .flat_map(|l| [*l, -*l])
        .filter_map(|length| Some((length, fit_level(&samples, length)?)))
        .collect();
    let least = fits.iter().map(|f| f.1.chi2).min_by(f64::total_cmp)?;
    let scatter = least / (samples.len() as f64 - 4.0).max(1.0);
    let unit = scatter.max((noise_sd / mean_peak).powi(2));
    let (length_px, level) = fits
        .into_iter()
        .filter(|f| f.1.chi2 <= least + CHI2_FOR_SHORTER * unit)
        .max_by(|a, b| {
            a.0.abs()
                .total_cmp(&b.0.abs())
                .then(b.1.chi2.total_cmp(&a.1.chi2))
        })?;
    let fraction = level.fraction;
    let fraction_sd = (level.unit_variance * unit).sqrt();
    let significant = fraction > MIN_FRACTION && fraction > MIN_SIGNIFICANCE * fraction_sd;
    significant.then_some(Haze {
        fraction: fraction.min(0.5),
        fraction_sd,
        length_px,
    })
}

/// A haze level for one length and side.
struct LevelFit {
    fraction: f64,
    unit_variance: f64,
    chi2: f64,
}

/// Weighted fit of constant, slope and haze.
fn fit_level(samples: &[(f64, f64, f64)], length_px: f64) -> Option<LevelFit> {
    let design = |d: f64| Vector3::new(1.0, d / REACH_PX as f64, haze_over_pixel(d, length_px));
    let mut n = Matrix3::<f64>::zeros();
    let mut r = Vector3::<f64>::zeros();
    for &(d, value, weight) in samples {
        let x = design(d);
        n.ger(weight, &x, &x, 1.0);
        r.axpy(weight * value, &x, 1.0);
    }
    let covariance = n.try_inverse()?;
    let s = covariance * r;
    let chi2 = samples
        .iter()
        .map(|&(d, value, weight)| weight * (value - design(d).dot(&s)).powi(2))
        .sum();
    Some(LevelFit {
        fraction: s[2],
        unit_variance: covariance[(2, 2)],
        chi2,
    })
}

impl Haze {
    /// This haze under the taps of a kernel.
    pub fn shape(&self, kernel: &Kernel) -> HazeShape {
        let stride = kernel.stride;
        let mut shape = vec![0.0f32; PHASES * stride];
        let mut solved = Vec::with_capacity(PHASES);
        for (p, phase) in kernel.phases.iter().enumerate() {
            let line = &mut shape[p * stride..(p + 1) * stride];
            for (k, h) in line.iter_mut().enumerate().take(kernel.taps()) {
                *h = haze_over_pixel(
                    k as f64 - kernel.half as f64 - phase_offset(p),
                    self.length_px,
                ) as f32;
            }
            // The same integer weights as the fit's, on the haze in 1/1024 grey levels.
            let fine: Vec<i16> = line.iter().map(|h| (h * 1024.0).round() as i16).collect();
            solved.push([0, 1, 2, 3].map(|i| phase.solve_line(i, &fine) / 1024.0));
        }
        HazeShape {
            length_px: self.length_px,
            shape,
            solved,
        }
    }
}
