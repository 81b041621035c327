//! Banding: lamps flicker while a rolling shutter reads the rows, so that whole rows are brighter
//! or darker, by the same in all columns.
//!
//! A row's level is read where the stripe is elsewhere: the median over blocks of columns, each
//! against its own mean, so that lamps and gradients across the frame do not matter. A flat stripe
//! covers its rows in all columns; there the waves found on either side are all one can know, and
//! what they leave unexplained beside it goes into the rows' sd. Haze is level with a flat stripe
//! too, but ends at it: its shape and a slope are fitted with every wave, so that the one is not
//! taken for the other. The levels are taken off the pixels; the fits then know nothing
//! of them.

use super::extractor::Track;
use super::haze::Haze;
use super::haze::haze_over_pixel;
use hydroline_core::frame::{GreyImage, GreyView};

/// Columns of a block.
const BLOCK_COLUMNS: usize = 16;
/// Rows read on either side of the stripe.
const REACH_ROWS: usize = 140;
/// Least share of the blocks that a row's level needs.
const MIN_SHARE: f64 = 0.25;
/// Fewest rows for an estimate of waves.
const MIN_ROWS: usize = 60;
/// Row levels farther than this from the middle one are lamps' bars, not flicker \[grey levels\].
const MAX_LEVEL: f64 = 15.0;
/// Shortest and longest wave sought \[px\].
const SHORTEST_PX: f64 = 6.0;
const LONGEST_PX: f64 = 260.0;
/// Most waves: mains flicker, two harmonics, and a change of its pace.
const MAX_WAVES: usize = 4;
/// Smallest wave that is taken out \[grey levels\], and the least ratio of what it explains to what
/// is left per degree of freedom: 130 places are searched, chance gives 12 once in a thousand.
const MIN_WAVE: f64 = 0.2;
const MIN_RATIO: f64 = 14.0;
/// Smallest wave beside haze, as a fraction of that: what a wrong decay length leaves is less.
const MIN_OF_HAZE: f64 = 0.1;
/// Longest waves, which are looked at in any case, and peaks of the search that are.
const LONG_WAVES: usize = 5;
const PEAKS: usize = 8;
/// Blocks looked at first.
const QUICK_BLOCKS: usize = 9;
/// Sd of a median over that of a mean.
const MEDIAN_SD: f64 = 1.2533;

/// Levels of the rows.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Banding {
    first_row: usize,
    levels: Vec<f64>,
    /// Standard deviation of a row's level near the stripe that is left beyond noise \[grey levels\].
    pub left_sd: f64,
}

/// Some columns with their stripe.
struct Block {
    start: usize,
    /// Rows between which the stripe lies \[px\].
    low: f64,
    high: f64,
    /// Haze at the stripe \[grey levels\].
    haze: f64,
}

impl Block {
    fn middle(&self) -> f64 {
        0.5 * (self.low + self.high)
    }
}

/// Haze per unit of level, by whole pixels below the stripe.
struct HazeByRow {
    reach: i64,
    light: Vec<f32>,
}

impl HazeByRow {
    fn new(length_px: f64, reach: usize) -> Self {
        let mut light = vec![0.0; 2 * reach + 1];
        let per_px = (-1.0 / length_px.abs().max(1e-9)).exp();
        let mut here = haze_over_pixel(-length_px.signum(), length_px);
        light[reach] = haze_over_pixel(0.0, length_px) as f32;
        for k in 1..=reach {
            let at = if length_px > 0.0 {
                reach - k
            } else {
                reach + k
            };
            light[at] = here as f32;
            here *= per_px;
        }
        let reach = reach as i64;
        Self { reach, light }
    }

    fn at(&self, distance_px: f64) -> f32 {
        let place = (distance_px + 0.5).floor() as i64 + self.reach;
        let place = usize::try_from(place).unwrap_or(usize::MAX);
        self.light.get(place).copied().unwrap_or(0.0)
    }
}

/// A row's level, measured.
struct Sample {
    row: f64,
    level: f64,
    /// Haze in this row, by its level at the stripe.
    haze: f64,
}

/// Finds the banding around a stripe of this width; `None` where none is established.
pub(super) fn find(
    image: GreyView<'_>,
    tracks: &[Track],
    sigma_px: f64,
    haze: Option<Haze>,
    noise_sd: f64,
) -> Option<Banding> {
    let (low, high) = tracks
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), t| {
            (low.min(t.fit.row_px), high.max(t.fit.row_px))
        });
    if low > high {
        return None;
    }
    let first_row = (low.max(0.0) as usize).saturating_sub(REACH_ROWS);
    let last_row = (high.max(0.0) as usize + REACH_ROWS).min(image.height_px.checked_sub(1)?);
    let rows = first_row..last_row + 1;
    let peak = tracks.iter().map(|t| t.fit.peak).sum::<f64>() / tracks.len().max(1) as f64;
    let hazy = haze.map_or(0.0, |h| h.fraction * peak);
    let smallest = MIN_WAVE.max(MIN_OF_HAZE * hazy);
    // A quick look first: most frames that are restless are hazy.
    let few = blocks(image, tracks, haze, QUICK_BLOCKS);
    let samples = row_levels(image, &few, sigma_px, haze, rows.clone());
    if samples.len() < MIN_ROWS || !Waves::new(&samples).any(smallest) {
        return None;
    }
    let all = blocks(image, tracks, haze, usize::MAX);
    let samples = row_levels(image, &all, sigma_px, haze, rows);
    if samples.len() < MIN_ROWS {
        return None;
    }
    let noise = MEDIAN_SD * noise_sd / ((BLOCK_COLUMNS * all.len()) as f64).sqrt();
    let mut fit = Waves::new(&samples);
    while fit.waves.len() < MAX_WAVES && fit.add(noise, smallest) {}
    if fit.waves.is_empty() {
        return None;
    }
    let waves = fit.solved();
    let level = |row: f64| -> f64 {
        waves
            .iter()
            .map(|(f, c, s)| {
                let angle = std::f64::consts::TAU * f * (row - fit.middle);
                c * angle.cos() + s * angle.sin()
            })
            .sum()
    };
    let near = fit.left_over(low - 60.0, high + 60.0);
    Some(Banding {
        first_row,
        levels: (first_row..=last_row)
            .map(|row| level(row as f64))
            .collect(),
        left_sd: (near - noise * noise).max(0.0).sqrt(),
    })
}

/// Blocks of columns with their stripe, `most` at most, evenly from all over.
fn blocks(image: GreyView<'_>, tracks: &[Track], haze: Option<Haze>, most: usize) -> Vec<Block> {
    let every = (image.width_px / BLOCK_COLUMNS).div_ceil(most).max(1);
    let mut blocks: Vec<Block> = Vec::new();
    for track in tracks {
        let number = track.column / BLOCK_COLUMNS;
        let start = number * BLOCK_COLUMNS;
        if start + BLOCK_COLUMNS > image.width_px || number % every != every / 2 {
            continue;
        }
        let row = track.fit.row_px;
        match blocks.last_mut().filter(|b| b.start == start) {
            Some(block) => {
                (block.low, block.high) = (block.low.min(row), block.high.max(row));
            }
            None => blocks.push(Block {
                start,
                low: row,
                high: row,
                haze: haze.map_or(0.0, |h| h.fraction * track.fit.peak),
            }),
        }
    }
    blocks
}

/// Levels of the rows where enough columns have the stripe elsewhere.
fn row_levels(
    image: GreyView<'_>,
    blocks: &[Block],
    sigma_px: f64,
    haze: Option<Haze>,
    rows: std::ops::Range<usize>,
) -> Vec<Sample> {
    // Beyond 4.5 sigma nothing of the stripe is left (4e-5 of its peak).
    let guard = 4.5 * sigma_px + 2.0;
    let haze = haze.map(|h| HazeByRow::new(h.length_px, rows.len()));
    let count = blocks.len();
    let mut light = vec![f32::NAN; count * rows.len()];
    for (line, row) in light.chunks_exact_mut(count.max(1)).zip(rows.clone()) {
        for (value, block) in line.iter_mut().zip(blocks) {
            let beside = (row as f64) < block.low - guard || row as f64 > block.high + guard;
            let from = row * image.width_px + block.start;
            if let Some(pixels) = image
                .pixels
                .get(from..from + BLOCK_COLUMNS)
                .filter(|_| beside)
            {
                let sum: u32 = pixels.iter().map(|p| u32::from(*p)).sum();
                let hazy = haze.as_ref().map_or(0.0, |h| {
                    block.haze as f32 * h.at(row as f64 - block.middle())
                });
                *value = sum as f32 / BLOCK_COLUMNS as f32 - hazy;
            }
        }
    }
    // A block's own level first, then rows against it; again, with rows known.
    let least = ((MIN_SHARE * count as f64) as usize).max(2);
    let mut levels = vec![f32::NAN; rows.len()];
    let mut order = Vec::with_capacity(count);
    let mut own = vec![0.0f32; count];
    for _ in 0..2 {
        let mut sums = vec![(0.0f32, 0.0f32); count];
        for (line, level) in light.chunks_exact(count.max(1)).zip(&levels) {
            let level = if level.is_nan() { 0.0 } else { *level };
            for (sum, value) in sums.iter_mut().zip(line) {
                // Rows on which a lamp's bar lies have no information of a block.
                if !value.is_nan() && level.abs() < MAX_LEVEL as f32 {
                    *sum = (sum.0 + value - level, sum.1 + 1.0);
                }
            }
        }
        for (own, (sum, n)) in own.iter_mut().zip(&sums) {
            *own = sum / n.max(1.0);
        }
        for (level, line) in levels.iter_mut().zip(light.chunks_exact(count.max(1))) {
            order.clear();
            let beside = line.iter().zip(&own).filter(|(v, _)| !v.is_nan());
            order.extend(beside.map(|(v, own)| v - own));
            *level = if order.len() < least {
                f32::NAN
            } else {
                let middle = order.len() / 2;
                *order.select_nth_unstable_by(middle, f32::total_cmp).1
            };
        }
    }
    let mut known: Vec<f32> = levels.iter().copied().filter(|v| !v.is_nan()).collect();
    if known.is_empty() {
        return Vec::new();
    }
    let middle = known.len() / 2;
    let centre = f64::from(*known.select_nth_unstable_by(middle, f32::total_cmp).1);
    let spread: Vec<f64> = blocks.iter().map(Block::middle).collect();
    levels
        .iter()
        .zip(rows)
        .filter(|(level, _)| (f64::from(**level) - centre).abs() < MAX_LEVEL)
        .map(|(level, row)| Sample {
            row: row as f64,
            level: f64::from(*level) - centre,
            haze: haze.as_ref().map_or(0.0, |h| {
                let every = spread.len().div_ceil(8).max(1);
                let seen = spread.iter().step_by(every);
                let n = seen.clone().count().max(1) as f64;
                seen.map(|at| f64::from(h.at(row as f64 - at))).sum::<f64>() / n
            }),
        })
        .collect()
}

/// Waves in the levels of rows, beside a constant, a slope and haze.
struct Waves {
    rows: Vec<f64>,
    middle: f64,
    levels: Vec<f64>,
    /// Orthonormal columns: what is no wave, then the waves taken.
    basis: Vec<Vec<f64>>,
    /// Levels without their part in the basis.
    rest: Vec<f64>,
    others: usize,
    /// Frequencies taken \[1/px\].
    waves: Vec<f64>,
    plain: Vec<Vec<f64>>,
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

impl Waves {
    fn new(samples: &[Sample]) -> Self {
        let rows: Vec<f64> = samples.iter().map(|s| s.row).collect();
        let middle = rows.iter().sum::<f64>() / rows.len().max(1) as f64;
        let levels: Vec<f64> = samples.iter().map(|s| s.level).collect();
        let mut this = Self {
            middle,
            rest: levels.clone(),
            levels,
            basis: Vec::new(),
            others: 0,
            waves: Vec::new(),
            plain: Vec::new(),
            rows,
        };
        this.push(vec![1.0; this.rows.len()]);
        this.push(this.rows.iter().map(|r| r - middle).collect());
        this.push(samples.iter().map(|s| s.haze).collect());
        this.others = this.basis.len();
        this
    }

    /// Takes its part in the basis out of a column, in place.
    fn reduce(&self, column: &mut [f64]) {
        for b in &self.basis {
            let along = dot(b, column);
            for (c, b) in column.iter_mut().zip(b) {
                *c -= along * b;
            }
        }
    }

    /// Adds a column to the basis, unless it holds nothing new.
    fn push(&mut self, column: Vec<f64>) {
        let size = dot(&column, &column);
        let mut new = column.clone();
        self.reduce(&mut new);
        let left = dot(&new, &new);
        if left > 1e-6 * size && left > 0.0 {
            let scale = 1.0 / left.sqrt();
            new.iter_mut().for_each(|v| *v *= scale);
            let along = dot(&new, &self.rest);
            for (r, b) in self.rest.iter_mut().zip(&new) {
                *r -= along * b;
            }
            self.basis.push(new);
            self.plain.push(column);
        }
    }

    fn columns(&self, frequency: f64) -> [Vec<f64>; 2] {
        let angle = |r: f64| std::f64::consts::TAU * frequency * (r - self.middle);
        let turn = angle(self.middle + 1.0).sin_cos();
        let (mut cosines, mut sines) = (
            Vec::with_capacity(self.rows.len()),
            Vec::with_capacity(self.rows.len()),
        );
        let mut last = f64::NAN;
        let (mut s, mut c) = (0.0, 1.0);
        for &row in &self.rows {
            // One turn per row; afresh behind a gap.
            (s, c) = if row == last + 1.0 {
                (s * turn.1 + c * turn.0, c * turn.1 - s * turn.0)
            } else {
                angle(row).sin_cos()
            };
            last = row;
            cosines.push(c);
            sines.push(s);
        }
        [cosines, sines]
    }

    /// How much of the rest's square a wave explains.
    fn explained(&self, frequency: f64) -> f64 {
        let [mut c, mut s] = self.columns(frequency);
        self.reduce(&mut c);
        self.reduce(&mut s);
        let (cc, ss, cs) = (dot(&c, &c), dot(&s, &s), dot(&c, &s));
        let (cy, sy) = (dot(&c, &self.rest), dot(&s, &self.rest));
        let determinant = cc * ss - cs * cs;
        if determinant < 1e-4 * self.rows.len() as f64 {
            return 0.0;
        }
        (cy * cy * ss - 2.0 * cy * sy * cs + sy * sy * cc) / determinant
    }

    /// Power of the rest at `places` frequencies from `lowest` on, `step` apart.
    fn power(&self, lowest: f64, step: f64, places: usize) -> Vec<f32> {
        const LANES: usize = 8;
        // Every row between the first and the last; nothing where the stripe lies.
        let first = self.rows.first().copied().unwrap_or(0.0);
        let last = self.rows.last().copied().unwrap_or(0.0);
        let mut rest = vec![0.0f32; (last - first) as usize + 1];
        for (row, value) in self.rows.iter().zip(&self.rest) {
            rest[(row - first) as usize] = *value as f32;
        }
        let mut power = Vec::with_capacity(places + LANES);
        for start in (0..places).step_by(LANES) {
            let turn: [(f64, f64); LANES] = std::array::from_fn(|i| {
                (std::f64::consts::TAU * (lowest + (start + i) as f64 * step)).sin_cos()
            });
            let (sine, cosine) = (turn.map(|t| t.0 as f32), turn.map(|t| t.1 as f32));
            let (mut c, mut s) = ([1.0f32; LANES], [0.0f32; LANES]);
            let (mut along_c, mut along_s) = ([0.0f32; LANES], [0.0f32; LANES]);
            for value in &rest {
                for i in 0..LANES {
                    along_c[i] += c[i] * value;
                    along_s[i] += s[i] * value;
                    let next = c[i] * cosine[i] - s[i] * sine[i];
                    s[i] = s[i] * cosine[i] + c[i] * sine[i];
                    c[i] = next;
                }
            }
            power.extend(along_c.iter().zip(&along_s).map(|(c, s)| c * c + s * s));
        }
        power.truncate(places);
        power
    }

    /// Whether any wave stands out, at a first look.
    fn any(&self, smallest: f64) -> bool {
        let (Some(first), Some(last)) = (self.rows.first(), self.rows.last()) else {
            return false;
        };
        let span = (last - first).max(1.0);
        let step = 0.5 / span;
        let (lowest, highest) = (1.0 / LONGEST_PX.min(1.2 * span), 1.0 / SHORTEST_PX);
        let power = self.power(lowest, step, ((highest - lowest) / step) as usize + 1);
        let count = self.rows.len() as f64;
        let gain = 2.0 * f64::from(power.into_iter().fold(0.0, f32::max)) / count;
        let left = (dot(&self.rest, &self.rest) - gain).max(0.0) / count;
        // Half of what is asked later: the wave may lie between two places.
        gain > 0.5 * 0.5 * count * smallest * smallest && gain > MIN_RATIO * left
    }

    /// Takes in the wave that explains most; whether it is worth it.
    fn add(&mut self, noise_sd: f64, smallest: f64) -> bool {
        let span = match (self.rows.first(), self.rows.last()) {
            (Some(first), Some(last)) => (last - first).max(1.0),
            _ => return false,
        };
        // Four places per cycle over the span: no wave falls between two of them.
        let step = 0.25 / span;
        let (lowest, highest) = (1.0 / LONGEST_PX.min(1.2 * span), 1.0 / SHORTEST_PX);
        let places = ((highest - lowest) / step) as usize + 1;
        // Cheap first, as if waves were at right angles to all else; long ones are not.
        let power = self.power(lowest, step, places);
        let peaks = (0..places).filter(|&k| {
            let at = |k: usize| power.get(k).copied().unwrap_or(0.0);
            k < LONG_WAVES || (at(k) >= at(k - 1) && at(k) >= at(k + 1))
        });
        let mut peaks: Vec<usize> = peaks.collect();
        peaks.sort_by(|a, b| power[*b].total_cmp(&power[*a]));
        let mut best = (0.0, lowest);
        for k in peaks.into_iter().take(PEAKS) {
            let frequency = lowest + k as f64 * step;
            let gain = self.explained(frequency);
            if gain > best.0 {
                best = (gain, frequency);
            }
        }
        let mut reach = 0.5 * step;
        for _ in 0..6 {
            for frequency in [best.1 - reach, best.1 + reach] {
                let gain = self.explained(frequency);
                if gain > best.0 {
                    best = (gain, frequency);
                }
            }
            reach *= 0.5;
        }
        let (gain, frequency) = best;
        let count = self.rows.len() as f64;
        let freedom = (count - self.basis.len() as f64 - 2.0).max(1.0);
        let left = ((dot(&self.rest, &self.rest) - gain) / freedom).max(noise_sd * noise_sd);
        let amplitude = (2.0 * gain / count).sqrt();
        if amplitude < smallest || gain < 2.0 * MIN_RATIO * left {
            return false;
        }
        self.waves.push(frequency);
        for column in self.columns(frequency) {
            self.push(column);
        }
        true
    }

    /// Mean square of what is left of the rows between these.
    fn left_over(&self, from: f64, to: f64) -> f64 {
        let near = self
            .rows
            .iter()
            .zip(&self.rest)
            .filter(|(r, _)| (from..to).contains(*r));
        let (count, sum) = near.fold((0.0, 0.0), |(n, s), (_, v)| (n + 1.0, s + v * v));
        sum / f64::max(count, 1.0)
    }

    /// Frequency and the two amplitudes of each wave, from all columns together.
    fn solved(&self) -> Vec<(f64, f64, f64)> {
        // Back from the orthonormal columns: R x = Q' y with R = Q' (plain columns).
        let n = self.plain.len();
        let mut x = vec![0.0; n];
        for i in (0..n).rev() {
            let mut value = dot(&self.basis[i], &self.levels);
            for (plain, x) in self.plain.iter().zip(&x).skip(i + 1) {
                value -= dot(&self.basis[i], plain) * x;
            }
            x[i] = value / dot(&self.basis[i], &self.plain[i]);
        }
        let pairs = x[self.others..].chunks_exact(2);
        self.waves
            .iter()
            .zip(pairs)
            .map(|(f, pair)| (*f, pair[0], pair[1]))
            .collect()
    }
}

impl Banding {
    /// The image without the rows' levels. Pixels at the ceiling stay there.
    pub fn taken_off(&self, image: GreyView<'_>, ceiling: u8) -> GreyImage {
        let mut out = GreyImage {
            width_px: image.width_px,
            height_px: image.height_px,
            pixels: image.pixels.to_vec(),
        };
        let width = image.width_px.max(1);
        let lines = out
            .pixels
            .chunks_exact_mut(width)
            .enumerate()
            .skip(self.first_row);
        for ((row, line), level) in lines.zip(&self.levels) {
            // Whole levels with an even share of columns rounded up: a row's mean loses the level
            // exactly, and no rounding error is common to a row.
            const GOLDEN: f64 = 0.618_033_988_749_895;
            const PLASTIC: f64 = 0.754_877_666_246_693;
            let mut dither = (row as f64 * PLASTIC).fract();
            let brightest_level = f64::from(ceiling.saturating_sub(1));
            for pixel in line {
                if *pixel < ceiling {
                    *pixel = (f64::from(*pixel) - level + dither)
                        .floor()
                        .clamp(0.0, brightest_level) as u8;
                }
                dither += GOLDEN;
                if dither >= 1.0 {
                    dither -= 1.0;
                }
            }
        }
        out
    }
}
