//! The daemon as a process: its file's name, its terminal, its clock, its signals.

use super::{path, words};
use crate::support::{hydroline, read};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

fn recording(log: &str, more: &[&str]) -> Child {
    hydroline()
        .args(["record", "--rig", "lshpi", "--out", log])
        .args(more)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

/// 2. The file was deleted while it was written: "finished as planned", exit code 0, nothing there.
#[test]
fn the_name_is_not_the_file() {
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    let log = path(dir.path(), "run.mcap");
    let child = recording(&log, &["--for", "3s"]);
    std::thread::sleep(Duration::from_millis(1500));
    std::fs::remove_file(&log).unwrap();
    let output = child.wait_with_output().unwrap();
    let said = words(&output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    let saved = dir.path().join("run-saved.mcap");
    assert!(saved.exists(), "{said}");
}

/// 3. In the background of an interactive shell the kernel stopped it with SIGTTOU, without a word.
#[test]
fn a_recording_in_the_background_of_a_shell() {
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    let log = path(dir.path(), "run.mcap");
    let binary = hydroline().get_program().to_owned();
    // A terminal of its own, and a shell with job control on it.
    let shell = format!(
        "bash -mc '{} record --rig lshpi --for 1s --out {log} & sleep 6; kill -9 %1 2>/dev/null'",
        Path::new(&binary).display()
    );
    let status = Command::new("script")
        .args(["-qec", &shell, "/dev/null"])
        .env("XDG_DATA_HOME", crate::support::data_home())
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .unwrap();
    let output = hydroline().args(["doctor", &log]).output().unwrap();
    assert_eq!(
        output.status.code(),
        Some(0),
        "{status:?}: {}",
        words(&output)
    );
}

/// A library of `tests/attack/parts` to preload, built.
fn shim(dir: &Path, source: &str) -> String {
    let shim = path(dir, "shim.so");
    let parts = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/attack/parts");
    let built = Command::new("cc")
        .args(["-shared", "-fPIC", "-o", &shim])
        .arg(parts.join(source))
        .arg("-ldl")
        .status()
        .unwrap();
    assert!(built.success());
    shim
}

/// 4. The first NTP contact, three hours ahead, aborted the plan: \"x = 1075 m\".
#[test]
fn supervision_on_the_wall_clock() {
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    let shim = shim(dir.path(), "clock.c");
    let (plan, log) = (path(dir.path(), "plan.toml"), path(dir.path(), "run.mcap"));
    let ahead = "name = \"ahead\"\n[[step]]\nfor_s = 6.0\nwrench = { surge_n = 8.0 }\n";
    std::fs::write(&plan, ahead).unwrap();
    let output = hydroline()
        .args(["record", "--rig", "lshpi", "--plan", &plan, "--out", &log])
        .envs([
            ("LD_PRELOAD", shim.as_str()),
            ("AFTER_S", "2"),
            ("STEP_S", "10800"),
        ])
        .output()
        .unwrap();
    let said = words(&output);
    assert!(matches!(output.status.code(), Some(0 | 3)), "{said}");
    let steps = read(Path::new(&log)).0;
    let stepped = |r: &hydroline::log::Record| matches!(r, hydroline::log::Record::Event(e) if e.kind == "clock.step");
    assert!(steps.iter().any(stepped), "the clock was not set: {said}");
}

/// 11. These killed the process at once and left the thrusters running; on a24d55e the real-time ones still did.
#[test]
fn deaths_without_neutral() {
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    for signal in [libc::SIGUSR1, libc::SIGABRT, libc::SIGRTMIN()] {
        let log = path(dir.path(), &format!("run{signal}.mcap"));
        let child = recording(&log, &["--plan", "surge-4n"]);
        std::thread::sleep(Duration::from_millis(2000));
        // SAFETY: our own child.
        unsafe { libc::kill(child.id() as i32, signal) };
        let output = child.wait_with_output().unwrap();
        assert!(
            output.status.code().is_some(),
            "signal {signal}: {}",
            words(&output)
        );
        let commands: Vec<f64> = read(Path::new(&log))
            .0
            .iter()
            .filter_map(|r| match r {
                hydroline::log::Record::Command(c) => Some(c.pulse_us),
                _ => None,
            })
            .collect();
        assert!(commands.iter().any(|p| *p != 1500.0), "signal {signal}");
        assert!(
            commands.iter().rev().take(4).all(|p| *p == 1500.0),
            "signal {signal}"
        );
    }
}

/// 12. The service manager's watchdog was fed every second although the log's writer stood still.
#[test]
fn a_watchdog_fed_while_the_writer_stands() {
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    let shim = shim(dir.path(), "disk.c");
    let (socket_path, log) = (path(dir.path(), "notify"), path(dir.path(), "run.mcap"));
    let socket = std::os::unix::net::UnixDatagram::bind(&socket_path).unwrap();
    socket
        .set_read_timeout(Some(Duration::from_millis(200)))
        .unwrap();
    let mut child = hydroline()
        .args(["record", "--rig", "lshpi", "--no-thrusters", "--for", "10s"])
        .args(["--out", &log])
        .envs([
            ("NOTIFY_SOCKET", socket_path.as_str()),
            ("LD_PRELOAD", shim.as_str()),
            ("DISK_FAULT", "stall"),
            ("DISK_AFTER", "8000000"),
            ("DISK_STALL_S", "5"),
        ])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut fed = Vec::new();
    let mut bytes = [0; 256];
    while child.try_wait().unwrap().is_none() {
        if let Ok(n) = socket.recv(&mut bytes)
            && bytes[..n].windows(10).any(|w| w == b"WATCHDOG=1")
        {
            fed.push(std::time::Instant::now());
        }
    }
    let gaps_s: Vec<f64> = fed
        .windows(2)
        .map(|w| (w[1] - w[0]).as_secs_f64())
        .collect();
    let widest_s = gaps_s.iter().copied().fold(0.0, f64::max);
    // Every second while all goes on; not while the disk takes nothing for five.
    assert!(
        gaps_s.iter().filter(|s| **s < 1.5).count() >= 2,
        "{gaps_s:?}"
    );
    assert!(widest_s > 3.5, "{gaps_s:?}");
}

/// 11. A limit on a file's size (`ulimit -f`) killed it with SIGXFSZ.
#[test]
fn a_limit_on_the_size_of_a_file() {
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    let log = path(dir.path(), "run.mcap");
    let output = Command::new("bash")
        .args(["-c", "ulimit -f 400; exec \"$@\"", "bash"])
        .arg(hydroline().get_program())
        .args(["record", "--rig", "lshpi", "--for", "2s", "--out", &log])
        .stdin(Stdio::null())
        .output()
        .unwrap();
    assert!(output.status.code().is_some(), "{}", words(&output));
    let output = hydroline().args(["info", &log]).output().unwrap();
    assert!(!words(&output).contains("CUT"), "{}", words(&output));
}

/// Few descriptors: a panic of a library, `failed to create UnixStream`.
#[test]
fn few_descriptors_are_a_clear_error_and_no_panic() {
    let dir = tempfile::tempdir().unwrap();
    let log = path(dir.path(), "run.mcap");
    let record = ["record", "--rig", "lshpi", "--for", "1s", "--out", &log];
    for (limit, words_of) in [
        (8, &record[..]),
        (20, &record[..]),
        (8, &["rig", "show", "lshpi"][..]),
    ] {
        let output = Command::new("bash")
            .args(["-c", &format!("ulimit -n {limit}; exec \"$@\""), "bash"])
            .arg(hydroline().get_program())
            .args(words_of)
            .stdin(Stdio::null())
            .output()
            .unwrap();
        let said = words(&output);
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(said.contains(&format!("may open {limit} files")), "{said}");
        assert!(
            said.contains("ulimit -n 1024") && !said.contains("panicked"),
            "{said}"
        );
    }
}
