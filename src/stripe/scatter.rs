//! The scatter of the rows along the stripe, where the frame's noise is not white.
//!
//! A row's sd comes from what its column's fit leaves, as if every pixel's noise were its own. JPEG,
//! denoising and demosaicking make neighbours alike: less is left than there is, and the fit moves
//! with the rest. Then the scatter is estimated from the rows themselves: by their fourth differences over
//! a stride of eight columns (the side of a JPEG block, inside which errors are common), to which a
//! smooth course adds nothing to speak of: 0.02 px for 5 px of undulation on 200 columns, next to
//! 8.4 sd of a row.

use super::{StripePoint, quality};
use hydroline_core::frame::GreyView;

/// Variance that fits leave over that of the frame's noise up to which noise is as large on the
/// stripe as beside it.
const EVEN: f64 = 1.5;
/// The same from which a frame without noise beside the stripe has lost it there: JPEG rounds what
/// is small away.
const SILENCED: f64 = 10.0;
/// Noise that is no more than rounding \[grey levels\].
const SILENT_SD: f64 = 0.35;
/// Scatter over sd from which it is taken: below, chance (0.05) may have made it.
const WORTH_IT: f64 = 1.08;
/// Least scale where noise is not the pixels' own. What a flat stripe's errors have in common over a
/// hundred columns looks like its course and does not show in the scatter: of JPEG of quality
/// 60 to 95 the rms of error over sd is 1.1 to 1.6 where the scatter shows less than this.
const COMMON: f64 = 1.3;
/// Stride of the differences \[columns\].
const STRIDE: usize = 8;
/// The fourth difference.
const WEIGHTS: [f64; 5] = [1.0, -4.0, 6.0, -4.0, 1.0];
/// A longer stride, and the eighth difference for it.
const LONG_STRIDE: usize = 24;
const LONG_WEIGHTS: [f64; 9] = [1.0, -8.0, 28.0, -56.0, 70.0, -56.0, 28.0, -8.0, 1.0];
/// Rows from one column to the next that no stripe rises.
const STEEP_ROWS: f64 = 3.0;
/// Fewest differences for an estimate: 1 in 8 is independent, which gives the scale to a fifth.
const MIN_DIFFERENCES: usize = 80;
/// Differences beyond so many times the middle one are particles and ends of things.
const OUTLYING: f64 = 5.0;
/// Rows looked at for the noise's colour.
const ROWS: usize = 12;
/// Ratio of the noise's variance a stride apart to that of neighbours, beyond which it is not white:
/// chance makes 1.2 at three sds.
const WHITE: f64 = 1.3;

/// Factor by which the sds of a frame's rows grow, given the variance that its fits leave;
/// `None` = they stay as they are.
pub(super) fn sd_scale(
    image: GreyView<'_>,
    points: &[StripePoint],
    noise_sd: f64,
    variance: f64,
) -> Option<f64> {
    let noise = noise_sd * noise_sd;
    let even = variance < EVEN * noise;
    let processed = if noise_sd < SILENT_SD {
        variance > SILENCED * noise
    } else {
        !is_white(image)
    };
    if processed {
        return Some(over_sd(points).unwrap_or(COMMON).max(COMMON));
    }
    // Noise as large beside the stripe as on it needs no second witness.
    if even {
        return None;
    }
    over_sd(points).filter(|scale| *scale > WORTH_IT)
}

/// Whether neighbouring pixels have noise of their own.
fn is_white(image: GreyView<'_>) -> bool {
    let step = (image.height_px / ROWS).max(1);
    let lines = image.pixels.chunks_exact(image.width_px.max(1));
    let (mut near, mut far) = ([0u32; 256], [0u32; 256]);
    // The middle of each strip: `noise` starts from the first row.
    for line in lines.skip(step / 2).step_by(step) {
        // Second differences: insensitive to light that grows evenly along the row.
        let strips = line.as_chunks::<STRIDE>().0;
        for ((a, b), c) in strips
            .iter()
            .zip(strips.iter().skip(1))
            .zip(strips.iter().skip(2))
        {
            for k in [0, STRIDE / 2] {
                near[second_difference(b[k], b[k + 1], b[k + 2])] += 1;
                far[second_difference(a[k], b[k], c[k])] += 1;
            }
        }
    }
    let ratio = (super::noise::truncated_sd(&far) / super::noise::truncated_sd(&near)).powi(2);
    (1.0 / WHITE..WHITE).contains(&ratio)
}

fn second_difference(a: u8, b: u8, c: u8) -> usize {
    let second_difference = i32::from(a) - 2 * i32::from(b) + i32::from(c);
    (second_difference.unsigned_abs() as usize).min(255)
}

/// Scatter of the rows over their sds; `None` where too few columns stand in a row. The largest
/// that any stride shows: what is common to a stride does not show in it.
fn over_sd(points: &[StripePoint]) -> Option<f64> {
    let short = over_sd_at(points, STRIDE, &WEIGHTS);
    let long = over_sd_at(points, LONG_STRIDE, &LONG_WEIGHTS);
    short.into_iter().chain(long).reduce(f64::max)
}

/// Whether a smooth course goes on from a point to the next: not at steps, and not where a path leads from one thing to
/// another.
fn goes_on(a: &StripePoint, b: &StripePoint) -> bool {
    let sound = |p: &StripePoint| p.quality & quality::NEAR_STEP == 0;
    sound(a)
        && sound(b)
        && b.column_px - a.column_px == 1.0
        && (b.row_px - a.row_px).abs() < STEEP_ROWS
}

fn over_sd_at<const N: usize>(
    points: &[StripePoint],
    stride: usize,
    weights: &[f64; N],
) -> Option<f64> {
    let span = (N - 1) * stride;
    // Points after which the course breaks off, up to each.
    if points.len() <= span {
        return None;
    }
    let mut broken = 0u32;
    let mut breaks = vec![0u32; points.len()];
    for ((a, b), sum) in points.iter().zip(&points[1..]).zip(&mut breaks[1..]) {
        broken += u32::from(!goes_on(a, b));
        *sum = broken;
    }
    let mut squares: Vec<f64> = points
        .windows(span + 1)
        .zip(breaks.windows(span + 1))
        .filter(|(_, breaks)| breaks[0] == breaks[span])
        .map(|(run, _)| {
            let (mut sum, mut variance) = (0.0, 0.0);
            for (p, w) in run.iter().step_by(stride).zip(weights) {
                sum += w * p.row_px;
                variance += w * w * p.sd_px * p.sd_px;
            }
            sum * sum / variance
        })
        .collect();
    if squares.len() < MIN_DIFFERENCES {
        return None;
    }
    let middle = squares.len() / 2;
    let median = *squares.select_nth_unstable_by(middle, f64::total_cmp).1;
    // Of squares of a Gaussian the median is 0.455 of the mean.
    let limit = OUTLYING * OUTLYING * median / 0.455;
    squares.retain(|s| *s <= limit);
    Some((squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{StripeImage, render};

    #[test]
    fn white_noise_is_white_and_smoothed_noise_is_not() {
        for noise_sd in [1.0, 2.0, 4.0] {
            let mut image = render(&StripeImage {
                noise_sd,
                slope: 0.2,
                row0_px: 150.0,
                ..Default::default()
            });
            assert!(is_white((&image).into()), "{noise_sd}");
            let sharp = image.pixels.clone();
            for (i, pixel) in image.pixels.iter_mut().enumerate().skip(1) {
                *pixel = (u16::from(sharp[i]) + u16::from(sharp[i - 1])).div_ceil(2) as u8;
            }
            assert!(!is_white((&image).into()), "{noise_sd}");
        }
    }

    #[test]
    fn the_scale_is_the_scatter_over_the_sd() {
        let mut state = 1u64;
        let mut uniform = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (state >> 40) as f64 / (1u64 << 24) as f64 - 0.5
        };
        let points: Vec<StripePoint> = (0..720)
            .map(|c| StripePoint {
                column_px: f64::from(c),
                // Sd 0.02 on an undulating course.
                row_px: 200.0 + 4.0 * (f64::from(c) / 40.0).sin() + 0.02 * 12f64.sqrt() * uniform(),
                peak: 100.0,
                sd_px: 0.01,
                sigma_px: 2.0,
                quality: 0,
            })
            .collect();
        let scale = over_sd(&points).unwrap();
        assert!((scale - 2.0).abs() < 0.2, "{scale}");
        assert_eq!(over_sd(&points[..60]), None);
    }
}
