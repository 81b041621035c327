//! The whole adapter against a kernel in memory.

use std::sync::Mutex;

use hydroline_rigs::{CameraControl, ImageNoise, PixelFormat, YuvRange};
use proptest::prelude::*;

use super::device::PixFormat;
use super::*;
use fake_kernel::*;
use hydroline_core::clock::ManualClock;

pub(super) mod fake_kernel;

fn rig_camera() -> Camera {
    let control = |name: &str, value| CameraControl {
        name: name.into(),
        value,
    };
    Camera {
        backend: CameraBackend::V4l(DeviceIdentity::ByPath("fake:0".into())),
        pixel_format: PixelFormat::Grey,
        bits: None,
        yuv_range: None,
        width_px: 32,
        height_px: 16,
        rate_fps: 25.0,
        exposure_s: 0.002,
        fx_px: 1.0,
        fy_px: 1.0,
        cx_px: 0.0,
        cy_px: 0.0,
        controls: vec![
            control("auto_exposure", 1),
            control("exposure_absolute", 80),
            control("gain", 10),
        ],
        noise: ImageNoise {
            blur_px: 0.0,
            read_sd: 0.0,
            shot_gain: 0.0,
            ambient: 0.0,
        },
        seed: 0,
        frozen_after_s: 1.0,
        response: None,
    }
}

fn system() -> (FakeSystem, Arc<ManualClock>) {
    let clock = Arc::new(ManualClock::new(
        1_000_000_000_000,
        1_700_000_000_000_000_000,
    ));
    (
        FakeSystem(Arc::new(Mutex::new(World::new(Arc::clone(&clock))))),
        clock,
    )
}

fn open(
    camera: &Camera,
    system: &FakeSystem,
    clock: &Arc<ManualClock>,
) -> Result<V4lSource, CaptureError> {
    V4lSource::open(
        camera,
        OpenOptions::default(),
        Box::new(system.clone()),
        Arc::clone(clock) as Arc<dyn Clock>,
    )
}

/// The camera with JPEGs.
fn open_mjpg(system: &FakeSystem, clock: &Arc<ManualClock>) -> V4lSource {
    system.world().jpeg = true;
    let camera = Camera {
        pixel_format: PixelFormat::Mjpg,
        ..rig_camera()
    };
    open(&camera, system, clock).unwrap()
}

struct Record {
    frames: Vec<Frame>,
    events: Vec<Event>,
    counts: CaptureCounts,
}

impl Record {
    fn events(&self, kind: &str) -> Vec<&Event> {
        self.events.iter().filter(|e| *e.kind == *kind).collect()
    }

    fn number(&self, kind: &str, name: &str) -> f64 {
        let event = self
            .events(kind)
            .into_iter()
            .next()
            .unwrap_or_else(|| panic!("no {kind} in {:#?}", self.events));
        event.values.iter().find(|(n, _)| *n == name).unwrap().1
    }

    fn balanced(&self) {
        let c = &self.counts;
        assert_eq!(
            (c.received + c.lost.total(), c.disagreement),
            (c.expected, 0),
            "{c:?}"
        );
        assert!(self.events("camera.count_disagrees").is_empty());
        assert_eq!(
            self.frames.len() as u64,
            c.received + c.excluded.leftover + c.excluded.repeated
        );
    }
}

fn go(source: &mut V4lSource, clock: &ManualClock, seconds: f64) -> Record {
    let end = clock.monotonic_ns() + (seconds * 1e9) as u64;
    let (mut frames, mut events) = (Vec::new(), Vec::new());
    while clock.monotonic_ns() < end {
        let before = clock.monotonic_ns();
        match source.next(Duration::from_millis(100)).unwrap() {
            Captured::Frame(f) => frames.push(f),
            Captured::Event(e) => events.push(e),
            Captured::Nothing => assert!(
                clock.monotonic_ns() >= before + 100 * MS,
                "returned early with nothing"
            ),
            Captured::Finished => panic!("a camera never finishes"),
        }
        assert!(
            clock.monotonic_ns() <= before + 101 * MS,
            "stayed longer than asked"
        );
    }
    Record {
        frames,
        events,
        counts: source.counts(),
    }
}

/// Records 12 s with faults at seconds after the start.
fn with_faults(camera: &Camera, faults: &[(f64, Fault)]) -> Record {
    let (system, clock) = system();
    let mut source = open(camera, &system, &clock).unwrap();
    let start = clock.monotonic_ns();
    system
        .world()
        .faults
        .extend(faults.iter().map(|(s, f)| (start + (s * 1e9) as u64, *f)));
    let record = go(&mut source, &clock, 12.0);
    let calls = system.world().calls;
    assert!(
        calls < 12 * 25 * 20,
        "{calls} calls in 12 s: something spins"
    );
    record.balanced();
    record
}

#[test]
fn a_healthy_camera() {
    let r = with_faults(&rig_camera(), &[]);
    assert!((299..=301).contains(&r.frames.len()), "{}", r.frames.len());
    assert_eq!(r.counts.lost.total(), 0);
    let stale: Vec<_> = r
        .frames
        .iter()
        .filter(|f| f.meta.fault == Some(FrameFault::Stale))
        .map(|f| f.meta.sequence)
        .collect();
    assert_eq!(stale, [0, 1]);
    assert!(
        r.events.iter().all(|e| *e.kind == *"camera.counts"),
        "{:?}",
        r.events
    );
    assert!(r.events.len() >= 10);
    let f = &r.frames[100];
    assert_eq!((f.data.len(), f.data[0], f.stride_bytes), (512, 100, 32));
    // Start of exposure + half the exposure that the camera itself states (80 x 100 us).
    assert_eq!(f.meta.exposure_s, 0.008);
    assert_eq!(
        f.meta.mid_exposure_ns,
        f.meta.driver_stamp_ns + 1_700_000_000_000_000_000 - 1_000_000_000_000 + 4 * MS
    );
}

#[test]
fn what_was_set_up_is_reported() {
    let (system, clock) = system();
    let d = open(&rig_camera(), &system, &clock).unwrap().describe();
    assert_eq!(
        (
            d.driver.as_str(),
            d.driver_version.as_str(),
            d.identity.as_str()
        ),
        ("fakevideo", "6.1.0", "by-path fake:0")
    );
    assert_eq!(
        (
            d.format.fourcc.as_str(),
            d.format.field.as_str(),
            d.rate_fps,
            d.buffers
        ),
        ("GREY", "none", 25.0, 8)
    );
    let values: Vec<_> = d
        .controls
        .iter()
        .map(|c| (c.name.as_str(), c.asked, c.value))
        .collect();
    assert_eq!(
        values,
        [
            ("auto_exposure", Some(1), 1),
            ("exposure_absolute", Some(80), 80),
            ("gain", Some(10), 10)
        ]
    );
    assert_eq!(d.module_parameters["nodrop"], "1");
    assert_eq!(
        serde_json::from_str::<SourceDescription>(&serde_json::to_string(&d).unwrap()).unwrap(),
        d
    );
}

#[test]
fn damaged_and_short_frames_are_kept_and_marked() {
    let r = with_faults(&rig_camera(), &[(3.0, Fault::Damage), (5.0, Fault::Halve)]);
    let faults: Vec<_> = r
        .frames
        .iter()
        .filter_map(|f| f.meta.fault)
        .filter(|f| *f != FrameFault::Stale)
        .collect();
    assert_eq!(faults, [FrameFault::DriverError, FrameFault::Truncated]);
    assert_eq!(
        (
            r.counts.excluded.driver_error,
            r.counts.excluded.truncated,
            r.counts.lost.total()
        ),
        (1, 1, 0)
    );
    assert_eq!(r.events("camera.error_frame").len(), 2);
}

#[test]
fn half_a_jpeg_is_noticed_without_a_flag() {
    let (system, clock) = system();
    let mut source = open_mjpg(&system, &clock);
    let at = clock.monotonic_ns() + 2_000 * MS;
    system.world().faults.push_back((at, Fault::Halve));
    let r = go(&mut source, &clock, 4.0);
    r.balanced();
    assert_eq!(r.counts.excluded.broken_jpeg, 1);
    assert_eq!(r.frames[20].stride_bytes, 0);
}

#[test]
fn a_hole_between_the_markers_of_a_jpeg_makes_its_frame_faulty() {
    let (system, clock) = system();
    let mut source = open_mjpg(&system, &clock);
    let at = clock.monotonic_ns() + 2_000 * MS;
    system.world().faults.push_back((at, Fault::Hole));
    let r = go(&mut source, &clock, 4.0);
    r.balanced();
    assert_eq!(r.counts.excluded.broken_jpeg, 1);
    let said = r.events("camera.error_frame");
    // With the reason, as far as it is known.
    let words = &said[0].message;
    assert!(
        words.contains("is no whole JPEG: ") && words.contains("block group"),
        "{words}"
    );
}

#[test]
fn a_jpeg_is_looked_into_when_its_buffer_is_back_with_the_driver() {
    let (system, clock) = system();
    let mut source = open_mjpg(&system, &clock);
    let start_ns = clock.monotonic_ns();
    let at = start_ns + 200 * MS;
    system.world().faults.push_back((at, Fault::Hole));
    // Steps of the queue alone, as many as fetch some frames.
    let (end_ns, mut frames) = (start_ns + 1_000 * MS, 0);
    while clock.monotonic_ns() < end_ns {
        frames += usize::from(source.step(end_ns).unwrap().is_some());
    }
    assert!(frames > 10, "{frames}");
    assert_eq!(source.counts().excluded, Default::default());
}

#[test]
fn drops_of_driver_and_device_are_distinguished() {
    let r = with_faults(
        &rig_camera(),
        &[(3.0, Fault::DriverDrop(3)), (6.0, Fault::DeviceDrop(5))],
    );
    assert_eq!((r.counts.lost.sequence_gap, r.counts.lost.time_gap), (3, 5));
    let gaps: Vec<_> = r
        .frames
        .iter()
        .filter(|f| f.meta.lost_before != Default::default())
        .map(|f| f.meta.lost_before)
        .collect();
    assert_eq!(gaps.len(), 2);
    assert_eq!(
        (
            gaps[0].sequence_gap,
            gaps[0].time_gap,
            gaps[1].sequence_gap,
            gaps[1].time_gap
        ),
        (3, 0, 0, 5)
    );
    assert_eq!(r.events("camera.gap").len(), 2);
}

#[test]
fn signals_and_refusals_leave_no_trace() {
    let r = with_faults(
        &rig_camera(),
        &[(3.0, Fault::Interrupt), (4.0, Fault::Interrupt)],
    );
    assert_eq!((r.counts.lost.total(), r.counts.restarts), (0, 0));
}

#[test]
fn a_frozen_camera_is_restarted_and_its_time_counted() {
    let r = with_faults(&rig_camera(), &[(3.0, Fault::Freeze), (6.5, Fault::Thaw)]);
    assert!((r.number("camera.frozen", "silence_s") - 1.0).abs() < 0.11);
    assert!(
        (86..=89).contains(&r.counts.lost.frozen),
        "{:?}",
        r.counts.lost
    );
    assert!((r.number("camera.resumed", "gap_s") - 3.54).abs() < 0.1);
}

#[test]
fn a_fatal_error_restarts_with_back_off() {
    let r = with_faults(
        &rig_camera(),
        &[(3.0, Fault::Fatal), (6.0, Fault::FatalAfterStart(4))],
    );
    assert_eq!(r.events("camera.stream_error").len(), 1 + 5);
    assert_eq!(r.counts.lost.sequence_gap + r.counts.lost.time_gap, 0);
    // 50 ms, then 50 + 100 + 200 + 400 + 800 ms.
    assert!(
        (1..=3).contains(&(r.counts.lost.restarted as i64 - 38).abs())
            || r.counts.lost.restarted == 38,
        "{:?}",
        r.counts.lost
    );
}

#[test]
fn void_buffers_restart_at_once() {
    let r = with_faults(&rig_camera(), &[(3.0, Fault::Void)]);
    assert_eq!(r.counts.excluded.void, 8);
    assert_eq!(r.events("camera.void_buffers").len(), 1);
    assert!(r.counts.lost.restarted <= 3, "{:?}", r.counts.lost);
}

#[test]
fn unplugged_and_replugged_in_the_same_recording() {
    let r = with_faults(
        &rig_camera(),
        &[
            (3.0, Fault::Unplug),
            (5.03, Fault::Plug),
            (9.0, Fault::Unplug),
            (9.5, Fault::Plug),
        ],
    );
    let gone = r.events("camera.unplugged");
    let back = r.events("camera.replugged");
    assert_eq!((gone.len(), back.len()), (2, 2));
    let start = 1_700_000_000_000_000_000;
    assert!(
        gone[0].timestamp_ns - start - 3_000 * MS <= 500 * MS,
        "noticed within 0.5 s"
    );
    assert!(
        back[0].timestamp_ns - start - 5_030 * MS <= 250 * MS,
        "found within one look"
    );
    assert!((2.0..2.3).contains(&r.number("camera.replugged", "gap_s")));
    assert!(
        (62..=74).contains(&r.counts.lost.unplugged),
        "{:?}",
        r.counts.lost
    );
    // The rig's controls are set again; the device had forgotten them.
    assert_eq!(r.frames.last().unwrap().meta.exposure_s, 0.008);
    assert!(r.events("camera.control_changed").is_empty());
    let stale = r
        .frames
        .iter()
        .filter(|f| f.meta.fault == Some(FrameFault::Stale))
        .count();
    assert_eq!(stale, 6);
}

#[test]
fn unplugged_for_good_is_lost_until_the_stop() {
    let (system, clock) = system();
    let mut source = open(&rig_camera(), &system, &clock).unwrap();
    let at = clock.monotonic_ns() + 2_000 * MS;
    system.world().faults.push_back((at, Fault::Unplug));
    let mut r = go(&mut source, &clock, 60.0);
    source.finish();
    r.counts = source.counts();
    r.balanced();
    // 60 s at 25 frames/s, less what is in flight at both ends.
    assert!((1495..=1500).contains(&r.counts.expected), "{:?}", r.counts);
    assert_eq!(
        r.counts.lost.unplugged,
        r.counts.expected - r.counts.received
    );
}

#[test]
fn a_control_changed_behind_our_back_is_said_once() {
    let r = with_faults(&rig_camera(), &[(3.0, Fault::Control(EXPOSURE, 300))]);
    assert_eq!(r.events("camera.control_changed").len(), 1);
    assert_eq!(
        (
            r.number("camera.control_changed", "from"),
            r.number("camera.control_changed", "to")
        ),
        (80.0, 300.0)
    );
    let now_s = r.frames.last().unwrap().meta.exposure_s;
    assert!(
        (now_s - 0.030).abs() < 1e-9,
        "the exposure that is true now, not {now_s}"
    );
}

#[test]
fn a_halved_rate_is_no_loss() {
    let r = with_faults(&rig_camera(), &[(4.0, Fault::Period(80 * MS))]);
    assert_eq!(r.counts.lost.total(), 0);
    assert!((r.number("camera.rate_changed", "to_fps") - 12.5).abs() < 0.01);
}

#[test]
fn odd_stamps_are_said_once_and_used_with_sense() {
    for (flag_bits, offset_ns, kind) in [
        (0, 0, "camera.stamp_clock_unknown"),
        (flags(false), 34 * MS as i64, "camera.stamp_in_future"),
        (flags(false), 1 << 60, "camera.stamp_implausible"),
        (0, -2_000_000_000, "camera.stamp_implausible"),
    ] {
        let (system, clock) = system();
        system.world().flags = flag_bits;
        system.world().stamp_offset_ns = offset_ns;
        let mut source = open(&rig_camera(), &system, &clock).unwrap();
        let r = go(&mut source, &clock, 4.0);
        r.balanced();
        assert_eq!(r.events(kind).len(), 1, "{kind}: {:?}", r.events);
        assert_eq!(r.counts.lost.total(), 0);
    }
}

fn flags(soe: bool) -> u32 {
    stamp::flags::MONOTONIC | if soe { stamp::flags::SOE } else { 0 }
}

fn refused(change: impl FnOnce(&mut World), camera: &Camera) -> String {
    let (system, clock) = system();
    change(&mut system.world());
    let text = match open(camera, &system, &clock) {
        Err(e) => e.to_string(),
        Ok(mut source) => (0..100)
            .find_map(|_| source.next(Duration::from_millis(100)).err())
            .unwrap()
            .to_string(),
    };
    assert_eq!(system.world().handles, 0, "no descriptor is leaked");
    text
}

/// Every format of a camera: negotiated, delivered, a cut frame marked, and the account exact.
#[test]
fn every_format_is_captured_and_accounted_for() {
    for format in PixelFormat::of_cameras() {
        let camera = Camera {
            pixel_format: format,
            ..rig_camera()
        };
        let (system, clock) = system();
        let start_ns = clock.monotonic_ns();
        {
            let mut world = system.world();
            world.jpeg = format.is_compressed();
            world.faults = [
                (start_ns + 500 * MS, Fault::Halve),
                (start_ns + 900 * MS, Fault::DriverDrop(3)),
            ]
            .into();
        }
        let mut source = open(&camera, &system, &clock).unwrap();
        let mut frames = Vec::new();
        while clock.monotonic_ns() < start_ns + 2_000 * MS {
            if let Captured::Frame(frame) = source.next(Duration::from_millis(100)).unwrap() {
                frames.push(frame);
            }
        }
        source.finish();
        let counts = source.counts();
        assert_eq!(counts.received, frames.len() as u64, "{format:?}");
        assert_eq!(counts.lost.total(), 3, "{format:?}");
        assert_eq!(
            counts.expected,
            counts.received + counts.lost.total(),
            "{format:?}"
        );
        let bad = |f: &&Frame| !matches!(f.meta.fault, None | Some(FrameFault::Stale));
        assert_eq!(frames.iter().filter(bad).count(), 1, "{format:?}");
        for frame in frames.iter().filter(|f| f.meta.fault.is_none()) {
            assert_eq!((frame.format, frame.width_px), (format, 32));
            if !format.is_compressed() {
                let grey = frame.to_grey(&Default::default()).unwrap();
                assert_eq!(grey.pixels.len(), 32 * 16, "{format:?}");
            }
        }
        let named = source.describe().format.fourcc;
        assert_eq!(named.as_bytes(), format.fourcc().trim_ascii_end());
    }
}

#[test]
fn planes_apart_and_levels_that_nobody_named_are_refused_with_what_to_do() {
    let nv12 = Camera {
        pixel_format: PixelFormat::Nv12,
        ..rig_camera()
    };
    let text = refused(|w| w.memory_planes = 2, &nv12);
    for word in ["2 planes of memory", "NV12 32x16", "instead of NM12"] {
        assert!(text.contains(word), "{word}: {text}");
    }
    let open_for = |camera: &Camera, full_range: bool, colour: bool| {
        let (system, clock) = system();
        system.world().full_range = full_range;
        let options = OpenOptions {
            colour,
            ..OpenOptions::default()
        };
        V4lSource::open(camera, options, Box::new(system), clock)
            .map(|source| source.describe().format.yuv_range)
            .map_err(|e| e.to_string())
    };
    let text = open_for(&nv12, true, true).unwrap_err();
    for word in ["full range", "camera.yuv_range = \"full\"", "NV12 32x16"] {
        assert!(text.contains(word), "{word}: {text}");
    }
    let said = Camera {
        yuv_range: Some(YuvRange::Limited),
        ..nv12.clone()
    };
    assert!(open_for(&said, true, true).is_ok());
    assert_eq!(open_for(&nv12, false, true), Ok(Some("limited".into())));
    // Luma is what stands in the bytes.
    assert_eq!(open_for(&nv12, true, false), Ok(Some("full".into())));
    let grey = rig_camera();
    assert_eq!(open_for(&grey, true, true), Ok(None));
}

#[test]
fn every_refusal_names_what_where_and_what_to_do() {
    let camera = rig_camera();
    let yuyv = PixFormat {
        fourcc: *b"YUYV",
        width_px: 32,
        height_px: 16,
        stride_bytes: 64,
        size_bytes: 1024,
        field: 1,
        ..PixFormat::default()
    };
    let has = |text: String, words: &[&str]| {
        words
            .iter()
            .for_each(|w| assert!(text.contains(w), "`{w}` is missing in: {text}"))
    };
    has(
        refused(|w| w.format_override = Some(yuyv), &camera),
        &[
            "/dev/video9",
            "GREY 32x16",
            "YUYV 32x16",
            "YUYV 320x240 @ 30/15",
        ],
    );
    let tight = PixFormat {
        fourcc: *b"GREY",
        stride_bytes: 16,
        size_bytes: 512,
        ..yuyv
    };
    has(
        refused(|w| w.format_override = Some(tight), &camera),
        &["stride 16"],
    );
    has(
        refused(|w| w.rate_override = Some((1, 15)), &camera),
        &["25 frames/s", "15.0000"],
    );
    has(
        refused(|w| w.refused_control = Some(GAIN), &camera),
        &["`gain`", "asked 10", "0..=100"],
    );
    has(
        refused(|w| w.stream_on_errno = Some(libc::ENOSPC), &camera),
        &["USB bandwidth", "Mbit/s", "MJPG"],
    );
    has(
        refused(|w| w.stream_on_errno = Some(libc::EPROTO), &camera),
        &["5 attempts", "VIDIOC_STREAMON"],
    );
    has(
        refused(|w| w.open_errno = Some(libc::EACCES), &camera),
        &["root:video"],
    );
    has(
        refused(|w| w.open_errno = Some(libc::EBUSY), &camera),
        &["77 (ffmpeg)"],
    );
    has(
        refused(|w| w.present = false, &camera),
        &["by-path fake:0", "hydroline devices"],
    );
    has(
        refused(|w| w.capability.caps = 0x0480_0000, &camera),
        &["V4L2_CAP_VIDEO_CAPTURE", "metadata"],
    );
    let wrong_order = Camera {
        controls: camera.controls.iter().rev().cloned().collect(),
        ..camera.clone()
    };
    has(
        refused(|_| (), &wrong_order),
        &["`exposure_absolute`", "reads back 157", "auto_exposure = 1"],
    );
    let unknown = Camera {
        controls: vec![CameraControl {
            name: "zoom".into(),
            value: 1,
        }],
        ..camera.clone()
    };
    has(
        refused(|_| (), &unknown),
        &["`zoom`", "exposure_time_absolute"],
    );
    let node = Camera {
        backend: CameraBackend::V4l(DeviceIdentity::Node("/dev/video9".into())),
        ..camera.clone()
    };
    has(
        refused(|_| (), &node),
        &["not a stable name", "allow_unstable_node"],
    );
    has(
        refused(
            |_| (),
            &Camera {
                backend: CameraBackend::Sim,
                ..camera
            },
        ),
        &["simulated"],
    );
}

#[test]
fn a_loopback_without_its_feeder_is_waited_for() {
    let (system, clock) = system();
    system.world().capability.caps = setup::CAP_OUTPUT | setup::CAP_STREAMING;
    assert!(matches!(
        open(&rig_camera(), &system, &clock),
        Err(CaptureError::NotACamera { .. })
    ));
    // It waited its whole patience before giving up.
    assert!(clock.monotonic_ns() >= 1_005_000 * MS);
}

#[test]
fn a_camera_that_comes_back_different_is_said_and_waited_for() {
    let (system, clock) = system();
    let mut source = open(&rig_camera(), &system, &clock).unwrap();
    let start = clock.monotonic_ns();
    system.world().faults.extend([
        (start + 1_000 * MS, Fault::Unplug),
        (start + 2_000 * MS, Fault::Plug),
    ]);
    go(&mut source, &clock, 1.5);
    system.world().refused_control = Some(GAIN);
    let r = go(&mut source, &clock, 3.0);
    assert_eq!(
        (r.frames.len(), r.events("camera.reopen_failed").len()),
        (0, 1)
    );
    system.world().refused_control = None;
    let r = go(&mut source, &clock, 3.0);
    assert!(r.frames.len() > 60);
    assert_eq!(r.counts.disagreement, 0);
}

fn fault() -> impl Strategy<Value = Fault> {
    prop_oneof![
        Just(Fault::Unplug),
        Just(Fault::Plug),
        Just(Fault::Freeze),
        Just(Fault::Thaw),
        Just(Fault::Fatal),
        (1u32..4).prop_map(Fault::FatalAfterStart),
        Just(Fault::Damage),
        Just(Fault::Halve),
        (1u32..9).prop_map(Fault::DeviceDrop),
        (1u32..9).prop_map(Fault::DriverDrop),
        Just(Fault::Void),
        Just(Fault::Interrupt),
        (0i64..100).prop_map(|v| Fault::Control(GAIN, v)),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    /// Any sequence of faults: no error, no wedge, no spinning, the account balances, frames flow at the end.
    #[test]
    fn no_sequence_of_faults_ends_a_recording(mut faults in proptest::collection::vec((2_000u64..20_000, fault()), 0..25)) {
        faults.sort_by_key(|(at, _)| *at);
        let (system, clock) = system();
        let mut source = open(&rig_camera(), &system, &clock).unwrap();
        let start = clock.monotonic_ns();
        system.world().faults.extend(faults.iter().map(|(ms, f)| (start + ms * MS, *f)));
        system.world().faults.extend([(start + 20_500 * MS, Fault::Thaw), (start + 20_500 * MS, Fault::Plug)]);
        let r = go(&mut source, &clock, 40.0);
        let late = r.frames.iter().filter(|f| f.meta.received_monotonic_ns > start + 36_000 * MS).count();
        prop_assert!(late > 60, "only {late} frames in the last 4 s");
        let calls = system.world().calls;
        prop_assert!(calls < 40_000, "{calls} calls in 40 s");
        let c = r.counts;
        prop_assert_eq!((c.received + c.lost.total(), c.disagreement), (c.expected, 0), "{:?}", c);
    }
}
