//! Logs that our writers wrote are sound to every reader, whatever the size and content of their frames.
#![allow(clippy::unwrap_used, clippy::panic)]

use bytes::Bytes;
use grey_frame::{T0_NS, grey_frame};
use hydroline_core::frame::Frame;
use hydroline_log::doctor::{Grade, doctor};
use hydroline_log::export::{ExportOptions, export};
use hydroline_log::recover::recover;
use hydroline_log::{
    Closing, EXPANSION_MAX, Entry, FileParts, FileRecorder, Head, IndexedLog, LIMIT_BYTES,
    LogError, LogReader, LogWriter, RawReader, Record, SummaryInput, WriteSettings, info,
};
use hydroline_rigs::{FRAME_BYTES_MAX, Rig};
use std::path::Path;

#[path = "../../../tests/support/grey_frame.rs"]
mod grey_frame;

/// Head of a recording by a camera of this size.
fn head(width_px: u32, height_px: u32) -> Head {
    let mut rig = Rig::builtin("lshpi").unwrap();
    (rig.camera.width_px, rig.camera.height_px) = (width_px, height_px);
    Head {
        rig_toml: rig.to_toml(),
        ..Head::default()
    }
}

fn grey(k: u32, (width_px, height_px): (u32, u32), level: impl Fn(u32, u32) -> u8) -> Frame {
    let pixels = (0..height_px).flat_map(|row| (0..width_px).map(move |column| (row, column)));
    let data: Vec<u8> = pixels.map(|(row, column)| level(row, column)).collect();
    Frame {
        width_px,
        height_px,
        stride_bytes: width_px,
        data: Bytes::from(data),
        ..grey_frame(k, 1, 1)
    }
}

fn flat(k: u32, size: (u32, u32), level: u8) -> Frame {
    let bytes = size.0 as usize * size.1 as usize;
    Frame {
        width_px: size.0,
        height_px: size.1,
        stride_bytes: size.0,
        data: Bytes::from(vec![level; bytes]),
        ..grey_frame(k, 1, 1)
    }
}

fn written(path: &Path, head: Head, settings: WriteSettings, frames: &[Frame]) {
    let mut log = FileRecorder::create_whole(path, false, head, settings).unwrap();
    for (i, frame) in frames.iter().enumerate() {
        let t = T0_NS + i as u64 * 40_000_000;
        log.write(t, &Entry::frame(frame, i as u64)).unwrap();
    }
    log.finish(&SummaryInput::clean("done")).unwrap();
}

/// Has a log of these frames read by everything that reads logs, and its recovery too.
fn every_reader_finds_it_sound(head: Head, frames: &[Frame]) {
    let dir = tempfile::tempdir().unwrap();
    let (path, mended) = (dir.path().join("run.mcap"), dir.path().join("mended.mcap"));
    let settings = WriteSettings::offline(Some(frames[0].format));
    written(&path, head, settings, frames);
    let recovery = recover(&path, &mended).unwrap();
    assert!(recovery.was_whole && !recovery.lossy, "{recovery}");
    for log in [&path, &mended] {
        let diagnosis = doctor(log).unwrap();
        assert!(!diagnosis.found("damage", Grade::Note), "{diagnosis}");
        assert!(log != &path || diagnosis.sound, "{diagnosis}");
        let found = info::info(log).unwrap();
        assert!(found.damage.is_empty(), "{:?}", found.damage);
        let images = found.topics.iter().find(|t| t.topic == "/camera/image");
        assert_eq!(images.unwrap().messages, frames.len() as u64);
        assert_eq!(
            RawReader::open(log).unwrap().filter(|m| m.is_err()).count(),
            0
        );
        assert!(Closing::of(log).is_some());
    }
    let read = LogReader::open(&path).unwrap().map(|m| m.unwrap().record);
    let read = read.filter_map(|record| match record {
        Record::Frame(frame) => Some(frame),
        _ => None,
    });
    let mut compared = 0;
    for (read, frame) in read.zip(frames) {
        assert_eq!(read.data, frame.data);
        compared += 1;
    }
    assert_eq!(compared, frames.len());
    let indexed = IndexedLog::open(&path).unwrap();
    let places = indexed.places(&["/camera/image"]).into_iter();
    let found = places.map(|place| indexed.messages(place, &["/camera/image"]).unwrap().len());
    assert_eq!(found.sum::<usize>(), frames.len());
    let options = ExportOptions {
        tables: true,
        frames: frames[0].data.len() < 1 << 20,
    };
    let exported = export(&path, &dir.path().join("tables"), options).unwrap();
    assert_eq!(exported.frames_skipped, 0);
}

#[test]
fn own_recordings_from_black_to_noise_are_sound_at_every_size() {
    for size in [(16, 16), (64, 48), (720, 576), (2448, 2048)] {
        let stripe = |row: u32, _: u32| 200 * u8::from(row == size.1 / 3);
        let frames = [
            flat(0, size, 0),
            flat(1, size, 255),
            grey(2, size, stripe),
            grey(3, size, |row, column| (row + column) as u8),
            grey_frame(4, size.0, size.1),
        ];
        every_reader_finds_it_sound(head(size.0, size.1), &frames);
    }
}

/// Black frames of 12 megapixels, so many that no ratio of sizes divides their log from a bomb.
fn dark() -> Vec<Frame> {
    let first = flat(0, (4096, 3072), 0);
    let frame = |k| Frame {
        meta: grey_frame(k, 1, 1).meta,
        ..first.clone()
    };
    (0..40).map(frame).collect()
}

/// Whether the log of these frames is one that the ratio alone would refuse.
fn is_beyond_the_ratio(path: &Path, frames: &[Frame]) -> bool {
    let unpacked: u64 = frames.iter().map(|f| f.data.len() as u64).sum();
    unpacked > EXPANSION_MAX * path.metadata().unwrap().len() + LIMIT_BYTES
}

#[test]
fn dark_frames_of_12_megapixels_are_no_damage() {
    every_reader_finds_it_sound(head(4096, 3072), &dark());
}

#[test]
fn the_largest_frames_are_written_and_read() {
    // 8192 x 8192: one more row is beyond the limit.
    let frames: Vec<Frame> = (0..2).map(|k| flat(k, (8192, 8192), 0)).collect();
    every_reader_finds_it_sound(head(8192, 8192), &frames);
}

#[test]
fn dark_frames_whose_rig_was_destroyed_are_no_damage() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    let frames = dark();
    let settings = WriteSettings::offline(Some(frames[0].format));
    written(&path, head(4096, 3072), settings, &frames);
    let size = path.metadata().unwrap().len();
    assert!(is_beyond_the_ratio(&path, &frames), "{size} bytes");
    let mut bytes = std::fs::read(&path).unwrap();
    let rig = bytes.windows(9).position(|w| w == b"width_px ").unwrap();
    bytes[rig] = b'#';
    std::fs::write(&path, bytes).unwrap();
    let found = info::info(&path).unwrap();
    let images = found.topics.iter().find(|t| t.topic == "/camera/image");
    assert_eq!(images.unwrap().messages, frames.len() as u64);
    let kinds = |d: &(u64, String)| d.1.contains("unpack");
    assert!(!found.damage.iter().any(kinds), "{:?}", found.damage);
}

#[test]
fn noise_in_the_largest_chunk_is_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    let noise: Vec<Frame> = (0..5).map(|k| grey_frame(k, 4096, 3072)).collect();
    let mut settings = WriteSettings::offline(Some(noise[0].format));
    settings.limits.chunk_bytes = FRAME_BYTES_MAX;
    written(&path, head(4096, 3072), settings, &noise);
    let found = info::info(&path).unwrap();
    assert!(found.damage.is_empty(), "{:?}", found.damage);
    assert_eq!(found.chunks, 2, "the head's, and one of all frames");
}

/// Chunks of zeros behind a rig whose frames are smaller: the head says that nothing recorded them.
#[test]
fn a_bomb_behind_the_head_of_a_recording_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("bomb.mcap");
    let file = std::io::BufWriter::new(std::fs::File::create(&path).unwrap());
    let mut writer = mcap::WriteOptions::new()
        .compression(Some(mcap::Compression::Zstd))
        .chunk_size(None)
        .create(file)
        .unwrap();
    let metadata = mcap::write::Metadata {
        name: "rig".to_owned(),
        metadata: [("toml".to_owned(), head(720, 576).rig_toml)].into(),
    };
    writer.write_metadata(&metadata).unwrap();
    let channel = writer
        .add_channel(0, "/zeros", "", &Default::default())
        .unwrap();
    let zeros = vec![0; 48 << 20];
    for sequence in 0..8 {
        let header = mcap::records::MessageHeader {
            channel_id: channel,
            sequence,
            log_time: T0_NS,
            publish_time: T0_NS,
        };
        writer.write_to_known_channel(&header, &zeros).unwrap();
        writer.flush().unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    let found = info::info(&path).unwrap();
    assert!(found.messages < 8, "{}", found.messages);
    let refused = found.damage.iter().filter(|(_, d)| d.contains("unpack"));
    assert_eq!(refused.count() as u64, 8 - found.messages);
    assert!(found.to_string().contains("place(s) of damage"), "{found}");
}

#[test]
fn a_frame_that_no_reader_would_read_is_not_written_and_counted() {
    let dir = tempfile::tempdir().unwrap();
    let large = Frame {
        data: Bytes::from(vec![0; FRAME_BYTES_MAX as usize + 1]),
        ..grey_frame(0, 1, 1)
    };
    let small = grey_frame(1, 16, 16);
    let settings = || WriteSettings::offline(Some(large.format));
    let path = dir.path().join("offline.mcap");
    let mut log = FileRecorder::create(&path, false, Head::default(), settings()).unwrap();
    let error = log.write(T0_NS, &Entry::frame(&large, 0)).unwrap_err();
    assert!(matches!(error, LogError::TooLarge { .. }), "{error}");
    assert!(error.to_string().contains("67108865"), "{error}");

    // A recording goes on, and says what it lacks.
    let path = dir.path().join("live.mcap");
    let parts = FileParts {
        path: path.clone(),
        replace: false,
    };
    let mut log = LogWriter::create(Box::new(parts), Head::default(), settings(), 0).unwrap();
    for (index, frame) in [&large, &small].into_iter().enumerate() {
        let entry = Entry::frame(frame, index as u64);
        log.write(0, T0_NS, &entry, &Default::default);
    }
    let outcome = log.finish(0, &SummaryInput::clean("done"), &Default::default);
    assert!(outcome.lost && outcome.stopped.is_none(), "{outcome:?}");
    assert_eq!(outcome.counts.unwritten["/camera/image"], 1);
    let found = info::info(&path).unwrap();
    assert!(found.damage.is_empty(), "{:?}", found.damage);
    assert!(doctor(&path).unwrap().found("ledger", Grade::Warning));
}

#[test]
fn a_log_that_breaks_off_leaves_nothing_under_its_name() {
    let dir = tempfile::tempdir().unwrap();
    let (path, part) = (
        dir.path().join("run.mcap"),
        dir.path().join("run.mcap.part"),
    );
    let create = || {
        let settings = WriteSettings::offline(None);
        FileRecorder::create_whole(&path, false, Head::default(), settings)
    };
    let files = || std::fs::read_dir(dir.path()).unwrap().count();
    let log = create().unwrap();
    assert!(part.exists() && !path.exists());
    // Two at once: the second does not take the place of the first.
    let error = create().err().unwrap();
    assert!(matches!(error, LogError::BeingWritten { .. }), "{error}");
    drop(log);
    assert_eq!(files(), 0);
    // What a killed process left is in nobody's way.
    std::fs::write(&part, vec![7; 100_000]).unwrap();
    let log = create().unwrap();
    let outcome = log.finish(&SummaryInput::clean("done")).unwrap();
    assert_eq!(outcome.files, std::slice::from_ref(&path));
    assert_eq!(files(), 1);
    assert!(doctor(&path).unwrap().sound);
    assert!(matches!(create(), Err(LogError::OutputExists { .. })));
}

#[test]
fn an_export_that_was_broken_off_is_taken_up_again() {
    let dir = tempfile::tempdir().unwrap();
    let (log, into) = (dir.path().join("run.mcap"), dir.path().join("run"));
    let frames: Vec<Frame> = (0..3).map(|k| grey_frame(k, 16, 16)).collect();
    let settings = WriteSettings::offline(Some(frames[0].format));
    written(&log, head(16, 16), settings, &frames);
    let options = ExportOptions {
        tables: true,
        frames: true,
    };
    let part = into.join("unfinished.part");
    std::fs::create_dir_all(&part).unwrap();
    // Killed while it wrote; killed while the files got their places.
    for moving in [false, true] {
        std::fs::create_dir_all(&part).unwrap();
        std::fs::write(part.join("frames.csv"), "half").unwrap();
        if moving {
            std::fs::write(part.join("moving.txt"), "frames.csv\nmotion.csv").unwrap();
            std::fs::write(into.join("motion.csv"), "of the former attempt").unwrap();
        }
        let exported = export(&log, &into, options).unwrap();
        assert_eq!((exported.frames, exported.rows.len()), (3, 1));
        assert_eq!(std::fs::read_dir(&into).unwrap().count(), 4);
        std::fs::remove_dir_all(&into).unwrap();
        std::fs::create_dir(&into).unwrap();
    }
    // One that goes on is left alone, and so are files that no export left.
    std::fs::create_dir(&part).unwrap();
    let writer = std::fs::File::open(&part).unwrap();
    writer.lock().unwrap();
    let error = export(&log, &into, options).unwrap_err();
    assert!(matches!(error, LogError::BeingWritten { .. }), "{error}");
    drop(writer);
    std::fs::write(into.join("notes.txt"), "precious").unwrap();
    let error = export(&log, &into, options).unwrap_err();
    assert!(matches!(error, LogError::NotEmpty { .. }), "{error}");
    assert_eq!(std::fs::read(into.join("notes.txt")).unwrap(), b"precious");
}
