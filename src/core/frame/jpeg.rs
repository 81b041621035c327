//! Whether a JPEG is whole: its coded data are decoded to the last block (ITU-T T.81), without making pixels of them.
//!
//! Decoders of images go on where data are missing and fill in what they have: a stripe in such an image lies
//! elsewhere. Here every code must be one of its table, every block must end where it should, and after the last one
//! nothing may be left. JPEG has no checksum: a bit of a coefficient's value that is another leaves all of this as it
//! is. Of these, values beyond what 8 bits can show are found here, and blocks that do not fit their neighbours in
//! [`super::seams`].

mod bits;
mod huffman;
mod picture;
mod progressive;
mod scan;
#[cfg(test)]
mod tests;

use std::borrow::Cow;

use picture::Picture;

/// Why a JPEG is no whole image.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum JpegDamage {
    #[error("it does not begin with a start marker (ff d8)")]
    NoStart,
    #[error("it ends after {bytes} bytes without its end marker (ff d9)")]
    NoEnd { bytes: usize },
    #[error("{what} (byte {at})")]
    Segment { at: usize, what: &'static str },
    #[error(
        "its coding (marker ff {marker:02x}) is not read; baseline and progressive Huffman coding of 8 bits are"
    )]
    Coding { marker: u8 },
    #[error("its coded data break off in block group {mcu} of {mcus} (byte {at}): {what}")]
    Data {
        at: usize,
        mcu: u64,
        mcus: u64,
        what: &'static str,
    },
    #[error(
        "after the last of {mcus} block groups {bytes} bytes are left over (byte {at}): some are missing or changed before"
    )]
    LeftOver { at: usize, mcus: u64, bytes: usize },
    #[error(
        "the block at column {column_px}, row {row_px} does not fit its neighbours, and would with one of its values changed by {change} levels"
    )]
    Block {
        column_px: usize,
        row_px: usize,
        /// Change of a coefficient.
        change: i32,
    },
    #[error(
        "the block at column {column_px}, row {row_px} goes on from none of its neighbours: its coded data have changed"
    )]
    Foreign { column_px: usize, row_px: usize },
    #[error(
        "from the block at column {column_px}, row {row_px} on everything is {levels} levels off: a value in its coded data has changed"
    )]
    Step {
        column_px: usize,
        row_px: usize,
        /// Brighter by so much, or darker.
        levels: i32,
    },
}

impl JpegDamage {
    /// First pixel of the block whose seams look like damage, column and row \[px\] of the stored image; `None` = the data
    /// themselves are damaged.
    pub fn block_px(&self) -> Option<(usize, usize)> {
        match *self {
            JpegDamage::Block {
                column_px, row_px, ..
            }
            | JpegDamage::Foreign { column_px, row_px }
            | JpegDamage::Step {
                column_px, row_px, ..
            } => Some((column_px, row_px)),
            _ => None,
        }
    }
}

/// Blocks of 8 x 8 pixels of the first component, as they lie in the image and follow each other in its data.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Grid {
    /// Steps of quantization by row and column of a frequency.
    pub steps: [u16; 64],
    /// Blocks across and down in a group.
    pub group: [usize; 2],
    /// Groups after which values begin anew; 0 = never.
    pub interval: usize,
}

/// A JPEG that was found whole.
#[derive(Debug, Clone, PartialEq)]
pub struct WholeJpeg<'a> {
    data: &'a [u8],
    lacks_tables: bool,
    /// Blocks of the brightness in the image; `None` where they are not of full resolution.
    pub(super) grid: Option<Grid>,
}

impl<'a> WholeJpeg<'a> {
    /// Reads all of it.
    ///
    /// # Errors
    /// [`JpegDamage`].
    pub fn of(data: &'a [u8]) -> Result<Self, JpegDamage> {
        let picture = read(data)?;
        Ok(WholeJpeg {
            data,
            lacks_tables: picture.lacks_tables,
            grid: picture.grid(),
        })
    }

    /// Its bytes, with the standard Huffman tables where it leaves them out, as MJPEG may.
    pub fn with_tables(&self) -> Cow<'a, [u8]> {
        if !self.lacks_tables {
            return Cow::Borrowed(self.data);
        }
        // Right after the start marker: tables that the file does state come later and hold.
        let (start, rest) = self.data.split_at(2);
        Cow::Owned([start, &huffman::standard_segment(), rest].concat())
    }
}

/// Markers of T.81, table B.1.
mod marker {
    pub const SOF0: u8 = 0xc0;
    pub const SOF2: u8 = 0xc2;
    pub const SOF3: u8 = 0xc3;
    pub const DHT: u8 = 0xc4;
    pub const SOF5: u8 = 0xc5;
    pub const SOF15: u8 = 0xcf;
    pub const RST0: u8 = 0xd0;
    pub const EOI: u8 = 0xd9;
    pub const SOS: u8 = 0xda;
    pub const DQT: u8 = 0xdb;
    pub const DRI: u8 = 0xdd;
    pub const APP0: u8 = 0xe0;
    pub const APP15: u8 = 0xef;
    pub const COM: u8 = 0xfe;
}

/// Next marker at or after a place, and the place after it. Fill bytes (ff) may stand before it, nothing else.
fn next_marker(data: &[u8], from: usize) -> Result<(u8, usize), JpegDamage> {
    let mut at = from;
    let bytes = data.len();
    if *data.get(at).ok_or(JpegDamage::NoEnd { bytes })? != 0xff {
        let what = "bytes that belong to no segment";
        return Err(JpegDamage::Segment { at, what });
    }
    while data.get(at) == Some(&0xff) {
        at += 1;
    }
    let marker = *data.get(at).ok_or(JpegDamage::NoEnd { bytes })?;
    Ok((marker, at + 1))
}

/// Body of the segment whose length stands at a place.
fn segment(data: &[u8], at: usize) -> Result<&[u8], JpegDamage> {
    let bytes = data.len();
    let Some(&[high, low]) = data.get(at..at + 2) else {
        return Err(JpegDamage::NoEnd { bytes });
    };
    let length = usize::from(u16::from_be_bytes([high, low]));
    if length < 2 {
        let what = "a segment shorter than its own length";
        return Err(JpegDamage::Segment { at, what });
    }
    data.get(at + 2..at + length)
        .ok_or(JpegDamage::NoEnd { bytes })
}

fn read(data: &[u8]) -> Result<Picture, JpegDamage> {
    if !data.starts_with(&[0xff, 0xd8]) {
        return Err(JpegDamage::NoStart);
    }
    let mut picture = Picture::default();
    let mut at = 2;
    loop {
        let (marker, body_at) = next_marker(data, at)?;
        let wrong = |what| JpegDamage::Segment { at, what };
        if marker == marker::EOI {
            return picture.ended().map_err(wrong).map(|()| picture);
        }
        let is_known = matches!(
            marker,
            marker::SOF0..=marker::SOF15
                | marker::SOS
                | marker::DQT
                | marker::DRI
                | marker::APP0..=marker::APP15
                | marker::COM
        );
        if !is_known {
            return Err(wrong("a marker that has no place here"));
        }
        let body = segment(data, body_at)?;
        let after = body_at + 2 + body.len();
        match marker {
            marker::SOF0..=marker::SOF2 => {
                picture.frame(body, marker == marker::SOF2).map_err(wrong)?
            }
            marker::DHT => picture.huffman(body).map_err(wrong)?,
            marker::DQT => picture.quantizers(body).map_err(wrong)?,
            marker::DRI => picture.restarts(body).map_err(wrong)?,
            marker::SOF3 | marker::SOF5..=marker::SOF15 => {
                return Err(JpegDamage::Coding { marker });
            }
            marker::SOS => {
                let scan = picture.scan(body).map_err(wrong)?;
                at = picture.decode(&scan, data, after)?;
                continue;
            }
            _ => {}
        }
        at = after;
    }
}
