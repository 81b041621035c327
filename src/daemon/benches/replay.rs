//! Full replay of a logged surge run: decode, extract, map, joint pose, write; frames per second on two threads.
//! `cargo bench -p hydroline-daemon --bench replay` (renders its own log first). Asked (issue 4, must show 6): >= 100 frames/s on two cores.
#![allow(clippy::unwrap_used)]

use hydroline_calib::IdealMap;
use hydroline_daemon::replay::{Options, replay};
use hydroline_daemon::simulate;
use hydroline_pose::run::PoseRun;
use hydroline_rigs::{Plan, Rig};
use std::sync::Arc;
use std::time::Instant;

const REPETITIONS: usize = 5;

fn main() {
    rayon::ThreadPoolBuilder::new()
        .num_threads(2)
        .build_global()
        .unwrap();
    let rig = Rig::builtin("lshpi").unwrap();
    let plan = Plan::load_or_builtin("surge-4n").unwrap();
    let dir = tempfile::tempdir().unwrap();
    let log = dir.path().join("run.mcap");
    let none = simulate::Options::default();
    simulate::simulate(&rig, &plan, &log, &none, &mut |_, _| {}).unwrap();
    let map = Arc::new(IdealMap::of(&rig));
    let options = Options {
        map: Some(map.clone()),
        poses: Some(PoseRun::new(&rig, map)),
        ..Options::default()
    };
    let mut best = 0.0f64;
    for k in 0..REPETITIONS {
        let out = dir.path().join(format!("again-{k}.mcap"));
        let from = Instant::now();
        let (report, _) = replay(&log, &out, &options, &mut |_| {}).unwrap();
        let rate = report.frames as f64 / from.elapsed().as_secs_f64();
        best = best.max(rate);
        println!(
            "{} frames, {} poses: {rate:.0} frames/s on two threads",
            report.frames, report.poses
        );
    }
    println!("best of {REPETITIONS}: {best:.0} frames/s, asked 100");
}
