//! Logs that lie, by accident or on purpose: named by what broke.
#![allow(clippy::unwrap_used, clippy::panic)]

use bytes::Bytes;
use grey_frame::{T0_NS, grey_frame};
use hydroline_core::frame::{Frame, FrameError, GreyRule, PixelFormat};
use hydroline_log::doctor::{Grade, doctor};
use hydroline_log::export::{ExportOptions, export};
use hydroline_log::messages::{pb, timestamp};
use hydroline_log::recover::recover;
use hydroline_log::{
    Closing, Entry, FileOutput, FileRecorder, Head, LogOutcome, LogOutput, LogReader, Record,
    SummaryInput, WriteSettings, info,
};
use std::path::{Path, PathBuf};

#[path = "../../../tests/support/grey_frame.rs"]
mod grey_frame;

/// A log of these frames.
fn written(path: &Path, frames: &[Frame]) {
    let settings = WriteSettings::offline(Some(frames[0].format));
    let head = Head {
        rig_toml: "[rig]\n".into(),
        ..Head::default()
    };
    let mut log = FileRecorder::create(path, false, head, settings).unwrap();
    for (i, frame) in frames.iter().enumerate() {
        let t = T0_NS + i as u64 * 40_000_000;
        log.write(t, &Entry::frame(frame, i as u64)).unwrap();
    }
    log.finish(&SummaryInput::clean("done")).unwrap();
}

fn frames(n: u32) -> Vec<Frame> {
    (0..n).map(|i| grey_frame(i, 64, 48)).collect()
}

/// Records three frames, does something to the file, records two more and ends.
fn disturbed(path: &Path, disturb: impl FnOnce()) -> LogOutcome {
    let mut settings = WriteSettings::offline(Some(PixelFormat::Grey));
    settings.limits.chunk_age_ns = 1_000_000_000;
    settings.limits.sync_ns = Some(2_000_000_000);
    let mut log = FileRecorder::create(path, false, Head::default(), settings).unwrap();
    let mut disturb = Some(disturb);
    for (i, frame) in frames(5).iter().enumerate() {
        if i == 3 {
            let disturb = disturb.take().unwrap();
            disturb();
        }
        // Ten seconds apart: each is synced before the next.
        let t = T0_NS + i as u64 * 10_000_000_000;
        log.write(t, &Entry::frame(frame, i as u64)).unwrap();
    }
    log.finish(&SummaryInput::clean("done")).unwrap()
}

/// Where the data of the one misplaced file is, and the event that was logged when it was noticed.
fn found_again(outcome: &LogOutcome) -> PathBuf {
    let [misplaced] = outcome.misplaced.as_slice() else {
        panic!("{:?}", outcome.misplaced);
    };
    let now = misplaced.now.clone().unwrap();
    let events: Vec<String> = LogReader::open(&now)
        .unwrap()
        .filter_map(|m| match m.unwrap().record {
            Record::Event(e) => Some(e.kind),
            _ => None,
        })
        .collect();
    assert_eq!(events, ["log.name_lost"], "once, while there was time");
    assert!(doctor(&now).unwrap().found("event", Grade::Warning));
    now
}

#[test]
fn the_name_is_not_the_file_what_was_removed_is_saved_and_said() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    let outcome = disturbed(&path, || std::fs::remove_file(&path).unwrap());
    let now = found_again(&outcome);
    assert_eq!(now, dir.path().join("run-saved.mcap"));
    assert_eq!(counted(&now), (11, 0));
}

#[test]
fn the_name_is_not_the_file_what_was_renamed_is_found() {
    let dir = tempfile::tempdir().unwrap();
    let (path, other) = (dir.path().join("run.mcap"), dir.path().join("other.mcap"));
    let outcome = disturbed(&path, || std::fs::rename(&path, &other).unwrap());
    assert_eq!(found_again(&outcome), other);
}

#[test]
fn the_name_is_not_the_file_another_file_in_its_place_is_left_alone() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    let outcome = disturbed(&path, || {
        std::fs::remove_file(&path).unwrap();
        std::fs::write(&path, "theirs").unwrap();
        std::fs::write(dir.path().join("run-saved.mcap"), "theirs, too").unwrap();
    });
    assert_eq!(found_again(&outcome), dir.path().join("run-saved-1.mcap"));
    assert_eq!(std::fs::read(&path).unwrap(), b"theirs");
}

/// A file of at most `most_bytes`, as FAT or RLIMIT_FSIZE have it: beyond that EFBIG.
struct Small {
    file: FileOutput,
    most_bytes: u64,
}

impl std::io::Write for Small {
    fn write(&mut self, buf: &[u8]) -> std::io::Result<usize> {
        self.file.write(buf)
    }
    fn flush(&mut self) -> std::io::Result<()> {
        self.file.flush()
    }
}

impl LogOutput for Small {
    fn sync(&mut self) -> std::io::Result<()> {
        self.file.sync()
    }
    fn reserve(&mut self, end_bytes: u64) -> std::io::Result<()> {
        if end_bytes > self.most_bytes {
            return Err(std::io::Error::from_raw_os_error(libc::EFBIG));
        }
        self.file.reserve(end_bytes)
    }
    fn truncate(&mut self, end_bytes: u64) -> std::io::Result<()> {
        self.file.truncate(end_bytes)
    }
    fn free_bytes(&self) -> Option<u64> {
        self.file.free_bytes()
    }
}

#[test]
fn a_file_at_its_largest_goes_on_in_the_next_part() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().to_owned();
    let opener = move |part: u32| -> std::io::Result<(Box<dyn LogOutput>, PathBuf)> {
        let path = folder.join(format!("{part}.mcap"));
        let file = FileOutput::create(&path, false)?;
        let most_bytes = 400_000;
        Ok((Box::new(Small { file, most_bytes }), path))
    };
    let settings = WriteSettings::offline(Some(PixelFormat::Grey));
    let mut log = FileRecorder::with_opener(Box::new(opener), Head::default(), settings).unwrap();
    for (i, frame) in frames(200).iter().enumerate() {
        let t = T0_NS + i as u64 * 40_000_000;
        log.write(t, &Entry::frame(frame, i as u64)).unwrap();
    }
    let outcome = log.finish(&SummaryInput::clean("done")).unwrap();
    assert!(outcome.files.len() > 1 && !outcome.lost, "{outcome:?}");
    let images = |path: &PathBuf| {
        let read = LogReader::open(path).unwrap().map(|m| m.unwrap().record);
        read.filter(|r| matches!(r, Record::Frame(_))).count()
    };
    assert_eq!(outcome.files.iter().map(images).sum::<usize>(), 200);
}

/// Messages read before and after the first error.
fn counted(path: &Path) -> (usize, usize) {
    let reader = LogReader::open(path).unwrap();
    let read: Vec<bool> = reader.map(|m| m.is_ok()).collect();
    let first = read.iter().position(|ok| !ok).unwrap_or(read.len());
    (first, read[first..].iter().filter(|ok| **ok).count())
}

#[test]
fn two_logs_joined_end_to_end_are_said_and_recovered() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| -> PathBuf { dir.path().join(name) };
    written(&at("a.mcap"), &frames(3));
    written(&at("b.mcap"), &frames(5));
    let mut both = std::fs::read(at("a.mcap")).unwrap();
    both.extend(std::fs::read(at("b.mcap")).unwrap());
    std::fs::write(at("ab.mcap"), &both).unwrap();
    // An image and its account each.
    assert_eq!(counted(&at("ab.mcap")), (6, 10), "an error between the two");
    let found = doctor(&at("ab.mcap")).unwrap();
    assert!(
        !found.sound && found.found("damage", Grade::Error),
        "{found}"
    );
    let recovery = recover(&at("ab.mcap"), &at("mended.mcap")).unwrap();
    assert!(!recovery.was_whole && !recovery.lossy, "{recovery}");
    assert_eq!(counted(&at("mended.mcap")), (16, 0));
}

#[test]
fn bytes_behind_the_end_are_said() {
    let dir = tempfile::tempdir().unwrap();
    let (path, mended) = (dir.path().join("a.mcap"), dir.path().join("b.mcap"));
    written(&path, &frames(3));
    let mut bytes = std::fs::read(&path).unwrap();
    bytes.extend(b"left over from an older, longer file");
    std::fs::write(&path, &bytes).unwrap();
    let found = doctor(&path).unwrap();
    assert!(
        found.to_string().contains("36 bytes stand behind the end"),
        "{found}"
    );
    assert!(!found.sound);
    let recovery = recover(&path, &mended).unwrap();
    assert!(recovery.lossy && !recovery.was_whole, "{recovery}");
}

#[test]
fn a_message_that_does_not_decode_is_no_whole_log() {
    let dir = tempfile::tempdir().unwrap();
    let (path, mended) = (dir.path().join("a.mcap"), dir.path().join("b.mcap"));
    let mut writer = mcap::Writer::new(std::fs::File::create(&path).unwrap()).unwrap();
    let schema = hydroline_log::Topic::Command.schema();
    let schema = writer
        .add_schema(&schema.name, "protobuf", &schema.data)
        .unwrap();
    let channel = writer
        .add_channel(schema, "/thruster/command", "protobuf", &Default::default())
        .unwrap();
    let header = mcap::records::MessageHeader {
        channel_id: channel,
        sequence: 0,
        log_time: T0_NS,
        publish_time: T0_NS,
    };
    writer.write_to_known_channel(&header, &[0xff; 7]).unwrap();
    writer.finish().unwrap();
    let recovery = recover(&path, &mended).unwrap();
    assert_eq!(recovery.undecodable["/thruster/command"], 1);
    assert!(recovery.lossy && !recovery.was_whole, "{recovery}");
    assert!(recovery.to_string().contains("do not decode"));
}

#[test]
fn image_geometry_from_a_log_is_checked_before_it_is_used() {
    let of = |format, width_px, height_px, stride_bytes| Frame {
        format,
        width_px,
        height_px,
        stride_bytes,
        ..grey_frame(0, 64, 48)
    };
    let all = u32::MAX;
    for (w, h, stride) in [
        (0, 576, 0),
        (576, 0, 0),
        (all, all, all),
        (all, 1, 0),
        (64, 48, all),
    ] {
        for format in [PixelFormat::Grey, PixelFormat::Yuyv] {
            let refused = of(format, w, h, stride).to_grey(&GreyRule::default());
            let geometry = matches!(refused, Err(FrameError::Geometry { .. }));
            assert!(geometry, "{w} x {h}, {stride} bytes a row: {refused:?}");
        }
    }
    // Believable, but the bytes are not there: refused without taking the memory.
    let short = of(PixelFormat::Yuyv, 32_768, 32_768, 0).to_grey(&GreyRule::default());
    assert!(matches!(short, Err(FrameError::Short { .. })), "{short:?}");
}

/// A grey frame of 8 x 8 whose header claims 65500 x 65500.
fn jpeg_bomb(sequence: u32) -> Frame {
    let mut jpeg = Vec::new();
    let small = image::GrayImage::from_pixel(8, 8, image::Luma([7]));
    small
        .write_to(
            &mut std::io::Cursor::new(&mut jpeg),
            image::ImageFormat::Jpeg,
        )
        .unwrap();
    // SOF0: marker, length, precision, height, width.
    let sof = jpeg.windows(2).position(|w| w == [0xff, 0xc0]).unwrap();
    jpeg[sof + 5..sof + 9].copy_from_slice(&[0xff, 0xdc, 0xff, 0xdc]);
    Frame {
        format: PixelFormat::Mjpg,
        width_px: 65_500,
        height_px: 65_500,
        stride_bytes: 0,
        data: Bytes::from(jpeg),
        ..grey_frame(sequence, 8, 8)
    }
}

#[test]
fn a_jpeg_bomb_is_a_frame_that_was_lost() {
    let bomb = jpeg_bomb(0);
    let refused = bomb.to_grey(&GreyRule::default());
    assert!(
        matches!(refused, Err(FrameError::TooLarge { .. })),
        "{refused:?}"
    );
    let dir = tempfile::tempdir().unwrap();
    let (path, into) = (dir.path().join("a.mcap"), dir.path().join("out"));
    written(&path, &[jpeg_bomb(0), jpeg_bomb(1)]);
    let options = ExportOptions {
        tables: false,
        frames: true,
    };
    let exported = export(&path, &into, options).unwrap();
    assert_eq!((exported.frames, exported.frames_undecodable), (0, 2));
    assert!(!doctor(&path).unwrap().sound);
}

#[test]
fn chunks_that_unpack_to_more_than_any_recording_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("bomb.mcap");
    let file = std::io::BufWriter::new(std::fs::File::create(&path).unwrap());
    let mut writer = mcap::WriteOptions::new()
        .compression(Some(mcap::Compression::Zstd))
        .chunk_size(None)
        .create(file)
        .unwrap();
    let channel = writer
        .add_channel(0, "/zeros", "", &Default::default())
        .unwrap();
    let zeros = vec![0; 48 << 20];
    for sequence in 0..12 {
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
    let bytes = std::fs::metadata(&path).unwrap().len();
    let read = info::info(&path).unwrap();
    let unpacked = read.messages * (48 << 20);
    assert!(read.messages > 0, "one chunk is within the limit");
    let most = hydroline_log::EXPANSION_MAX * bytes + hydroline_log::LIMIT_BYTES;
    assert!(unpacked <= most, "{unpacked} bytes out of {bytes}");
    assert!(
        read.damage.iter().any(|(_, d)| d.contains("unpack")),
        "{:?}",
        read.damage
    );
}

#[test]
fn a_dark_recording_is_no_bomb() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("dark.mcap");
    let dark: Vec<Frame> = (0..120)
        .map(|i| Frame {
            data: Bytes::from(vec![0; 720 * 576]),
            ..grey_frame(i, 720, 576)
        })
        .collect();
    written(&path, &dark);
    let found = doctor(&path).unwrap();
    assert!(!found.found("damage", Grade::Error), "{found}");
    assert_eq!(counted(&path), (240, 0));
}

#[test]
fn cells_of_a_table_are_no_formulas() {
    let dir = tempfile::tempdir().unwrap();
    let (path, into) = (dir.path().join("a.mcap"), dir.path().join("out"));
    let settings = WriteSettings::offline(None);
    let mut log = FileRecorder::create(&path, false, Head::default(), settings).unwrap();
    let names = [
        "=1+1",
        " @sum",
        "-cmd|calc",
        "+x",
        "port",
        "-4.5",
        "＝HYPERLINK(1)",
    ];
    for (i, thruster) in names.into_iter().enumerate() {
        let t = T0_NS + i as u64;
        let command = pb::ThrusterCommand {
            timestamp: Some(timestamp(t)),
            thruster: thruster.to_owned(),
            ..Default::default()
        };
        log.write(t, &Entry::command(&command)).unwrap();
    }
    log.finish(&SummaryInput::clean("done")).unwrap();
    let options = ExportOptions {
        tables: true,
        frames: false,
    };
    export(&path, &into, options).unwrap();
    let text = std::fs::read_to_string(into.join("commands.csv")).unwrap();
    let cells: Vec<&str> = text
        .lines()
        .skip(1)
        .map(|l| l.split(',').nth(3).unwrap())
        .collect();
    assert_eq!(
        cells,
        [
            "'=1+1",
            "' @sum",
            "'-cmd|calc",
            "'+x",
            "port",
            "-4.5",
            "'＝HYPERLINK(1)"
        ]
    );
    let back = LogReader::open(&path).unwrap().next().unwrap().unwrap();
    assert!(matches!(back.record, Record::Command(c) if c.thruster == "=1+1"));
}

/// The end of a log is believed where it is whole and agrees with its own digest, and nowhere else.
#[test]
fn the_closing_of_a_cut_or_altered_log_is_not_believed() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.mcap");
    written(&path, &frames(3));
    let whole = Closing::of(&path).unwrap();
    assert_eq!(whole.messages_of("/camera/image"), 3);
    assert_eq!(whole.messages_of("/vehicle/motion"), 0);
    assert!(whole.summary.values().any(|v| v == "done"), "{whole:?}");

    let bytes = std::fs::read(&path).unwrap();
    let changed = |bytes: &[u8]| {
        let path = dir.path().join("b.mcap");
        std::fs::write(&path, bytes).unwrap();
        Closing::of(&path)
    };
    for cut in [1, 30, 200, bytes.len() / 2, bytes.len() - 10] {
        assert_eq!(changed(&bytes[..bytes.len() - cut]), None, "{cut}");
    }
    // The last place where the reason of the end stands is in the summary's map.
    let at = bytes.windows(4).rposition(|w| w == b"done").unwrap();
    let mut altered = bytes.clone();
    altered[at] ^= 1;
    assert!(changed(&altered).is_none_or(|c| c.summary.is_empty()));
    assert_eq!(Closing::of(&dir.path().join("none.mcap")), None);
}
