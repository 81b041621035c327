//! lm, cmaes and ga side by side on the same objective, one thread each: must show 3 and 7.
//!
//! `cargo bench -p hydroline-lab --bench identify` prints a table and ends with 1 where a figure that is asked is missed. GA_REPEATS=1
//! shortens it: repetitions are independent and equally long, so ten take ten times that, by which times are compared.
//! The best of fewer than ten is not the objective that is asked to be reached: such a run ends with 1 too.

#![allow(clippy::expect_used)]

use std::process::ExitCode;
use std::time::Instant;

use hydroline_core::run::{Channel, Command, PerChannel, Run, Sample};
use hydroline_estimate::{Options, identify};
use hydroline_identify::parameter::Coefficient;
use hydroline_lab::search::axis::{Axis, Start};
use hydroline_lab::search::cmaes::Cmaes;
use hydroline_lab::search::forward::Forward;
use hydroline_lab::search::ga::Genetic;
use hydroline_lab::search::lm::LevenbergMarquardt;
use hydroline_lab::search::method::Method;
use hydroline_lab::search::problem::{Objective, Problem};
use hydroline_rigs::{Dof, Rig};
use rand::{SeedableRng, rngs::StdRng};
use rand_distr::{Distribution, Normal};

const NOISE_M: f64 = 3e-4;
/// Bounds to meet: least `ga` time over that of `lm` and of `cmaes`, most seconds for three parameters with their uncertainty.
const LM_TIMES: f64 = 3000.0;
const CMAES_TIMES: f64 = 300.0;
const UNCERTAINTY_S: f64 = 0.5;
/// Relative difference of objectives that is rounding of sums taken in another order.
const ROUNDING: f64 = 1e-9;
/// Search ranges of X_udot, X_u, X_u|u| (the paper's Table 9).
const TABLE9: [(f64, f64); 3] = [(-500.0, 0.0), (-100.0, 0.0), (-500.0, 0.0)];
/// The paper's repetitions of `ga`, of which the best counts.
const ASKED_REPEATS: usize = 10;
/// Takes of what is over in seconds, of which the middle one counts, as `ga`'s time is that of ten repetitions: the machine
/// may be busy with something else, and neither side is to be given its luckiest moment.
const TAKES: usize = 5;

/// The middle one.
fn median(mut times_s: Vec<f64>) -> f64 {
    times_s.sort_by(f64::total_cmp);
    times_s[times_s.len() / 2]
}

/// A surge run from rest at 25 Hz with white noise.
fn run(rig: &Rig, commands: Vec<Command>, length_s: f64, seed: u64) -> Run {
    let sample = |k: usize| Sample {
        t_s: 0.04 * k as f64,
        values: PerChannel::from_fn(|c| if c == Channel::X { 0.0 } else { f64::NAN }),
        covariance: None,
    };
    let mut run = Run {
        name: format!("run{seed}"),
        commands,
        samples: (0..(length_s / 0.04) as usize).map(sample).collect(),
        ..Run::default()
    };
    let axis = Axis::new(
        std::slice::from_ref(&run),
        &rig.vehicle,
        Dof::Surge,
        &[],
        Start::AtRestFromZero,
    );
    let mut truth = Vec::new();
    axis.values(0, &[], &mut truth)
        .expect("the rig's own motion");
    let normal = Normal::new(0.0, NOISE_M).expect("a standard deviation");
    let mut rng = StdRng::seed_from_u64(seed);
    for (sample, x) in run.samples.iter_mut().zip(truth) {
        sample.values[Channel::X] = x + normal.sample(&mut rng);
    }
    run
}

fn main() -> ExitCode {
    let mut missed: Vec<String> = Vec::new();
    let rig = Rig::builtin("lshpi").expect("built in");
    let constant = |x: f64| {
        vec![Command {
            t_s: 0.0,
            wrench: [x, 0.0, 0.0, 0.0, 0.0, 0.0],
        }]
    };
    // The paper's two runs, 1 m each, start known (section 3.6.3), ranges of Table 9.
    let runs = [
        run(&rig, constant(4.0), 15.42, 1),
        run(&rig, constant(8.0), 10.42, 2),
    ];
    let mut axis = Axis::new(
        &runs,
        &rig.vehicle,
        Dof::Surge,
        &Coefficient::of(Dof::Surge),
        Start::AtRestFromZero,
    );
    axis.set_ranges(&TABLE9);
    let problem = Problem::new(&axis, &[NOISE_M]);
    let repeats = match std::env::var("GA_REPEATS") {
        Err(_) => ASKED_REPEATS,
        Ok(typed) => match typed.parse() {
            Ok(count) if count > 0 => count,
            _ => {
                println!("GA_REPEATS={typed}: give a count of 1 or more");
                return ExitCode::FAILURE;
            }
        },
    };
    if repeats < ASKED_REPEATS {
        missed.push(format!(
            "ga's best of {repeats} is not its best of {ASKED_REPEATS}: whether objectives are reached is not shown"
        ));
    }
    let (lm, cmaes, ga) = (
        LevenbergMarquardt::default(),
        Cmaes::default(),
        Genetic {
            repeats,
            ..Genetic::default()
        },
    );
    for objective in [Objective::SumOfAbsolute, Objective::LeastSquares] {
        println!("{objective:?}");
        println!(
            "  {:<6}{:>22}{:>13}{:>12}   X_udot      X_u         X_u|u|     ga time / its time",
            "", "objective", "evaluations", "time [s]"
        );
        let mut rows = Vec::new();
        for method in [&lm as &dyn Method, &cmaes, &ga] {
            // ga takes minutes; the others are over before the clock is read well. Every take is the same search
            // (one seed), so their objectives are one.
            let takes = if method.name() == "ga" { 1 } else { TAKES };
            let (mut found, mut times_s) = (None, Vec::new());
            for _ in 0..takes {
                let start = Instant::now();
                found = Some(
                    method
                        .minimise(&problem, objective, 1)
                        .expect("a finite motion"),
                );
                times_s.push(start.elapsed().as_secs_f64());
            }
            rows.push((method.name(), found.expect("taken once"), median(times_s)));
        }
        let slowest = rows.last().map_or(1.0, |r| r.2) * ASKED_REPEATS as f64 / repeats as f64;
        for (name, found, time_s) in &rows {
            let p = &found.parameters;
            println!(
                "  {name:<6}{:>22.15e}{:>13}{time_s:>12.5}   {:<11.4} {:<11.5} {:<11.4} {:.0}",
                found.objective,
                found.evaluations,
                p[0],
                p[1],
                p[2],
                slowest / time_s
            );
        }
        let best = |name: &str| {
            rows.iter()
                .find(|r| r.0 == name)
                .map_or(f64::NAN, |r| r.1.objective)
        };
        println!(
            "  lm - ga {:+.3e}, cmaes - ga {:+.3e} (relative; not above 0 = no worse)",
            best("lm") / best("ga") - 1.0,
            best("cmaes") / best("ga") - 1.0
        );
        for (name, asked) in [("lm", LM_TIMES), ("cmaes", CMAES_TIMES)] {
            let time_s = rows.iter().find(|r| r.0 == name).map_or(f64::NAN, |r| r.2);
            let times = slowest / time_s;
            if times.is_nan() || times < asked {
                missed.push(format!(
                    "{objective:?}: {name} takes 1/{times:.0} of ga's time, asked 1/{asked:.0}"
                ));
            }
        }
        for name in ["lm", "cmaes"] {
            let worse = best(name) / best("ga") - 1.0;
            if worse.is_nan() || worse > ROUNDING {
                missed.push(format!(
                    "{objective:?}: {name}'s objective is {worse:.3e} above ga's best of {repeats}"
                ));
            }
        }
    }
    // Four runs of 24 s at 25 Hz, starts and velocities free, everything `identify` does.
    let step = |pairs: &[(f64, f64)]| {
        pairs
            .iter()
            .map(|(t_s, x)| Command {
                t_s: *t_s,
                wrench: [*x, 0.0, 0.0, 0.0, 0.0, 0.0],
            })
            .collect()
    };
    let four = [
        run(&rig, step(&[(0.0, 4.0), (14.0, 0.0)]), 24.0, 3),
        run(&rig, step(&[(0.0, 8.0), (9.0, -8.0), (18.0, 8.0)]), 24.0, 4),
        run(
            &rig,
            step(&[(0.0, 16.0), (5.0, -6.0), (12.0, 3.0)]),
            24.0,
            5,
        ),
        run(
            &rig,
            step(&[(0.0, 2.0), (3.0, 10.0), (6.0, -10.0), (12.0, 4.0)]),
            24.0,
            6,
        ),
    ];
    for (words, cross_validate, asked_s) in [
        (
            "identify, 4 runs x 24 s x 25 Hz, intervals, noise and cross-validation",
            true,
            f64::INFINITY,
        ),
        ("the same without cross-validation", false, UNCERTAINTY_S),
    ] {
        let (mut fits, mut times_s) = (0, Vec::new());
        for _ in 0..TAKES {
            let start = Instant::now();
            let found = identify(
                &four,
                &rig,
                &Options {
                    cross_validate,
                    ..Options::default()
                },
            )
            .expect("identified");
            fits = found.fits;
            times_s.push(start.elapsed().as_secs_f64());
        }
        let took_s = median(times_s);
        println!("{words}: {took_s:.3} s, {fits} fits");
        if took_s > asked_s {
            missed.push(format!("{words}: {took_s:.3} s, asked {asked_s} s"));
        }
    }
    for words in &missed {
        println!("MISSED: {words}");
    }
    if missed.is_empty() {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}
