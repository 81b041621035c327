//! Speed of the log: `cargo bench -p hydroline-log --bench log`. Compare rates with each other, not with a clock:
//! the camera needs 10 to 21 MB/s (720 x 576 mono8 at 25 to 50 frames/s).
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use std::hint::black_box;
use std::path::Path;
use std::sync::Arc;

use bytes::Bytes;
use divan::Bencher;
use divan::counter::BytesCount;
use hydroline_core::clock::SystemClock;
use hydroline_core::frame::{Frame, FrameMeta, LossBefore, StampClock, StampSource};
use hydroline_log::messages::ThrusterCommand;
use hydroline_log::*;
use hydroline_rigs::PixelFormat;

const FRAMES: u32 = 50;
const PIXELS: usize = 720 * 576;

fn main() {
    divan::main();
}

fn frames() -> Vec<Frame> {
    let mut state = 0x9E37_79B9_7F4A_7C15u64;
    (0..FRAMES)
        .map(|sequence| {
            let data: Vec<u8> = (0..PIXELS)
                .map(|_| {
                    state ^= state << 13;
                    state ^= state >> 7;
                    state ^= state << 17;
                    // The sum of four nibbles / 4: bell-shaped noise around 10, sigma about 2.
                    let nibbles = (0..4).map(|i| (state >> (16 * i)) & 0xF).sum::<u64>();
                    (3 + nibbles / 4) as u8
                })
                .collect();
            let meta = FrameMeta {
                sequence,
                driver_stamp_ns: 0,
                stamp_clock: StampClock::Realtime,
                stamp_source: StampSource::MidExposure,
                flags: 0,
                received_monotonic_ns: 0,
                mid_exposure_ns: u64::from(sequence) * 40_000_000,
                exposure_s: 0.004,
                fault: None,
                lost_before: LossBefore::default(),
            };
            let (format, width_px, height_px) = (PixelFormat::Grey, 720, 576);
            Frame {
                format,
                width_px,
                height_px,
                stride_bytes: 720,
                data: Bytes::from(data),
                meta,
            }
        })
        .collect()
}

fn write(path: &Path, frames: &[Frame], zstd_level: u32) -> LogOutcome {
    let mut settings = WriteSettings::offline(Some(PixelFormat::Grey));
    settings.encoding.zstd_level = zstd_level;
    let mut log = FileRecorder::create(path, true, Head::default(), settings).unwrap();
    for (i, frame) in frames.iter().enumerate() {
        log.write(frame.meta.mid_exposure_ns, &Entry::frame(frame, i as u64))
            .unwrap();
    }
    log.finish(&SummaryInput::clean("done")).unwrap()
}

#[divan::bench(args = [0, 1, 3], sample_count = 5)]
fn write_frames(bencher: Bencher, zstd_level: u32) {
    let dir = tempfile::tempdir().unwrap();
    let frames = frames();
    bencher
        .counter(BytesCount::new(frames.len() * PIXELS))
        .bench(|| write(&dir.path().join("a.mcap"), &frames, zstd_level));
}

#[divan::bench(args = [0, 1], sample_count = 10)]
fn read_frames(bencher: Bencher, zstd_level: u32) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.mcap");
    write(&path, &frames(), zstd_level);
    bencher
        .counter(BytesCount::new(FRAMES as usize * PIXELS))
        .bench(|| {
            let frames = LogReader::open(&path)
                .unwrap()
                .filter(|m| matches!(m.as_ref().unwrap().record, Record::Frame(_)));
            assert_eq!(frames.count(), FRAMES as usize);
        });
}

/// Cost to a producer per frame and per command: no more with a disk that is busy.
#[divan::bench(sample_count = 20, sample_size = 40)]
fn push_a_frame(bencher: Bencher) {
    let dir = tempfile::tempdir().unwrap();
    let log = recorder(dir.path());
    let frame = frames().remove(0);
    bencher.bench(|| log.frame(black_box(&frame), 0));
}

#[divan::bench(sample_count = 20, sample_size = 40)]
fn push_a_command(bencher: Bencher) {
    let dir = tempfile::tempdir().unwrap();
    let log = recorder(dir.path());
    let command = ThrusterCommand {
        thruster: "surge".into(),
        ..Default::default()
    };
    bencher.bench(|| log.command(black_box(&command)));
}

fn recorder(dir: &Path) -> Recorder {
    let parts = FileParts {
        path: dir.join("a.mcap"),
        replace: true,
    };
    let settings = WriteSettings {
        limits: Limits::default(),
        ..WriteSettings::offline(Some(PixelFormat::Grey))
    };
    Recorder::start(
        Box::new(parts),
        Head::default(),
        settings,
        Arc::new(SystemClock),
    )
    .unwrap()
}
