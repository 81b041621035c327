//! One log, one verdict: `diagnose`, `campaign` and `record --until-decided` ask motion and frames by the same call.
//! (`src/python/tests/test_same_as_command_line.py` holds Python to the same, `demo` is run by `readme`.)
#![allow(clippy::unwrap_used)]

use crate::support::{hydroline, read};
use hydroline::log::messages::unix_ns;
use hydroline::log::{Entry, FileRecorder, Head, Record, SummaryInput, WriteSettings};
use hydroline::simulate::{Options, simulate};
use hydroline_rigs::{Plan, Rig};
use serde_json::Value;
use std::path::Path;

/// There and back, for two seconds and a half.
const PLAN: &str = "[[step]]\nfor_s = 1.0\nwrench = { surge_n = 8.0 }\n[[step]]\nfor_s = 1.4\nwrench = { surge_n = -8.0 }\n";
const CURVE: &str = "\n[[physics]]\neffect = \"tone_curve\"\ngamma = 1.4\n";

/// The built-in rig with a smaller camera that delivers so many frames per second, and some light about it.
fn small(rate_fps: f64) -> String {
    let text = Rig::builtin("lshpi").unwrap().effective_toml;
    let values = [
        ("width_px", 360.0),
        ("height_px", 288.0),
        ("rate_fps", rate_fps),
        ("fx_px", 443.186_429_353_236_5),
        ("fy_px", 443.186_429_353_236_5),
        ("cx_px", 179.5),
        ("cy_px", 143.5),
        ("frozen_after_s", 4.0),
        ("ambient", 8.0),
    ];
    let line = |line: &str| {
        let key = line.split(" = ").next();
        let value = values.iter().find(|(k, _)| Some(*k) == key);
        value.map_or(line.to_owned(), |(k, v)| match k.starts_with(['w', 'h']) {
            true => format!("{k} = {v:.0}"),
            false => format!("{k} = {v:?}"),
        })
    };
    text.lines().map(line).collect::<Vec<_>>().join("\n")
}

/// A folder with `rig.toml`, `tank.toml` that has the curve, and logs of one run in that tank: `run-1.mcap` with frames
/// and motion, `run-1-poses.mcap` the same.
fn recorded(rate_fps: f64) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let rig = |name: &str, text: &str| {
        std::fs::write(at(name), text).unwrap();
        Rig::load(&at(name)).unwrap()
    };
    let own = small(rate_fps);
    let tank = rig("tank.toml", &format!("{own}{CURVE}"));
    let seen = rig("rig.toml", &own);
    std::fs::write(at("plan.toml"), PLAN).unwrap();
    let plan = Plan::load(&at("plan.toml")).unwrap();
    let made = |rig: &Rig, name: &str, motion_only: bool| {
        let options = Options {
            motion_only,
            tank: Some(tank.clone()),
            ..Options::default()
        };
        simulate(rig, &plan, &at(name), &options, &mut |_, _| ()).unwrap();
        read(&at(name)).0
    };
    let frames = made(&seen, "frames.mcap", false);
    let often = rig("often.toml", &small(25.0));
    let motion = made(&often, "motion.mcap", true);
    let head = Head {
        rig_toml: seen.effective_toml.clone(),
        ..Head::default()
    };
    let settings = WriteSettings::offline(None);
    let mut log = FileRecorder::create(&at("run-1.mcap"), false, head, settings).unwrap();
    let mut entries: Vec<(u64, Entry)> = Vec::new();
    for record in motion {
        match record {
            Record::Motion(m) => {
                entries.push((unix_ns(m.timestamp.as_ref().unwrap()), Entry::motion(&m)))
            }
            Record::Command(c) => {
                entries.push((unix_ns(c.timestamp.as_ref().unwrap()), Entry::command(&c)))
            }
            _ => {}
        }
    }
    for (k, record) in frames.into_iter().enumerate() {
        if let Record::Frame(frame) = record {
            entries.push((frame.meta.mid_exposure_ns, Entry::frame(&frame, k as u64)));
        }
    }
    entries.sort_by_key(|e| e.0);
    for (ns, entry) in &entries {
        log.write(*ns, entry).unwrap();
    }
    log.finish(&SummaryInput::clean("made for a test")).unwrap();
    std::fs::copy(at("run-1.mcap"), at("run-1-poses.mcap")).unwrap();
    dir
}

/// stdout of a command in the folder.
fn printed(dir: &Path, words: &[&str]) -> String {
    let out = hydroline().current_dir(dir).args(words).output().unwrap();
    let said = String::from_utf8(out.stderr).unwrap();
    assert!(out.status.success(), "{words:?}: {said}");
    String::from_utf8(out.stdout).unwrap()
}

fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap()
}

fn diagnosed(dir: &Path) -> Value {
    let words = [
        "diagnose",
        "run-1-poses.mcap",
        "--rig",
        "rig.toml",
        "--time-limit",
        "none",
        "--json",
    ];
    json(&printed(dir, &words))
}

const SERIES: [&str; 14] = [
    "record",
    "--rig",
    "rig.toml",
    "--tank",
    "tank.toml",
    "--until-decided",
    "--dof",
    "surge",
    "--max-runs",
    "1",
    "--time-limit",
    "none",
    "--out",
    "run.mcap",
];

/// A session that goes on from its one run, the last.
fn until_decided(dir: &Path) -> Value {
    json(&printed(dir, &[&SERIES[..], &["--json"]].concat()))
}

/// Four frames are too few to say anything, which is a note of every verdict that has asked them.
#[test]
fn diagnose_and_a_series_ask_the_same_frames_of_a_log() {
    let dir = recorded(1.5);
    let found = diagnosed(dir.path());
    let notes = found["notes"].as_array().unwrap();
    let asked = |note: &Value| note.as_str().unwrap().contains("frames show a stripe");
    assert!(notes.iter().any(asked), "{notes:?}");
    assert_eq!(until_decided(dir.path())["verdict"], found);
}

#[test]
fn a_series_names_its_logs_that_have_no_images() {
    let dir = recorded(1.5);
    for name in ["run-1.mcap", "run-1-poses.mcap"] {
        std::fs::copy(dir.path().join("motion.mcap"), dir.path().join(name)).unwrap();
    }
    let text = printed(dir.path(), &SERIES);
    let line = text.lines().find(|l| l.contains("decided after 1 run(s)"));
    let line = line.unwrap_or_else(|| panic!("{text}"));
    let words = "without images, by motion alone: run-1.mcap";
    assert!(line.contains(words), "{line}");
}

#[test]
#[ignore = "four looks at frames, a minute of processor time: tests/nightly"]
fn a_wrong_tone_curve_has_one_verdict_from_every_command() {
    let dir = recorded(2.1);
    let found = diagnosed(dir.path());
    let effects = found["effects"].as_array().unwrap();
    let named = effects.iter().any(|e| e["effect"] == "tone_curve");
    assert!(named, "{}", found["sentence"]);
    let series = until_decided(dir.path());
    assert_eq!(series["verdict"], found);

    std::fs::create_dir(dir.path().join("logs")).unwrap();
    let own = dir.path().join("logs/run-1-poses.mcap");
    std::fs::copy(dir.path().join("run-1.mcap"), own).unwrap();
    let campaign = ["campaign", "logs", "--time-limit", "none"];
    printed(
        dir.path(),
        &[&campaign[..], &["--out", "campaign"]].concat(),
    );
    let rows = std::fs::read_to_string(dir.path().join("campaign/runs.jsonl")).unwrap();
    let rows: Vec<Value> = rows.lines().map(json).collect();
    for kind in ["run", "group"] {
        let row = rows.iter().find(|r| r["kind"] == kind).unwrap();
        assert_eq!(row["verdict"], found["verdict"], "{kind}");
        assert_eq!(row["sentence"], found["sentence"], "{kind}");
    }
}

/// Two runs of a vehicle whose thrusters lag, as motion alone: `run-1.mcap`, `run-1-poses.mcap` and the same of run 2 in the
/// folder, the poses in `logs` too.
fn lagging() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let own = Rig::builtin("lshpi").unwrap().effective_toml;
    std::fs::write(at("rig.toml"), &own).unwrap();
    let lag = "\n[[physics]]\neffect = \"thruster_lag\"\nlag_s = 0.25\n";
    std::fs::write(at("tank.toml"), format!("{own}{lag}")).unwrap();
    let [rig, tank] = ["rig.toml", "tank.toml"].map(|name| Rig::load(&at(name)).unwrap());
    std::fs::create_dir(at("logs")).unwrap();
    for (k, plan) in [(1, "reversals"), (2, "two-tone")] {
        let options = Options {
            motion_only: true,
            tank: Some(tank.clone()),
            seed: Some(k),
            ..Options::default()
        };
        let poses = at(&format!("run-{k}-poses.mcap"));
        let plan = Plan::load_or_builtin(plan).unwrap();
        simulate(&rig, &plan, &poses, &options, &mut |_, _| ()).unwrap();
        std::fs::copy(&poses, at(&format!("run-{k}.mcap"))).unwrap();
        std::fs::copy(&poses, at(&format!("logs/run-{k}-poses.mcap"))).unwrap();
    }
    dir
}

/// A verdict as a campaign's sheet has it, beside the whole one.
fn assert_same(sheet: &Value, found: &Value) {
    let own = &sheet["diagnosed"]["Ok"];
    for key in ["verdict", "sentence"] {
        assert_eq!(own[key], found[key], "{key}");
    }
    let [ours, theirs] = [own, found].map(|v| v["effects"].as_array().unwrap());
    assert_eq!(ours.len(), theirs.len());
    for (ours, theirs) in ours.iter().zip(theirs) {
        for key in ["effect", "probability", "matters"] {
            assert_eq!(ours[key], theirs[key], "{key}");
        }
        let numbers = theirs["parameters"].as_object().unwrap();
        assert_eq!(ours["parameters"].as_object().unwrap().len(), numbers.len());
        for (name, number) in numbers {
            let both = [&number["value"], &number["sd"]];
            for (k, value) in both.into_iter().enumerate() {
                assert_eq!(&ours["parameters"][name][k], value, "{name}");
            }
        }
    }
    for (channel, predicted) in own["predicted"].as_object().unwrap() {
        let rms = &found["leave_one_run_out"]["rms"];
        for (k, of) in ["before", "after", "noise"].into_iter().enumerate() {
            assert_eq!(predicted[k], rms[of][channel], "{channel} {of}");
        }
    }
}

#[test]
#[ignore = "seven diagnoses, a minute of processor time: tests/nightly; every day diagnose and a series, and Python"]
fn logs_of_motion_have_one_verdict_and_its_numbers_from_every_command() {
    let dir = lagging();
    let none = ["--rig", "rig.toml", "--time-limit", "none", "--json"];
    let diagnosed = |logs: &[&str]| {
        let words = [&["diagnose"], logs, &none[..]].concat();
        json(&printed(dir.path(), &words))
    };
    let both = diagnosed(&["run-1-poses.mcap", "run-2-poses.mcap"]);
    let effects = both["effects"].as_array().unwrap();
    assert!(
        effects.iter().any(|e| e["effect"] == "thruster_lag"),
        "{}",
        both["sentence"]
    );
    assert_eq!(diagnosed(&["run-2-poses.mcap", "run-1-poses.mcap"]), both);

    let mut series = SERIES;
    series[9] = "2";
    let last = json(&printed(dir.path(), &[&series[..], &["--json"]].concat()));
    assert_eq!(last["verdict"], both, "the last round of the series");

    let words = [
        "campaign",
        "logs",
        "--rig",
        "rig.toml",
        "--time-limit",
        "none",
    ];
    printed(dir.path(), &[&words[..], &["--out", "campaign"]].concat());
    let sheets = std::fs::read_dir(dir.path().join("campaign/store/sheets")).unwrap();
    let sheets = sheets.map(|f| json(&std::fs::read_to_string(f.unwrap().path()).unwrap()));
    let with_verdict = sheets.filter(|sheet| !sheet["diagnosed"].is_null());
    let (of_runs, of_sets): (Vec<Value>, Vec<Value>) =
        with_verdict.partition(|sheet| sheet["runs"].is_null());
    assert_eq!((of_runs.len(), of_sets.len()), (2, 1));
    assert_same(&of_sets[0], &both);
    let alone = ["run-1-poses.mcap", "run-2-poses.mcap"].map(|log| diagnosed(&[log]));
    for sheet in &of_runs {
        let sentence = &sheet["diagnosed"]["Ok"]["sentence"];
        let found = alone.iter().find(|f| f["sentence"] == *sentence).unwrap();
        assert_same(sheet, found);
    }
}
