//! The camera's response is found once, in a recording's opening or by its first replay, stands in the log, and every
//! replay takes it from there: the same poses, bit for bit.
#![allow(clippy::unwrap_used)]

use crate::support::hydroline;
use hydroline::log::{LogReader, Record};
use std::collections::BTreeMap;
use std::path::Path;

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Poses of a log by stamp, as bits.
fn poses(log: &Path) -> BTreeMap<(i64, i32), Vec<u64>> {
    let motions = LogReader::open(log)
        .unwrap()
        .filter_map(|m| match m.unwrap().record {
            Record::Motion(m) => Some(m),
            _ => None,
        });
    let bits = motions.map(|m| {
        let stamp = m.timestamp.unwrap();
        let pose = [m.x_m, m.y_m, m.z_m, m.phi_rad, m.theta_rad, m.psi_rad];
        let numbers = pose.into_iter().flatten().chain(m.covariance);
        (
            (stamp.seconds, stamp.nanos),
            numbers.map(f64::to_bits).collect(),
        )
    });
    bits.collect()
}

/// Replays with the images; returns what it says of the response.
fn replayed(log: &Path, out: &Path) -> serde_json::Value {
    let args = [
        "replay",
        text(log),
        "--keep-images",
        "--json",
        "--out",
        text(out),
    ];
    let output = hydroline().args(args).output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{stderr}");
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    json["replays"][0]["report"]["response"].clone()
}

#[test]
fn live_poses_are_those_of_every_replay_bit_for_bit() {
    let dir = tempfile::tempdir().unwrap();
    let [live, again, third] =
        ["live.mcap", "again.mcap", "third.mcap"].map(|n| dir.path().join(n));
    let args = [
        "record",
        "--rig",
        "lshpi",
        "--for",
        "3s",
        "--no-thrusters",
        "--out",
    ];
    let output = hydroline().args(args).arg(&live).output().unwrap();
    assert!(
        matches!(output.status.code(), Some(0 | 3)),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let said = LogReader::open(&live).unwrap().filter(
        |m| matches!(&m.as_ref().unwrap().record, Record::Event(e) if e.kind == "camera.response"),
    );
    assert_eq!(said.count(), 1);
    let at_first = poses(&live);
    // However loaded the machine: eight frames of the opening, and one after it.
    assert!(!at_first.is_empty());
    let response = replayed(&live, &again);
    assert_eq!(response["found_by"], "recording", "{response}");
    let replays = poses(&again);
    assert!(replays.len() > at_first.len());
    for (stamp, pose) in &at_first {
        assert_eq!(replays.get(stamp), Some(pose), "{stamp:?}");
    }
    assert_eq!(replayed(&again, &third), response);
    assert_eq!(poses(&third), replays);
}

#[test]
fn a_log_that_says_nothing_of_it_is_asked_once() {
    let dir = tempfile::tempdir().unwrap();
    let [log, once, twice] = ["run.mcap", "once.mcap", "twice.mcap"].map(|n| dir.path().join(n));
    let plan = dir.path().join("plan.toml");
    std::fs::write(&plan, "[[step]]\nfor_s = 0.6\nwrench = { surge_n = 8.0 }\n").unwrap();
    let args = [
        "simulate",
        "--rig",
        "lshpi",
        "--plan",
        text(&plan),
        "--out",
        text(&log),
    ];
    let output = hydroline().args(args).output().unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let first = replayed(&log, &once);
    assert_eq!(first["found_by"], "replay", "{first}");
    // The simulated camera leaves light as it is, and is known to.
    let [gamma, sd] = [0, 1].map(|k| first["gamma"][k].as_f64().unwrap());
    assert!((gamma - 1.0).abs() < 0.005 && sd < 0.01, "{first}");
    let second = replayed(&once, &twice);
    assert_eq!(second["found_by"], "recording", "{second}");
    assert_eq!(second["gamma"], first["gamma"]);
    assert_eq!(poses(&twice), poses(&once));
}
