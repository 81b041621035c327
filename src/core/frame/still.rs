//! JPEG and PNG to grey levels: frames of cameras and logs, and image files.
//!
//! A damaged image has no grey levels ([`WholeJpeg`]; PNG has checksums; blocks that look like damage, unless
//! [`PictureBlocks`] explain them), and what EXIF says of how the camera was held
//! is heeded, so that rows are rows and columns are columns.

use std::borrow::Cow;
use std::io::Cursor;

use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageError, ImageFormat, ImageReader};

use super::clipping::{HiddenClipping, worst};
use super::grey::{full_scale, level, luma};
use super::jpeg::Grid;
use super::{
    COMPRESSED_MAX_PX, Channel, Frame, FrameError, GreyImage, GreyRule, JpegDamage, PictureBlocks,
    PixelFormat, WholeJpeg, seams,
};

/// Why an image file has no grey levels.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
#[allow(missing_docs)] // Each message names its fields.
pub enum StillError {
    /// Neither PNG nor JPEG, or a damaged PNG.
    #[error("{0}; PNG (8 or 16 bit) and JPEG are read")]
    Decode(String),
    #[error(
        "damaged JPEG, nothing in it is to be trusted: {0}; take the image anew or copy it again"
    )]
    Damaged(#[from] JpegDamage),
    #[error("an image of {0} x {1} pixels; at most {COMPRESSED_MAX_PX} in all are unpacked")]
    TooLarge(u32, u32),
}

impl From<ImageError> for StillError {
    fn from(error: ImageError) -> Self {
        StillError::Decode(error.to_string())
    }
}

/// Grey levels of an image whose data are whole, and what its seams show.
#[derive(Debug, Clone, PartialEq)]
pub struct InspectedImage {
    /// The grey levels.
    pub image: GreyImage,
    /// Blocks that look like damage; empty of anything but a JPEG.
    pub seams: Vec<JpegDamage>,
}

impl InspectedImage {
    /// The grey levels, where no block looks like damage but those of the picture itself.
    ///
    /// # Errors
    /// The first of the others.
    pub fn sound(self, picture: &PictureBlocks) -> Result<GreyImage, JpegDamage> {
        let mut seams = self.seams.into_iter();
        match seams.find(|damage| !picture.explains(damage)) {
            Some(damage) => Err(damage),
            None => Ok(self.image),
        }
    }
}

/// The grey levels of an image file's bytes, PNG or JPEG as they say themselves.
///
/// # Errors
/// [`StillError`].
pub fn read_still(bytes: &[u8], rule: &GreyRule) -> Result<GreyImage, StillError> {
    Ok(inspect_still(bytes, rule)?.sound(&PictureBlocks::default())?)
}

/// The same, with blocks that look like damage beside it.
///
/// # Errors
/// [`StillError`], not for blocks.
pub fn inspect_still(bytes: &[u8], rule: &GreyRule) -> Result<InspectedImage, StillError> {
    Ok(decoded(bytes)?.inspected(rule))
}

/// Clipping that the luma of an image file does not show, whatever its blocks look like; `None` where there is none, or a
/// channel is read as it is.
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
    let image = decoded(bytes)?.upright();
    if !image.color().has_color() {
        return Ok(None);
    }
    hidden(&image, rule)
}

/// The same of a compressed frame, decoded once for all channels.
pub(super) fn hidden_in_frame(
    frame: &Frame,
    rule: &GreyRule,
) -> Result<Option<HiddenClipping>, FrameError> {
    hidden(&frame_decoded(frame)?.upright(), rule)
}

fn hidden<E>(image: &DynamicImage, rule: &GreyRule) -> Result<Option<HiddenClipping>, E> {
    worst(rule, |rule| Ok(grey(image.clone(), rule)))
}

/// An image as it is stored.
struct Decoded {
    image: DynamicImage,
    turned: Orientation,
    /// Grid of a JPEG's blocks, where they lie on the image's own.
    grid: Option<Grid>,
}

impl Decoded {
    fn upright(self) -> DynamicImage {
        let mut image = self.image;
        image.apply_orientation(self.turned);
        image
    }

    fn inspected(self, rule: &GreyRule) -> InspectedImage {
        let seams = self.grid.as_ref().map_or_else(Vec::new, |grid| {
            let grey = self.image.to_luma8();
            seams::flagged(grey.as_raw(), grey.width() as usize, grid)
        });
        let image = grey(self.upright(), rule);
        InspectedImage { image, seams }
    }
}

fn decoded(bytes: &[u8]) -> Result<Decoded, StillError> {
    let kind = image::guess_format(bytes)?;
    // The header first: a few bytes can claim any size.
    let Head { size_px, turned } = head(bytes, kind).map_err(|e| unread(bytes, kind, e))?;
    let (w, h) = size_px;
    if u64::from(w) * u64::from(h) > COMPRESSED_MAX_PX {
        return Err(StillError::TooLarge(w, h));
    }
    unpacked(bytes, kind, turned)
}

/// Size as an image is stored \[px\], and the turn that makes it upright.
struct Head {
    size_px: (u32, u32),
    turned: Orientation,
}

impl Head {
    /// Width and height of the upright image \[px\].
    fn upright(&self) -> (u32, u32) {
        let (w, h) = self.size_px;
        match self.turned {
            Orientation::Rotate90
            | Orientation::Rotate270
            | Orientation::Rotate90FlipH
            | Orientation::Rotate270FlipH => (h, w),
            _ => (w, h),
        }
    }
}

fn head(bytes: &[u8], kind: ImageFormat) -> Result<Head, ImageError> {
    let mut decoder = ImageReader::with_format(Cursor::new(bytes), kind).into_decoder()?;
    Ok(Head {
        size_px: decoder.dimensions(),
        // EXIF that cannot be read says nothing.
        turned: decoder.orientation().unwrap_or(Orientation::NoTransforms),
    })
}

/// Why an image's head cannot be read: where it is a JPEG, its damage.
fn unread(bytes: &[u8], kind: ImageFormat, error: ImageError) -> StillError {
    match kind {
        ImageFormat::Jpeg => WholeJpeg::of(bytes).map_or_else(Into::into, |_| error.into()),
        _ => error.into(),
    }
}

/// Pixels of an image that is whole: the one place where JPEG and PNG are decoded.
fn unpacked(bytes: &[u8], kind: ImageFormat, turned: Orientation) -> Result<Decoded, StillError> {
    let jpeg = match kind {
        ImageFormat::Jpeg => Some(WholeJpeg::of(bytes)?),
        _ => None,
    };
    let bytes = jpeg
        .as_ref()
        .map_or(Cow::Borrowed(bytes), WholeJpeg::with_tables);
    let image = ImageReader::with_format(Cursor::new(&bytes), kind).decode()?;
    let grid = jpeg.and_then(|jpeg| jpeg.grid);
    Ok(Decoded {
        image,
        turned,
        grid,
    })
}

/// The format that an image file's bytes say they have.
pub fn still_format(bytes: &[u8]) -> Option<PixelFormat> {
    match image::guess_format(bytes) {
        Ok(ImageFormat::Png) => Some(PixelFormat::Png),
        Ok(ImageFormat::Jpeg) => Some(PixelFormat::Mjpg),
        _ => None,
    }
}

/// The decoder's name of a compressed format, and a person's.
fn kind(format: PixelFormat) -> (ImageFormat, &'static str) {
    match format {
        PixelFormat::Png => (ImageFormat::Png, "PNG"),
        _ => (ImageFormat::Jpeg, "JPEG"),
    }
}

/// Width and height of the upright image that the head of a compressed one states \[px\]; `None` = its head cannot be
/// read.
pub fn still_size(bytes: &[u8], format: PixelFormat) -> Option<(u32, u32)> {
    head(bytes, kind(format).0).ok().map(|head| head.upright())
}

/// The grey levels of a compressed frame, and what its seams show.
pub(super) fn of_frame(frame: &Frame, rule: &GreyRule) -> Result<InspectedImage, FrameError> {
    Ok(frame_decoded(frame)?.inspected(rule))
}

fn frame_decoded(frame: &Frame) -> Result<Decoded, FrameError> {
    let sequence = frame.meta.sequence;
    let (kind, format) = kind(frame.format);
    let failed = |error: StillError| match error {
        StillError::Damaged(damage) => FrameError::Damaged { sequence, damage },
        error => FrameError::Undecodable {
            sequence,
            format,
            reason: error.to_string(),
        },
    };
    // The header first: what it claims is held against what was negotiated before anything is unpacked.
    let head = head(&frame.data, kind).map_err(|e| failed(unread(&frame.data, kind, e)))?;
    let wanted = (frame.width_px, frame.height_px);
    let turned = match head.upright() {
        upright if upright == wanted => head.turned,
        // The size that was negotiated with a camera holds against a turn that it states.
        _ if head.size_px == wanted => Orientation::NoTransforms,
        got => {
            return Err(FrameError::CompressedSize {
                sequence,
                format,
                got,
                wanted,
            });
        }
    };
    if u64::from(wanted.0) * u64::from(wanted.1) > COMPRESSED_MAX_PX {
        return Err(FrameError::TooLarge {
            sequence,
            got: head.size_px,
        });
    }
    unpacked(&frame.data, kind, turned).map_err(failed)
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
