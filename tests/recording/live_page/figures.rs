//! The figures that are asked of the live page, and a real browser. Run by hand, alone on the machine:
//! `cargo test --release --test recording live_page::figures -- --ignored --nocapture --test-threads 1`

use super::run::{Crowd, Recording, State, finish};
use crate::http::{ask, session_key};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

/// Resident memory of this process \[MB\].
fn resident_mb() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status
        .lines()
        .find_map(|l| l.strip_prefix("VmRSS:"))
        .unwrap();
    line.trim().trim_end_matches(" kB").parse::<f64>().unwrap() / 1e3
}

#[test]
#[ignore = "a figure in milliseconds: alone on the machine"]
fn stop_is_neutral_at_the_controller_within_100_ms() {
    let mut waits = Vec::new();
    for _ in 0..5 {
        let running = Recording::start(State::Viewed, 8.0);
        let crowd = Crowd::gather(running.address());
        std::thread::sleep(Duration::from_secs(3));
        assert!(running.neutral_since(0).is_none(), "the plan pushes");
        let key = format!(
            "X-Hydroline-Session: {}\r\n",
            session_key(running.address())
        );
        let pressed_ns = running.now_ns();
        assert_eq!(ask(running.address(), "POST /stop", &key).status, 200);
        std::thread::sleep(Duration::from_secs(1));
        let neutral_ns = running.neutral_since(pressed_ns).unwrap();
        waits.push((neutral_ns - pressed_ns) as f64 * 1e-6);
        finish(running);
        crowd.leave();
    }
    println!(
        "STOP to neutral at the controller, eight viewers and two hostile ones beside it: {waits:.1?} ms"
    );
    assert!(waits.iter().all(|ms| *ms <= 100.0), "{waits:?}");
}

#[test]
#[ignore = "two recordings of 40 s each: alone on the machine"]
fn eight_viewers_one_deaf_one_hostile_cost_nothing() {
    let alone = finish(Recording::start(State::Unseen, 40.0));
    let running = Recording::start(State::Viewed, 40.0);
    let crowd = Crowd::gather(running.address());
    std::thread::sleep(Duration::from_secs(8));
    let early_mb = resident_mb();
    std::thread::sleep(Duration::from_secs(29));
    let late_mb = resident_mb();
    let beside = finish(running);
    let seen = crowd.leave();
    let (with, without) = (
        beside.report.thrusters.unwrap(),
        alone.report.thrusters.unwrap(),
    );
    println!("viewers got {seen:?}; memory {early_mb:.1} MB after 8 s, {late_mb:.1} MB after 37 s");
    for (name, ended) in [("without viewers", &alone), ("with viewers", &beside)] {
        let stats = ended.report.thrusters.unwrap();
        println!(
            "{name}: {} frames, {} lost, {} sets, {} echoed, {} skipped; capture thread away p50 {:.3} p99 {:.3} max {:.3} ms",
            ended.report.capture.received,
            ended.lost(),
            stats.sets,
            stats.echoed,
            stats.skipped,
            ended.away_ms(0.5),
            ended.away_ms(0.99),
            ended.away_ms(1.0)
        );
    }
    assert_eq!(
        (beside.lost(), with.skipped, with.losses),
        (alone.lost(), without.skipped, without.losses)
    );
    assert!(beside.away_ms(0.99) - alone.away_ms(0.99) <= 1.0);
    assert!(late_mb - early_mb <= 5.0, "{early_mb} -> {late_mb} MB");
}

/// Findings of a script of `tests/recording` in a browser at an address; fails where the script does, or the console has an error.
pub(crate) fn found_in_browser(
    (python, chromium): (PathBuf, PathBuf),
    script: &str,
    address: impl std::fmt::Display,
    further: &[&str],
) -> serde_json::Value {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/recording");
    let out = Command::new(python)
        .arg(folder.join(script))
        .arg(chromium)
        .arg(format!("http://{address}/"))
        .args(further)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&out.stderr);
    assert!(out.status.success(), "{said}");
    let found: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    println!("browser: {found}");
    assert_eq!(found["errors"], serde_json::json!([]), "{found}");
    found
}

/// A Python with Playwright, and a Chromium; `None` where one is missing (the test is left out, aloud).
pub(crate) fn browser() -> Option<(PathBuf, PathBuf)> {
    let python: PathBuf = std::env::var_os("HYDROLINE_PYTHON")
        .unwrap_or_else(|| "python3".into())
        .into();
    let drives = Command::new(&python)
        .args(["-c", "import playwright"])
        .output();
    let chromium = [
        "/usr/bin/chromium",
        "/usr/bin/chromium-browser",
        "/usr/bin/google-chrome",
    ];
    let chromium = chromium.iter().map(PathBuf::from).find(|p| p.exists());
    match (drives.is_ok_and(|o| o.status.success()), chromium) {
        (true, Some(chromium)) => Some((python, chromium)),
        _ => {
            crate::inputs::skip(
                "a Chromium and a Python with playwright (HYDROLINE_BROWSER=1 tests/setup --tests)",
            );
            None
        }
    }
}

#[test]
#[ignore = "Chromium beside a recording: where it takes the cores, a late set-point ends the plan, as it should"]
fn a_browser_shows_it_all_and_its_stop_stops() {
    let Some(browser) = browser() else {
        return;
    };
    let _alone = crate::support::alone();
    let running = Recording::start(State::Viewed, 120.0);
    let found = found_in_browser(browser, "live_page/browser.py", running.address(), &[]);
    for shown in ["image", "stripe", "pose", "loads"] {
        assert!(found["shown_s"][shown].is_f64(), "{shown}: {found}");
    }
    assert_eq!(found["other_site_read"], serde_json::json!([]), "{found}");
    assert_eq!(
        found["before"], "STOP",
        "another site's posts stopped nothing: {found}"
    );
    let pressed_ns = found["pressed_ns"].as_u64().unwrap();
    let neutral_ns = running
        .neutral_since(pressed_ns)
        .expect("every output at neutral");
    println!(
        "browser: neutral at the controller {:.1} ms after the click",
        (neutral_ns - pressed_ns) as f64 * 1e-6
    );
    assert_eq!(found["after"], "STOPPED: neutral");
    running.end();
    let ended = finish(running);
    assert!(ended.pushes_after(neutral_ns).is_empty());
}
