//! The log's messages and the way from our own types to them and back, bit by bit.
//!
//! `hydroline.*` comes from `hydroline.proto`; `foxglove.*` from the foxglove crate, whose
//! messages are prost messages and therefore decode as well as they encode.

use bytes::Bytes;
pub use foxglove::messages::{
    CameraCalibration, CompressedImage, ImageAnnotations, Log, PoseInFrame, RawImage,
};
use hydroline_rigs::PixelFormat;
use prost_types::Timestamp;

use crate::clock::ClockTriple;
use crate::event::{Event, Severity};
use crate::frame::{Frame, FrameFault, FrameMeta, LossBefore, StampClock, StampSource};

/// Generated from `hydroline.proto`.
#[allow(missing_docs, clippy::all)]
pub mod pb {
    include!(concat!(env!("OUT_DIR"), "/hydroline.rs"));
}

pub use pb::{
    ClockPair, ControllerClock, FrameInfo, PlaneCalibration, StripeProfile, ThrusterCommand,
    ThrusterEcho, VehicleMotion,
};

/// Coordinate frame of everything the camera sees, as viewers name it.
pub const CAMERA_FRAME: &str = "camera_optical";
/// The tank frame (Z down, floor at 0), as viewers name it.
pub const TANK_FRAME: &str = "tank";

const NS: u64 = 1_000_000_000;

/// UNIX nanoseconds as a protobuf timestamp.
pub fn timestamp(unix_ns: u64) -> Timestamp {
    Timestamp {
        seconds: (unix_ns / NS) as i64,
        nanos: (unix_ns % NS) as i32,
    }
}

/// A protobuf timestamp as UNIX nanoseconds; times before 1970 give 0.
pub fn unix_ns(t: &Timestamp) -> u64 {
    let ns = i128::from(t.seconds) * i128::from(NS) + i128::from(t.nanos);
    ns.clamp(0, i128::from(u64::MAX)) as u64
}

/// UNIX nanoseconds in Foxglove's timestamp (32-bit seconds: good until 2106).
pub fn foxglove_time(unix_ns: u64) -> foxglove::messages::Timestamp {
    let sec = u32::try_from(unix_ns / NS).unwrap_or(u32::MAX);
    foxglove::messages::Timestamp::new(sec, (unix_ns % NS) as u32)
}

/// Foxglove's timestamp as UNIX nanoseconds.
pub fn foxglove_ns(t: &foxglove::messages::Timestamp) -> u64 {
    u64::from(t.sec()) * NS + u64::from(t.nsec())
}

/// A message that says when it was true.
pub trait Stamped {
    /// UNIX \[ns\]; `None` when the message does not say.
    fn stamp_ns(&self) -> Option<u64>;
}

macro_rules! stamped {
    ($convert:expr => $($message:ty),+) => {
        $(impl Stamped for $message {
            fn stamp_ns(&self) -> Option<u64> {
                self.timestamp.as_ref().map($convert)
            }
        })+
    };
}
stamped!(unix_ns => ThrusterCommand, ThrusterEcho, VehicleMotion, FrameInfo, ClockPair, pb::Event,
    StripeProfile, PlaneCalibration);
stamped!(foxglove_ns => RawImage, CompressedImage, CameraCalibration, ImageAnnotations, PoseInFrame, Log);

/// The image part of a frame.
#[derive(Debug, Clone, PartialEq)]
pub enum ImageMessage {
    /// GREY as `mono8`, YUYV as `yuyv`.
    Raw(RawImage),
    /// MJPG as `jpeg`.
    Compressed(CompressedImage),
}

/// Why an image message cannot become a frame.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum ImageError {
    /// An encoding we do not read.
    #[error("image encoding `{0}`; hydroline reads mono8, 8UC1, yuyv, yuv422_yuy2, jpeg and png")]
    Encoding(String),
    /// The compressed image's header does not decode.
    #[error("{format} image of {bytes} bytes does not decode: {reason}")]
    Decode {
        /// Format as named in the message.
        format: String,
        /// Size of the data.
        bytes: usize,
        /// Decoder's words.
        reason: String,
    },
}

/// The image message of a frame: same bytes, `timestamp` = mid-exposure.
pub fn image_message(frame: &Frame) -> ImageMessage {
    let timestamp = Some(foxglove_time(frame.meta.mid_exposure_ns));
    let frame_id = CAMERA_FRAME.to_owned();
    let encoding = match frame.format {
        PixelFormat::Grey => "mono8",
        PixelFormat::Yuyv => "yuyv",
        PixelFormat::Mjpg => {
            let data = frame.data.clone();
            return ImageMessage::Compressed(CompressedImage {
                timestamp,
                frame_id,
                data,
                format: "jpeg".to_owned(),
            });
        }
    };
    ImageMessage::Raw(RawImage {
        timestamp,
        frame_id,
        width: frame.width_px,
        height: frame.height_px,
        encoding: encoding.to_owned(),
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
        pixel_format: format_name(frame.format).to_owned(),
    }
}

/// A frame from its image and, where the log has one, its [`FrameInfo`].
///
/// Without an info (logs made elsewhere) the stamp is taken as mid-exposure on the UNIX scale;
/// `sequence` and `fallback_ns` (the MCAP record's) stand in for what the image does not say.
///
/// # Errors
/// An encoding that is not read, or a compressed image whose size cannot be told.
pub fn frame_from(
    image: ImageMessage,
    info: Option<&FrameInfo>,
    sequence: u32,
    fallback_ns: u64,
) -> Result<Frame, ImageError> {
    let (format, width_px, height_px, stride_bytes, data, stamp_ns) = match image {
        ImageMessage::Raw(raw) => {
            let stamp = raw.stamp_ns().unwrap_or(fallback_ns);
            let format = match raw.encoding.as_str() {
                "mono8" | "8UC1" => PixelFormat::Grey,
                "yuyv" | "yuv422_yuy2" => PixelFormat::Yuyv,
                _ => return Err(ImageError::Encoding(raw.encoding)),
            };
            (format, raw.width, raw.height, raw.step, raw.data, stamp)
        }
        ImageMessage::Compressed(image) => compressed_parts(image, info, fallback_ns)?,
    };
    let meta = match info {
        Some(info) => meta_from(info, stamp_ns),
        None => FrameMeta {
            sequence,
            driver_stamp_ns: stamp_ns,
            stamp_clock: StampClock::Realtime,
            stamp_source: StampSource::MidExposure,
            flags: 0,
            received_monotonic_ns: 0,
            mid_exposure_ns: stamp_ns,
            exposure_s: 0.0,
            fault: None,
            lost_before: LossBefore::default(),
        },
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
    let failed = |reason: String| ImageError::Decode {
        format: image.format.clone(),
        bytes: image.data.len(),
        reason,
    };
    match image.format.as_str() {
        "jpeg" | "jpg" => {
            let (w, h) = match info {
                Some(info) if info.width_px > 0 => (info.width_px, info.height_px),
                _ => image::ImageReader::with_format(
                    std::io::Cursor::new(&image.data),
                    image::ImageFormat::Jpeg,
                )
                .into_dimensions()
                .map_err(|e| failed(e.to_string()))?,
            };
            Ok((PixelFormat::Mjpg, w, h, 0, image.data, stamp))
        }
        "png" => {
            // The decoder's own limit (512 MiB) keeps a forged header from exhausting memory.
            let grey = image::load_from_memory_with_format(&image.data, image::ImageFormat::Png)
                .map_err(|e| failed(e.to_string()))?
                .into_luma8();
            let (w, h) = grey.dimensions();
            Ok((
                PixelFormat::Grey,
                w,
                h,
                w,
                Bytes::from(grey.into_raw()),
                stamp,
            ))
        }
        other => Err(ImageError::Encoding(other.to_owned())),
    }
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

/// V4L2 four-character code.
pub fn format_name(format: PixelFormat) -> &'static str {
    match format {
        PixelFormat::Grey => "GREY",
        PixelFormat::Yuyv => "YUYV",
        PixelFormat::Mjpg => "MJPG",
    }
}

/// An event as a message.
pub fn event_message(event: &Event) -> pb::Event {
    let severity = match event.severity {
        Severity::Info => pb::event::Severity::Info,
        Severity::Warning => pb::event::Severity::Warning,
        Severity::Error => pb::event::Severity::Error,
    };
    pb::Event {
        timestamp: Some(timestamp(event.timestamp_ns)),
        severity: severity.into(),
        kind: event.kind.to_owned(),
        message: event.message.clone(),
        values: event
            .values
            .iter()
            .map(|(k, v)| ((*k).to_owned(), *v))
            .collect(),
    }
}

/// Severity of a logged event; an unknown number counts as an error.
pub fn event_severity(event: &pb::Event) -> Severity {
    match pb::event::Severity::try_from(event.severity) {
        Ok(pb::event::Severity::Info) => Severity::Info,
        Ok(pb::event::Severity::Warning) => Severity::Warning,
        Ok(pb::event::Severity::Error) | Err(_) => Severity::Error,
    }
}

/// The clocks, with the controller's where the link has one.
pub fn clock_message(clocks: &ClockTriple, controller: Option<ControllerClock>) -> ClockPair {
    ClockPair {
        timestamp: Some(timestamp(clocks.realtime_ns)),
        monotonic_ns: clocks.monotonic_ns,
        realtime_ns: clocks.realtime_ns,
        boottime_ns: clocks.boottime_ns,
        bracket_ns: clocks.bracket_ns,
        controller,
    }
}

/// The clocks as read back.
pub fn clock_triple(message: &ClockPair) -> ClockTriple {
    ClockTriple {
        monotonic_ns: message.monotonic_ns,
        realtime_ns: message.realtime_ns,
        boottime_ns: message.boottime_ns,
        bracket_ns: message.bracket_ns,
    }
}

/// The rig's pinhole as viewers read it. Pixel origin = centre of the top left pixel, as in OpenCV's K.
pub fn camera_calibration(camera: &hydroline_rigs::Camera, unix_ns: u64) -> CameraCalibration {
    let (fx, fy, cx, cy) = (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px);
    CameraCalibration {
        timestamp: Some(foxglove_time(unix_ns)),
        frame_id: CAMERA_FRAME.to_owned(),
        width: camera.width_px,
        height: camera.height_px,
        distortion_model: "plumb_bob".to_owned(),
        d: vec![0.0; 5],
        k: vec![fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        r: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: vec![fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    }
}

/// The stripe drawn over the image: points at ours + 0.5, because Foxglove's origin is the outer
/// corner of the top left pixel and ours its centre.
pub fn stripe_annotations(profile: &StripeProfile) -> ImageAnnotations {
    use foxglove::messages as fg;
    let points = profile
        .column_px
        .iter()
        .zip(&profile.row_px)
        .map(|(c, r)| fg::Point2 {
            x: f64::from(*c) + 0.5,
            y: f64::from(*r) + 0.5,
        })
        .collect();
    let stamp = profile.stamp_ns().map(foxglove_time);
    ImageAnnotations {
        timestamp: stamp,
        points: vec![fg::PointsAnnotation {
            timestamp: stamp,
            r#type: fg::points_annotation::Type::Points.into(),
            points,
            outline_color: Some(fg::Color {
                r: 1.0,
                g: 0.2,
                b: 0.2,
                a: 1.0,
            }),
            thickness: 1.0,
            ..Default::default()
        }],
        ..Default::default()
    }
}

/// A measured pose for viewers; `None` unless all six coordinates were measured.
///
/// Z-Y-X Euler angles (Fossen 2011, Eq. 2.18: R = Rz(psi) Ry(theta) Rx(phi)) to a unit quaternion.
pub fn pose_message(motion: &VehicleMotion) -> Option<PoseInFrame> {
    use foxglove::messages as fg;
    let (phi, theta, psi) = (motion.phi_rad?, motion.theta_rad?, motion.psi_rad?);
    let q = nalgebra::UnitQuaternion::from_euler_angles(phi, theta, psi);
    Some(PoseInFrame {
        timestamp: motion.stamp_ns().map(foxglove_time),
        frame_id: TANK_FRAME.to_owned(),
        pose: Some(fg::Pose {
            position: Some(fg::Vector3 {
                x: motion.x_m?,
                y: motion.y_m?,
                z: motion.z_m?,
            }),
            orientation: Some(fg::Quaternion {
                x: q.i,
                y: q.j,
                z: q.k,
                w: q.w,
            }),
        }),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use prost::Message;

    fn frames() -> impl Strategy<Value = Frame> {
        let format = prop::sample::select(vec![
            PixelFormat::Grey,
            PixelFormat::Yuyv,
            PixelFormat::Mjpg,
        ]);
        let clock = prop::sample::select(vec![
            StampClock::Unknown,
            StampClock::Monotonic,
            StampClock::Copy,
            StampClock::Realtime,
        ]);
        let source = prop::sample::select(vec![
            StampSource::EndOfFrame,
            StampSource::StartOfExposure,
            StampSource::MidExposure,
        ]);
        let fault = prop::sample::select(vec![
            None,
            Some(FrameFault::DriverError),
            Some(FrameFault::Truncated),
            Some(FrameFault::BrokenJpeg),
            Some(FrameFault::Stale),
        ]);
        let shape = (
            format,
            any::<u32>(),
            any::<u32>(),
            any::<u32>(),
            prop::collection::vec(any::<u8>(), 0..600),
        );
        let stamps = (
            any::<u32>(),
            any::<u64>(),
            any::<u64>(),
            0..u64::from(u32::MAX) * NS,
            0.0f64..10.0,
        );
        let marks = (
            clock,
            source,
            any::<u32>(),
            fault,
            any::<u32>(),
            any::<u32>(),
        );
        (shape, stamps, marks).prop_map(|(shape, stamps, marks)| Frame {
            format: shape.0,
            // A JPEG always has a size; 0 would mean "not told".
            width_px: shape.1.max(1),
            height_px: shape.2,
            stride_bytes: if shape.0 == PixelFormat::Mjpg {
                0
            } else {
                shape.3
            },
            data: shape.4.into(),
            meta: FrameMeta {
                sequence: stamps.0,
                driver_stamp_ns: stamps.1,
                received_monotonic_ns: stamps.2,
                mid_exposure_ns: stamps.3,
                exposure_s: stamps.4,
                stamp_clock: marks.0,
                stamp_source: marks.1,
                flags: marks.2,
                fault: marks.3,
                lost_before: LossBefore {
                    sequence_gap: marks.4,
                    time_gap: marks.5,
                },
            },
        })
    }

    proptest! {
        /// Frame -> encoded image + encoded info -> the same frame, bit by bit.
        #[test]
        fn frames_survive(frame in frames(), index in any::<u64>()) {
            let info = FrameInfo::decode(frame_info(&frame, index).encode_to_vec().as_slice()).unwrap();
            prop_assert_eq!(info.frame_index, index);
            let image = match image_message(&frame) {
                ImageMessage::Raw(m) => ImageMessage::Raw(RawImage::decode(m.encode_to_vec().as_slice()).unwrap()),
                ImageMessage::Compressed(m) => {
                    ImageMessage::Compressed(CompressedImage::decode(m.encode_to_vec().as_slice()).unwrap())
                }
            };
            prop_assert_eq!(frame_from(image, Some(&info), 0, 0).unwrap(), frame);
        }

        #[test]
        fn times_survive(ns in any::<u64>()) {
            prop_assert_eq!(unix_ns(&timestamp(ns)), ns);
        }

        /// Arbitrary bytes never panic in any decoder.
        #[test]
        fn arbitrary_bytes_do_not_panic(data in prop::collection::vec(any::<u8>(), 0..200), format in "jpeg|png|mono8") {
            FrameInfo::decode(data.as_slice()).ok();
            StripeProfile::decode(data.as_slice()).ok();
            let image = CompressedImage { data: data.into(), format, ..Default::default() };
            frame_from(ImageMessage::Compressed(image), None, 0, 0).ok();
        }
    }

    #[test]
    fn an_image_without_info_takes_the_records_word() {
        let raw = RawImage {
            width: 2,
            height: 1,
            encoding: "mono8".into(),
            step: 2,
            data: Bytes::from_static(&[1, 2]),
            ..Default::default()
        };
        let frame = frame_from(ImageMessage::Raw(raw.clone()), None, 7, 99).unwrap();
        assert_eq!((frame.meta.sequence, frame.meta.mid_exposure_ns), (7, 99));
        assert_eq!(frame.to_grey().unwrap().pixels, [1, 2]);
        let odd = RawImage {
            encoding: "32FC1".into(),
            ..raw
        };
        let error = frame_from(ImageMessage::Raw(odd), None, 0, 0).unwrap_err();
        assert!(error.to_string().contains("32FC1"), "{error}");
    }

    #[test]
    fn events_keep_their_numbers() {
        let event = Event::new(5, Severity::Warning, "camera.gap", "3 lost")
            .with("lost", 3.0)
            .with("gap_s", 0.12);
        let back = pb::Event::decode(event_message(&event).encode_to_vec().as_slice()).unwrap();
        assert_eq!(event_severity(&back), Severity::Warning);
        assert_eq!(
            (
                back.kind.as_str(),
                back.values["lost"],
                back.values["gap_s"]
            ),
            ("camera.gap", 3.0, 0.12)
        );
    }

    #[test]
    fn annotations_are_half_a_pixel_away_and_poses_need_all_six() {
        let profile = StripeProfile {
            column_px: vec![0.0, 10.0],
            row_px: vec![0.0, 20.5],
            ..Default::default()
        };
        let points = &stripe_annotations(&profile).points[0].points;
        assert_eq!(
            (points[0].x, points[0].y, points[1].x, points[1].y),
            (0.5, 0.5, 10.5, 21.0)
        );
        let mut motion = VehicleMotion {
            x_m: Some(1.0),
            y_m: Some(2.0),
            z_m: Some(-0.8),
            phi_rad: Some(0.0),
            theta_rad: Some(0.0),
            psi_rad: Some(std::f64::consts::PI),
            ..Default::default()
        };
        let q = pose_message(&motion)
            .unwrap()
            .pose
            .unwrap()
            .orientation
            .unwrap();
        assert!((q.z.abs() - 1.0).abs() < 1e-12 && q.w.abs() < 1e-12);
        motion.theta_rad = None;
        assert!(pose_message(&motion).is_none());
    }
}
