//! Record and read back, in memory.

use std::io::Cursor;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use proptest::prelude::*;

use super::*;
use fixtures::{MemoryDisk, T0_NS, command, grey_frame};
use hydroline_core::clock::{Clock, ClockTriple, ManualClock, SystemClock};
use hydroline_core::event::{Event, Severity, kind};

pub(crate) mod fixtures;
#[path = "recover/tests.rs"]
mod salvage;

fn head() -> Head {
    Head {
        rig_toml: "[rig]\nname = \"bench\"\n".into(),
        calibration_toml: None,
        session: MetadataMap::from([
            ("host".into(), "tank".into()),
            ("planned_s".into(), "30".into()),
        ]),
        ..Head::default()
    }
}

fn offline() -> WriteSettings {
    WriteSettings::offline(Some(hydroline_rigs::PixelFormat::Grey))
}

fn live() -> WriteSettings {
    WriteSettings {
        limits: Limits {
            min_free_bytes: 0,
            ..Limits::default()
        },
        ..offline()
    }
}

fn read(bytes: Vec<u8>) -> Vec<LogMessage> {
    let reader = LogReader::from_source(Path::new("memory.mcap"), Cursor::new(bytes)).unwrap();
    reader.collect::<Result<_, _>>().unwrap()
}

/// A short offline log of `n` frames with a command each.
fn sample(disk: &MemoryDisk, n: u32, settings: WriteSettings) -> LogOutcome {
    let mut log = FileRecorder::with_opener(disk.opener(), head(), settings).unwrap();
    for i in 0..n {
        let t = T0_NS + u64::from(i) * 40_000_000;
        log.write(t, &Entry::frame(&grey_frame(i, 72, 58), u64::from(i)))
            .unwrap();
        log.write(t + 1, &Entry::command(&command(i))).unwrap();
    }
    log.finish(&SummaryInput::clean("plan done")).unwrap()
}

#[test]
fn what_goes_in_comes_out_bit_by_bit() {
    let disk = MemoryDisk::default();
    let outcome = sample(&disk, 30, offline());
    assert!(!outcome.lost);
    let (mut frames, mut commands, mut infos) = (0, 0, 0);
    for m in read(disk.file(0)) {
        match m.record {
            Record::Frame(frame) => {
                assert_eq!(frame, grey_frame(frames, 72, 58));
                assert_eq!(
                    (m.sequence, m.publish_ns),
                    (frames, frame.meta.mid_exposure_ns)
                );
                frames += 1;
            }
            Record::Command(c) => {
                assert_eq!(c, command(commands));
                assert_eq!(m.log_ns, T0_NS + u64::from(commands) * 40_000_000 + 1);
                commands += 1;
            }
            Record::FrameInfo(info) => {
                assert_eq!(info.frame_index, infos);
                infos += 1;
            }
            other => panic!("unexpected {other:?}"),
        }
    }
    assert_eq!((frames, commands, infos), (30, 30, 30));
}

#[test]
fn the_index_finds_what_reading_everything_finds() {
    let disk = MemoryDisk::default();
    sample(&disk, 40, offline());
    let (whole, folder) = (disk.file(0), tempfile::tempdir().unwrap());
    let all = read(whole.clone());
    let commands: Vec<&LogMessage> = all
        .iter()
        .filter(|m| matches!(m.record, Record::Command(_)))
        .collect();
    let topic = Topic::Command.name();
    // As it was written; without its summary; cut within the data.
    let no_index = &whole[..whole.len() - 100];
    for (bytes, least) in [
        (&whole[..], 40),
        (no_index, 40),
        (&whole[..whole.len() / 2], 5),
    ] {
        let path = folder.path().join(format!("{}.mcap", bytes.len()));
        std::fs::write(&path, bytes).unwrap();
        let log = IndexedLog::open(&path).unwrap();
        assert_eq!(log.end_missing().is_some(), bytes.len() < whole.len());
        let places = log.places(&[topic]).into_iter();
        let found: Vec<LogMessage> = places
            .flat_map(|p| log.messages(p, &[topic]).unwrap())
            .collect();
        assert!(found.len() >= least, "{} of {}", found.len(), bytes.len());
        assert_eq!(log.counts()[topic], found.len() as u64);
        assert!(found.iter().eq(commands.iter().take(found.len()).copied()));
        let last = found.len() as u64 - 1;
        assert_eq!(log.nth(topic, last).unwrap().as_ref(), found.last());
        assert_eq!(log.nth(topic, last + 1).unwrap(), None);
        assert_eq!(log.metadata()["rig"], read_metadata(&path, "rig"));
    }
    // A chunk whose bytes changed is found when it is read.
    let mut changed = whole.clone();
    let middle = whole.len() / 3;
    changed[middle] ^= 0x40;
    let path = folder.path().join("changed.mcap");
    std::fs::write(&path, &changed).unwrap();
    let log = IndexedLog::open(&path).unwrap();
    let image = Topic::RawImage.name();
    let mut read = log.places(&[image, topic]).into_iter();
    assert!(read.any(|p| matches!(
        log.messages(p, &[image, topic]),
        Err(LogError::Damaged { .. })
    )));
}

fn read_metadata(path: &Path, name: &str) -> MetadataMap {
    LogReader::open(path).unwrap().metadata()[name].clone()
}

#[test]
fn the_head_is_durable_before_the_first_message() {
    let disk = MemoryDisk::default();
    let log = FileRecorder::with_opener(disk.opener(), head(), offline()).unwrap();
    let (bytes, syncs) = (disk.file(0), disk.state.lock().unwrap().syncs);
    assert_eq!(syncs, 1);
    let mut reader = LogReader::from_source(Path::new("m"), Cursor::new(bytes)).unwrap();
    assert!(matches!(
        reader.next(),
        Some(Err(LogError::Damaged {
            damage: Damage::NoEnd,
            ..
        }))
    ));
    assert_eq!(reader.rig_toml(), Some(head().rig_toml.as_str()));
    assert_eq!(reader.metadata()["session"]["planned_s"], "30");
    assert_eq!(reader.metadata()["session"]["part"], "0");
    assert_eq!(reader.metadata()["calibration"]["status"], "none");
    drop(log);
}

#[test]
fn the_same_input_gives_the_same_bytes() {
    let disks = [MemoryDisk::default(), MemoryDisk::default()];
    for disk in &disks {
        let mut log = FileRecorder::with_opener(disk.opener(), head(), offline()).unwrap();
        let event = Event::new(T0_NS, Severity::Error, &kind::CAMERA_GAP, "x")
            .with("sequence", 1.0)
            .with("lost", 2.0);
        for i in 0..5 {
            log.write(T0_NS + i, &Entry::event(&event)).unwrap();
            log.write(T0_NS + i, &Entry::frame(&grey_frame(i as u32, 90, 50), i))
                .unwrap();
        }
        log.finish(&SummaryInput::clean("done")).unwrap();
    }
    assert_eq!(disks[0].file(0), disks[1].file(0));
}

#[test]
fn the_crates_own_reader_agrees() {
    let disk = MemoryDisk::default();
    sample(&disk, 40, offline());
    let bytes = disk.file(0);
    let theirs: Vec<_> = mcap::io::MessageReader::new(Cursor::new(&bytes))
        .collect::<Result<_, _>>()
        .unwrap();
    let ours = read(bytes.clone());
    assert_eq!(theirs.len(), ours.len());
    for (a, b) in theirs.iter().zip(&ours) {
        assert_eq!(
            (a.log_time, a.publish_time, a.sequence),
            (b.log_ns, b.publish_ns, b.sequence)
        );
    }
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    assert_eq!(summary.stats.unwrap().message_count, 120);
    assert_eq!(summary.metadata_indexes.len(), 4);
    assert!(!summary.chunk_indexes.is_empty());
}

#[test]
fn rotation_loses_nothing_and_every_part_stands_alone() {
    let disk = MemoryDisk::default();
    let settings = WriteSettings {
        limits: Limits {
            rotate_bytes: 60_000,
            chunk_bytes: 20_000,
            ..Limits::offline()
        },
        ..offline()
    };
    let outcome = sample(&disk, 100, settings);
    let parts = disk.state.lock().unwrap().files.len();
    assert!(parts > 3, "{parts} parts");
    assert_eq!(outcome.files.len(), parts);
    let (mut frames, mut commands, mut rotations) = (Vec::new(), Vec::new(), 0);
    for part in 0..parts {
        let bytes = disk.file(part);
        let mut reader = LogReader::from_source(Path::new("m"), Cursor::new(bytes)).unwrap();
        assert!(reader.rig_toml().is_some());
        let mut total = 0;
        for m in reader.by_ref() {
            total += 1;
            match m.unwrap().record {
                Record::Frame(f) => frames.push(f.meta.sequence),
                Record::Command(c) => commands.push(c.sequence),
                Record::Event(e) => {
                    assert_eq!(e.kind, "log.rotated");
                    rotations += 1;
                }
                _ => {}
            }
        }
        let meta = reader.metadata();
        assert_eq!(meta["session"]["part"], part.to_string());
        assert_eq!(meta["summary"]["part.number"], part.to_string());
        assert_eq!(
            meta["summary"]["part.last"],
            (part + 1 == parts).to_string()
        );
        assert_eq!(meta["summary"]["messages.total"], total.to_string());
    }
    assert_eq!(frames, (0..100).collect::<Vec<u32>>());
    assert_eq!(commands, (0..100).collect::<Vec<u32>>());
    assert_eq!(rotations, parts - 1);
}

#[test]
fn a_recording_through_the_thread_keeps_order_and_accounts() {
    let disk = MemoryDisk::default();
    let clock: Arc<dyn Clock> = Arc::new(SystemClock);
    let log = Recorder::start(disk.opener(), head(), live(), clock).unwrap();
    let other = log.clone();
    let producer = std::thread::spawn(move || {
        for i in 0..200 {
            other.command(&command(i));
        }
    });
    for i in 0..50 {
        let mut frame = grey_frame(i * 2, 72, 58);
        frame.meta.lost_before.sequence_gap = u32::from(i > 0);
        log.frame(&frame, u64::from(i));
    }
    producer.join().unwrap();
    let outcome = log.finish(&SummaryInput::clean("plan done")).unwrap();
    assert!(!outcome.lost && outcome.stopped.is_none());
    assert!(matches!(
        log.finish(&SummaryInput::clean("again")),
        Err(LogError::Finished)
    ));
    log.command(&command(201));
    assert_eq!(log.counts().after_end, 1);
    let mut reader = LogReader::from_source(Path::new("m"), Cursor::new(disk.file(0))).unwrap();
    let messages: Vec<_> = reader.by_ref().collect::<Result<_, _>>().unwrap();
    assert!(messages.windows(2).all(|w| w[0].log_ns <= w[1].log_ns));
    let commands: Vec<u32> = messages
        .iter()
        .filter_map(|m| {
            if let Record::Command(c) = &m.record {
                Some(c.sequence)
            } else {
                None
            }
        })
        .collect();
    assert_eq!(commands, (0..200).collect::<Vec<_>>());
    let s = &reader.metadata()["summary"];
    assert_eq!(
        (s["frames.received"].as_str(), s["frames.expected"].as_str()),
        ("50", "99")
    );
    assert_eq!(
        (
            s["frames.lost.sequence_gap"].as_str(),
            s["frames.logged"].as_str()
        ),
        ("49", "50")
    );
    assert_eq!(
        (s["stop.clean"].as_str(), s["stop.reason"].as_str()),
        ("true", "plan done")
    );
}

/// A clock whose CLOCK_REALTIME may be an hour back, as NTP or an operator would set it.
struct Stepped(ManualClock, AtomicBool);

impl Clock for Stepped {
    fn triple(&self) -> ClockTriple {
        let mut now = self.0.triple();
        if self.1.load(Ordering::Relaxed) {
            now.realtime_ns -= 3_600_000_000_000;
        }
        now
    }

    fn sleep(&self, duration: Duration) {
        self.0.sleep(duration);
    }
}

#[test]
fn a_clock_step_is_an_event_and_log_time_does_not_go_back() {
    let disk = MemoryDisk::default();
    let clock = Arc::new(Stepped(
        ManualClock::new(1_000, T0_NS),
        AtomicBool::new(false),
    ));
    let log = Recorder::start(disk.opener(), head(), live(), clock.clone()).unwrap();
    log.command(&command(0));
    clock.1.store(true, Ordering::Relaxed);
    log.command(&command(1));
    clock.0.advance(Duration::from_millis(1));
    log.command(&command(2));
    log.finish(&SummaryInput::clean("done")).unwrap();
    let messages = read(disk.file(0));
    assert!(messages.iter().all(|m| m.log_ns == T0_NS));
    let steps: Vec<_> = messages
        .iter()
        .filter_map(|m| {
            if let Record::Event(e) = &m.record {
                Some(e)
            } else {
                None
            }
        })
        .collect();
    assert_eq!(steps.len(), 1);
    assert_eq!(
        (steps[0].kind.as_str(), steps[0].values["step_s"]),
        ("clock.step", -3600.0)
    );
}

#[test]
fn a_dropped_recorder_still_closes_its_file() {
    let disk = MemoryDisk::default();
    let log = Recorder::start(disk.opener(), head(), live(), Arc::new(SystemClock)).unwrap();
    log.command(&command(0));
    drop(log);
    let mut reader = LogReader::from_source(Path::new("m"), Cursor::new(disk.file(0))).unwrap();
    assert_eq!(reader.by_ref().map(Result::unwrap).count(), 1);
    assert_eq!(reader.metadata()["summary"]["stop.clean"], "false");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// A disk that fills up at any point: the file is whole, what is in it is a prefix of what was
    /// sent, and every frame and command that is not in it is counted.
    #[test]
    fn a_full_disk_ends_cleanly(room in 330_000u64..680_000, lying in any::<bool>()) {
        let disk = MemoryDisk::default();
        if lying {
            // Free space that vanishes after it was claimed: the write itself fails.
            disk.state.lock().unwrap().fails_after = Some(room);
        } else {
            disk.state.lock().unwrap().room = Some(room);
        }
        let log = Recorder::start(disk.opener(), head(), live(), Arc::new(SystemClock)).unwrap();
        for i in 0..400 {
            log.frame(&grey_frame(i, 72, 58), u64::from(i));
            log.command(&command(i));
        }
        let outcome = log.finish(&SummaryInput::clean("plan done")).unwrap();
        prop_assert!(outcome.lost);
        prop_assert!(outcome.stopped.is_some());
        let bytes = disk.file(0);
        prop_assert!(bytes.len() as u64 <= room + 4096);
        let mut reader = LogReader::from_source(Path::new("m"), Cursor::new(bytes)).unwrap();
        let (mut frames, mut commands) = (0u32, 0u32);
        for m in reader.by_ref() {
            match m.unwrap().record {
                Record::Frame(f) => {
                    prop_assert_eq!(f.meta.sequence, frames);
                    frames += 1;
                }
                Record::Command(c) => {
                    prop_assert_eq!(c.sequence, commands);
                    commands += 1;
                }
                _ => {}
            }
        }
        prop_assert!(frames < 400);
        let unwritten = &outcome.counts.unwritten;
        prop_assert_eq!(u64::from(frames) + unwritten["/camera/image"], 400);
        prop_assert_eq!(u64::from(commands) + unwritten["/thruster/command"], 400);
        let s = &reader.metadata()["summary"];
        prop_assert_eq!(s["stop.clean"].as_str(), "false");
        prop_assert_eq!(s["frames.logged"].parse::<u32>().unwrap(), frames);
        let n = |k: &str| s[k].parse::<u64>().unwrap();
        prop_assert_eq!(n("frames.logged") + n("frames.dropped.queue") + n("frames.dropped.disk"), n("frames.received"));
        prop_assert_eq!(n("frames.received"), n("frames.expected"));
    }
}

/// A log of our own with these entries, examined.
fn examined(entries: &[Entry], summary: &SummaryInput) -> doctor::Diagnosis {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.mcap");
    let mut log = FileRecorder::create(&path, false, head(), offline()).unwrap();
    for (i, entry) in entries.iter().enumerate() {
        log.write(T0_NS + i as u64, entry).unwrap();
    }
    log.finish(summary).unwrap();
    doctor::doctor(&path).unwrap()
}

/// Regression: the guest's emulated camera sent one frame late; the account took the loss back, the doctor did not.
#[test]
fn a_loss_that_was_taken_back_leaves_a_log_sound() {
    let done = SummaryInput::clean("done");
    let reported = |lost, of_frame: f64| {
        let mut late = grey_frame(1, 16, 8);
        late.meta.lost_before.time_gap = lost;
        let gap = Event::new(T0_NS, Severity::Error, &kind::CAMERA_GAP, "lost")
            .with("sequence", 1.0)
            .with("lost", f64::from(lost));
        let back = Event::new(T0_NS, Severity::Info, &kind::CAMERA_GAP_RETRACTED, "late")
            .with("sequence", of_frame)
            .with("frames", 1.0);
        examined(
            &[
                Entry::frame(&grey_frame(0, 16, 8), 0),
                Entry::event(&gap),
                Entry::frame(&late, 1),
                Entry::event(&back),
                Entry::frame(&grey_frame(2, 16, 8), 2),
            ],
            &done,
        )
    };
    let (all, half, another) = (reported(1, 1.0), reported(2, 1.0), reported(1, 2.0));
    assert!(all.sound, "{all}");
    // A loss that is taken back of one frame says nothing of another.
    assert!(!another.sound, "{another}");
    assert!(
        !half.sound && half.to_string().contains("camera.gap"),
        "{half}"
    );
}

#[test]
fn the_doctor_checks_the_ledger_the_gaps_and_the_clocks() {
    use doctor::Grade::{Error, Note, Warning};
    let done = SummaryInput::clean("done");
    let frame = |sequence, gap, index| {
        let mut f = grey_frame(sequence, 16, 8);
        f.meta.lost_before.sequence_gap = gap;
        Entry::frame(&f, index)
    };
    let stated = [frame(0, 0, 0), frame(3, 2, 1), frame(0, 0, 2)];
    let diagnosis = examined(&stated, &done);
    assert!(
        diagnosis.sound && diagnosis.found("ledger", Note),
        "{diagnosis}"
    );
    let unstated = examined(&[frame(0, 0, 0), frame(3, 0, 1)], &done);
    assert!(unstated.found("frame_gap", Error), "{unstated}");
    let dropped = examined(&[frame(0, 0, 0), frame(3, 0, 3)], &done);
    assert!(
        dropped.found("frame_gap", Warning) && !dropped.found("frame_gap", Error),
        "{dropped}"
    );

    let wrong = FrameLedger {
        expected: 5,
        received: 1,
        ..FrameLedger::default()
    };
    let wrong = SummaryInput {
        frames: Some(wrong),
        ..done.clone()
    };
    assert!(examined(&[frame(0, 0, 0)], &wrong).found("ledger", Error));

    let commands = [0, 1, 4].map(|n| Entry::command(&command(n)));
    let gap = examined(&commands, &done);
    assert!(
        gap.found("command_gap", Error) && gap.to_string().contains("2 commands"),
        "{gap}"
    );

    let pair = |monotonic_ns, realtime_ns| {
        let triple = hydroline_core::clock::ClockTriple {
            monotonic_ns,
            realtime_ns,
            ..Default::default()
        };
        Entry::clock(&messages::clock_message(&triple, None))
    };
    let steady = examined(
        &[pair(0, T0_NS), pair(1_000_000_000, T0_NS + 1_000_000_500)],
        &done,
    );
    assert!(steady.sound && steady.findings.is_empty(), "{steady}");
    let stepped = examined(
        &[pair(0, T0_NS), pair(1_000_000_000, T0_NS + 1_020_000_000)],
        &done,
    );
    assert!(stepped.found("clock", Warning), "{stepped}");

    let mut short = grey_frame(0, 16, 8);
    short.data = short.data.slice(..100);
    assert!(examined(&[Entry::frame(&short, 0)], &done).found("image", Error));
    short.meta.fault = Some(hydroline_core::frame::FrameFault::Truncated);
    assert!(examined(&[Entry::frame(&short, 0)], &done).sound);

    let ended = SummaryInput {
        clean: false,
        ..SummaryInput::clean("limit x")
    };
    let ended = examined(&[], &ended);
    assert!(
        ended.found("summary", Warning) && ended.to_string().contains("limit x"),
        "{ended}"
    );
}

#[test]
fn a_writer_that_panics_is_reported_at_once_and_the_queue_stops_growing() {
    let disk = MemoryDisk::default();
    let log = Recorder::start(disk.opener(), head(), live(), Arc::new(SystemClock)).unwrap();
    let head_bytes = disk.file(0).len() as u64;
    disk.state.lock().unwrap().panics_after = Some(head_bytes + 20_000);
    let mut sent = 0;
    // Bounded by the number of entries, not by time: 20 kB are some ten frames, the queue holds 256 MB.
    while log.stopped().is_none() && sent < 2_000 {
        log.frame(&grey_frame(sent, 72, 58), u64::from(sent));
        sent += 1;
        std::thread::sleep(Duration::from_millis(2));
    }
    let words = log.stopped().unwrap();
    assert!(
        words.contains("bad sink") && words.contains("recover"),
        "{words}"
    );
    assert_eq!(log.counts().queue_bytes, 0);
    let before = log.counts().after_end;
    for i in 0..50 {
        log.command(&command(i));
    }
    let counts = log.counts();
    assert_eq!((counts.queue_bytes, counts.after_end - before), (0, 50));
    assert!(matches!(
        log.finish(&SummaryInput::clean("plan done")),
        Err(LogError::WriterPanicked)
    ));
}

#[test]
fn every_part_holds_the_calibrations_and_says_that_its_ledger_runs_on() {
    let disk = MemoryDisk::default();
    let settings = WriteSettings {
        limits: Limits {
            rotate_bytes: 60_000,
            chunk_bytes: 10_000,
            ..offline().limits
        },
        ..offline()
    };
    let mut log = FileRecorder::with_opener(disk.opener(), head(), settings).unwrap();
    let plane = |n: u64| messages::pb::PlaneCalibration {
        timestamp: Some(messages::timestamp(T0_NS + n)),
        ..Default::default()
    };
    let camera = messages::CameraCalibration {
        width: 72,
        ..Default::default()
    };
    log.write(T0_NS, &Entry::camera_calibration(&camera))
        .unwrap();
    log.write(T0_NS, &Entry::plane_calibration(&plane(1)))
        .unwrap();
    log.write(T0_NS, &Entry::plane_calibration(&plane(2)))
        .unwrap();
    for i in 0..100 {
        let t = T0_NS + u64::from(i) * 40_000_000;
        log.write(t, &Entry::frame(&grey_frame(i, 72, 58), u64::from(i)))
            .unwrap();
    }
    let outcome = log.finish(&SummaryInput::clean("plan done")).unwrap();
    let parts = outcome.files.len();
    assert!(parts >= 3, "{parts} parts");
    let dir = tempfile::tempdir().unwrap();
    for part in 0..parts {
        let bytes = disk.file(part);
        let path = dir.path().join(format!("{part}.mcap"));
        std::fs::write(&path, &bytes).unwrap();
        let diagnosis = doctor::doctor(&path).unwrap();
        assert!(diagnosis.sound, "part {part}: {diagnosis}");
        let mut reader = LogReader::from_source(Path::new("m"), Cursor::new(bytes)).unwrap();
        let records: Vec<Record> = reader.by_ref().map(|m| m.unwrap().record).collect();
        let first_frame = records
            .iter()
            .position(|r| matches!(r, Record::FrameInfo(_)));
        // The last part may end before its first frame.
        let before = &records[..first_frame.unwrap_or(records.len())];
        assert!(
            before.contains(&Record::CameraCalibration(camera.clone())),
            "part {part} begins without /camera/calibration"
        );
        let last_plane = before
            .iter()
            .rfind(|r| matches!(r, Record::PlaneCalibration(_)));
        assert_eq!(last_plane, Some(&Record::PlaneCalibration(plane(2))));
        let summary = &reader.metadata()["summary"];
        let last = part + 1 == parts;
        assert_eq!(summary.contains_key("frames.received"), last);
        assert_eq!(summary.contains_key("frames_so_far.received"), !last);
    }
}

#[test]
fn a_recording_that_broke_off_is_recovered_with_a_summary_of_what_is_left() {
    let dir = tempfile::tempdir().unwrap();
    let whole = dir.path().join("whole.mcap");
    let mut log = FileRecorder::create(&whole, false, head(), offline()).unwrap();
    for i in 0..40u32 {
        let mut frame = grey_frame(i + u32::from(i >= 10), 72, 58);
        // One lost by number before the 10th, one by time before the 20th that was only late.
        frame.meta.lost_before.sequence_gap = u32::from(i == 10);
        frame.meta.lost_before.time_gap = u32::from(i == 20);
        let at_ns = T0_NS + u64::from(i) * 40_000_000;
        log.write(at_ns, &Entry::frame(&frame, u64::from(i)))
            .unwrap();
        if i == 21 {
            let event = Event::new(at_ns, Severity::Info, &kind::CAMERA_GAP_RETRACTED, "late")
                .with("sequence", 21.0)
                .with("frames", 1.0);
            log.write(at_ns, &Entry::event(&event)).unwrap();
        }
    }
    log.finish(&SummaryInput::clean("plan done")).unwrap();
    // Killed: the end with its summary was never written.
    let mut bytes = std::fs::read(&whole).unwrap();
    let summary = bytes.windows(9).position(|w| w == b"stop.clea").unwrap();
    bytes.truncate(summary - 40);
    let (cut, mended) = (dir.path().join("cut.mcap"), dir.path().join("mended.mcap"));
    std::fs::write(&cut, bytes).unwrap();
    assert!(!doctor::doctor(&cut).unwrap().sound);
    recover::recover(&cut, &mended).unwrap();
    assert!(!dir.path().join("mended.mcap.part").exists());

    let diagnosis = doctor::doctor(&mended).unwrap();
    assert_eq!(diagnosis.recovered_lost, Some(1), "{diagnosis}");
    assert!(diagnosis.sound, "{diagnosis}");
    assert!(
        diagnosis.to_string().contains("recovered, 1 frames lost"),
        "{diagnosis}"
    );
    let map = &info::info(&mended).unwrap().metadata["summary"];
    for (key, value) in [
        ("recovered", "true"),
        ("stop.clean", "false"),
        ("frames.logged", "40"),
        ("frames.received", "40"),
        ("frames.expected", "41"),
        ("frames.lost.sequence_gap", "1"),
    ] {
        assert_eq!(map.get(key).map(String::as_str), Some(value), "{key}");
    }
    assert!(!map.contains_key("frames.lost.time_gap"));
}

#[test]
fn an_export_goes_into_an_empty_folder_whole_or_not_at_all() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.mcap");
    let mut log = FileRecorder::create(&path, false, head(), offline()).unwrap();
    for i in 0..3 {
        let frame = Entry::frame(&grey_frame(i, 72, 58), u64::from(i));
        log.write(T0_NS + u64::from(i), &frame).unwrap();
    }
    log.finish(&SummaryInput::clean("plan done")).unwrap();
    let options = export::ExportOptions {
        tables: true,
        frames: true,
    };
    let into = dir.path().join("tables");
    let exported = export::export(&path, &into, options).unwrap();
    assert_eq!(
        (exported.frames, exported.rows[&into.join("frames.csv")]),
        (3, 3)
    );
    // 3 PNG and the table, nothing else.
    assert_eq!(std::fs::read_dir(&into).unwrap().count(), 4);
    // The files that are there are neither mixed with others nor replaced.
    let before = std::fs::metadata(into.join("frames.csv"))
        .unwrap()
        .modified()
        .unwrap();
    let refused = export::export(&path, &into, options).unwrap_err();
    assert!(matches!(refused, LogError::NotEmpty { .. }), "{refused}");
    let after = std::fs::metadata(into.join("frames.csv"))
        .unwrap()
        .modified()
        .unwrap();
    assert_eq!(before, after);
    // A log that breaks off in the middle leaves no folder behind.
    let mut bytes = std::fs::read(&path).unwrap();
    bytes.truncate(bytes.len() / 2);
    let cut = dir.path().join("cut.mcap");
    std::fs::write(&cut, bytes).unwrap();
    let half = dir.path().join("half");
    assert!(export::export(&cut, &half, options).is_err());
    assert!(!half.exists());
}

#[test]
fn an_empty_file_is_called_empty() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("empty.mcap");
    std::fs::write(&path, b"").unwrap();
    let words = doctor::doctor(&path).unwrap_err().to_string();
    assert!(words.contains("empty (0 bytes)"), "{words}");
}

#[test]
fn command_numbers_are_missing_only_where_nobody_names_them() {
    use doctor::Grade::{Error, Note};
    let with = |unsent: Option<(f64, f64)>| {
        let mut entries = vec![Entry::command(&command(1)), Entry::command(&command(2))];
        if let Some((first, sets)) = unsent {
            let event = Event::new(T0_NS, Severity::Warning, &kind::THRUSTER_UNSENT, "cut off")
                .with("sequence", first)
                .with("sets", sets);
            entries.push(Entry::event(&event));
        }
        entries.push(Entry::command(&command(5)));
        examined(&entries, &SummaryInput::clean("plan done"))
    };
    let silent = with(None);
    assert!(silent.found("command_gap", Error), "{silent}");
    let named = with(Some((3.0, 2.0)));
    assert!(
        named.found("command_gap", Note) && !named.found("command_gap", Error),
        "{named}"
    );
    // One of the two is named, the other is missing.
    assert!(with(Some((3.0, 1.0))).found("command_gap", Error));
}
