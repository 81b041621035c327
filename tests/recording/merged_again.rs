//! The table of a whole run, imported again: what a fit finds in it is what it finds in the log.

use crate::support::hydroline;
use std::path::Path;

fn run(dir: &Path, words: &[&str]) -> String {
    let output = hydroline().current_dir(dir).args(words).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(0), "{words:?}: {said}");
    String::from_utf8(output.stdout).unwrap()
}

const MAP: &str = "[time]\ncolumn = \"timestamp_ns\"\nunit = \"ns\"\nclock = \"unix\"\n[motion.x_m]\ncolumn = \"x_m\"\nunit = \"m\"\n";

/// Value and sd of a coefficient.
fn found(dir: &Path, log: &str, key: &str) -> [f64; 2] {
    let text = run(dir, &["identify", log, "--rig", "lshpi", "--json"]);
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    ["value", "sd"].map(|name| json["parameters"][key][name].as_f64().unwrap())
}

/// Commands stood in the row of the next pose, up to a row late: quadratic damping came out 3 sd off, in the same direction for
/// every plan.
#[test]
fn a_run_exported_and_imported_again_gives_the_coefficients_of_the_log() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let thrusters: String = ["h_fore_stbd", "h_fore_port", "h_aft_stbd", "h_aft_port"]
        .iter()
        .map(|t| {
            format!("[[command]]\nthruster = \"{t}\"\ncolumn = \"thrust_{t}_n\"\nunit = \"N\"\n")
        })
        .collect();
    let load = "[[command]]\nthruster = \"surge\"\ncolumn = \"surge_n\"\nunit = \"N\"\n".to_owned();
    for (plan, commands) in [
        ("reversals", &load),
        ("two-tone", &load),
        ("coast-down", &load),
        ("reversals", &thrusters),
    ] {
        let out = |end: &str| format!("{plan}.{end}");
        for end in ["mcap", "csv", "again.mcap"] {
            std::fs::remove_file(dir.join(out(end))).ok();
        }
        run(
            dir,
            &[
                "simulate",
                "--motion-only",
                "--rig",
                "lshpi",
                "--plan",
                plan,
                "--seed",
                "3",
                "--out",
                &out("mcap"),
            ],
        );
        run(dir, &["export", &out("mcap"), "--merged"]);
        std::fs::write(dir.join("m.toml"), format!("{MAP}{commands}")).unwrap();
        run(
            dir,
            &[
                "import",
                &out("csv"),
                "--map",
                "m.toml",
                "--out",
                &out("again.mcap"),
            ],
        );
        for key in ["x_u", "x_uu"] {
            let ([a, sd], [b, _]) = (
                found(dir, &out("mcap"), key),
                found(dir, &out("again.mcap"), key),
            );
            assert!(
                (a - b).abs() < 0.3 * sd,
                "{plan} {key}: {a} ± {sd} in the log, {b} in its table"
            );
        }
    }
}
