//! What is known of the measurement's noise, and what a fit makes of it: samples weighed by the sd their log
//! says, noise measured at rest, false alarms and real misfits.
#![allow(clippy::unwrap_used)]

#[path = "support/experiment.rs"]
#[allow(dead_code)]
mod experiment;

use experiment::{
    TestNoise, WHITE, decoupled, inside, other_vehicle, quick, simulated, surge, surge_runs,
};
use hydroline::identify::data::{Run, Start};
use hydroline::identify::parameter::Coefficient;
use hydroline::identify::{Identification, ModelChoice, Options, identify};
use hydroline_rigs::{Dof, Rig, Vehicle};
use rand::{SeedableRng, rngs::StdRng};
use rand_distr::{Distribution, StandardNormal};

const COLOURED: TestNoise = TestNoise {
    coloured: 1.0,
    ..WHITE
};
const NONE: TestNoise = TestNoise {
    position_m: 0.0,
    attitude_rad: 0.0,
    ..WHITE
};

fn options(method: &hydroline::identify::lm::LevenbergMarquardt) -> Options<'_> {
    Options {
        method,
        cross_validate: false,
        ..Options::default()
    }
}

fn fit(runs: &[Run], rig: &Rig) -> Identification {
    identify(runs, rig, &options(&quick())).unwrap()
}

/// Two runs in which every other stamp has ten times the sd of the rest, which the log says, but for a
/// factor of 1.7 that it has all too small.
fn uneven_runs(truth: &Vehicle, seed: u64) -> Vec<Run> {
    let mut runs: Vec<Run> = surge_runs(truth, NONE, seed).drain(1..3).collect();
    let mut rng = StdRng::seed_from_u64(seed ^ 0x77);
    for run in &mut runs {
        for (k, sample) in run.samples.iter_mut().enumerate() {
            let worse = if k % 2 == 0 { 10.0 } else { 1.0 };
            let mut covariance = Box::new([0.0; 36]);
            for c in 0..6 {
                let sd = worse * if c < 3 { 1.5e-4 } else { 1.745e-4 };
                let noise: f64 = StandardNormal.sample(&mut rng);
                sample.values[c] += sd * noise;
                covariance[7 * c] = (sd / 1.7).powi(2);
            }
            sample.covariance = Some(covariance);
        }
    }
    runs
}

/// Experiments of [`uneven_runs`]: share of intervals that hold the truth, rms of errors over their sd, and the
/// mean sd of each coefficient with and without the logged sd.
fn weighed(experiments: u64, model: ModelChoice) -> (f64, f64, [f64; 2]) {
    let mut rig = decoupled();
    let quick = quick();
    let fixed = Dof::ALL[1..].iter().flat_map(|d| Coefficient::of(*d));
    let options = Options {
        model,
        // The five DOFs at rest tell nothing here and cost time.
        fixed: fixed.collect(),
        start: Start::AtRest,
        ..options(&quick)
    };
    rig.vehicle.model = hydroline_rigs::VehicleModel::Decoupled;
    let (mut hits, mut square, mut sds) = (0usize, 0.0, [0.0; 2]);
    for seed in 0..experiments {
        let mut truth = other_vehicle(&rig, seed);
        truth.coefficients[1..].copy_from_slice(&rig.vehicle.coefficients[1..]);
        let runs = uneven_runs(&truth, seed + 1);
        let found = identify(&runs, &rig, &options).unwrap();
        hits += inside(&found, &truth).values().filter(|hit| **hit).count();
        let mut blind = runs.clone();
        for sample in blind.iter_mut().flat_map(|r| &mut r.samples) {
            sample.covariance = None;
        }
        let unweighed = identify(&blind, &rig, &options).unwrap();
        for (key, p) in &found.parameters {
            let actual = Coefficient::find(key).unwrap().of_vehicle(&truth);
            let (sd, other) = (p.sd.unwrap(), unweighed.parameters[key].sd.unwrap());
            square += ((p.value - actual) / sd).powi(2);
            sds[0] += sd / actual.abs();
            sds[1] += other / actual.abs();
        }
        let logged = found.noise["x_m"].logged.unwrap();
        assert!((logged.scale / 1.7 - 1.0).abs() < 0.2, "{logged:?}");
    }
    let n = 3.0 * experiments as f64;
    (hits as f64 / n, (square / n).sqrt(), sds)
}

/// Prints and checks `experiments` of them: intervals hold the truth in 92 .. 98 %.
fn assert_weighed(experiments: u64) {
    let (share, ratio, [with, without]) = weighed(experiments, ModelChoice::Axis(Dof::Surge));
    println!(
        "{experiments} experiments: {:.1} % inside, errors over sd {ratio:.3}, sd {:.3} of the unweighed",
        100.0 * share,
        with / without
    );
    // Information of half the samples at 1 and half at 1/100 against all at the mean variance of 50.5: 0.20.
    assert!(with < 0.35 * without, "{with} {without}");
    assert!((0.92..=0.98).contains(&share), "{share}");
    // Three errors at a time belong together: 1 +- 3 / sqrt(2 n).
    let chance = 3.0 / (2.0 * experiments as f64).sqrt();
    assert!((ratio - 1.0).abs() <= chance, "{ratio}");
}

#[test]
fn samples_count_by_the_sd_their_log_says() {
    assert_weighed(120);
}

#[test]
#[ignore = "600 experiments fitted twice; run with --ignored"]
fn samples_count_by_the_sd_their_log_says_in_600_experiments() {
    assert_weighed(600);
}

#[test]
fn the_coupled_model_weighs_samples_too_where_some_have_no_sd() {
    // Whole covariances: whitened by them. One sample without: each channel by its own sd.
    let rig = decoupled();
    let mut truth = other_vehicle(&rig, 3);
    truth.coefficients[1..].copy_from_slice(&rig.vehicle.coefficients[1..]);
    let quick = quick();
    let fixed = Dof::ALL[1..].iter().flat_map(|d| Coefficient::of(*d));
    let options = Options {
        model: ModelChoice::Coupled,
        fixed: fixed.collect(),
        start: Start::AtRest,
        ..options(&quick)
    };
    let whole = uneven_runs(&truth, 4);
    let mut partly = whole.clone();
    partly[0].samples[7].covariance = None;
    let mut blind = whole.clone();
    for sample in blind.iter_mut().flat_map(|r| &mut r.samples) {
        sample.covariance = None;
    }
    let sd = |runs: &[Run]| {
        let found = identify(runs, &rig, &options).unwrap();
        for (key, p) in &found.parameters {
            let actual = Coefficient::find(key).unwrap().of_vehicle(&truth);
            assert!(
                (p.value - actual).abs() < 4.0 * p.sd.unwrap(),
                "{key}: {p:?} {actual}"
            );
        }
        (found.parameters["x_uu"].sd.unwrap(), found.notes.join("\n"))
    };
    let ((whole, _), (partly, notes), (blind, _)) = (sd(&whole), sd(&partly), sd(&blind));
    assert!(
        (partly / whole - 1.0).abs() < 0.1 && partly < 0.35 * blind,
        "{whole} {partly} {blind}"
    );
    assert!(
        notes.contains("1 of 1200 samples carry no covariance"),
        "{notes}"
    );
}

/// Runs of a vehicle with coloured noise, and one at rest of `still_s`.
fn with_rest(truth: &Vehicle, still_s: f64, seed: u64) -> Vec<Run> {
    let mut runs = surge_runs(truth, COLOURED, seed);
    runs.push(simulated(
        truth,
        "still",
        &[],
        still_s,
        COLOURED,
        7000 + seed,
    ));
    runs
}

/// Experiments without misfit that are called misfits, and their smallest p each.
fn false_alarms(experiments: u64, still_s: f64) -> (usize, Vec<f64>) {
    let rig = decoupled();
    let mut alarms = 0;
    let mut smallest = Vec::new();
    for seed in 0..experiments {
        let truth = other_vehicle(&rig, seed);
        let found = fit(&with_rest(&truth, still_s, seed + 1), &rig);
        assert_eq!(found.noise["x_m"].source, "measured at rest");
        if !found.misfit.is_empty() {
            println!("seed {seed}: {:?}", found.misfit);
            alarms += 1;
        }
        let p = found
            .residuals
            .iter()
            .filter_map(|r| Some(r.at_rest?.p_value));
        smallest.push(p.fold(1.0, f64::min));
    }
    (alarms, smallest)
}

#[test]
fn coloured_noise_measured_in_20_s_is_no_misfit() {
    let (alarms, smallest) = false_alarms(60, 20.5);
    // Four runs each: the smallest p of four is below 5 % in 18.5 % of experiments without misfit: 11.1 +- 3.0 of 60.
    let small = smallest.iter().filter(|p| **p < 0.05).count();
    println!("60 experiments: {alarms} alarms, {small} with a p below 5 %");
    // Nominal 1e-3 for whiteness and 1e-3 for the level per experiment: two of 60 by chance have 0.6 %.
    assert!(alarms <= 1, "{alarms} of 60");
    assert!(small <= 20, "{small} of 60");
}

#[test]
#[ignore = "500 experiments; run with --ignored"]
fn coloured_noise_measured_in_20_s_is_no_misfit_in_500_experiments() {
    let (alarms, smallest) = false_alarms(500, 20.5);
    let small = smallest.iter().filter(|p| **p < 0.05).count();
    println!("500 experiments: {alarms} alarms, {small} with a p below 5 %");
    // Nominal 2e-3: one of 500, and above four by chance in 0.4 %.
    assert!(alarms <= 4, "{alarms} of 500");
    // 18.5 % + 3 binomial sd.
    assert!(small <= 118, "{small} of 500");
}

#[test]
fn a_term_left_out_is_a_misfit_beside_coloured_noise_measured_at_rest() {
    let mut rig = decoupled();
    let truth = other_vehicle(&rig, 2);
    rig.vehicle.coefficients[0].quadratic = 0.0;
    let quick = quick();
    let concealed = Options {
        fixed: vec![Coefficient::find("x_uu").unwrap()],
        ..options(&quick)
    };
    for seed in 1..=10 {
        let found = identify(&with_rest(&truth, 20.5, seed), &rig, &concealed).unwrap();
        let words = found.misfit.join("\n");
        assert!(words.contains("far from white"), "seed {seed}: {words}");
    }
}

#[test]
fn a_run_that_begins_at_rest_measures_its_own_noise() {
    let rig = decoupled();
    let commands = [(25.0, surge(8.0)), (34.0, surge(-8.0)), (43.0, surge(4.0))];
    let run = simulated(&rig.vehicle, "late", &commands, 50.0, COLOURED, 3);
    let found = fit(std::slice::from_ref(&run), &rig);
    let slot = &found.noise["x_m"];
    assert_eq!(slot.source, "measured at rest");
    assert!(
        (slot.noise.total_sd() / 2.12e-4 - 1.0).abs() < 0.35,
        "{slot:?}"
    );
    assert!(
        found
            .notes
            .iter()
            .any(|n| n.contains("25 s before its first load")),
        "{:?}",
        found.notes
    );
    // Eight seconds measure no colour: the residuals do, and the result says so.
    let soon: Vec<(f64, [f64; 6])> = commands.iter().map(|(t, w)| (t - 17.0, *w)).collect();
    let run = simulated(&rig.vehicle, "soon", &soon, 33.0, COLOURED, 4);
    let found = fit(std::slice::from_ref(&run), &rig);
    assert_eq!(found.noise["x_m"].source, "residuals");
    assert!(
        found
            .notes
            .iter()
            .any(|n| n.contains("estimated from the residuals"))
    );
}

#[test]
fn what_is_held_at_a_zero_of_the_rig_is_not_taken_as_known() {
    let mut rig = decoupled();
    let truth = rig.vehicle.clone();
    rig.vehicle.coefficients[0].quadratic = 0.0;
    // So slow that the quadratic term cannot be told, but biases the linear one.
    let slow = [
        (0.0, surge(0.05)),
        (14.0, surge(-0.04)),
        (30.0, surge(0.02)),
    ];
    let run = simulated(&truth, "slow", &slow, 40.0, WHITE, 5);
    let found = fit(&[run], &rig);
    println!("{:#?} {:?}", found.parameters, found.notes);
    let held = found
        .notes
        .iter()
        .any(|n| n.starts_with("x_uu: the rig file knows no number"));
    if held {
        assert_eq!(found.value("x_uu"), Some(0.0));
    }
    for (key, p) in &found.parameters {
        let actual = Coefficient::find(key).unwrap().of_vehicle(&truth);
        assert!(
            p.low.unwrap() <= actual && actual <= p.high.unwrap(),
            "{key}: {p:?} {actual}"
        );
    }
    assert!(held, "{:?}", found.notes);
    assert!(!found.parameters["x_uu"].excited);
}

#[test]
fn weak_coefficients_of_a_coupled_fit_have_a_profile_and_strong_ones_need_none() {
    let rig = decoupled();
    let truth = rig.vehicle.clone();
    let push = |x: f64, n: f64| [x, 0.0, 0.0, 0.0, 0.0, n];
    // Surge well driven; yaw so gently that its quadratic term hardly shows.
    let commands = [
        (0.0, push(12.0, 0.08)),
        (7.0, push(-10.0, -0.08)),
        (14.0, push(5.0, 0.05)),
    ];
    let run = simulated(&truth, "gentle", &commands, 22.0, WHITE, 6);
    let quick = quick();
    let others = [Dof::Sway, Dof::Heave, Dof::Roll, Dof::Pitch];
    let options = Options {
        model: ModelChoice::Coupled,
        fixed: others.into_iter().flat_map(Coefficient::of).collect(),
        start: Start::AtRest,
        ..options(&quick)
    };
    let found = identify(&[run], &rig, &options).unwrap();
    assert_eq!(found.order.len(), 6);
    let (mut weak, mut strong) = (0, 0);
    for (i, key) in found.order.iter().enumerate() {
        let p = &found.parameters[key];
        let tied = (0..6).any(|j| j != i && found.correlation[i][j].abs() > 0.95);
        let held = found
            .notes
            .iter()
            .any(|n| n.starts_with(&format!("{key}: these runs")));
        println!("{key}: {p:?} tied {tied} held {held}");
        let is_weak = !held && (p.sd.unwrap() > 0.2 * p.value.abs() || tied);
        assert_eq!(p.profile.is_some(), is_weak, "{key}: {p:?}");
        weak += usize::from(is_weak);
        strong += usize::from(!is_weak);
        let actual = Coefficient::find(key).unwrap().of_vehicle(&truth);
        let (low, high) = (p.low.unwrap(), p.high.unwrap());
        // Three times the interval's half width about its middle: 6 sd.
        let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
        assert!(
            (actual - middle).abs() < 3.0 * half,
            "{key}: {p:?} {actual}"
        );
    }
    assert!(weak > 0 && strong > 0, "{weak} {strong}");
}
