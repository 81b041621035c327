//! A force of no known effect is written down, and the rig that holds it predicts what no run has shown.
#![allow(clippy::unwrap_used)] // a test

use crate::diagnose_motion::{clean, simulated};
use hydroline::diagnose::verdict::Word;
use hydroline::diagnose::{Source, diagnose};
use hydroline_rigs::{ParameterValue, PhysicsEntry, Rig};

/// Something at one place of the tank: 1.2 N exp(-((x - 0.3) / 0.1)^2 / 2).
const FORCE: [(&str, f64); 3] = [("force", 1.2), ("at", 0.3), ("width", 0.1)];

fn bump() -> PhysicsEntry {
    let number = |v: f64| ParameterValue::Number(v);
    let word = |w: &str| ParameterValue::Word(w.to_owned());
    let all = [
        ("dof", word("surge")),
        ("along", word("x")),
        ("first", word("bump")),
        ("first_n", number(FORCE[0].1)),
        ("first_at", number(FORCE[1].1)),
        ("first_width", number(FORCE[2].1)),
    ];
    PhysicsEntry {
        effect: "written_force".to_owned(),
        parameters: all.map(|(n, v)| (n.to_owned(), v)).to_vec(),
    }
}

#[test]
fn an_unnamed_force_is_written_down_and_predicts_twice_the_load() {
    let rig = Rig::builtin("lshpi").unwrap();
    let mut water = rig.clone();
    water.vehicle.coefficients[0].linear *= 1.15;
    water.physics.push(bump());
    let edges: [&[(f64, f64)]; 4] = [
        &[(0.0, 5.0), (9.0, -3.0)],
        &[(0.0, 8.0), (6.0, -8.0), (12.0, 0.0)],
        &[(0.0, 10.0), (5.0, -6.0)],
        &[(0.0, -5.0), (4.0, 9.0), (9.0, 2.0)],
    ];
    let names = ["a", "b", "c", "d"];
    let each = names.iter().zip(edges).zip(1..);
    let runs: Vec<Source> = each
        .map(|((name, edges), seed)| clean(simulated(&water, name, edges, seed)))
        .collect();
    let found = diagnose(&runs, &[], &rig, &|_| {}).unwrap();
    let v = &found.verdict;
    println!("{}", v.sentence);
    assert_eq!(v.verdict, Word::Unknown, "{}", v.sentence);
    let form = v.unexplained[0].closed_form.as_ref().unwrap();
    println!("{form:?}");
    assert!(form.sure && form.written, "{}", form.sentence);
    let pieces = &form.forms[0].pieces;
    assert_eq!(pieces.len(), 1);
    assert_eq!(pieces[0].form, "bump");
    for (name, truth) in FORCE {
        let n = pieces[0].numbers[name];
        let sd = n.sd.unwrap();
        assert!((n.value - truth).abs() < 4.0 * sd, "{name}: {n:?}");
        assert!(sd < 0.1 * truth, "{name}: {n:?}");
    }
    // The rig that is written holds the expression; runs of twice the load are predicted from rest.
    let written = &found.rig.physics;
    assert!(written.iter().any(|e| e.effect == "written_force"));
    let hard: &[(f64, f64)] = &[(0.0, 18.0), (4.0, -16.0), (9.0, 20.0)];
    let (truth, predicted) = (
        simulated(&water, "hard", hard, 7),
        simulated(&found.rig, "hard", hard, 7),
    );
    let pairs = truth.samples.iter().zip(&predicted.samples);
    let square: f64 = pairs
        .map(|(a, b)| (a.values[0] - b.values[0]).powi(2))
        .sum();
    let rms_m = (square / truth.samples.len() as f64).sqrt();
    println!("off by {:.2} mm at twice the load", rms_m * 1e3);
    assert!(rms_m < 1e-3, "{rms_m}");
}
