//! Plans for vehicles of different kinds.
#![allow(clippy::unwrap_used)]

use hydroline_design::{Admission, Judge, Options, Purpose, Set, design, reach};
use hydroline_numerics::parallel;
use hydroline_plan::preflight::preflight;
use hydroline_plan::size::scaled;
use hydroline_rigs::{Dof, Plan, PlanStep, Rig, Shape, StepLoad, Wrench};
use hydroline_sim::Allocation;
use nalgebra::{Cholesky, DMatrix};
use rand::{RngExt, SeedableRng, rngs::StdRng};

/// The paper's, a small ROV, a torpedo-shaped AUV.
fn rig(name: &str) -> Rig {
    let path = format!("{}/tests/rigs/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    match name {
        "lshpi" => Rig::builtin(name).unwrap(),
        _ => Rig::load(std::path::Path::new(&path)).unwrap(),
    }
}

const RIGS: [&str; 3] = ["lshpi", "small-rov", "torpedo"];

/// Effects that a tank's thrusters and water show as much alike.
const ALIKE: [&str; 5] = [
    "thruster_lag",
    "command_latency",
    "thruster_deadband",
    "current",
    "coulomb_friction",
];

/// Every plan runs on the rig, is as long as was asked, and adds to what is known.
fn check(rig: &Rig, options: &Options, set: &Set) {
    assert_eq!(set.plans.len(), options.plans);
    for p in &set.plans {
        let report = preflight(rig, &p.plan).unwrap();
        assert!(report.violations.is_empty(), "{:?}", report.violations);
        assert_eq!(report.least_edges, Some(2));
        assert!((p.plan.duration_s() - options.length_s).abs() < 1e-9);
        assert!(p.gain_nats > 0.0, "{}", p.gain_nats);
        let back = Plan::from_toml(&p.plan.source_toml, "p.toml").unwrap();
        assert_eq!(back.steps, p.plan.steps);
        for (alone, together) in p.sd_alone.iter().zip(&p.sd) {
            assert!(together <= &(alone * (1.0 + 1e-9)), "{together} {alone}");
        }
    }
}

/// Pairs of [`ALIKE`] that are not distinguished.
fn taken_for_each_other(set: &Set) -> Vec<String> {
    let asked = |name: &str| ALIKE.contains(&name.split(' ').next().unwrap_or(""));
    let pairs = set.separations.iter();
    let of = pairs.filter(|s| asked(&s.of) && asked(&s.from) && !s.discriminated());
    of.map(|s| format!("{} | {}: {:.2}", s.of, s.from, s.nats))
        .collect()
}

#[test]
fn plans_for_two_dofs_run_say_more_one_after_the_other_and_tell_alike_effects_apart() {
    let rig = rig("small-rov");
    let options = Options {
        purpose: Purpose::Diagnose,
        dofs: vec![Dof::Surge, Dof::Yaw],
        plans: 2,
        drawn: 6,
        length_s: 16.0,
        improved: 1,
        sweeps: 1,
        ..Options::default()
    };
    let set = design(&rig, &options, &|_| ()).unwrap();
    check(&rig, &options, &set);
    assert!(set.plans[0].gain_nats > set.plans[1].gain_nats);
    assert_eq!(taken_for_each_other(&set), Vec::<String>::new());
    assert!(set.reach[0] > 0.0 && set.reach[5] > 0.0);
    assert!([1, 2, 3, 4].iter().all(|d| set.reach[*d] == 0.0));
}

#[test]
fn a_dof_that_no_thruster_drives_is_said() {
    let rig = rig("torpedo");
    let options = Options {
        dofs: vec![Dof::Roll],
        ..Options::default()
    };
    let error = design(&rig, &options, &|_| ()).unwrap_err().to_string();
    assert!(error.contains("of roll"), "{error}");
}

/// A plan drawn by another rule than the design's: any number of steps of any length and load, at the largest share that runs.
fn random_plan(
    rng: &mut StdRng,
    admission: &Admission,
    reach: &[f64; 6],
    length_s: f64,
) -> Option<Plan> {
    let n = rng.random_range(3..=15);
    let mut cuts: Vec<f64> = (1..n).map(|_| length_s * rng.random::<f64>()).collect();
    cuts.extend([0.0, length_s]);
    cuts.sort_by(f64::total_cmp);
    let sizes: [f64; 6] = std::array::from_fn(|d| 1.5 * reach[d] * rng.random::<f64>());
    let steps = cuts.windows(2).filter(|c| c[1] - c[0] > 0.05).map(|c| {
        let load = std::array::from_fn(|d| sizes[d] * (2.0 * rng.random::<f64>() - 1.0));
        PlanStep {
            for_s: c[1] - c[0],
            load: StepLoad::Wrench(Wrench::from_array(load)),
            shape: Shape::Hold,
        }
    });
    let plan = Plan {
        name: "random".to_owned(),
        steps: steps.collect(),
        source_toml: String::new(),
    };
    // The largest of these shares that the rig runs, as the design's own plans must: what runs at one runs at smaller ones, but
    // for the deadband.
    let at = |k: i32| scaled(&plan, 0.9f64.powi(k));
    let (mut refused, mut runs) = (-1, 40);
    while runs - refused > 1 {
        let middle = (runs + refused) / 2;
        if admission.admits(&at(middle)) {
            runs = middle;
        } else {
            refused = middle;
        }
    }
    (runs < 40).then(|| at(runs))
}

/// Log determinant of the information about the coefficients, over their number.
fn per_number(information: &DMatrix<f64>, own: usize) -> f64 {
    let part = information.view((0, 0), (own, own)).into_owned();
    Cholesky::new(part).map_or(f64::NEG_INFINITY, |root| {
        let each = root.l_dirty().diagonal();
        2.0 * each.iter().map(|v| v.ln()).sum::<f64>() / own as f64
    })
}

/// `RANDOM=10000 RIG=lshpi cargo test --release -p hydroline-design --test rigs -- --ignored --nocapture`: five plans per rig,
/// their D-efficiency over the best of that many random ones, and what they distinguish.
#[test]
#[ignore = "minutes per rig"]
fn designs_of_three_rigs_against_random_plans() {
    let random: usize = std::env::var("RANDOM").map_or(200, |v| v.parse().unwrap());
    let only = std::env::var("RIG").ok();
    for name in RIGS
        .iter()
        .filter(|n| only.as_deref().is_none_or(|o| o == **n))
    {
        let rig = rig(name);
        let options = Options::default();
        let begin = std::time::Instant::now();
        let set = design(&rig, &options, &|_| ()).unwrap();
        let took_s = begin.elapsed().as_secs_f64();
        check(&rig, &options, &set);
        let allocation = Allocation::new(&rig.thrusters).unwrap();
        let admission = Admission::new(&rig, None);
        let reach = reach(&admission, &allocation, &[]);
        let dofs: Vec<usize> = (0..6).filter(|d| reach[*d] > 0.0).collect();
        let judge = Judge::new(&rig, &allocation, &dofs, &set.plans[0].plan, &options).unwrap();
        let own = set.own.len();
        let mut sum = DMatrix::zeros(own, own);
        let mut each = Vec::new();
        for p in &set.plans {
            let information = judge.information(&p.plan).unwrap();
            each.push(per_number(&information, own));
            sum += information;
        }
        let of_set = per_number(&(sum / set.plans.len() as f64), own);
        let drawn = parallel::map(random, |seed| {
            let mut rng = StdRng::seed_from_u64(0xd0e5 + seed as u64);
            let plan = random_plan(&mut rng, &admission, &reach, options.length_s)?;
            Some(per_number(&judge.information(&plan)?, own))
        });
        let drawn: Vec<f64> = drawn.into_iter().flatten().collect();
        let best = drawn.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let first = (each[0] - best).exp();
        let efficiency = (of_set - best).exp();
        let diagnosing = Options {
            purpose: Purpose::Diagnose,
            ..Options::default()
        };
        let other = design(&rig, &diagnosing, &|_| ()).unwrap();
        check(&rig, &diagnosing, &other);
        println!(
            "{name}: {own} numbers, {} random plans; D-efficiency of the first {first:.2}, of all five a run {efficiency:.2}; {took_s:.0} s",
            drawn.len()
        );
        println!(
            "  not distinguished: identify {:?}",
            taken_for_each_other(&set)
        );
        println!(
            "  not distinguished: diagnose {:?}",
            taken_for_each_other(&other)
        );
        assert!(efficiency >= 0.9, "{name}: {efficiency}");
        assert!(taken_for_each_other(&other).is_empty(), "{name}");
    }
}
