//! Seams between the blocks of a JPEG: what a changed value in its coded data leaves, where the data still decode.
//!
//! A value that is not the one that was written changes one block by one pattern of its 64 (an AC coefficient), or the
//! brightness of it and of all that follow (a DC coefficient, of which the differences are coded); a code that is read as
//! another changes a block or a few altogether. Light knows nothing of blocks: across their edges a sound image goes on
//! as it does within them. So a block is damaged where it goes on from none of its neighbours, or where taking one
//! pattern away closes the seams on all of its four sides at once; and there is a step where the seams run along the
//! order of the data. What an object does, an edge on the grid, a dot as large as a block, does none of it.
//!
//! Not to be seen: changes no larger than noise and quantization, those of colour alone, weak ones of several patterns
//! at once, and most of those in blocks at the border.

use std::sync::LazyLock;

use super::jpeg::{Grid, JpegDamage};

/// Side of a block \[px\].
const SIDE: usize = 8;
/// Share of the seams' energy that one pattern has to explain, alone and with a shift of the whole block, which clipping
/// at black or white makes of it. Half of a pattern that is clipped to half is itself, two fifths are a shift.
const EXPLAINED: [f32; 2] = [0.45, 0.9];
/// Steps of quantization that a change has at least: where most coefficients are quantized to nothing, one that is not
/// stands alone, at one step or a few.
const CHANGE_MIN: f32 = 4.0;
/// Mismatch of a seam's pixel, over the usual one and that within the neighbour, from which it does not go on.
const BEYOND: f32 = 3.0;
/// Mismatch over the step from pixel to pixel: 2 of a step with even levels on both sides, less than this of an edge that
/// a lens has drawn (a point spread of standard deviation 0.6 px: 1.3).
const SHARP: f32 = 1.4;
/// Blocks that a change leaves at most, or one of so many: of more, the picture itself is drawn on the grid.
const FEW: usize = 8;
const FEW_OF: usize = 50;
/// Share of its own rounding that a block has: where the picture is smooth, most coefficients are zero and stay so.
const ROUNDED: f32 = 0.5;
/// Pixels of a side, of 8, and sides of a block from which it goes on from none: an object's edge on the grid makes one
/// or two sides, a dot as large as a block parts of all.
const BEYOND_MIN: usize = 5;
const SIDES_MIN: usize = 3;
/// Scatter of the seams along a step, over the step, at most: the change is the same for all of them.
const UNEVEN_MAX: f32 = 0.3;
/// Range of the step along the seams, over that at the block where it begins.
const AGREES: std::ops::Range<f32> = 0.7..1.4;
/// Edges that a part of the seams along a step has at least.
const PART_MIN: usize = 3;

/// Twice the mismatch of two pixels on either side of a seam with the slopes beside it, from the second pixel before it.
fn mismatch(p: [u8; 4]) -> i16 {
    let [a1, a0, b0, b1] = p.map(i16::from);
    3 * (b0 - a0) + a1 - b1
}

/// Mismatches at the edges of all whole blocks.
struct Seams {
    columns: usize,
    rows: usize,
    /// To the left of each block, row by row of it, and above it; zeros at the border.
    left: Vec<[i16; SIDE]>,
    above: Vec<[i16; SIDE]>,
}

impl Seams {
    fn of(pixels: &[u8], width_px: usize) -> Self {
        let height_px = pixels.len().checked_div(width_px).unwrap_or(0);
        let (columns, rows) = (width_px / SIDE, height_px / SIDE);
        let mut left = vec![[0; SIDE]; columns * rows];
        let mut above = left.clone();
        let at = |x: usize, y: usize| pixels[y * width_px + x];
        for row in 0..rows {
            for column in 0..columns {
                let (x, y) = (column * SIDE, row * SIDE);
                let block = row * columns + column;
                for k in 0..SIDE {
                    if column > 0 {
                        left[block][k] =
                            mismatch([-2, -1, 0, 1].map(|d| at(x.wrapping_add_signed(d), y + k)));
                    }
                    if row > 0 {
                        above[block][k] =
                            mismatch([-2, -1, 0, 1].map(|d| at(x + k, y.wrapping_add_signed(d))));
                    }
                }
            }
        }
        Seams {
            columns,
            rows,
            left,
            above,
        }
    }

    /// Seams of a block that has neighbours on all sides: left, right, above, below.
    fn around(&self, row: usize, column: usize) -> [f32; 4 * SIDE] {
        let block = row * self.columns + column;
        let sides = [
            self.left[block],
            self.left[block + 1],
            self.above[block],
            self.above[block + self.columns],
        ];
        let mut all = [0.0; 4 * SIDE];
        for (value, seam) in all.iter_mut().zip(sides.iter().flatten()) {
            *value = f32::from(*seam);
        }
        all
    }

    fn inner(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let columns = 1..self.columns.saturating_sub(1);
        (1..self.rows.saturating_sub(1)).flat_map(move |row| columns.clone().map(move |c| (row, c)))
    }
}

fn dot(a: &[f32; 32], b: &[f32; 32]) -> f32 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// Middle of the values; 0 of none.
fn median(values: &mut [f32]) -> f32 {
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f32::total_cmp).1
}

/// Seams that a unit of each pattern makes around its block, by row and column of its frequency.
static PATTERNS: LazyLock<Vec<[f32; 32]>> = LazyLock::new(|| {
    let cosine = |u: usize, x: usize| {
        let scale = if u == 0 { 0.125f32.sqrt() } else { 0.5 };
        scale * (std::f32::consts::PI * (2 * x + 1) as f32 * u as f32 / 16.0).cos()
    };
    let mut all = Vec::with_capacity(SIDE * SIDE);
    for v in 0..SIDE {
        for u in 0..SIDE {
            let entering = |of: usize| 3.0 * cosine(of, 0) - cosine(of, 1);
            let leaving = |of: usize| cosine(of, 6) - 3.0 * cosine(of, 7);
            let mut seams = [0.0; 32];
            for k in 0..SIDE {
                seams[k] = entering(u) * cosine(v, k);
                seams[SIDE + k] = leaving(u) * cosine(v, k);
                seams[2 * SIDE + k] = entering(v) * cosine(u, k);
                seams[3 * SIDE + k] = leaving(v) * cosine(u, k);
            }
            all.push(seams);
        }
    }
    all
});

/// Blocks that look like damage, of an image's grey levels held against its grid.
pub(super) fn flagged(pixels: &[u8], width_px: usize, grid: &Grid) -> Vec<JpegDamage> {
    let seams = Seams::of(pixels, width_px);
    let usual = Usual::of(&seams, grid);
    let mut found = foreign(&seams, pixels, width_px, &usual);
    found.extend(blocks(&seams, grid, &usual));
    found.extend(steps(&seams, grid, width_px, &usual));
    found
}

/// Standard deviations of a pixel's mismatch in a sound image.
struct Usual {
    noise: f32,
    /// By the rounding of the coefficients.
    rounding: f32,
}

impl Usual {
    fn of(seams: &Seams, grid: &Grid) -> Self {
        let all = seams.left.iter().chain(&seams.above).flatten();
        let mut sizes: Vec<f32> = all.map(|m| f32::from(m.abs())).collect();
        let squares = grid.steps.iter().map(|q| f32::from(*q).powi(2));
        // That of a pixel where all coefficients are rounded, and the weights of 9, 9, 1, 1 of a mismatch.
        let all_rounded = (20.0 * squares.sum::<f32>() / (12.0 * 64.0)).sqrt();
        Usual {
            // Rounding to levels alone makes mismatches of a few.
            noise: 1.5 * median(&mut sizes) + 2.0,
            rounding: ROUNDED * all_rounded,
        }
    }

    fn pixel(&self) -> f32 {
        self.noise.max(self.rounding)
    }
}

/// Blocks that one pattern too much explains.
fn blocks(seams: &Seams, grid: &Grid, usual: &Usual) -> Vec<JpegDamage> {
    let mut found = Vec::new();
    let looked_at = 4.0 * SIDE as f32 * (BEYOND * usual.pixel()).powi(2);
    for (row, column) in seams.inner() {
        let around = seams.around(row, column);
        let energy = dot(&around, &around);
        if energy < looked_at {
            continue;
        }
        let shift = &PATTERNS[0];
        let (shift_length, on_shift) = (dot(shift, shift), dot(&around, shift));
        let mut best: (f32, f32) = (0.0, 0.0);
        for (pattern, step) in PATTERNS.iter().zip(grid.steps).skip(1) {
            let (length, on, both) = (
                dot(pattern, pattern),
                dot(&around, pattern),
                dot(pattern, shift),
            );
            let alone = on * on / length;
            // Least squares of the two together.
            let change = (on * shift_length - on_shift * both)
                / (length * shift_length - both * both).max(f32::MIN_POSITIVE);
            let rest = on_shift - change * both;
            let together = alone.max(change * on + rest / shift_length * on_shift);
            let real = change.abs() > CHANGE_MIN * f32::from(step);
            if real && alone > EXPLAINED[0] * energy && together > best.0 {
                best = (together, change);
            }
        }
        if best.0 > EXPLAINED[1] * energy {
            found.push(JpegDamage::Block {
                column_px: column * SIDE,
                row_px: row * SIDE,
                change: best.1.round() as i32,
            });
        }
    }
    found
}

/// Blocks that go on from none of their neighbours, however these look.
fn foreign(seams: &Seams, pixels: &[u8], width_px: usize, usual: &Usual) -> Vec<JpegDamage> {
    let usual = usual.pixel();
    let mut found = Vec::new();
    for row in 0..seams.rows {
        for column in 0..seams.columns {
            let block = row * seams.columns + column;
            let is_last = [column + 1 == seams.columns, row + 1 == seams.rows];
            // Where a seam's pixels begin, and where those within the neighbour do, from the block's first pixel.
            let sides = [
                (column > 0).then(|| (&seams.left[block], [-2, -7], true)),
                (!is_last[0]).then(|| (&seams.left[block + 1], [6, 9], true)),
                (row > 0).then(|| (&seams.above[block], [-2, -7], false)),
                (!is_last[1]).then(|| (&seams.above[block + seams.columns], [6, 9], false)),
            ];
            let apart = sides
                .into_iter()
                .flatten()
                .filter(|(seam, [at, within], across)| {
                    let rough = seam.iter().filter(|m| f32::from(m.abs()) > BEYOND * usual);
                    // Before the neighbour is looked at: most seams are as usual.
                    if rough.count() < BEYOND_MIN {
                        return false;
                    }
                    let four = |start: isize, k: usize| {
                        [0, 1, 2, 3].map(|d| {
                            let (x, y) = (column * SIDE, row * SIDE);
                            match across {
                                true => {
                                    pixels[(y + k) * width_px + x.wrapping_add_signed(start + d)]
                                }
                                false => {
                                    pixels[y.wrapping_add_signed(start + d) * width_px + x + k]
                                }
                            }
                        })
                    };
                    let inner =
                        (0..SIDE).flat_map(|k| [0, 1, 2].map(|s| mismatch(four(within + s, k))));
                    let energy: f32 = inner.map(|m| f32::from(m).powi(2)).sum();
                    let bound = BEYOND * usual.max((energy / (3 * SIDE) as f32).sqrt());
                    let is_apart = |k: &usize| {
                        let p = four(*at, *k);
                        let (m, step) = (f32::from(mismatch(p).abs()), p[1].abs_diff(p[2]));
                        m > bound && m > SHARP * f32::from(step)
                    };
                    (0..SIDE).filter(is_apart).count() >= BEYOND_MIN
                });
            if apart.count() >= SIDES_MIN {
                found.push(JpegDamage::Foreign {
                    column_px: column * SIDE,
                    row_px: row * SIDE,
                });
            }
        }
    }
    if found.len() > FEW.max(seams.rows * seams.columns / FEW_OF) {
        found.clear();
    }
    found
}

/// Steps of brightness that follow the order of the data.
fn steps(seams: &Seams, grid: &Grid, width_px: usize, usual: &Usual) -> Vec<JpegDamage> {
    let mut found = Vec::new();
    let mean =
        |edge: &[i16; SIDE]| edge.iter().map(|m| f32::from(*m)).sum::<f32>() / (2 * SIDE) as f32;
    let left: Vec<f32> = seams.left.iter().map(mean).collect();
    let above: Vec<f32> = seams.above.iter().map(mean).collect();
    let [across, down] = grid.group;
    let groups = width_px.div_ceil(SIDE * across);
    let order = |row: usize, column: usize| {
        let group = row / down * groups + column / across;
        let within = row % down * across + column % across;
        group * across * down + within
    };
    let interval = grid.interval * across * down;
    // In levels: half a mismatch. Noise goes down with the mean over a side, rounding, common to all of it, does not.
    let least = 0.5 * BEYOND * (0.5 * usual.noise).max(usual.rounding);
    for row in 0..seams.rows {
        for column in 1..seams.columns {
            let step = left[row * seams.columns + column];
            if step.abs() < least {
                continue;
            }
            let from = order(row, column);
            let to = match interval {
                0 => usize::MAX,
                n => (from / n + 1) * n,
            };
            let is_off = |row: usize, column: usize| (from..to).contains(&order(row, column));
            // Seams between what is off and what is not, in the group's row and below it.
            let [mut first, mut later] = [Vec::new(), Vec::new()];
            // The other seams of the same rows: a picture that repeats itself has them, too.
            let [mut first_quiet, mut later_quiet] = [Vec::new(), Vec::new()];
            let top = row / down * down;
            for r in top.max(1)..(top + 2 * down).min(seams.rows) {
                for c in 0..seams.columns {
                    let seam = above[r * seams.columns + c];
                    let (along, quiet) = match r <= row {
                        true => (&mut first, &mut first_quiet),
                        false => (&mut later, &mut later_quiet),
                    };
                    match (is_off(r - 1, c), is_off(r, c)) {
                        (false, true) => along.push(seam),
                        (true, false) => along.push(-seam),
                        _ => quiet.push(seam.abs()),
                    }
                }
            }
            let is_quiet = [&mut first_quiet, &mut later_quiet]
                .into_iter()
                .all(|part| median(part) < UNEVEN_MAX * step.abs());
            let agree = [&mut first, &mut later].into_iter().all(|part| {
                let middle = median(part);
                let off = median(&mut part.iter().map(|v| (v - middle).abs()).collect::<Vec<_>>());
                part.len() >= PART_MIN
                    && off < UNEVEN_MAX * middle.abs()
                    && AGREES.contains(&(middle / step))
            });
            if agree && is_quiet {
                found.push(JpegDamage::Step {
                    column_px: column * SIDE,
                    row_px: row * SIDE,
                    levels: step.round() as i32,
                });
            }
        }
    }
    found
}
