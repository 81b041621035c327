//! Frames that are missing or show nothing do not lose the poses of those after them.
#![allow(clippy::unwrap_used)]

use crate::support::hydroline;
use hydroline_rigs::Rig;
use std::path::Path;

fn run(args: &[&str], dir: &Path) -> String {
    let output = hydroline().args(args).current_dir(dir).output().unwrap();
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(0), "{words}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

#[test]
fn poses_come_back_after_a_second_and_a_half_without_one_at_two_frames_a_second() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let rig = Rig::builtin("lshpi").unwrap().effective_toml;
    let slow = rig.replacen("rate_fps = 25.0", "rate_fps = 2.0", 1);
    let slow = slow.replacen("frozen_after_s = 0.5", "frozen_after_s = 5.0", 1);
    assert!(slow.contains("rate_fps = 2.0") && slow.contains("frozen_after_s = 5.0"));
    std::fs::write(dir.join("rig.toml"), slow).unwrap();
    let plan = "[[step]]\nfor_s = 6.0\nwrench = { surge_n = 6.0 }\n";
    std::fs::write(dir.join("plan.toml"), plan).unwrap();
    let simulate = [
        "simulate",
        "--rig",
        "rig.toml",
        "--plan",
        "plan.toml",
        "--out",
        "run.mcap",
    ];
    run(&simulate, dir);
    run(
        &["export", "run.mcap", "--frames-only", "--out", "frames"],
        dir,
    );
    let mut images: Vec<_> = std::fs::read_dir(dir.join("frames"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|e| e == "png"))
        .collect();
    images.sort();
    assert!(images.len() >= 12, "{images:?}");
    for image in &images[5..7] {
        std::fs::remove_file(image).unwrap();
    }
    let left = images.len() - 2;
    let replay = [
        "replay",
        "frames",
        "--rig",
        "rig.toml",
        "--json",
        "--out",
        "again.mcap",
    ];
    let said: serde_json::Value = serde_json::from_str(&run(&replay, dir)).unwrap();
    let report = &said["replays"][0]["report"];
    assert_eq!(report["frames"], left);
    assert_eq!(report["poses"], left, "{report}");
}
