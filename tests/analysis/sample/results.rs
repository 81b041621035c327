//! Numbers of a case's results, read as tests/sample/lib/stages.py reads them.

use super::cases::{Cases, ran};
use serde_json::{Map, Value, json};
use std::path::Path;

const CHANNELS: [&str; 6] = ["x_m", "y_m", "z_m", "phi_rad", "theta_rad", "psi_rad"];
/// Columns of the probe's stripe at which a calibration is asked where on the sheet it puts them \[px\].
const PROBE_EVERY_PX: f64 = 80.0;
const PROBE_FIRST_PX: f64 = 40.0;
/// Parameters of a map with an sd below this are idle: the models that have them weigh nothing in the average.
const IDLE_SD: f64 = 1e-9;

/// Runs a case.
pub fn of(cases: &Cases, stage: &str, name: &str) -> Value {
    let command = match stage {
        "poses" => "replay",
        "calibrations" => "calibrate",
        "identifications" => "identify",
        "verdicts" => "diagnose",
        _ => panic!("no stage {stage}"),
    };
    let mut args = vec![command.to_owned()];
    args.extend(cases.arguments(stage, name));
    args.push("--json".to_owned());
    if command == "diagnose" {
        args.extend(["--time-limit", "none"].map(str::to_owned));
    }
    let out = cases.out(name);
    if matches!(stage, "poses" | "calibrations") {
        args.extend(["--out".to_owned(), out.to_str().unwrap().to_owned()]);
    }
    let printed: Value = serde_json::from_str(&ran(&args)).unwrap();
    match stage {
        "poses" => json!({ "report": printed["replays"][0]["report"], "poses": poses(&out) }),
        "calibrations" => json!({
            "report": printed,
            "parameters": parameters(&out),
            // Theirs is no uncertainty, and nothing is asked of them.
            "idle": {},
            "points": points(cases, &out),
        }),
        _ => printed,
    }
}

/// Rows of a table of a log: header to cell.
fn table(log: &Path, file: &str) -> Vec<Map<String, Value>> {
    let folder = log.with_extension("tables");
    let path = |p: &Path| p.to_str().unwrap().to_owned();
    let words = ["export", "--tables-only", "--out"].map(str::to_owned);
    ran(&[&words[..], &[path(&folder), path(log)]].concat());
    let text = std::fs::read_to_string(folder.join(file)).unwrap();
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let row = |line: &str| {
        let cells = line.split(',').map(|c| Value::from(c.trim_matches('"')));
        let named = header.iter().map(|h| (*h).to_owned()).zip(cells);
        named.collect()
    };
    lines.map(row).collect()
}

/// A cell; empty and NaN are null.
fn exact(cell: &Value) -> Value {
    let text = cell.as_str().unwrap();
    json!(text.parse::<f64>().ok().filter(|v| v.is_finite()))
}

/// Poses by stamp, with their sd.
fn poses(log: &Path) -> Value {
    let mut found = Map::new();
    for row in table(log, "motion.csv") {
        let covariance: Vec<f64> = row["covariance"]
            .as_str()
            .unwrap()
            .split(' ')
            .map(|v| v.parse().unwrap())
            .collect();
        let each = CHANNELS.iter().enumerate().map(|(i, name)| {
            let sd = covariance[7 * i].sqrt();
            (
                (*name).to_owned(),
                json!({ "value": exact(&row[*name]), "sd": sd }),
            )
        });
        let stamp = row["timestamp_ns"].as_str().unwrap().to_owned();
        found.insert(stamp, Value::Object(each.collect()));
    }
    Value::Object(found)
}

/// A fitted map's parameters with their sd, but for idle ones; a grid map has none.
fn parameters(calibration: &Path) -> Value {
    let text = std::fs::read_to_string(calibration).unwrap();
    let table: toml::Table = text.parse().unwrap();
    let map = &table["map"];
    let values = map.get("parameters").and_then(toml::Value::as_array);
    let mut found = Map::new();
    for (i, value) in values.into_iter().flatten().enumerate() {
        let sd = map["covariance"][i][i].as_float().unwrap().sqrt();
        if sd >= IDLE_SD {
            let with_sd = json!({ "value": value.as_float(), "sd": sd });
            found.insert(i.to_string(), with_sd);
        }
    }
    Value::Object(found)
}

/// Where on the sheet a calibration puts points of the probe's stripe, with the sd that it states.
fn points(cases: &Cases, calibration: &Path) -> Value {
    let probe = cases.log("probe");
    let out = calibration.with_extension("probe.mcap");
    let path = |p: &Path| p.to_str().unwrap().to_owned();
    let mut args = vec!["replay".to_owned(), path(&probe)];
    args.extend(["--calibration".to_owned(), path(calibration)]);
    args.push("--force-calibration".to_owned());
    args.extend(["--out".to_owned(), path(&out)]);
    ran(&args);
    let mut found = Map::new();
    for row in table(&out, "profiles.csv") {
        let column_px: f64 = row["column_px"].as_str().unwrap().parse().unwrap();
        // Outside of the board the map says nothing.
        if column_px % PROBE_EVERY_PX != PROBE_FIRST_PX || exact(&row["xi_m"]).is_null() {
            continue;
        }
        let axis = |name: &str| {
            let [value, sd] = ["m", "sd_m"].map(|end| exact(&row[&format!("{name}_{end}")]));
            json!({ "value": value, "sd": sd })
        };
        let sequence = row["sequence"].as_str().unwrap();
        let place = format!("frame {sequence} column {column_px:.0}");
        found.insert(place, json!({ "xi": axis("xi"), "eta": axis("eta") }));
    }
    Value::Object(found)
}
