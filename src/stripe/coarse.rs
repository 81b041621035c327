//! Where a stripe may be: blocks of four rows, compared with the blocks beside them.
//!
//! The whole frame is read once, in bytes, four rows at a time; the averages are
//! `pavgb` instructions after auto-vectorisation. A block pair brighter than the blocks two
//! beyond it on either side (a top-hat minus its surroundings, 8 px against ±12 px) is a
//! candidate where it is a local maximum down the column.

use hydroline_core::frame::GreyView;
use wide::u8x16;

/// Rows per block.
pub(super) const BLOCK_ROWS: usize = 4;
/// Most candidates kept in a column: the strongest.
pub(super) const MAX_PER_COLUMN: usize = 12;
/// Columns compared at once; lines of the search are padded to a multiple of it.
const CHUNK: usize = 16;

/// A place where a stripe may be.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Spot {
    /// Row, good to about 1 px.
    pub row_px: f32,
    /// Contrast: half the block pair's excess over its surroundings \[grey levels\]; 0 = ruled
    /// out, not on the stripe.
    pub contrast: u8,
}

/// Candidates of all columns.
#[derive(Debug, Clone, Default)]
pub(super) struct Spots {
    slots: Vec<[Spot; MAX_PER_COLUMN]>,
    counts: Vec<u8>,
}

impl Spots {
    pub fn clear(&mut self, columns: usize) {
        self.slots
            .resize(columns, [Spot::default(); MAX_PER_COLUMN]);
        self.counts.clear();
        self.counts.resize(columns, 0);
    }

    /// Candidates of one column, from top to bottom.
    pub fn column(&self, column: usize) -> &[Spot] {
        match (self.slots.get(column), self.counts.get(column)) {
            (Some(slots), Some(&count)) => &slots[..usize::from(count)],
            _ => &[],
        }
    }

    /// Adds a spot below all earlier ones of its column; of spots closer than two blocks
    /// (one stripe seen twice) and of too many, the weaker goes.
    #[inline(always)]
    pub(super) fn push(&mut self, column: usize, spot: Spot) {
        if let (Some(slots), Some(count @ 0)) =
            (self.slots.get_mut(column), self.counts.get_mut(column))
        {
            slots[0] = spot;
            *count = 1;
        } else {
            self.push_another(column, spot);
        }
    }

    /// Marks a candidate as not on the stripe.
    pub fn rule_out(&mut self, column: usize, spot: usize) {
        if let Some(spot) = self.slots.get_mut(column).and_then(|s| s.get_mut(spot)) {
            spot.contrast = 0;
        }
    }

    fn push_another(&mut self, column: usize, spot: Spot) {
        let count = usize::from(self.counts[column]);
        let slots = &mut self.slots[column];
        if let Some(last) = slots[..count].last_mut()
            && spot.row_px - last.row_px < (2 * BLOCK_ROWS) as f32
        {
            if spot.contrast > last.contrast {
                *last = spot;
            }
            return;
        }
        if count < MAX_PER_COLUMN {
            slots[count] = spot;
            self.counts[column] += 1;
            return;
        }
        let weakest = (0..MAX_PER_COLUMN)
            .min_by_key(|&i| slots[i].contrast)
            .unwrap_or(0);
        if spot.contrast > slots[weakest].contrast {
            slots.copy_within(weakest + 1.., weakest);
            slots[MAX_PER_COLUMN - 1] = spot;
        }
    }
}

/// Contrast below which noise makes candidates \[halved grey levels, as [`Spot::contrast`]\].
///
/// Noise of a block average is n/2, of a pair against its surroundings, halved, n/2 again;
/// 5.5 sd leaves 0.002 false spots in the 100 000 places of a frame.
pub(super) fn threshold(noise_sd: f64) -> u8 {
    (5.5 * noise_sd / 2.0).ceil().clamp(4.0, 250.0) as u8
}

/// Rounded average of two bytes; compiles to `pavgb`.
#[inline]
fn average(a: u8, b: u8) -> u8 {
    ((u16::from(a) + u16::from(b) + 1) >> 1) as u8
}

#[derive(Debug, Clone, Default)]
pub(super) struct CoarseScratch {
    blocks: Vec<u8>,
    contrast: [Vec<u8>; 3],
}

/// Part of an image to search: columns `from..to`, blocks `first..=last`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Tile {
    pub from: usize,
    pub to: usize,
    pub first: usize,
    pub last: usize,
}

/// Adds the candidates of `tile` to `spots`. What it finds at a place does not depend on the tile.
pub(super) fn search(
    image: GreyView<'_>,
    tile: Tile,
    threshold: u8,
    scratch: &mut CoarseScratch,
    spots: &mut Spots,
) {
    let width = tile.to.saturating_sub(tile.from);
    search_lines(image, tile, width, threshold, scratch, spots);
}

#[inline(always)]
fn search_lines(
    image: GreyView<'_>,
    tile: Tile,
    width: usize,
    threshold: u8,
    scratch: &mut CoarseScratch,
    spots: &mut Spots,
) {
    let blocks = image.height_px / BLOCK_ROWS;
    if blocks == 0 || width == 0 || tile.first > tile.last || tile.last >= blocks {
        return;
    }
    // The local maximum needs the contrast of one block more, the contrast two and three more.
    let stride = width.next_multiple_of(CHUNK);
    let low = tile.first.saturating_sub(3);
    let high = (tile.last + 4).min(blocks - 1);
    scratch
        .blocks
        .resize(((high - low + 1) * stride).max(scratch.blocks.len()), 0);
    for (block, out) in (low..=high).zip(scratch.blocks.chunks_exact_mut(stride)) {
        let start = block * BLOCK_ROWS * image.width_px + tile.from;
        let row = |i: usize| &image.pixels[start + i * image.width_px..][..width];
        average_rows(&mut out[..width], [row(0), row(1), row(2), row(3)]);
    }
    let line = |block: usize| {
        let block = block.clamp(low, high) - low;
        &scratch.blocks[block * stride..][..stride]
    };
    for c in &mut scratch.contrast {
        c.resize(stride.max(c.len()), 0);
    }
    let [before, here, after] = &mut scratch.contrast;
    let fill = |out: &mut [u8], block: usize| {
        contrast_line(
            &mut out[..stride],
            [
                line(block.saturating_sub(2)),
                line(block),
                line(block + 1),
                line(block + 3),
            ],
        );
    };
    if tile.first > 0 {
        fill(before, tile.first - 1);
    } else {
        before.fill(0);
    }
    fill(here, tile.first);
    for block in tile.first..=tile.last {
        if block + 1 < blocks {
            fill(after, block + 1);
        } else {
            after.fill(0);
        }
        let near = [
            line(block.saturating_sub(1)),
            line(block),
            line(block + 1),
            line(block + 2),
        ];
        let lines = [&before[..stride], &here[..stride], &after[..stride]];
        for_each_peak(lines, width, threshold, |column, contrast| {
            let row_px = centre_of_blocks(block, near.map(|line| line[column]));
            spots.push(tile.from + column, Spot { row_px, contrast });
        });
        std::mem::swap(before, here);
        std::mem::swap(here, after);
    }
}

fn average_rows(out: &mut [u8], [a, b, c, d]: [&[u8]; 4]) {
    for ((((o, a), b), c), d) in out.iter_mut().zip(a).zip(b).zip(c).zip(d) {
        *o = average(average(*a, *b), average(*c, *d));
    }
}

fn contrast_line(out: &mut [u8], [above, upper, lower, below]: [&[u8]; 4]) {
    for ((((o, a), u), l), b) in out.iter_mut().zip(above).zip(upper).zip(lower).zip(below) {
        *o = average(*u, *l).saturating_sub(average(*a, *b));
    }
}

/// Calls `found` for every column whose contrast is a maximum of the three and over the threshold.
/// The lines are whole vectors; of what lies beyond `width` nothing is said.
#[inline(always)]
fn for_each_peak(lines: [&[u8]; 3], width: usize, threshold: u8, mut found: impl FnMut(usize, u8)) {
    let least = u8x16::splat(threshold);
    let [before, here, after] = lines.map(|line| line.as_chunks::<CHUNK>().0);
    for (index, ((h, b), a)) in here.iter().zip(before).zip(after).enumerate() {
        let [hs, bs, as_] = [h, b, a].map(|line| u8x16::new(*line));
        let over = hs.max(least).simd_eq(hs) & hs.max(bs).simd_eq(hs);
        let mut peaks = (over & !hs.max(as_).simd_eq(as_)).to_bitmask();
        while peaks != 0 {
            let i = peaks.trailing_zeros() as usize % CHUNK;
            peaks &= peaks - 1;
            let column = index * CHUNK + i;
            if column < width {
                found(column, h[i]);
            }
        }
    }
}

/// Centre of gravity of four blocks above the darker of the outer two \[px\].
#[inline(always)]
fn centre_of_blocks(second: usize, b: [u8; 4]) -> f32 {
    let floor = i32::from(b[0].min(b[3]));
    // Neither inner block is darker than both outer ones where the contrast is over a threshold;
    // if rounding makes one so, it counts as nothing.
    let [p, q, r, s] = b.map(|v| (i32::from(v) - floor).max(0));
    let blocks = BLOCK_ROWS as f32;
    let offset = (r + 2 * s - p) as f32 / (p + q + r + s).max(1) as f32;
    // Middle of block `second`: its first row + 1.5.
    (second as i32 as f32 + offset) * blocks + 0.5 * (blocks - 1.0)
}

#[cfg(test)]
mod tests {
    /// Columns of a tile.
    const TILE_COLUMNS: usize = 32;

    use super::*;
    use crate::synthetic::{StripeImage, render};
    use hydroline_core::frame::GreyImage;

    fn whole(image: &GreyImage) -> Tile {
        Tile {
            from: 0,
            to: image.width_px,
            first: 0,
            last: image.height_px / BLOCK_ROWS - 1,
        }
    }

    #[test]
    fn finds_every_column_of_a_stripe_and_nothing_else() {
        for (sigma, peak, noise) in [
            (1.0, 60.0, 4.0),
            (2.0, 60.0, 4.0),
            (3.0, 200.0, 2.0),
            (6.0, 100.0, 2.0),
        ] {
            let stripe = StripeImage {
                sigma_px: sigma,
                peak,
                noise_sd: noise,
                slope: 0.3,
                width_px: 400,
                ..Default::default()
            };
            let image = render(&stripe);
            let mut spots = Spots::default();
            spots.clear(image.width_px);
            search(
                (&image).into(),
                whole(&image),
                threshold(noise),
                &mut CoarseScratch::default(),
                &mut spots,
            );
            for c in 0..image.width_px {
                let found = spots.column(c);
                assert_eq!(found.len(), 1, "sigma {sigma}, column {c}: {found:?}");
                let off = f64::from(found[0].row_px) - stripe.row_px(c as f64);
                assert!(off.abs() < 2.0, "sigma {sigma}, column {c}: off by {off}");
            }
        }
    }

    #[test]
    fn a_tile_finds_what_the_whole_finds() {
        let image = render(&StripeImage {
            slope: 0.2,
            noise_sd: 4.0,
            ..Default::default()
        });
        let (mut all, mut part) = (Spots::default(), Spots::default());
        all.clear(image.width_px);
        part.clear(image.width_px);
        let mut scratch = CoarseScratch::default();
        search((&image).into(), whole(&image), 8, &mut scratch, &mut all);
        for from in (0..image.width_px).step_by(TILE_COLUMNS) {
            let to = (from + TILE_COLUMNS).min(image.width_px);
            search(
                (&image).into(),
                Tile {
                    from,
                    to,
                    first: 65,
                    last: 115,
                },
                8,
                &mut scratch,
                &mut part,
            );
        }
        for c in 0..image.width_px {
            let inside: Vec<Spot> = all
                .column(c)
                .iter()
                .copied()
                .filter(|s| (270.0..450.0).contains(&s.row_px))
                .collect();
            assert_eq!(part.column(c), inside, "column {c}");
        }
    }

    #[test]
    fn too_many_spots_keep_the_strongest_in_order() {
        let mut spots = Spots::default();
        spots.clear(1);
        let all: Vec<u8> = (0..MAX_PER_COLUMN as u8 + 2).map(|i| 10 * i + 20).collect();
        let mut given = all.clone();
        given.swap(0, 3);
        for (i, contrast) in given.into_iter().enumerate() {
            spots.push(
                0,
                Spot {
                    row_px: 20.0 * i as f32,
                    contrast,
                },
            );
        }
        let kept: Vec<u8> = spots.column(0).iter().map(|s| s.contrast).collect();
        let mut strongest = all[2..].to_vec();
        // The fourth strongest came first.
        strongest.remove(1);
        strongest.insert(0, 50);
        assert_eq!(kept, strongest);
    }
}
