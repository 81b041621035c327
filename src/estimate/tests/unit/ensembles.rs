//! Lines of the budget beside ensembles of simulated experiments in which one source at a time differs.

use super::QUICK;
use super::tank::{Noise, PLANS, Truth, runs, surge_effect};
use crate::{Options, identify};
use hydroline_core::run::{Joined, Run};
use hydroline_identify::Identification;
use hydroline_rigs::Rig;
use rand::{SeedableRng, rngs::StdRng};
use rand_distr::{Distribution, StandardNormal};
use std::collections::BTreeMap;

/// Draws of each source: the scatter is known to a twentieth.
const DRAWS: u64 = 200;
/// Share of the samples' sd below which a line is not compared: their noise moves as much.
const SMALL: f64 = 0.1;
/// Share of a line by which the scatter may differ from it.
const APART: f64 = 0.2;
/// Typical width of a deadband, as the effects' table has it \[N\].
const DEADBAND_N: f64 = 0.4;

fn with_budget() -> Options<'static> {
    Options {
        budget: true,
        ..QUICK
    }
}

/// How an error of one source, in its sds, makes the truth differ from what the rig file says.
type Off = fn(&mut Truth, f64);

/// The source that moves no coefficient: the fit takes a constant offset of a run into its start.
const OFFSET: &str = "offset that all poses of a run share";

/// Sources that make an experiment differ by as much as the rig file leaves open.
const SOURCES: [(&str, Off); 4] = [
    ("thrust scale", |t, z| t.thrust_share = 1.0 + 0.05 * z),
    ("mass", |t, z| t.vehicle.mass_kg *= 1.0 + 0.01 * z),
    ("length scale of the positions", |t, z| {
        t.length_share = 1.0 + 0.002 * z
    }),
    (OFFSET, |t, z| {
        t.shared_m = vec![1e-4 * z; 2];
    }),
];

/// One run, always with the same noise.
fn experiment(truth: &Truth) -> Vec<Run> {
    let mut rng = StdRng::seed_from_u64(3);
    runs(truth, &PLANS[..1], Noise::White, &mut rng)
}

/// What a line of the budget says of each coefficient.
fn line(of: &Identification, source: &str) -> BTreeMap<String, f64> {
    let line = of.budget.iter().find(|l| l.source == source).unwrap();
    line.contributions.clone()
}

/// Estimates of many draws, by coefficient.
#[derive(Default)]
struct Scatter(BTreeMap<String, Vec<f64>>);

impl Scatter {
    /// Adds what each coefficient of a fit is away from a value.
    fn add(&mut self, of: &Identification, from: &Identification) {
        for (key, p) in &of.parameters {
            let each = self.0.entry(key.clone()).or_default();
            each.push(p.value - from.value(key).unwrap());
        }
    }

    /// Root of the mean square of a coefficient: about the mean of all, or about none where that is `None`.
    fn rms(&self, key: &str, is_about_mean: bool) -> f64 {
        let all = &self.0[key];
        let mean = |v: &mut dyn Iterator<Item = f64>| v.sum::<f64>() / all.len() as f64;
        let centre = match is_about_mean {
            true => mean(&mut all.iter().copied()),
            false => 0.0,
        };
        mean(&mut all.iter().map(|v| (v - centre).powi(2))).sqrt()
    }
}

/// Fails where a line is not within [`APART`] of the scatter, of coefficients in which it is no small part, and where a line is
/// small and the scatter is not. Number of the coefficients in which it is no small part.
fn assert_line(
    source: &str,
    (found, said): (&Identification, &BTreeMap<String, f64>),
    scatter: impl Fn(&str) -> f64,
) -> usize {
    assert!(!said.is_empty(), "{source}: no line");
    let mut compared = 0;
    for (key, said) in said {
        let scatter = scatter(key);
        println!("{source} {key}: scatter {scatter:.4}, line {said:.4}");
        let small = SMALL * found.parameters[key].sd.unwrap();
        if *said < small {
            let most = (1.0 + APART) * small;
            assert!(scatter < most, "{source} {key}: small in the line only");
            continue;
        }
        assert!((scatter / said - 1.0).abs() < APART, "{source} {key}");
        compared += 1;
    }
    compared
}

fn standard_normal(seed: u64) -> f64 {
    StandardNormal.sample(&mut StdRng::seed_from_u64(seed))
}

#[test]
#[ignore = "800 experiments, minutes; run with --ignored"]
fn a_line_of_the_budget_is_the_scatter_that_its_source_makes() {
    let rig = Rig::builtin("lshpi").unwrap();
    let found = identify(&experiment(&Truth::of(&rig)), &rig, &with_budget()).unwrap();
    for (source, off) in SOURCES {
        let mut drawn = Scatter::default();
        for seed in 0..DRAWS {
            let mut truth = Truth::of(&rig);
            off(&mut truth, standard_normal(900 + seed));
            let one = identify(&experiment(&truth), &rig, &QUICK).unwrap();
            drawn.add(&one, &found);
        }
        let said = line(&found, source);
        let compared = assert_line(source, (&found, &said), |key| drawn.rms(key, true));
        assert_eq!(compared > 0, source != OFFSET, "{source}: {said:?}");
    }
}

/// The deadband is there with the probability that its line has: the mean square is that of the draws in which it is, times that.
#[test]
#[ignore = "200 experiments, minutes; run with --ignored"]
fn the_line_of_a_deadband_is_how_far_it_moves_the_estimates_where_it_is_there() {
    let rig = Rig::builtin("lshpi").unwrap();
    let source = "thruster_deadband";
    let found = identify(&experiment(&Truth::of(&rig)), &rig, &with_budget()).unwrap();
    let of_budget = found.budget.iter().find(|l| l.source == source).unwrap();
    let probability = of_budget.probability.unwrap();
    let mut drawn = Scatter::default();
    for seed in 0..DRAWS {
        let mut truth = Truth::of(&rig);
        let width_n = DEADBAND_N * standard_normal(900 + seed).abs();
        truth.effects = vec![surge_effect(source, "width_n", width_n)];
        let one = identify(&experiment(&truth), &rig, &QUICK).unwrap();
        drawn.add(&one, &found);
    }
    println!("{source}: probability {probability:.4}");
    let scatter = |key: &str| probability.sqrt() * drawn.rms(key, false);
    assert!(assert_line(source, (&found, &line(&found, source)), scatter) > 0);
}

/// A clock that is open costs what the estimates differ from those of the same samples under the right clock: of efficient estimates
/// the variance of the difference is the difference of the variances (Rao 1973, 5a.2).
#[test]
#[ignore = "400 experiments, minutes; run with --ignored"]
fn the_line_of_a_joined_clock_is_what_not_knowing_it_moves_the_estimates() {
    let rig = Rig::builtin("lshpi").unwrap();
    let source = "clocks of joined logs";
    let sd_s = 0.02;
    let mut drawn = Scatter::default();
    // What the runs say of a clock differs little from draw to draw; mean square of the lines.
    let mut square: BTreeMap<String, f64> = BTreeMap::new();
    let mut last = None;
    for seed in 0..DRAWS {
        let mut rng = StdRng::seed_from_u64(3000 + seed);
        let known = runs(&Truth::of(&rig), &PLANS[..1], Noise::White, &mut rng);
        let off_s = sd_s * standard_normal(900 + seed);
        let mut open = known.clone();
        for run in &mut open {
            run.commands.iter_mut().for_each(|c| c.t_s -= off_s);
            run.joined = Some(Joined {
                is_estimated: false,
                offset_sd_s: sd_s,
                drift_sd_ppm: 0.0,
            });
        }
        let known = identify(&known, &rig, &QUICK).unwrap();
        let open = identify(&open, &rig, &with_budget()).unwrap();
        drawn.add(&open, &known);
        for (key, said) in line(&open, source) {
            *square.entry(key).or_default() += said * said / DRAWS as f64;
        }
        last = Some(open);
    }
    let said = square.into_iter().map(|(key, v)| (key, v.sqrt())).collect();
    let found = last.unwrap();
    assert!(assert_line(source, (&found, &said), |key| drawn.rms(key, false)) > 0);
}
