//! `record --until-decided` on tanks with hidden physics, against a fixed list of plans.
#![allow(clippy::unwrap_used)]

use std::collections::BTreeSet;

use hydroline_core::run::{Channel, Command, PerChannel, Run, Sample};
use hydroline_diagnose::until::{Options, Series, Step};
use hydroline_diagnose::verdict::Effect;
use hydroline_diagnose::{Diagnosis, Source, Watch};
use hydroline_plan::setpoint::setpoint;
use hydroline_rigs::{Dof, ParameterValue, PhysicsEntry, Plan, Rig};
use hydroline_sim::model::{Model, ModelState};
use hydroline_sim::trajectory::Trajectory;
use rand::{RngExt, SeedableRng, rngs::StdRng};
use rand_distr::{Distribution, StandardNormal};

/// Hidden in surge: (effect, number, size, has it a `dof`). Each pair of neighbours is mistaken for each other
/// (theory/identifiability.md, confusable effects).
const HIDDEN: [(&str, &str, f64, bool); 6] = [
    ("thruster_lag", "lag_s", 0.35, true),
    ("command_latency", "delay_s", 0.15, false),
    ("thruster_deadband", "width_n", 0.6, true),
    ("coulomb_friction", "f_n", 0.3, true),
    ("constant_force", "bias_n", 0.35, true),
    ("thrust_asymmetry", "reverse_gain", 0.78, true),
];
/// Stamps per second, and what is recorded behind a plan \[s\].
const RATE_HZ: f64 = 25.0;
const BEHIND_S: f64 = 1.0;
/// Noise of a pose: white and as much correlated over half a second \[m, rad\].
const NOISE: [f64; 2] = [1.5e-4, 1.7e-4];
const COLOUR_S: f64 = 0.5;
/// Plans that are run one after the other where nothing is chosen.
const FIXED: [&str; 4] = ["surge-8n", "reversals", "coast-down", "two-tone"];
const RUNS: usize = 8;
/// Probability from which an effect counts as found: that from which a verdict is decided.
const ESTABLISHED: f64 = 0.95;

struct Tank {
    rig: Rig,
    truth: Rig,
    hidden: BTreeSet<String>,
    seed: u64,
}

impl Tank {
    fn new(seed: u64) -> Tank {
        let mut rng = StdRng::seed_from_u64(seed);
        let rig = Rig::builtin("lshpi").unwrap();
        let mut truth = rig.clone();
        for c in &mut truth.vehicle.coefficients {
            c.added *= 0.85 + 0.3 * rng.random::<f64>();
            c.linear *= 0.85 + 0.3 * rng.random::<f64>();
            c.quadratic *= 0.85 + 0.3 * rng.random::<f64>();
        }
        // None, one, two that look alike, in turn.
        let pair = 2 * rng.random_range(0..HIDDEN.len() / 2);
        let which: Vec<usize> = match seed % 3 {
            0 => vec![],
            1 => vec![pair + rng.random_range(0..2)],
            _ => vec![pair, pair + 1],
        };
        for i in &which {
            let (effect, name, size, dof) = HIDDEN[*i];
            let size = size * (0.9 + 0.2 * rng.random::<f64>());
            let mut parameters = vec![(name.to_owned(), ParameterValue::Number(size))];
            if dof {
                parameters.push(("dof".to_owned(), ParameterValue::Word("surge".to_owned())));
            }
            truth.physics.push(PhysicsEntry {
                effect: effect.to_owned(),
                parameters: parameters.into_iter().collect(),
            });
        }
        Tank {
            rig,
            truth,
            hidden: which.iter().map(|i| HIDDEN[*i].0.to_owned()).collect(),
            seed,
        }
    }

    fn run(&self, plan: &Plan, k: usize) -> Source {
        let mut rng = StdRng::seed_from_u64(self.seed.wrapping_mul(101).wrapping_add(k as u64));
        let allocation = hydroline_sim::Allocation::new(&self.rig.thrusters).unwrap();
        let model = Model::from_rig(&self.truth).unwrap();
        let start = self.truth.tank.start_pose;
        let mut path = Trajectory::new(model, ModelState::at_rest(start), 0.005).unwrap();
        let end_s = plan.duration_s() + BEHIND_S;
        let mut made = Run {
            name: format!("run{k}-{}", plan.name),
            start_ns: 1_000_000_000_000 * (k as u64 + 1),
            ..Run::default()
        };
        for n in 0..(end_s * RATE_HZ) as u32 {
            let t_s = f64::from(n) / RATE_HZ;
            let thrust = setpoint(&self.rig, &allocation, plan, t_s)
                .unwrap()
                .thrust_n;
            let wrench = allocation.wrench(&thrust).unwrap().to_array();
            if made.commands.last().is_none_or(|c| c.wrench != wrench) {
                path.command(t_s, wrench).unwrap();
                made.commands.push(Command { t_s, wrench });
            }
        }
        let mut colour = [0.0; 6];
        let decay = (-1.0 / (RATE_HZ * COLOUR_S)).exp();
        for n in 0..(end_s * RATE_HZ) as u32 {
            let t_s = 0.006 + f64::from(n) / RATE_HZ;
            let pose = path.state_at(t_s).unwrap().vehicle.eta;
            let mut values = PerChannel::NAN;
            for (c, channel) in Channel::POSES.into_iter().enumerate() {
                let sd = NOISE[usize::from(c > 2)];
                let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
                colour[c] = decay * colour[c] + sd * (1.0 - decay * decay).sqrt() * normal();
                values[channel] = pose[c] + sd * normal() + colour[c];
            }
            made.samples.push(Sample {
                t_s,
                values,
                covariance: None,
            });
        }
        Source {
            run: made,
            ..Source::default()
        }
    }
}

/// Effects that a verdict holds for there: those that matter, and all.
fn named(found: &Diagnosis) -> [BTreeSet<String>; 2] {
    let there = |e: &&Effect| e.probability >= ESTABLISHED;
    let all = found.verdict.effects.iter().filter(there);
    let heavy = all.clone().filter(|e| e.matters);
    [
        heavy.map(|e| e.effect.clone()).collect(),
        all.map(|e| e.effect.clone()).collect(),
    ]
}

/// Whether a verdict is right: all that is hidden is found, be it that it does not matter at the rig's tolerance, and nothing
/// matters that is not hidden.
fn is_right([matters, there]: &[BTreeSet<String>; 2], hidden: &BTreeSet<String>) -> bool {
    matters.is_subset(hidden) && hidden.is_subset(there)
}

fn series(tank: &Tank) -> Series<'_> {
    let options = Options {
        dofs: vec![Dof::Surge],
        ..Options::default()
    };
    Series::new(&tank.rig, options)
}

/// Runs made, and the verdict where it was decided.
fn until_decided(tank: &Tank) -> (usize, Option<Diagnosis>) {
    let series = series(tank);
    let mut sources = Vec::new();
    loop {
        let left = RUNS - sources.len();
        match series
            .step(&sources, left, Watch::unlimited(&|_| ()))
            .unwrap()
        {
            Step::Run(proposal) => {
                sources.push(tank.run(&proposal.offers[0].plan, sources.len()));
            }
            Step::Decided(found) => return (sources.len(), Some(*found)),
            Step::Undecided { why, .. } => {
                println!("    {why}");
                return (sources.len(), None);
            }
        }
    }
}

fn by_the_list(tank: &Tank) -> (usize, Option<Diagnosis>) {
    let series = series(tank);
    let mut sources = Vec::new();
    for k in 0..RUNS {
        let plan = Plan::builtin(FIXED[k % FIXED.len()]).unwrap();
        sources.push(tank.run(&plan, k));
        let left = RUNS - sources.len();
        if let Step::Decided(found) = series
            .step(&sources, left, Watch::unlimited(&|_| ()))
            .unwrap()
        {
            return (sources.len(), Some(*found));
        }
    }
    (RUNS, None)
}

/// `TANKS=30 cargo test --release -p hydroline-lab --test until_decided -- --ignored --nocapture`
#[test]
#[ignore = "a minute or two a tank"]
fn runs_until_it_is_decided_against_a_fixed_list() {
    let tanks: u64 = std::env::var("TANKS").map_or(6, |v| v.parse().unwrap());
    let first: u64 = std::env::var("SEED").map_or(40_000, |v| v.parse().unwrap());
    let (mut right, mut open, mut ours, mut lists) = (0, 0, Vec::new(), Vec::new());
    for seed in first..first + tanks {
        let tank = Tank::new(seed);
        let (runs, found) = until_decided(&tank);
        let (list_runs, by_list) = by_the_list(&tank);
        let said = found.as_ref().map(named);
        let list_said = by_list.as_ref().map(named);
        println!(
            "{seed}: {:?}: {runs} runs {said:?}; the list {list_runs} {list_said:?}",
            tank.hidden
        );
        match &said {
            None => open += 1,
            Some(said) if is_right(said, &tank.hidden) => right += 1,
            Some(_) => {}
        }
        ours.push(runs);
        lists.push(list_runs);
    }
    let median = |all: &mut Vec<usize>| {
        all.sort_unstable();
        all[all.len() / 2]
    };
    let (ours, lists) = (median(&mut ours), median(&mut lists));
    println!("{right} right, {open} undecided of {tanks}; median runs {ours}, of the list {lists}");
    assert!((right + open) as f64 >= 0.95 * tanks as f64);
    assert!(ours as f64 <= 0.7 * lists as f64, "{ours} {lists}");
}
