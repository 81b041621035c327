//! kill -9 of the daemon itself: simulated camera, simulated controller, the plan of the paper.
//!
//! A killed process cannot be asked what it had, so that is reckoned from what fell due:
//! frames and commands come at a fixed rate, each reaches the log at most as late as the latest
//! one in that very log did, and what fell due before the kill by that reckoning must be there.
#![allow(clippy::unwrap_used, clippy::panic)]

use crate::support::hydroline;
use hydroline::log::{LogMessage, LogReader, Record};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, SystemTime};

/// Frames per second of the built-in rig: every 40 ms one falls due.
const FRAME_PERIOD_NS: u64 = 40_000_000;

/// A log of the paper's camera takes some 150 kB per frame.
const CUT_STRIDE_BYTES: usize = 4099;

struct Lost {
    /// The thrusters had gone to neutral before: of the commands' end this kill says nothing.
    stopped: bool,
    frames: u64,
    commands: u64,
    frames_kept: usize,
    commands_kept: usize,
}

/// Starts the daemon, kills it `life` after its log has begun to grow, and says when (UNIX [ns]).
///
/// Over a bare floor: on a busy computer a pose, which a plan waits for elsewhere, may take longer than that.
fn record_and_kill(dir: &Path, log: &Path, life: Duration) -> u64 {
    let mut child = Command::new(env!("CARGO_BIN_EXE_hydroline"))
        .env("XDG_DATA_HOME", crate::support::data_home())
        .args(["record", "--plan", "surge-4n", "--json", "--rig"])
        .arg(crate::support::bare_rig(dir))
        .arg("--out")
        .arg(log)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    // The head is some 40 kB; the first frames take it beyond.
    while std::fs::metadata(log).map_or(0, |m| m.len()) < 150_000 {
        if let Some(status) = child.try_wait().unwrap() {
            panic!("the daemon ended by itself: {status}");
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    std::thread::sleep(life);
    let now = SystemTime::now()
        .duration_since(SystemTime::UNIX_EPOCH)
        .unwrap();
    child.kill().unwrap(); // SIGKILL
    child.wait().unwrap();
    now.as_nanos() as u64
}

fn median(mut values: Vec<u64>) -> u64 {
    values.sort_unstable();
    values[values.len() / 2]
}

fn judge(dir: &Path, log: &Path, killed_ns: u64) -> Lost {
    let before = std::fs::read(log).unwrap();
    let mended = dir.join("mended.mcap");
    let status = hydroline()
        .arg("recover")
        .arg(log)
        .arg("--out")
        .arg(&mended)
        .status()
        .unwrap();
    assert!(matches!(status.code(), Some(0 | 3)), "{status}");
    let doctor = hydroline().arg("doctor").arg(&mended).output().unwrap();
    let found = String::from_utf8_lossy(&doctor.stdout);
    assert!(!found.contains("ERROR"), "what is left is sound: {found}");
    assert_eq!(
        std::fs::read(log).unwrap(),
        before,
        "the original was touched"
    );
    let messages: Vec<LogMessage> = LogReader::open(&mended)
        .unwrap()
        .collect::<Result<_, _>>()
        .unwrap();

    let mut stopped = None;
    let (mut indexes, mut images, mut latest_ns) = (Vec::new(), 0, 0);
    let (mut frame_ns, mut command_ns, mut last_sequence) = (Vec::new(), Vec::new(), None);
    for message in &messages {
        match &message.record {
            Record::FrameInfo(info) => indexes.push(info.frame_index),
            Record::Frame(frame) => {
                images += 1;
                assert!(
                    frame.to_grey(&Default::default()).is_ok(),
                    "a recovered frame is whole"
                );
                let taken_ns = frame.meta.mid_exposure_ns;
                frame_ns.push(taken_ns);
                latest_ns = latest_ns.max(message.log_ns.saturating_sub(taken_ns));
            }
            // A run that the daemon itself took to neutral, and says so: from then on no set-point was due.
            Record::Event(event) if event.kind == "thruster.neutral" && !command_ns.is_empty() => {
                stopped = Some((message.log_ns, event.message.clone()));
            }
            Record::Command(command) => {
                if let Some(last) = last_sequence {
                    let step = command.sequence - last;
                    // One sequence number may stand for all thrusters of an update.
                    assert!(step <= 1, "commands are contiguous");
                }
                last_sequence = Some(command.sequence);
                command_ns.push(message.log_ns);
            }
            _ => {}
        }
    }
    assert!(images >= 3 && command_ns.len() >= 3, "enough to judge by");
    // SIGKILL may cut the write of a chunk between a frame's account and its image, which follows it: such a frame
    // counts as lost here.
    assert!(
        (images..=images + 1).contains(&indexes.len()),
        "{images} frames, {} accounts",
        indexes.len()
    );
    assert!(
        indexes.windows(2).all(|w| w[1] == w[0] + 1),
        "frames are contiguous: {indexes:?}"
    );
    let due = |last_ns: u64, late_ns: u64, period_ns: u64| {
        killed_ns.saturating_sub(last_ns + late_ns) / period_ns
    };
    // Updates, not messages: the thrusters of one update are written within a millisecond.
    let spacing: Vec<u64> = command_ns
        .windows(2)
        .map(|w| w[1] - w[0])
        .filter(|ns| *ns > 1_000_000)
        .collect();
    assert!(!spacing.is_empty(), "commands come again and again");
    let widest_ns = spacing.iter().copied().max().unwrap_or(0);
    let period_ns = median(spacing).max(1);
    let last_command_ns = *command_ns.last().unwrap();
    if let Some((at_ns, why)) = &stopped {
        let before_ms = killed_ns.saturating_sub(*at_ns) / 1_000_000;
        println!("{before_ms} ms before the kill: {why}");
    }
    Lost {
        stopped: stopped.is_some(),
        frames: due(frame_ns[images - 1], latest_ns, FRAME_PERIOD_NS),
        commands: match stopped {
            Some(_) => 0,
            None => due(
                last_command_ns,
                widest_ns.saturating_sub(period_ns),
                period_ns,
            ),
        },
        frames_kept: images,
        commands_kept: command_ns.len(),
    }
}

/// Kills at moments of a fixed seed, two daemons at a time.
fn kill_and_judge(times: u64, seed: u64) {
    let one = |round: u64| {
        let mut state = seed ^ (round + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        for _ in 0..3 {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
        }
        let life = Duration::from_millis(800 + state % 1700);
        let dir = tempfile::tempdir().unwrap();
        let log = dir.path().join("run.mcap");
        let killed_ns = record_and_kill(dir.path(), &log, life);
        let lost = judge(dir.path(), &log, killed_ns);
        println!(
            "kill {round} after {life:?}: {} frames ({} lost), {} commands ({} lost)",
            lost.frames_kept, lost.frames, lost.commands_kept, lost.commands
        );
        lost
    };
    let halves: Vec<Vec<Lost>> = std::thread::scope(|scope| {
        let one = &one;
        let threads: Vec<_> = (0..2u64)
            .map(|k| {
                scope.spawn(move || {
                    (0..times)
                        .filter(|n| n % 2 == k)
                        .map(one)
                        .collect::<Vec<_>>()
                })
            })
            .collect();
        threads.into_iter().map(|t| t.join().unwrap()).collect()
    });
    let all: Vec<Lost> = halves.into_iter().flatten().collect();
    let worst = |of: fn(&Lost) -> u64| all.iter().map(of).max().unwrap_or(0);
    let (frames, commands) = (worst(|l| l.frames), worst(|l| l.commands));
    println!("{times} kills: at most {frames} frames and {commands} commands lost");
    assert_eq!(all.len() as u64, times);
    let judged = all.iter().filter(|l| !l.stopped).count() as u64;
    assert!(
        judged * 10 >= times * 9,
        "only {judged} of {times} runs kept their thrusters running: this computer is too busy to judge by"
    );
    assert!(frames <= 3, "{frames} frames lost");
    assert!(commands <= 1, "{commands} commands lost");
}

#[test]
fn kill_9_of_the_daemon_costs_at_most_three_frames_and_the_last_command() {
    kill_and_judge(3, 0x1234_5678_9ABC);
}

/// SIGKILL within a write leaves a file that ends anywhere, which a kill hits once in some hundred times.
#[test]
fn a_log_that_ends_anywhere_is_recovered_in_order() {
    let dir = tempfile::tempdir().unwrap();
    let log = dir.path().join("run.mcap");
    record_and_kill(dir.path(), &log, Duration::from_millis(800));
    let whole = std::fs::read(&log).unwrap();
    // The last tenth, some three frames: at a stride that is prime, so that no structure is kept in step with.
    for end in (whole.len() * 9 / 10..whole.len()).step_by(CUT_STRIDE_BYTES) {
        let cut = dir.path().join("cut.mcap");
        std::fs::write(&cut, &whole[..end]).unwrap();
        println!("cut at byte {end} of {}", whole.len());
        judge(dir.path(), &cut, 0);
        std::fs::remove_file(dir.path().join("mended.mcap")).unwrap();
    }
}

/// `cargo test --workspace --test recording record_kill -- --ignored --nocapture`
#[test]
#[ignore = "20 kills take most of a minute"]
fn kill_9_of_the_daemon_twenty_times() {
    kill_and_judge(20, 0xFEED_5EED);
}

#[test]
#[ignore = "20 kills take most of a minute"]
fn kill_9_of_the_daemon_twenty_times_under_four_busy_loops() {
    let ended = AtomicBool::new(false);
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                while !ended.load(Ordering::Relaxed) {
                    std::hint::spin_loop();
                }
            });
        }
        // The loops end also when the verdict is a panic.
        let verdict = std::panic::catch_unwind(|| kill_and_judge(20, 0xB055_1E55));
        ended.store(true, Ordering::Relaxed);
        if let Err(panic) = verdict {
            std::panic::resume_unwind(panic);
        }
    });
}
