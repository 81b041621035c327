//! Frames of one exposure time, taken together: pixel by pixel, then block by block.

use super::steady::Steadiness;
use super::{FlatError, Options};

/// About so many blocks the picture is cut into; each is at least so many pixels wide.
const BLOCKS_ABOUT: usize = 8000;
const BLOCK_LEAST_PX: usize = 8;
/// Levels of grey that share one figure of noise.
const NOISE_BIN: usize = 4;
const NOISE_BINS: usize = 256 / NOISE_BIN;
/// Fewest pixels of a bin for an estimate of its noise.
const NOISE_LEAST: f64 = 200.0;
/// Least pixels at one level that are a pile, and how many times more it has than the two levels beside it together.
const PILE_LEAST: u64 = 200;
const PILE_TIMES: u64 = 2;
/// Variance of rounding to whole levels.
const ROUNDING: f64 = 1.0 / 12.0;

/// Frames of a scene at one exposure time.
#[derive(Debug, Clone)]
pub struct Exposure {
    /// Name in messages.
    pub name: String,
    /// Exposure time \[s\].
    pub time_s: f64,
    pub(super) width_px: usize,
    pub(super) height_px: usize,
    pub(super) frames: usize,
    sum: Vec<u32>,
    squares: Vec<u32>,
    pub(super) histogram: Vec<u64>,
    /// Of each frame: mean levels of the blocks.
    pub(super) by_frame: Vec<Vec<f32>>,
}

/// Side of a block in a picture of this size.
pub(super) fn block_px(width_px: usize, height_px: usize) -> usize {
    let side = ((width_px * height_px) as f64 / BLOCKS_ABOUT as f64).sqrt();
    (side.ceil() as usize).max(BLOCK_LEAST_PX)
}

/// Calls with each whole block and its pixels' places.
fn each_block(
    width_px: usize,
    height_px: usize,
    mut of: impl FnMut(&mut dyn Iterator<Item = usize>),
) {
    let side = block_px(width_px, height_px);
    for top in (0..height_px / side).map(|k| k * side) {
        for left in (0..width_px / side).map(|k| k * side) {
            let mut places = (top..top + side)
                .flat_map(|row| (left..left + side).map(move |column| row * width_px + column));
            of(&mut places);
        }
    }
}

impl Exposure {
    /// Most frames of one exposure that are taken: sums of squares keep within 32 bits, and noise averages no further.
    pub const FRAMES_MOST: usize = 1000;

    /// Of a time, without frames yet.
    pub fn new(name: String, time_s: f64) -> Self {
        Exposure {
            name,
            time_s,
            width_px: 0,
            height_px: 0,
            frames: 0,
            sum: Vec::new(),
            squares: Vec::new(),
            histogram: vec![0; 256],
            by_frame: Vec::new(),
        }
    }

    /// Frames so far.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// Adds a frame's grey levels, row by row. Beyond [`Self::FRAMES_MOST`] they are passed over.
    ///
    /// # Errors
    /// [`FlatError::Size`] where it has another size than those before it.
    pub fn add(
        &mut self,
        pixels: &[u8],
        width_px: usize,
        height_px: usize,
    ) -> Result<(), FlatError> {
        if self.frames == 0 {
            (self.width_px, self.height_px) = (width_px, height_px);
            self.sum = vec![0; pixels.len()];
            self.squares = vec![0; pixels.len()];
        }
        if (self.width_px, self.height_px) != (width_px, height_px)
            || pixels.len() != self.sum.len()
        {
            return Err(FlatError::Size {
                name: self.name.clone(),
                got: (width_px, height_px),
                wanted: (self.width_px, self.height_px),
            });
        }
        if self.frames == Self::FRAMES_MOST {
            return Ok(());
        }
        self.frames += 1;
        for ((sum, squares), grey) in self.sum.iter_mut().zip(&mut self.squares).zip(pixels) {
            let level = u32::from(*grey);
            *sum += level;
            *squares += level * level;
            self.histogram[usize::from(*grey)] += 1;
        }
        let mut means = Vec::new();
        each_block(width_px, height_px, |places| {
            let (mut sum, mut n) = (0u32, 0u32);
            for place in places {
                sum += u32::from(pixels[place]);
                n += 1;
            }
            means.push(sum as f32 / n as f32);
        });
        self.by_frame.push(means);
        Ok(())
    }

    /// Mean and variance over the frames of a pixel.
    pub(super) fn pixel(&self, place: usize) -> [f64; 2] {
        let n = self.frames as f64;
        let mean = f64::from(self.sum[place]) / n;
        let variance = (f64::from(self.squares[place]) - n * mean * mean) / (n - 1.0).max(1.0);
        [mean, variance.max(0.0)]
    }

    /// Variance in one frame that each block has of its pixels' noise; rounding alone is some.
    pub(super) fn noise_of_blocks(&self, noise: &Noise) -> Vec<f64> {
        let mut all = Vec::new();
        each_block(self.width_px, self.height_px, |places| {
            let (mut n, mut sum) = (0.0, 0.0);
            for place in places {
                n += 1.0;
                sum += noise.at(self.pixel(place)[0]).max(ROUNDING);
            }
            all.push(sum / (n * n));
        });
        all
    }

    pub(super) fn pixels(&self) -> usize {
        self.sum.len()
    }
}

/// Checks the series before anything is computed: numbers of exposures and frames, and sizes of the images.
pub(super) fn check(
    exposures: &[&Exposure],
    dark: Option<&Exposure>,
    options: &Options,
) -> Result<(), FlatError> {
    let mut times: Vec<f64> = exposures.iter().map(|e| e.time_s).collect();
    times.sort_by(f64::total_cmp);
    times.dedup_by(|a, b| *a / *b < 1.001);
    if times.len() < options.exposures_least {
        return Err(FlatError::FewExposures {
            exposures: times.len(),
            least: options.exposures_least,
        });
    }
    let first = exposures[0];
    for exposure in exposures.iter().copied().chain(dark) {
        if exposure.frames < options.frames_least {
            return Err(FlatError::FewFrames {
                name: exposure.name.clone(),
                frames: exposure.frames,
                least: options.frames_least,
            });
        }
        let size = |e: &Exposure| (e.width_px, e.height_px);
        if size(exposure) != size(first) {
            return Err(FlatError::Size {
                name: exposure.name.clone(),
                got: size(exposure),
                wanted: size(first),
            });
        }
    }
    Ok(())
}

/// A block under one exposure.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cell {
    pub mean: f64,
    pub variance: f64,
    /// Mean variance of a pixel in one frame.
    pub noise: f64,
    /// Mean levels of its darkest and its brightest pixel.
    pub range: [f64; 2],
}

/// Blocks under all exposures.
#[derive(Debug, Clone)]
pub(super) struct Field {
    /// By exposure, then block; `None` where it was not steady.
    pub cells: Vec<Vec<Option<Cell>>>,
    pub noise: Noise,
    /// Scatter of the frames' brightness within each exposure, of its mean.
    pub flicker: Vec<f64>,
    /// Level at or below which light is cut off.
    pub floor: f64,
    /// Level at which light is clipped, where some is.
    pub ceiling: Option<u8>,
}

/// Variance of a pixel in one frame by its level.
#[derive(Debug, Clone)]
pub(super) struct Noise([f64; NOISE_BINS]);

impl Noise {
    pub fn of(exposures: &[&Exposure]) -> Noise {
        let mut bins = [[0.0; 2]; NOISE_BINS];
        for exposure in exposures {
            for place in 0..exposure.pixels() {
                let [mean, variance] = exposure.pixel(place);
                let bin = &mut bins[(mean as usize / NOISE_BIN).min(NOISE_BINS - 1)];
                *bin = [bin[0] + variance, bin[1] + 1.0];
            }
        }
        let known: Vec<(usize, f64)> = bins
            .iter()
            .enumerate()
            .filter(|(_, [_, n])| *n >= NOISE_LEAST)
            .map(|(k, [sum, n])| (k, sum / n))
            .collect();
        Noise(std::array::from_fn(|k| {
            let nearest = known.iter().min_by_key(|(at, _)| at.abs_diff(k));
            nearest.map_or(1.0, |(_, variance)| *variance)
        }))
    }

    pub fn at(&self, level: f64) -> f64 {
        self.0[(level.max(0.0) as usize / NOISE_BIN).min(NOISE_BINS - 1)]
    }
}

/// Variance of the mean of rounded levels about the true one, where noise and scene spread them by this variance before
/// rounding: the Fourier series of the sawtooth under a Gaussian.
fn rounding(variance: f64) -> f64 {
    let tau = std::f64::consts::TAU;
    (1..=8)
        .map(|k| f64::from(k) * tau)
        .map(|w| 2.0 / (w * w) * (-w * w * variance).exp())
        .sum()
}

impl Field {
    pub fn of(exposures: &[&Exposure], steadiness: &[Steadiness], noise: Noise) -> Field {
        let cells = exposures
            .iter()
            .zip(steadiness)
            .map(|(exposure, steady)| cells(exposure, steady, &noise))
            .collect();
        let mut histogram = vec![0u64; 256];
        for exposure in exposures {
            for (sum, n) in histogram.iter_mut().zip(&exposure.histogram) {
                *sum += n;
            }
        }
        let floor = pile(histogram.iter().copied());
        let ceiling = pile(histogram.iter().rev().copied()).map(|k| 255 - k as u8);
        Field {
            cells,
            noise,
            flicker: steadiness.iter().map(|s| s.of_mean).collect(),
            floor: floor.unwrap_or(0) as f64,
            ceiling,
        }
    }

    /// From here on nothing is used.
    pub fn clip_level(&self) -> f64 {
        f64::from(self.ceiling.unwrap_or(u8::MAX))
    }
}

/// The first level of a histogram, where levels pile up there.
fn pile(mut levels: impl Iterator<Item = u64>) -> Option<usize> {
    let mut at = 0;
    let first = loop {
        let n = levels.next()?;
        if n > 0 {
            break n;
        }
        at += 1;
    };
    let beside: u64 = levels.take(2).sum();
    (first >= PILE_LEAST && first > PILE_TIMES * beside).then_some(at)
}

fn cells(exposure: &Exposure, steady: &Steadiness, noise: &Noise) -> Vec<Option<Cell>> {
    let mut all = Vec::new();
    let frames = exposure.frames as f64;
    each_block(exposure.width_px, exposure.height_px, |places| {
        let (mut n, mut sum, mut squares, mut variance) = (0.0, 0.0, 0.0, 0.0);
        let mut range = [f64::INFINITY, f64::NEG_INFINITY];
        for place in places {
            let [mean, _] = exposure.pixel(place);
            n += 1.0;
            sum += mean;
            squares += mean * mean;
            variance += noise.at(mean);
            range = [range[0].min(mean), range[1].max(mean)];
        }
        let (mean, of_noise) = (sum / n, variance / n);
        let inner = (squares / n - mean * mean).max(0.0);
        let before = (of_noise - ROUNDING).max(0.0);
        let whole = steady.blocks.get(all.len()).copied().unwrap_or(false);
        all.push(whole.then_some(Cell {
            mean,
            // Light that flickers by rows moves a block as a whole.
            variance: of_noise / n * steady.usual_at(mean) / frames
                + rounding(before) / n
                + rounding(before + inner),
            noise: of_noise,
            range,
        }));
    });
    all
}
