//! The daemon on a camera whose JPEGs are damaged where nothing but their picture shows it, or look so in every frame.

use crate::support::{job, read, recorder};
use bytes::Bytes;
use hydroline::capture::{CaptureCounts, CaptureError, Captured, FrameSource, SourceDescription};
use hydroline::clock::{Clock, SystemClock};
use hydroline::frame::{Frame, FrameMeta, PixelFormat};
use hydroline::log::{FileParts, Record};
use hydroline::record::{self, Job, Parts, Report};
use hydroline::shutdown::{Shutdown, StopReason};
use hydroline_rigs::Rig;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

const PERIOD_NS: u64 = 40_000_000;

/// A camera whose frames are these JPEGs of 160 x 120, in turn.
struct JpegCamera {
    frames: Vec<Bytes>,
    clock: Arc<dyn Clock>,
    due_ns: u64,
    received: u32,
}

impl FrameSource for JpegCamera {
    fn describe(&self) -> SourceDescription {
        SourceDescription::default()
    }

    fn next(&mut self, wait: Duration) -> Result<Captured, CaptureError> {
        let due = self.due_ns.saturating_sub(self.clock.monotonic_ns());
        self.clock.sleep(Duration::from_nanos(due).min(wait));
        let now = self.clock.triple();
        if now.monotonic_ns < self.due_ns {
            return Ok(Captured::Nothing);
        }
        let sequence = self.received;
        self.received += 1;
        self.due_ns += PERIOD_NS;
        Ok(Captured::Frame(Frame {
            format: PixelFormat::Mjpg,
            width_px: 160,
            height_px: 120,
            stride_bytes: 0,
            data: self.frames[sequence as usize % self.frames.len()].clone(),
            meta: FrameMeta {
                received_monotonic_ns: now.monotonic_ns,
                ..FrameMeta::at(sequence, now.realtime_ns)
            },
        }))
    }

    fn counts(&self) -> CaptureCounts {
        CaptureCounts {
            received: self.received.into(),
            expected: self.received.into(),
            ..CaptureCounts::default()
        }
    }
}

/// A stripe with sharp squares over it: on the JPEG's grid each looks like a damaged block.
fn jpeg(squares: &[[u32; 2]]) -> Bytes {
    let mut image = image::GrayImage::from_fn(160, 120, |x, y| {
        let z = (f64::from(y) - 60.3 - 0.02 * f64::from(x)) / 2.0;
        image::Luma([10 + (180.0 * (-0.5 * z * z).exp()) as u8 + ((x * 7 + y * 13) % 5) as u8])
    });
    for [left, top] in squares {
        for (x, y) in (0..8).flat_map(|y| (0..8).map(move |x| (x, y))) {
            image.put_pixel(left + x, top + y, image::Luma([220]));
        }
    }
    let mut bytes = Vec::new();
    let mut encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 95);
    encoder.encode_image(&image).unwrap();
    bytes.into()
}

/// Frames each with a damaged block at another place.
fn wandering() -> Vec<Bytes> {
    let places = (0..4).flat_map(|row| (0..15).map(move |column| [16 + 8 * column, 8 + 8 * row]));
    places.map(|place| jpeg(&[place])).collect()
}

fn recorded(path: &Path, frames: Vec<Bytes>, set: impl FnOnce(&mut Job)) -> Report {
    let mut rig = Rig::builtin("lshpi").unwrap();
    rig.camera.pixel_format = PixelFormat::Mjpg;
    let clock: Arc<dyn Clock> = Arc::new(SystemClock);
    let opener = FileParts {
        path: path.to_owned(),
        replace: false,
    };
    let source = JpegCamera {
        frames,
        clock: clock.clone(),
        due_ns: clock.monotonic_ns(),
        received: 0,
    };
    let parts = Parts {
        source: Box::new(source),
        line: None,
        recorder: recorder(&rig, Box::new(opener), clock.clone()),
        clock,
        map: None,
        live: None,
    };
    let mut job = job(&rig, None, 0.8);
    set(&mut job);
    record::run(parts, &job, &Shutdown::new(), Box::new(|_| {})).unwrap()
}

fn events(records: &[Record], kind: &str) -> Vec<String> {
    let events = records.iter().filter_map(|r| match r {
        Record::Event(event) if event.kind == kind => Some(event.message.clone()),
        _ => None,
    });
    events.collect()
}

#[test]
fn a_frame_with_a_damaged_block_is_counted_said_and_a_loss() {
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    let sound = jpeg(&[]);
    let frames = wandering().into_iter().flat_map(|f| [sound.clone(), f]);
    let report = recorded(&path, frames.collect(), |_| {});
    assert_eq!(report.stop, StopReason::Finished);
    let damaged = report.unusable.damaged;
    assert!(damaged > 0 && damaged < report.analysed, "{report:?}");
    assert!(report.lost_anything() && !report.log.lost, "{report:?}");
    let (records, metadata) = read(&path);
    let summary = &metadata["summary"];
    assert_eq!(summary["frames.excluded.damaged"], damaged.to_string());
    let said = events(&records, "camera.error_frame");
    assert_eq!(said.len() as u64, damaged);
    assert!(
        said[0].contains("damaged JPEG: the block at"),
        "{}",
        said[0]
    );
}

#[test]
fn a_camera_of_which_no_frame_can_be_read_is_never_ready_and_the_reason_is_said() {
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    let wait = |job: &mut Job| job.ready_within = Duration::from_millis(600);
    let report = recorded(&path, wandering(), wait);
    let StopReason::Failed(words) = &report.stop else {
        panic!("{report:?}");
    };
    for part in [
        "none can be used",
        " damaged)",
        "damaged JPEG: the block at",
    ] {
        assert!(words.contains(part), "no '{part}' in: {words}");
    }
    assert!(!words.contains("plugged in"), "{words}");
}

#[test]
fn a_camera_that_draws_over_its_picture_is_recorded_as_any_other() {
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    let report = recorded(&path, vec![jpeg(&[[40, 16], [96, 16]])], |_| {});
    assert_eq!(report.stop, StopReason::Finished);
    assert_eq!(report.unusable.damaged, 0, "{report:?}");
    assert!(!report.lost_anything(), "{report:?}");
    let (records, _) = read(&path);
    let said = events(&records, "camera.picture_blocks");
    assert!(said.len() == 1 && said[0].contains("2 blocks"), "{said:?}");
    // The frames before it was known are in the log, and read from there.
    let out = dir.path().join("again.mcap");
    let options = hydroline::replay::Options::default();
    let (replayed, _) = hydroline::replay::replay(&path, &out, &options, &mut |_| {}).unwrap();
    assert_eq!(replayed.undecodable, 0, "{replayed:?}");
    assert_eq!(replayed.live_different, 0, "{replayed:?}");
    assert!(replayed.picture_blocks.is_some() && replayed.live > 5);
}
