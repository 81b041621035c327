//! Identification end to end: simulated experiments with known truth, logs made apart from the
//! project, a real tank test and a real linear drive.

#![allow(clippy::unwrap_used, clippy::panic)]

use std::collections::BTreeMap;

use crate::experiment::{
    TestNoise, WHITE, decoupled, inside, other_vehicle, quick, simulated, surge, surge_runs,
};
use crate::inputs::input;
use crate::support::{elements, read_markup};
use hydroline::estimate::{ModelChoice, Options, identify};
use hydroline::identify::Identification;
use hydroline::identify::data::load;
use hydroline::identify::parameter::Coefficient;
use hydroline::import::{self, Map, import, read};
use hydroline::run::{Channel, PerChannel, Run, Sample};
use hydroline_rigs::{Dof, Plan, Rig, StepLoad, Vehicle};
use hydroline_sim::model::{Model, ModelState};
use hydroline_sim::vehicle::Hydrodynamics;
use hydroline_sim::{EffectStack, Trajectory};
use rand::{SeedableRng, rngs::StdRng};
use rand_distr::{Distribution, StandardNormal};

/// Noise that intervals are tried with, and how long it was measured at rest \[s\]; 0 = not.
fn kinds() -> [(&'static str, TestNoise, f64); 3] {
    let coloured = TestNoise {
        coloured: 1.0,
        ..WHITE
    };
    let spoilt = TestNoise {
        outliers: 0.01,
        ..coloured
    };
    [
        ("white", WHITE, 0.0),
        ("coloured with outliers", spoilt, 0.0),
        ("coloured, measured at rest", coloured, 40.0),
    ]
}

/// Per coefficient: share of experiments whose 95 % interval holds the truth, and rms of the errors
/// over their sd, which tells intervals that are too wide as well.
fn coverage(experiments: u64, noise: TestNoise, still_s: f64) -> BTreeMap<String, (f64, f64)> {
    let rig = decoupled();
    let mut hits: BTreeMap<String, (f64, f64)> = BTreeMap::new();
    for seed in 0..experiments {
        let truth = other_vehicle(&rig, seed);
        let mut runs: Vec<Run> = surge_runs(&truth, noise, seed + 1).drain(1..3).collect();
        if still_s > 0.0 {
            runs.push(simulated(
                &truth,
                "still",
                &[],
                still_s,
                noise,
                90_000 + seed,
            ));
        }
        let found = identify(&runs, &rig, &quick()).unwrap();
        for (key, hit) in inside(&found, &truth) {
            let p = &found.parameters[&key];
            let error = p.value - Coefficient::find(&key).unwrap().of_vehicle(&truth);
            let entry = hits.entry(key).or_default();
            entry.0 += f64::from(u8::from(hit)) / experiments as f64;
            entry.1 += (error / p.sd.unwrap()).powi(2) / experiments as f64;
        }
    }
    hits.values_mut().for_each(|h| h.1 = h.1.sqrt());
    hits
}

#[test]
fn intervals_cover_the_truth_in_a_share_of_experiments() {
    for (name, noise, still_s) in kinds() {
        let shares = coverage(24, noise, still_s);
        println!("{name}: {shares:?}");
        // 24 experiments: 95 % - 3 binomial sd of 4.4 %. All 24 may be inside (29 % of the time), so
        // that intervals are not too wide is asked of the errors over their sd: 1 +- 3 / sqrt(2 * 24).
        let sound =
            |(share, ratio): &(f64, f64)| *share >= 0.816 && (0.567..=1.433).contains(ratio);
        assert!(
            shares.len() == 3 && shares.values().all(sound),
            "{name}: {shares:?}"
        );
    }
}

#[test]
#[ignore = "600 experiments three times; run with --ignored"]
fn intervals_cover_the_truth_in_600_experiments() {
    let mut missed = Vec::new();
    for (name, noise, still_s) in kinds() {
        let shares = coverage(600, noise, still_s);
        assert_eq!(shares.len(), 3);
        for (key, (share, ratio)) in shares {
            println!(
                "{name}: {key} {:.1} % inside, errors over their sd {ratio:.3}",
                100.0 * share
            );
            // The coverage that is required; and 1 +- 3 / sqrt(2 * 600) of the errors over their sd.
            if !(0.92..=0.98).contains(&share) || !(0.913..=1.087).contains(&ratio) {
                missed.push((name, key, share, ratio));
            }
        }
    }
    assert!(missed.is_empty(), "{missed:?}");
}

#[test]
fn four_surge_runs_give_three_parameters_white_residuals_and_the_blind_spots() {
    let rig = decoupled();
    let truth = other_vehicle(&rig, 5);
    let runs = surge_runs(&truth, WHITE, 3);
    let found = identify(&runs, &rig, &Options::default()).unwrap();
    assert_eq!(found.model, "surge");
    for (key, p) in &found.parameters {
        let actual = Coefficient::find(key).unwrap().of_vehicle(&truth);
        assert!(
            (p.value - actual).abs() < 4.0 * p.sd.unwrap(),
            "{key}: {p:?} {actual}"
        );
        assert!(p.sd.unwrap() < 0.01 * actual.abs(), "{key}: {p:?}");
    }
    assert!(found.misfit.is_empty(), "{:?}", found.misfit);
    let spots: Vec<&str> = found.blind_spots.iter().map(|b| b.what.as_str()).collect();
    assert!(
        spots.contains(&"thrust_scale") && spots.contains(&"position_scale"),
        "{spots:?}"
    );
    let page = hydroline::identify::report::html(&found, "hydroline identify");
    let read = read_markup(&page);
    // A figure per run (measured, fitted and its noise, their difference, the load), one of all runs over each other
    // (motion, difference) and one of their autocorrelation; each broad and narrow.
    assert_eq!(elements(&read, "figure"), 4 + 1 + 1);
    assert_eq!(elements(&read, "path"), 2 * (5 * 4 + 2 * 4 + 4));
    assert!(page.contains("4 runs determine all 3 coefficients of the model surge: "));
    assert!(page.contains("Each run predicted by the others"));
    assert_eq!(found.cross_validation.len(), 4);
    for cv in &found.cross_validation {
        assert!(cv.left_out["x_m"] < 1.2 * cv.fitted["x_m"], "{cv:?}");
    }
    // A thrust 5 % too large gives 5 % wrong coefficients and residuals as white as before.
    let mut scaled = runs.clone();
    for c in scaled.iter_mut().flat_map(|r| &mut r.commands) {
        c.wrench[0] *= 1.05;
    }
    let wrong = identify(&scaled, &rig, &Options::default()).unwrap();
    let mass = |f: &Identification| rig.vehicle.mass_kg - f.value("x_udot").unwrap();
    assert!((mass(&wrong) / mass(&found) - 1.05).abs() < 1e-3);
    assert!(wrong.misfit.is_empty());
}

#[test]
fn a_run_at_rest_measures_the_noise() {
    let rig = decoupled();
    let noise = TestNoise {
        coloured: 1.0,
        ..WHITE
    };
    let mut runs = surge_runs(&rig.vehicle, noise, 8);
    runs.push(simulated(&rig.vehicle, "still", &[], 60.0, noise, 99));
    let found = identify(&runs, &rig, &Options::default()).unwrap();
    let slot = &found.noise["x_m"];
    assert_eq!(slot.source, "measured at rest");
    assert!(
        (slot.noise.total_sd() / 2.1e-4 - 1.0).abs() < 0.25,
        "{slot:?}"
    );
    // Its colour is known: coloured residuals are no misfit then.
    assert!(found.misfit.is_empty(), "{:?}", found.misfit);
    assert!(
        (0.6..1.6).contains(&found.variance_ratio),
        "{}",
        found.variance_ratio
    );
    let same = identify(&runs, &rig, &Options::default()).unwrap();
    assert_eq!(
        serde_json::to_string(&found).unwrap(),
        serde_json::to_string(&same).unwrap(),
        "same input, same bytes"
    );
}

/// A free motion (no command) from a place and a rate in one DOF; only `kept` channels are measured.
fn free_motion(
    vehicle: &Vehicle,
    dof: Dof,
    (place, rate): (f64, f64),
    kept: &[(Channel, f64)],
    length_s: f64,
) -> Run {
    let model = Model {
        hydrodynamics: Hydrodynamics::new(vehicle),
        effects: EffectStack::empty(),
    };
    let mut start = ModelState::at_rest([0.0; 6]);
    start.vehicle.eta[dof.index()] = place;
    start.vehicle.nu[dof.index()] = rate;
    let mut path = Trajectory::new(model, start, 0.005).unwrap();
    let mut rng = StdRng::seed_from_u64(12);
    let sample = |k: usize| {
        let t_s = 0.04 * k as f64;
        let state = path.state_at(t_s).unwrap().vehicle;
        let mut values = PerChannel::NAN;
        for (c, sd) in kept {
            let noise: f64 = StandardNormal.sample(&mut rng);
            let truth = PerChannel::of_state(state.eta, state.nu)[*c];
            values[*c] = truth + sd * noise;
        }
        Sample {
            t_s,
            values,
            covariance: None,
        }
    };
    Run {
        name: "free".into(),
        samples: (0..(length_s / 0.04) as usize).map(sample).collect(),
        ..Run::default()
    }
}

fn fixed(keys: &[&str]) -> Options<'static> {
    Options {
        fixed: keys.iter().map(|k| Coefficient::find(k).unwrap()).collect(),
        ..Options::default()
    }
}

/// Every determined coefficient within 4 sd of the truth, and nothing stopped on a bound.
fn assert_sound(found: &Identification, truth: &Vehicle) {
    for (key, p) in &found.parameters {
        let actual = Coefficient::find(key).unwrap().of_vehicle(truth);
        assert!(
            p.excited && (p.value - actual).abs() < 4.0 * p.sd.unwrap(),
            "{key}: {p:?} {actual}"
        );
    }
    assert!(
        !found.notes.iter().any(|n| n.contains("ended on")),
        "{:?}",
        found.notes
    );
}

#[test]
fn a_coast_down_seen_by_velocity_only_starts_at_any_speed() {
    let rig = decoupled();
    let mut truth = other_vehicle(&rig, 3);
    truth.coefficients[0].added = rig.vehicle.coefficients[0].added;
    let run = free_motion(&truth, Dof::Surge, (0.0, 0.6), &[(Channel::U, 1e-3)], 20.0);
    let found = identify(&[run], &rig, &fixed(&["x_udot"])).unwrap();
    assert_eq!(found.model, "surge");
    assert_sound(&found, &truth);
    assert!((found.runs[0].rms["u_mps"] / 1e-3 - 1.0).abs() < 0.2);
    // Channels that were not measured have no noise.
    assert!(!found.noise.contains_key("x_m") && !found.runs[0].rms.contains_key("x_m"));
}

#[test]
fn a_roll_decay_seen_by_a_gyro_only_starts_at_any_heel() {
    let rig = decoupled();
    let truth = other_vehicle(&rig, 4);
    let run = free_motion(&truth, Dof::Roll, (0.3, 0.0), &[(Channel::P, 1e-3)], 30.0);
    let found = identify(std::slice::from_ref(&run), &rig, &Options::default()).unwrap();
    assert_eq!(found.model, "roll");
    assert_sound(&found, &truth);
    let (heel, sd) = found.runs[0].start["phi_rad.start"];
    assert!((heel - 0.3).abs() < 4.0 * sd.unwrap(), "{heel} {sd:?}");
    // The coupled model too.
    let options = Options {
        model: ModelChoice::Coupled,
        ..Options::default()
    };
    assert_sound(&identify(&[run], &rig, &options).unwrap(), &truth);
}

/// The water's stiffness gives mass and damping their scale, where the hull floats deeper by its net weight too.
#[test]
fn a_heave_decay_of_a_hull_that_floats_shows_mass_and_damping() {
    let mut rig = decoupled();
    rig.vehicle.stiffness[0] = 900.0;
    rig.vehicle.net_weight_n = 9.0;
    rig.vehicle.float_z_m = Some(0.05);
    let truth = other_vehicle(&rig, 5);
    let run = free_motion(&truth, Dof::Heave, (0.15, 0.0), &[(Channel::Z, 1e-4)], 20.0);
    let found = identify(&[run], &rig, &Options::default()).unwrap();
    assert_eq!(found.model, "heave");
    assert_sound(&found, &truth);
    let spots = found.blind_spots.iter();
    let scale = spots.clone().find(|b| b.what == "restoring_scale");
    assert!(scale.is_some_and(|b| b.why.contains("water's stiffness")));
    assert!(!spots.clone().any(|b| b.what == "mass_scale"));
}

#[test]
fn a_swing_that_no_heel_makes_is_no_fit() {
    let rig = decoupled();
    let mut run = free_motion(
        &rig.vehicle,
        Dof::Roll,
        (0.3, 0.0),
        &[(Channel::P, 1e-3)],
        1.2,
    );
    // The first quarter of a swing, ten times what a heel of 0.3 rad makes: no sine is 3.
    for sample in &mut run.samples {
        sample.values[Channel::P] *= 10.0;
    }
    let options = Options {
        from_rest: true,
        ..fixed(&["k_pdot", "k_pp"])
    };
    let found = identify(&[run], &rig, &options).unwrap();
    assert!(!found.test.explains, "{:?}", found.test);
}

#[test]
fn a_free_decay_holds_the_mass_alone_and_names_the_scale() {
    let rig = decoupled();
    let mut truth = rig.vehicle.clone();
    // Twice the mass and damping of the rig with the same motion, and half as much again of drag.
    truth.coefficients[0].added = 2.0 * rig.vehicle.coefficients[0].added - rig.vehicle.mass_kg;
    truth.coefficients[0].linear *= 2.0;
    truth.coefficients[0].quadratic *= 3.0;
    let run = free_motion(
        &truth,
        Dof::Surge,
        (0.0, 0.6),
        &[(Channel::X, 1e-4), (Channel::U, 1e-3)],
        20.0,
    );
    let flat = Options {
        flat_priors: true,
        ..Options::default()
    };
    let found = identify(std::slice::from_ref(&run), &rig, &flat).unwrap();
    let held: Vec<&String> = found
        .notes
        .iter()
        .filter(|n| n.contains("kept at the rig's"))
        .collect();
    assert!(held.len() == 1 && held[0].starts_with("x_udot"), "{held:?}");
    assert!(found.misfit.is_empty(), "{:?}", found.misfit);
    // The ratios to the mass are the truth's.
    let of = |key: &str| Coefficient::find(key).unwrap();
    for (key, share) in [("x_u", 0.05), ("x_uu", 0.02)] {
        let ratio = 2.0 * found.value(key).unwrap() / of(key).of_vehicle(&truth);
        assert!((ratio - 1.0).abs() < share, "{key}: {ratio}");
        assert!(!found.parameters[key].excited, "the scale is open");
    }
    // Beside the rig's priors the scale is theirs, and the ratios are the same.
    let known = identify(&[run], &rig, &Options::default()).unwrap();
    let inertia = |added: f64| rig.vehicle.mass_kg - added;
    let of_truth = inertia(truth.coefficients[0].added);
    let of_found = inertia(known.value("x_udot").unwrap());
    for (key, share) in [("x_u", 0.05), ("x_uu", 0.02)] {
        let ratio = known.value(key).unwrap() / of(key).of_vehicle(&truth);
        assert!(
            (ratio * of_truth / of_found - 1.0).abs() < share,
            "{key}: {ratio}"
        );
        assert!(!known.parameters[key].excited, "the scale is open");
    }
    let scale = found
        .blind_spots
        .iter()
        .find(|b| b.what == "mass_scale")
        .unwrap();
    assert!(scale.experiment.contains("known load"), "{scale:?}");
    assert!(
        found
            .blind_spots
            .iter()
            .all(|b| !b.experiment.starts_with("a slow run")),
        "{:?}",
        found.blind_spots
    );
}

#[test]
fn what_the_other_runs_leave_open_is_held_when_a_run_is_predicted() {
    let rig = decoupled();
    let slow = |seed| {
        let commands = [(0.0, surge(0.05)), (6.0, surge(-0.05))];
        simulated(&rig.vehicle, "slow", &commands, 12.0, WHITE, seed)
    };
    let fast = [(0.0, surge(16.0)), (5.0, surge(-8.0)), (12.0, surge(3.0))];
    let fast = simulated(&rig.vehicle, "fast", &fast, 20.0, WHITE, 9);
    let found = identify(&[fast, slow(1), slow(2)], &rig, &Options::default()).unwrap();
    let [without_fast, with_fast, _] = found.cross_validation.as_slice() else {
        panic!("three runs")
    };
    assert!(
        without_fast.held.contains(&"x_uu".to_owned()) && with_fast.held.is_empty(),
        "{:?}",
        found.cross_validation
    );
    // The rig is the truth here: what is held predicts, what drifts does not.
    assert!(without_fast.left_out["x_m"] < 0.05, "{without_fast:?}");
}

/// The built-in plan's commands at the link's rate.
fn commands_of(plan: &Plan, rate_hz: f64) -> Vec<(f64, [f64; 6])> {
    (0..=(plan.duration_s() * rate_hz) as usize)
        .map(|k| {
            let t_s = k as f64 / rate_hz;
            match plan.load_at(t_s).1 {
                StepLoad::Wrench(w) => (t_s, w.to_array()),
                StepLoad::ThrustN(_) => panic!("a wrench plan"),
            }
        })
        .collect()
}

#[test]
fn all_eighteen_from_two_mixed_runs_and_what_is_not_excited_is_named() {
    let rig = Rig::builtin("lshpi").unwrap();
    let truth = other_vehicle(&rig, 11);
    let plan = Plan::builtin("mixed-6dof").unwrap();
    let first = commands_of(&plan, 25.0);
    // The second run: the same, backwards and stronger in the angles.
    let second: Vec<(f64, [f64; 6])> = first
        .iter()
        .map(|(t, _)| {
            let w = first[first.len() - 1 - ((t * 25.0).round() as usize).min(first.len() - 1)].1;
            (
                *t,
                std::array::from_fn(|i| if i < 3 { -w[i] } else { 1.4 * w[i] }),
            )
        })
        .collect();
    let runs = [
        simulated(&truth, "a", &first, 47.0, WHITE, 21),
        simulated(&truth, "b", &second, 47.0, WHITE, 22),
    ];
    let options = Options {
        from_rest: true,
        ..quick()
    };
    let found = identify(&runs, &rig, &options).unwrap();
    assert_eq!((found.model.as_str(), found.parameters.len()), ("eq1", 18));
    let mut outside = Vec::new();
    for (key, p) in &found.parameters {
        let actual = Coefficient::find(key).unwrap().of_vehicle(&truth);
        let sd = p.sd.unwrap_or(f64::INFINITY);
        println!(
            "{key:<7} {:>10.4} +- {sd:<9.4} truth {actual:.4}{}",
            p.value,
            if p.excited { "" } else { "  not excited" }
        );
        if !(p.low.unwrap() <= actual && actual <= p.high.unwrap()) {
            outside.push(key.clone());
        }
        assert!(
            (p.value - actual).abs() < 4.0 * sd,
            "{key}: {p:?} truth {actual}"
        );
    }
    // Of 18 intervals of 95 % none to two miss in 94 % of experiments (binomial); three would be a finding.
    assert!(outside.len() <= 2, "{outside:?}");
    // And they are not wider than they need be: the mean square of the errors over their sd is 1, with
    // an sd of sqrt(2 / 18) if all were independent (pairs correlate, so less is known).
    let square = |(key, p): (&String, &hydroline::identify::Estimate)| {
        let actual = Coefficient::find(key).unwrap().of_vehicle(&truth);
        ((p.value - actual) / p.sd.unwrap()).powi(2)
    };
    let mean = found.parameters.iter().map(square).sum::<f64>() / 18.0;
    assert!((0.2..2.2).contains(&mean), "{mean}");

    // Surge alone moves nothing else: the other fifteen are named, with an experiment each.
    let alone = [simulated(
        &truth,
        "surge",
        &[(0.0, surge(8.0)), (6.0, surge(-8.0)), (12.0, surge(0.0))],
        20.0,
        WHITE,
        31,
    )];
    let options = Options {
        model: ModelChoice::Coupled,
        ..options
    };
    let found = identify(&alone, &rig, &options).unwrap();
    let named: Vec<&str> = found.blind_spots.iter().map(|b| b.what.as_str()).collect();
    for dof in &Dof::ALL[1..] {
        for c in Coefficient::of(*dof) {
            assert!(
                named.contains(&c.key()) && !found.parameters[c.key()].excited,
                "{}: {named:?}",
                c.key()
            );
        }
    }
    assert!(
        Coefficient::of(Dof::Surge)
            .iter()
            .all(|c| found.parameters[c.key()].excited)
    );
}

#[test]
fn case103_is_recovered_within_three_sd() {
    let Some(folder) = input("cases/motion") else {
        return;
    };
    let rig = Rig::builtin("lshpi").unwrap();
    let key: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(folder.join("key.json")).unwrap()).unwrap();
    let case = key
        .as_array()
        .unwrap()
        .iter()
        .find(|c| c["case"] == "case103")
        .unwrap();
    let runs: Vec<Run> = (0..4)
        .map(|i| load(&folder.join(format!("case103/run{i}.mcap")), &rig).unwrap())
        .collect();
    let found = identify(&runs, &rig, &Options::default()).unwrap();
    assert_eq!(found.model, "surge");
    for (name, p) in &found.parameters {
        let truth = case["vehicle"][name].as_f64().unwrap();
        let sd = p.sd.unwrap();
        println!(
            "{name}: {:.4} +- {sd:.4}, key {truth:.4}, {:.2} sd",
            p.value,
            (p.value - truth) / sd
        );
        assert!(
            (p.value - truth).abs() < 3.0 * sd,
            "{name}: {} +- {sd}, key {truth}",
            p.value
        );
    }
    println!("noise {:?} misfit {:?}", found.noise, found.misfit);
}

const ROLL_DECAY_MAP: &str = r#"
[time]
column = "time"
unit = "s"
from_s = 12.0
to_s = 100.0
[motion.phi_rad]
column = "phi"
unit = "rad"
"#;

/// KVLCC2 at scale 68, zero speed: displacement 312653 m3, GM 5.73 m full scale.
fn kvlcc2() -> Rig {
    let mut rig = decoupled();
    let mass = 312_653.0 / 68f64.powi(3) * 1000.0;
    rig.vehicle.mass_kg = mass;
    rig.vehicle.r_bz_m = -5.73 / 68.0;
    rig.vehicle.inertia_kgm2[0] = mass * (0.341_f64).powi(2);
    for (c, value) in Coefficient::of(Dof::Roll)
        .into_iter()
        .zip([-20.0, -3.0, 0.0])
    {
        c.put(&mut rig.vehicle, value);
    }
    rig
}

#[test]
fn the_real_roll_decay_is_fitted_and_its_residual_is_far_from_white() {
    let Some(csv) = input("cases/real/roll-decay/model_test_21338.csv") else {
        return;
    };
    let text = std::fs::read_to_string(csv).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("roll.mcap");
    let map = Map::from_toml(ROLL_DECAY_MAP, "roll.toml").unwrap();
    let data = read(&text, &map);
    assert!(!data.has_faults(), "{:?}", data.findings);
    let outcome = import(
        &data,
        &map,
        ROLL_DECAY_MAP,
        &out,
        import::Options::default(),
    )
    .unwrap();
    assert!(outcome.samples > 8000 && outcome.commands == 0);
    let rig = kvlcc2();
    let run = load(&out, &rig).unwrap();
    let options = Options {
        fixed: vec![Coefficient::find("k_pp").unwrap()],
        ..Options::default()
    };
    let found = identify(&[run], &rig, &options).unwrap();
    assert_eq!(found.model, "roll");
    println!(
        "{:#?}\nnoise {:?}\nrms {:?}\n{:?}",
        found.parameters, found.noise, found.runs[0].rms, found.misfit
    );
    let damping = &found.parameters["k_p"];
    assert!(damping.value < 0.0 && damping.excited, "{damping:?}");
    println!("{}", found.test.sentence);
    assert!(found.residuals[0].plain.unwrap().p_value < 1e-12);
    assert!(
        found
            .blind_spots
            .iter()
            .any(|b| b.what == "restoring_scale"),
        "{:?}",
        found.blind_spots
    );
}

#[test]
fn the_real_linear_drive_is_imported_with_its_command() {
    let Some(csv) = input("cases/real/emps/DATA_EMPS_SC.csv") else {
        return;
    };
    let text = std::fs::read_to_string(csv).unwrap();
    let toml = "[time]\ncolumn = \"time_exp\"\nunit = \"s\"\n[motion.x_m]\ncolumn = \"q_meas\"\nunit = \"m\"\n[motion.u_mps]\ncolumn = \"v_est\"\nunit = \"m/s\"\n[[command]]\nthruster = \"surge\"\ncolumn = \"u_in\"\nscale = 35.15\nbetween = \"hold\"\n";
    let map = Map::from_toml(toml, "emps.toml").unwrap();
    let data = read(&text, &map);
    println!("{:?}", data.findings);
    assert!(!data.has_faults(), "{:?}", data.findings);
    assert!(
        data.findings
            .iter()
            .any(|f| f.kind == "kinematics" && f.message.contains("u_mps is d(x_m)/dt")),
        "{:?}",
        data.findings
    );
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("emps.mcap");
    import(&data, &map, toml, &out, import::Options::default()).unwrap();
    let rig = decoupled();
    let run = load(&out, &rig).unwrap();
    assert_eq!(run.samples.len(), 4968);
    assert!((run.commands[0].wrench[0] - 35.15 * 2.538_628_101_348_877).abs() < 1e-9);
}
