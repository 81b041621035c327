//! `hydroline flat`: folders of images at stated exposure times become the rig's table, and what is no series is refused.
#![allow(clippy::unwrap_used)]

use crate::support::hydroline;
use std::path::{Path, PathBuf};
use std::process::Output;

const WIDTH: u32 = 200;
const HEIGHT: u32 = 160;

/// A camera's frame of a still scene: noise before the curve, black level 16, clipped at 235.
fn frame(gamma: f64, time: f64, seed: u64) -> Vec<u8> {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let mut uniform = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    (0..WIDTH * HEIGHT)
        .map(|k| {
            let (u, v) = (f64::from(k % WIDTH), f64::from(k / WIDTH));
            let scene = 6.0 * (0.8 * (0.05 * u).sin() + 0.7 * (0.043 * v + 0.02 * u).cos()).exp();
            // Twelve uniform numbers are a bell of sd 1.
            let noise: f64 = (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
            let light = (scene * time + 1.2 * noise).clamp(0.0, 255.0);
            let grey = 16.0 + 255.0 * (light / 255.0).powf(gamma);
            grey.min(235.0).round() as u8
        })
        .collect()
}

fn folder(dir: &Path, name: &str, of: impl Fn(u64) -> Vec<u8>) -> PathBuf {
    let folder = dir.join(name);
    std::fs::create_dir(&folder).unwrap();
    for k in 0..6u64 {
        let image = image::GrayImage::from_raw(WIDTH, HEIGHT, of(k)).unwrap();
        image.save(folder.join(format!("{k:02}.png"))).unwrap();
    }
    folder
}

/// Arguments of a series whose light goes by a power of the time that is said.
fn series(dir: &Path, gamma: f64, honest: f64) -> Vec<String> {
    (0..6i32)
        .flat_map(|k| {
            let time = 2f64.powi(k);
            let of = |seed: u64| frame(gamma, time.powf(honest), seed + 100 * k as u64);
            let path = folder(dir, &format!("{}us", 500 << k), of);
            [
                "--exposure-us".to_owned(),
                format!("{}:{}", 500 << k, path.display()),
            ]
        })
        .collect()
}

fn run(args: &[String], more: &[&str]) -> Output {
    hydroline()
        .arg("flat")
        .args(args)
        .args(more)
        .output()
        .unwrap()
}

#[test]
fn a_series_of_images_becomes_a_rig_that_states_its_camera() {
    let dir = tempfile::tempdir().unwrap();
    let args = series(dir.path(), 0.45, 1.0);
    let out = dir.path().join("measured.toml");
    let output = run(
        &args,
        &["--rig", "lshpi", "--write-rig", out.to_str().unwrap()],
    );
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{stderr}");
    assert!(stderr.contains("a power of light fits"), "{stderr}");
    let rig = hydroline_rigs::Rig::load(&out).unwrap();
    let stated = rig.camera.response.unwrap();
    assert!(
        (stated.gamma - 0.45).abs() < 4.0 * stated.gamma_sd,
        "{stated:?}"
    );
    assert!(stated.gamma_sd < 0.02, "{stated:?}");
    let [black, sd] = stated.black_levels.unwrap();
    assert!((black - 16.0).abs() < 4.0 * sd, "{stated:?}");
    assert_eq!(stated.ceiling_levels, Some(235));
    // The output is that table.
    let table = String::from_utf8(output.stdout).unwrap();
    assert_eq!(table, stated.to_toml());
    let json = run(&args, &["--json"]);
    let json: serde_json::Value = serde_json::from_slice(&json.stdout).unwrap();
    assert_eq!(json["toml"], table);
    assert_eq!(json["exposures"].as_array().unwrap().len(), 6);
}

#[test]
fn auto_exposure_and_missing_times_are_refused_with_what_to_do() {
    let dir = tempfile::tempdir().unwrap();
    let args = series(dir.path(), 0.45, 0.05);
    let output = run(&args, &[]);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    assert!(stderr.contains("manual"), "{stderr}");
    assert!(output.stdout.is_empty());
    let path = args[1].split_once(':').unwrap().1.to_owned();
    for (args, words) in [
        (vec![path.clone()], "--exposure-us US:"),
        (args[..4].to_vec(), "at least 3 are needed"),
        ([&args[..], &args[..2]].concat(), "given twice"),
    ] {
        let output = run(&args, &[]);
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{stderr}");
        assert!(stderr.contains(words), "{words}: {stderr}");
    }
}
