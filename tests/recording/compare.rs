//! `hydroline compare`: results, rigs and logs held against each other, the same on a terminal, on a page and as JSON.

use crate::support::hydroline;
use std::path::{Path, PathBuf};

/// What a command printed; it ended well.
fn printed(arguments: &[&str], folder: &Path) -> String {
    let made = hydroline()
        .args(arguments)
        .current_dir(folder)
        .output()
        .unwrap();
    let words = String::from_utf8_lossy(&made.stderr);
    assert_eq!(made.status.code(), Some(0), "{arguments:?}: {words}");
    String::from_utf8(made.stdout).unwrap()
}

fn result(folder: &Path, name: &str, x_u: f64, y_v: f64) -> PathBuf {
    let json = serde_json::json!({
        "parameters": {
            "x_u": {"value": x_u, "sd": 1.0, "low": x_u - 2.0, "high": x_u + 2.0},
            "y_v": {"value": y_v, "sd": 3.0, "low": null, "high": null},
        },
        "order": ["x_u", "y_v"],
        "covariance": [[1.0, 0.0], [0.0, 9.0]],
        "covariance_combined": [[4.0, 0.0], [0.0, 9.0]],
        "runs": [{"name": "run-1", "seen": {"surge": {"speed": 0.3, "amplitude": 0.1, "frequency_hz": 0.2}}}],
    });
    let path = folder.join(name);
    std::fs::write(&path, json.to_string()).unwrap();
    path
}

#[test]
fn two_results_differ_in_their_own_sds() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    result(folder, "monday.json", -20.0, -30.0);
    result(folder, "tuesday.json", -30.0, -30.5);
    let arguments = [
        "compare",
        "monday.json",
        "tuesday.json",
        "--report",
        "page.html",
    ];
    let text = printed(&arguments, folder);
    // By the whole budget: 10 / sqrt(4 + 4), and 10 / (2 + 2) whatever both share.
    let row = text.lines().find(|l| l.starts_with("X_u ")).unwrap();
    assert!(row.ends_with("-3.5      -2.5"), "{row}");
    assert!(
        text.contains("1 of 2 coefficients differ by 2 sds or more"),
        "{text}"
    );
    assert!(
        text.contains("WARNING: runs of the same name stand in both (run-1)"),
        "{text}"
    );
    let page = std::fs::read_to_string(folder.join("page.html")).unwrap();
    let lead = text.lines().nth(1).unwrap();
    assert!(page.contains(lead), "{lead}");
    let json = printed(
        &["compare", "monday.json", "tuesday.json", "--json"],
        folder,
    );
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    let together = &json["coefficients"]["together"];
    let chi2 = 100.0 / 8.0 + 0.25 / 18.0;
    assert!(
        (together["chi2"].as_f64().unwrap() - chi2).abs() < 1e-9,
        "{together}"
    );
    assert_eq!(json["rig"], serde_json::Value::Null);
}

#[test]
fn rigs_and_logs_show_what_differs_in_rig_and_conditions() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let change = [
        "rig",
        "set",
        "lshpi",
        "vehicle.surge.linear_kgps=-22",
        "--out",
        "b.toml",
    ];
    printed(&change, folder);
    let text = printed(&["compare", "lshpi", "b.toml"], folder);
    let changed = text
        .lines()
        .find(|l| l.starts_with("vehicle.surge.linear_kgps"));
    assert!(changed.unwrap().ends_with("-20.0  -22.0  1.1000"), "{text}");
    assert!(text.contains("No difference can be judged"), "{text}");
    for (rig, out) in [("lshpi", "a.mcap"), ("b.toml", "b.mcap")] {
        let simulate = [
            "simulate",
            "--rig",
            rig,
            "--plan",
            "surge-4n",
            "--motion-only",
            "--note",
            rig,
            "--out",
            out,
        ];
        printed(&simulate, folder);
    }
    let text = printed(&["compare", "a.mcap", "b.mcap"], folder);
    assert!(text.contains("vehicle.surge.linear_kgps"), "{text}");
    let note = text.lines().find(|l| l.starts_with("note"));
    assert!(note.unwrap().contains("\"b.toml\""), "{text}");
    assert!(text.contains("\nCalibration\nNo key differs."), "{text}");
}
