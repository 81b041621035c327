//! `join`: motion from one log and commands from another, by stamps that are far apart, and what a diagnosis makes of it.

use std::path::{Path, PathBuf};
use std::process::Output;

use hydroline::build_info::BuildInfo;
use hydroline::log::messages::{pb, timestamp};
use hydroline::log::{Entry, FileRecorder, Head, LogReader, SummaryInput, WriteSettings};
use hydroline_rigs::{ParameterValue, PhysicsEntry, Rig};
use hydroline_sim::model::{Model, ModelState};
use hydroline_sim::trajectory::Trajectory;
use rand::{RngExt, SeedableRng, rngs::StdRng};
use rand_distr::{Distribution, StandardNormal};

use crate::support::hydroline;

/// 2026-01-01, UNIX \[ns\].
const START_NS: u64 = 1_767_225_600_000_000_000;
const RUN_S: f64 = 40.0;

/// One vehicle's surge, seen by one computer and commanded by another.
struct Logs {
    motion: PathBuf,
    commands: PathBuf,
}

#[derive(Clone, Copy)]
struct Clocks {
    /// Offset to add to the commands' stamps \[s\].
    offset_s: f64,
    /// The commands' log holds neutral for so long before the motion begins \[s\].
    idle_s: f64,
    /// Starts of the two hosts, and what their clocks that no one sets read at the start of the motion \[s\].
    boots: Option<[(&'static str, f64); 2]>,
}

fn ns(since_s: f64) -> u64 {
    START_NS.saturating_add_signed((since_s * 1e9) as i64)
}

fn log(path: &Path, boot: Option<(&str, f64)>, entries: Vec<(u64, Entry)>) {
    let session = match boot {
        Some((id, _)) => [("boot_id".to_owned(), id.to_owned())].into(),
        None => Default::default(),
    };
    let head = Head {
        rig_toml: "# none\n".to_owned(),
        calibration_toml: None,
        session,
        build: BuildInfo::default(),
    };
    let mut file = FileRecorder::create(path, false, head, WriteSettings::offline(None)).unwrap();
    for (at_ns, entry) in entries {
        file.write(at_ns, &entry).unwrap();
    }
    file.finish(&SummaryInput::clean("test")).unwrap();
}

fn clock_records(boot: Option<(&str, f64)>, wrong_s: f64) -> Vec<(u64, Entry)> {
    let of = |(_, uptime_s): (&str, f64)| {
        (0..8).map(move |k| {
            let since_s = 5.0 * f64::from(k);
            let realtime_ns = ns(since_s - wrong_s);
            let record = pb::ClockPair {
                monotonic_ns: ((uptime_s + since_s) * 1e9) as u64,
                realtime_ns,
                ..Default::default()
            };
            (realtime_ns, Entry::clock(&record))
        })
    };
    boot.into_iter().flat_map(of).collect()
}

fn logs(dir: &Path, clocks: Clocks, delay_s: Option<f64>, seed: u64) -> Logs {
    let mut water = Rig::builtin("lshpi").unwrap();
    if let Some(delay_s) = delay_s {
        water.physics.push(PhysicsEntry {
            effect: "command_latency".to_owned(),
            parameters: vec![("delay_s".to_owned(), ParameterValue::Number(delay_s))],
        });
    }
    let mut rng = StdRng::seed_from_u64(seed);
    let start = ModelState::at_rest([0.2, 0.0, -0.8, 0.0, 0.0, 0.1]);
    let mut path = Trajectory::new(Model::from_rig(&water).unwrap(), start, 0.005).unwrap();
    let mut edges = vec![(-clocks.idle_s, 0.0), (0.0, 0.0)];
    let mut t_s = 0.5;
    while t_s < RUN_S - 5.0 {
        edges.push((t_s, rng.random_range(-9.0..9.0)));
        t_s += rng.random_range(1.5..5.0);
    }
    edges.push((RUN_S - 4.0, 0.0));
    let mut commands = clock_records(clocks.boots.map(|b| b[1]), clocks.offset_s);
    for (k, (t_s, load)) in edges.into_iter().enumerate() {
        if t_s >= 0.0 {
            path.command(t_s, [load, 0.0, 0.0, 0.0, 0.0, 0.0]).unwrap();
        }
        let at_ns = ns(t_s - clocks.offset_s);
        let command = pb::ThrusterCommand {
            timestamp: Some(timestamp(at_ns)),
            sequence: k as u32,
            thruster: "surge".to_owned(),
            thrust_n: load,
            ..Default::default()
        };
        commands.push((at_ns, Entry::command(&command)));
    }
    let mut motion = clock_records(clocks.boots.map(|b| b[0]), 0.0);
    for k in 0..(RUN_S / 0.05) as u32 {
        let t_s = 0.003 + 0.05 * f64::from(k);
        let eta = path.state_at(t_s).unwrap().vehicle.eta;
        let mut noisy = |d: usize| {
            let normal: f64 = StandardNormal.sample(&mut rng);
            Some(eta[d] + 2e-4 * normal)
        };
        let sample = pb::VehicleMotion {
            timestamp: Some(timestamp(ns(t_s))),
            x_m: noisy(0),
            y_m: noisy(1),
            psi_rad: noisy(5),
            ..Default::default()
        };
        motion.push((ns(t_s), Entry::motion(&sample)));
    }
    let made = Logs {
        motion: dir.join(format!("motion-{seed}.mcap")),
        commands: dir.join(format!("commands-{seed}.mcap")),
    };
    for (path, boot, mut entries) in [
        (&made.motion, clocks.boots.map(|b| b[0]), motion),
        (&made.commands, clocks.boots.map(|b| b[1]), commands),
    ] {
        entries.sort_by_key(|e| e.0);
        log(path, boot, entries);
    }
    made
}

fn join(logs: &Logs, out: &Path, more: &[&str]) -> Output {
    let out = hydroline()
        .arg("join")
        .args([&logs.motion, &logs.commands])
        .arg("--out")
        .arg(out)
        .arg("--json")
        .args(more)
        .output()
        .unwrap();
    assert_eq!(
        out.status.code(),
        Some(0),
        "{}",
        String::from_utf8_lossy(&out.stderr)
    );
    out
}

fn relation(out: &Output) -> serde_json::Value {
    serde_json::from_slice::<serde_json::Value>(&out.stdout).unwrap()["relation"].clone()
}

/// Where the offset was looked for counted from the logs' own beginnings, not from their stamps.
#[test]
fn an_offset_is_looked_for_about_the_stamps() {
    let dir = tempfile::tempdir().unwrap();
    let clocks = Clocks {
        offset_s: 0.35,
        idle_s: 1200.0,
        boots: None,
    };
    let logs = logs(dir.path(), clocks, None, 1);
    let found = relation(&join(
        &logs,
        &dir.path().join("run.mcap"),
        &["--search-s", "20"],
    ));
    let (offset_s, sd_s) = (
        found["offset_s"].as_f64().unwrap(),
        found["offset_sd_s"].as_f64().unwrap(),
    );
    // The offset holds at the first command, 20 minutes before the motion: it is known as well as the drift is.
    let drift_s = found["drift_ppm"].as_f64().unwrap() * 1e-6 * clocks.idle_s;
    let drift_sd_s = found["drift_sd_ppm"].as_f64().unwrap() * 1e-6 * clocks.idle_s;
    assert!((offset_s - 0.35).abs() < 4.0 * sd_s, "{found}");
    assert!(
        (offset_s + drift_s - 0.35).abs() < 4.0 * sd_s.hypot(drift_sd_s),
        "{found}"
    );
    assert_eq!(found["from"], "estimated");
}

/// Two computers that were switched on at the same time were taken for one.
#[test]
fn two_hosts_have_two_clocks() {
    let dir = tempfile::tempdir().unwrap();
    for (other, from) in [("one", "clocks"), ("two", "estimated")] {
        let clocks = Clocks {
            offset_s: 0.35,
            idle_s: 0.0,
            boots: Some([("one", 500.0), (other, 500.0)]),
        };
        let logs = logs(dir.path(), clocks, None, 2);
        let out = dir.path().join(format!("{other}.mcap"));
        let found = relation(&join(&logs, &out, &[]));
        assert_eq!(found["from"], from);
        let offset_s = found["offset_s"].as_f64().unwrap();
        assert!((offset_s - 0.35).abs() < 0.05, "{found}");
        for path in [&logs.motion, &logs.commands] {
            std::fs::remove_file(path).unwrap();
        }
    }
}

/// Nobody had said anything of the drift, and the log said that it was none.
#[test]
fn a_drift_that_nobody_gave_is_not_known_to_be_none() {
    let dir = tempfile::tempdir().unwrap();
    let clocks = Clocks {
        offset_s: -1.25,
        idle_s: 0.0,
        boots: None,
    };
    let logs = logs(dir.path(), clocks, None, 3);
    for (more, sd) in [
        (&[][..], "50"),
        (&["--drift-ppm", "3", "--drift-sd-ppm", "0.5"][..], "0.5"),
        (&["--drift-ppm", "3"][..], "0"),
    ] {
        let out = dir.path().join(format!("{sd}.mcap"));
        join(&logs, &out, &[&["--offset-s", "-1.25"][..], more].concat());
        let mut reader = LogReader::open(&out).unwrap();
        reader.by_ref().for_each(drop);
        assert_eq!(reader.metadata()["session"]["join.drift_sd_ppm"], sd);
    }
}

/// A latency is in an offset that was estimated from the motion, and may not be named; it is distinguished from one that was
/// measured.
#[test]
fn a_diagnosis_of_joined_logs_names_no_latency_that_the_offset_could_be() {
    let dir = tempfile::tempdir().unwrap();
    let clocks = Clocks {
        offset_s: 0.8,
        idle_s: 0.0,
        boots: None,
    };
    let measured = [
        "--offset-s",
        "0.8",
        "--offset-sd-s",
        "0.004",
        "--drift-ppm",
        "0",
    ];
    for (name, more, latency_s) in [
        ("estimated", &[][..], None),
        ("measured", &measured[..], Some(0.25)),
    ] {
        let joined: Vec<PathBuf> = (10..13)
            .map(|seed| {
                let dir = dir.path().join(name);
                std::fs::create_dir_all(&dir).unwrap();
                let logs = logs(&dir, clocks, Some(0.25), seed);
                let out = dir.join(format!("run-{seed}.mcap"));
                join(&logs, &out, more);
                out
            })
            .collect();
        let out = hydroline()
            .arg("diagnose")
            .args(&joined)
            .args(["--rig", "lshpi", "--time-limit", "none", "--json"])
            .output()
            .unwrap();
        let said: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
        let effects = said["effects"].as_array().unwrap();
        match latency_s {
            None => {
                assert_eq!(said["verdict"], "none", "{}", said["sentence"]);
                assert!(effects.is_empty(), "{}", said["sentence"]);
            }
            Some(latency_s) => {
                assert_eq!(effects.len(), 1, "{}", said["sentence"]);
                assert_eq!(effects[0]["effect"], "command_latency");
                let delay_s = effects[0]["parameters"]["delay_s"]["value"]
                    .as_f64()
                    .unwrap();
                assert!((delay_s - latency_s).abs() < 0.02, "{delay_s}");
            }
        }
    }
}
