//! Reports in a real browser: on a phone nothing is cut off, on a dark screen and on paper letters stand out. By hand, and in
//! the nightly tests: `cargo test --test recording reports -- --ignored --nocapture`

use crate::live_page::figures::browser;
use crate::support::hydroline;
use std::path::Path;
use std::process::Command;

/// A command of hydroline, words split at blanks.
fn run(dir: &Path, line: &str) {
    let out = hydroline()
        .current_dir(dir)
        .args(line.split(' '))
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&out.stderr);
    assert!(out.status.success(), "{line}: {said}");
}

#[test]
#[ignore = "a Chromium, and a diagnosis"]
fn reports_fit_a_phone_and_follow_a_dark_screen() {
    let Some((python, chromium)) = browser() else {
        return;
    };
    let dir = tempfile::tempdir().unwrap();
    for (name, plan, seed) in [
        ("a", "surge-4n", 1),
        ("b", "reversals", 2),
        ("c", "surge-8n", 3),
    ] {
        run(
            dir.path(),
            &format!(
                "simulate --rig lshpi --plan {plan} --motion-only --seed {seed} --out {name}.mcap"
            ),
        );
    }
    for line in [
        "identify a.mcap b.mcap --rig lshpi --report out",
        "predict --rig lshpi --plan surge-8n --measured c.mcap --report out",
        "diagnose a.mcap b.mcap --hold-out c.mcap --rig lshpi --report out",
    ] {
        run(dir.path(), line);
    }
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/recording/reports/browser.py");
    let pages = ["identify", "predict", "diagnose"].map(|n| format!("out/{n}.html"));
    let out = Command::new(python)
        .current_dir(dir.path())
        .arg(script)
        .arg(chromium)
        .args(&pages)
        .output()
        .unwrap();
    assert!(
        out.status.success(),
        "{}",
        String::from_utf8_lossy(&out.stderr)
    );
    let found: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    println!("browser: {found}");
    for page in &pages {
        let page = &found[page];
        assert_eq!(
            page["phone_scroll_px"], 390,
            "the body scrolls sideways: {page}"
        );
        assert!(page["phone_letter_px"].as_f64().unwrap() >= 10.0, "{page}");
        assert_eq!(
            page["broken_figures"], 0,
            "a figure broken over two pages: {page}"
        );
        // Letters of the page and of its figures against what they stand on: WCAG 2.2, 1.4.3.
        for mode in ["light", "dark", "print"] {
            let contrasts = page["contrast"][mode].as_array().unwrap();
            assert!(contrasts.len() == 2, "page and figure: {page}");
            assert!(
                contrasts.iter().all(|c| c.as_f64().unwrap() >= 4.5),
                "{mode}: {page}"
            );
        }
        assert_eq!(page["print_paper"], "rgb(255, 255, 255)", "{page}");
    }
}
