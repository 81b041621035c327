//! `hydroline plan`: what a vehicle cannot run is refused with the size that fits, and that file runs.
#![allow(clippy::unwrap_used)]

use crate::support::hydroline;

#[test]
fn a_refused_plan_is_written_at_the_size_that_is_said_and_runs() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let large = dir.join("large.toml");
    let shown = |arguments: &[&str]| {
        let out = hydroline().args(arguments).output().unwrap();
        (
            out.status.code(),
            String::from_utf8(out.stdout).unwrap(),
            String::from_utf8(out.stderr).unwrap(),
        )
    };
    let (code, text, _) = shown(&["plan", "show", "reversals", "--scale", "9", "--toml"]);
    assert_eq!(code, Some(0));
    std::fs::write(&large, text).unwrap();

    let large = large.to_str().unwrap();
    let (code, _, refusal) = shown(&["record", "--rig", "lshpi", "--plan", large, "--dry-run"]);
    assert_eq!(code, Some(2), "{refusal}");
    let share = refusal.split("--scale ").nth(1).unwrap();
    let share = share.split(' ').next().unwrap();
    let (_, text, _) = shown(&["plan", "show", large, "--scale", share, "--toml"]);
    let fits = dir.join("fits.toml");
    std::fs::write(&fits, text).unwrap();
    let fits = fits.to_str().unwrap();
    let (code, _, why) = shown(&["record", "--rig", "lshpi", "--plan", fits, "--dry-run"]);
    assert_eq!(code, Some(0), "at {share}: {why}");
}

#[test]
fn every_plan_that_is_built_in_is_tried_on_the_rig() {
    let out = hydroline()
        .args(["plan", "list", "--rig", "lshpi", "--json"])
        .output()
        .unwrap();
    let all: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    let all = all.as_array().unwrap();
    assert!(all.len() >= 7);
    assert!(all.iter().all(|p| p["runs"] == true), "{all:?}");
}
