//! Bad input on the command line: exit code 2, words that name the thing and the next step, no panic.
#![allow(clippy::unwrap_used)]

mod codes;

use crate::support::hydroline;
use std::path::Path;

/// Runs and returns (exit code, stderr).
fn run(args: &[&str]) -> (i32, String) {
    let output = hydroline().args(args).output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!stderr.contains("panicked"), "{args:?}: {stderr}");
    (output.status.code().unwrap(), stderr)
}

fn refused(args: &[&str], code: i32, words: &[&str]) {
    let (got, stderr) = run(args);
    assert_eq!(got, code, "{args:?}: {stderr}");
    for word in words {
        assert!(stderr.contains(word), "{args:?}: no '{word}' in: {stderr}");
    }
}

#[test]
fn arguments_and_files_that_are_wrong_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &[u8]| {
        let path = dir.path().join(name);
        std::fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let out = dir.path().join("out.mcap");
    let out = out.to_str().unwrap();
    let bad_rig = file("bad.toml", b"[camera]\nwidht_px = 720\n");
    let binary_rig = file("binary.toml", &[0, 159, 146, 150]);
    let bad_plan = file(
        "plan.toml",
        b"[[step]]\nfor_s = -3\nwrench = { surge_n = 4 }\n",
    );
    let strong = file(
        "strong.toml",
        b"[[step]]\nfor_s = 3\nwrench = { surge_n = 4000 }\n",
    );
    let far = file(
        "far.toml",
        b"[[step]]\nfor_s = 60\nwrench = { surge_n = 8 }\n",
    );
    let noise = file(
        "noise.mcap",
        b"this is no log at all, but long enough to look at",
    );
    let existing = file("there.mcap", b"");

    refused(
        &["record", "--rig", "no-such-rig", "--out", out],
        2,
        &["no-such-rig", "lshpi"],
    );
    refused(
        &["record", "--rig", &bad_rig, "--out", out],
        2,
        &["bad.toml", "widht_px", "width_px"],
    );
    refused(
        &["record", "--rig", &binary_rig, "--out", out],
        2,
        &["binary.toml"],
    );
    refused(
        &[
            "record", "--rig", "lshpi", "--plan", &bad_plan, "--out", out,
        ],
        2,
        &["plan.toml", "for_s", "-3"],
    );
    refused(
        &["record", "--rig", "lshpi", "--plan", &strong, "--out", out],
        2,
        &["surge"],
    );
    refused(
        &["record", "--rig", "lshpi", "--plan", &far, "--out", out],
        2,
        &["refused", "--dry-run"],
    );
    refused(
        &["record", "--rig", "lshpi", "--plan", &far, "--dry-run"],
        2,
        &["refused"],
    );
    refused(
        &["record", "--rig", "lshpi", "--for", "soon", "--out", out],
        2,
        &["30s"],
    );
    refused(
        &["record", "--rig", "lshpi", "--out", &existing],
        2,
        &["there.mcap", "exists"],
    );
    refused(
        &[
            "record",
            "--rig",
            "lshpi",
            "--out",
            "/no/such/folder/x.mcap",
        ],
        2,
        &["/no/such/folder"],
    );
    refused(
        &[
            "record",
            "--rig",
            "lshpi",
            "--water-temp",
            "80",
            "--for",
            "1s",
            "--out",
            out,
        ],
        2,
        &["--water-temp", "0..30"],
    );
    refused(
        &["record", "--rig", "lshpi", "--for", "10000h", "--out", out],
        2,
        &["MB/s", "free"],
    );
    refused(
        &[
            "simulate", "--rig", "lshpi", "--plan", "no-plan", "--out", out,
        ],
        2,
        &["no-plan", "surge-4n"],
    );
    refused(
        &[
            "simulate",
            "--rig",
            "lshpi",
            "--plan",
            "still",
            "--position-noise-m",
            "-1",
            "--out",
            out,
        ],
        2,
        &["-1"],
    );
    refused(&["info", &noise], 2, &["noise.mcap"]);
    refused(&["doctor", &noise], 2, &["noise.mcap"]);
    // One rule for what is no log: a bad argument, whichever command it was given to.
    let folder = dir.path().to_str().unwrap();
    let tables = dir.path().join("tables");
    let tables = tables.to_str().unwrap();
    for (log, word) in [
        ("/no/such.mcap", "/no/such.mcap"),
        (folder, folder),
        (existing.as_str(), "there.mcap"),
        (noise.as_str(), "noise.mcap"),
    ] {
        refused(&["info", log], 2, &[word]);
        refused(&["doctor", log], 2, &[word]);
        refused(&["recover", log, "--out", out], 2, &[word]);
        refused(&["export", log, "--out", tables], 2, &[word]);
    }
    refused(
        &["export", &noise, "--out", &existing],
        2,
        &["there.mcap", "is a file", "another --out"],
    );
    for (flag, value, words) in [
        ("--runs", "-3", ["-3", "1..=1000"]),
        ("--salinity", "60", ["60", "0..35"]),
        ("--ballast", "-1", ["-1", ">= 0"]),
        ("--ballast", "inf", ["inf", ">= 0"]),
        ("--set", "paint", ["paint", "KEY=VALUE"]),
        ("--water-temp", "nan", ["--water-temp", "0..30"]),
    ] {
        refused(
            &["record", "--rig", "lshpi", flag, value, "--out", out],
            2,
            &words,
        );
    }
    refused(
        &[
            "simulate", "--rig", "lshpi", "--plan", "still", "--seed", "-1", "--out", out,
        ],
        2,
        &["invalid value '-1'", "--seed"],
    );
    refused(&["recover", &noise, "--out", out], 2, &["noise.mcap"]);
    refused(&["replay", &noise, "--out", out], 2, &["noise.mcap"]);
    refused(&["extract", &noise, "--csv"], 2, &["noise.mcap"]);
    refused(&["rig", "new", "--out", &existing], 2, &["exists"]);
    refused(&["replay"], 2, &["Usage"]);
    assert!(
        !Path::new(out).exists(),
        "a refused command leaves nothing behind"
    );
}

#[test]
fn a_v4l_rig_without_its_camera_says_what_to_do() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("x.mcap");
    let (code, stderr) = run(&[
        "record",
        "--rig",
        "bench-v4l",
        "--for",
        "1s",
        "--out",
        out.to_str().unwrap(),
    ]);
    assert_eq!(code, 1, "{stderr}");
    assert!(stderr.contains("hydroline devices"), "{stderr}");
}

#[test]
fn rig_new_writes_a_rig_that_is_accepted() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("mine.toml");
    let output = hydroline()
        .args(["rig", "new", "--out"])
        .arg(&path)
        .output()
        .unwrap();
    assert!(output.status.success());
    let output = hydroline()
        .args(["rig", "show"])
        .arg(&path)
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    assert!(String::from_utf8_lossy(&output.stdout).contains("[camera]"));
}

#[test]
fn every_subcommand_explains_itself() {
    let words = |args: &[&str]| {
        let output = hydroline().args(args).output().unwrap();
        assert!(output.status.success(), "{args:?}");
        String::from_utf8(output.stdout).unwrap()
    };
    let help = words(&["--help"]);
    for part in [
        "First steps:",
        "At the tank:",
        "Analysis:",
        "Exit codes: 0 done",
    ] {
        assert!(help.contains(part), "no '{part}' in {help}");
    }
    let all = hydroline::cli::command(hydroline::build_info::BuildInfo::default());
    for command in all.get_subcommands() {
        let name = command.get_name();
        assert!(
            help.contains(&format!("\n  {name} ")) || command.is_hide_set(),
            "{name}"
        );
        assert!(words(&[name, "--help"]).contains("Examples:"), "{name}");
    }
    // Without a command: the help, and no success that a script would take for one.
    let output = hydroline().output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("At the tank:"));
}

#[test]
fn a_rig_too_fast_for_its_line_is_refused_before_anything_is_opened() {
    let dir = tempfile::tempdir().unwrap();
    let rig = dir.path().join("rig.toml");
    let text = hydroline_rigs::Rig::builtin("lshpi")
        .unwrap()
        .effective_toml;
    let slow = text.replace("baud = 115200", "baud = 9600");
    assert_ne!(slow, text);
    std::fs::write(&rig, slow).unwrap();
    let (rig, out) = (rig.to_str().unwrap(), dir.path().join("x.mcap"));
    let out = out.to_str().unwrap();
    let words = ["9600 baud", "raise link.baud"];
    refused(
        &["record", "--rig", rig, "--for", "1s", "--out", out],
        2,
        &words,
    );
    assert!(!Path::new(out).exists(), "no log is left behind");
    let output = hydroline().args(["check", "--rig", rig]).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    let stdout = String::from_utf8_lossy(&output.stdout);
    assert!(stdout.contains("FIX     thruster controller"), "{stdout}");
}

#[test]
fn a_reader_that_has_seen_enough_is_no_panic() {
    let dir = tempfile::tempdir().unwrap();
    let log = dir.path().join("sim.mcap");
    let log = log.to_str().unwrap();
    let tables = dir.path().join("tables");
    let image = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/frame.png");
    let (code, stderr) = run(&[
        "simulate",
        "--rig",
        "lshpi",
        "--plan",
        "still",
        "--motion-only",
        "--out",
        log,
    ]);
    assert_eq!(code, 0, "{stderr}");
    for args in [
        ["check", "--rig", "lshpi", "--json"],
        ["info", log, "--json", ""],
        ["doctor", log, "", ""],
        ["export", log, "--out", tables.to_str().unwrap()],
        ["extract", image, "--csv", ""],
        ["aim", "--rig", "lshpi", "--for=2s"],
    ] {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let output = hydroline()
            .args(args.iter().filter(|a| !a.is_empty()))
            .stdout(writer)
            .stderr(std::process::Stdio::piped())
            .spawn()
            .unwrap()
            .wait_with_output()
            .unwrap();
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{args:?}: {stderr}");
        assert!(!stderr.contains("panicked"), "{args:?}: {stderr}");
    }
}

#[test]
fn a_failed_run_whose_stdout_failed_too_says_both() {
    let full = std::fs::File::options().write(true).open("/dev/full");
    let output = hydroline()
        .args(["check", "--rig", "bench-v4l"])
        .stdout(full.unwrap())
        .output()
        .unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    assert!(
        stderr.contains("stdout: ") && stderr.contains("not ready"),
        "{stderr}"
    );
}
