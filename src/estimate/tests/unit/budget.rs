//! The uncertainty budget of simulated runs: its lines, their sum, and the scatter between repeats beside it.

use super::{QUICK, by_supply, reversals};
use crate::{Options, identify};
use hydroline_core::run::{Joined, Run};
use hydroline_identify::Identification;
use hydroline_identify::parameter::Coefficient;
use hydroline_rigs::Rig;
use std::collections::BTreeMap;

/// Each line of the budget is what the coefficient does when its source is off by one sd.
#[test]
fn a_line_of_the_budget_is_the_change_that_its_source_makes() {
    let rig = Rig::builtin("lshpi").unwrap();
    let runs = [reversals(&rig, 0.0)];
    let with = Options {
        budget: true,
        ..QUICK
    };
    let found = identify(&runs, &rig, &with).unwrap();
    let line = |source: &str| found.budget.iter().find(|l| l.source == source).unwrap();
    let mut heavy = rig.clone();
    heavy.vehicle.mass_kg *= 1.01;
    let of_mass = identify(&runs, &heavy, &QUICK).unwrap();
    let mut strong = runs.clone();
    for command in &mut strong[0].commands {
        command.wrench[0] *= 1.05;
    }
    let of_thrust = identify(&strong, &rig, &QUICK).unwrap();
    for (source, other) in [("mass", &of_mass), ("thrust scale", &of_thrust)] {
        for (key, said) in &line(source).contributions {
            let sd = found.parameters[key].sd.unwrap();
            let change = (other.value(key).unwrap() - found.value(key).unwrap()).abs();
            // Where it does next to nothing, to a part of the scatter.
            let near = (0.2 * said).max(0.2 * sd);
            assert!(
                (change - said).abs() < near,
                "{source} {key}: {change} {said}"
            );
        }
    }
    // With its sign: more thrust for the same motion is more mass.
    let by_thrust = line("thrust scale").sensitivities["x_udot"];
    let change = of_thrust.value("x_udot").unwrap() - found.value("x_udot").unwrap();
    assert!(by_thrust < 0.0 && (change / 0.05 / by_thrust - 1.0).abs() < 0.2);
    // The thrust's scale is what these runs say least of.
    for p in found.parameters.values() {
        assert_eq!(p.largest_share.as_deref(), Some("thrust scale"), "{p:?}");
        let sum = |key: &str| -> f64 {
            let each = found.budget.iter().filter_map(|l| l.contributions.get(key));
            each.map(|v| v * v).sum::<f64>().sqrt()
        };
        let key = found.parameters.iter().find(|(_, q)| *q == p).unwrap().0;
        assert!(
            (sum(key) / p.combined_sd.unwrap() - 1.0).abs() < 1e-6,
            "{key}"
        );
        assert!((p.u95.unwrap() - 2.0 * p.combined_sd.unwrap()).abs() < 1e-9);
    }
    assert!(
        found
            .notes
            .iter()
            .any(|n| n.starts_with("assumed until measured"))
    );
    // What the rig states is taken.
    let mut weighed = rig.clone();
    weighed.vehicle.mass_kg_sd = Some(1e-3);
    weighed.thrusters.scale_sd = Some(0.0);
    let known = identify(&runs, &weighed, &with).unwrap();
    assert!(known.budget.iter().all(|l| l.source != "thrust scale"));
    let mass = known.budget.iter().find(|l| l.source == "mass").unwrap();
    assert_eq!((mass.basis.as_str(), mass.sd), ("the rig", Some(1e-3)));
    for (key, p) in &known.parameters {
        assert!(p.combined_sd < found.parameters[key].combined_sd, "{key}");
    }
}

/// It counted as exactly known, and nothing said so.
#[test]
fn a_coefficient_that_is_fixed_without_an_sd_is_noted() {
    let rig = Rig::builtin("lshpi").unwrap();
    let with = Options {
        budget: true,
        fixed: vec![Coefficient::find("x_u").unwrap()],
        ..QUICK
    };
    let found = identify(&[reversals(&rig, 0.0)], &rig, &with).unwrap();
    let noted = |n: &String| n.starts_with("x_u: fixed") && n.contains("exactly known");
    assert!(found.notes.iter().any(noted), "{:?}", found.notes);
}

/// One load from rest: X_u̇ was some sds off the truth where the thrusters have a deadband that these runs cannot show.
#[test]
fn a_deadband_that_nobody_can_see_is_in_the_expanded_uncertainty() {
    let rig = Rig::builtin("lshpi").unwrap();
    let mut run = reversals(&rig, 0.0);
    // The loads as the rig has them, of which 0.3 N do not arrive.
    for command in &mut run.commands {
        let load = &mut command.wrench[0];
        *load += 0.3 * load.signum() * f64::from(*load != 0.0);
    }
    // Nothing but one push, so that no effect of the load's size shows.
    run.samples.retain(|s| s.t_s < 4.0);
    run.commands.truncate(1);
    let with = Options {
        from_rest: true,
        budget: true,
        ..QUICK
    };
    let found = identify(&[run], &rig, &with).unwrap();
    for line in &found.budget {
        println!("{} {:?} {:?}", line.source, line.sd, line.contributions);
    }
    let p = &found.parameters["x_udot"];
    let truth = rig.vehicle.coefficients[0].added;
    println!("{p:?} {truth}");
    assert!((p.value - truth).abs() < p.u95.unwrap(), "{p:?}");
    let deadband = found
        .budget
        .iter()
        .find(|l| l.source == "thruster_deadband");
    assert!(deadband.is_some_and(|l| l.contributions["x_udot"] > p.sd.unwrap()));
}

/// The clock's offset is a number of the fit: its part of the covariance is a line of its own, and the samples' is what it was without.
#[test]
fn the_clock_of_a_joined_log_is_a_line_of_the_budget() {
    let rig = Rig::builtin("lshpi").unwrap();
    let with = Options {
        budget: true,
        ..QUICK
    };
    let line = |of: &Identification, source: &str| -> Option<BTreeMap<String, f64>> {
        let line = of.budget.iter().find(|l| l.source.starts_with(source))?;
        Some(line.contributions.clone())
    };
    let mut alone_ln = Vec::new();
    for seed in 7..11 {
        let one = by_supply(&rig, (1.0, seed));
        let mut two = one.clone();
        two.joined = Some(Joined {
            is_estimated: false,
            offset_sd_s: 0.02,
            drift_sd_ppm: 0.0,
        });
        let [one, two] = [one, two].map(|r| identify(&[r], &rig, &with).unwrap());
        assert_eq!(line(&one, "clocks"), None);
        let (samples, clocks) = (
            line(&two, "samples").unwrap(),
            line(&two, "clocks").unwrap(),
        );
        for (key, p) in &two.parameters {
            let sum = samples[key].hypot(clocks[key]);
            assert!(
                (sum / p.sd.unwrap() - 1.0).abs() < 1e-6,
                "{key}: {sum} {p:?}"
            );
            let alone = samples[key] / one.parameters[key].sd.unwrap();
            println!("{seed} {key} {alone}");
            alone_ln.push(alone.ln());
        }
        // A load that comes later and a mass that is larger begin alike.
        let share = |key: &str| clocks[key] / samples[key];
        assert!(share("x_u") > 0.0 && share("x_udot") > 0.0, "{clocks:?}");
    }
    // On the whole: how probable a small random force is beside an open clock differs from draw to draw.
    let alone = (alone_ln.iter().sum::<f64>() / alone_ln.len() as f64).exp();
    assert!((0.8..1.25).contains(&alone), "{alone}");
}

/// Of five runs of one plan: where they differ by noise alone the sd by repeats is that of the samples; where a supply differs by
/// 1 % to either side, each run's coefficients are off in proportion, and their mean by a root of five less.
#[test]
fn repeats_of_a_plan_show_what_differs_from_run_to_run() {
    let rig = Rig::builtin("lshpi").unwrap();
    let with = Options {
        budget: true,
        ..QUICK
    };
    let fit = |shares: [f64; 5]| {
        let each = shares.into_iter().zip(21..);
        let runs: Vec<Run> = each.map(|of| by_supply(&rig, of)).collect();
        identify(&runs, &rig, &with).unwrap()
    };
    let is_of_repeats = |n: &&String| n.contains("repeats of a plan");
    let alike = fit([1.0; 5]);
    assert_eq!(alike.notes.iter().find(is_of_repeats), None);
    for (key, p) in &alike.parameters {
        let ratio = p.repeat_sd.unwrap() / p.sd.unwrap();
        println!("{key} {ratio}");
        // Chi-square of four degrees of freedom: 0.1 % to either side.
        assert!((0.15..2.2).contains(&ratio), "{key}: {ratio}");
    }
    let differing = fit([0.99, 0.995, 1.0, 1.005, 1.01]);
    println!("{:?}", differing.notes);
    let share_sd = 0.0079 / 5f64.sqrt();
    let m = rig.vehicle.mass_kg;
    let mut seen = 0;
    for (key, p) in &differing.parameters {
        let size = match key.as_str() {
            "x_udot" => m - p.value,
            _ => p.value.abs(),
        };
        // Of what the samples scatter more than the supply changes nothing is to be seen.
        if share_sd * size < p.sd.unwrap() {
            continue;
        }
        seen += 1;
        let ratio = p.repeat_sd.unwrap() / (share_sd * size);
        println!("{key} {ratio} {p:?}");
        assert!((0.7..1.4).contains(&ratio), "{key}: {ratio}");
        assert!(p.combined_sd >= p.sd, "{key}: it stands beside the sum");
    }
    assert!(seen > 0);
    // Two are no repeats.
    let two = [(1.0, 31), (1.0, 32)].map(|of| by_supply(&rig, of));
    let found = identify(&two, &rig, &with).unwrap();
    assert!(found.parameters.values().all(|p| p.repeat_sd.is_none()));
}
