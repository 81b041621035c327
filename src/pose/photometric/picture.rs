//! A frame as it is compared: its grey levels, from where on they are clipped, and light that comes and goes by rows.

use super::Response;
use super::flicker::{self, Rows};
use super::lighting::CELL_PX;
use crate::segments::background_level;
use hydroline_core::frame::GreyImage;
use hydroline_stripe::{Profile, StripePoint};
use nalgebra::{Const, OMatrix, OVector};

/// Rows this near the stripe are not looked at for what is dark \[px\].
const STRIPE_ROWS: f64 = 25.0;
/// Nor those near the stripe of so many columns on either side.
const EDGE_COLUMNS: usize = 12;
/// Nor those within so many of its sds.
const STRIPE_SDS: f64 = 6.0;
/// So few numbers are sorted one by one.
const SORTED_MOST: usize = 16;
/// Every so many columns and rows show whether the dark is even, and if not, how.
const FEW: [usize; 2] = [16, 4];
const ALL: [usize; 2] = [1, 1];
/// Rounds in which lamps and flicker are separated.
const ROUNDS: usize = 3;
/// Light that flickers by more than this is none of a lamp's mains, and pixels off by more than that and so many sds of
/// their noise are not counted \[grey levels\].
const FLICKER_MOST: f64 = 20.0;
const WITHIN_SDS: f64 = 3.0;
/// Fewest dark pixels of a row's level.
const DARK_LEAST: f64 = 20.0;
/// Side of a block \[px\], and fewest of its pixels away from the stripe from which its level is taken.
const BLOCK_PX: usize = 24;
const BLOCK_LEAST: f64 = 200.0;
/// Sd left by blocks and what lies between them, and by rows that do not differ by more than their noise \[grey levels\].
const BLOCKS_SD: f64 = 0.2;
/// Sd of the mean about a median, in those of a mean.
const MEDIAN_SDS: f64 = 1.1;
/// Rows that differ by more than so many times their noise differ.
const DIFFER_SDS: f64 = 3.0;

/// A frame made ready.
#[derive(Debug, Clone)]
pub(crate) struct Picture<'a> {
    pub pixels: &'a [u8],
    /// Level from which a pixel counts as clipped.
    pub ceiling: u8,
    /// Share of the stripe's columns that are.
    pub clipped_share: f64,
    /// Median of the dark pixels \[grey levels\].
    pub dark: f64,
    /// Where the dark is uneven.
    pub uneven: Option<Uneven>,
}

/// By how much dark pixels differ from their median \[grey levels\].
#[derive(Debug, Clone)]
pub(crate) struct Uneven {
    /// Level that they differ from: the median of the dark \[as the levels\].
    pub dark: f64,
    /// Of each row: light that flickers, and its sd.
    pub rows: Rows,
    /// Of blocks of pixels, by rows: lamps and what they light.
    pub(super) blocks: Vec<f64>,
    pub(super) across: usize,
    pub(super) blocks_sd: f64,
}

impl Uneven {
    /// Sd of a row's level where blocks and rows are separated \[as the levels\].
    pub fn sd(&self, row: usize) -> f64 {
        let rows = self.rows.sd.get(row).copied().unwrap_or(0.0);
        // A row is off by the same all along it, and each cell's dark is eliminated by itself: so many of them, each with this
        // sd, are together off by the row's.
        let cells = (self.across * BLOCK_PX) as f64 / CELL_PX as f64;
        (rows * cells.sqrt()).hypot(self.blocks_sd)
    }

    /// At rows of a column, without the rows' own: in the first of them, and what it gains per row.
    pub fn along(&self, column: usize, first: usize, last: usize) -> (f64, f64) {
        let (a, b) = (self.of_blocks(column, first), self.of_blocks(column, last));
        (a, (b - a) / (last - first).max(1) as f64)
    }

    fn of_blocks(&self, column: usize, row: usize) -> f64 {
        let down = self.blocks.len() / self.across.max(1);
        let place = |at: usize, n: usize| {
            let middle = (at as f64 + 0.5) / BLOCK_PX as f64 - 0.5;
            let middle = middle.clamp(0.0, n.saturating_sub(1) as f64);
            let below = (middle as usize).min(n.saturating_sub(2));
            (below, middle - below as f64)
        };
        let ((i, u), (j, v)) = (place(column, self.across), place(row, down));
        let node =
            |i: usize, j: usize| self.blocks.get(j * self.across + i).copied().unwrap_or(0.0);
        let line = |j: usize| node(i, j) * (1.0 - u) + node(i + 1, j) * u;
        line(j) * (1.0 - v) + line(j + 1) * v
    }
}

impl<'a> Picture<'a> {
    /// A frame whose dark is even.
    pub fn plain(pixels: &'a [u8], ceiling: u8) -> Self {
        Picture {
            pixels,
            ceiling,
            clipped_share: 0.0,
            dark: 0.0,
            uneven: None,
        }
    }

    /// A frame, its dark and its clipping measured from its pixels; clipped from its own ceiling on, at most from `ceiling`.
    pub fn of(image: &'a GreyImage, profile: &Profile, ceiling: u8) -> Self {
        let away = Away::new(image, profile);
        let uneven = [FEW, ALL].into_iter().try_fold(None, |_, step| {
            // Where few pixels show nothing, all are not looked at.
            away.uneven(image, step).map(Some)
        });
        let ceiling = own_ceiling(image, profile).min(ceiling);
        let lit = |point: &&StripePoint| {
            let (row, column) = (point.row_px.round(), point.column_px.round());
            let at = row.max(0.0) as usize * image.width_px + column.max(0.0) as usize;
            image.pixels.get(at).is_some_and(|grey| *grey >= ceiling)
        };
        let clipped = profile.points.iter().filter(lit).count();
        Picture {
            dark: away.dark,
            uneven: uneven.flatten(),
            clipped_share: clipped as f64 / profile.points.len().max(1) as f64,
            ..Picture::plain(&image.pixels, ceiling)
        }
    }

    /// Half of what rows differ by, and most less least of what lamps light \[grey levels\].
    pub fn uneven_levels(&self) -> (f64, f64) {
        let across = |levels: &[f64]| {
            let most = levels.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let least = levels.iter().copied().fold(f64::INFINITY, f64::min);
            (most - least).max(0.0)
        };
        self.uneven.as_ref().map_or((0.0, 0.0), |uneven| {
            (0.5 * across(&uneven.rows.level), across(&uneven.blocks))
        })
    }

    /// Light that is not even, beyond that of the median, under a camera's response.
    pub fn lit(&self, response: &Response) -> Option<Uneven> {
        let dark = response.between(self.dark);
        let of = |by: &f64| response.between(self.dark + by) - dark;
        let per_grey = response.light_per_grey(dark);
        self.uneven.as_ref().map(|uneven| Uneven {
            dark,
            rows: Rows {
                level: uneven.rows.level.iter().map(of).collect(),
                sd: uneven.rows.sd.iter().map(|sd| sd * per_grey).collect(),
            },
            blocks: uneven.blocks.iter().map(of).collect(),
            across: uneven.across,
            blocks_sd: uneven.blocks_sd * per_grey,
        })
    }
}

/// Pixels away from the stripe.
struct Away {
    dark: f64,
    noise_sd: f64,
    /// First and last row near the stripe in each column; [`UNKNOWN`] where it has no stripe and nothing is known.
    near: Vec<[usize; 2]>,
}

/// All rows.
const UNKNOWN: [usize; 2] = [0, usize::MAX];

impl Away {
    fn new(image: &GreyImage, profile: &Profile) -> Self {
        let mut near: Vec<Option<[usize; 2]>> = vec![None; image.width_px];
        for point in profile.points.iter().chain(&profile.candidates) {
            if let Some(rows) = near.get_mut(point.column_px.round() as usize) {
                let reach = (STRIPE_SDS * point.sigma_px).max(STRIPE_ROWS);
                let [a, b] = [-reach, reach].map(|by| (point.row_px + by).max(0.0) as usize);
                *rows = Some(rows.map_or([a, b], |[c, d]| [a.min(c), b.max(d)]));
            }
        }
        // Where an edge cuts the stripe some columns show a little of both levels, and a point of neither or one.
        let near = (0..near.len())
            .map(|k| {
                let about = k.saturating_sub(EDGE_COLUMNS)..(k + EDGE_COLUMNS + 1).min(near.len());
                let Some(own) = near[k] else {
                    return UNKNOWN;
                };
                let others = near[about].iter().flatten();
                others.fold(own, |[a, b], [c, d]| [a.min(*c), b.max(*d)])
            })
            .collect();
        Away {
            dark: background_level(image),
            noise_sd: profile.noise_sd.max(0.5),
            near,
        }
    }

    fn holds(&self, row: usize, column: usize) -> bool {
        let [first, last] = self.near[column];
        row < first || row > last
    }

    /// Rows and blocks that differ, by every so many pixels; `None` where they do not by more than their noise.
    fn uneven(&self, image: &GreyImage, [by_columns, by_rows]: [usize; 2]) -> Option<Uneven> {
        // From each other: what all have in common is the background, which is fitted.
        let differ = |seen: &mut dyn Iterator<Item = (f64, f64)>| {
            let (n, by, by2, sd2) = seen.fold((0.0, 0.0, 0.0, 0.0), |(n, a, b, c), (by, sd)| {
                (n + 1.0, a + by, b + by * by, c + sd * sd)
            });
            by2 - by * by / f64::max(n, 1.0) > DIFFER_SDS * DIFFER_SDS * sd2
        };
        // Of rows, none where they do not differ.
        let flickering = |(by, sd): (Vec<Option<f64>>, Vec<f64>)| {
            let seen = &mut by
                .iter()
                .zip(&sd)
                .filter_map(|(by, sd)| Some(((*by)?, *sd)));
            differ(seen).then(|| flicker::of_rows(&by, &sd))
        };
        let block_sd = |n: f64| MEDIAN_SDS * self.noise_sd / n.sqrt();
        let lit = |seen: &[Option<f64>], counts: &[f64]| {
            let with_sd = |(by, n): (&Option<f64>, &f64)| Some(((*by)?, block_sd(*n)));
            differ(&mut seen.iter().zip(counts).filter_map(with_sd))
        };
        let even = vec![0.0; image.height_px];
        let mut rows = flickering(self.rows_and_columns(image, by_columns, by_rows));
        let mut lamps = None;
        // Lamps and flicker are separated by backfitting: the one is smooth, the other the same along a row.
        for _ in 0..ROUNDS {
            let of_rows = rows.as_ref().map_or(&even, |r| &r.level);
            let (seen, across, counts) = self.blocks(image, of_rows, by_columns, by_rows);
            if !lit(&seen, &counts) {
                break;
            }
            let smooth = smooth_over(&seen, &counts, across)?;
            rows = flickering(self.rows(image, &smooth, by_columns, by_rows));
            lamps = Some((smooth, seen, across, counts));
        }
        let across = image.width_px.div_ceil(BLOCK_PX);
        let blocks = lamps.map(|(smooth, seen, across, counts)| {
            // Part of the lamps' light that is no polynomial.
            let left = |(s, l): (&Option<f64>, &f64)| Some((*s)? - l);
            let left: Vec<Option<f64>> = seen.iter().zip(&smooth).map(left).collect();
            if lit(&left, &counts) {
                let left = filled(&left, across);
                smooth.iter().zip(left).map(|(l, by)| l + by).collect()
            } else {
                smooth
            }
        });
        let uneven = rows.is_some() || blocks.is_some();
        let none = across * image.height_px.div_ceil(BLOCK_PX);
        uneven.then(|| Uneven {
            dark: self.dark,
            rows: rows.unwrap_or(Rows {
                sd: even.clone(),
                level: even,
            }),
            blocks: blocks.unwrap_or_else(|| vec![0.0; none]),
            across,
            blocks_sd: BLOCKS_SD,
        })
    }

    /// By how much the dark pixels of each row differ from those of their columns, and the sd of that: a lamp to one side
    /// makes columns differ, and which of them the stripe hides changes from row to row.
    fn rows_and_columns(
        &self,
        image: &GreyImage,
        by_columns: usize,
        by_rows: usize,
    ) -> (Vec<Option<f64>>, Vec<f64>) {
        let width = image.width_px;
        let most = FLICKER_MOST + WITHIN_SDS * self.noise_sd;
        let mut columns = vec![self.dark; width];
        let (mut rows, mut sd) = (vec![None; image.height_px], vec![0.0; image.height_px]);
        for _ in 0..ROUNDS {
            let mut of_columns = vec![(0.0, 0.0); width];
            let lines = image.pixels.chunks_exact(width.max(1)).enumerate();
            for (k, line) in lines.step_by(by_rows) {
                let row_by = rows[k].unwrap_or(0.0);
                let (mut sum, mut n) = (0.0, 0.0);
                let mut column = 0;
                while column < width {
                    let by = f64::from(line[column]) - columns[column];
                    if by.abs() < most && self.holds(k, column) {
                        (sum, n) = (sum + by, n + 1.0);
                        let of = &mut of_columns[column];
                        *of = (of.0 + by - row_by, of.1 + 1.0);
                    }
                    column += by_columns;
                }
                rows[k] = (n * by_columns as f64 >= DARK_LEAST).then(|| sum / n);
                sd[k] = self.noise_sd / f64::sqrt(n);
            }
            for (column, (sum, n)) in columns.iter_mut().zip(of_columns) {
                *column += if n > 0.0 { sum / n } else { 0.0 };
            }
        }
        (rows, sd)
    }

    /// By how much the dark pixels of each row differ from what lamps light, and the sd of that.
    fn rows(
        &self,
        image: &GreyImage,
        lamps: &[f64],
        by_columns: usize,
        by_rows: usize,
    ) -> (Vec<Option<f64>>, Vec<f64>) {
        let width = image.width_px;
        let most = FLICKER_MOST + WITHIN_SDS * self.noise_sd;
        let lamps = Uneven {
            dark: self.dark,
            rows: Rows::default(),
            blocks: lamps.to_vec(),
            across: width.div_ceil(BLOCK_PX),
            blocks_sd: BLOCKS_SD,
        };
        let row = |(k, line): (usize, &[u8])| {
            if k % by_rows != 0 {
                return (None, 0.0);
            }
            let (mut sum, mut n) = (0.0, 0.0);
            for (column, grey) in line.iter().enumerate().step_by(by_columns) {
                if self.holds(k, column) {
                    let by = f64::from(*grey) - self.dark - lamps.of_blocks(column, k);
                    if by.abs() < most {
                        (sum, n) = (sum + by, n + 1.0);
                    }
                }
            }
            (
                (n * by_columns as f64 >= DARK_LEAST).then(|| sum / n),
                self.noise_sd / f64::sqrt(n),
            )
        };
        image
            .pixels
            .chunks_exact(width.max(1))
            .enumerate()
            .map(row)
            .unzip()
    }

    /// Medians of what blocks have beyond their rows, by rows of blocks; blocks to a row; pixels in each.
    fn blocks(
        &self,
        image: &GreyImage,
        rows: &[f64],
        by_columns: usize,
        by_rows: usize,
    ) -> (Vec<Option<f64>>, usize, Vec<f64>) {
        let (width, height) = (image.width_px, image.height_px);
        let across = width.div_ceil(BLOCK_PX);
        let down = height.div_ceil(BLOCK_PX);
        let (mut blocks, mut counts) = (Vec::new(), Vec::new());
        let mut seen = Vec::new();
        for block in 0..across * down {
            let (left, top) = (block % across * BLOCK_PX, block / across * BLOCK_PX);
            seen.clear();
            let (right, bottom) = ((left + BLOCK_PX).min(width), (top + BLOCK_PX).min(height));
            let mut row = top;
            while row < bottom {
                let (line, of_row) = (&image.pixels[row * width..(row + 1) * width], rows[row]);
                let mut column = left;
                while column < right {
                    if self.holds(row, column) {
                        seen.push(f64::from(line[column]) - of_row);
                    }
                    column += by_columns;
                }
                row += by_rows;
            }
            let n = seen.len() as f64;
            let enough = n * (by_columns * by_rows) as f64 >= BLOCK_LEAST;
            blocks.push(enough.then(|| self.level(&mut seen) - self.dark));
            counts.push(n);
        }
        (blocks, across, counts)
    }

    /// Mean of those about the median: grey levels are whole, and what glitters is no background.
    fn level(&self, seen: &mut [f64]) -> f64 {
        let middle = seen.len() / 2;
        let median = if seen.len() <= SORTED_MOST {
            for k in 1..seen.len() {
                let (mut at, new) = (k, seen[k]);
                while at > 0 && seen[at - 1] > new {
                    seen[at] = seen[at - 1];
                    at -= 1;
                }
                seen[at] = new;
            }
            seen[middle]
        } else {
            *seen.select_nth_unstable_by(middle, f64::total_cmp).1
        };
        let within = WITHIN_SDS * self.noise_sd;
        let (mut sum, mut n) = (0.0, 0.0);
        for v in seen.iter().filter(|v| (**v - median).abs() < within) {
            (sum, n) = (sum + v, n + 1.0);
        }
        sum / f64::max(n, 1.0)
    }
}

/// Legendre polynomials of blocks' columns and rows by least squares, in every block; `None` where too few are seen.
fn smooth_over(seen: &[Option<f64>], counts: &[f64], across: usize) -> Option<Vec<f64>> {
    let down = seen.len() / across.max(1);
    let powers = |k: usize| {
        let place = |at: usize, n: usize| (2.0 * at as f64 + 1.0) / n.max(1) as f64 - 1.0;
        let (u, v) = (
            legendre(place(k % across, across)),
            legendre(place(k / across, down)),
        );
        OVector::<f64, Const<{ LAMP_TERMS * LAMP_TERMS }>>::from_fn(|i, _| {
            u[i % LAMP_TERMS] * v[i / LAMP_TERMS]
        })
    };
    let mut normal = OMatrix::<
        f64,
        Const<{ LAMP_TERMS * LAMP_TERMS }>,
        Const<{ LAMP_TERMS * LAMP_TERMS }>,
    >::identity();
    let mut right = OVector::<f64, Const<{ LAMP_TERMS * LAMP_TERMS }>>::zeros();
    for (k, (seen, n)) in seen.iter().zip(counts).enumerate() {
        if let Some(seen) = seen {
            let row = powers(k);
            normal.ger(*n, &row, &row, 1.0);
            right.axpy(n * seen, &row, 1.0);
        }
    }
    let solved = normal.cholesky()?.solve(&right);
    Some((0..seen.len()).map(|k| powers(k).dot(&solved)).collect())
}

/// Terms of what lamps light, along columns and rows each: a glow of a fifth of the image is held to a hundredth.
const LAMP_TERMS: usize = 7;

fn legendre(x: f64) -> [f64; LAMP_TERMS] {
    let mut p = [1.0, x, 0.0, 0.0, 0.0, 0.0, 0.0];
    for k in 2..LAMP_TERMS {
        let n = k as f64;
        p[k] = ((2.0 * n - 1.0) * x * p[k - 1] - (n - 1.0) * p[k - 2]) / n;
    }
    p
}

/// Blocks that show nothing, the stripe's, lie on a line between those above and below them.
fn filled(blocks: &[Option<f64>], across: usize) -> Vec<f64> {
    let down = blocks.len() / across.max(1);
    let mut all = vec![0.0; blocks.len()];
    for i in 0..across {
        let seen: Vec<(usize, f64)> = (0..down)
            .filter_map(|j| Some((j, blocks[j * across + i]?)))
            .collect();
        for j in 0..down {
            all[j * across + i] = between(&seen, j);
        }
    }
    all
}

/// A line between the nodes on either side, the last one beyond them.
fn between(nodes: &[(usize, f64)], at: usize) -> f64 {
    let after = nodes.partition_point(|(k, _)| *k < at);
    let before = after.checked_sub(1).and_then(|k| nodes.get(k));
    match (before, nodes.get(after)) {
        (Some((k, a)), Some((l, b))) => a + (b - a) * (at - k) as f64 / (l - k) as f64,
        (Some((_, only)), None) | (None, Some((_, only))) => *only,
        (None, None) => 0.0,
    }
}

/// Least pixels at one level that are a ceiling.
const CEILING_LEAST: u32 = 30;
/// How many times more pixels a ceiling has than the two levels below it together.
const CEILING_TIMES: u32 = 2;

/// Rows above and below a stripe's middle in which it is brightest.
const BRIGHT_ROWS: usize = 3;

/// The level at which the camera cuts off, where the stripe's brightest pixels pile up there: video stops at 235. 255 where
/// they do not.
fn own_ceiling(image: &GreyImage, profile: &Profile) -> u8 {
    let mut counts = [0u32; 256];
    for point in &profile.points {
        let (row, column) = (point.row_px.round(), point.column_px.round());
        let (row, column) = (row.max(0.0) as usize, column.max(0.0) as usize);
        for row in row.saturating_sub(BRIGHT_ROWS)..=row + BRIGHT_ROWS {
            if let Some(grey) = image.pixels.get(row * image.width_px + column) {
                counts[usize::from(*grey)] += 1;
            }
        }
    }
    let Some(brightest) = counts.iter().rposition(|n| *n > 0) else {
        return u8::MAX;
    };
    let below: u32 = counts[brightest.saturating_sub(2)..brightest].iter().sum();
    if counts[brightest] >= CEILING_LEAST && counts[brightest] > CEILING_TIMES * below {
        brightest as u8
    } else {
        u8::MAX
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(of: impl Fn(usize, usize) -> f64) -> GreyImage {
        let (width_px, height_px) = (200, 150);
        let level = |k: usize| of(k / width_px, k % width_px).round().clamp(0.0, 255.0) as u8;
        GreyImage {
            width_px,
            height_px,
            pixels: (0..width_px * height_px).map(level).collect(),
        }
    }

    fn stripe_at(row_px: f64) -> Profile {
        let point = |column: usize| hydroline_stripe::StripePoint {
            column_px: column as f64,
            row_px,
            peak: 100.0,
            sd_px: 0.05,
            sigma_px: 2.0,
            quality: 0,
        };
        Profile {
            points: (0..200).map(point).collect(),
            ..Profile::default()
        }
    }

    /// Noise of a standard deviation of about one, the same every time.
    fn noise(row: usize, column: usize) -> f64 {
        let x = ((row * 7919 + column * 104_729) as f64 * 0.618_034).fract();
        3.46 * (x - 0.5)
    }

    #[test]
    fn an_even_dark_is_even() {
        let image = image(|r, c| 12.0 + noise(r, c) + if r.abs_diff(75) < 4 { 150.0 } else { 0.0 });
        assert!(Picture::of(&image, &stripe_at(75.0), 254).uneven.is_none());
    }

    #[test]
    fn flicker_is_found_by_rows_and_a_lamp_by_blocks() {
        let band = |row: usize| 5.0 * (row as f64 / 90.0 * std::f64::consts::TAU).sin();
        let lamp = |row: usize, column: usize| {
            let off = (row as f64 - 60.0).hypot(column as f64 - 80.0);
            6.0 * (-0.5 * (off / 60.0).powi(2)).exp()
        };
        let image = image(|r, c| 20.0 + band(r) + lamp(r, c) + noise(r, c));
        let picture = Picture::of(&image, &stripe_at(110.0), 254);
        let uneven = picture.uneven.unwrap();
        for row in 30..80 {
            for column in (24..176).step_by(8) {
                let (by, _) = uneven.along(column, row, row + 1);
                let seen = picture.dark + uneven.rows.level[row] + by;
                let off = seen - 20.0 - band(row) - lamp(row, column);
                assert!(off.abs() < 0.5, "{row} {column}: {off}");
            }
        }
    }

    #[test]
    fn a_ceiling_is_where_pixels_pile_up() {
        let clipped =
            image(|r, c| (16.0 + noise(r, c) + if r == 75 { 400.0 } else { 0.0 }).min(235.0));
        assert_eq!(Picture::of(&clipped, &stripe_at(75.0), 254).ceiling, 235);
        let bright = image(|r, c| 16.0 + noise(r, c) + if r == 75 { 180.0 } else { 0.0 });
        assert_eq!(Picture::of(&bright, &stripe_at(75.0), 254).ceiling, 254);
    }
}
