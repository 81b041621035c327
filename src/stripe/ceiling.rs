//! The level at which this camera clips, where that lies below the maximum of eight bits: limited
//! range (235, 240), a gain, a look-up table.
//!
//! Light that varies with noise thins out towards its brightest values. Clipped light does not:
//! it piles up at one level with nothing above. The brightest pixel of each column on a candidate
//! distinguishes the two; where noise is too small for that, the flanks do, which imply how
//! bright the clipped peak would have been (`trace`).

use hydroline_core::frame::GreyView;

/// Every so many candidates are looked at.
const STEP: usize = 2;
/// Rows looked at on either side of a candidate.
const REACH_ROWS: usize = 3;
/// Fewest columns that make a pile.
const MIN_PILE: u32 = 6;
/// Columns that should be brighter than the pile, were it none, and are not: chance leaves so many
/// out once in 20 000 frames (e^-10).
const MIN_MISSING: f64 = 10.0;
/// Noise below which rounding hides how the light thins out \[grey levels\].
const MIN_NOISE_SD: f64 = 0.7;
/// A pile so much higher than the level below it is one, whatever the noise is up there (a tone
/// curve makes it another than in the dark).
const PLAIN_RATIO: f64 = 2.0;

/// A level at which columns pile up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Pile {
    /// The level \[grey levels\].
    pub level: u8,
    /// Whether noise cannot explain it; else the flanks are to be examined.
    pub certain: bool,
}

/// The pile at the maximum of the brightest pixels of these candidates `(column, row)`, if there is one.
pub(super) fn pile(
    image: GreyView<'_>,
    candidates: impl Iterator<Item = (usize, f32)>,
    noise_sd: f64,
) -> Option<Pile> {
    let mut histogram = [0u32; 256];
    for (column, row_px) in candidates.step_by(STEP) {
        histogram[usize::from(brightest(image, column, row_px))] += 1;
    }
    ceiling_pile(&histogram, noise_sd)
}

/// Brightest pixel of a candidate \[grey levels\].
pub(super) fn brightest(image: GreyView<'_>, column: usize, row_px: f32) -> u8 {
    let middle = (row_px + 0.5).max(0.0) as usize;
    let mut place = middle.saturating_sub(REACH_ROWS) * image.width_px + column;
    let mut brightest_level = 0;
    for _ in 0..2 * REACH_ROWS + 1 {
        brightest_level = brightest_level.max(image.pixels.get(place).copied().unwrap_or(0));
        place += image.width_px;
    }
    brightest_level
}

fn ceiling_pile(histogram: &[u32; 256], noise_sd: f64) -> Option<Pile> {
    let brightest_level = histogram.iter().rposition(|n| *n > 0)?;
    let count = |i: Option<usize>| i.and_then(|i| histogram.get(i)).copied().unwrap_or(0);
    let (here, below) = (
        histogram[brightest_level],
        count(brightest_level.checked_sub(1)),
    );
    if here < MIN_PILE {
        return None;
    }
    let level = u8::try_from(brightest_level).unwrap_or(u8::MAX);
    let ratio = f64::from(here) / f64::from(below).max(0.5);
    if noise_sd < MIN_NOISE_SD {
        return Some(Pile {
            level,
            certain: false,
        });
    }
    // Of two neighbouring levels of a Gaussian of sd n the ratio falls by exp(-1 / n²) per level.
    let missing = f64::from(here) * ratio * (-1.0 / (noise_sd * noise_sd)).exp();
    (missing > MIN_MISSING).then_some(Pile {
        level,
        certain: ratio >= PLAIN_RATIO,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Brightest pixels of 360 columns as a bell of this middle and noise makes them, cut at `brightest_level`.
    fn bell(middle: f64, noise_sd: f64, brightest_level: usize) -> [u32; 256] {
        let mut histogram = [0; 256];
        for i in 0..360 {
            // Quantiles of a logistic, near enough to a Gaussian's.
            let p = (f64::from(i) + 0.5) / 360.0;
            let level = middle + 0.55 * noise_sd * (p / (1.0 - p)).ln();
            histogram[(level.round() as usize).min(brightest_level)] += 1;
        }
        histogram
    }

    #[test]
    fn a_bell_is_no_pile_and_a_cut_bell_is() {
        for noise_sd in [1.0, 2.0, 4.0] {
            assert_eq!(ceiling_pile(&bell(180.0, noise_sd, 255), noise_sd), None);
            for brightest_level in [200, 235, 240] {
                let cut = bell(brightest_level as f64 + 3.0, noise_sd, brightest_level);
                let level = brightest_level as u8;
                let found = ceiling_pile(&cut, noise_sd);
                assert_eq!(
                    found,
                    Some(Pile {
                        level,
                        certain: true
                    })
                );
            }
        }
    }

    #[test]
    fn without_noise_a_pile_is_a_question() {
        let found = ceiling_pile(&bell(180.0, 0.1, 255), 0.3);
        assert!(matches!(found, Some(Pile { certain: false, .. })));
    }
}
