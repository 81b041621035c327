//! Logs that `replay` writes are sound, carry over our own topics, and say what was not copied.

use std::path::Path;

use bytes::Bytes;
use hydroline::analysis::Analyst;
use hydroline::log::messages::{foxglove_time, frame_info};
use hydroline::log::{doctor::doctor, *};
use hydroline::replay::{Options, Report, replay};
use hydroline::stripe::ExtractorConfig;
use hydroline_rigs::PixelFormat;

use super::support::{T0_NS, command, frame, head, noise};

/// As the daemon writes it: frames with the profiles extracted live (one of them falsified if
/// `falsify`), commands, a line of the daemon's log. Frames 3 and 4 never reached the file.
fn record_like(path: &Path, falsify: bool) {
    let settings = WriteSettings::offline(Some(PixelFormat::Grey));
    let mut log = FileRecorder::create(path, false, head(), settings).unwrap();
    let mut analyst = Analyst::new(ExtractorConfig::default(), None, Default::default());
    // Commands are never dropped: their own count has no gap.
    for (sequence, i) in (0..9).filter(|i| ![3, 4].contains(i)).enumerate() {
        let t = T0_NS + u64::from(i) * 40_000_000;
        let frame = frame(i, 64, 48, noise(u64::from(i), 64 * 48));
        log.write(t, &Entry::frame(&frame, u64::from(i))).unwrap();
        let mut profile = analyst.analyse(&frame);
        if falsify && i == 5 {
            profile.fault.push('!');
        }
        log.write(t + 5_000_000, &Entry::profile(&profile)).unwrap();
        log.write(t + 15_000_000, &Entry::command(&command(sequence as u32)))
            .unwrap();
    }
    let line = messages::Log {
        timestamp: Some(foxglove_time(T0_NS)),
        message: "camera opened".into(),
        ..Default::default()
    };
    log.write(T0_NS + 400_000_000, &Entry::log_line(&line))
        .unwrap();
    log.finish(&SummaryInput::clean("plan done")).unwrap();
}

fn replayed(log: &Path, out: &Path, keep_images: bool) -> (Report, Vec<Record>) {
    let options = Options {
        keep_images,
        ..Options::default()
    };
    let (report, _) = replay(log, out, &options, &mut |_| {}).unwrap();
    let records = LogReader::open(out).unwrap().map(|m| m.unwrap().record);
    (report, records.collect())
}

#[test]
fn a_replay_is_sound_with_and_without_its_images() {
    let dir = tempfile::tempdir().unwrap();
    let log = dir.path().join("a.mcap");
    record_like(&log, false);
    for (name, keep, images) in [("lean.mcap", false, 0), ("full.mcap", true, 7)] {
        let out = dir.path().join(name);
        let (report, records) = replayed(&log, &out, keep);
        assert_eq!(
            (report.live, report.live_identical, report.live_different),
            (7, 7, 0)
        );
        let count = |f: fn(&Record) -> bool| records.iter().filter(|r| f(r)).count();
        assert_eq!(count(|r| matches!(r, Record::Frame(_))), images);
        assert_eq!(count(|r| matches!(r, Record::Command(_))), 7);
        assert_eq!(count(|r| matches!(r, Record::Log(_))), 1);
        // One account per frame, with the recording's index: the two dropped frames stay visible.
        let indexes: Vec<u64> = records
            .iter()
            .filter_map(|r| match r {
                Record::FrameInfo(info) => Some(info.frame_index),
                _ => None,
            })
            .collect();
        assert_eq!(indexes, [0, 1, 2, 5, 6, 7, 8]);
        let diagnosis = doctor(&out).unwrap();
        // The recording's own loss is still reported, and nothing else is found.
        assert!(
            diagnosis
                .findings
                .iter()
                .all(|f| f.check == "frame_gap" || f.grade == hydroline::log::doctor::Grade::Note),
            "{diagnosis}"
        );
        assert!(!diagnosis.found("image", hydroline::log::doctor::Grade::Warning));
    }
}

#[test]
fn a_profile_that_comes_out_otherwise_is_counted_and_ends_in_3() {
    let dir = tempfile::tempdir().unwrap();
    let log = dir.path().join("a.mcap");
    record_like(&log, true);
    let (report, _) = replayed(&log, &dir.path().join("b.mcap"), false);
    assert_eq!((report.live_identical, report.live_different), (6, 1));
    // The head's rig of this log is no whole rig, so the command is given the built-in one:
    // then the rig is another, and differing profiles are no reason to complain.
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_hydroline"))
        .args(["replay", "--rig", "lshpi", "--out"])
        .arg(dir.path().join("c.mcap"))
        .arg(&log)
        .output()
        .unwrap();
    // That none of its frames has a pose, is.
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{stderr}");
    assert!(
        stderr.contains("have a pose") && !stderr.contains("came out otherwise"),
        "{stderr}"
    );
}

#[test]
fn foreign_topics_are_counted() {
    let dir = tempfile::tempdir().unwrap();
    let log = dir.path().join("foreign.mcap");
    let mut writer = mcap::Writer::new(std::fs::File::create(&log).unwrap()).unwrap();
    let schema = Topic::RawImage.schema();
    let schema = writer
        .add_schema(&schema.name, "protobuf", &schema.data)
        .unwrap();
    let image = writer
        .add_channel(schema, "/camera/image", "protobuf", &MetadataMap::new())
        .unwrap();
    let gps = writer
        .add_channel(0, "/gps", "json", &MetadataMap::new())
        .unwrap();
    let pixels = frame(0, 64, 48, noise(0, 64 * 48));
    assert_eq!(frame_info(&pixels, 0).sequence, 0);
    let messages::ImageMessage::Raw(raw) = messages::image_message(&pixels) else {
        panic!("grey frames are raw images")
    };
    let header = |channel_id, sequence| mcap::records::MessageHeader {
        channel_id,
        sequence,
        log_time: T0_NS,
        publish_time: T0_NS,
    };
    writer
        .write_to_known_channel(&header(image, 0), &prost::Message::encode_to_vec(&raw))
        .unwrap();
    for i in 0..3 {
        writer
            .write_to_known_channel(&header(gps, i), &Bytes::from_static(b"{}"))
            .unwrap();
    }
    writer.finish().unwrap();
    let out = dir.path().join("b.mcap");
    let (report, _) = replayed(&log, &out, true);
    assert_eq!(report.frames, 1);
    assert_eq!(report.foreign["/gps"], 3);
    let mut reader = LogReader::open(&out).unwrap();
    assert_eq!(reader.by_ref().filter(Result::is_err).count(), 0);
    assert_eq!(reader.metadata()["summary"]["replay.not_copied./gps"], "3");
}
