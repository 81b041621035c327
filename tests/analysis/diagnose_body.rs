//! The verdict by one likelihood: what does not change its verdict, and what does.
#![allow(clippy::unwrap_used)] // a test

use crate::diagnose_motion::{clean, simulated};
use hydroline::diagnose::verdict::{Verdict, Word};
use hydroline::diagnose::{Source, diagnose};
use hydroline_rigs::{ParameterValue, PhysicsEntry, Rig};

fn water() -> Rig {
    let mut water = Rig::builtin("lshpi").unwrap();
    water.vehicle.coefficients[0].linear *= 1.15;
    water.physics.push(PhysicsEntry {
        effect: "thruster_lag".to_owned(),
        parameters: vec![
            ("lag_s".to_owned(), ParameterValue::Number(0.3)),
            ("dof".to_owned(), ParameterValue::Word("surge".to_owned())),
        ],
    });
    water
}

fn runs(water: &Rig) -> Vec<Source> {
    let edges: [&[(f64, f64)]; 4] = [
        &[(0.0, 4.0), (9.0, 0.0)],
        &[(0.0, 8.0), (6.0, -8.0), (12.0, 0.0)],
        &[(0.0, 12.0), (5.0, -6.0)],
        &[(0.0, -5.0), (4.0, 9.0), (9.0, 2.0)],
    ];
    let names = ["a", "b", "c", "d"];
    let each = names.iter().zip(edges).zip(1..);
    each.map(|((name, edges), seed)| clean(simulated(water, name, edges, seed)))
        .collect()
}

fn asked(sources: &[Source], held: &[Source], rig: &Rig) -> Verdict {
    let found = diagnose(sources, held, rig, &|_| {}).unwrap();
    println!("{:?}: {}", found.verdict.verdict, found.verdict.sentence);
    found.verdict
}

fn probabilities(v: &Verdict) -> Vec<(String, f64)> {
    let mut all: Vec<_> = v
        .effects
        .iter()
        .map(|e| (e.effect.clone(), e.probability))
        .collect();
    all.sort_by(|a, b| a.0.cmp(&b.0));
    all
}

/// The same five logs with the last two swapped established an effect that was not there.
#[test]
fn the_order_of_logs_changes_nothing() {
    let rig = Rig::builtin("lshpi").unwrap();
    let all = runs(&water());
    let (fitted, held) = all.split_at(2);
    let first = asked(fitted, held, &rig);
    assert_eq!(first.verdict, Word::Named, "{}", first.sentence);
    let turned = |s: &[Source]| -> Vec<Source> { s.iter().rev().cloned().collect() };
    let second = asked(&turned(fitted), &turned(held), &rig);
    assert_eq!(first.sentence, second.sentence);
    assert_eq!(probabilities(&first), probabilities(&second));
    // Held-out runs choose nothing: without them the verdict is the same.
    let third = asked(fitted, &[], &rig);
    assert_eq!(first.sentence, third.sentence);
    assert_eq!(probabilities(&first), probabilities(&third));
}

/// A rig may be off by five: hidden bounds on coefficients made effects of what a coefficient is.
#[test]
fn a_rig_that_is_far_off_gets_the_same_verdict_and_is_reported() {
    let all = runs(&water());
    for (factor, left_out) in [(0.2, true), (5.0, true), (3.0, false)] {
        let mut rig = Rig::builtin("lshpi").unwrap();
        let own = &mut rig.vehicle.coefficients[0];
        own.added *= factor;
        own.linear *= factor;
        own.quadratic *= factor;
        let seen = if left_out {
            all.clone()
        } else {
            runs(&Rig::builtin("lshpi").unwrap())
        };
        let v = asked(&seen, &[], &rig);
        let heavy: Vec<&str> = v
            .effects
            .iter()
            .filter(|e| e.matters)
            .map(|e| e.effect.as_str())
            .collect();
        let expected: &[&str] = if left_out { &["thruster_lag"] } else { &[] };
        assert_eq!(heavy, expected, "{factor}: {}", v.sentence);
        let word = if left_out { Word::Named } else { Word::None };
        assert_eq!(v.verdict, word, "{factor}: {}", v.sentence);
        let found = v.at_limit.iter().find(|c| c.key == "x_udot").unwrap();
        assert!(
            (found.factor * factor - 1.0).abs() < 0.1,
            "{factor}: {found:?}"
        );
    }
}

/// A rig with what was left out had no covariance: nothing could be predicted of it with a band, and coefficients
/// identified beside an effect held fixed were too sure.
#[test]
fn the_rig_that_is_found_says_how_well_its_coefficients_are_known() {
    let rig = Rig::builtin("lshpi").unwrap();
    let water = water();
    let mut squares = Vec::new();
    // Each pair of runs is another sample of the noise.
    let all = runs(&water);
    for pair in [[0, 1], [1, 2], [2, 3], [0, 3]] {
        let fitted = pair.map(|i| all[i].clone());
        let found = diagnose(&fitted, &[], &rig, &|_| {}).unwrap();
        let text = found.rig.to_toml();
        let written = Rig::from_toml(&text, "found.toml", None).unwrap();
        let known = written.identified.unwrap();
        assert_eq!(known.coefficients, ["x_udot", "x_u", "x_uu"]);
        let truth = water.vehicle.coefficients[0];
        let truth = [truth.added, truth.linear, truth.quadratic];
        for (i, truth) in truth.into_iter().enumerate() {
            let off = (known.values[i] - truth) / known.sd[i];
            println!("{}: {off:.2} sd", known.coefficients[i]);
            squares.push(off * off);
        }
    }
    let rms = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
    // Twelve numbers, three by three correlated, of runs that overlap.
    assert!((0.3..2.0).contains(&rms), "{rms}");
}
