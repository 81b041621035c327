//! Clocks that were set in mid-run, and clocks that never were: what they cost, and what is said of them.

use crate::support::hydroline;
use std::path::Path;

fn run(dir: &Path, words: &[&str]) -> (Option<i32>, String) {
    let output = hydroline().current_dir(dir).args(words).output().unwrap();
    let both = [output.stdout, output.stderr].concat();
    (output.status.code(), String::from_utf8(both).unwrap())
}

fn simulate(dir: &Path, seed: &str, start: &str, log: &str) {
    let words = [
        "simulate",
        "--motion-only",
        "--rig",
        "lshpi",
        "--plan",
        "reversals",
        "--seed",
        seed,
        "--start",
        start,
        "--out",
        log,
    ];
    let (code, text) = run(dir, &words);
    assert_eq!(code, Some(0), "{text}");
}

/// The map of a table of surge and its load, with keys of [time].
fn map(dir: &Path, time: &str) {
    let text = format!(
        "[time]\ncolumn = \"t_s\"\nunit = \"s\"\n{time}[motion.x_m]\ncolumn = \"x_m\"\nunit = \"m\"\n[[command]]\nthruster = \"surge\"\ncolumn = \"surge_n\"\nunit = \"N\"\n"
    );
    std::fs::write(dir.join("m.toml"), text).unwrap();
}

/// The value behind a key in a message.
fn number<'a>(text: &'a str, key: &str) -> &'a str {
    let rest = text.split_once(key).unwrap().1;
    let end = rest
        .find(|c: char| !c.is_ascii_digit() && c != '.')
        .unwrap_or(rest.len());
    &rest[..end]
}

/// It was a warning of gaps; `identify` then took time and memory in proportion to the step.
#[test]
fn a_clock_set_in_mid_run_is_refused_and_the_two_runs_it_names_are_sound() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    simulate(dir, "3", "2026-05-04T09:00:00Z", "run.mcap");
    let (code, text) = run(dir, &["export", "run.mcap", "--merged"]);
    assert_eq!(code, Some(0), "{text}");
    let table = std::fs::read_to_string(dir.join("run.csv")).unwrap();
    let mut lines: Vec<Vec<String>> = table
        .lines()
        .map(|l| l.split(',').map(str::to_owned).collect())
        .collect();
    let keep = ["t_s", "x_m", "surge_n"].map(|n| lines[0].iter().position(|c| c == n).unwrap());
    let rows = lines.len() - 1;
    for (k, row) in lines.iter_mut().enumerate().skip(1) {
        let t_s: f64 = row[keep[0]].parse().unwrap();
        let set_s = if k > rows / 2 { 3.2e9 + 0.7 } else { 0.0 };
        row[keep[0]] = format!("{:.4}", t_s + set_s);
    }
    let text: Vec<String> = lines
        .iter()
        .map(|row| keep.map(|i| row[i].as_str()).join(","))
        .collect();
    std::fs::write(dir.join("set.csv"), text.join("\n") + "\n").unwrap();

    map(dir, "");
    let import = [
        "import",
        "set.csv",
        "--map",
        "m.toml",
        "--out",
        "whole.mcap",
    ];
    let (code, text) = run(dir, &import);
    assert_eq!(code, Some(2), "{text}");
    assert!(
        text.contains("FAULT clock_step") && !dir.join("whole.mcap").exists(),
        "{text}"
    );

    let [to_s, from_s] = ["to_s = ", "from_s = "].map(|key| number(&text, key).to_owned());
    let (mut written, mut logs) = (0, Vec::new());
    for (name, key) in [
        ("a.mcap", format!("to_s = {to_s}\n")),
        ("b.mcap", format!("from_s = {from_s}\n")),
    ] {
        map(dir, &key);
        let (code, text) = run(
            dir,
            &["import", "set.csv", "--map", "m.toml", "--out", name],
        );
        assert_eq!(code, Some(0), "{text}");
        written += number(&text, &format!("{name}: "))
            .parse::<usize>()
            .unwrap();
        logs.push(name);
    }
    assert_eq!(written, rows, "no row is lost between the two");

    // What goes on all the same is two runs for a fit and for a diagnosis.
    map(dir, "");
    let (code, text) = run(dir, &[&import[..], &["--accept-faults"]].concat());
    assert_eq!(code, Some(3), "{text}");
    let (code, text) = run(dir, &["identify", "whole.mcap", "--rig", "lshpi"]);
    assert_eq!(code, Some(0), "{text}");
    assert!(text.contains("taken as 2 run(s)"), "{text}");
    let diagnose = ["diagnose", "whole.mcap", "--rig", "lshpi", "--time-limit"];
    let (code, text) = run(dir, &[&diagnose[..], &["none"]].concat());
    assert_eq!(code, Some(0), "{text}");
    assert!(
        text.contains("clock_step in stamp") && text.contains("LOG@"),
        "{text}"
    );
    let (code, text) = run(dir, &[&diagnose[..], &["none", "--accept-faults"]].concat());
    assert_eq!(code, Some(0), "{text}");
    assert!(text.contains("long_gap"), "{text}");
}

/// They came before and behind all days of a campaign, and what had changed since was said of them.
#[test]
fn logs_of_1970_and_2099_are_clock_errors_and_have_no_day() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    std::fs::create_dir(dir.join("logs")).unwrap();
    simulate(dir, "1", "1970-01-01T00:00:45Z", "logs/early.mcap");
    simulate(dir, "2", "2024-05-04T09:00:00Z", "logs/right.mcap");
    simulate(dir, "3", "2099-06-23T00:00:00Z", "logs/late.mcap");
    for (log, wrong) in [("early", true), ("right", false), ("late", true)] {
        let (_, text) = run(dir, &["doctor", &format!("logs/{log}.mcap")]);
        assert_eq!(text.contains("clock: stamped"), wrong, "{text}");
    }
    let campaign = ["campaign", "logs", "--time-limit", "none"];
    let (code, text) = run(dir, &[&campaign[..], &["--out", "campaign"]].concat());
    assert_eq!(code, Some(0), "{text}");
    assert!(
        text.contains("3 runs on 1 day(s), 2 of them without a day"),
        "{text}"
    );
    let table = std::fs::read_to_string(dir.join("campaign/runs.jsonl")).unwrap();
    let rows: Vec<serde_json::Value> = table
        .lines()
        .map(|l| serde_json::from_str(l).unwrap())
        .collect();
    for row in rows.iter().filter(|r| r["kind"] == "run") {
        let is_right = row["log"] == "right.mcap";
        assert_eq!(row["date"] == "2024-05-04", is_right, "{row}");
        assert_eq!(row.get("start_ns").is_some(), is_right, "{row}");
    }
    let group = rows.iter().find(|r| r["kind"] == "group").unwrap();
    assert_eq!(
        group["runs"], 3,
        "without a change they are of one body, whenever they were"
    );
}

/// It wrapped around to 1970 and was written without a word.
#[test]
fn a_simulation_that_begins_beyond_2554_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let words = [
        "simulate",
        "--motion-only",
        "--rig",
        "lshpi",
        "--plan",
        "surge-4n",
        "--out",
        "late.mcap",
        "--start",
    ];
    for start in [
        "2554-07-21T23:34:20Z",
        "2555-01-01T00:00:00Z",
        "9999-12-31T23:59:59Z",
    ] {
        let (code, text) = run(dir, &[&words[..], &[start]].concat());
        assert_eq!(code, Some(2), "{text}");
        assert!(text.contains("64 bits"), "{text}");
        assert!(!dir.join("late.mcap").exists());
    }
}
