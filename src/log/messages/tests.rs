//! Round trips.

use super::*;
use bytes::Bytes;
use hydroline_core::event::kind;
use hydroline_core::frame::{
    Frame, FrameFault, FrameMeta, GreyRule, LossBefore, StampClock, StampSource,
};
use hydroline_rigs::PixelFormat;
use proptest::prelude::*;
use prost::Message;

fn frames() -> impl Strategy<Value = Frame> {
    let all: Vec<PixelFormat> = PixelFormat::of_cameras()
        .chain([PixelFormat::Png])
        .collect();
    let format = prop::sample::select(all);
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
        // A JPEG always has a size; 0 would mean "not stated".
        width_px: shape.1.max(1),
        height_px: shape.2,
        stride_bytes: if shape.0.is_compressed() { 0 } else { shape.3 },
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
    assert_eq!(frame.to_grey(&GreyRule::default()).unwrap().pixels, [1, 2]);
    let odd = RawImage {
        encoding: "32FC1".into(),
        ..raw
    };
    let error = frame_from(ImageMessage::Raw(odd), None, 0, 0).unwrap_err();
    assert!(error.to_string().contains("32FC1"), "{error}");
}

#[test]
fn events_keep_their_numbers() {
    let event = Event::new(5, Severity::Error, &kind::CAMERA_GAP, "3 lost")
        .with("lost", 3.0)
        .with("gap_s", 0.12);
    let back = pb::Event::decode(event_message(&event).encode_to_vec().as_slice()).unwrap();
    assert_eq!(event_severity(&back), Severity::Error);
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
