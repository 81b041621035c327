//! A fixed handful of sealed cases; the full set is `hydroline prove --cases 460`.

#![allow(clippy::unwrap_used)] // a test

use hydroline::prove::case::parse;
use hydroline::prove::score::complaint;
use hydroline::prove::{Category, Judged, run};

fn judged(seed: u64, ids: &[&str]) -> Vec<Judged> {
    let ids: Vec<(Category, usize)> = ids.iter().map(|id| parse(id).unwrap()).collect();
    let all = run(seed, &ids, false, &|_| {}).unwrap();
    for line in all.iter().filter_map(complaint) {
        println!("{line}");
    }
    all
}

fn passed(all: &[Judged], key: &str) -> usize {
    all.iter()
        .flat_map(|j| &j.passed)
        .filter(|p| p.0 == key && p.1)
        .count()
}

/// Units, swapped columns, a dead channel, repeated stamps and outliers are faults, not physics.
#[test]
fn faults_of_the_data_are_said_to_be_that() {
    let all = judged(1, &["fault-0", "fault-1", "fault-2", "fault-3", "fault-4"]);
    assert_eq!(passed(&all, "fault"), 5);
}
