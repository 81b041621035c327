//! The daemon as people start it: simulated camera, simulated controller on a pseudo-terminal, one log.
#![allow(clippy::unwrap_used)]

use crate::support::{hydroline, read};
use hydroline::log::Record;
use hydroline::replay::{Options, replay};
use hydroline::shutdown::StopReason;
use hydroline::thruster::controller::{ControllerConfig, PtyController, SimController};
use hydroline::thruster::ports::Roots;
use hydroline::thruster::service::serial_opener;
use hydroline_calib::analytic::IdealMap;
use hydroline_rigs::{Plan, Rig};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::Arc;

fn plan_file(dir: &Path, text: &str) -> PathBuf {
    let path = dir.join("plan.toml");
    std::fs::write(&path, text).unwrap();
    path
}

/// Whether any thruster was commanded to push.
pub fn moved(records: &[Record]) -> bool {
    let pushes = |r: &Record| matches!(r, Record::Command(c) if c.pulse_us != 1500.0);
    records.iter().any(pushes)
}

fn record(dir: &Path, more: &[&str]) -> (PathBuf, Output) {
    let out = dir.join("run.mcap");
    let output = hydroline()
        .args(["record", "--rig", "lshpi", "--out"])
        .arg(&out)
        .args(more)
        .output()
        .unwrap();
    (out, output)
}

#[test]
fn a_run_is_logged_whole_and_replay_gives_the_live_points_bit_for_bit() {
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    let plan = plan_file(
        dir.path(),
        "[[step]]\nfor_s = 1.0\nwrench = { surge_n = 8.0 }\n",
    );
    let (log, output) = record(
        dir.path(),
        &[
            "--plan",
            plan.to_str().unwrap(),
            "--note",
            "still water",
            "--water-temp",
            "18",
        ],
    );
    let stderr = String::from_utf8_lossy(&output.stderr);
    // 3 = frames were lost: a loaded machine may be too slow to render, and says so. Everything else must hold.
    assert!(
        matches!(output.status.code(), Some(0 | 3)),
        "{:?} {stderr}",
        output.status
    );

    let (records, metadata) = read(&log);
    let summary = &metadata["summary"];
    let number = |key: &str| summary.get(key).map_or(0, |v| v.parse::<u64>().unwrap());
    let lost: u64 = summary
        .iter()
        .filter(|(k, _)| k.starts_with("frames.lost."))
        .map(|(_, v)| v.parse::<u64>().unwrap())
        .sum();
    assert_eq!(number("frames.received") + lost, number("frames.expected"));
    assert!(number("frames.received") >= 25, "{summary:?}");
    assert_eq!(metadata["session"]["note"], "still water");
    assert!(metadata["session"]["water.n_532nm"].starts_with("1.33"));

    let commands: Vec<_> = records
        .iter()
        .filter_map(|r| {
            if let Record::Command(c) = r {
                Some(c)
            } else {
                None
            }
        })
        .collect();
    let planned = commands.iter().filter(|c| c.plan_step == 1).count();
    // A second at 25 sets/s for 8 thrusters: each set was sent, or superseded by the next one and counted.
    assert_eq!(
        planned / 8 + number("commands.skipped") as usize,
        25,
        "{summary:?}"
    );
    let last_set = commands.last().unwrap().sequence;
    let last: Vec<_> = commands.iter().filter(|c| c.sequence == last_set).collect();
    assert!(
        last.len() == 8 && last.iter().all(|c| c.pulse_us == 1500.0),
        "neutral comes last: {last:?}"
    );
    let echoes = records
        .iter()
        .filter(|r| matches!(r, Record::Echo(_)))
        .count();
    assert_eq!(echoes, commands.len(), "every command is echoed");
    assert!(
        records
            .iter()
            .any(|r| matches!(r, Record::Clock(c) if c.controller.is_some()))
    );

    let rig = Rig::builtin("lshpi").unwrap();
    let options = Options {
        map: Some(Arc::new(IdealMap::of(&rig))),
        ..Options::default()
    };
    let (report, _) = replay(&log, &dir.path().join("again.mcap"), &options, &mut |_| {}).unwrap();
    assert!(report.live > 0);
    assert_eq!(
        report.live_identical, report.live,
        "replay equals live, bit for bit"
    );
    assert_eq!(report.frames, number("frames.received"));
}

#[test]
fn the_simulated_vehicle_moves_as_commanded() {
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    let plan = plan_file(
        dir.path(),
        "[[step]]\nfor_s = 2.0\nwrench = { surge_n = 8.0 }\n",
    );
    let (log, _) = record(
        dir.path(),
        &["--plan", plan.to_str().unwrap(), "--for", "3s"],
    );
    let (records, _) = read(&log);
    let u: Vec<f64> = records
        .iter()
        .filter_map(|r| {
            if let Record::Truth(t) = r {
                t.u_mps
            } else {
                None
            }
        })
        .collect();
    // 8 N on 279.8 kg for 2 s: 0.055 m/s less drag; then it coasts.
    let fastest = u.iter().copied().fold(0.0, f64::max);
    assert!((0.045..0.056).contains(&fastest), "{fastest}");
    assert_eq!(u[0], 0.0);
}

#[test]
fn ctrl_c_and_sigterm_end_a_recording_cleanly_with_neutral_last() {
    let _alone = crate::support::alone();
    for (signal, words) in [("INT", "Ctrl-C"), ("TERM", "SIGTERM"), ("HUP", "SIGHUP")] {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("run.mcap");
        let child = hydroline()
            .args(["record", "--rig", "lshpi", "--plan", "surge-4n", "--out"])
            .arg(&out)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        std::thread::sleep(std::time::Duration::from_millis(2500));
        let killed = Command::new("kill")
            .args([format!("-{signal}"), child.id().to_string()])
            .status()
            .unwrap();
        assert!(killed.success());
        let output = child.wait_with_output().unwrap();
        assert!(
            matches!(output.status.code(), Some(0 | 3)),
            "{signal}: {:?}",
            output.status
        );
        assert!(String::from_utf8_lossy(&output.stdout).contains(words));
        let (records, metadata) = read(&out);
        assert_eq!(metadata["summary"]["stop.clean"], "true");
        let last = records
            .iter()
            .rev()
            .find_map(|r| {
                if let Record::Command(c) = r {
                    Some(c)
                } else {
                    None
                }
            })
            .unwrap();
        assert_eq!(last.pulse_us, 1500.0);
        assert!(
            records
                .iter()
                .any(|r| matches!(r, Record::Command(c) if c.pulse_us > 1500.0)),
            "the plan ran"
        );
    }
}

#[test]
fn several_runs_make_several_logs() {
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    let plan = plan_file(
        dir.path(),
        "[[step]]\nfor_s = 1.0\nwrench = { surge_n = 8.0 }\n",
    );
    let plan = plan.to_str().unwrap();
    let (_, output) = record(
        dir.path(),
        &["--plan", plan, "--runs", "2", "--settle", "100ms"],
    );
    assert!(
        matches!(output.status.code(), Some(0 | 3)),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    for k in [1, 2] {
        let (records, metadata) = read(&dir.path().join(format!("run-{k}.mcap")));
        assert!(records.iter().any(|r| matches!(r, Record::Frame(_))));
        assert!(moved(&records), "run {k}: the plan ran");
        assert_eq!(metadata["session"]["run"], format!("{k} of 2"));
        // Every stripe that was extracted live was fitted, or counted as not fitted.
        let poses: u64 = ["fitted", "doubtful", "none", "skipped"]
            .iter()
            .map(|what| {
                let count = &metadata["summary"][&format!("poses.{what}")];
                count.parse::<u64>().unwrap()
            })
            .sum();
        assert!(poses > 0, "{:?}", metadata["summary"]);
    }
}

/// Records the built-in vehicle under other limits, with a plan on a simulated controller or without thrusters: why it
/// ended, and what is in the log.
pub fn recorded(
    dir: &Path,
    (plan, length_s): (Option<Plan>, f64),
    limit: impl FnOnce(&mut hydroline_rigs::Limits),
    clock: Arc<dyn hydroline::clock::Clock>,
) -> (StopReason, Vec<Record>) {
    let rig = Rig::builtin("lshpi").unwrap();
    let mut job = crate::support::job(&rig, plan, length_s);
    limit(&mut job.rig.limits);
    recorded_at(dir, rig.tank.start_pose, &job, clock)
}

/// Records a job on the built-in vehicle, which lies at this pose.
pub fn recorded_at(
    dir: &Path,
    pose: [f64; 6],
    job: &hydroline::record::Job,
    clock: Arc<dyn hydroline::clock::Clock>,
) -> (StopReason, Vec<Record>) {
    let mut rig = Rig::builtin("lshpi").unwrap();
    rig.tank.start_pose = pose;
    let vehicle = hydroline::simulated::SimulatedVehicle::new(&rig).unwrap();
    let renderer = hydroline_sim::Renderer::new(&rig).unwrap();
    let view = hydroline::simulated::CameraView::new(vehicle.clone(), renderer);
    let source = hydroline::capture::sim::SimCamera::new(view, &rig.camera, clock.clone());
    vehicle.start(source.start_ns());
    let controller = job.plan.is_some().then(|| {
        let moved = vehicle.clone();
        PtyController::start(
            SimController::new(ControllerConfig::for_rig(&rig.thrusters)),
            None,
            Box::new(move |e| {
                moved
                    .pulse(e.host_monotonic_ns, e.channel, e.pulse_us)
                    .unwrap();
            }),
        )
        .unwrap()
    });
    let line = controller.as_ref().map(|controller| {
        let mut set = rig.thrusters.clone();
        set.link.port = hydroline_rigs::LinkPort::Node(controller.path().unwrap().to_owned());
        serial_opener(&set, Roots::default(), clock.clone())
    });
    let path = dir.join("limit.mcap");
    let opener = Box::new(hydroline::log::FileParts {
        path: path.clone(),
        replace: false,
    });
    let parts = hydroline::record::Parts {
        source: Box::new(source),
        line,
        recorder: crate::support::recorder(&rig, opener, clock.clone()),
        clock,
        map: Some(Arc::new(IdealMap::of(&rig))),
        live: None,
    };
    let report = hydroline::record::run(
        parts,
        job,
        &hydroline::shutdown::Shutdown::new(),
        Box::new(|_| {}),
    )
    .unwrap();
    let (records, _) = read(&path);
    (report.stop, records)
}

/// The same until a limit is passed.
fn record_within(
    dir: &Path,
    plan: Option<Plan>,
    limit: impl FnOnce(&mut hydroline_rigs::Limits),
) -> (String, Vec<Record>) {
    let clock = Arc::new(hydroline::clock::SystemClock);
    let (stop, records) = recorded(dir, (plan, 60.0), limit, clock);
    let StopReason::Limit(words) = stop else {
        unreachable!("{stop:?}")
    };
    assert!(
        records
            .iter()
            .any(|r| matches!(r, Record::Event(e) if e.kind == "limit.passed"))
    );
    (words, records)
}

#[test]
fn a_limit_that_is_passed_while_running_aborts_to_neutral() {
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    let start_x_m = Rig::builtin("lshpi").unwrap().tank.start_pose[0];
    let plan = Plan::builtin("surge-8n").unwrap();
    let (words, records) = record_within(dir.path(), Some(plan), |limits| {
        limits.x_m = [-1.0, start_x_m + 0.02];
    });
    assert!(words.contains("x = "), "{words}");
    let commands: Vec<_> = records
        .iter()
        .filter_map(|r| match r {
            Record::Command(c) => Some(c),
            _ => None,
        })
        .collect();
    let stopped = commands.iter().position(|c| c.cause == "limit").unwrap();
    let pushes = |c: &&hydroline::log::messages::pb::ThrusterCommand| c.pulse_us != 1500.0;
    assert!(commands[..stopped].iter().any(pushes), "the plan ran");
    assert!(!commands[stopped..].iter().any(pushes), "neutral for good");
}

#[test]
fn a_floor_line_beyond_the_limit_ends_a_recording_without_thrusters() {
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    let (words, _) = record_within(dir.path(), None, |limits| limits.z_m = [-0.5, -0.1]);
    assert!(words.contains("z = -0.83"), "{words}");
}

#[test]
fn a_measured_x_beyond_the_limit_is_enough_without_any_command() {
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    let start_x_m = Rig::builtin("lshpi").unwrap().tank.start_pose[0];
    // No command, no dead reckoning: only a pose that was fitted to frames can say where the vehicle is.
    let (words, _) = record_within(dir.path(), None, |limits| {
        limits.x_m = [start_x_m + 0.1, 7.0];
    });
    assert!(words.contains("x = "), "{words}");
}

/// A pseudo-terminal: master and slave.
fn terminal() -> (std::fs::File, std::fs::File) {
    use std::os::fd::FromRawFd;
    let (mut master, mut slave) = (0, 0);
    let null = std::ptr::null_mut();
    // SAFETY: both descriptors are written by openpty and owned by nobody else.
    unsafe {
        assert_eq!(
            libc::openpty(&mut master, &mut slave, null, null.cast(), null.cast()),
            0
        );
        (
            std::fs::File::from_raw_fd(master),
            std::fs::File::from_raw_fd(slave),
        )
    }
}

#[test]
fn space_among_other_keys_brings_neutral_and_the_recording_goes_on_until_q() {
    let _alone = crate::support::alone();
    use std::io::Write;
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("run.mcap");
    let (mut master, slave) = terminal();
    let mut child = hydroline()
        .args([
            "record", "--rig", "lshpi", "--plan", "surge-4n", "--json", "--out",
        ])
        .arg(&out)
        .stdin(Stdio::from(slave))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    std::thread::sleep(std::time::Duration::from_millis(2500));
    // Several keys in one burst: a buffered reader once swallowed the Space behind the first one.
    master.write_all(b"xx x").unwrap();
    std::thread::sleep(std::time::Duration::from_millis(1000));
    assert!(child.try_wait().unwrap().is_none(), "still recording");
    master.write_all(b"q").unwrap();
    let output = child.wait_with_output().unwrap();
    assert!(matches!(output.status.code(), Some(0 | 3)));
    assert!(String::from_utf8_lossy(&output.stdout).contains("the q key"));
    let (records, _) = read(&out);
    let sets: Vec<_> = records
        .iter()
        .filter_map(|r| match r {
            Record::Command(c) if c.thruster == "h_fore_stbd" => Some(c.pulse_us),
            _ => None,
        })
        .collect();
    let moved = sets.iter().position(|p| *p > 1500.0).unwrap();
    let stopped = sets.iter().rposition(|p| *p > 1500.0).unwrap();
    assert!(moved < stopped && stopped + 1 < sets.len());
    assert!(sets[stopped + 1..].iter().all(|p| *p == 1500.0));
    let reported = |word: &str| {
        records
            .iter()
            .any(|r| matches!(r, Record::Event(e) if e.kind == "thruster.neutral" && e.message.contains(word)))
    };
    assert!(reported("Space"));
}

#[test]
fn a_plan_without_an_answering_controller_fails_and_says_so() {
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    let rig = dir.path().join("rig.toml");
    let text = Rig::builtin("lshpi").unwrap().effective_toml;
    // A pseudo-terminal that nobody serves.
    let (_master, slave) = terminal();
    let node = std::fs::read_link(format!(
        "/proc/self/fd/{}",
        std::os::fd::AsRawFd::as_raw_fd(&slave)
    ))
    .unwrap();
    let port = format!("port = \"{}\"\nallow_unstable_node = true", node.display());
    let silent = text.replace("port = \"sim\"", &port);
    assert_ne!(silent, text);
    std::fs::write(&rig, silent).unwrap();
    let out = dir.path().join("run.mcap");
    let output = hydroline()
        .args([
            "record",
            "--plan",
            "surge-4n",
            "--ready-within",
            "2s",
            "--rig",
        ])
        .arg(&rig)
        .arg("--out")
        .arg(&out)
        .output()
        .unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    assert!(stderr.contains("controller does not answer"), "{stderr}");
}

#[test]
fn a_terminal_as_stderr_gets_words_and_no_panic() {
    use std::io::Read;
    let (mut master, slave) = terminal();
    let mut child = hydroline()
        .args(["info", "/no/such.mcap"])
        .stderr(Stdio::from(slave))
        .spawn()
        .unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(2));
    // A terminal hands over in pieces; when nobody holds the other end any more it says so as an error.
    let (mut shown, mut piece) = (Vec::new(), [0; 4096]);
    while let Ok(n @ 1..) = master.read(&mut piece) {
        shown.extend_from_slice(&piece[..n]);
    }
    let shown = String::from_utf8_lossy(&shown).into_owned();
    assert!(
        shown.lines().all(|line| line.starts_with("hydroline: "))
            && shown.contains("/no/such.mcap"),
        "{shown:?}"
    );
}

#[test]
fn a_plan_cut_by_for_is_not_called_finished() {
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    let (_, output) = record(dir.path(), &["--plan", "surge-4n", "--for", "2s"]);
    let (stdout, stderr) = (
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr),
    );
    assert!(matches!(output.status.code(), Some(0 | 3)), "{stderr}");
    assert!(stderr.contains("the plan will be cut"), "{stderr}");
    assert!(
        stdout.contains("was cut at 1.")
            && stdout.contains(" of 1")
            && !stdout.contains("finished"),
        "{stdout}"
    );
}

#[test]
fn space_pressed_before_a_plan_begins_keeps_it_from_beginning_and_ends_the_series() {
    let _alone = crate::support::alone();
    use std::io::Write;
    let dir = tempfile::tempdir().unwrap();
    let plan = plan_file(
        dir.path(),
        "[[step]]\nfor_s = 1.0\nwrench = { surge_n = 8.0 }\n",
    );
    let (mut master, slave) = terminal();
    // Before the daemon has even been started: the key lies in the terminal.
    master.write_all(b" ").unwrap();
    let output = hydroline()
        .args(["record", "--rig", "lshpi", "--runs", "2", "--plan"])
        .arg(&plan)
        .arg("--out")
        .arg(dir.path().join("run.mcap"))
        .stdin(Stdio::from(slave))
        .output()
        .unwrap();
    assert!(
        matches!(output.status.code(), Some(0 | 3)),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let (records, metadata) = read(&dir.path().join("run-1.mcap"));
    let planned = records
        .iter()
        .filter(|r| matches!(r, Record::Command(c) if c.cause == "plan" || c.plan_step > 0))
        .count();
    assert_eq!(planned, 0);
    assert!(!moved(&records));
    assert!(
        records
            .iter()
            .any(|r| matches!(r, Record::Event(e) if e.message.contains("Space before the start")))
    );
    assert!(
        metadata["summary"]["stop.reason"].contains("Space"),
        "{:?}",
        metadata["summary"]
    );
    assert!(
        !dir.path().join("run-2.mcap").exists(),
        "the series is over"
    );
}

#[test]
fn space_between_two_runs_keeps_the_second_from_starting() {
    let _alone = crate::support::alone();
    use std::io::{BufRead, Write};
    let dir = tempfile::tempdir().unwrap();
    let plan = plan_file(
        dir.path(),
        "[[step]]\nfor_s = 1.0\nwrench = { surge_n = 8.0 }\n",
    );
    let (mut master, slave) = terminal();
    let mut child = hydroline()
        .args([
            "record", "--rig", "lshpi", "--runs", "2", "--settle", "60s", "--plan",
        ])
        .arg(&plan)
        .arg("--out")
        .arg(dir.path().join("run.mcap"))
        .stdin(Stdio::from(slave))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // The first run's report is the beginning of the pause.
    let mut lines = std::io::BufReader::new(child.stdout.take().unwrap()).lines();
    let report = lines.next().unwrap().unwrap();
    assert!(report.contains("run-1.mcap: finished"), "{report}");
    let pressed = std::time::Instant::now();
    master.write_all(b" ").unwrap();
    let output = child.wait_with_output().unwrap();
    assert!(pressed.elapsed().as_secs() < 30, "the pause ends at once");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(matches!(output.status.code(), Some(0 | 3)), "{stderr}");
    assert!(stderr.contains("1 of 2 runs are recorded"), "{stderr}");
    assert!(!dir.path().join("run-2.mcap").exists());
}

#[test]
fn between_runs_the_way_to_the_start_is_shown_until_enter() {
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    let plan = dir.path().join("nudge.toml");
    std::fs::write(&plan, "[[step]]\nfor_s = 0.3\nwrench = { surge_n = 2.0 }\n").unwrap();
    let mut child = hydroline()
        .args(["record", "--rig", "lshpi", "--runs", "2"])
        .args(["--return-to-start", "--plan"])
        .arg(&plan)
        .arg("--out")
        .arg(dir.path().join("run.mcap"))
        .stdin(std::process::Stdio::piped())
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    // The simulated vehicle of the pause stands at its start; somebody sees it there and presses Enter.
    let stderr = std::io::BufReader::new(child.stderr.take().unwrap());
    let mut said = Vec::new();
    for line in std::io::BufRead::lines(stderr) {
        let line = line.unwrap();
        let there = line.contains("at the start: release");
        said.push(line);
        if there {
            let mut stdin = child.stdin.take().unwrap();
            std::io::Write::write_all(&mut stdin, b"\n").unwrap();
        }
    }
    let code = child.wait().unwrap().code();
    let said = said.join("\n");
    assert!(matches!(code, Some(0 | 3)), "{code:?} {said}");
    for part in ["bring the vehicle back to x", "looks the same every 0.2"] {
        assert!(said.contains(part), "no '{part}' in: {said}");
    }
    for k in [1, 2] {
        assert!(dir.path().join(format!("run-{k}.mcap")).exists(), "{said}");
    }
}

#[test]
fn a_dry_run_refuses_the_calibration_that_the_run_refuses() {
    use hydroline_calib::calibration::MapParameters;
    use hydroline_calib::plane::PlaneMap;
    let dir = tempfile::tempdir().unwrap();
    let rig = Rig::builtin("lshpi").unwrap();
    let mut made = IdealMap::of(&rig).describe();
    let MapParameters::Ideal(map) = &mut made.map else {
        unreachable!("the ideal map is ideal")
    };
    map.image.width_px /= 2;
    let file = dir.path().join("other.calibration.toml");
    std::fs::write(&file, made.to_toml().unwrap()).unwrap();
    let log = dir.path().join("run.mcap");
    for dry in [&["--dry-run"][..], &[]] {
        let output = hydroline()
            .args(["record", "--rig", "lshpi", "--plan", "surge-4n"])
            .arg("--calibration")
            .arg(&file)
            .arg("--out")
            .arg(&log)
            .args(dry)
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{dry:?} {said}");
        assert!(
            said.contains("another size or crop is another map"),
            "{said}"
        );
        assert!(!log.exists());
    }
    // Nor does it pass over a log that is there.
    std::fs::write(&log, "").unwrap();
    let output = hydroline()
        .args(["record", "--rig", "lshpi", "--plan", "surge-4n"])
        .args(["--dry-run", "--out"])
        .arg(&log)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
}
