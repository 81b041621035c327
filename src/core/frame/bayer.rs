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
    let mosaic = Mosaic::new(rows, wide, max);
    let mut pixels = Vec::with_capacity(rows.width * rows.height);
    let mut colours: [Vec<u32>; 3] = std::array::from_fn(|_| vec![0; rows.width]);
    let rounded = |quarters: u32| level(((quarters + QUARTERS / 2) / QUARTERS) as u16, max);
    for row in 0..rows.height {
        let mut colour = |of: usize| mosaic.colour(of, order, row, &mut colours[of]);
        match channel {
            Channel::Luma => [RED, GREEN, BLUE].into_iter().for_each(&mut colour),
            Channel::Red => colour(RED),
            Channel::Green => colour(GREEN),
            Channel::Blue => colour(BLUE),
        }
        let [red, green, blue] = &colours;
        match channel {
            Channel::Luma => {
                let both = red.iter().zip(green).zip(blue);
                pixels.extend(both.map(|((r, g), b)| rounded(luma(*r, *g, *b))));
            }
            Channel::Red => pixels.extend(red.iter().map(|q| rounded(*q))),
            Channel::Green => pixels.extend(green.iter().map(|q| rounded(*q))),
            Channel::Blue => pixels.extend(blue.iter().map(|q| rounded(*q))),
        }
    }
    pixels
}

/// The samples with a border of one pixel, mirrored about the outermost.
struct Mosaic {
    samples: Vec<u16>,
    stride: usize,
}

/// Where a pixel finds a colour.
#[derive(Clone, Copy)]
enum Neighbours {
    /// In itself.
    Own,
    /// Left and right.
    Across,
    /// Above and below.
    Along,
    /// In the four corners.
    Corners,
    /// On the four sides.
    Sides,
}

impl Mosaic {
    fn new(rows: &Rows<'_>, wide: bool, max: u16) -> Self {
        let (width, height) = (rows.width, rows.height);
        let stride = width + 2;
        let mut all = Vec::with_capacity(stride * (height + 2));
        // Row 1 stands above row 0, the last but one below the last.
        let inner = 0..height;
        for row in [1].into_iter().chain(inner).chain([height - 2]) {
            let start = all.len();
            all.push(0);
            if wide {
                all.extend(samples(rows.row(row)).map(|s| s.min(max)));
            } else {
                all.extend(rows.row(row).iter().map(|s| u16::from(*s)));
            }
            all[start] = all[start + 2];
            all.push(all[start + width - 1]);
        }
        Self {
            samples: all,
            stride,
        }
    }

    /// A row of a colour at full resolution, in quarters of a sample.
    fn colour(&self, colour: usize, order: BayerOrder, row: usize, into: &mut [u32]) {
        let (red_row, red_column) = order.red_at();
        for first in [0, 1] {
            // Where these columns stand against the samples of red.
            let same_row = (row + red_row).is_multiple_of(2);
            let same_column = first == red_column;
            let (same_row, same_column) = match colour {
                RED | GREEN => (same_row, same_column),
                _ => (!same_row, !same_column),
            };
            let neighbours = match (colour, same_row, same_column) {
                (GREEN, row, column) if row != column => Neighbours::Own,
                (GREEN, ..) => Neighbours::Sides,
                (_, true, true) => Neighbours::Own,
                (_, true, false) => Neighbours::Across,
                (_, false, true) => Neighbours::Along,
                (_, false, false) => Neighbours::Corners,
            };
            self.fill(neighbours, row, first, into);
        }
    }

    /// Every second pixel of a row.
    fn fill(&self, neighbours: Neighbours, row: usize, first: usize, into: &mut [u32]) {
        let line = |k: usize| &self.samples[(row + k) * self.stride..(row + k + 1) * self.stride];
        let (above, here, below) = (line(0), line(1), line(2));
        let sum = |a: u16, b: u16| u32::from(a) + u32::from(b);
        let columns = (first..into.len()).step_by(2);
        // Column c of the image is c + 1 of the bordered row.
        match neighbours {
            Neighbours::Own => columns.for_each(|c| into[c] = QUARTERS * u32::from(here[c + 1])),
            Neighbours::Across => columns.for_each(|c| into[c] = 2 * sum(here[c], here[c + 2])),
            Neighbours::Along => {
                columns.for_each(|c| into[c] = 2 * sum(above[c + 1], below[c + 1]))
            }
            Neighbours::Corners => columns.for_each(|c| {
                into[c] = sum(above[c], above[c + 2]) + sum(below[c], below[c + 2]);
            }),
            Neighbours::Sides => columns.for_each(|c| {
                into[c] = sum(here[c], here[c + 2]) + sum(above[c + 1], below[c + 1]);
            }),
        }
    }
}
