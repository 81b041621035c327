//! Luma and chroma of Y'CbCr frames to one channel.
//!
//! Luma is the camera's own, as it stands in the bytes. A channel is BT.601's, over the levels that the rig names. Chroma
//! of 4:2:2 stands with the first column of a pair, chroma of 4:2:0 midway between its two rows (ITU-T H.264, Annex E,
//! type 0): in between it is interpolated, so that a line of pure colour keeps its row.

use super::grey::Rows;
use super::{Channel, PixelFormat, YuvRange};

/// BT.601: red is Y' + 1.402 Cr, blue Y' + 1.772 Cb, green what is left of the weights 0.299, 0.587, 0.114.
const RED_CR: f32 = 1.402;
const BLUE_CB: f32 = 1.772;
const GREEN_CB: f32 = -0.114 * 1.772 / 0.587;
const GREEN_CR: f32 = -0.299 * 1.402 / 0.587;

/// Cb and Cr about their middle.
type Chroma = [f32; 2];

pub(super) fn pixels(
    rows: &Rows<'_>,
    format: PixelFormat,
    channel: Channel,
    range: YuvRange,
) -> Vec<u8> {
    if channel == Channel::Luma {
        return rows.image(|row, pixels| match format {
            PixelFormat::Yuyv => pixels.extend(row.iter().step_by(2)),
            PixelFormat::Uyvy => pixels.extend(row.iter().skip(1).step_by(2)),
            _ => pixels.extend_from_slice(&row[..rows.width]),
        });
    }
    let mut pixels = Vec::with_capacity(rows.width * rows.height);
    let mut chroma = Vec::with_capacity(rows.width);
    for row in 0..rows.height {
        let bytes = rows.row(row);
        // Luma's first byte, and how far it is to the next.
        let (first, step) = match format {
            PixelFormat::Yuyv => (0, 2),
            PixelFormat::Uyvy => (1, 2),
            _ => (0, 1),
        };
        let luma = bytes.iter().copied().skip(first).step_by(step);
        chroma.clear();
        match format {
            PixelFormat::Yuyv => between(rows.width, &mut chroma, |k| packed(bytes, 4 * k + 1)),
            PixelFormat::Uyvy => between(rows.width, &mut chroma, |k| packed(bytes, 4 * k)),
            _ => {
                // Of row 2k three quarters of k and one of k - 1; of row 2k + 1 one of k + 1.
                let last = rows.height.div_ceil(2) - 1;
                let near = row / 2;
                let far = if row.is_multiple_of(2) {
                    near.saturating_sub(1)
                } else {
                    (near + 1).min(last)
                };
                let [near, far] = [near, far].map(|k| rows.row(rows.height + k));
                between(rows.width, &mut chroma, |k| {
                    let (a, b) = (planar(near, k), planar(far, k));
                    [0, 1].map(|i| 0.75 * a[i] + 0.25 * b[i])
                });
            }
        }
        pixels.extend(
            luma.zip(&chroma)
                .map(|(y, c)| convert(y, *c, channel, range)),
        );
    }
    pixels
}

/// Chroma of every column from that of every pair: it stands with the pair's first column.
fn between(width: usize, chroma: &mut Vec<Chroma>, of: impl Fn(usize) -> Chroma) {
    let last = width.div_ceil(2) - 1;
    let mut here = of(0);
    for k in 0..=last {
        let next = if k < last { of(k + 1) } else { here };
        chroma.push(here);
        if 2 * k + 1 < width {
            chroma.push([0, 1].map(|i| 0.5 * (here[i] + next[i])));
        }
        here = next;
    }
}

/// 4:2:2: Cb stands at this byte, Cr two further; the last pixel of an odd width has none, and borrows its neighbour's.
fn packed(row: &[u8], cb_at: usize) -> Chroma {
    let cr_at = match cb_at + 2 {
        at if at < row.len() => Some(at),
        at => at.checked_sub(4),
    };
    let level = |at: Option<usize>| at.and_then(|at| row.get(at)).map_or(0.0, centred);
    [level(Some(cb_at)), level(cr_at)]
}

/// 4:2:0: pairs of Cb and Cr.
fn planar(row: &[u8], k: usize) -> Chroma {
    [2 * k, 2 * k + 1].map(|at| row.get(at).map_or(0.0, centred))
}

fn centred(byte: &u8) -> f32 {
    f32::from(*byte) - 128.0
}

fn convert(luma: u8, [cb, cr]: Chroma, channel: Channel, range: YuvRange) -> u8 {
    // Limited: luma over 219 levels from 16, chroma over 224 about 128.
    let (y, scale) = match range {
        YuvRange::Limited => ((f32::from(luma) - 16.0) * (255.0 / 219.0), 255.0 / 224.0),
        YuvRange::Full => (f32::from(luma), 1.0),
    };
    let value = match channel {
        Channel::Luma => y,
        Channel::Red => y + scale * RED_CR * cr,
        Channel::Green => y + scale * (GREEN_CB * cb + GREEN_CR * cr),
        Channel::Blue => y + scale * BLUE_CB * cb,
    };
    value.round().clamp(0.0, 255.0) as u8
}
