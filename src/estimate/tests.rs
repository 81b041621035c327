//! Simulated runs through the whole way.

#[path = "tests/unit/budget.rs"]
mod budget;
#[path = "tests/unit/coverage.rs"]
mod coverage;
#[path = "tests/unit/ensembles.rs"]
mod ensembles;
#[path = "tests/unit/kept.rs"]
mod kept;
#[path = "tests/unit/tank.rs"]
mod tank;

use crate::{EstimateError, ModelChoice, Options, identify, refit};
use hydroline_core::run::{Channel, Command, PerChannel, Run, Sample};
use hydroline_identify::parameter::Coefficient;
use hydroline_rigs::{Dof, Rig};
use hydroline_sim::model::{Model, ModelState};
use hydroline_sim::{EffectStack, Trajectory, vehicle::Hydrodynamics};
use rand::{SeedableRng, rngs::StdRng};
use rand_distr::{Distribution, Normal};

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

/// A thruster that gives less pushes aslant: starts of sway, of which no noise was known and nothing was said, left the refit where it
/// began, tens of millimetres off.
#[test]
fn a_refit_under_loads_of_a_dof_that_the_fit_before_did_not_have_ends_at_its_least() {
    let rig = Rig::builtin("lshpi").unwrap();
    let mut run = reversals(&rig, 0.0);
    let noise = Normal::new(0.0, 1.5e-4).unwrap();
    let mut rng = StdRng::seed_from_u64(8);
    for sample in &mut run.samples {
        sample.values[Channel::Y] = noise.sample(&mut rng);
    }
    let coupled = Options {
        model: ModelChoice::Coupled,
        ..QUICK
    };
    let before = identify(std::slice::from_ref(&run), &rig, &coupled).unwrap();
    assert!(!before.noise.contains_key("y_m"), "{:?}", before.noise);
    for command in &mut run.commands {
        let surge_n = command.wrench[0];
        command.wrench[0] = 0.999 * surge_n;
        command.wrench[1] = 0.02 * surge_n;
    }
    let found = refit(&[run], &rig, &before, false).unwrap();
    let rms_m = found.runs[0].2["x_m"];
    assert!(rms_m < 2e-4, "{rms_m}");
    let m = rig.vehicle.mass_kg;
    let ratio = (m - found.values["x_udot"]) / (m - before.value("x_udot").unwrap());
    assert!((ratio / 0.999 - 1.0).abs() < 1e-3, "{ratio}");
}
