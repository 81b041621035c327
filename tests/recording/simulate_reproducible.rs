//! `simulate`: the same rig, plan and seed give the same bytes; another seed gives other images of the same motion.
#![allow(clippy::unwrap_used)]

use hydroline::log::{LogReader, Record};
use hydroline::simulate::{Options, simulate};
use hydroline_rigs::{Plan, Rig};
use std::path::Path;

const PLAN: &str = "[[step]]\nfor_s = 0.4\nwrench = { surge_n = 8.0 }\n";

fn run(out: &Path, seed: u64, motion_only: bool) -> Vec<u8> {
    let rig = Rig::builtin("lshpi").unwrap();
    let plan = Plan::from_toml(PLAN, "short.toml").unwrap();
    let options = Options {
        seed: Some(seed),
        motion_only,
        ..Options::default()
    };
    simulate(&rig, &plan, out, &options, &mut |_, _| {}).unwrap();
    std::fs::read(out).unwrap()
}

#[test]
fn same_seed_same_bytes_other_seed_other_images() {
    let dir = tempfile::tempdir().unwrap();
    for motion_only in [false, true] {
        let path = |n: &str| dir.path().join(format!("{n}-{motion_only}.mcap"));
        let first = run(&path("a"), 7, motion_only);
        assert_eq!(
            first,
            run(&path("b"), 7, motion_only),
            "motion_only = {motion_only}"
        );
        assert_ne!(
            first,
            run(&path("c"), 8, motion_only),
            "motion_only = {motion_only}"
        );
    }
}

#[test]
fn the_number_of_threads_changes_no_byte() {
    let dir = tempfile::tempdir().unwrap();
    let with_threads = |n: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(n)
            .build()
            .unwrap();
        pool.install(|| run(&dir.path().join(format!("{n}.mcap")), 3, false))
    };
    assert_eq!(with_threads(1), with_threads(4));
}

#[test]
fn a_motion_only_log_holds_commands_measured_motion_and_truth() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("motion.mcap");
    run(&path, 1, true);
    let (mut commands, mut motion, mut truth, mut frames) = (0, 0, 0, 0);
    for message in LogReader::open(&path).unwrap() {
        match message.unwrap().record {
            Record::Command(_) => commands += 1,
            Record::Motion(m) => {
                assert!(m.x_m.is_some() && m.u_mps.is_none() && m.covariance.len() == 36);
                motion += 1;
            }
            Record::Truth(_) => truth += 1,
            Record::Frame(_) => frames += 1,
            _ => {}
        }
    }
    assert_eq!((motion, truth, frames), (10, 10, 0));
    assert_eq!(commands % 8, 0);
    assert!(commands >= 80, "{commands}");
}

/// Effects within a frame change the pictures of a moving vehicle, and neither its motion nor what was commanded when.
#[test]
fn rolling_shutter_and_interlace_reach_the_images() {
    let dir = tempfile::tempdir().unwrap();
    let plan = Plan::from_toml(PLAN, "short.toml").unwrap();
    let with = |name: &str, physics: &str| {
        let text =
            std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("rigs/lshpi.toml"))
                .unwrap();
        let rig = Rig::from_toml(&format!("{text}\n{physics}"), "rig.toml", None).unwrap();
        let out = dir.path().join(format!("{name}.mcap"));
        simulate(&rig, &plan, &out, &Options::default(), &mut |_, _| {}).unwrap();
        let (mut images, mut rest, mut last_ns) = (Vec::new(), Vec::new(), 0);
        for message in LogReader::open(&out).unwrap() {
            let message = message.unwrap();
            assert!(message.log_ns >= last_ns);
            last_ns = message.log_ns;
            match message.record {
                Record::Frame(frame) => images.push(frame.data),
                Record::Command(c) => rest.push(format!("{c:?}")),
                Record::Truth(t) => rest.push(format!("{t:?}")),
                _ => {}
            }
        }
        (images, rest)
    };
    let plain = with("plain", "");
    for physics in [
        "[[physics]]\neffect = \"rolling_shutter\"\nrow_time_s = 3.5e-5\n",
        "[[physics]]\neffect = \"interlace\"\nfield_s = 0.02\n",
    ] {
        let changed = with(&physics[20..30], physics);
        assert_eq!(plain.1, changed.1, "{physics}");
        assert_eq!(plain.0.len(), changed.0.len());
        assert_ne!(plain.0.last(), changed.0.last(), "{physics}");
    }
}
