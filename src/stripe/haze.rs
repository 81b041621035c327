//! One-sided haze: the sheet lights the water it crosses, and the camera sees that light on one
//! side of the stripe only (notes 2.4; physics: `backscatter_haze`).
//!
//! `light = fraction * peak * exp(-d / length)`, d = distance beyond the stripe on that side.
//! One column cannot tell it from the stripe's own shift; all columns together can, from the
//! pixels outside the stripe: their mean, aligned on the stripe, is fitted with a constant, a
//! slope (uneven light) and the haze, on either side and with several lengths.

use super::fit::{Fit, HazeShape};
use super::kernel::{Kernel, LANES, PHASES, parted, phase_offset};
use super::synthetic::haze_over_pixel;
use crate::frame::GreyImage;
use nalgebra::{Matrix3, Vector3};
use wide::f32x4;

/// Farthest pixel looked at \[px\].
const REACH_PX: usize = 56;
const SIZE: usize = 2 * REACH_PX + 1;
/// Columns looked at first, and all in all where the first show a sign of haze.
const FIRST_COLUMNS: usize = 80;
const MAX_COLUMNS: usize = 360;
/// Decay lengths tried \[px\].
const LENGTHS_PX: [f64; 5] = [20.0, 30.0, 50.0, 90.0, 300.0];
/// A shorter length must explain the data better by this much chi², else the longest that does:
/// the level at the stripe is extrapolated, the more the shorter the length.
const CHI2_FOR_SHORTER: f64 = 4.0;
/// What the first columns must show for a closer look.
const SIGN_SIGNIFICANCE: f64 = 1.5;
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

/// Shapes of the haze tried, by distance from the stripe.
#[derive(Debug, Clone)]
pub(super) struct HazeTable {
    shapes: Vec<(f64, Vec<f64>)>,
}

/// Mean light beside the stripe, aligned on it, in units of the peak.
struct Surroundings {
    /// Distance below the stripe \[px\], light over peak, columns it is the mean of.
    samples: Vec<(isize, f64, f64)>,
    mean_peak: f64,
}

impl HazeTable {
    /// Builds the table.
    pub fn new() -> Self {
        let shape = |length: f64| {
            let at = |i: usize| haze_over_pixel(i as f64 - REACH_PX as f64, length);
            (length, (0..SIZE).map(at).collect())
        };
        Self {
            shapes: LENGTHS_PX
                .iter()
                .flat_map(|l| [*l, -*l])
                .map(shape)
                .collect(),
        }
    }

    /// Estimates the haze from columns `(column, fit)` that are free of steps and rivals.
    pub fn estimate(
        &self,
        image: &GreyImage,
        columns: &[(usize, &Fit)],
        noise_sd: f64,
    ) -> Option<Haze> {
        let sign = self.fit(
            &surroundings(image, columns, FIRST_COLUMNS, noise_sd)?,
            noise_sd,
        )?;
        if sign.fraction < SIGN_SIGNIFICANCE * sign.fraction_sd {
            return None;
        }
        let haze = self.fit(
            &surroundings(image, columns, MAX_COLUMNS, noise_sd)?,
            noise_sd,
        )?;
        let significant =
            haze.fraction > MIN_FRACTION && haze.fraction > MIN_SIGNIFICANCE * haze.fraction_sd;
        significant.then_some(Haze {
            fraction: haze.fraction.min(0.5),
            ..haze
        })
    }

    /// Best side and length. Noise in units of one pixel's over the peak: the larger of what the
    /// camera gives and what the best fit leaves, so that uneven light does not pass for haze.
    fn fit(&self, light: &Surroundings, noise_sd: f64) -> Option<Haze> {
        let fits: Vec<(f64, LevelFit)> = self
            .shapes
            .iter()
            .filter_map(|(length, shape)| Some((*length, fit_level(&light.samples, shape)?)))
            // A lack of light on one side is an excess on the other.
            .filter(|f| f.1.fraction > 0.0)
            .collect();
        let best = fits.iter().min_by(|a, b| a.1.chi2.total_cmp(&b.1.chi2))?;
        let (side, least) = (best.0.signum(), best.1.chi2);
        let scatter = least / (light.samples.len() as f64 - 4.0).max(1.0);
        let unit = scatter.max((noise_sd / light.mean_peak).powi(2));
        let (length_px, level) = fits
            .into_iter()
            .filter(|f| f.0.signum() == side && f.1.chi2 <= least + CHI2_FOR_SHORTER * unit)
            .max_by(|a, b| {
                a.0.abs()
                    .total_cmp(&b.0.abs())
                    .then(b.1.chi2.total_cmp(&a.1.chi2))
            })?;
        Some(Haze {
            fraction: level.fraction,
            fraction_sd: (level.unit_variance * unit).sqrt(),
            length_px,
        })
    }
}

/// Gathers the light beside the stripe from at most `most` columns.
fn surroundings(
    image: &GreyImage,
    columns: &[(usize, &Fit)],
    most: usize,
    noise_sd: f64,
) -> Option<Surroundings> {
    let mut sums = [0i32; SIZE];
    let mut counts = [0i32; SIZE];
    let mut widths = Vec::with_capacity(most);
    let (mut peaks, mut used) = (0.0, 0.0);
    for (column, fit) in columns.iter().step_by(columns.len().div_ceil(most).max(1)) {
        let middle = (fit.row_px + 0.5) as usize;
        let first = middle.saturating_sub(REACH_PX);
        let last = (middle + REACH_PX).min(image.height_px - 1);
        // In sixteenths of a grey level.
        let background = (16.0 * fit.background) as i32;
        let clip = (16.0 * (4.0 * noise_sd + 0.25 * fit.peak.min(255.0))) as i32;
        let offset = first + REACH_PX - middle;
        let rows = last + 1 - first;
        // Pixels first, sums after: those then go eight at a time.
        let mut pixels = [0i32; SIZE];
        let mut place = first * image.width_px + column;
        for pixel in &mut pixels[..rows] {
            *pixel = image.pixels.get(place).map_or(0, |p| i32::from(*p));
            place += image.width_px;
        }
        let (sums, counts) = (&mut sums[offset..], &mut counts[offset..]);
        for ((pixel, sum), count) in pixels[..rows].iter().zip(sums).zip(counts) {
            // Particles, ghosts and other segments are brighter than haze can be.
            let above = 16 * pixel - background;
            let kept = i32::from(above.abs() <= clip);
            *sum += above & -kept;
            *count += kept;
        }
        widths.push(fit.sigma_px);
        peaks += fit.peak;
        used += 1.0;
    }
    if used < 8.0 {
        return None;
    }
    let middle = widths.len() / 2;
    let width = *widths.select_nth_unstable_by(middle, f64::total_cmp).1;
    // Beyond 4.5 sigma nothing of the stripe is left (4e-5 of its peak).
    let guard = (4.5 * width + 2.0) as isize;
    let mean_peak = peaks / used;
    let samples: Vec<(isize, f64, f64)> = (0..SIZE)
        .map(|i| {
            (
                i as isize - REACH_PX as isize,
                f64::from(sums[i]) / 16.0,
                f64::from(counts[i]),
            )
        })
        .filter(|(d, _, count)| d.abs() > guard && *count > 0.5 * used)
        .map(|(d, sum, count)| (d, sum / (count * mean_peak), count))
        .collect();
    let above = samples.iter().filter(|s| s.0 < 0).count();
    (above >= 6 && samples.len() - above >= 6).then_some(Surroundings { samples, mean_peak })
}

/// A haze level for one length and side.
struct LevelFit {
    fraction: f64,
    unit_variance: f64,
    chi2: f64,
}

/// Weighted fit of constant, slope and haze.
fn fit_level(samples: &[(isize, f64, f64)], shape: &[f64]) -> Option<LevelFit> {
    let design = |d: isize| {
        let shape = shape[(d + REACH_PX as isize) as usize];
        Vector3::new(1.0, d as f64 / REACH_PX as f64, shape)
    };
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
        let mut shape = Vec::with_capacity(PHASES * kernel.stride / LANES);
        let mut solved = Vec::with_capacity(PHASES);
        for (p, phase) in kernel.phases.iter().enumerate() {
            let mut line = vec![0.0f32; kernel.stride];
            for (k, h) in line.iter_mut().enumerate().take(kernel.taps()) {
                let distance_px = k as f64 - kernel.half as f64 - phase_offset(p);
                *h = haze_over_pixel(distance_px, self.length_px) as f32;
            }
            solved.push(f32x4::new([0, 1, 2, 3].map(|i| phase.solve_line(i, &line))));
            shape.extend(line.as_chunks().0.iter().map(parted));
        }
        HazeShape {
            length_px: self.length_px,
            shape,
            solved,
        }
    }
}
