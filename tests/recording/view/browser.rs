//! The page in a real browser: by hand, and in `tests/nightly view`.

use super::{Served, simulated};
use crate::live_page::figures::{browser, found_in_browser};
use crate::support::hydroline;

/// Longest time between two frames of the page while it plays \[ms\], but for one in twenty.
const FRAME_MS: f64 = 50.0;

#[test]
#[ignore = "a Chromium"]
fn a_browser_shows_it_all_and_the_keyboard_alone_will_do() {
    let Some(browser) = browser() else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let log = simulated(folder.path(), 6.0);
    let replayed = folder.path().join("replayed.mcap");
    let made = hydroline()
        .arg("replay")
        .arg(&log)
        .arg("--out")
        .arg(&replayed)
        .output()
        .unwrap();
    assert!(made.status.success());
    let served = Served::of(&[&log, &replayed]);
    let pictures = env!("CARGO_TARGET_TMPDIR");
    let found = found_in_browser(browser, "view/browser.py", served.address, &[pictures]);
    served.end();
    let shown = found["shown"].as_array().unwrap();
    assert_eq!(shown.len(), 4);
    for one in shown {
        assert_eq!(
            one["scroll_px"], one["width_px"],
            "it scrolls sideways: {one}"
        );
        assert!(
            one["stripe"] == true && one["plots"].as_u64() >= Some(3),
            "{one}"
        );
        for name in one["names"].as_array().unwrap() {
            assert_ne!(name, "", "a control without a name: {one}");
        }
    }
    // Every control is reached by Tab, and keys do what the page says.
    assert_eq!(found["unreached"], serde_json::json!([]), "{found}");
    let keys = &found["keys"];
    let time = |key: &str| keys[key].as_f64().unwrap();
    assert!(
        time("ArrowRight") > 0.02 && time("ArrowRight") < 0.06,
        "{keys}"
    );
    assert!(time("End") > 5.9 && time("Home").abs() < 0.01, "{keys}");
    assert!((time("Shift+ArrowRight") - 1.0).abs() < 0.01, "{keys}");
    assert!(time("Space") > 1.5, "it plays: {keys}");
    let range = found["range"].as_str().unwrap();
    assert!(range.contains("@1..2"), "{range}");
    assert!(
        found["csv"]
            .as_str()
            .unwrap()
            .starts_with("time_s,unix_ns,/"),
        "{found}"
    );
    let frame_ms = found["frame_ms"].as_f64().unwrap();
    assert!(frame_ms <= FRAME_MS, "95 % of frames within {frame_ms} ms");
}
