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
    replayed_with(log, out, &[], 0)
}

fn replayed_with(log: &Path, out: &Path, more: &[&str], code: i32) -> serde_json::Value {
    let args = [
        "replay",
        text(log),
        "--keep-images",
        "--json",
        "--out",
        text(out),
    ];
    let output = hydroline().args(args).args(more).output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{stderr}");
    assert_eq!(code == 3, stderr.contains("[camera.response]"), "{stderr}");
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

/// The built-in rig with a response stated, as a file.
fn rig_stating(path: &Path, table: &str) {
    let rig = hydroline_rigs::Rig::builtin("lshpi").unwrap();
    let text = format!("{}\n[camera.response]\n{table}", rig.effective_toml);
    std::fs::write(path, text).unwrap();
}

#[test]
fn what_the_rig_states_goes_before_the_opening_and_replays_keep_it() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    let [rig, other] = [path("rig.toml"), path("other.toml")];
    rig_stating(&rig, "gamma = 1\ngamma_sd = 0\nsource = \"simulated\"\n");
    rig_stating(
        &other,
        "gamma = 0.8\ngamma_sd = 0.001\nblack_levels = 0\nblack_levels_sd = 0.5\nsource = \"another camera\"\n",
    );
    let [live, again, against, without] =
        ["live.mcap", "again.mcap", "against.mcap", "without.mcap"].map(path);
    let args = [
        "record",
        "--for",
        "3s",
        "--no-thrusters",
        "--rig",
        text(&rig),
        "--out",
    ];
    let output = hydroline().args(args).arg(&live).output().unwrap();
    assert!(
        matches!(output.status.code(), Some(0 | 3)),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let at_first = poses(&live);
    assert!(!at_first.is_empty());
    let response = replayed(&live, &again);
    assert_eq!(response["found_by"], "recording", "{response}");
    assert_eq!(
        response["gamma"],
        serde_json::json!([1.0, 0.0]),
        "{response}"
    );
    assert!(
        response["stated_by_rig"]["contradiction"].is_null(),
        "{response}"
    );
    let replays = poses(&again);
    for (stamp, pose) in &at_first {
        assert_eq!(replays.get(stamp), Some(pose), "{stamp:?}");
    }
    // Another rig states another camera: its word counts, no frame fits under it, and that is said.
    let response = replayed_with(&live, &against, &["--rig", text(&other)], 3);
    assert_eq!(response["found_by"], "replay", "{response}");
    let gamma = response["gamma"][0].as_f64().unwrap();
    assert!((gamma - 0.8).abs() < 0.01, "{response}");
    let words = response["stated_by_rig"]["contradiction"].as_str();
    assert!(
        words.is_some_and(|w| w.contains("hydroline flat")),
        "{response}"
    );
    // One that states nothing leaves it to the frames.
    let response = replayed_with(&live, &without, &["--rig", "lshpi"], 0);
    assert_eq!(response["found_by"], "replay", "{response}");
    assert!(response.get("stated_by_rig").is_none(), "{response}");
}
