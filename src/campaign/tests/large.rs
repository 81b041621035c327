//! Ten thousand runs: how long table and page take, how much memory, and the files for a browser and a database.
//!
//! `OUT=/tmp/large cargo test --release -p hydroline-campaign --test large -- --ignored --nocapture` leaves
//! `campaign.html`, `runs.csv` and `runs.jsonl` there; `tests/nightly campaign` opens them.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use hydroline_campaign::group::groups;
use hydroline_campaign::sheet::{Coefficients, Diagnosed, Number, RunSheet};
use hydroline_campaign::store::Store;
use hydroline_campaign::survey::{Found, Identity, RigToml};
use hydroline_campaign::table::Table;
use hydroline_campaign::unit::{Task, units};
use hydroline_campaign::work::Campaign;
use hydroline_diagnose::verdict::Word;
use hydroline_rigs::Rig;
use std::path::PathBuf;
use std::time::Instant;

/// Runs, unless `RUNS` says another number.
const RUNS: usize = 10_000;
const DAYS: usize = 50;
/// Peak memory of a campaign, whatever its size \[MB\].
const MEMORY_MB: u64 = 1000;

/// A log of one of two vehicles on one of the days.
fn found(k: usize, runs: usize, rigs: &[RigToml; 2]) -> Found {
    Found {
        name: format!("day-{:02}/run-{k:05}.mcap", k * DAYS / runs),
        path: PathBuf::from(format!("run-{k:05}.mcap")),
        hash: format!("{k:016x}"),
        is: Ok(Identity {
            vehicle: format!("vehicle-{}", k % 2),
            rig_toml: rigs[k % 2].clone(),
            calibration: String::new(),
            water: "fresh".to_owned(),
            start_ns: (20_000 + (k * DAYS / runs) as u64) * 86_400_000_000_000
                + k as u64 * 1_000_000_000,
            plan: "reversals".to_owned(),
            note: String::new(),
        }),
    }
}

/// A sheet as a six-DOF run gives it.
fn sheet(k: usize) -> RunSheet {
    let keys: Vec<&str> = hydroline_rigs::Dof::ALL
        .iter()
        .flat_map(|d| d.coefficient_names())
        .collect();
    let scatter = ((k * 7919) % 1000) as f64 / 1000.0 - 0.5;
    let number = |j: usize| {
        let value = -20.0 - j as f64 + scatter;
        Number {
            value,
            sd: Some(0.3),
            low: Some(value - 0.6),
            high: Some(value + 0.6),
            rig: -20.0,
        }
    };
    let channels = hydroline_core::run::Channel::ALL.map(|c| c.name());
    RunSheet {
        sound: true,
        findings: Vec::new(),
        frames_lost: 0,
        duration_s: 24.96,
        samples: 625,
        replayed: false,
        range: channels
            .iter()
            .map(|c| ((*c).to_owned(), [-1.0, 1.0]))
            .collect(),
        largest_load: [("surge".to_owned(), 8.0)].into(),
        identified: Ok(Coefficients {
            model: "eq1".to_owned(),
            numbers: keys
                .iter()
                .enumerate()
                .map(|(j, key)| ((*key).to_owned(), number(j)))
                .collect(),
            order: keys.iter().map(|k| (*k).to_owned()).collect(),
            covariance: vec![vec![1e-3; keys.len()]; keys.len()],
            variance_ratio: 1.0,
            noise_sd: channels.iter().map(|c| ((*c).to_owned(), 1.5e-4)).collect(),
            ..Coefficients::default()
        }),
        diagnosed: Ok(Diagnosed {
            verdict: Word::None,
            sentence: "Nothing that matters was left out: the model explains these runs."
                .to_owned(),
            effects: Vec::new(),
            predicted: channels
                .iter()
                .map(|c| ((*c).to_owned(), [Some(1e-3), Some(2e-4), Some(1.5e-4)]))
                .collect(),
            faults: Vec::new(),
            next_plan: String::new(),
            truncated: None,
        }),
    }
}

fn peak_mb() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|l| l.starts_with("VmHWM")).unwrap();
    line.split_whitespace()
        .nth(1)
        .unwrap()
        .parse::<u64>()
        .unwrap()
        / 1000
}

#[test]
#[ignore = "half a minute, 10,000 files"]
fn ten_thousand_runs() {
    let runs = std::env::var("RUNS").map_or(RUNS, |n| n.parse().unwrap());
    let scratch = tempfile::tempdir().unwrap();
    let out = std::env::var_os("OUT").map_or_else(|| scratch.path().to_owned(), PathBuf::from);
    std::fs::create_dir_all(&out).unwrap();
    let rig = Rig::builtin("lshpi").unwrap();
    let rigs = [0, 1].map(|k| {
        let mut rig = rig.clone();
        rig.name = format!("vehicle-{k}");
        RigToml::from(rig.to_toml())
    });
    let logs: Vec<Found> = (0..runs).map(|k| found(k, runs, &rigs)).collect();
    let groups = groups(&logs);
    assert_eq!(groups.len(), 2);
    let units = units(&logs, &groups, "test");
    let store = Store::open(scratch.path()).unwrap();
    for unit in &units {
        if let Task::Run { log } = unit.task {
            store.put(&unit.key, &sheet(log)).unwrap();
        }
    }
    let before_mb = peak_mb();
    let campaign = Campaign {
        logs: &logs,
        groups: &groups,
        units: &units,
        store: &store,
        replay: &|_, _| Ok(()),
        time_limit: None,
    };
    let began = Instant::now();
    let table = Table::write(&campaign, &out.join("runs.jsonl"), &out.join("runs.csv")).unwrap();
    let rows = table.rows().unwrap().map(Result::unwrap).count();
    let tables_s = began.elapsed().as_secs_f64();
    let began = Instant::now();
    let page = hydroline_campaign::page::page(&campaign, &table, "hydroline campaign");
    let page = page.unwrap().html();
    std::fs::write(out.join("campaign.html"), &page).unwrap();
    println!(
        "{} rows: tables {tables_s:.2} s, page {:.2} s, {:.1} MB of page, peak memory {} MB ({before_mb} before)",
        rows,
        began.elapsed().as_secs_f64(),
        page.len() as f64 / 1e6,
        peak_mb()
    );
    assert!(rows >= runs);
    assert!(peak_mb() < MEMORY_MB);
}
