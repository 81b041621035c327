//! The verdict's JSON as a user reads it: every field is documented, every number is one, and words have one form.
#![allow(clippy::unwrap_used)]

use crate::support::hydroline;
use hydroline::simulate::{Options, simulate};
use hydroline_rigs::{Dof, Plan, Rig};
use serde_json::{Map, Value};
use std::collections::BTreeSet;
use std::path::Path;

/// Fields that only some verdicts have, and none of these.
const NOT_HERE: [&str; 5] = ["data_faults", "equivalent", "given", "unexplained", "notes"];
/// Fields that are null where there is nothing: words and a whole object, and an sd that is not determined.
const MAY_BE_NULL: [&str; 3] = ["stage", "next_experiment", "sd"];

fn rig(dir: &Path, name: &str, text: &str) -> Rig {
    let path = dir.join(name);
    std::fs::write(&path, text).unwrap();
    Rig::load(&path).unwrap()
}

/// Two runs of a tank whose thrusters lag, diagnosed by a rig that knows neither that nor the drag; JSON and text.
fn said() -> (Map<String, Value>, String) {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let plain = Rig::builtin("lshpi").unwrap();
    let own = &plain.effective_toml;
    let lag = "\n[[physics]]\neffect = \"thruster_lag\"\nlag_s = 0.25\n";
    let tank = rig(dir, "tank.toml", &format!("{own}{lag}"));
    // A tenth of its drag.
    let drag = plain.vehicle.coefficients[0].quadratic;
    let mut wrong = plain.clone();
    wrong.vehicle.coefficients[0].quadratic = 0.1 * drag;
    std::fs::write(dir.join("rig.toml"), wrong.to_toml()).unwrap();
    for plan in ["reversals", "two-tone", "surge-8n"] {
        let options = Options {
            motion_only: true,
            tank: Some(tank.clone()),
            ..Options::default()
        };
        let out = dir.join(format!("{plan}.mcap"));
        let plan = Plan::load_or_builtin(plan).unwrap();
        simulate(&plain, &plan, &out, &options, &mut |_, _| ()).unwrap();
    }
    let run = |last: &[&str]| {
        let out = hydroline()
            .current_dir(dir)
            .args(["diagnose", "reversals.mcap", "two-tone.mcap"])
            .args(["--time-limit", "none"])
            .args([
                "--rig",
                "rig.toml",
                "--other-rig",
                "--hold-out",
                "surge-8n.mcap",
            ])
            .args(last)
            .output()
            .unwrap();
        let words = String::from_utf8_lossy(&out.stderr).into_owned();
        assert!(out.status.success(), "{words}");
        String::from_utf8(out.stdout).unwrap()
    };
    (serde_json::from_str(&run(&["--json"])).unwrap(), run(&[]))
}

/// First cells of the table of fields in the reference.
fn documented() -> BTreeSet<String> {
    let page = include_str!("../../src/guide/reference/interfaces.md");
    let (_, verdict) = page.split_once("\n## Verdict").unwrap();
    let verdict = verdict.split("\n## ").next().unwrap();
    let cells = verdict
        .lines()
        .filter_map(|l| l.strip_prefix("| ")?.split(" |").next());
    let names = cells.flat_map(|c| c.split('`').skip(1).step_by(2));
    names.map(str::to_owned).collect()
}

fn nulls(at: &str, value: &Value, found: &mut Vec<String>) {
    match value {
        Value::Null => found.push(at.to_owned()),
        Value::Array(all) => all.iter().for_each(|v| nulls(at, v, found)),
        Value::Object(all) => all.iter().for_each(|(k, v)| nulls(k, v, found)),
        Value::String(words) => assert!(!words.contains("NaN"), "{at}: {words}"),
        _ => {}
    }
}

fn is_empty(value: &Value) -> bool {
    match value {
        Value::Null => true,
        Value::String(words) => words.is_empty(),
        Value::Array(all) => all.is_empty(),
        Value::Object(all) => all.is_empty(),
        _ => false,
    }
}

#[test]
fn every_field_is_documented_and_true() {
    let (verdict, text) = said();
    let known = documented();
    for (field, value) in &verdict {
        assert!(field == "verdict" || known.contains(field), "{field}");
        let may_be_empty = NOT_HERE.contains(&field.as_str());
        assert!(may_be_empty || !is_empty(value), "{field} is empty");
    }
    let mut missing = Vec::new();
    nulls("", &Value::Object(verdict.clone()), &mut missing);
    missing.retain(|at| !MAY_BE_NULL.contains(&at.as_str()));
    assert!(missing.is_empty(), "{missing:?}");

    let spots = verdict["blind_spots"].as_array().unwrap();
    let mut seen = BTreeSet::new();
    for spot in spots {
        let spot = spot.as_str().unwrap();
        let (effect, dofs) = spot.split_once(" in ").unwrap_or((spot, ""));
        assert!(hydroline_sim::effect::find(effect).is_some(), "{spot}");
        assert!(seen.insert(effect), "{spot} stands there twice");
        let dofs = dofs.split(", ").filter(|d| !d.is_empty());
        for dof in dofs {
            assert!(Dof::ALL.iter().any(|d| d.name() == dof), "{spot}");
        }
    }

    let limits = verdict["at_limit"].as_array().unwrap();
    for limit in limits {
        let keys: Vec<&String> = limit.as_object().unwrap().keys().collect();
        assert_eq!(keys, ["factor", "key"], "{limit}");
        assert!(limit["key"].is_string() && limit["factor"].is_f64());
    }
    assert!(limits.iter().any(|l| l["key"] == "x_uu"), "{limits:?}");

    let others = verdict["leave_one_run_out"]["runs"].as_array().unwrap();
    let names: Vec<&Value> = others.iter().map(|r| &r["run"]).collect();
    assert_eq!(names, ["reversals", "two-tone"]);
    for run in others {
        let of = |by: &str| {
            assert!(run[by]["rms"]["x_m"].is_f64(), "{run}");
            run[by]["log_predictive_density"].as_f64().unwrap()
        };
        assert!(of("after") > of("before"), "{run}");
    }

    // Missing physics alone is left out; a run that was predicted is held out.
    for line in text
        .lines()
        .filter(|l| l.to_lowercase().contains("left out"))
    {
        assert!(verdict["sentence"] == *line, "{line}");
    }
}
