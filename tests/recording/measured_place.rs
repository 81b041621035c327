//! A plan begins from where the vehicle is measured: beside its start, where the plan would leave the limits, it does not.

use crate::record_command::{moved, recorded_at};
use hydroline::clock::SystemClock;
use hydroline::log::Record;
use hydroline::record::Job;
use hydroline::shutdown::StopReason;
use hydroline_plan::preflight::preflight;
use hydroline_rigs::{Plan, Rig};
use std::sync::Arc;
use std::time::Duration;

/// To starboard with 8 N for a second, where the limit lies 4 cm beyond where that gets to from the rig's start; nobody watches.
fn aside() -> Job {
    let rig = Rig::builtin("lshpi").unwrap();
    let text = "name = \"aside\"\n[[step]]\nfor_s = 1.0\nwrench = { sway_n = 8.0 }\n";
    let plan = Plan::from_toml(text, "aside.toml").unwrap();
    let reach_m = preflight(&rig, &plan).unwrap().ranges[1].max;
    let mut job = crate::support::job(&rig, Some(plan), 1.8);
    job.rig.limits.y_m[1] = reach_m + 0.04;
    job.unattended = true;
    job
}

/// The recording of a vehicle that lies `by_m` along x and y from the job's start.
fn recorded(job: &Job, by_m: [f64; 2]) -> (StopReason, Vec<Record>) {
    let dir = tempfile::tempdir().unwrap();
    let mut pose = job.rig.tank.start_pose;
    pose[0] += by_m[0];
    pose[1] += by_m[1];
    recorded_at(dir.path(), pose, job, Arc::new(SystemClock))
}

/// Whether an event on the vehicle's place says this.
fn said(records: &[Record], words: &str) -> bool {
    let says = |r: &Record| matches!(r, Record::Event(e) if e.kind == "plan.place" && e.message.contains(words));
    records.iter().any(says)
}

#[test]
fn a_vehicle_beside_its_start_is_not_driven_beyond_a_limit() {
    let _alone = crate::support::alone();
    let (stop, records) = recorded(&aside(), [0.0, 0.08]);
    let StopReason::PlanAborted(words) = stop else {
        unreachable!("{stop:?}")
    };
    for part in [
        "does not begin",
        "is measured at x -0.",
        "y against [limits]",
    ] {
        assert!(words.contains(part), "no '{part}' in: {words}");
    }
    assert!(said(&records, "does not begin"));
    assert!(!moved(&records), "nothing but neutral was sent");
}

#[test]
fn a_vehicle_at_its_start_is_driven() {
    let _alone = crate::support::alone();
    let (stop, records) = recorded(&aside(), [0.0, 0.0]);
    assert!(moved(&records), "{stop:?}");
    assert!(said(&records, "at the start of plan 'aside'"));
}

#[test]
fn a_vehicle_that_no_pose_shows_is_driven_only_where_somebody_watches() {
    let _alone = crate::support::alone();
    let mut job = aside();
    job.ready_within = Duration::from_secs(2);
    // Behind the target, over the bare floor.
    let behind = [-0.5, 0.0];
    let (stop, records) = recorded(&job, behind);
    assert!(
        matches!(&stop, StopReason::PlanAborted(words) if words.contains("no pose shows")),
        "{stop:?}"
    );
    assert!(!moved(&records), "nothing but neutral was sent");
    job.unattended = false;
    let (stop, records) = recorded(&job, behind);
    assert!(moved(&records), "{stop:?}");
    assert!(said(&records, "no pose shows"));
}
