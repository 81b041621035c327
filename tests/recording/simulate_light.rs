//! `simulate` under `[[physics]]` of light and camera: each is taken from a rig file, does something to the frames, and is
//! refused beyond its range with what to write instead.
#![allow(clippy::unwrap_used)]

use crate::support::{hydroline, read};
use hydroline::log::Record;
use hydroline_rigs::Rig;
use hydroline_sim::effect::find;
use std::path::Path;

const EFFECTS: [&str; 6] = [
    "line_profile",
    "lens_shading",
    "ambient_gradient",
    "mains_banding",
    "tone_curve",
    "range_clipping",
];

/// Simulates two frames of the rig with this text appended; exit code, last words, frames.
fn simulated(dir: &Path, name: &str, physics: &str) -> (Option<i32>, String, Vec<Vec<u8>>) {
    let file = |ending: &str| dir.join(format!("{name}.{ending}"));
    let rig = Rig::builtin("lshpi").unwrap().effective_toml;
    std::fs::write(file("toml"), rig + physics).unwrap();
    let plan = "[[step]]\nfor_s = 0.08\nwrench = { surge_n = 8.0 }\n";
    std::fs::write(file("plan.toml"), plan).unwrap();
    let output = hydroline()
        .args(["simulate", "--rig"])
        .arg(file("toml"))
        .arg("--plan")
        .arg(file("plan.toml"))
        .arg("--out")
        .arg(file("mcap"))
        .output()
        .unwrap();
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    let mut frames = Vec::new();
    if file("mcap").exists() {
        for record in read(&file("mcap")).0 {
            if let Record::Frame(frame) = record {
                frames.push(frame.data.to_vec());
            }
        }
    }
    (output.status.code(), words, frames)
}

#[test]
fn every_law_of_light_and_camera_is_simulated_or_refused_with_its_range() {
    let dir = tempfile::tempdir().unwrap();
    let (code, words, plain) = simulated(dir.path(), "plain", "");
    assert_eq!((code, plain.len()), (Some(0), 2), "{words}");
    for id in EFFECTS {
        let info = find(id).unwrap();
        let with = |which: Option<usize>| {
            let mut text = format!("\n[[physics]]\neffect = \"{id}\"\n");
            for (i, p) in info.parameters.iter().enumerate() {
                let beyond = which == Some(i);
                let value = if beyond { p.limits.1 + 1.0 } else { p.typical };
                text += &format!("{} = {value:e}\n", p.name);
            }
            text
        };
        let (code, words, frames) = simulated(dir.path(), id, &with(None));
        assert_eq!((code, frames.len()), (Some(0), 2), "{id}: {words}");
        assert_ne!(frames, plain, "{id}");
        for (i, p) in info.parameters.iter().enumerate() {
            let name = format!("{id}-{i}");
            let (code, words, _) = simulated(dir.path(), &name, &with(Some(i)));
            assert_eq!(code, Some(2), "{words}");
            let range = format!("it must lie in {} .. {}", p.limits.0, p.limits.1);
            for part in [id, p.name, &range] {
                assert!(words.contains(part), "no '{part}' in: {words}");
            }
        }
    }
}
