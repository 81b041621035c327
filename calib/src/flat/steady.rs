//! Whether the frames of one exposure show the same: their brightness, and each place of the picture.

use super::exposure::{Exposure, Noise};
use super::{FlatError, Options};
use hydroline_numerics::statistics::median;

/// Brightness of the frames that goes one way by more than this is an exposure that is being set.
const DRIFT_MOST: f64 = 0.03;
/// Correlation of brightness and time that is going one way.
const ONE_WAY: f64 = 0.9;
/// Blocks whose variance over the frames is so many times what is usual of their noise moved; chance alone makes it three times as much in one of 10⁴ of three frames.
const MOVED_TIMES: f64 = 25.0;
/// Brightness of the frames scatters if it does by so many times the variance that noise gives it.
const SHOWN_TIMES: f64 = 10.0;
/// Levels above the darkest from which on a block shows brightness, and how many are to.
const LIT_LEVELS: f64 = 8.0;
const LIT_BLOCKS: usize = 20;
/// Frames that differ in brightness by this are worth a word.
const FLICKER_SAID: f64 = 0.005;

/// Unsteadiness of an exposure's frames.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum Unsteady {
    #[error(
        "its frames change by {:+.1} % in brightness from first to last: auto exposure or auto gain is on, or a lamp warms up. Set the camera's controls to manual, wait, and record again",
        100.0 * .0
    )]
    Drifts(f64),
    #[error(
        "its frames differ by {:.0} % in brightness: the light flickers. Use daylight or a lamp on direct current, or exposure times that are multiples of half the mains' period (10 ms at 50 Hz)",
        100.0 * .0
    )]
    Flickers(f64),
    #[error(
        "{:.0} % of the picture moves while it is recorded. Fix the camera, keep people and water still, and record again",
        100.0 * .0
    )]
    Moves(f64),
}

/// Of one exposure.
#[derive(Debug, Clone)]
pub(super) struct Steadiness {
    /// Blocks that stay as they are.
    pub blocks: Vec<bool>,
    /// How many times what its pixels' noise gives it the variance of a block usually is, in bins of [`LEVELS`].
    usual: [f64; BINS],
    /// Scatter of the frames' mean brightness, of that mean.
    pub of_mean: f64,
}

/// Of all exposures.
pub(super) fn all(
    exposures: &[&Exposure],
    noise: &Noise,
    options: &Options,
    remarks: &mut Vec<String>,
) -> Result<Vec<Steadiness>, FlatError> {
    let of = |exposure: &Exposure| {
        of_one(exposure, noise, options, remarks).map_err(|what| FlatError::Unsteady {
            name: exposure.name.clone(),
            what,
        })
    };
    exposures.iter().copied().map(of).collect()
}

fn of_one(
    exposure: &Exposure,
    noise: &Noise,
    options: &Options,
    remarks: &mut Vec<String>,
) -> Result<Steadiness, Unsteady> {
    let frames = exposure.by_frame.len();
    let blocks = exposure.by_frame.first().map_or(0, Vec::len);
    let means: Vec<f64> = (0..blocks)
        .map(|k| {
            let sum: f64 = exposure.by_frame.iter().map(|f| f64::from(f[k])).sum();
            sum / frames as f64
        })
        .collect();
    // Blocks as dark as the darkest have no brightness to compare.
    let lowest = exposure.histogram.iter().position(|n| *n > 0).unwrap_or(0) as f64;
    let lit: Vec<f64> = means
        .iter()
        .map(|m| if *m > lowest + LIT_LEVELS { *m } else { 0.0 })
        .collect();
    let enough = lit.iter().filter(|m| **m > 0.0).count() >= LIT_BLOCKS;
    let square: f64 = lit.iter().map(|m| m * m).sum();
    let brightness: Vec<f64> = exposure
        .by_frame
        .iter()
        .map(|frame| {
            let with: f64 = frame.iter().zip(&lit).map(|(f, m)| f64::from(*f) * m).sum();
            if enough { with / square } else { 1.0 }
        })
        .collect();
    let n = frames as f64;
    let scatter: Vec<f64> = (0..blocks)
        .map(|k| {
            let off = |(frame, b): (&Vec<f32>, &f64)| (f64::from(frame[k]) - b * means[k]).powi(2);
            let squares = exposure.by_frame.iter().zip(&brightness).map(off);
            squares.sum::<f64>() / (n - 1.0).max(1.0)
        })
        .collect();
    let of_noise: f64 = lit
        .iter()
        .zip(&scatter)
        .map(|(m, s)| m * m * s)
        .sum::<f64>();
    let of_noise = of_noise / (square * square).max(f64::MIN_POSITIVE);
    let variance = brightness.iter().map(|b| (b - 1.0).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    let flicker = (variance - of_noise).max(0.0).sqrt();
    let (drift, correlation) = line(&brightness);
    let shown = variance > SHOWN_TIMES * of_noise;
    if shown && drift.abs() > DRIFT_MOST && correlation.abs() > ONE_WAY {
        return Err(Unsteady::Drifts(drift));
    }
    if shown && flicker > options.flicker_most {
        return Err(Unsteady::Flickers(flicker));
    }
    if shown && flicker > FLICKER_SAID {
        remarks.push(format!(
            "{}: its frames differ by {:.1} % in brightness; their mean is used",
            exposure.name,
            100.0 * flicker
        ));
    }
    // Each block about its mean, the frame's brightness taken off, beside others of its level.
    let expected = exposure.noise_of_blocks(noise);
    let times: Vec<f64> = scatter.iter().zip(&expected).map(|(s, e)| s / e).collect();
    let usual = by_level(&means, &times);
    let still: Vec<bool> = means
        .iter()
        .zip(&times)
        .map(|(mean, times)| *times <= MOVED_TIMES * usual[bin(*mean)].max(1.0))
        .collect();
    let moves = still.iter().filter(|s| !**s).count() as f64 / blocks.max(1) as f64;
    if moves > options.moved_most_share {
        return Err(Unsteady::Moves(moves));
    }
    Ok(Steadiness {
        blocks: still,
        usual,
        of_mean: flicker / n.sqrt(),
    })
}

/// Gain of a series from first to last along a straight line, and its correlation with time.
fn line(series: &[f64]) -> (f64, f64) {
    let n = series.len() as f64;
    let mean = series.iter().sum::<f64>() / n;
    let middle = 0.5 * (n - 1.0);
    let (mut tt, mut tv, mut vv) = (0.0, 0.0, 0.0);
    for (k, value) in series.iter().enumerate() {
        let (t, v) = (k as f64 - middle, value - mean);
        (tt, tv, vv) = (tt + t * t, tv + t * v, vv + v * v);
    }
    if tt * vv <= 0.0 {
        return (0.0, 0.0);
    }
    ((n - 1.0) * tv / tt, tv / (tt * vv).sqrt())
}

/// Levels that share a usual variance.
const LEVELS: f64 = 32.0;
const BINS: usize = 8;

fn bin(mean: f64) -> usize {
    (mean / LEVELS).clamp(0.0, BINS as f64 - 1.0) as usize
}

impl Steadiness {
    /// How many times that of its pixels the variance of a block is, at least once.
    pub fn usual_at(&self, mean: f64) -> f64 {
        self.usual[bin(mean)].max(1.0)
    }
}

/// Median over the blocks of about a level.
fn by_level(means: &[f64], of_blocks: &[f64]) -> [f64; BINS] {
    std::array::from_fn(|k| {
        let of = means.iter().zip(of_blocks);
        let mut of: Vec<f64> = of
            .filter(|(mean, _)| bin(**mean) == k)
            .map(|(_, s)| *s)
            .collect();
        median(&mut of).unwrap_or(0.0)
    })
}
