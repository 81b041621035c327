//! Coverage of the intervals, Type A and expanded: how many of them hold the truth.
//!
//! Of the many cases each is kept where `COVERAGE_KEPT` names a folder: `COVERAGE_KEPT=kept COVERAGE_SEEDS=250..500 cargo test
//! -p hydroline-estimate coverage -- --ignored --nocapture`.

use super::kept::{cases, seeds};
use super::tank::{Noise, PLANS, Plan, Truth, runs, surge_effect};
use super::{QUICK, kept};
use crate::{Options, identify};
use hydroline_identify::Estimate;
use hydroline_identify::parameter::Coefficient;
use hydroline_rigs::Rig;
use rand::{SeedableRng, rngs::StdRng};
use rand_distr::{Distribution, StandardNormal};
use std::collections::BTreeMap;

/// Intervals that hold the truth, intervals, and sum of squares of errors over their sd.
#[derive(Debug, Default, Clone, Copy)]
struct Count {
    inside: usize,
    all: usize,
    square: f64,
}

impl Count {
    fn share(self) -> f64 {
        self.inside as f64 / self.all as f64
    }

    fn ratio(self) -> f64 {
        (self.square / self.all as f64).sqrt()
    }
}

/// By kind of noise and coefficient.
type Counts = BTreeMap<(Noise, String), Count>;

fn noise_of(seed: u64) -> Noise {
    Noise::ALL[seed as usize % Noise::ALL.len()]
}

/// Whether an interval holds the truth, and the error over its sd.
fn judged(p: &Estimate, actual: f64) -> Vec<f64> {
    let is_inside = p.low.unwrap() <= actual && actual <= p.high.unwrap();
    vec![
        f64::from(u8::from(is_inside)),
        (p.value - actual) / p.sd.unwrap(),
    ]
}

/// An experiment; the kind of noise changes with the seed.
fn experiment(rig: &Rig, seed: u64) -> kept::Found {
    let options = Options {
        from_rest: true,
        ..QUICK
    };
    let mut rng = StdRng::seed_from_u64(seed);
    let truth = Truth::drawn(rig, &mut rng);
    let runs = runs(&truth, &PLANS, noise_of(seed), &mut rng);
    let found = identify(&runs, rig, &options).unwrap();
    let actual = |key: &str| Coefficient::find(key).unwrap().of_vehicle(&truth.vehicle);
    let each = found.parameters.iter();
    each.map(|(key, p)| (key.clone(), judged(p, actual(key))))
        .collect()
}

/// Experiments of these seeds.
fn counted(seeds: std::ops::Range<u64>) -> Counts {
    let rig = Rig::builtin("lshpi").unwrap();
    let mut counts = Counts::new();
    for (seed, found) in cases("type-a", seeds, |seed| experiment(&rig, seed)) {
        for (key, numbers) in found {
            let count = counts.entry((noise_of(seed), key)).or_default();
            count.all += 1;
            count.inside += usize::from(numbers[0] > 0.5);
            count.square += numbers[1].powi(2);
        }
    }
    for (kind, count) in &counts {
        println!(
            "{kind:?}: {:.1} % of {} inside, errors over sd {:.3}",
            100.0 * count.share(),
            count.all,
            count.ratio()
        );
    }
    counts
}

fn pooled(counts: &Counts) -> Count {
    counts.values().fold(Count::default(), |sum, c| Count {
        inside: sum.inside + c.inside,
        all: sum.all + c.all,
        square: sum.square + c.square,
    })
}

/// They were too wide: errors of .65 sd where the noise is white, 99 to 100 % inside.
#[test]
fn intervals_are_as_wide_as_their_errors() {
    let all = pooled(&counted(0..10));
    // Three errors at a time belong together: 30 are worth some ten, whose rms scatters by .22.
    assert!((0.5..1.6).contains(&all.ratio()), "{all:?}");
}

#[test]
#[ignore = "500 experiments, minutes; run with --ignored"]
fn intervals_hold_the_truth_in_93_to_97_of_a_hundred() {
    let all = pooled(&counted(seeds(500)));
    println!("{all:?} {} {}", all.share(), all.ratio());
    assert!((0.93..=0.97).contains(&all.share()), "{all:?}");
}

/// A case in which thrust scale, mass, a deadband, the poses' offset and their scale are drawn from what the budget states of them;
/// `typical` = sd of the deadband's width over what is typical. Of each coefficient its error over U95.
fn over_u95(rig: &Rig, seed: u64, typical: f64) -> kept::Found {
    let with = Options {
        from_rest: true,
        budget: true,
        ..QUICK
    };
    let mut rng = StdRng::seed_from_u64(6400 + seed);
    let mut truth = Truth::drawn(rig, &mut rng);
    let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
    truth.thrust_share = 1.0 + 0.05 * normal();
    truth.vehicle.mass_kg *= 1.0 + 0.01 * normal();
    truth.length_share = 1.0 + 0.002 * normal();
    truth.shared_m = vec![1e-4 * normal(), 1e-4 * normal()];
    let width_n = 0.4 * typical * normal().abs();
    if width_n > 0.0 {
        truth.effects = vec![surge_effect("thruster_deadband", "width_n", width_n)];
    }
    let found = identify(&runs(&truth, &PLANS, Noise::White, &mut rng), rig, &with).unwrap();
    let actual = |key: &str| Coefficient::find(key).unwrap().of_vehicle(&truth.vehicle);
    let each = found.parameters.iter();
    each.map(|(key, p)| {
        let off = p.value - actual(key);
        (
            key.clone(),
            vec![off / p.u95.unwrap(), off / p.combined_sd.unwrap()],
        )
    })
    .collect()
}

/// Coefficients within U95 of the truth, and all.
fn within_u95(seeds: std::ops::Range<u64>, typical: f64) -> (usize, usize) {
    let rig = Rig::builtin("lshpi").unwrap();
    let name = format!("u95-deadband-{typical}");
    let found = cases(&name, seeds, |seed| over_u95(&rig, seed, typical));
    let mut by_key: BTreeMap<String, Count> = BTreeMap::new();
    for (key, numbers) in found.into_iter().flat_map(|f| f.1) {
        let count = by_key.entry(key).or_default();
        count.all += 1;
        count.inside += usize::from(numbers[0].abs() <= 1.0);
        count.square += numbers[1].powi(2);
    }
    for (key, count) in &by_key {
        println!(
            "deadband {typical} {key}: {:.1} % of {} within U95, errors over combined sd {:.3}",
            100.0 * count.share(),
            count.all,
            count.ratio()
        );
    }
    let of = |f: fn(&Count) -> usize| by_key.values().map(f).sum();
    (of(|c| c.inside), of(|c| c.all))
}

#[test]
#[ignore = "300 cases with and 300 without a deadband, minutes; run with --ignored"]
fn u95_holds_the_truth_in_92_to_99_of_a_hundred() {
    for typical in [0.0, 1.0] {
        let (inside, all) = within_u95(seeds(300), typical);
        let share = inside as f64 / all as f64;
        println!("deadband {typical}: {share}");
        assert!((0.92..=0.99).contains(&share), "{typical}: {share}");
    }
}

/// Six cases: all but three at the most.
#[test]
fn u95_holds_the_truth_in_a_few_cases() {
    let (inside, all) = within_u95(0..6, 0.0);
    assert!(inside + 3 >= all, "{inside} of {all}");
}

/// The worked case of the budget: thrust lags by .15 s and the thrusters have a deadband of .4 N, of which the rig says nothing.
#[test]
fn what_hides_in_the_added_mass_is_in_its_expanded_uncertainty() {
    let rig = Rig::builtin("lshpi").unwrap();
    let with = Options {
        from_rest: true,
        budget: true,
        ..QUICK
    };
    let mut truth = Truth::of(&rig);
    truth.effects = vec![
        surge_effect("thruster_lag", "lag_s", 0.15),
        surge_effect("thruster_deadband", "width_n", 0.4),
    ];
    let plans: [Plan; 2] = [PLANS[0], &[(0.0, 8.0), (12.0, 0.0)]];
    let mut rng = StdRng::seed_from_u64(64);
    let found = identify(&runs(&truth, &plans, Noise::White, &mut rng), &rig, &with).unwrap();
    for line in &found.budget {
        println!(
            "{} {:?} {:?}",
            line.source, line.probability, line.contributions
        );
    }
    let p = &found.parameters["x_udot"];
    println!("{p:?} {:?}", found.misfit);
    let off = p.value - rig.vehicle.coefficients[0].added;
    assert!(off.abs() < p.u95.unwrap(), "{p:?}");
}
