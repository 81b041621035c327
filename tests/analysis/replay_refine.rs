//! `replay --refine`: what a run shows of the sheet is found, printed with its sd, and the poses follow it;
//! what no image shows is refused in words.
#![allow(clippy::unwrap_used)]

use crate::support::hydroline;
use hydroline::log::{LogReader, Record};
use std::path::Path;

const THICKNESS_M: f64 = 0.0022;
const TILT_RAD: f64 = 0.0012;
const PLAN: &str = "[[step]]\nfor_s = 1.0\nwrench = { surge_n = 8.0 }\n";

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Runs to a code and returns stdout and stderr.
fn run_to(code: i32, args: &[&str]) -> [String; 2] {
    let output = hydroline().args(args).output().unwrap();
    let [stdout, stderr] = [output.stdout, output.stderr].map(|o| String::from_utf8(o).unwrap());
    assert_eq!(output.status.code(), Some(code), "{args:?}: {stderr}");
    [stdout, stderr]
}

/// Runs and returns stdout.
fn run(args: &[&str]) -> String {
    let [stdout, _] = run_to(0, args);
    stdout
}

/// Largest error of x and θ in a log \[m\], \[rad\], and the number of poses.
fn worst(log: &Path, truth: &Path) -> ([f64; 2], usize) {
    let of = |path: &Path, want_truth: bool| -> Vec<(i64, [f64; 2])> {
        LogReader::open(path)
            .unwrap()
            .filter_map(|m| match m.unwrap().record {
                Record::Truth(m) if want_truth => Some(m),
                Record::Motion(m) if !want_truth => Some(m),
                _ => None,
            })
            .filter_map(|m| {
                let stamp = m.timestamp.as_ref()?;
                let ns = stamp.seconds * 1_000_000_000 + i64::from(stamp.nanos);
                Some((ns, [m.x_m?, m.theta_rad?]))
            })
            .collect()
    };
    let (poses, truths) = (of(log, false), of(truth, true));
    let mut most = [0.0f64; 2];
    for (ns, pose) in &poses {
        let near = truths.iter().min_by_key(|(t, _)| t.abs_diff(*ns)).unwrap();
        for i in 0..2 {
            most[i] = most[i].max((pose[i] - near.1[i]).abs());
        }
    }
    (most, poses.len())
}

#[test]
fn a_sheet_that_is_not_the_rigs_is_found_and_the_poses_follow_it() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    let lshpi = include_str!("../../rigs/lshpi.toml");
    assert!(lshpi.contains("sigma_m = 0.002"));
    let other = lshpi
        .replace("sigma_m = 0.002", &format!("sigma_m = {THICKNESS_M}"))
        .replace("\"targets/hexagons.toml\"", "\"builtin:hexagons\"")
        + &format!(
            "\n[[physics]]\neffect = \"laser_plane_tilt\"\npitch_rad = {TILT_RAD}\nyaw_rad = 0.0\n"
        );
    std::fs::write(path("other.toml"), other).unwrap();
    std::fs::write(path("plan.toml"), PLAN).unwrap();
    let log = path("run.mcap");
    run(&[
        "simulate",
        "--rig",
        text(&path("other.toml")),
        "--plan",
        text(&path("plan.toml")),
        "--seed",
        "5",
        "--out",
        text(&log),
    ]);

    let (plain, refined) = (path("plain.mcap"), path("refined.mcap"));
    let words = ["replay", text(&log), "--rig", "lshpi", "--out"];
    let [_, stderr] = run_to(3, &[&words[..], &[text(&plain)]].concat());
    assert!(
        stderr.contains("only 0 of 25 frames have a pose") && stderr.contains("--refine"),
        "{stderr}"
    );
    let words = ["replay", text(&log), "--rig", "lshpi", "--json", "--refine"];
    let out = ["thickness,brightness,sheet-tilt", "--out", text(&refined)];
    let found: serde_json::Value =
        serde_json::from_str(&run(&[&words[..], &out[..]].concat())).unwrap();
    let found = &found["replays"][0]["report"]["refined"];
    for (name, truth) in [
        ("thickness_m", THICKNESS_M),
        ("tilt_pitch_rad", TILT_RAD),
        ("tilt_yaw_rad", 0.0),
    ] {
        let (value, sd) = (
            found[name][0].as_f64().unwrap(),
            found[name][1].as_f64().unwrap(),
        );
        assert!(
            sd > 0.0 && (value - truth).abs() < 4.5 * sd,
            "{name}: {value} sd {sd}, true {truth}"
        );
    }
    // Thickness to a hundredth of what it is off by, or the claim above says little.
    assert!(found["thickness_m"][1].as_f64().unwrap() < 0.1 * (THICKNESS_M - 0.002));

    let (before, without) = worst(&plain, &log);
    let (after, poses) = worst(&refined, &log);
    println!("{without} poses, x and theta off by {before:?} at most; refined {poses}, {after:?}");
    // Under the rig's own sheet the frames do not fit, and are not said to.
    assert_eq!(without, 0);
    assert_eq!(poses, 25);
    // Four sds of single frames with the thickness known.
    assert!(
        after[0] < 1.4e-3 && after[1] < 0.1f64.to_radians(),
        "{after:?}"
    );
}

#[test]
fn what_no_image_shows_is_refused_with_the_reason() {
    for (what, words) in [
        ("target-offset", ["leaves every image as it is", "measure"]),
        (
            "floor-slope",
            ["leaves every image as it is", "floor_slope"],
        ),
        ("thickness,floor-slope", ["floor-slope", "[[physics]]"]),
    ] {
        let output = hydroline()
            .args(["replay", "no.mcap", "--refine", what, "--out", "out.mcap"])
            .output()
            .unwrap();
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{stderr}");
        for word in words {
            assert!(stderr.contains(word), "{what}: {stderr}");
        }
    }
}
