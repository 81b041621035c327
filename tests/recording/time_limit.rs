//! A diagnosis that its time limit or Ctrl-C ends: the verdict so far, marked so.

use crate::support::hydroline;
use serde_json::Value;
use std::path::Path;
use std::process::Stdio;
use std::time::Duration;

fn simulate(dir: &Path) {
    let out = hydroline()
        .current_dir(dir)
        .args(["simulate", "--rig", "lshpi", "--plan", "reversals"])
        .args(["--motion-only", "--out", "run.mcap"])
        .output()
        .unwrap();
    assert!(out.status.success());
}

const DIAGNOSE: [&str; 5] = ["diagnose", "run.mcap", "--rig", "lshpi", "--json"];

fn open(verdict: &Value) -> Vec<&str> {
    let open = verdict["truncated"]["open"].as_array().unwrap();
    open.iter().filter_map(Value::as_str).collect()
}

#[test]
fn a_diagnosis_without_time_ends_with_the_vehicle_alone_and_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    simulate(dir);
    let out = hydroline()
        .current_dir(dir)
        .args(DIAGNOSE)
        .args(["--time-limit", "0s", "--report", "report"])
        .output()
        .unwrap();
    assert_eq!(out.status.code(), Some(0));
    let verdict: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(verdict["truncated"]["by"], "time_limit");
    assert_eq!(verdict["truncated"]["steps"], 0);
    assert_eq!(verdict["truncated"]["after"], "the vehicle alone");
    assert!(open(&verdict).contains(&"beside the vehicle alone"));
    let sentence = verdict["sentence"].as_str().unwrap();
    assert!(sentence.starts_with("So far: "), "{sentence}");
    assert!(sentence.contains("--time-limit"), "{sentence}");
    let page = std::fs::read_to_string(dir.join("report/diagnose.html")).unwrap();
    assert!(page.contains("This is the verdict so far"));
}

/// It ended without a verdict.
#[test]
fn the_first_ctrl_c_gives_the_verdict_so_far() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    simulate(dir);
    let mut child = hydroline()
        .current_dir(dir)
        .args(DIAGNOSE)
        .args(["--time-limit", "none"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // From when on it listens, the system says.
    let status = format!("/proc/{}/status", child.id());
    let listens = || {
        let text = std::fs::read_to_string(&status).unwrap_or_default();
        let caught = text.lines().find_map(|l| l.strip_prefix("SigCgt:"));
        let caught = caught.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
        caught.is_some_and(|mask| (mask >> (libc::SIGINT - 1)) & 1 == 1)
    };
    while !listens() {
        assert!(
            child.try_wait().unwrap().is_none(),
            "ended before it listened"
        );
        std::thread::sleep(Duration::from_millis(2));
    }
    // SAFETY: a signal to a child that has not been waited for.
    unsafe { libc::kill(child.id() as i32, libc::SIGINT) };
    let out = child.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(0), "{said}");
    assert!(said.contains("verdict so far"), "{said}");
    let verdict: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(verdict["truncated"]["by"], "interrupt");
    assert!(!open(&verdict).is_empty());
}

#[test]
fn a_time_limit_is_a_length_of_time_or_none() {
    let out = hydroline()
        .args(["diagnose", "run.mcap", "--rig", "lshpi"])
        .args(["--time-limit", "soon"])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(2), "{said}");
    assert!(
        said.contains("--time-limit") && said.contains("or none"),
        "{said}"
    );
}
