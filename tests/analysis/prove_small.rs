//! A fixed handful of sealed cases; the full set is `hydroline prove --cases 460`.

#![allow(clippy::unwrap_used)] // a test

use hydroline::diagnose::verdict::Word;
use hydroline::prove::case::parse;
use hydroline::prove::coupled;
use hydroline::prove::score::complaint;
use hydroline::prove::{Category, How, Judged, run};

fn judged(seed: u64, ids: &[&str]) -> Vec<Judged> {
    let ids: Vec<(Category, usize)> = ids.iter().map(|id| parse(id).unwrap()).collect();
    let all = run(seed, &ids, How::default(), None, &|_| {}).unwrap();
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

/// A drift that the log's clock records show is reported from them; one that only the motion shows
/// is named as an effect.
#[test]
fn a_clock_that_drifts_is_distinguished_from_the_records_or_else_from_the_motion() {
    let all = judged(1, &["fault-5", "fault-6"]);
    assert_eq!(passed(&all, "fault"), 2);
    assert!(
        all[0].verdict.as_ref().unwrap().effects.is_empty(),
        "{}",
        all[0].sentence
    );
    assert!(
        all[1]
            .verdict
            .as_ref()
            .unwrap()
            .data_faults
            .iter()
            .all(|f| f.fault != "clock_drift"),
        "{}",
        all[1].sentence
    );
}

/// The paper's two constant thrusts leave a set open, and the run proposed next splits it.
#[test]
fn what_the_papers_protocol_leaves_open_the_next_run_splits() {
    let all = judged(1, &["paper-0"]);
    assert_eq!(all[0].word, Word::Ambiguous, "{}", all[0].sentence);
    let set = |id: &str| all[0].equivalent.iter().any(|s| s.iter().any(|e| e == id));
    // A current would have to be so strong that it stands below a twentieth of the likeliest.
    for id in ["thruster_deadband", "constant_force", "coulomb_friction"] {
        assert!(set(id), "{id}: {:?}", all[0].equivalent);
    }
    assert_eq!(passed(&all, "paper_split"), 1, "{}", all[0].sentence);
}

/// Was asked for too: a limit that does nothing beside the true effect is distinguished from it, not "never fitted".
#[test]
fn a_rival_that_does_nothing_is_not_asked_for_in_the_papers_set() {
    let all = judged(1, &["paper-0"]);
    let paper = all[0].paper.as_ref().unwrap();
    let limit = |id: &String| id.as_str() == "thruster_saturation";
    assert!(
        !paper.lacking.iter().any(limit),
        "lacking {:?}",
        paper.lacking
    );
}

/// Surge, sway and yaw at once gave no verdict in ten minutes.
#[test]
fn coupled_cases_are_named_with_their_dof_and_nothing_is_none() {
    let judged = coupled::run(11, &[1, 2], None, &|_| {}).unwrap();
    for j in &judged {
        assert!(j.right, "{:?}", coupled::complaint(j));
        assert!(j.fits <= 300, "{}", j.fits);
    }
}

/// `cargo test --workspace --test analysis coupled -- --ignored --nocapture` shows the score.
#[test]
#[ignore = "six minutes of two processors: tests/nightly"]
fn twenty_four_coupled_cases() {
    let indices: Vec<usize> = (0..24).collect();
    let judged = coupled::run(12, &indices, None, &|j| {
        coupled::complaint(j).iter().for_each(|c| println!("{c}"));
    })
    .unwrap();
    println!("{}", coupled::words(&judged));
    let right = judged.iter().filter(|j| j.right).count();
    assert!(right >= 22, "{right} of 24");
}
