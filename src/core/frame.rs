//! A camera frame with everything that is known about when it was true.

mod bayer;
mod clipping;
mod grey;
mod jpeg;
mod picture_blocks;
mod seams;
mod still;
#[cfg(test)]
mod tests;
mod yuv;

use bytes::Bytes;
pub use clipping::{ClippingWatch, HiddenClipping};
pub use hydroline_rigs::{BayerDepth, BayerOrder, Channel, GreyRule, PixelFormat, YuvRange};
pub use jpeg::{JpegDamage, WholeJpeg};
pub use picture_blocks::{BlockAccount, BlockAccountOptions, PictureBlocks};
pub use still::{
    InspectedImage, StillError, hidden_in_still, inspect_still, read_still, still_format,
    still_size,
};

/// Clock of a driver's stamp (V4L2_BUF_FLAG_TIMESTAMP_*).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StampClock {
    /// The driver does not say.
    Unknown,
    /// The kernel's CLOCK_MONOTONIC.
    Monotonic,
    /// Copied from an output buffer.
    Copy,
    /// UNIX time (simulator, log).
    Realtime,
}

/// Event a driver's stamp refers to (V4L2_BUF_FLAG_TSTAMP_SRC_*).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StampSource {
    /// End of frame.
    EndOfFrame,
    /// Start of exposure.
    StartOfExposure,
    /// Middle of the exposure (simulator, log).
    MidExposure,
}

/// Why a frame is kept but excluded from analysis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameFault {
    /// Marked as damaged by the driver (V4L2_BUF_FLAG_ERROR).
    DriverError,
    /// Fewer bytes than the format needs.
    Truncated,
    /// MJPG that is not whole ([`WholeJpeg`]).
    BrokenJpeg,
    /// Among the first buffers after STREAMON, or repeated content: may be stale.
    Stale,
}

impl FrameFault {
    /// Whether something of the frame is missing or changed: of all but a stale one.
    pub fn is_damage(self) -> bool {
        self != FrameFault::Stale
    }
}

/// Frames that were lost just before this one, by how the loss was noticed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LossBefore {
    /// Gap in the driver's sequence numbers.
    pub sequence_gap: u32,
    /// Missing periods in the stamps where the sequence shows no gap (device-side drops).
    pub time_gap: u32,
}

/// Metadata of a frame: number, stamps, exposure and faults.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameMeta {
    /// The driver's sequence number.
    pub sequence: u32,
    /// The driver's stamp, raw, on `stamp_clock` \[ns\].
    pub driver_stamp_ns: u64,
    /// Clock of that stamp.
    pub stamp_clock: StampClock,
    /// Event of that stamp.
    pub stamp_source: StampSource,
    /// Raw V4L2 buffer flags; 0 for other sources.
    pub flags: u32,
    /// CLOCK_MONOTONIC when the frame reached us \[ns\].
    pub received_monotonic_ns: u64,
    /// Mid-exposure, UNIX \[ns\]: when the frame was true.
    pub mid_exposure_ns: u64,
    /// Exposure time \[s\]; 0 = not known.
    pub exposure_s: f64,
    /// Set when the frame is excluded from analysis.
    pub fault: Option<FrameFault>,
    /// Losses noticed just before this frame.
    pub lost_before: LossBefore,
}

impl FrameMeta {
    /// Of a frame of which only number and time are known: mid-exposure, UNIX \[ns\].
    pub fn at(sequence: u32, mid_exposure_ns: u64) -> Self {
        FrameMeta {
            sequence,
            driver_stamp_ns: mid_exposure_ns,
            stamp_clock: StampClock::Realtime,
            stamp_source: StampSource::MidExposure,
            flags: 0,
            received_monotonic_ns: 0,
            mid_exposure_ns,
            exposure_s: 0.0,
            fault: None,
            lost_before: LossBefore::default(),
        }
    }
}

/// One frame. Cheap to clone: the pixels are shared.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Pixel format of `data`.
    pub format: PixelFormat,
    /// Width \[px\].
    pub width_px: u32,
    /// Height \[px\].
    pub height_px: u32,
    /// Bytes per row as negotiated; 0 for compressed formats.
    pub stride_bytes: u32,
    /// The bytes as delivered, cut to `bytesused`.
    pub data: Bytes,
    /// When, from whom, how sound.
    pub meta: FrameMeta,
}

/// An 8-bit grey image, row-major without padding: what the stripe extractor reads.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GreyImage {
    /// Width \[px\].
    pub width_px: usize,
    /// Height \[px\].
    pub height_px: usize,
    /// `width_px * height_px` grey levels.
    pub pixels: Vec<u8>,
}

/// An 8-bit grey image that lies in somebody else's memory, as in [`GreyImage`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GreyView<'a> {
    /// Width \[px\].
    pub width_px: usize,
    /// Height \[px\].
    pub height_px: usize,
    /// `width_px * height_px` grey levels.
    pub pixels: &'a [u8],
}

impl<'a> From<&'a GreyImage> for GreyView<'a> {
    fn from(image: &'a GreyImage) -> Self {
        GreyView {
            width_px: image.width_px,
            height_px: image.height_px,
            pixels: &image.pixels,
        }
    }
}

/// Longest side of an image that is believed \[px\]: twice that of the largest sensors of machine vision.
pub const SIDE_MAX_PX: u32 = 1 << 15;
/// Most pixels of a compressed image that are unpacked: a few bytes can claim any number.
pub const COMPRESSED_MAX_PX: u64 = hydroline_rigs::FRAME_BYTES_MAX;

/// Why a frame has no grey image.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum FrameError {
    #[error(
        "frame {sequence}: an image of {width_px} x {height_px} pixels with {stride_bytes} bytes a row; sides of 1 to {SIDE_MAX_PX} are read, of a colour mosaic from 2"
    )]
    Geometry {
        sequence: u32,
        width_px: u32,
        height_px: u32,
        stride_bytes: u32,
    },
    #[error(
        "frame {sequence}: a compressed image of {got:?} pixels; at most {COMPRESSED_MAX_PX} in all are unpacked"
    )]
    TooLarge {
        sequence: u32,
        /// Width, height in the image.
        got: (u32, u32),
    },
    #[error(
        "frame {sequence}: {} {width_px}x{height_px} needs {needed} bytes, got {got}",
        format.name()
    )]
    Short {
        sequence: u32,
        format: PixelFormat,
        width_px: u32,
        height_px: u32,
        needed: u64,
        got: usize,
    },
    #[error("frame {sequence}: damaged JPEG: {damage}")]
    Damaged { sequence: u32, damage: JpegDamage },
    #[error("frame {sequence}: {format} does not decode: {reason}")]
    Undecodable {
        sequence: u32,
        format: &'static str,
        reason: String,
    },
    #[error("frame {sequence}: {format} is {got:?}, negotiated {wanted:?}")]
    CompressedSize {
        sequence: u32,
        format: &'static str,
        /// Width, height in the image.
        got: (u32, u32),
        /// Width, height negotiated.
        wanted: (u32, u32),
    },
}
