//! Simulated runs through the whole way.

use crate::{EstimateError, ModelChoice, Options, identify, refit};
use hydroline_core::run::{Channel, Command, Joined, PerChannel, Run, Sample};
use hydroline_identify::Identification;
use hydroline_identify::parameter::Coefficient;
use hydroline_rigs::{Dof, Rig};
use hydroline_sim::model::{Model, ModelState};
use hydroline_sim::{EffectStack, Trajectory, vehicle::Hydrodynamics};
use rand::{SeedableRng, rngs::StdRng};
use rand_distr::{Distribution, Normal};
use std::collections::BTreeMap;

const QUICK: Options<'_> = Options {
    model: ModelChoice::Auto,
    fixed: Vec::new(),
    from_rest: false,
    flat_priors: false,
    cross_validate: false,
    budget: false,
    progress: &|_| {},
};

/// Surge at 25 Hz for 24 s under reversals; from half of it on stamps are `gap_s` later, as of a clock that was set.
fn reversals(rig: &Rig, gap_s: f64) -> Run {
    let mut run = by_supply(rig, (1.0, 7));
    let set = |t_s: &mut f64| *t_s += if *t_s > 12.01 { gap_s } else { 0.0 };
    run.samples.iter_mut().for_each(|s| set(&mut s.t_s));
    run.commands.iter_mut().for_each(|c| set(&mut c.t_s));
    run
}

/// The same where so much of each load arrives, with the noise of a seed.
fn by_supply(rig: &Rig, (share, seed): (f64, u64)) -> Run {
    let loads_n = [8.0, -8.0, 6.0, -6.0, 8.0, 0.0];
    let commands = loads_n.iter().enumerate().map(|(k, load_n)| Command {
        t_s: 0.002 + 4.0 * k as f64,
        wrench: [*load_n, 0.0, 0.0, 0.0, 0.0, 0.0],
    });
    let mut run = Run {
        name: format!("run{seed}"),
        commands: commands.collect(),
        ..Run::default()
    };
    let model = Model {
        hydrodynamics: Hydrodynamics::new(&rig.vehicle),
        effects: EffectStack::empty(),
    };
    let mut path = Trajectory::new(model, ModelState::at_rest([0.0; 6]), 0.005).unwrap();
    for c in &run.commands {
        path.command(c.t_s, c.wrench.map(|w| share * w)).unwrap();
    }
    let noise = Normal::new(0.0, 1.5e-4).unwrap();
    let mut rng = StdRng::seed_from_u64(seed);
    for k in 0..600_u32 {
        let t_s = 0.04 * f64::from(k);
        let mut values = PerChannel::NAN;
        let x_m = path.state_at(t_s).unwrap().vehicle.eta[0];
        values[Channel::X] = x_m + noise.sample(&mut rng);
        run.samples.push(Sample {
            t_s,
            values,
            covariance: None,
        });
    }
    run
}

/// The gap was integrated in steps of 40 ms: a year of it took tens of gigabytes, until the kernel ended the program.
#[test]
fn a_gap_of_a_century_makes_two_runs_and_costs_neither_time_nor_memory() {
    let rig = Rig::builtin("lshpi").unwrap();
    let fit = |gap_s: f64| identify(&[reversals(&rig, gap_s)], &rig, &QUICK).unwrap();
    let key = Coefficient::of(Dof::Surge)[2].key();
    let whole = fit(0.0).parameters[key].clone();
    for gap_s in [1000.7, 3.2e9] {
        let found = fit(gap_s);
        let (own, sd) = (&found.parameters[key], whole.sd.unwrap());
        assert_eq!(found.runs.len(), 2, "{gap_s}");
        assert!(
            (own.value - whole.value).abs() < 4.0 * sd,
            "{own:?} {whole:?}"
        );
        let notes = &found.runs[0].notes;
        assert!(notes[0].contains("taken as 2 run(s)"), "{notes:?}");
    }
}

/// They drew the first fit away, what it left passed for noise of 70 mm, and by that nothing was determined: the rig's own
/// numbers were given for the vehicle's.
#[test]
fn spikes_in_two_of_a_hundred_samples_leave_every_coefficient_determined() {
    let rig = Rig::builtin("lshpi").unwrap();
    let fit = |spike_m: f64| {
        let mut run = reversals(&rig, 0.0);
        let spiked = (0..600).filter(|k| k % 53 == 17);
        spiked.for_each(|k| run.samples[k].values[Channel::X] += spike_m);
        identify(&[run], &rig, &QUICK).unwrap()
    };
    let clean = fit(0.0);
    for spike_m in [0.5, -0.03, 40.0] {
        let found = fit(spike_m);
        for c in Coefficient::of(Dof::Surge) {
            let (own, whole) = (&found.parameters[c.key()], &clean.parameters[c.key()]);
            assert!(own.excited, "{spike_m}: {own:?}");
            assert!(
                (own.value - whole.value).abs() < whole.sd.unwrap(),
                "{spike_m}: {own:?} {whole:?}"
            );
        }
        let noise = &found.noise["x_m"];
        assert!(noise.noise.white_sd < 2e-4, "{spike_m}: {noise:?}");
        assert!(
            (noise.outliers - 11.0 / 600.0).abs() < 5e-3,
            "{spike_m}: {noise:?}"
        );
    }
}

#[test]
fn samples_that_are_all_far_apart_are_refused_with_the_reason() {
    let rig = Rig::builtin("lshpi").unwrap();
    for apart_s in [15.0, 50.0, 86_400.0] {
        let mut run = reversals(&rig, 0.0);
        let samples = run.samples.iter_mut();
        samples.for_each(|s| s.t_s *= apart_s / 0.04);
        let error = identify(&[run], &rig, &Options::default()).unwrap_err();
        assert!(matches!(error, EstimateError::TooSparse(_)), "{error}");
        assert!(error.to_string().contains("less than 14 s"), "{error}");
    }
}

#[test]
fn a_refit_gives_what_the_fit_before_gave_and_other_loads_what_they_would() {
    let rig = Rig::builtin("lshpi").unwrap();
    let measured = [reversals(&rig, 0.0)];
    let before = identify(&measured, &rig, &QUICK).unwrap();
    let again = refit(&measured, &rig, &before, false).unwrap();
    assert_eq!(again.order.len(), 3);
    for (k, key) in again.order.iter().enumerate() {
        let sd = again.covariance[k][k].sqrt();
        let was = &before.parameters[key];
        assert!((again.values[key] - was.value).abs() < 0.3 * sd, "{key}");
        let ratio = sd / was.sd.unwrap();
        assert!((0.5..2.0).contains(&ratio), "{key}: {ratio}");
    }
    // Half the load for the same motion: half the inertia, half the damping (Eq. 1 of surge is linear in them).
    let mut halved = measured.clone();
    for command in &mut halved[0].commands {
        command.wrench[0] *= 0.5;
    }
    let half = refit(&halved, &rig, &before, false).unwrap();
    let m = rig.vehicle.mass_kg;
    let [added, linear, _] = Coefficient::of(Dof::Surge);
    let inertia = |of: &crate::Refitted| m - of.values[added.key()];
    assert!((inertia(&half) / inertia(&again) - 0.5).abs() < 0.01);
    let ratio = half.values[linear.key()] / again.values[linear.key()];
    assert!((ratio - 0.5).abs() < 0.01, "{ratio}");
    assert!(half.runs[0].2["x_m"] < 4e-4);
}

/// Without priors the interval is that of the likelihood: where the runs decide nothing changes, where they do not the number is held.
#[test]
fn flat_priors_change_what_the_runs_do_not_decide_and_nothing_else() {
    let rig = Rig::builtin("lshpi").unwrap();
    let flat = Options {
        flat_priors: true,
        ..QUICK
    };
    let runs = [reversals(&rig, 0.0)];
    let [with, without] = [&QUICK, &flat].map(|o| identify(&runs, &rig, o).unwrap());
    for (key, p) in &with.parameters {
        let other = &without.parameters[key];
        let sd = p.sd.unwrap();
        assert!(
            (p.value - other.value).abs() < 0.1 * sd,
            "{key}: {p:?} {other:?}"
        );
        assert!(
            (other.sd.unwrap() / sd - 1.0).abs() < 0.05,
            "{key}: {p:?} {other:?}"
        );
    }
    // No load: a factor of mass and damping is open.
    let mut free = reversals(&rig, 0.0);
    let coasts = 20.0;
    free.samples.retain(|s| s.t_s > coasts);
    free.commands.clear();
    let found = identify(&[free], &rig, &flat).unwrap();
    let held: Vec<&String> = (found.notes.iter())
        .filter(|n| n.contains("kept at the rig's"))
        .collect();
    assert!(held.iter().any(|n| n.starts_with("x_udot")), "{held:?}");
}

/// Every other sample has ten times the sd of the rest, which the log says: the others say nearly all.
#[test]
fn samples_count_by_the_sd_that_their_log_says() {
    let rig = Rig::builtin("lshpi").unwrap();
    let mut run = reversals(&rig, 0.0);
    let unit = Normal::new(0.0, 1.5e-3).unwrap();
    let mut rng = StdRng::seed_from_u64(9);
    for (k, sample) in run.samples.iter_mut().enumerate() {
        let sd = if k % 2 == 0 { 1.5e-3 } else { 1.5e-4 };
        if k % 2 == 0 {
            sample.values[Channel::X] += unit.sample(&mut rng);
        }
        let mut covariance = Box::new([0.0; 36]);
        for c in 0..6 {
            covariance[7 * c] = sd * sd;
        }
        sample.covariance = Some(covariance);
    }
    let weighed = identify(std::slice::from_ref(&run), &rig, &QUICK).unwrap();
    let mut good = run.clone();
    let mut k = 0;
    good.samples.retain(|_| {
        k += 1;
        k % 2 == 0
    });
    let alone = identify(&[good], &rig, &QUICK).unwrap();
    for (key, p) in &weighed.parameters {
        let ratio = p.sd.unwrap() / alone.parameters[key].sd.unwrap();
        println!("{key} {ratio} {:?} {:?}", weighed.noise, alone.noise);
        assert!((0.7..1.3).contains(&ratio), "{key}: {ratio}");
    }
}

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
    let one = reversals(&rig, 0.0);
    let mut two = one.clone();
    two.joined = Some(Joined {
        is_estimated: false,
        offset_sd_s: 0.02,
        drift_sd_ppm: 0.0,
    });
    let [one, two] = [one, two].map(|r| identify(&[r], &rig, &with).unwrap());
    let line = |of: &Identification, source: &str| -> Option<BTreeMap<String, f64>> {
        let line = of.budget.iter().find(|l| l.source.starts_with(source))?;
        Some(line.contributions.clone())
    };
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
        assert!((0.8..1.25).contains(&alone), "{key}: {alone}");
    }
    // A load that comes later and a mass that is larger begin alike.
    assert!(
        clocks["x_udot"] > samples["x_udot"],
        "{clocks:?} {samples:?}"
    );
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
    for (key, p) in &differing.parameters {
        let size = match key.as_str() {
            "x_udot" => m - p.value,
            _ => p.value.abs(),
        };
        let ratio = p.repeat_sd.unwrap() / (share_sd * size);
        println!("{key} {ratio} {p:?}");
        assert!((0.7..1.4).contains(&ratio), "{key}: {ratio}");
        assert!(p.combined_sd >= p.sd, "{key}: it stands beside the sum");
    }
    // Two are no repeats.
    let two = [(1.0, 31), (1.0, 32)].map(|of| by_supply(&rig, of));
    let found = identify(&two, &rig, &with).unwrap();
    assert!(found.parameters.values().all(|p| p.repeat_sd.is_none()));
}
