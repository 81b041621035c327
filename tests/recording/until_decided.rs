//! `record --until-decided`: a session that was cut off goes on from its logs, and the simulated tank can hide physics.
#![allow(clippy::unwrap_used)]

use crate::support::hydroline;

/// A rig whose tank has an effect that the built-in one leaves out.
fn tank(dir: &std::path::Path) -> String {
    let shown = hydroline().args(["rig", "show", "lshpi"]).output().unwrap();
    let mut text = String::from_utf8(shown.stdout).unwrap();
    text.push_str("\n[[physics]]\neffect = \"thruster_lag\"\ndof = \"surge\"\nlag_s = 0.4\n");
    let path = dir.join("tank.toml");
    std::fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

#[test]
fn a_session_goes_on_from_its_logs_and_says_what_to_run_or_that_it_is_decided() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    // A run that was recorded and replayed before the session was cut off.
    let made = hydroline()
        .args(["simulate", "--rig", &tank(dir.path()), "--plan", "surge-8n"])
        .args(["--motion-only", "--out", &at("run-1-poses.mcap")])
        .output()
        .unwrap();
    assert!(made.status.success());
    std::fs::copy(at("run-1-poses.mcap"), at("run-1.mcap")).unwrap();
    let out = hydroline()
        .args([
            "record",
            "--rig",
            "lshpi",
            "--until-decided",
            "--dof",
            "surge",
        ])
        .args(["--time-limit", "none"])
        .args(["--dry-run", "--out", &at("run.mcap")])
        .output()
        .unwrap();
    let said = String::from_utf8(out.stderr).unwrap();
    assert!(out.status.success(), "{said}");
    assert!(said.contains("goes on from 1 run(s)"), "{said}");
    // One surge run does not show all that may be left out: there is something to run, with its reason.
    assert!(said.contains("run 2 of at most 8: "), "{said}");
    assert!(said.contains("so far: "), "{said}");
    assert!(!dir.path().join("run-2.mcap").exists());
}

#[test]
fn a_tank_of_its_own_is_for_simulated_parts() {
    let dir = tempfile::tempdir().unwrap();
    let rig = dir.path().join("real.toml");
    let shown = hydroline()
        .args(["rig", "show", "bench-v4l"])
        .output()
        .unwrap();
    std::fs::write(&rig, shown.stdout).unwrap();
    let out = hydroline()
        .args(["record", "--rig", rig.to_str().unwrap(), "--tank", "lshpi"])
        .args(["--for", "1s", "--out"])
        .arg(dir.path().join("run.mcap"))
        .output()
        .unwrap();
    let said = String::from_utf8(out.stderr).unwrap();
    assert_eq!(out.status.code(), Some(2), "{said}");
    assert!(
        said.contains("--tank") && said.contains("leave it out"),
        "{said}"
    );
}

/// `cargo test --test recording until_decided -- --ignored`
#[test]
#[ignore = "a run of 30 s and its diagnosis: two minutes"]
fn a_hidden_lag_is_found_by_one_run_that_was_proposed() {
    let dir = tempfile::tempdir().unwrap();
    let out = hydroline()
        .args(["record", "--rig", "lshpi", "--tank", &tank(dir.path())])
        .args([
            "--until-decided",
            "--max-runs",
            "3",
            "--time-limit",
            "none",
            "--yes",
            "--json",
            "--out",
        ])
        .arg(dir.path().join("run.mcap"))
        .output()
        .unwrap();
    let said: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(said["decided"], true, "{said}");
    let effects = said["verdict"]["effects"].as_array().unwrap();
    let heavy: Vec<&serde_json::Value> = effects.iter().filter(|e| e["matters"] == true).collect();
    assert!(
        matches!(&heavy[..], [e] if e["effect"] == "thruster_lag" && e["dof"] == "surge"),
        "{heavy:?}"
    );
}
