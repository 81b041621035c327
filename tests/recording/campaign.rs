//! `hydroline campaign`: groups, bad logs, nothing done twice, units of work one by one.

use crate::support::hydroline;
use std::collections::BTreeMap;
use std::path::Path;
use std::time::SystemTime;

fn run(dir: &Path, words: &[&str]) -> (Option<i32>, String) {
    let output = hydroline().current_dir(dir).args(words).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    (output.status.code(), text)
}

fn simulate(dir: &Path, rig: &str, plan: &str, seed: &str, start: &str, log: &str) {
    let (code, _) = run(
        dir,
        &[
            "simulate",
            "--motion-only",
            "--rig",
            rig,
            "--plan",
            plan,
            "--seed",
            seed,
            "--start",
            start,
            "--out",
            log,
        ],
    );
    assert_eq!(code, Some(0), "{log}");
}

/// Words of a campaign that no clock ends.
fn into<'a>(out: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let words = ["campaign", "logs", "--time-limit", "none", "--out", out];
    [&words[..], more].concat()
}

/// Sheets with their times of change.
fn sheets(dir: &Path) -> BTreeMap<String, SystemTime> {
    let entries = std::fs::read_dir(dir.join("campaign/store/sheets")).unwrap();
    entries
        .map(|e| {
            let e = e.unwrap();
            let name = e.file_name().to_string_lossy().into_owned();
            (name, e.metadata().unwrap().modified().unwrap())
        })
        .collect()
}

#[test]
fn two_vehicles_are_two_groups_a_bad_log_is_a_row_and_nothing_is_done_twice() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    std::fs::create_dir(dir.join("logs")).unwrap();
    let (_, rig) = run(dir, &["rig", "show", "lshpi"]);
    let other = rig.replacen("name = \"lshpi\"", "name = \"other\"", 1);
    std::fs::write(dir.join("other.toml"), other).unwrap();
    simulate(
        dir,
        "lshpi",
        "reversals",
        "1",
        "2026-05-04T09:00:00Z",
        "logs/a1.mcap",
    );
    simulate(
        dir,
        "other.toml",
        "reversals",
        "2",
        "2026-05-04T09:30:00Z",
        "logs/b1.mcap",
    );
    std::fs::write(dir.join("logs/bad.mcap"), b"no log at all").unwrap();
    let campaign = into("campaign", &[]);

    let (code, text) = run(dir, &campaign);
    assert_eq!(code, Some(3), "{text}");
    assert!(text.contains("cannot be used: bad.mcap"), "{text}");
    let table = std::fs::read_to_string(dir.join("campaign/runs.jsonl")).unwrap();
    let rows: Vec<serde_json::Value> = table
        .lines()
        .map(|l| serde_json::from_str(l).unwrap())
        .collect();
    let of = |kind: &str, column: &str| -> Vec<&str> {
        let own = rows.iter().filter(|r| r["kind"] == kind);
        own.map(|r| r[column].as_str().unwrap_or("")).collect()
    };
    assert_eq!(of("group", "vehicle"), ["lshpi", "other"]);
    assert_eq!(of("run", "log"), ["a1.mcap", "b1.mcap"]);
    assert_eq!(of("run", "verdict"), ["none", "none"]);
    assert_eq!(of("bad", "log"), ["bad.mcap"]);
    let page = std::fs::read_to_string(dir.join("campaign/campaign.html")).unwrap();
    assert!(page.contains("bad.mcap") && page.contains("b1.mcap"));

    // Again: the same table, and no sheet is written.
    let before = sheets(dir);
    assert_eq!(run(dir, &campaign).0, Some(3));
    assert_eq!(sheets(dir), before);
    assert_eq!(
        std::fs::read_to_string(dir.join("campaign/runs.jsonl")).unwrap(),
        table
    );

    // One more log costs its identity, its run with the motion to draw, its group.
    simulate(
        dir,
        "lshpi",
        "coast-down",
        "3",
        "2026-05-04T10:00:00Z",
        "logs/a2.mcap",
    );
    let list = |n: usize| {
        let (code, text) = run(dir, &into("campaign", &["--list"]));
        assert_eq!(code, Some(0));
        let units: Vec<String> = text.lines().map(str::to_owned).collect();
        assert_eq!(units.len(), n, "{text}");
        units
    };
    for kind in ["run-", "group-lshpi-"] {
        let unit = list(1).remove(0);
        assert!(unit.starts_with(kind), "{unit}");
        let (code, _) = run(dir, &into("campaign", &["--only", &unit]));
        assert_eq!(code, Some(0));
    }
    list(0);
    let after = sheets(dir);
    assert_eq!(after.len(), before.len() + 4);
    assert!(before.iter().all(|(name, at)| after[name] == *at));
}

/// Files of a campaign that another one of the same logs must leave too: sheets and tables, byte for byte.
fn left(out: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut left = BTreeMap::new();
    for entry in std::fs::read_dir(out.join("store/sheets")).unwrap() {
        let entry = entry.unwrap();
        let name = entry.file_name().to_string_lossy().into_owned();
        left.insert(name, std::fs::read(entry.path()).unwrap());
    }
    for name in ["runs.csv", "runs.jsonl"] {
        left.insert(name.to_owned(), std::fs::read(out.join(name)).unwrap());
    }
    left
}

#[test]
#[ignore = "some minutes: a campaign, and one that is killed ten times"]
fn a_campaign_killed_at_ten_random_moments_ends_with_the_same_sheets() {
    use rand::{RngExt, SeedableRng, rngs::StdRng};
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    std::fs::create_dir(dir.join("logs")).unwrap();
    for (k, plan) in ["reversals", "coast-down", "two-tone"].iter().enumerate() {
        for day in [4, 5] {
            let seed = (10 * day + k).to_string();
            let start = format!("2026-05-0{day}T0{k}:00:00Z");
            let log = format!("logs/{plan}-{day}.mcap");
            simulate(dir, "lshpi", plan, &seed, &start, &log);
        }
    }
    std::fs::write(dir.join("logs/bad.mcap"), b"no log at all").unwrap();
    let began = std::time::Instant::now();
    let whole = run(dir, &into("whole", &[]));
    let length = began.elapsed();
    assert_eq!(whole.0, Some(3));
    let mut rng = StdRng::seed_from_u64(7);
    let mut kills = 0;
    for _ in 0..10 {
        let mut child = hydroline()
            .current_dir(dir)
            .args(into("killed", &[]))
            .stdout(std::process::Stdio::null())
            .stderr(std::process::Stdio::null())
            .spawn()
            .unwrap();
        // Within the first third: what is done stays done, so that the last of the ten has work left too.
        std::thread::sleep(length.mul_f64(rng.random_range(0.0..0.3)));
        kills += u32::from(child.try_wait().unwrap().is_none());
        child.kill().unwrap();
        child.wait().unwrap();
    }
    let resumed = run(dir, &into("killed", &[]));
    assert_eq!(resumed.0, Some(3));
    println!("campaign of {length:.1?}, killed {kills} times at work");
    assert!(kills > 3, "killed too late");
    let (whole, killed) = (left(&dir.join("whole")), left(&dir.join("killed")));
    assert_eq!(
        whole.keys().collect::<Vec<_>>(),
        killed.keys().collect::<Vec<_>>()
    );
    for (name, bytes) in &whole {
        assert!(killed[name] == *bytes, "{name}");
    }
}

/// Surge, sway and yaw at once, so that single thrusters can be distinguished; the vehicle stays over its target.
const COUPLED: &str = r#"name = "coupled"
[[step]]
for_s = 6.0
wrench = { surge_n = 8.0 }
[[step]]
for_s = 8.0
wrench = { sway_n = 10.0, yaw_nm = 0.7 }
shape = "sine"
period_s = 4.0
phase_deg = 90
[[step]]
for_s = 6.0
wrench = { surge_n = -8.0 }
"#;
/// Share of its thrust that a fouled thruster gives.
const FOULED: f64 = 0.6;
/// Ballast \[kg\].
const BALLAST_KG: f64 = 2.0;

/// The rig with another name and mass.
fn vehicle(rig: &str, name: &str, added_kg: f64) -> String {
    let mut rig: toml::Table = rig.parse().unwrap();
    rig["rig"]["name"] = name.into();
    let mass_kg = rig["vehicle"]["mass_kg"].as_float().unwrap();
    rig["vehicle"]["mass_kg"] = (mass_kg + added_kg).into();
    rig.to_string()
}

/// The rig with a thruster that gives less.
fn fouled(rig: &str, thruster: &str) -> String {
    let mut rig: toml::Table = rig.parse().unwrap();
    let mut all = rig["thruster"].as_array_mut().unwrap().iter_mut();
    let one = all.find(|t| t["name"].as_str() == Some(thruster)).unwrap();
    for point in one["curve"].as_array_mut().unwrap() {
        point[1] = (FOULED * point[1].as_float().unwrap()).into();
    }
    rig.to_string()
}

/// 120 runs of two vehicles on three days, a ballast from the second day on, a fouled thruster of the other one on the third,
/// and five broken logs; `RUNS=N` for other numbers.
#[test]
#[ignore = "some minutes: 120 runs"]
fn ballast_and_a_fouled_thruster_are_found_and_dated_among_a_hundred_runs() {
    let runs: usize = std::env::var("RUNS").map_or(120, |n| n.parse().unwrap());
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    std::fs::create_dir(dir.join("logs")).unwrap();
    let write = |name: &str, text: &str| std::fs::write(dir.join(name), text).unwrap();
    let (_, rig) = run(dir, &["rig", "show", "lshpi"]);
    write("coupled.toml", COUPLED);
    write("one.toml", &vehicle(&rig, "one", 0.0));
    write("one-ballast.toml", &vehicle(&rig, "one", BALLAST_KG));
    write("other.toml", &vehicle(&rig, "other", 0.0));
    write(
        "other-fouled.toml",
        &fouled(&vehicle(&rig, "other", 0.0), "h_aft_port"),
    );
    for k in 0..runs {
        let (day, of_day) = (4 + 3 * k / runs, k % 60);
        let (rig, tank) = match (k % 2, day) {
            (0, 4) => ("one.toml", "one.toml"),
            (0, _) => ("one.toml", "one-ballast.toml"),
            (_, 6) => ("other.toml", "other-fouled.toml"),
            _ => ("other.toml", "other.toml"),
        };
        let plan = if k / 2 % 2 == 0 {
            "coupled.toml"
        } else {
            "reversals"
        };
        let (seed, log) = (k.to_string(), format!("logs/{k:03}.mcap"));
        let start = format!("2026-05-{day:02}T{:02}:{of_day:02}:00Z", 8 + k / 60);
        let words = "simulate --motion-only --rig";
        let words = words
            .split(' ')
            .chain([rig, "--tank", tank, "--plan", plan]);
        let words = words.chain(["--seed", &seed, "--start", &start, "--out", &log]);
        assert_eq!(run(dir, &words.collect::<Vec<_>>()).0, Some(0), "{log}");
    }
    // Five that are broken: the last one only in its middle, so that most of it can be read.
    let whole = std::fs::read(dir.join("logs/001.mcap")).unwrap();
    let mut flipped = whole.clone();
    let middle = flipped.len() / 2;
    flipped[middle..middle + 8].fill(0x5a);
    let broken: [(&str, &[u8]); 5] = [
        ("empty", b""),
        ("text", b"no log at all"),
        ("head", &whole[..200]),
        ("zeros", &[0; 4096]),
        ("middle", &flipped),
    ];
    for (name, bytes) in broken {
        std::fs::write(dir.join(format!("logs/{name}.mcap")), bytes).unwrap();
    }
    let began = std::time::Instant::now();
    let (code, text) = run(dir, &into("campaign", &[]));
    println!(
        "{text}{runs} runs in {:.0} s",
        began.elapsed().as_secs_f64()
    );
    assert_eq!(code, Some(3));
    let table = std::fs::read_to_string(dir.join("campaign/runs.jsonl")).unwrap();
    let rows = table.lines().map(|l| serde_json::from_str(l).unwrap());
    let rows: Vec<serde_json::Value> = rows.collect();
    let of = |kind: &'static str| rows.iter().filter(move |r| r["kind"] == kind);
    let bad: Vec<&str> = of("bad").map(|r| r["log"].as_str().unwrap()).collect();
    assert_eq!(bad, ["empty.mcap", "head.mcap", "text.mcap", "zeros.mcap"]);
    let unsound: Vec<&str> = (of("run").filter(|r| r["sound"] == false))
        .map(|r| r["log"].as_str().unwrap())
        .collect();
    assert_eq!(unsound, ["middle.mcap"]);
    assert_eq!(of("group").count(), 2);
    let change = |vehicle: &str, date: &str| {
        let mut all = of("change");
        all.find(|r| r["vehicle"] == vehicle && r["date"] == date)
            .unwrap()
    };
    let number = |row: &serde_json::Value, column: &str| row[column].as_f64().unwrap();
    for (vehicle, date) in [("one", "2026-05-06"), ("other", "2026-05-05")] {
        let same = number(change(vehicle, date), "same_probability");
        assert!(same > 0.95, "{vehicle} {date}: {same}");
    }
    for (vehicle, date, cause, value) in [
        ("one", "2026-05-05", "mass", BALLAST_KG),
        ("other", "2026-05-06", "thruster h_aft_port", FOULED),
    ] {
        let found = change(vehicle, date);
        assert_eq!(found["cause"], cause);
        assert!(number(found, "cause_probability") > 0.95);
        let off_sd = (number(found, "cause_value") - value) / number(found, "cause_sd");
        assert!(off_sd.abs() < 3.5, "{cause}: {off_sd} sd");
    }
}

#[test]
fn a_folder_that_holds_something_else_is_no_campaign() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    std::fs::create_dir_all(dir.join("logs")).unwrap();
    std::fs::create_dir_all(dir.join("precious")).unwrap();
    std::fs::write(dir.join("precious/thesis.tex"), "").unwrap();
    let output = hydroline()
        .current_dir(dir)
        .args(["campaign", "logs", "--out", "precious"])
        .output()
        .unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr.contains("thesis.tex"), "{stderr}");
    let (code, _) = run(dir, &["campaign", "logs", "--out", "new"]);
    assert_eq!(code, Some(2), "an empty folder holds no log");
    assert!(!dir.join("new/store").exists());
}
