//! The tables of theory/identifiability.md, confusable effects: what an effect leaves of a surge run when the vehicle's
//! coefficients are refitted to first order, and what of that another effect makes as well.

#![allow(clippy::unwrap_used, clippy::panic)] // a test

use fixture::lshpi_rig;
use hydroline_rigs::channel::Channel;
use hydroline_rigs::{ParameterValue, PhysicsEntry};
use hydroline_sim::Model;
use hydroline_sim::effect::{CheckedEffect, EffectStack, check, find};
use hydroline_sim::model::ModelState;
use hydroline_sim::vehicle::Hydrodynamics;
use hydroline_sim::whole::{Course, run};
use nalgebra::{DMatrix, DVector};
use std::f64::consts::TAU;

#[path = "../../tests/support/lshpi_rig.rs"]
mod fixture;

type Loads = Vec<(f64, [f64; 6])>;

/// Loads in surge from these times on, and the run's length \[s\].
fn held(loads: &[(f64, f64)], length_s: f64) -> (Loads, f64) {
    let each = loads.iter();
    let wrench = |x: f64| [x, 0.0, 0.0, 0.0, 0.0, 0.0];
    (each.map(|(t, x)| (*t, wrench(*x))).collect(), length_s)
}

/// `surge-4n` and `surge-8n`.
fn of_the_paper() -> Vec<(Loads, f64)> {
    vec![held(&[(0.0, 4.0)], 15.42), held(&[(0.0, 8.0)], 9.8)]
}

/// `reversals`, `coast-down` and `two-tone`.
fn that_split() -> Vec<(Loads, f64)> {
    let turns = [
        (0.0, 8.0),
        (4.0, -8.0),
        (10.0, 8.0),
        (16.0, -8.0),
        (22.0, 8.0),
    ];
    let tone = |t: f64| match t {
        t if t < 20.0 => 16.0 * (TAU * t / 10.0 + 75f64.to_radians()).sin(),
        t => 24.0 * (TAU * (t - 20.0) / 3.0 + 0.25 * TAU).sin(),
    };
    let tones: Vec<(f64, f64)> = (0..800)
        .map(|k| (0.04 * f64::from(k), tone(0.04 * f64::from(k))))
        .collect();
    vec![
        held(&turns, 25.0),
        held(&[(0.0, 8.0), (6.0, 0.0)], 18.0),
        held(&tones, 32.0),
    ]
}

/// Positions \[mm\] of all runs, end to end.
fn positions(
    runs: &[(Loads, f64)],
    vehicle: &Hydrodynamics,
    effects: &[CheckedEffect],
) -> DVector<f64> {
    let mut all = Vec::new();
    for (commands, length_s) in runs {
        let stamps_s: Vec<f64> = (1..=(length_s * 25.0) as usize)
            .map(|k| 0.04 * k as f64)
            .collect();
        let model = Model {
            hydrodynamics: vehicle.clone(),
            effects: EffectStack::assemble(effects, |_, _, v| v).unwrap(),
        };
        let course = Course {
            start_s: 0.0,
            commands,
            stamps_s: &stamps_s,
            step_max_s: 0.005,
            given: None,
        };
        run(&model, &course, ModelState::at_rest([0.0; 6]), |state| {
            all.push(1e3 * state[Channel::X])
        });
    }
    DVector::from_vec(all)
}

/// At its typical size, in surge.
fn typical(id: &str) -> CheckedEffect {
    if id != "current" {
        return CheckedEffect::typical(find(id).unwrap());
    }
    let along = ("vx_mps".to_owned(), ParameterValue::Number(0.005));
    let entry = PhysicsEntry {
        effect: id.to_owned(),
        parameters: [along].into_iter().collect(),
    };
    check(&[entry]).unwrap().remove(0)
}

/// Motion that each effect leaves after the refit \[mm\].
struct Left<'a>(Vec<(&'a str, DVector<f64>)>);

impl<'a> Left<'a> {
    fn new(runs: &[(Loads, f64)], ids: &[&'a str]) -> Self {
        let vehicle = Hydrodynamics::new(&lshpi_rig().vehicle);
        let own = |by: [f64; 3]| {
            let mut v = vehicle.clone();
            (v.added[0], v.linear[0], v.quadratic[0]) = (
                v.added[0] * by[0],
                v.linear[0] * by[1],
                v.quadratic[0] * by[2],
            );
            positions(runs, &v, &[])
        };
        let slope = |i: usize| {
            let at = |h: f64| own(std::array::from_fn(|j| if i == j { 1.0 + h } else { 1.0 }));
            at(1e-3) - at(-1e-3)
        };
        let basis = DMatrix::from_columns(&[slope(0), slope(1), slope(2)])
            .qr()
            .q();
        let none = positions(runs, &vehicle, &[]);
        let of = |id: &&'a str| {
            let moved = positions(runs, &vehicle, &[typical(id)]) - &none;
            (*id, &moved - &basis * basis.tr_mul(&moved))
        };
        Left(ids.iter().map(of).collect())
    }

    fn of(&self, id: &str) -> &DVector<f64> {
        &self.0.iter().find(|l| l.0 == id).unwrap().1
    }

    fn rms(&self, id: &str) -> f64 {
        self.of(id).norm() / (self.of(id).len() as f64).sqrt()
    }

    fn cos(&self, a: &str, b: &str) -> f64 {
        self.of(a).normalize().dot(&self.of(b).normalize())
    }

    /// Rms that an effect leaves where the other's size is fitted too \[mm\].
    fn beside(&self, id: &str, other: &str) -> f64 {
        self.rms(id) * (1.0 - self.cos(id, other).powi(2)).max(0.0).sqrt()
    }
}

const FIVE: [&str; 5] = [
    "thruster_deadband",
    "thruster_saturation",
    "current",
    "constant_force",
    "coulomb_friction",
];
const LATE: [&str; 3] = ["thruster_lag", "command_latency", "camera_latency"];
const SCALES: [&str; 2] = ["thrust_scale", "position_scale"];
const ASTERN: [&str; 2] = ["thrust_asymmetry", "astern_drag"];

#[test]
fn the_papers_runs_cannot_tell_five_effects_apart_nor_three_delays() {
    let left = Left::new(
        &of_the_paper(),
        &[&FIVE[..], &LATE, &SCALES, &ASTERN].concat(),
    );
    for set in [&FIVE[..], &LATE] {
        for (a, b) in set.iter().flat_map(|a| set.iter().map(move |b| (a, b))) {
            assert!(left.cos(a, b).abs() > 0.997, "{a} {b}: {}", left.cos(a, b));
        }
    }
    for id in ASTERN {
        assert_eq!(left.of(id).norm(), 0.0, "{id}");
    }
    for id in SCALES {
        assert!(left.rms(id) < 0.003, "{id}: {}", left.rms(id));
    }
}

#[test]
fn reversals_coast_down_and_two_tones_split_all_but_latencies_and_scales() {
    let all = [&FIVE[..], &LATE, &SCALES, &ASTERN, &["fluid_memory"]].concat();
    let left = Left::new(&that_split(), &all);
    // (effect, left, nearest, left beside it), as printed.
    let rows = [
        ("command_latency", 3.4, "camera_latency", 0.05),
        ("thruster_lag", 8.1, "command_latency", 0.86),
        ("fluid_memory", 1.8, "thruster_lag", 0.57),
        ("thruster_deadband", 1.9, "thruster_saturation", 0.21),
        ("current", 35.0, "constant_force", 1.8),
        ("thrust_asymmetry", 153.0, "current", 12.0),
        ("astern_drag", 39.0, "current", 3.2),
        ("coulomb_friction", 0.64, "thrust_asymmetry", 0.34),
    ];
    for (id, alone, other, beside) in rows {
        let found = (left.rms(id), left.beside(id, other));
        println!("{id} {found:.4?} {other} {:.4}", left.cos(id, other));
        assert!((found.0 / alone - 1.0).abs() < 0.06, "{id}: {found:?}");
        assert!(
            (found.1 / beside - 1.0).abs() < 0.12,
            "{id} beside {other}: {found:?}"
        );
    }
    for id in SCALES {
        assert!(left.rms(id) < 0.02, "{id}: {}", left.rms(id));
    }
}
