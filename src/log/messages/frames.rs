//! Frames to image and FrameInfo messages and back.

use bytes::Bytes;
use hydroline_rigs::PixelFormat;

use super::encodings::{READ, compression, encoded, encoding};
use super::{
    CAMERA_FRAME, CompressedImage, FrameInfo, RawImage, Stamped, foxglove_time, timestamp,
};
use hydroline_core::frame::{
    Frame, FrameFault, FrameMeta, LossBefore, StampClock, StampSource, still_size,
};

/// The image part of a frame.
#[derive(Debug, Clone, PartialEq)]
pub enum ImageMessage {
    /// Pixels as they come from the camera; [`encoding`] names them.
    Raw(RawImage),
    /// MJPG as `jpeg`, PNG as `png`.
    Compressed(CompressedImage),
}

/// Reason why an image message cannot become a frame.
#[derive(Debug, thiserror::Error, PartialEq)]
#[allow(missing_docs)] // Each message names its fields.
pub enum ImageError {
    #[error("image encoding `{0}`; hydroline reads {READ}")]
    Encoding(String),
}

/// The image message of a frame: same bytes, `timestamp` = mid-exposure.
pub fn image_message(frame: &Frame) -> ImageMessage {
    let timestamp = Some(foxglove_time(frame.meta.mid_exposure_ns));
    let frame_id = CAMERA_FRAME.to_owned();
    if frame.format.is_compressed() {
        return ImageMessage::Compressed(CompressedImage {
            timestamp,
            frame_id,
            data: frame.data.clone(),
            format: encoding(frame.format).to_owned(),
        });
    }
    ImageMessage::Raw(RawImage {
        timestamp,
        frame_id,
        width: frame.width_px,
        height: frame.height_px,
        encoding: encoding(frame.format).to_owned(),
        step: frame.stride_bytes,
        data: frame.data.clone(),
    })
}

/// Everything about a frame but its pixels; `frame_index` counts frames received by the daemon.
pub fn frame_info(frame: &Frame, frame_index: u64) -> FrameInfo {
    let meta = &frame.meta;
    FrameInfo {
        timestamp: Some(timestamp(meta.mid_exposure_ns)),
        sequence: meta.sequence,
        driver_stamp_ns: meta.driver_stamp_ns,
        driver_clock: stamp_clock_name(meta.stamp_clock).to_owned(),
        stamp_source: stamp_source_name(meta.stamp_source).to_owned(),
        v4l2_flags: meta.flags,
        received_monotonic_ns: meta.received_monotonic_ns,
        exposure_s: meta.exposure_s,
        fault: meta.fault.map_or("", fault_name).to_owned(),
        sequence_gap_before: meta.lost_before.sequence_gap,
        time_gap_before: meta.lost_before.time_gap,
        bytes_used: u32::try_from(frame.data.len()).unwrap_or(u32::MAX),
        frame_index,
        width_px: frame.width_px,
        height_px: frame.height_px,
        stride_bytes: frame.stride_bytes,
        pixel_format: format_name(frame.format),
    }
}

/// A frame from its image and, where the log has one, its [`FrameInfo`].
///
/// Without an info (logs made elsewhere) the stamp is taken as mid-exposure on the UNIX scale;
/// `sequence` and `fallback_ns` (the MCAP record's) stand in for what the image does not say.
///
/// # Errors
/// An encoding that is not read.
pub fn frame_from(
    image: ImageMessage,
    info: Option<&FrameInfo>,
    sequence: u32,
    fallback_ns: u64,
) -> Result<Frame, ImageError> {
    let (format, width_px, height_px, stride_bytes, data, stamp_ns) = match image {
        ImageMessage::Raw(raw) => {
            let stamp = raw.stamp_ns().unwrap_or(fallback_ns);
            let format = encoded(&raw.encoding).ok_or(ImageError::Encoding(raw.encoding))?;
            (format, raw.width, raw.height, raw.step, raw.data, stamp)
        }
        ImageMessage::Compressed(image) => compressed_parts(image, info, fallback_ns)?,
    };
    let meta = match info {
        Some(info) => meta_from(info, stamp_ns),
        None => FrameMeta::at(sequence, stamp_ns),
    };
    Ok(Frame {
        format,
        width_px,
        height_px,
        stride_bytes,
        data,
        meta,
    })
}

type ImageParts = (PixelFormat, u32, u32, u32, Bytes, u64);

fn compressed_parts(
    image: CompressedImage,
    info: Option<&FrameInfo>,
    fallback_ns: u64,
) -> Result<ImageParts, ImageError> {
    let stamp = image.stamp_ns().unwrap_or(fallback_ns);
    let format = compression(&image.format).ok_or(ImageError::Encoding(image.format))?;
    let (w, h) = match info {
        Some(info) if info.width_px > 0 => (info.width_px, info.height_px),
        // An image whose head is damaged is a frame still: one that does not decode, and is counted as one.
        _ => still_size(&image.data, format).unwrap_or((0, 0)),
    };
    Ok((format, w, h, 0, image.data, stamp))
}

fn meta_from(info: &FrameInfo, stamp_ns: u64) -> FrameMeta {
    FrameMeta {
        sequence: info.sequence,
        driver_stamp_ns: info.driver_stamp_ns,
        stamp_clock: match info.driver_clock.as_str() {
            "monotonic" => StampClock::Monotonic,
            "copy" => StampClock::Copy,
            "realtime" => StampClock::Realtime,
            _ => StampClock::Unknown,
        },
        stamp_source: match info.stamp_source.as_str() {
            "end_of_frame" => StampSource::EndOfFrame,
            "start_of_exposure" => StampSource::StartOfExposure,
            _ => StampSource::MidExposure,
        },
        flags: info.v4l2_flags,
        received_monotonic_ns: info.received_monotonic_ns,
        mid_exposure_ns: info.stamp_ns().unwrap_or(stamp_ns),
        exposure_s: info.exposure_s,
        fault: match info.fault.as_str() {
            "" => None,
            "truncated" => Some(FrameFault::Truncated),
            "broken_jpeg" => Some(FrameFault::BrokenJpeg),
            "stale" => Some(FrameFault::Stale),
            // A word from a newer writer still means: excluded from analysis.
            _ => Some(FrameFault::DriverError),
        },
        lost_before: LossBefore {
            sequence_gap: info.sequence_gap_before,
            time_gap: info.time_gap_before,
        },
    }
}

/// Name of a stamp's clock in the log.
pub fn stamp_clock_name(clock: StampClock) -> &'static str {
    match clock {
        StampClock::Unknown => "unknown",
        StampClock::Monotonic => "monotonic",
        StampClock::Copy => "copy",
        StampClock::Realtime => "realtime",
    }
}

/// Name of a stamp's event in the log.
pub fn stamp_source_name(source: StampSource) -> &'static str {
    match source {
        StampSource::EndOfFrame => "end_of_frame",
        StampSource::StartOfExposure => "start_of_exposure",
        StampSource::MidExposure => "mid_exposure",
    }
}

/// Name of a frame's fault in the log.
pub fn fault_name(fault: FrameFault) -> &'static str {
    match fault {
        FrameFault::DriverError => "driver_error",
        FrameFault::Truncated => "truncated",
        FrameFault::BrokenJpeg => "broken_jpeg",
        FrameFault::Stale => "stale",
    }
}

/// V4L2's four characters, without the spaces at their end.
pub fn format_name(format: PixelFormat) -> String {
    String::from_utf8_lossy(&format.fourcc())
        .trim_end()
        .to_owned()
}
