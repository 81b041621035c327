//! JPEG and PNG to grey levels: frames of cameras and logs, and image files.

use std::io::Cursor;

use image::{DynamicImage, ImageFormat, ImageReader};

use super::clipping::{HiddenClipping, worst};
use super::grey::{full_scale, level, luma};
use super::{COMPRESSED_MAX_PX, Channel, Frame, FrameError, GreyImage, GreyRule, PixelFormat};

/// Why an image file has no grey levels.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
#[allow(missing_docs)] // Each message names its fields.
pub enum StillError {
    /// Neither PNG nor JPEG, or damaged.
    #[error("{0}; PNG (8 or 16 bit) and JPEG are read")]
    Decode(String),
    #[error("an image of {0} x {1} pixels; at most {COMPRESSED_MAX_PX} in all are unpacked")]
    TooLarge(u32, u32),
}

/// The grey levels of an image file's bytes, PNG or JPEG as they say themselves.
///
/// # Errors
/// [`StillError`].
pub fn read_still(bytes: &[u8], rule: &GreyRule) -> Result<GreyImage, StillError> {
    Ok(grey(decoded(bytes)?, rule))
}

/// Clipping that the luma of an image file does not show; `None` where there is none, or a channel is read as it is.
///
/// # Errors
/// [`StillError`].
pub fn hidden_in_still(
    bytes: &[u8],
    rule: &GreyRule,
) -> Result<Option<HiddenClipping>, StillError> {
    if rule.channel != Channel::Luma {
        return Ok(None);
    }
    let image = decoded(bytes)?;
    if !image.color().has_color() {
        return Ok(None);
    }
    worst(rule, |rule| Ok(grey(image.clone(), rule)))
}

fn decoded(bytes: &[u8]) -> Result<DynamicImage, StillError> {
    let reader = || {
        ImageReader::new(Cursor::new(bytes))
            .with_guessed_format()
            .map_err(|e| StillError::Decode(e.to_string()))
    };
    let words = |e: image::ImageError| StillError::Decode(e.to_string());
    // The header first: a few bytes can claim any size.
    let (w, h) = reader()?.into_dimensions().map_err(words)?;
    if u64::from(w) * u64::from(h) > COMPRESSED_MAX_PX {
        return Err(StillError::TooLarge(w, h));
    }
    reader()?.decode().map_err(words)
}

/// The format that an image file's bytes say they have.
pub fn still_format(bytes: &[u8]) -> Option<PixelFormat> {
    match image::guess_format(bytes) {
        Ok(ImageFormat::Png) => Some(PixelFormat::Png),
        Ok(ImageFormat::Jpeg) => Some(PixelFormat::Mjpg),
        _ => None,
    }
}

/// Width and height that an image file's head states \[px\].
pub fn still_size(bytes: &[u8]) -> Option<(u32, u32)> {
    let reader = ImageReader::new(Cursor::new(bytes));
    reader.with_guessed_format().ok()?.into_dimensions().ok()
}

/// The grey levels of a compressed frame.
pub(super) fn of_frame(frame: &Frame, rule: &GreyRule) -> Result<GreyImage, FrameError> {
    let sequence = frame.meta.sequence;
    let (kind, format) = match frame.format {
        PixelFormat::Png => (ImageFormat::Png, "PNG"),
        _ => (ImageFormat::Jpeg, "JPEG"),
    };
    let failed = |e: image::ImageError| FrameError::Undecodable {
        sequence,
        format,
        reason: e.to_string(),
    };
    let reader = || ImageReader::with_format(Cursor::new(&frame.data), kind);
    // The header first: what it claims is held against what was negotiated before anything is unpacked.
    let got = reader().into_dimensions().map_err(failed)?;
    let wanted = (frame.width_px, frame.height_px);
    if got != wanted {
        return Err(FrameError::CompressedSize {
            sequence,
            format,
            got,
            wanted,
        });
    }
    if u64::from(got.0) * u64::from(got.1) > COMPRESSED_MAX_PX {
        return Err(FrameError::TooLarge { sequence, got });
    }
    Ok(grey(reader().decode().map_err(failed)?, rule))
}

/// The grey levels of a decoded image. Without colours every channel is the same.
fn grey(image: DynamicImage, rule: &GreyRule) -> GreyImage {
    let (width_px, height_px) = (image.width() as usize, image.height() as usize);
    let wide = image.color().bytes_per_pixel() / image.color().channel_count() == 2;
    let colour = image.color().has_color();
    let max = full_scale(rule.bits_of(PixelFormat::Png));
    let pixels = match (wide, colour && rule.channel != Channel::Luma) {
        (false, false) => image.into_luma8().into_raw(),
        (true, false) if max == u16::MAX => image.into_luma8().into_raw(),
        (false, true) => {
            let rgb = image.into_rgb8();
            rgb.pixels()
                .map(|p| pick(p.0, rule.channel) as u8)
                .collect()
        }
        (true, false) if !colour => {
            let samples = image.into_luma16();
            samples.pixels().map(|p| level(p.0[0], max)).collect()
        }
        (true, _) => {
            let rgb = image.into_rgb16();
            let of = |p: &image::Rgb<u16>| {
                level(pick(p.0.map(|s| s.min(max)), rule.channel) as u16, max)
            };
            rgb.pixels().map(of).collect()
        }
    };
    GreyImage {
        width_px,
        height_px,
        pixels,
    }
}

fn pick<T: Into<u32>>([red, green, blue]: [T; 3], channel: Channel) -> u32 {
    match channel {
        Channel::Luma => luma(red, green, blue),
        Channel::Red => red.into(),
        Channel::Green => green.into(),
        Channel::Blue => blue.into(),
    }
}
