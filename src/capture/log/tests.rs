use super::*;
use hydroline_core::clock::ManualClock;
use hydroline_core::event::{Event, Severity, kind};
use hydroline_core::frame::{FrameFault, LossBefore};
use hydroline_core::synthetic::{T0_NS, grey_frame};
use hydroline_log::{Entry, FileRecorder, Head, SummaryInput, WriteSettings};
use hydroline_rigs::PixelFormat;

const PERIOD_NS: u64 = 40_000_000;

/// 57 frames of 70 at 25 frames/s; 20..23 were dropped by the host, 40..=49 while the camera was unplugged.
fn frames() -> Vec<Frame> {
    let mut frames = Vec::new();
    for slot in (0..70).filter(|i| !(20..23).contains(i) && !(40..50).contains(i)) {
        let mut frame = grey_frame(slot, 8, 8);
        match slot {
            23 => frame.meta.lost_before.sequence_gap = 3,
            30 => frame.meta.fault = Some(FrameFault::Truncated),
            50 => frame.meta.lost_before.time_gap = 10,
            _ => {}
        }
        if slot >= 50 {
            frame.meta.sequence = slot - 50;
        }
        frames.push(frame);
    }
    frames
}

fn write(path: &Path, frames: &[Frame]) {
    let head = Head {
        rig_toml: "[rig]".to_owned(),
        ..Head::default()
    };
    let settings = WriteSettings::offline(Some(PixelFormat::Grey));
    let mut log = FileRecorder::create(path, false, head, settings).unwrap();
    for (index, frame) in frames.iter().enumerate() {
        let at_ns = frame.meta.mid_exposure_ns + 5_000_000;
        if frame.meta.lost_before.time_gap > 0 {
            let event = Event::new(at_ns, Severity::Error, &kind::CAMERA_UNPLUGGED, "gone");
            log.write(at_ns, &Entry::event(&event)).unwrap();
        }
        log.write(at_ns, &Entry::frame(frame, index as u64))
            .unwrap();
    }
    log.finish(&SummaryInput::clean("plan done")).unwrap();
}

fn play(source: &mut LogSource) -> Vec<Frame> {
    let mut frames = Vec::new();
    loop {
        match source.next(Duration::ZERO).unwrap() {
            Captured::Frame(frame) => frames.push(frame),
            Captured::Finished => return frames,
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn frames_stamps_and_losses_come_out_as_recorded() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.mcap");
    write(&path, &frames());
    let mut source = LogSource::open(&path, None).unwrap();
    let d = source.describe();
    assert_eq!(
        (d.kind.as_str(), d.format.fourcc.as_str(), d.format.width_px),
        ("log", "GREY", 8)
    );
    assert_eq!(play(&mut source), frames());
    source.finish();
    let counts = source.counts();
    assert_eq!((counts.received, counts.excluded.truncated), (57, 1));
    assert_eq!((counts.lost.sequence_gap, counts.lost.unplugged), (3, 10));
    assert_eq!((counts.lost.total(), counts.expected), (13, 70));
    assert_eq!(counts.disagreement, 0);
    assert_eq!(
        source.next(Duration::ZERO).unwrap(),
        Captured::Finished,
        "and stays so"
    );
}

#[test]
fn a_frame_that_is_not_in_the_file_is_lost() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.mcap");
    let kept: Vec<_> = (0..70)
        .filter(|i| *i != 33)
        .map(|i| grey_frame(i, 8, 8))
        .collect();
    assert!(
        kept.iter()
            .all(|f| f.meta.lost_before == LossBefore::default())
    );
    write(&path, &kept);
    let mut source = LogSource::open(&path, None).unwrap();
    play(&mut source);
    let counts = source.counts();
    assert_eq!((counts.lost.sequence_gap, counts.expected), (1, 70));
}

#[test]
fn paced_by_the_stamps_and_never_longer_than_asked() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.mcap");
    write(&path, &frames());
    let clock = Arc::new(ManualClock::new(7, T0_NS + 1_000 * PERIOD_NS));
    let mut source = LogSource::open(&path, Some(clock.clone())).unwrap();
    // Time between opening and the first call does not count.
    clock.advance(Duration::from_secs(9));
    let start_ns = clock.monotonic_ns();
    let mut got = 0;
    loop {
        let before_ns = clock.monotonic_ns();
        let one = source.next(Duration::from_millis(15)).unwrap();
        let now_ns = clock.monotonic_ns();
        assert!(now_ns - before_ns <= 15_000_000);
        match one {
            Captured::Frame(frame) => {
                assert_eq!(now_ns - start_ns, frame.meta.mid_exposure_ns - T0_NS);
                got += 1;
            }
            Captured::Nothing => assert_eq!(now_ns - before_ns, 15_000_000),
            Captured::Finished => break,
            Captured::Event(event) => panic!("{event:?}"),
        }
    }
    assert_eq!(got, 57);
}

fn reason(result: Result<LogSource, CaptureError>) -> String {
    match result.map(|mut source| {
        loop {
            match source.next(Duration::ZERO) {
                Ok(Captured::Finished) => panic!("nothing wrong was seen"),
                Ok(_) => {}
                Err(error) => {
                    // Reported once; then it is over.
                    assert_eq!(source.next(Duration::ZERO).unwrap(), Captured::Finished);
                    return error;
                }
            }
        }
    }) {
        Ok(error @ CaptureError::Source { .. }) | Err(error @ CaptureError::Source { .. }) => {
            error.to_string()
        }
        Ok(error) | Err(error) => panic!("{error:?}"),
    }
}

#[test]
fn what_is_no_sound_log_is_said() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.mcap");
    write(&path, &frames());
    let sound = std::fs::read(&path).unwrap();
    let broken = dir.path().join("broken.mcap");
    // One flipped bit in the middle, a cut end, another file, no file, no frames.
    let mut flipped = sound.clone();
    flipped[sound.len() / 2] ^= 0x10;
    std::fs::write(&broken, &flipped).unwrap();
    let words = reason(LogSource::open(&broken, None));
    assert!(words.contains("recover"), "{words}");
    std::fs::write(&broken, &sound[..sound.len() * 2 / 3]).unwrap();
    let words = reason(LogSource::open(&broken, None));
    assert!(words.contains("recover"), "{words}");
    std::fs::write(&broken, b"no log at all, only words").unwrap();
    let words = reason(LogSource::open(&broken, None));
    assert!(words.contains("not an MCAP file"), "{words}");
    let words = reason(LogSource::open(&dir.path().join("nowhere.mcap"), None));
    assert!(words.contains("cannot be read"), "{words}");
    let empty = dir.path().join("empty.mcap");
    write(&empty, &[]);
    let words = reason(LogSource::open(&empty, None));
    assert!(words.contains("/camera/image"), "{words}");
}
