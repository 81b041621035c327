//! Written files, read again and integrated beside our own simulation.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

mod reading;

use hydroline_exchange::model::written;
use hydroline_exchange::target::{About, Target, export};
use hydroline_identify::predict::predict;
use hydroline_plan::setpoint::setpoint;
use hydroline_rigs::{Plan, Rig};
use hydroline_sim::Allocation;
use hydroline_sim::effect::{CheckedEffect, Stage, find};
use reading::Function;

const ABOUT: About<'static> = About {
    made_by: "a test",
    ranges: &[],
    function: "model",
    library: None,
};

/// Relative distance at which nothing is lost.
const NOTHING_LOST: f64 = 1e-6;

/// Part of a plan that shows an effect by itself \[s\].
const SHORT_S: f64 = 6.0;

/// Step of the integration, as `predict` has it \[s\].
const STEP_S: f64 = 0.02;

fn rig_with(effects: &[(&str, &str)]) -> Rig {
    let mut rig = Rig::builtin("lshpi").unwrap();
    rig.physics = effects
        .iter()
        .map(|(id, dof)| {
            let mut effect = CheckedEffect::typical(find(id).unwrap());
            let words = effect.info.words.iter().position(|w| w.name == "dof");
            if let (Some(k), false) = (words, dof.is_empty()) {
                let allowed = effect.info.words[k].allowed;
                effect.words[k] = allowed.iter().position(|w| w == dof).unwrap();
            }
            effect.entry()
        })
        .collect();
    rig
}

/// Motion of a read function over a plan, twelve numbers each 0.2 s, up to some time \[s\].
fn integrated(
    function: &Function,
    rig: &Rig,
    states: &[String],
    plan: &Plan,
    until_s: f64,
) -> Vec<Vec<f64>> {
    let allocation = Allocation::new(&rig.thrusters).unwrap();
    let mut state = rig.tank.start_pose.to_vec();
    state.resize(states.len(), 0.0);
    let mut rows = Vec::new();
    let steps = (plan.duration_s().min(until_s) / STEP_S).round() as u64;
    let mut thrust = Vec::new();
    let inputs: Vec<String> = (1..=rig.thrusters.thrusters.len())
        .map(|k| format!("thrust_{k}"))
        .collect();
    for k in 0..=steps {
        if k % 10 == 0 {
            rows.push(state[..12].to_vec());
        }
        // Commands come at 25 per second, on the grid of the steps.
        if k % 2 == 0 {
            thrust = setpoint(rig, &allocation, plan, 0.04 * (k / 2) as f64)
                .unwrap()
                .thrust_n;
        }
        let rates = |t_s: f64, state: &[f64]| {
            let names = states
                .iter()
                .chain(&inputs)
                .map(String::as_str)
                .chain(["t"]);
            let values = state.iter().chain(&thrust).copied().chain([t_s]);
            function.rates(&names.zip(values).collect::<Vec<_>>())
        };
        let moved = |rate: &[f64], by: f64| -> Vec<f64> {
            state.iter().zip(rate).map(|(s, r)| s + r * by).collect()
        };
        let t_s = k as f64 * STEP_S;
        let k1 = rates(t_s, &state);
        let k2 = rates(t_s + 0.5 * STEP_S, &moved(&k1, 0.5 * STEP_S));
        let k3 = rates(t_s + 0.5 * STEP_S, &moved(&k2, 0.5 * STEP_S));
        let k4 = rates(t_s + STEP_S, &moved(&k3, STEP_S));
        let next = (0..state.len())
            .map(|i| state[i] + STEP_S / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
        state = next.collect();
    }
    rows
}

/// Largest distance of each channel over the largest value that it takes, of those that move.
fn distance(ours: &[Vec<f64>], theirs: &[Vec<f64>]) -> f64 {
    assert!(theirs.len() > 20 && ours.len() >= theirs.len());
    let mut worst = 0.0_f64;
    for c in 0..12 {
        let size = ours.iter().map(|r| r[c].abs()).fold(1e-6, f64::max);
        let each = ours.iter().zip(theirs);
        let off = each.map(|(a, b)| (a[c] - b[c]).abs()).fold(0.0, f64::max);
        worst = worst.max(off / size);
    }
    worst
}

fn predicted(rig: &Rig, plan: &Plan) -> Vec<Vec<f64>> {
    let made = predict(rig, plan, None, 5.0, 0.0).unwrap();
    made.motion
        .iter()
        .map(|m| m.into_array().to_vec())
        .collect()
}

/// In the order of our states; the MSS file has its own.
fn in_our_order(target: Target, function: Function) -> Function {
    if target == Target::Mss {
        function.reordered()
    } else {
        function
    }
}

#[test]
fn each_language_moves_as_the_simulator_over_three_plans() {
    let rig = rig_with(&[
        ("thruster_lag", "surge"),
        ("thruster_lag", "yaw"),
        ("thruster_deadband", "heave"),
        ("thrust_asymmetry", "surge"),
        ("coulomb_friction", "sway"),
        ("current", ""),
        ("cubic_damping", "yaw"),
        ("fluid_memory", "heave"),
    ]);
    let states = written(&rig).unwrap().states;
    assert_eq!(states.len(), 15);
    for target in [Target::Python, Target::Casadi, Target::Mss] {
        let export = export(&rig, target, &ABOUT).unwrap();
        assert!(export.lost.is_empty() && export.differences.is_empty());
        let text = String::from_utf8(export.bytes).unwrap();
        let function = in_our_order(target, Function::read(&text, target.name()));
        for name in ["surge-8n", "reversals", "mixed-6dof"] {
            let plan = Plan::builtin(name).unwrap();
            let off = distance(
                &predicted(&rig, &plan),
                &integrated(&function, &rig, &states, &plan, f64::INFINITY),
            );
            println!("{} {name}: {off:.1e}", target.name());
            assert!(off < NOTHING_LOST, "{} {name}: {off}", target.name());
        }
    }
}

#[test]
fn each_effect_of_the_vehicle_moves_it_as_in_the_simulator() {
    let plan = Plan::builtin("mixed-6dof").unwrap();
    let mut seen = 0;
    for info in hydroline_sim::effect::ALL {
        if !matches!(info.stage, Stage::Thruster | Stage::Hydrodynamics) {
            continue;
        }
        let mut rig = rig_with(&[(info.id, "")]);
        if info.id == "free_force" {
            let mut table = CheckedEffect::typical(info);
            table.numbers = vec![-0.1, 0.1];
            table
                .numbers
                .extend((0..40).map(|k| 0.1 * f64::from(k % 7) - 0.3));
            table.words[1] = 6;
            rig.physics = vec![table.entry()];
        }
        let model = written(&rig).unwrap();
        if model.held.is_empty() {
            continue;
        }
        seen += 1;
        let text = String::from_utf8(export(&rig, Target::Python, &ABOUT).unwrap().bytes).unwrap();
        let function = Function::read(&text, "python");
        let off = distance(
            &predicted(&rig, &plan),
            &integrated(&function, &rig, &model.states, &plan, SHORT_S),
        );
        assert!(off < NOTHING_LOST, "{}: {off}", info.id);
    }
    assert!(seen > 15, "{seen}");
}

#[test]
fn a_decoupled_rig_and_one_that_floats_are_written_as_they_are() {
    let mut rig = Rig::builtin("lshpi").unwrap();
    rig.vehicle.model = hydroline_rigs::VehicleModel::Decoupled;
    rig.vehicle.net_weight_n = 0.3;
    rig.vehicle.stiffness = [200.0, 3.0, 4.0];
    rig.vehicle.float_z_m = Some(rig.tank.start_pose[2]);
    let states = written(&rig).unwrap().states;
    let text = String::from_utf8(export(&rig, Target::Python, &ABOUT).unwrap().bytes).unwrap();
    let function = Function::read(&text, "python");
    let plan = Plan::builtin("mixed-6dof").unwrap();
    let off = distance(
        &predicted(&rig, &plan),
        &integrated(&function, &rig, &states, &plan, f64::INFINITY),
    );
    assert!(off < NOTHING_LOST, "{off}");
}

#[test]
fn what_is_lost_is_said_with_its_size() {
    let rig = rig_with(&[
        ("command_latency", ""),
        ("camera_latency", ""),
        ("wave_force", "heave"),
    ]);
    let export = export(&rig, Target::Python, &ABOUT).unwrap();
    let lost: Vec<&str> = export.lost.iter().map(|l| l.what.as_str()).collect();
    assert_eq!(
        lost,
        ["command_latency", "camera_latency", "wave_force_heave"]
    );
    assert_eq!(export.differences.len(), 3);
    assert!(
        export.differences.iter().all(|d| d.position_mm > 0.01),
        "{:?}",
        export.differences
    );
    let text = String::from_utf8(export.bytes).unwrap();
    for words in [
        "Lost in export:",
        "- camera_latency",
        "mm and",
        "COMMAND_DELAY_S = 0.",
    ] {
        assert!(text.contains(words), "no {words:?} in\n{text}");
    }
}
