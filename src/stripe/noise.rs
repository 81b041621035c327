//! Noise of a frame, from the frame itself.

use hydroline_core::frame::GreyView;

/// Smallest noise: what rounding to whole grey levels adds, sqrt(1/12).
pub(super) const ROUNDING_SD: f64 = 0.288_675_134_594_812_9;

/// Rows sampled: 24 x 180 differences of a 720 px frame give the noise to 1.1 %.
const SAMPLED_ROWS: usize = 24;
const COLUMN_STEP: usize = 4;

/// Standard deviation of the pixel noise, rounding included \[grey levels\].
///
/// Differences of neighbours along rows (insensitive to a stripe that runs along them and to slow
/// light), truncated at three of their own sd (insensitive to edges and particles) and corrected for
/// the truncation. A fixed grid of pixels: a function of the image alone.
pub(super) fn noise_sd(image: GreyView<'_>) -> f64 {
    let (w, h) = (image.width_px, image.height_px);
    // Two histograms in turn: the same difference twice running does not wait for itself.
    let mut histograms = [[0u32; 256]; 2];
    let row_step = (h / SAMPLED_ROWS).max(1);
    let lines = image.pixels.chunks_exact(w.max(1)).take(h);
    for line in lines.step_by(row_step) {
        let (pairs, rest) = line.as_chunks::<{ 2 * COLUMN_STEP }>();
        for pair in pairs {
            for (histogram, [a, b, ..]) in
                histograms.iter_mut().zip(pair.as_chunks::<COLUMN_STEP>().0)
            {
                histogram[usize::from(a.abs_diff(*b))] += 1;
            }
        }
        if let [a, b, _, _, ..] = rest {
            histograms[0][usize::from(a.abs_diff(*b))] += 1;
        }
    }
    let [first, second] = &histograms;
    let histogram = std::array::from_fn(|i| first[i] + second[i]);
    truncated_sd(&histogram) / std::f64::consts::SQRT_2
}

/// Sd of a zero-mean Gaussian from the histogram of its absolute values, robust against tails.
pub(super) fn truncated_sd(histogram: &[u32; 256]) -> f64 {
    let floor = ROUNDING_SD * std::f64::consts::SQRT_2;
    let total: u32 = histogram.iter().sum();
    let mut seen = 0;
    let median = histogram
        .iter()
        .position(|n| {
            seen += n;
            2 * seen >= total
        })
        .unwrap_or(0);
    // 0.6745 = median of |N(0,1)|.
    let mut sd = ((median as f64 + 0.5) / 0.6745).max(floor);
    for _ in 0..6 {
        let cut = (3.0 * sd).ceil().min(255.0);
        let (mut count, mut square) = (0.0, 0.0);
        for (d, n) in histogram.iter().enumerate().take(cut as usize + 1) {
            count += f64::from(*n);
            square += f64::from(*n) * (d * d) as f64;
        }
        if count == 0.0 {
            break;
        }
        let z = (cut + 0.5) / sd;
        let density = (-0.5 * z * z).exp() / (2.0 * std::f64::consts::PI).sqrt();
        // Mass inside +-z by the asymptotic tail (z >= 3), then the variance kept there.
        let mass = 1.0 - 2.0 * density / z * (1.0 - 1.0 / (z * z));
        let kept = 1.0 - 2.0 * z * density / mass;
        sd = (square / count / kept).sqrt().max(floor);
    }
    sd
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{StripeImage, render};
    use hydroline_core::frame::GreyImage;

    #[test]
    fn noise_is_found_to_three_percent_with_a_stripe_and_without() {
        for (seed, sd) in [(1, 1.0), (2, 2.0), (3, 4.0), (4, 8.0)] {
            for peak in [0.0, 200.0] {
                let stripe = StripeImage {
                    noise_sd: sd,
                    peak,
                    background: 60.0,
                    seed,
                    slope: 0.3,
                    ..Default::default()
                };
                let found = noise_sd((&render(&stripe)).into());
                let truth = (sd * sd + 1.0 / 12.0).sqrt();
                assert!((found / truth - 1.0).abs() < 0.03, "{sd}: {found}");
            }
        }
    }

    #[test]
    fn a_flat_image_has_rounding_noise_only() {
        let flat = GreyImage {
            width_px: 40,
            height_px: 30,
            pixels: vec![7; 1200],
        };
        assert!((noise_sd((&flat).into()) - ROUNDING_SD).abs() < 1e-12);
    }
}
