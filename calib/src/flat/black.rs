//! The black level from frames with the lens covered.
//!
//! Noise is there before the curve: where the curve is nonlinear and cuts off what is darker than none, half of the pixels lie
//! at b itself and the rest above, so that their lowest level determines b and their mean does not. Where light is left as it
//! is, the mean is b.

use super::exposure::{Exposure, Field};
use super::power::Power;
use nalgebra::Vector2;

/// Share of the pixels at the lowest level that is a pile: half is expected, a bell has a thousandth there.
const PILE_SHARE: f64 = 0.25;
/// The mean of dark pixels is b to this \[grey levels\]: dark current and the offsets of pixels differ by as much.
const MEAN_SD: f64 = 0.1;
/// A pile at a level is b to this \[grey levels\]: rounding.
const PILE_SD: f64 = 0.3;
/// Further apart in sds the dark has another curve than the rest.
const AGREES_SDS: f64 = 4.0;
/// Within so many sds of one γ leaves light as it is.
const STRAIGHT_SDS: f64 = 3.0;

/// Takes dark frames into account where they agree; says what they did.
pub(super) fn with_dark(curve: &mut Power, dark: &Exposure, field: &Field) -> String {
    let pixels: u64 = dark.histogram.iter().sum();
    let lowest = dark.histogram.iter().position(|n| *n > 0).unwrap_or(0);
    let share = dark.histogram[lowest] as f64 / pixels.max(1) as f64;
    let sum: f64 = (0..256).map(|k| k as f64 * dark.histogram[k] as f64).sum();
    let mean = sum / pixels.max(1) as f64;
    if lowest == 0 && share > 0.001 {
        return format!(
            "dark frames: {:.0} % of their pixels are at 0, so the black level is not above it; it comes from the exposures",
            100.0 * share
        );
    }
    let gamma_sd = curve.covariance[(0, 0)].sqrt();
    let straight = (curve.gamma() - 1.0).abs() < STRAIGHT_SDS * gamma_sd;
    let (level, sd) = match (share > PILE_SHARE, straight) {
        (true, _) => (lowest as f64, PILE_SD),
        (false, true) => (mean, MEAN_SD),
        (false, false) => {
            return format!(
                "dark frames: mean {mean:.1}, no pile at one level; under a curve noise lifts them, so the black level comes from the exposures"
            );
        }
    };
    let variance = curve.covariance[(1, 1)] + sd * sd;
    let off = level - curve.mean[1];
    if off.abs() > AGREES_SDS * variance.sqrt() {
        return format!(
            "dark frames lie at {level:.1} grey levels, the curve ends at {:.1} (sd {:.1}): it has a toe (as sRGB), or light came in; the curve's is stated, for it is what the levels from {:.0} up go by",
            curve.mean[1],
            curve.covariance[(1, 1)].sqrt(),
            field.floor.max(level)
        );
    }
    let column = Vector2::new(curve.covariance[(0, 1)], curve.covariance[(1, 1)]);
    curve.mean += column * (off / variance);
    curve.covariance -= column * column.transpose() / variance;
    format!("dark frames lie at {level:.1} grey levels, as the curve says: they are counted in")
}
