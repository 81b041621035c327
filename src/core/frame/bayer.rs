//! A colour filter's mosaic to one channel at full resolution.
//!
//! Missing samples are the mean of their nearest neighbours of the same colour (bilinear), which stand evenly around
//! them: rows and columns stay where they are. At the border the image is mirrored about its outermost pixels, which
//! keeps every colour in its place. Luma is Rec. 709's weighting of the three.

use super::grey::{Rows, level, luma, samples};
use super::{BayerOrder, Channel};

/// Colours' places in a pixel's triple.
const RED: usize = 0;
const GREEN: usize = 1;
const BLUE: usize = 2;

/// Sums of neighbours in quarters of a sample.
const QUARTERS: u32 = 4;

/// The pixels of a channel; `wide` = samples of 16 bits, `max` = full scale. The image has at least 2 x 2 pixels.
pub(super) fn pixels(
    rows: &Rows<'_>,
    order: BayerOrder,
    wide: bool,
    max: u16,
    channel: Channel,
) -> Vec<u8> {
    let (width, height) = (rows.width, rows.height);
    let read = |row: usize, into: &mut Vec<u32>| {
        into.clear();
        if wide {
            into.extend(samples(rows.row(row)).map(|s| u32::from(s.min(max))));
        } else {
            into.extend(rows.row(row).iter().map(|s| u32::from(*s)));
        }
    };
    let mut lines: [Vec<u32>; 3] = Default::default();
    let mut pixels = Vec::with_capacity(width * height);
    for row in 0..height {
        let (above, below) = mirrored(row, height);
        for (line, at) in lines.iter_mut().zip([above, row, below]) {
            read(at, line);
        }
        let block = Block {
            lines: &lines,
            red_at: order.red_at(),
            row,
        };
        for column in 0..width {
            let quarters = match channel {
                Channel::Red => block.colour(RED, column),
                Channel::Green => block.colour(GREEN, column),
                Channel::Blue => block.colour(BLUE, column),
                Channel::Luma => luma(
                    block.colour(RED, column),
                    block.colour(GREEN, column),
                    block.colour(BLUE, column),
                ),
            };
            let sample = (quarters + QUARTERS / 2) / QUARTERS;
            pixels.push(level(sample as u16, max));
        }
    }
    pixels
}

/// The neighbours before and after, mirrored about the outermost.
fn mirrored(at: usize, size: usize) -> (usize, usize) {
    let before = if at == 0 { 1 } else { at - 1 };
    let after = if at + 1 == size {
        at.saturating_sub(1)
    } else {
        at + 1
    };
    (before, after)
}

struct Block<'a> {
    /// The rows above, of and below the pixel.
    lines: &'a [Vec<u32>; 3],
    red_at: (usize, usize),
    row: usize,
}

impl Block<'_> {
    /// A colour at a pixel of this row, in quarters of a sample.
    fn colour(&self, colour: usize, column: usize) -> u32 {
        let [above, here, below] = self.lines;
        let (left, right) = mirrored(column, here.len());
        // Where the pixel stands against the samples of red.
        let of_red = |size: usize, red: usize| (size + red).is_multiple_of(2);
        let (red_row, red_column) = (
            of_red(self.row, self.red_at.0),
            of_red(column, self.red_at.1),
        );
        let (same_row, same_column) = match colour {
            GREEN if red_row != red_column => return QUARTERS * here[column],
            GREEN => return here[left] + here[right] + above[column] + below[column],
            RED => (red_row, red_column),
            _ => (!red_row, !red_column),
        };
        match (same_row, same_column) {
            (true, true) => QUARTERS * here[column],
            (true, false) => 2 * (here[left] + here[right]),
            (false, true) => 2 * (above[column] + below[column]),
            (false, false) => above[left] + above[right] + below[left] + below[right],
        }
    }
}
