//! kill -9 while recording: this test binary runs itself as the victim.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use hydroline::clock::SystemClock;
use hydroline::log::recover::recover;
use hydroline::log::*;
use hydroline_rigs::PixelFormat;

use super::support::{Rng, command, frame, head, noise, python_counts};

const VICTIM: &str = "HYDROLINE_LOG_VICTIM";

/// Not a test: records until it is killed. 25 frames/s of 720 x 576 noise, 25 commands/s, and a
/// line on stdout after each call that gave something to the recorder.
#[test]
#[ignore = "run by the other tests of this file, in a process of its own"]
fn victim() {
    let Some(path) = std::env::var_os(VICTIM) else {
        return;
    };
    let settings = WriteSettings {
        limits: Limits {
            min_free_bytes: 0,
            ..Limits::default()
        },
        ..WriteSettings::offline(Some(PixelFormat::Grey))
    };
    let parts = FileParts {
        path: PathBuf::from(path),
        replace: false,
    };
    let log = Recorder::start(Box::new(parts), head(), settings, Arc::new(SystemClock)).unwrap();
    let pixels: Vec<_> = (0..5).map(|i| noise(i, 720 * 576)).collect();
    let start = Instant::now();
    let until =
        |ns: u64| std::thread::sleep(Duration::from_nanos(ns).saturating_sub(start.elapsed()));
    for i in 0u32.. {
        let t = u64::from(i) * 40_000_000;
        until(t);
        log.frame(
            &frame(i, 720, 576, pixels[i as usize % 5].clone()),
            u64::from(i),
        );
        println!("frame {i}");
        until(t + 15_000_000);
        log.command(&command(i));
        println!("command {i}");
    }
}

struct Killed {
    frames_given: u32,
    commands_given: u32,
}

/// Starts the victim, kills it after `life` counted from its first frame, and says what it had
/// given to the recorder by then.
fn kill_after(path: &Path, life: Duration) -> Killed {
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args([
            "--exact",
            "log_files::crash::victim",
            "--ignored",
            "--nocapture",
            "--test-threads=1",
        ])
        .env(VICTIM, path)
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap())
        .lines()
        .map_while(Result::ok);
    let first = lines.by_ref().find(|l| l.contains("frame 0"));
    assert!(first.is_some(), "the victim did not start");
    std::thread::sleep(life);
    child.kill().unwrap(); // SIGKILL
    child.wait().unwrap();
    let mut killed = Killed {
        frames_given: 1,
        commands_given: 0,
    };
    for line in lines {
        if let Some(n) = line.strip_prefix("frame ") {
            killed.frames_given = n.parse::<u32>().unwrap() + 1;
        } else if let Some(n) = line.strip_prefix("command ") {
            killed.commands_given = n.parse::<u32>().unwrap() + 1;
        }
    }
    killed
}

fn crash_and_recover(times: u32, seed: u64) {
    let mut rng = Rng(seed);
    let (mut worst_frames, mut worst_commands) = (0, 0);
    for round in 0..times {
        let dir = tempfile::tempdir().unwrap();
        let (path, mended) = (dir.path().join("a.mcap"), dir.path().join("b.mcap"));
        let killed = kill_after(&path, Duration::from_millis(100 + rng.below(900)));
        let before = std::fs::read(&path).unwrap();
        let recovery = recover(&path, &mended).unwrap();
        assert_eq!(
            std::fs::read(&path).unwrap(),
            before,
            "the original was touched"
        );
        let messages: Vec<LogMessage> = LogReader::open(&mended)
            .unwrap()
            .collect::<Result<_, _>>()
            .unwrap();
        let (mut frames, mut commands) = (0, 0);
        for m in &messages {
            match &m.record {
                Record::Frame(f) => {
                    assert_eq!(f.meta.sequence, frames, "frames are contiguous");
                    assert_eq!(
                        f.data,
                        noise(u64::from(frames) % 5, 720 * 576),
                        "and untouched"
                    );
                    frames += 1;
                }
                Record::Command(c) => {
                    assert_eq!(c.sequence, commands, "commands are contiguous");
                    commands += 1;
                }
                _ => {}
            }
        }
        // The recorder may have had one more than it could still report.
        let lost_frames = killed.frames_given.saturating_sub(frames);
        let lost_commands = killed.commands_given.saturating_sub(commands);
        println!(
            "round {round}: {frames} frames ({lost_frames} lost), {commands} commands ({lost_commands} lost)"
        );
        assert!(lost_frames <= 3, "{lost_frames} frames lost");
        assert!(lost_commands <= 1, "{lost_commands} commands lost");
        worst_frames = worst_frames.max(lost_frames);
        worst_commands = worst_commands.max(lost_commands);
        assert_eq!(recovery.messages_total, messages.len() as u64);
        if let Some(counts) = python_counts(&mended) {
            assert_eq!(counts["/camera/image"], frames);
            assert_eq!(counts["/thruster/command"], commands);
        }
    }
    println!("{times} kills: at most {worst_frames} frames and {worst_commands} commands lost");
}

#[test]
fn kill_9_costs_at_most_three_frames_and_the_last_command() {
    crash_and_recover(3, 0x1234_5678_9ABC);
}

/// `cargo test -p hydroline --test log_files -- --ignored kill_9_twenty --nocapture`
#[test]
#[ignore = "20 kills take half a minute"]
fn kill_9_twenty_times() {
    crash_and_recover(20, 0xFEED_5EED);
}
