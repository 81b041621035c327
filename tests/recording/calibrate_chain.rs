//! From a board in the sheet to plane coordinates with their uncertainty, as people do it: the board recorded
//! until its calibration is accepted, a run recorded and replayed with it, and every wrong turn refused with a reason.
#![allow(clippy::unwrap_used, clippy::panic)]

use crate::support::{hydroline, read};
use hydroline::log::Record;
use hydroline::log::messages::pb::PlaneCalibration;
use hydroline_calib::board::coplanarity::Coplanarity;
use hydroline_calib::{Calibration, IdealMap};
use hydroline_rigs::Rig;
use std::path::{Path, PathBuf};
use std::process::Output;

fn run(args: &[&str]) -> Output {
    hydroline().args(args).output().unwrap()
}

/// The same where it finds what was remembered before.
fn run_at_home(home: &Path, args: &[&str]) -> Output {
    let mut command = hydroline();
    command.env("XDG_DATA_HOME", home).args(args);
    command.output().unwrap()
}

fn words(output: &Output) -> (Option<i32>, String, String) {
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let stderr = text(&output.stderr);
    assert!(!stderr.contains("panicked"), "{stderr}");
    (output.status.code(), text(&output.stdout), stderr)
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A second of the built-in rig looking at a board `offset_m` behind its sheet, rendered offline.
fn board_log(dir: &Path, name: &str, board: &str, offset_m: &str, seed: &str) -> PathBuf {
    let plan = dir.join("short.toml");
    std::fs::write(
        &plan,
        "[[step]]\nfor_s = 0.32\nwrench = { surge_n = 0.0 }\n",
    )
    .unwrap();
    let out = dir.join(name);
    let output = run(&[
        "simulate",
        "--rig",
        "lshpi",
        "--plan",
        text(&plan),
        "--seed",
        seed,
        "--show-board",
        board,
        "--board-offset-m",
        offset_m,
        "--out",
        text(&out),
    ]);
    assert_eq!(output.status.code(), Some(0), "{:?}", words(&output));
    out
}

fn plane_messages(records: &[Record]) -> Vec<&PlaneCalibration> {
    records
        .iter()
        .filter_map(|r| match r {
            Record::PlaneCalibration(c) => Some(c),
            _ => None,
        })
        .collect()
}

/// Records the board on the simulated camera until its calibration is accepted; log and file.
fn accepted(dir: &Path) -> (PathBuf, PathBuf) {
    let log = dir.join("calib.mcap");
    let args = [
        "record",
        "--rig",
        "lshpi",
        "--calibrate",
        "--board",
        "dots-50",
        "--no-thrusters",
        "--json",
        "--out",
        text(&log),
    ];
    let output = run_at_home(&dir.join("home"), &args);
    let (code, stdout, stderr) = words(&output);
    assert!(stderr.contains("remembered for this camera"), "{stderr}");
    assert!(matches!(code, Some(0 | 3)), "{code:?} {stdout} {stderr}");
    let report: serde_json::Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!(
        report["runs"][0]["calibration"]["accepted"], true,
        "{stdout}"
    );
    (log, dir.join("calib.calibration.toml"))
}

#[test]
fn a_board_is_recorded_until_accepted_and_the_next_run_uses_it_live_and_replayed() {
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    let (log, file) = accepted(dir.path());
    let calibration = Calibration::load(&file).unwrap();
    assert_eq!(calibration.medium.name(), "air");
    assert_eq!(calibration.board.as_deref(), Some("dots-50"));
    assert!(calibration.date.is_some());
    assert!(
        matches!(calibration.gap(), Some(Coplanarity::Measured(g)) if g.offset_m.abs() < 0.3e-3)
    );
    assert!(
        !calibration.claim().contains("withdrawn"),
        "{}",
        calibration.claim()
    );

    // The log tells the way: what was in force, progress, and the accepted one whole.
    let (records, metadata) = read(&log);
    let reported = plane_messages(&records);
    assert_eq!(
        (reported[0].state.as_str(), reported[0].method.as_str()),
        ("in_force", "eq11-12")
    );
    let (last, way) = reported[1..].split_last().unwrap();
    assert!(
        !way.is_empty()
            && way
                .iter()
                .all(|m| m.state == "measuring" && !m.missing.is_empty())
    );
    assert_eq!(last.state, "accepted");
    assert_eq!(
        Calibration::from_toml(&last.toml, "log").unwrap(),
        calibration
    );
    assert!(last.coverage.unwrap() > 0.9 && last.worst_sd_m.unwrap() < 0.5e-3);
    assert!(
        records
            .iter()
            .any(|r| matches!(r, Record::Event(e) if e.kind == "calibration.accepted"))
    );
    assert!(
        records
            .iter()
            .any(|r| matches!(r, Record::Event(e) if e.kind == "calibration.none"))
    );
    // The map in force did not change under the profiles' feet.
    assert!(metadata["calibration"]["toml"].contains("eq11-12"));

    // A surge run with it: plane coordinates and their sd at every point on the board's area.
    let plan = dir.path().join("plan.toml");
    std::fs::write(&plan, "[[step]]\nfor_s = 0.6\nwrench = { surge_n = 8.0 }\n").unwrap();
    let out = dir.path().join("run.mcap");
    let output = run(&[
        "record",
        "--rig",
        "lshpi",
        "--plan",
        text(&plan),
        "--calibration",
        text(&file),
        "--out",
        text(&out),
    ]);
    let (code, _, stderr) = words(&output);
    assert!(matches!(code, Some(0 | 3)), "{code:?} {stderr}");
    assert!(!stderr.contains("no calibration"), "{stderr}");
    let (records, metadata) = read(&out);
    assert_eq!(
        Calibration::from_toml(&metadata["calibration"]["toml"], "head").unwrap(),
        calibration
    );
    // Live, at least one frame was analysed, however loaded the machine.
    let has_sd =
        |r: &Record| matches!(r, Record::Profile(p) if p.eta_sd_m.iter().any(|sd| sd.is_finite()));
    assert!(records.iter().any(has_sd));

    // Without one named, what was accepted is remembered, used and said; unless it is not wanted, or not for this medium.
    let home = dir.path().join("home");
    let again = |name: &str, more: &[&str]| {
        let out = dir.path().join(name);
        let args = [
            "record",
            "--rig",
            "lshpi",
            "--for",
            "200ms",
            "--no-thrusters",
        ];
        let args = [&args[..], &["--out", text(&out)], more].concat();
        let (code, _, stderr) = words(&run_at_home(&home, &args));
        assert!(matches!(code, Some(0 | 3)), "{code:?} {stderr}");
        let (_, metadata) = read(&out);
        (stderr, metadata["calibration"]["toml"].clone())
    };
    let (stderr, used) = again("remembered.mcap", &[]);
    for part in [
        "remembered one of",
        "old)",
        "dots-50",
        "rms ",
        "--no-remembered",
    ] {
        assert!(stderr.contains(part), "no '{part}' in: {stderr}");
    }
    assert_eq!(Calibration::from_toml(&used, "head").unwrap(), calibration);
    let (stderr, used) = again("unwanted.mcap", &["--no-remembered"]);
    assert!(!stderr.contains("remembered one"), "{stderr}");
    assert!(used.contains("eq11-12"));
    let (stderr, used) = again("wet.mcap", &["--water-temp", "18"]);
    assert!(stderr.contains("none of the 1 remembered"), "{stderr}");
    assert!(used.contains("eq11-12"));

    // Replay takes the log's own calibration and gives the live bytes; another one is used when named.
    let again = dir.path().join("again.mcap");
    let output = run(&["replay", text(&out), "--json", "--out", text(&again)]);
    let (code, stdout, stderr) = words(&output);
    assert_eq!(code, Some(0), "{stderr}");
    let replayed: serde_json::Value = serde_json::from_str(&stdout).unwrap();
    let report = &replayed["replays"][0]["report"];
    assert!(report["live"].as_u64().unwrap() > 0);
    assert_eq!(report["live"], report["live_identical"], "{report}");
    // Replayed, every frame is: coordinates and their sd, and what they are worth.
    let (records, _) = read(&again);
    let ideal = IdealMap::of(&Rig::builtin("lshpi").unwrap());
    let (mut points, mut placed) = (0, 0);
    let (mut worst, mut worst_sd) = (0.0f64, 0.0f64);
    for record in &records {
        let Record::Profile(p) = record else { continue };
        for k in 0..p.row_px.len() {
            points += 1;
            let (xi, eta) = (f64::from(p.xi_m[k]), f64::from(p.eta_m[k]));
            let (sd_xi, sd_eta) = (f64::from(p.xi_sd_m[k]), f64::from(p.eta_sd_m[k]));
            if !xi.is_finite() {
                continue;
            }
            placed += 1;
            // The simulator's camera IS the ideal one: here the truth is known.
            let at = ideal
                .unlimited(f64::from(p.column_px[k]), f64::from(p.row_px[k]))
                .unwrap();
            worst = worst.max((xi - at.0).abs()).max((eta - at.1).abs());
            worst_sd = worst_sd.max(sd_xi).max(sd_eta);
            assert!(sd_xi > 0.0 && sd_eta > 0.0);
        }
    }
    println!(
        "{placed} of {points} points placed, off by {:.3} mm at most, sd up to {:.3} mm",
        1e3 * worst,
        1e3 * worst_sd
    );
    assert!(
        points > 4000 && placed * 10 > points * 8,
        "{placed} of {points}"
    );
    assert!(worst < 0.3e-3, "{worst}");
    assert!(worst_sd < 1e-3, "{worst_sd}");

    let other = dir.path().join("other.mcap");
    let output = run(&[
        "replay",
        text(&log),
        "--calibration",
        text(&file),
        "--out",
        text(&other),
    ]);
    assert_eq!(output.status.code(), Some(0), "{:?}", words(&output));
    let (records, metadata) = read(&other);
    assert!(metadata["calibration"]["toml"].contains("homography"));
    assert_eq!(plane_messages(&records)[0].method, "homography");
}

#[test]
fn an_air_calibration_is_refused_in_water_unless_forced() {
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    let log = board_log(dir.path(), "board.mcap", "dots-50", "0", "1");
    let file = dir.path().join("air.toml");
    // The board is the one that the log's rig names.
    let output = run(&["calibrate", text(&log), "--out", text(&file)]);
    assert_eq!(output.status.code(), Some(0), "{:?}", words(&output));
    let out = dir.path().join("wet.mcap");
    let wet = [
        "record",
        "--rig",
        "lshpi",
        "--for",
        "200ms",
        "--no-thrusters",
        "--water-temp",
        "18",
        "--calibration",
        text(&file),
        "--out",
        text(&out),
    ];
    let (code, _, stderr) = words(&run(&wet));
    assert_eq!(code, Some(2), "{stderr}");
    for word in ["made in air", "the run is in fresh", "--force-calibration"] {
        assert!(stderr.contains(word), "no '{word}' in: {stderr}");
    }
    assert!(!out.exists());
    let forced: Vec<&str> = wet.iter().copied().chain(["--force-calibration"]).collect();
    let (code, _, stderr) = words(&run(&forced));
    assert!(
        matches!(code, Some(0 | 3)) && stderr.contains("forced"),
        "{code:?} {stderr}"
    );
    let (_, metadata) = read(&out);
    assert!(metadata["session"]["calibration.warning"].contains("made in air"));
    // Replay asks the same question of the same log.
    let again = dir.path().join("again.mcap");
    let (code, _, stderr) = words(&run(&["replay", text(&out), "--out", text(&again)]));
    assert_eq!(code, Some(2), "{stderr}");
    let (code, _, stderr) = words(&run(&[
        "replay",
        text(&out),
        "--force-calibration",
        "--out",
        text(&again),
    ]));
    assert_eq!(code, Some(0), "{stderr}");
}

#[test]
fn offline_a_board_1_mm_off_is_measured_and_held_against_the_one_in_the_sheet() {
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    let straight = board_log(dir.path(), "straight.mcap", "dots-50", "0", "1");
    let behind = board_log(dir.path(), "behind.mcap", "dots-50", "0.001", "2");
    let file = |name: &str| dir.path().join(name);
    let made = |log: &Path, out: &Path, more: &[&str]| {
        let mut args = vec![
            "calibrate",
            text(log),
            "--board",
            "dots-50",
            "--json",
            "--out",
            text(out),
        ];
        args.extend(more);
        let (code, stdout, stderr) = words(&run(&args));
        assert_eq!(code, Some(0), "{stderr}");
        serde_json::from_str::<serde_json::Value>(&stdout).unwrap()
    };
    let first = made(&straight, &file("a.toml"), &[]);
    assert_eq!(first["accepted"], true, "{first}");
    assert!(
        first["placement"]["xi_m"].as_f64().unwrap().abs() < 3e-4,
        "{}",
        first["placement"]
    );
    let second = made(
        &behind,
        &file("b.toml"),
        &["--against", text(&file("a.toml"))],
    );
    let offset_m = second["coplanarity"]["offset_m"].as_f64().unwrap();
    assert!((offset_m - 1e-3).abs() < 0.3e-3, "{offset_m}");
    // Corrected: the two agree on lengths to what the rig allows.
    let against = &second["against"][0];
    assert_eq!(against["aligned"]["within_tolerance"], true, "{against}");
    assert!(
        against["aligned"]["max_m"].as_f64().unwrap() < 0.3e-3,
        "{against}"
    );
    // The literal map is there too, and its own report counts the scallop in.
    let literal = made(&straight, &file("c.toml"), &["--method", "graticule"]);
    assert!(
        literal["worst_sd_m"].as_f64().unwrap() > 0.2e-3,
        "{}",
        literal["worst_sd_m"]
    );

    let (records, _) = read(&straight);
    let frame = records.iter().find_map(|r| match r {
        Record::Frame(f) => Some(f.to_grey(&Default::default()).unwrap()),
        _ => None,
    });
    let frame = frame.unwrap();
    // A single image, annotated; and without a rig nothing is claimed.
    let png = file("board.png");
    let image =
        image::GrayImage::from_raw(frame.width_px as u32, frame.height_px as u32, frame.pixels);
    image.unwrap().save(&png).unwrap();
    let (code, stdout, stderr) = words(&run(&[
        "calibrate",
        text(&png),
        "--board",
        "dots-50",
        "--medium",
        "fresh",
        "--annotate",
        text(&file("nodes.png")),
        "--out",
        text(&file("d.toml")),
    ]));
    assert_eq!(code, Some(0), "{stderr}");
    assert!(
        stdout.contains("withdrawn") && stdout.contains("coplanarity unknown"),
        "{stdout}"
    );
    assert_eq!(
        Calibration::load(&file("d.toml")).unwrap().medium.name(),
        "fresh"
    );
    assert!(
        image::open(file("nodes.png"))
            .unwrap()
            .into_rgb8()
            .pixels()
            .any(|p| p.0 == [0, 220, 0])
    );
}

#[test]
fn a_calibration_off_from_another_beyond_tolerance_is_neither_accepted_nor_remembered() {
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    let log = board_log(dir.path(), "board.mcap", "dots-50", "0", "1");
    let file = |name: &str| dir.path().join(name);
    let made = |out: &Path, more: &[&str]| {
        let args = ["calibrate", text(&log), "--json", "--out", text(out)];
        words(&run_at_home(&file("home"), &[&args[..], more].concat()))
    };
    let (code, _, stderr) = made(&file("first.toml"), &[]);
    assert_eq!(code, Some(0), "{stderr}");
    assert!(stderr.contains("remembered for this camera"), "{stderr}");
    // The same board, by a ruler that is 1 % off.
    let first = std::fs::read_to_string(file("first.toml")).unwrap();
    let scaled = first
        .lines()
        .map(|line| match line.strip_prefix("plane_scale_m = ") {
            Some(scale) => format!("plane_scale_m = {}", 1.01 * scale.parse::<f64>().unwrap()),
            None => line.to_owned(),
        });
    let scaled = scaled.collect::<Vec<_>>().join("\n");
    assert_ne!(scaled.trim(), first.trim());
    let old = file("old.toml");
    std::fs::write(&old, scaled).unwrap();
    let (code, stdout, stderr) = made(&file("second.toml"), &["--against", text(&old)]);
    assert_eq!(code, Some(3), "{stderr}");
    assert!(
        !stderr.contains("remembered for") && stderr.contains("is not remembered"),
        "{stderr}"
    );
    let said: serde_json::Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!(said["apart"], serde_json::json!([text(&old)]), "{stdout}");
    assert_eq!(said["accepted"], false);
    // Beside itself nothing speaks against it.
    let against = file("first.toml");
    let (code, stdout, stderr) = made(&file("third.toml"), &["--against", text(&against)]);
    assert_eq!(code, Some(0), "{stderr}");
    let said: serde_json::Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!(
        (&said["accepted"], &said["apart"]),
        (&serde_json::json!(true), &serde_json::json!([]))
    );
}

#[test]
fn every_bad_image_has_its_reason_and_no_calibration_is_made_of_none() {
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    let log = board_log(dir.path(), "board.mcap", "dots-50", "0", "1");
    let (records, _) = read(&log);
    let good = records.iter().find_map(|r| match r {
        Record::Frame(f) => Some(f.to_grey(&Default::default()).unwrap()),
        _ => None,
    });
    let good = image::GrayImage::from_raw(720, 576, good.unwrap().pixels).unwrap();
    let save = |name: &str, image: &image::GrayImage| {
        let path = dir.path().join(name);
        image.save(&path).unwrap();
        path
    };
    let flat = |v: u8| image::GrayImage::from_pixel(720, 576, image::Luma([v]));
    let good_png = save("good.png", &good);
    let mut state = 1u32;
    let clutter = image::GrayImage::from_fn(720, 576, |_, _| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        image::Luma([(state >> 24) as u8])
    });
    std::fs::write(dir.path().join("text.png"), "no image").unwrap();
    let bad = [
        (save("empty.png", &flat(80)), "empty"),
        (save("bright.png", &flat(255)), "saturated"),
        (save("clutter.png", &clutter), "no board"),
        (
            save(
                "small.png",
                &image::imageops::resize(&good, 360, 288, image::imageops::FilterType::Triangle),
            ),
            "360 x 288 px",
        ),
        (dir.path().join("text.png"), "PNG (8 or 16 bit) and JPEG"),
    ];
    let calibrate = |out: &str, images: &[&Path]| {
        let out = dir.path().join(out);
        let mut args = vec![
            "calibrate",
            "--rig",
            "lshpi",
            "--board",
            "dots-50",
            "--out",
            text(&out),
        ];
        args.extend(images.iter().map(|p| text(p)));
        words(&run(&args))
    };
    // Among good images the bad ones are named and the rest counts.
    let mut all: Vec<&Path> = vec![&good_png];
    all.extend(bad.iter().map(|(p, _)| p.as_path()));
    let (code, stdout, stderr) = calibrate("some.toml", &all);
    assert_eq!(code, Some(3), "{stderr}");
    assert!(stdout.contains("in 1 of 6 images"), "{stdout}");
    for (path, reason) in &bad {
        let line = stderr.lines().find(|l| l.contains(text(path)));
        assert!(
            line.is_some_and(|l| l.contains(reason)),
            "{reason}: {stderr}"
        );
    }
    let (code, _, stderr) = calibrate("none.toml", &[&bad[0].0]);
    assert_eq!(code, Some(1), "{stderr}");
    assert!(!dir.path().join("none.toml").exists());
    // Another board than the file's.
    let out = dir.path().join("wrong.toml");
    let (code, _, stderr) = words(&run(&[
        "calibrate",
        text(&good_png),
        "--rig",
        "lshpi",
        "--board",
        "chess-25",
        "--out",
        text(&out),
    ]));
    assert_eq!(code, Some(1), "{stderr}");
    assert!(stderr.contains("another board"), "{stderr}");
    // A rig that names no board.
    let mut rig = Rig::builtin("lshpi").unwrap();
    rig.board = None;
    let boardless = dir.path().join("boardless.toml");
    std::fs::write(&boardless, rig.to_toml()).unwrap();
    for (args, reason) in [
        (
            vec![
                "calibrate",
                text(&good_png),
                "--board",
                "dots",
                "--out",
                text(&out),
            ],
            "dots-50",
        ),
        (
            vec![
                "calibrate",
                "absent.png",
                "--board",
                "dots-50",
                "--out",
                text(&out),
            ],
            "absent.png",
        ),
        (
            vec![
                "record",
                "--rig",
                text(&boardless),
                "--calibrate",
                "--out",
                text(&out),
            ],
            "--board",
        ),
        (
            vec!["calibrate", text(&good_png), "--out", text(&out)],
            "--board",
        ),
        (vec!["board", "dots-50", "--out", "x.png"], ".svg"),
    ] {
        let (code, _, stderr) = words(&run(&args));
        assert_eq!(code, Some(2), "{args:?} {stderr}");
        assert!(stderr.contains(reason), "{args:?} {stderr}");
    }
}

#[test]
fn a_calibration_that_is_not_accepted_in_time_fails_with_what_is_missing() {
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    let log = dir.path().join("calib.mcap");
    // A chessboard without gauge blocks: nobody can know how far it stands off the sheet.
    let (code, _, stderr) = words(&run(&[
        "record",
        "--rig",
        "lshpi",
        "--calibrate",
        "--board",
        "chess-25",
        "--no-thrusters",
        "--for",
        "1500ms",
        "--out",
        text(&log),
    ]));
    assert_eq!(code, Some(1), "{stderr}");
    assert!(stderr.contains("coplanarity unknown"), "{stderr}");
    assert!(!dir.path().join("calib.calibration.toml").exists());
    let (records, _) = read(&log);
    assert!(
        plane_messages(&records)
            .iter()
            .all(|m| m.state != "accepted")
    );
}

#[test]
fn boards_and_targets_are_drawn_at_true_scale_from_the_files_the_software_reads() {
    let _alone = crate::support::alone();
    let dir = tempfile::tempdir().unwrap();
    for (command, name, word) in [
        ("board", "dots-50", "BLOCK"),
        ("board", "chess-25", "MARK"),
        ("target", "hexagons", "CUT"),
        ("target", "sway-board", "CUT"),
    ] {
        for ending in ["svg", "dxf"] {
            let out = dir.path().join(format!("{name}.{ending}"));
            let (code, stdout, stderr) = words(&run(&[command, name, "--out", text(&out)]));
            assert_eq!(code, Some(0), "{stderr}");
            assert!(stdout.contains("true scale"), "{stdout}");
            let drawing = std::fs::read_to_string(&out).unwrap();
            if ending == "dxf" {
                assert!(drawing.contains(word), "{name}");
            } else {
                assert!(drawing.contains("mm\" height="), "{name}: sizes in mm");
            }
        }
    }
}
