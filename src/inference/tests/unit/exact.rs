//! The evidence of a fit against the integral itself: importance sampling about the mode, with the sizes and correlation
//! times of all random forces summed for every draw (Geweke 1989; Student's t, whose tails are heavier than the posterior's).
//! Against the Laplace approximation it asks for curvature, skewness and sizes that go with the numbers; a second mode far
//! away it does not see.

use hydroline_numerics::parallel;
use nalgebra::{Cholesky, DVector};
use rand::{SeedableRng, rngs::StdRng};
use rand_distr::{ChiSquared, Distribution, StandardNormal};

use crate::fit::{Fit, Problem};
use crate::hyper::{Cell, Cells, filters, ln_prior, ln_sum};
use crate::limit::Watch;
use crate::prior::PriorTable;
use crate::recording::Recording;
use crate::search::{Options, search};
use crate::tests::fixtures::{Tank, entry};
use hydroline_rigs::PhysicsEntry;

/// Degrees of freedom of the proposal, and by how much it is wider than the posterior.
const FREEDOM: f64 = 5.0;
const WIDER: f64 = 1.2;
/// Draws that an integral must be worth to be held against anything.
const THIN: f64 = 30.0;

/// Log evidence, and of how many draws it is worth.
fn integral(problem: &Problem, fit: &Fit, draws: usize, seed: u64) -> (f64, f64) {
    let prior = &problem.body.prior;
    let cells: Vec<Cell> = Cell::all().collect();
    let of = |d: usize| {
        let each = cells.iter().map(|cell| {
            let own = filters(&problem.body, &problem.worth, &problem.noises, d, *cell);
            (ln_prior(*cell, prior), own)
        });
        (d, each.collect::<Vec<_>>())
    };
    let all: Vec<_> = problem.body.dofs.iter().map(|d| of(*d)).collect();
    let used = problem.noises.used.iter().flatten().flatten();
    let used = used.filter(|u| **u).count() as f64;
    let number_prior = problem.number_prior(&fit.terms);
    let bounds = problem.body.bounds(&fit.terms);
    let none = Cells::of(fit.cells.misfit);
    let ln_posterior = |point: &[f64]| -> f64 {
        if point
            .iter()
            .zip(&bounds)
            .any(|(v, (low, high))| v < low || v > high)
        {
            return f64::NEG_INFINITY;
        }
        let values = problem.predicted(&fit.terms, point);
        let mut sum = number_prior.ln(point, &none) - 0.5 * used * std::f64::consts::TAU.ln();
        for (d, cells) in &all {
            let each: Vec<f64> = cells
                .iter()
                .map(|(ln_p, filters)| {
                    let cost = values.iter().zip(filters).enumerate().map(|(run, (v, f))| {
                        let white = problem.white_residual(run, *d, v, f);
                        0.5 * (white.iter().flatten().map(|w| w * w).sum::<f64>() + f.ln_variance)
                    });
                    ln_p - cost.sum::<f64>()
                })
                .collect();
            sum += ln_sum(&each);
        }
        if sum.is_nan() { f64::NEG_INFINITY } else { sum }
    };
    let n = fit.point.len();
    let root = Cholesky::new(fit.covariance.clone() * (WIDER * WIDER))
        .unwrap()
        .l();
    let ln_root: f64 = root.diagonal().iter().map(|v| v.ln()).sum();
    let gamma = |x: f64| statrs::function::gamma::ln_gamma(x);
    let constant = gamma(0.5 * (FREEDOM + n as f64))
        - gamma(0.5 * FREEDOM)
        - 0.5 * n as f64 * (FREEDOM * std::f64::consts::PI).ln()
        - ln_root;
    let mut rng = StdRng::seed_from_u64(seed);
    let chi = ChiSquared::new(FREEDOM).unwrap();
    let points: Vec<(Vec<f64>, f64)> = (0..draws)
        .map(|_| {
            let z = DVector::from_fn(n, |_, _| StandardNormal.sample(&mut rng));
            let t: DVector<f64> = z * (FREEDOM / chi.sample(&mut rng)).sqrt();
            let ln_q =
                constant - 0.5 * (FREEDOM + n as f64) * (1.0 + t.norm_squared() / FREEDOM).ln();
            let moved = &root * &t;
            let point = fit
                .point
                .iter()
                .zip(moved.iter())
                .map(|(a, b)| a + b)
                .collect();
            (point, ln_q)
        })
        .collect();
    let weights = parallel::map_slice(&points, |(point, ln_q)| ln_posterior(point) - ln_q);
    let squares: Vec<f64> = weights.iter().map(|w| 2.0 * w).collect();
    let (one, two) = (ln_sum(&weights), ln_sum(&squares));
    (one - (draws as f64).ln(), (2.0 * one - two).exp())
}

fn cases() -> Vec<(&'static str, Vec<usize>, Vec<PhysicsEntry>)> {
    let lag = |dof: &str| entry("thruster_lag", &[("lag_s", 0.25)], &[("dof", dof)]);
    let force = entry("constant_force", &[("bias_n", 0.2)], &[("dof", "surge")]);
    let friction = entry("coulomb_friction", &[("f_n", 0.3)], &[("dof", "surge")]);
    let band = entry(
        "thruster_deadband",
        &[("width_n", 0.6)],
        &[("dof", "surge")],
    );
    let latency = entry("command_latency", &[("delay_s", 0.12)], &[]);
    let cross = entry(
        "cross_flow_coupling",
        &[("c", -8.0)],
        &[("dof", "yaw"), ("a", "u"), ("b", "r")],
    );
    vec![
        ("nothing", vec![0], vec![]),
        ("lag", vec![0], vec![lag("surge")]),
        ("lag and force", vec![0], vec![lag("surge"), force]),
        ("friction", vec![0], vec![friction.clone()]),
        ("deadband", vec![0], vec![band.clone()]),
        ("friction and deadband", vec![0], vec![friction, band]),
        ("latency", vec![0], vec![latency]),
        ("planar lag", vec![0, 1, 5], vec![lag("yaw")]),
        ("planar cross", vec![0, 1, 5], vec![cross]),
        ("planar nothing", vec![0, 1, 5], vec![]),
    ]
}

/// `SEEDS=2 DRAWS=600 cargo test -p hydroline-inference --lib exact -- --ignored --nocapture`: log Bayes factors of up to six
/// models a case, each against the likeliest.
#[test]
#[ignore = "a quarter of an hour of two processors"]
fn log_bayes_factors_are_those_of_the_integral() {
    let number = |name: &str, or: u64| {
        std::env::var(name)
            .ok()
            .and_then(|v| v.parse().ok())
            .unwrap_or(or)
    };
    let (seeds, draws) = (number("SEEDS", 2), number("DRAWS", 600) as usize);
    let (mut asked, mut near, mut thin) = (0, 0, 0);
    for seed in 0..seeds {
        for (name, driven, effects) in cases() {
            let tank = Tank {
                seconds: 16.0,
                hz: 12.5,
                ..Tank::new(&driven, effects)
            };
            let runs = tank.runs(3, 500 + seed);
            let dofs = Recording::new(&runs, 0.1).moving(&tank.rig.tolerance.channels());
            let problem = Problem::new(&runs, &tank.rig, &dofs, PriorTable::default()).unwrap();
            let found = search(problem, Options::default(), Watch::unlimited(&|_| {})).unwrap();
            let tables = |f: &&Fit| {
                f.terms
                    .iter()
                    .all(|t| !found.problem.body.candidates[*t].is_table())
            };
            let mut models: Vec<&Fit> = found.models.values().filter(tables).collect();
            models.sort_by(|a, b| b.ln_score.total_cmp(&a.ln_score));
            let each: Vec<(f64, f64, f64)> = models
                .iter()
                .take(6)
                .map(|fit| {
                    let (ln_z, worth) = integral(&found.problem, fit, draws, seed);
                    (fit.ln_evidence, ln_z, worth)
                })
                .collect();
            for (laplace, ln_z, worth) in &each[1..] {
                let off = (laplace - each[0].0) - (ln_z - each[0].1);
                // An integral of a few draws' worth is off by more than what is asked of it.
                let is_thin = worth.min(each[0].2) < THIN;
                thin += usize::from(is_thin);
                asked += usize::from(!is_thin);
                near += usize::from(!is_thin && off.abs() <= 1.0);
                println!(
                    "{name} {seed}: {:+.2} here, {:+.2} by the integral ({off:+.2}), worth {worth:.0} draws",
                    laplace - each[0].0,
                    ln_z - each[0].1
                );
            }
            println!(
                "{name} {seed}: likeliest {:+.2}, worth {:.0}",
                each[0].0 - each[0].1,
                each[0].2
            );
        }
    }
    println!(
        "{near} of {asked} within 1 nat; beside them {thin} whose integral is worth fewer than {THIN} draws"
    );
    assert!(asked >= 20, "{asked}");
    assert!(near * 10 >= asked * 9, "{near} of {asked}");
}
