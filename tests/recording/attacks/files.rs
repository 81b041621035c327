//! Results that are files or streams: lost, cut, in the place of something else; inputs without an end; another
//! vehicle's logs.

use super::{bounded, path, simulated, simulated_by, words};
use crate::support::hydroline;
use std::os::unix::fs::symlink;
use std::process::Stdio;

/// A disk without room.
fn full() -> std::fs::File {
    let disk = std::fs::File::options().write(true).open("/dev/full");
    disk.unwrap()
}

/// 6. A result on a full disk was lost with exit code 0.
#[test]
fn a_result_that_stdout_did_not_take() {
    let dir = tempfile::tempdir().unwrap();
    let log = simulated(dir.path(), "run.mcap", "lshpi");
    for line in [vec!["info", &log], vec!["rig", "list"], vec!["--help"]] {
        let output = hydroline().args(&line).stdout(full()).output().unwrap();
        let said = words(&output);
        assert_eq!(output.status.code(), Some(1), "{line:?}: {said}");
        assert!(said.contains("stdout"), "{line:?}: {said}");
    }
}

/// 6. With stderr full or closed the words that could not be written became a panic: a whole log, then 101.
#[test]
fn words_that_stderr_did_not_take() {
    let dir = tempfile::tempdir().unwrap();
    let report = path(dir.path(), "report");
    let log = simulated(dir.path(), "run.mcap", "lshpi");
    let (reader, closed) = std::io::pipe().unwrap();
    drop(reader);
    for (i, stderr) in [Stdio::from(full()), Stdio::from(closed)]
        .into_iter()
        .enumerate()
    {
        let report = format!("{report}{i}");
        let status = hydroline()
            .args(["identify", &log, "--rig", "lshpi", "--report", &report])
            .stdout(Stdio::null())
            .stderr(stderr)
            .status()
            .unwrap();
        assert_eq!(status.code(), Some(0));
    }
}

/// 13. A result went through a symbolic link, and over a file that was there.
#[test]
fn results_over_what_is_there() {
    let dir = tempfile::tempdir().unwrap();
    let log = simulated(dir.path(), "run.mcap", "lshpi");
    let (link, precious) = (
        path(dir.path(), "new.toml"),
        path(dir.path(), "precious.toml"),
    );
    symlink(&precious, &link).unwrap();
    let output = bounded(&["rig", "new", "--out", &link]);
    assert_eq!(output.status.code(), Some(2), "{}", words(&output));
    assert!(
        !std::fs::exists(&precious).unwrap(),
        "written through the link"
    );

    let report = path(dir.path(), "report");
    std::fs::create_dir(&report).unwrap();
    let page = path(dir.path(), "report/identify.html");
    std::fs::write(&page, "of yesterday").unwrap();
    let line = ["identify", &log, "--rig", "lshpi", "--report", &report];
    let output = bounded(&line);
    assert_eq!(output.status.code(), Some(2), "{}", words(&output));
    assert_eq!(std::fs::read(&page).unwrap(), b"of yesterday");
    let output = bounded(&[&line[..], &["--force"]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", words(&output));
    assert!(std::fs::metadata(&page).unwrap().len() > 1000);
}

/// 13. The hidden controller removed whatever had the name of its link.
#[test]
fn the_hidden_controller_deletes_nothing_it_did_not_make() {
    let dir = tempfile::tempdir().unwrap();
    let precious = path(dir.path(), "thesis.tex");
    std::fs::write(&precious, "years of work").unwrap();
    let mut child = hydroline()
        .args(["sim-controller", "--kind", "maestro", "--pty", &precious])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    std::thread::sleep(std::time::Duration::from_millis(500));
    child.kill().unwrap();
    child.wait().unwrap();
    assert_eq!(std::fs::read(&precious).unwrap(), b"years of work");
}

/// 10. Files without an end were read to it; a pause that no clock can count was a panic.
#[test]
fn arguments_without_an_end() {
    let dir = tempfile::tempdir().unwrap();
    let table = path(dir.path(), "t.csv");
    std::fs::write(&table, "t,x\n0,0\n1,1\n").unwrap();
    let out = path(dir.path(), "out.mcap");
    for line in [
        vec!["import", &table, "--map", "/dev/zero", "--out", &out],
        vec![
            "record",
            "--rig",
            "lshpi",
            "--for",
            "1s",
            "--calibration",
            "/dev/zero",
            "--out",
            &out,
        ],
        vec![
            "record", "--rig", "lshpi", "--plan", "surge-4n", "--runs", "2", "--settle", "1e19",
            "--out", &out,
        ],
    ] {
        let output = bounded(&line);
        let said = words(&output);
        assert_eq!(output.status.code(), Some(2), "{line:?}: {said}");
    }
}

/// 14. Two vehicles were fitted as one, exit code 0.
#[test]
fn mixed_vehicles_are_fitted_as_one() {
    let dir = tempfile::tempdir().unwrap();
    let own = simulated(dir.path(), "own.mcap", "lshpi");
    let text = hydroline_rigs::Rig::builtin("lshpi")
        .unwrap()
        .effective_toml;
    let heavier = text.replace("name = \"lshpi\"", "name = \"heavy\"");
    assert_ne!(heavier, text);
    let rig = path(dir.path(), "heavy.toml");
    std::fs::write(&rig, heavier).unwrap();
    let other = simulated_by(dir.path(), "other.mcap", &rig, "surge-8n");
    for command in ["identify", "diagnose"] {
        let line = [command, &own, &other, "--rig", "lshpi"];
        let output = bounded(&line);
        let said = words(&output);
        assert_eq!(output.status.code(), Some(2), "{command}: {said}");
        assert!(
            said.contains("other.mcap") && said.contains("--other-rig"),
            "{said}"
        );
    }
    let output = bounded(&["identify", &own, &other, "--rig", "lshpi", "--other-rig"]);
    assert_eq!(output.status.code(), Some(0), "{}", words(&output));
}
