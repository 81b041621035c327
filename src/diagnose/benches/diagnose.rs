//! Cost of a diagnosis: growth with the number of runs and of effects at work.

#![allow(clippy::unwrap_used)]

use hydroline_diagnose::{Source, diagnose};
use hydroline_identify::data::{Command, Run, Sample};
use hydroline_rigs::{ParameterValue, PhysicsEntry, Rig};
use hydroline_sim::model::{Model, ModelState};
use hydroline_sim::trajectory::Trajectory;

fn main() {
    divan::main();
}

/// 24 s at 25 Hz with reversals, 0.15 mm of noise.
fn run(rig: &Rig, k: usize) -> Run {
    let edges = [
        (0.0, 4.0 + 2.0 * k as f64),
        (8.0 + k as f64, -6.0),
        (16.0, 0.0),
    ];
    let mut path = Trajectory::new(
        Model::from_rig(rig).unwrap(),
        ModelState::at_rest([0.0; 6]),
        0.01,
    )
    .unwrap();
    let mut made = Run {
        name: format!("run{k}"),
        ..Run::default()
    };
    for (t_s, load) in edges {
        let wrench = [load, 0.0, 0.0, 0.0, 0.0, 0.0];
        path.command(t_s, wrench).unwrap();
        made.commands.push(Command { t_s, wrench });
    }
    for i in 0..600u32 {
        let t_s = 0.006 + 0.04 * f64::from(i);
        let mut values = [f64::NAN; 12];
        let shake = f64::from((i.wrapping_mul(2_654_435_761) >> 16) % 1001) / 1000.0 - 0.5;
        values[0] = path.state_at(t_s).unwrap().vehicle.eta[0] + 5e-4 * shake;
        made.samples.push(Sample {
            t_s,
            values,
            covariance: None,
        });
    }
    made
}

/// A rig with so many effects at work that the diagnosed one does not know of.
fn at_work(rig: &Rig, effects: usize) -> Rig {
    let all: [(&str, &[(&str, f64)]); 4] = [
        ("thruster_lag", &[("lag_s", 0.3)]),
        (
            "tether_spring",
            &[("stiffness_npm", 0.8), ("slack_m", 0.15)],
        ),
        ("coulomb_friction", &[("f_n", 0.05)]),
        ("command_latency", &[("delay_s", 0.02)]),
    ];
    let mut made = rig.clone();
    for (effect, numbers) in all.into_iter().take(effects) {
        let numbers = numbers
            .iter()
            .map(|(n, v)| ((*n).to_owned(), ParameterValue::Number(*v)));
        made.physics.push(PhysicsEntry {
            effect: effect.to_owned(),
            parameters: numbers.collect(),
        });
    }
    made
}

/// The whole diagnosis of one DOF, three runs and one held out, by number of effects at work.
#[divan::bench(args = [0, 1, 2, 4], sample_count = 1, sample_size = 1)]
fn diagnosis_by_effects_at_work(effects: usize) -> usize {
    let rig = Rig::builtin("lshpi").unwrap();
    let tank = at_work(&rig, effects);
    let sources: Vec<Source> = (0..4)
        .map(|k| Source {
            run: run(&tank, k),
            faults: Vec::new(),
        })
        .collect();
    let made = diagnose(&sources[..3], &sources[3..], &rig, &|_| {}).unwrap();
    made.verdict.sets_looked_at
}

/// The same with nothing at work, by number of runs.
#[divan::bench(args = [2, 4, 8], sample_count = 1, sample_size = 1)]
fn diagnosis_by_runs(runs: usize) -> usize {
    let rig = Rig::builtin("lshpi").unwrap();
    let sources: Vec<Source> = (0..runs)
        .map(|k| Source {
            run: run(&rig, k % 4),
            faults: Vec::new(),
        })
        .collect();
    let made = diagnose(&sources, &[], &rig, &|_| {}).unwrap();
    made.verdict.sets_looked_at
}
