//! From somebody else's file to a verdict, in three commands: guess, import, diagnose. A simulated vehicle whose thrusters
//! answer late is written as a towing tank's table, a ROS 2 bag and an ArduPilot log would hold it
//! (`import_logs/vehicle.py`).

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::support::hydroline;
use serde_json::Value;

const LAG_S: f64 = 0.35;

fn run(words: &[&str]) -> Output {
    let out = hydroline().args(words).output().unwrap();
    let said = String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(0), "{words:?}: {said}");
    out
}

/// Surge loads that a pulse of whole microseconds makes by the rig's curve: 1565 and 1435 us at 45 degrees.
const AHEAD_N: f64 = 4.0 * 2.81 * std::f64::consts::FRAC_1_SQRT_2;
const ASTERN_N: f64 = -4.0 * 2.18 * std::f64::consts::FRAC_1_SQRT_2;

/// Two runs as tables of ours.
fn runs(dir: &Path) -> Vec<PathBuf> {
    let path = |name: &str| dir.join(name).to_str().unwrap().to_owned();
    let mut water = String::from_utf8(run(&["rig", "show", "lshpi"]).stdout).unwrap();
    water +=
        &format!("\n[[physics]]\neffect = \"thruster_lag\"\nlag_s = {LAG_S}\ndof = \"surge\"\n");
    std::fs::write(path("water.toml"), water).unwrap();
    let plans: [&[(f64, f64)]; 2] = [
        &[
            (4.0, AHEAD_N),
            (7.0, ASTERN_N),
            (5.0, AHEAD_N),
            (3.0, ASTERN_N),
            (3.0, 0.0),
        ],
        &[
            (2.0, AHEAD_N),
            (2.0, 0.0),
            (3.0, ASTERN_N),
            (1.5, AHEAD_N),
            (4.0, ASTERN_N),
            (4.0, AHEAD_N),
        ],
    ];
    let each = plans.iter().zip(["a", "b"]);
    each.map(|(steps, name)| {
        let mut plan = format!("name = \"{name}\"\n");
        for (for_s, surge_n) in *steps {
            plan +=
                &format!("\n[[step]]\nfor_s = {for_s:?}\nwrench = {{ surge_n = {surge_n:?} }}\n");
        }
        let [toml, log, table] = ["toml", "mcap", "csv"].map(|end| path(&format!("{name}.{end}")));
        std::fs::write(&toml, plan).unwrap();
        let water = path("water.toml");
        run(&[
            "simulate",
            "--rig",
            &water,
            "--plan",
            &toml,
            "--motion-only",
            "--out",
            &log,
        ]);
        run(&["export", &log, "--merged", "--out", &table]);
        PathBuf::from(table)
    })
    .collect()
}

/// The four columns of pulses, which no log says the thrusters of: the user takes the # away and writes their names.
fn with_thrusters(map: &str) -> String {
    let names = ["h_fore_stbd", "h_fore_port", "h_aft_stbd", "h_aft_port"];
    let mut left = names.iter();
    let mut begun = false;
    let lines = map.lines().map(|line| {
        begun |= line.starts_with("# [[command]]");
        let line = if begun {
            line.strip_prefix("# ").unwrap_or(line)
        } else {
            line
        };
        match line.contains("NAME IN THE RIG") {
            true => line.replace("NAME IN THE RIG", left.next().unwrap()),
            false => line.to_owned(),
        }
    });
    lines.collect::<Vec<_>>().join("\n")
}

#[test]
fn three_commands_from_a_foreign_file_to_a_verdict() {
    let Some(python) = crate::inputs::python(&["rosbags", "pymavlink", "numpy"]) else {
        return;
    };
    let dir = tempfile::tempdir().unwrap();
    let tables = runs(dir.path());
    let script =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/recording/import_logs/vehicle.py");
    for kind in ["table", "bag", "dataflash"] {
        let mut logs = Vec::new();
        let map = dir.path().join(format!("{kind}.map"));
        for table in &tables {
            let foreign = table.with_extension(kind);
            let made = Command::new(&python)
                .arg(&script)
                .arg(kind)
                .args([table, &foreign])
                .output()
                .unwrap();
            assert!(
                made.status.success(),
                "{}",
                String::from_utf8_lossy(&made.stderr)
            );
            let foreign = foreign.to_str().unwrap();
            if !map.exists() {
                let guessed =
                    String::from_utf8(run(&["import", "--guess", foreign]).stdout).unwrap();
                let own = if kind == "dataflash" {
                    with_thrusters(&guessed)
                } else {
                    guessed
                };
                std::fs::write(&map, own).unwrap();
            }
            let log = format!("{foreign}.mcap");
            let map = map.to_str().unwrap();
            run(&[
                "import", foreign, "--map", map, "--rig", "lshpi", "--out", &log,
            ]);
            logs.push(log);
        }
        let mut words = vec![
            "diagnose",
            "--rig",
            "lshpi",
            "--time-limit",
            "none",
            "--json",
        ];
        words.extend(logs.iter().map(String::as_str));
        let out = hydroline().args(&words).output().unwrap();
        let said: Value = serde_json::from_slice(&out.stdout).unwrap();
        let effects = said["effects"].as_array().unwrap();
        let names: Vec<&str> = effects
            .iter()
            .filter_map(|e| e["effect"].as_str())
            .collect();
        println!("{kind}: {}", said["sentence"]);
        assert_eq!(said["verdict"], "named", "{kind}: {}", said["sentence"]);
        assert_eq!(names, ["thruster_lag"], "{kind}: {}", said["sentence"]);
        let lag = &effects[0]["parameters"]["lag_s"];
        let (lag_s, sd_s) = (lag["value"].as_f64().unwrap(), lag["sd"].as_f64().unwrap());
        // Stamps of a bag's loads are when they were recorded.
        assert!((lag_s - LAG_S).abs() < 4.0 * sd_s + 0.003, "{kind}: {lag}");
    }
}
