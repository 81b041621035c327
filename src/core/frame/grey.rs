//! Grey levels out of a frame's bytes: the one place where formats become what stripe and pose read.
//!
//! Samples of more than 8 bits are rounded to the nearest of 256 levels, full scale to 255. What is lost is the rounding,
//! evenly spread over a level: 1/sqrt(12) = 0.29 levels of standard deviation, beside the read noise of 1 to 3 of a camera.

use super::{
    Channel, Frame, FrameError, GreyImage, GreyRule, InspectedImage, PictureBlocks, PixelFormat,
    SIDE_MAX_PX, bayer, still, yuv,
};

/// A sample of `max` at most as one of 256 levels, rounded; what is beyond `max` is clipped.
pub(super) fn level(sample: u16, max: u16) -> u8 {
    let max = u32::from(max).max(1);
    ((u32::from(sample).min(max) * 255 + max / 2) / max) as u8
}

/// The largest sample of so many bits.
pub(super) fn full_scale(bits: u8) -> u16 {
    u16::MAX >> (16 - bits.clamp(1, 16))
}

/// Brightness of red, green and blue: Rec. 709's weights, rounded, as the decoder of JPEG and PNG makes it.
pub(super) fn luma<T: Into<u32>>(red: T, green: T, blue: T) -> u32 {
    (2126 * red.into() + 7152 * green.into() + 722 * blue.into() + 5_000) / 10_000
}

/// An uncompressed frame's rows, checked to be there.
pub(super) struct Rows<'a> {
    data: &'a [u8],
    stride: usize,
    row_bytes: usize,
    /// Width \[px\].
    pub width: usize,
    /// Height \[px\].
    pub height: usize,
}

impl<'a> Rows<'a> {
    fn of(frame: &'a Frame) -> Result<Self, FrameError> {
        let (format, sequence) = (frame.format, frame.meta.sequence);
        // A mosaic needs all of its colours.
        let least = match format {
            PixelFormat::Bayer(..) => 2,
            _ => 1,
        };
        let sides = least..=SIDE_MAX_PX;
        // A row may be padded, not endless: sixteen times its pixels is far beyond any alignment.
        let stride_max = SIDE_MAX_PX.saturating_mul(16);
        let (width_px, height_px, stride_bytes) =
            (frame.width_px, frame.height_px, frame.stride_bytes);
        if !sides.contains(&width_px) || !sides.contains(&height_px) || stride_bytes > stride_max {
            return Err(FrameError::Geometry {
                sequence,
                width_px,
                height_px,
                stride_bytes,
            });
        }
        let needed = format.image_bytes(width_px, height_px, stride_bytes);
        if (frame.data.len() as u64) < needed {
            return Err(FrameError::Short {
                sequence,
                format,
                width_px,
                height_px,
                needed,
                got: frame.data.len(),
            });
        }
        // Bounded above: 2^19 bytes a row and 2^16 rows fit a usize of 64 bits with room.
        let row_bytes = format.row_bytes(width_px) as usize;
        Ok(Rows {
            data: &frame.data,
            stride: (stride_bytes as usize).max(row_bytes),
            row_bytes,
            width: width_px as usize,
            height: height_px as usize,
        })
    }

    /// A row of memory without its padding; NV12's chroma stands in the rows below its luma.
    pub fn row(&self, row: usize) -> &'a [u8] {
        let start = row * self.stride;
        &self.data[start..start + self.row_bytes]
    }

    /// Pixels of all rows, row by row.
    pub fn image(&self, mut fill: impl FnMut(&'a [u8], &mut Vec<u8>)) -> Vec<u8> {
        let mut pixels = Vec::with_capacity(self.width * self.height);
        for row in 0..self.height {
            fill(self.row(row), &mut pixels);
        }
        pixels
    }
}

/// Samples of 16 bits, little endian.
pub(super) fn samples(row: &[u8]) -> impl Iterator<Item = u16> + '_ {
    row.chunks_exact(2)
        .map(|b| u16::from_le_bytes([b[0], b[1]]))
}

/// Packed colours of `N` bytes a pixel, red, green and blue at these places of it.
fn packed<const N: usize>(rows: &Rows<'_>, [r, g, b]: [usize; 3], channel: Channel) -> Vec<u8> {
    rows.image(|row, pixels| {
        let (colours, _) = row.as_chunks::<N>();
        match channel {
            Channel::Luma => pixels.extend(colours.iter().map(|c| luma(c[r], c[g], c[b]) as u8)),
            Channel::Red => pixels.extend(colours.iter().map(|c| c[r])),
            Channel::Green => pixels.extend(colours.iter().map(|c| c[g])),
            Channel::Blue => pixels.extend(colours.iter().map(|c| c[b])),
        }
    })
}

impl Frame {
    /// The grey levels of this frame, with blocks that look like damage beside them where it is a JPEG.
    ///
    /// # Errors
    /// As [`Frame::to_grey`], not for blocks.
    pub fn inspect(&self, rule: &GreyRule) -> Result<InspectedImage, FrameError> {
        if self.format.is_compressed() {
            return still::of_frame(self, rule);
        }
        let (image, seams) = (self.to_grey(rule)?, Vec::new());
        Ok(InspectedImage { image, seams })
    }

    /// The grey levels of this frame of a camera whose picture has these blocks.
    ///
    /// # Errors
    /// As [`Frame::to_grey`], for other blocks alone.
    pub fn to_grey_with(
        &self,
        rule: &GreyRule,
        picture: &PictureBlocks,
    ) -> Result<GreyImage, FrameError> {
        let sequence = self.meta.sequence;
        let inspected = self.inspect(rule)?.sound(picture);
        inspected.map_err(|damage| FrameError::Damaged { sequence, damage })
    }

    /// The grey levels of this frame. A camera without colours shows the same in every channel.
    ///
    /// # Errors
    /// When the bytes do not hold an image of the stated size, or a block of it looks like damage.
    pub fn to_grey(&self, rule: &GreyRule) -> Result<GreyImage, FrameError> {
        if self.format.is_compressed() {
            return self.to_grey_with(rule, &PictureBlocks::default());
        }
        let rows = Rows::of(self)?;
        let channel = rule.channel;
        let max = full_scale(rule.bits_of(self.format));
        let pixels = match self.format {
            PixelFormat::Grey => rows.image(|row, pixels| pixels.extend_from_slice(row)),
            PixelFormat::Y10 | PixelFormat::Y12 | PixelFormat::Y16 => rows
                .image(|row, pixels| pixels.extend(samples(row).map(|sample| level(sample, max)))),
            PixelFormat::Yuyv | PixelFormat::Uyvy | PixelFormat::Nv12 => {
                yuv::pixels(&rows, self.format, channel, rule.yuv_range)
            }
            PixelFormat::Rgb24 => packed::<3>(&rows, [0, 1, 2], channel),
            PixelFormat::Bgr24 => packed::<3>(&rows, [2, 1, 0], channel),
            PixelFormat::Rgba32 => packed::<4>(&rows, [0, 1, 2], channel),
            PixelFormat::Bgra32 => packed::<4>(&rows, [2, 1, 0], channel),
            PixelFormat::Bayer(order, _) => {
                bayer::pixels(&rows, order, self.format.bits() > 8, max, channel)
            }
            // Decoded above.
            PixelFormat::Mjpg | PixelFormat::Png => Vec::new(),
        };
        Ok(GreyImage {
            width_px: rows.width,
            height_px: rows.height,
            pixels,
        })
    }
}
