//! The whole daemon on a bad disk: a stall costs no frame, a full disk ends in a readable file and exit code 3.
#![allow(clippy::unwrap_used)]

use crate::slow_disk::BadDisk;
use hydroline::clock::{Clock, SystemClock};
use hydroline::log::Record;
use hydroline::record::{self, Parts, Report};
use hydroline::shutdown::{Shutdown, StopReason};
use hydroline_rigs::Rig;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

fn record_on(disk: BadDisk, length_s: f64) -> Report {
    let mut rig = Rig::builtin("lshpi").unwrap();
    rig.log.min_free_bytes = 1 << 20;
    let clock: Arc<dyn Clock> = Arc::new(SystemClock);
    let recorder = crate::support::recorder(&rig, Box::new(disk), clock.clone());
    let source = crate::support::noise_camera(&rig.camera, clock.clone());
    let parts = Parts {
        source,
        line: None,
        recorder,
        clock,
        map: None,
        live: None,
    };
    record::run(
        parts,
        &crate::support::job(&rig, None, length_s),
        &Shutdown::new(),
        Box::new(|_| {}),
    )
    .unwrap()
}

fn disk(path: &Path, stall_ms: u64, room_bytes: u64) -> (BadDisk, Arc<AtomicU64>) {
    let stalls = Arc::new(AtomicU64::new(0));
    let disk = BadDisk {
        path: path.to_owned(),
        every: Duration::from_millis(700),
        stall: Duration::from_millis(stall_ms),
        room_bytes,
        stalls: stalls.clone(),
    };
    (disk, stalls)
}

#[test]
fn stalls_of_half_a_second_cost_no_frame() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("stalled.mcap");
    let (disk, stalls) = disk(&path, 500, u64::MAX);
    let report = record_on(disk, 3.0);
    assert!(
        stalls.load(Ordering::Relaxed) >= 2,
        "the disk did stand still"
    );
    assert_eq!(report.log.counts.frames_dropped, 0);
    assert!(!report.log.lost);
    let (records, metadata) = crate::support::read(&path);
    let frames = records
        .iter()
        .filter(|r| matches!(r, Record::Frame(_)))
        .count() as u64;
    assert_eq!(
        frames, report.capture.received,
        "every frame that was received is in the file"
    );
    assert_eq!(metadata["summary"]["frames.dropped.queue"], "0");
}

#[test]
fn a_disk_that_fills_up_ends_the_recording_with_a_readable_file() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("full.mcap");
    let (disk, _) = disk(&path, 0, 4 << 20);
    let report = record_on(disk, 60.0);
    assert!(
        matches!(report.stop, StopReason::LogStopped(_)),
        "{:?}",
        report.stop
    );
    assert!(report.lost_anything());
    let (records, metadata) = crate::support::read(&path);
    assert!(records.iter().any(|r| matches!(r, Record::Frame(_))));
    let summary = &metadata["summary"];
    let number = |key: &str| summary[key].parse::<u64>().unwrap();
    assert_eq!(
        number("frames.logged") + number("frames.dropped.queue") + number("frames.dropped.disk"),
        number("frames.received"),
        "{summary:?}"
    );
}

#[test]
fn the_binary_says_3_when_the_disk_took_no_more() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("limited.mcap");
    // A file size limit stands for the full disk: the kernel refuses the write in the same place.
    let script = format!(
        "trap '' XFSZ; ulimit -f 3000; exec {} record --rig lshpi --for 30s --no-thrusters --out {}",
        env!("CARGO_BIN_EXE_hydroline"),
        out.display()
    );
    let output = std::process::Command::new("bash")
        .args(["-c", &script])
        .env("XDG_DATA_HOME", crate::support::data_home())
        .stdin(std::process::Stdio::null())
        .output()
        .unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{stderr}");
    let (records, _) = crate::support::read(&out);
    assert!(records.iter().any(|r| matches!(r, Record::Frame(_))));
    assert!(std::fs::metadata(&out).unwrap().len() <= 3000 * 1024);
}
