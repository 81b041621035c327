//! A disk that stalls: the queue takes it, the producer does not notice.

use std::io::{self, Write};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex};

use hydroline::clock::SystemClock;
use hydroline::log::*;
use hydroline_rigs::PixelFormat;

use super::support::{command, frame, head, noise, read_all};

/// A sink whose writes wait at a gate while it is shut.
#[derive(Clone, Default)]
struct Gate(Arc<(Mutex<bool>, Condvar, AtomicBool)>);

impl Gate {
    fn set(&self, shut: bool) {
        *self.0.0.lock().unwrap() = shut;
        self.0.1.notify_all();
    }
    fn pass(&self) {
        let mut shut = self.0.0.lock().unwrap();
        while *shut {
            self.0.2.store(true, Ordering::SeqCst);
            shut = self.0.1.wait(shut).unwrap();
        }
    }
    fn somebody_waits(&self) -> bool {
        self.0.2.load(Ordering::SeqCst)
    }
}

struct Gated {
    gate: Gate,
    file: FileOutput,
}

impl Write for Gated {
    fn write(&mut self, buf: &[u8]) -> io::Result<usize> {
        self.gate.pass();
        self.file.write(buf)
    }
    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl LogOutput for Gated {
    fn sync(&mut self) -> io::Result<()> {
        self.gate.pass();
        self.file.sync()
    }
    fn reserve(&mut self, end_bytes: u64) -> io::Result<()> {
        self.file.reserve(end_bytes)
    }
    fn truncate(&mut self, end_bytes: u64) -> io::Result<()> {
        self.file.truncate(end_bytes)
    }
    fn free_bytes(&self) -> Option<u64> {
        self.file.free_bytes()
    }
}

fn recorder(gate: &Gate, path: PathBuf, queue_bytes: u64) -> Recorder {
    let gate = gate.clone();
    let opener = move |_: u32| -> io::Result<(Box<dyn LogOutput>, PathBuf)> {
        let file = FileOutput::create(&path, false)?;
        Ok((
            Box::new(Gated {
                gate: gate.clone(),
                file,
            }),
            path.clone(),
        ))
    };
    let settings = WriteSettings {
        limits: Limits {
            min_free_bytes: 0,
            ..Limits::default()
        },
        queue_bytes,
        ..WriteSettings::offline(Some(PixelFormat::Grey))
    };
    Recorder::start(Box::new(opener), head(), settings, Arc::new(SystemClock)).unwrap()
}

/// While the disk stands still — shut before the first frame, opened after the last, so the stall
/// is as long as it takes — 500 ms worth of 200 frames/s (100 frames of 720 x 576, 41 MB) and 100
/// commands go in. If a push waited for the disk, this test would never end: the gate opens only
/// after them. Nothing is lost.
#[test]
fn a_stalled_disk_loses_nothing_and_blocks_nobody() {
    let dir = tempfile::tempdir().unwrap();
    let (gate, path) = (Gate::default(), dir.path().join("a.mcap"));
    let log = recorder(&gate, path.clone(), 256 << 20);
    gate.set(true);
    let pixels = noise(1, 720 * 576);
    for i in 0..100 {
        log.frame(&frame(i, 720, 576, pixels.clone()), u64::from(i));
        log.command(&command(i));
        if i == 10 {
            // Not a race against an idle writer: it does stand at the gate.
            while !gate.somebody_waits() {
                std::thread::yield_now();
            }
        }
    }
    let counts = log.counts();
    assert!(
        counts.queue_bytes > 80 * 720 * 576,
        "the queue holds them: {}",
        counts.queue_bytes
    );
    gate.set(false);
    let outcome = log.finish(&SummaryInput::clean("done")).unwrap();
    assert!(!outcome.lost);
    let (messages, errors) = read_all(&std::fs::read(&path).unwrap());
    assert!(errors.is_empty());
    let frames = messages
        .iter()
        .filter(|m| matches!(m.record, Record::Frame(_)))
        .count();
    let commands = messages
        .iter()
        .filter(|m| matches!(m.record, Record::Command(_)))
        .count();
    assert_eq!((frames, commands), (100, 100));
}

/// Beyond the bound: the newest frames are dropped and counted, no command is, and the file says so.
#[test]
fn beyond_the_bound_frames_are_dropped_and_counted() {
    let dir = tempfile::tempdir().unwrap();
    let (gate, path) = (Gate::default(), dir.path().join("a.mcap"));
    let log = recorder(&gate, path.clone(), 1 << 20);
    gate.set(true);
    let pixels = noise(1, 160 * 120);
    for i in 0..200 {
        log.frame(&frame(i, 160, 120, pixels.clone()), u64::from(i));
        log.command(&command(i));
    }
    gate.set(false);
    let outcome = log.finish(&SummaryInput::clean("done")).unwrap();
    let dropped = outcome.counts.frames_dropped;
    assert!(outcome.lost && dropped > 0);
    let mut reader = LogReader::open(&path).unwrap();
    let messages: Vec<LogMessage> = reader.by_ref().collect::<Result<_, _>>().unwrap();
    let of = |f: fn(&Record) -> bool| messages.iter().filter(|m| f(&m.record)).count() as u64;
    assert_eq!(of(|r| matches!(r, Record::Frame(_))) + dropped, 200);
    assert_eq!(of(|r| matches!(r, Record::Command(_))), 200);
    assert!(of(|r| matches!(r, Record::Event(e) if e.kind == "log.frames_dropped")) >= 1);
    assert_eq!(
        reader.metadata()["summary"]["frames.dropped.queue"],
        dropped.to_string()
    );
    let diagnosis = doctor::doctor(&path).unwrap();
    assert!(
        diagnosis.found("event", doctor::Grade::Warning),
        "{diagnosis}"
    );
    assert!(
        !diagnosis.found("ledger", doctor::Grade::Warning),
        "{diagnosis}"
    );
}

/// A real disk that fills up: give a directory on a small file system of its own, e.g.
/// `mount -t tmpfs -o size=16m none /mnt/small`, then
/// `HYDROLINE_SMALL_DISK=/mnt/small cargo test -p hydroline --test log_files -- --ignored real_full_disk`
#[test]
#[ignore = "needs a small file system"]
fn a_real_full_disk_ends_in_a_readable_file() {
    let Some(root) = std::env::var_os("HYDROLINE_SMALL_DISK") else {
        crate::inputs::skip("HYDROLINE_SMALL_DISK, a folder on a small file system");
        return;
    };
    let dir = tempfile::tempdir_in(root).unwrap();
    let path = dir.path().join("a.mcap");
    let free = free_bytes(&path).unwrap();
    let log = recorder(&Gate::default(), path.clone(), 1 << 30);
    let frames = 2 * free / (720 * 576);
    let pixels: Vec<_> = (0..3).map(|i| noise(i, 720 * 576)).collect();
    // Twice what fits uncompressed, at a compression of about two: give four times that.
    for i in 0..(frames * 2) as u32 {
        log.frame(
            &frame(i, 720, 576, pixels[i as usize % 3].clone()),
            u64::from(i),
        );
        log.command(&command(i));
    }
    let outcome = log.finish(&SummaryInput::clean("done")).unwrap();
    assert!(outcome.lost && outcome.stopped.is_some(), "{outcome:?}");
    let mut reader = LogReader::open(&path).unwrap();
    let messages: Vec<LogMessage> = reader.by_ref().collect::<Result<_, _>>().unwrap();
    let kept = messages
        .iter()
        .filter(|m| matches!(m.record, Record::Frame(_)))
        .count() as u64;
    let summary = &reader.metadata()["summary"];
    println!(
        "{kept} of {} frames in {} bytes on {free} free; {}",
        frames * 2,
        std::fs::metadata(&path).unwrap().len(),
        summary["stop.reason"]
    );
    assert!(kept > 0);
    assert_eq!(kept + outcome.counts.unwritten["/camera/image"], frames * 2);
    assert_eq!(summary["frames.logged"], kept.to_string());
    let report = info::info(&path).unwrap();
    assert!(
        report.damage.is_empty() && report.ending == info::Ending::Stopped,
        "{report}"
    );
}
