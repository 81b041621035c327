use super::*;
use crate::fit::Effort;
use crate::hyper::{Cell, Cells};
use crate::limit::Account;
use crate::prior::PriorTable;
use crate::tests::fixtures::{Tank, entry};
use hydroline_core::run::Channel;
use hydroline_rigs::{ParameterValue, PhysicsEntry};
use hydroline_sim::effect::covariate_table::POINTS;
use hydroline_sim::effect::form::FORMS;
use rand::{RngExt, SeedableRng, rngs::StdRng};

/// A force in surge as a table, which no grammar has to hold.
fn by_points(along: &str, range: (f64, f64), law: impl Fn(f64) -> f64) -> PhysicsEntry {
    let step = (range.1 - range.0) / (POINTS - 1) as f64;
    let mut made = entry(
        "free_force",
        &[("from", range.0), ("to", range.1)],
        &[("dof", "surge"), ("along", along)],
    );
    for k in 0..POINTS {
        let value = law(range.0 + step * k as f64);
        made.parameters
            .push((format!("f{:02}_n", k + 1), ParameterValue::Number(value)));
    }
    made
}

fn written(along: &str, pieces: &[(&str, [f64; 3])]) -> PhysicsEntry {
    let mut made = entry("written_force", &[], &[("dof", "surge"), ("along", along)]);
    for ((form, numbers), which) in pieces.iter().zip(["first", "second"]) {
        let word = ParameterValue::Word((*form).to_owned());
        made.parameters.push((which.to_owned(), word));
        for (v, name) in numbers.iter().zip(["n", "at", "width"]) {
            made.parameters
                .push((format!("{which}_{name}"), ParameterValue::Number(*v)));
        }
    }
    made
}

/// A force drawn by the seed: (what it is, how the simulator runs it).
fn drawn(seed: u64) -> (String, &'static str, PhysicsEntry) {
    let mut rng = StdRng::seed_from_u64(seed);
    let mut between = |a: f64, b: f64| a + (b - a) * rng.random::<f64>();
    let a = between(0.4, 1.6) * if between(0.0, 1.0) < 0.5 { -1.0 } else { 1.0 };
    let (x, u) = (between(-0.5, 0.5), between(0.06, 0.15));
    let drag = -a.abs();
    let (along, pieces): (&str, Vec<(&str, [f64; 3])>) = match seed % 12 {
        0 => ("x", vec![("bump", [a, x, between(0.06, 0.2)])]),
        1 => (
            "u",
            vec![("odd_power", [3.0 * drag, between(2.6, 4.0), 0.25])],
        ),
        2 => (
            "x",
            vec![("wave", [a, between(-3.0, 3.0), between(0.3, 0.8)])],
        ),
        3 => ("u", vec![("odd_bump", [drag, u, between(0.015, 0.04)])]),
        4 => ("x", vec![("beyond", [2.0 * drag, x, 0.5])]),
        5 => ("u", vec![("odd_beyond", [3.0 * drag, u, 0.1])]),
        6 => ("x", vec![("step", [a, x, between(0.02, 0.2)])]),
        7 => (
            "u",
            vec![("odd_power", [2.0 * drag, between(0.3, 0.7), 0.25])],
        ),
        8 => ("x", vec![("bump", [a, x, 0.1]), ("wave", [0.6, 1.0, 0.5])]),
        _ => {
            let c = between(0.2, 0.5);
            let w = between(0.1, 0.2);
            let made = match seed % 12 {
                // No form of the grammar has these.
                9 => (
                    "soft tanh of u".to_owned(),
                    "u",
                    by_points("u", (-0.6, 0.6), |v| drag * (v / (0.2 * w)).tanh()),
                ),
                10 => (
                    "Lorentz of x".to_owned(),
                    "x",
                    by_points("x", (-3.0, 3.0), |v| a / (1.0 + ((v - x) / w).powi(2))),
                ),
                _ => (
                    "three bumps of x".to_owned(),
                    "x",
                    by_points("x", (-3.0, 3.0), |v| {
                        let b = |at: f64| (-0.5 * ((v - at) / (0.6 * w)).powi(2)).exp();
                        a * (b(x) - 0.7 * b(x + c) + 0.6 * b(x - c))
                    }),
                ),
            };
            return made;
        }
    };
    let name = format!("{pieces:.3?} of {along}");
    (name, along, written(along, &pieces))
}

/// The table alone beside the vehicle, fitted, and written down.
fn asked(tank: &Tank, along: &str, seed: u64) -> Option<(Found, Closed)> {
    let runs = tank.runs(4, seed);
    let problem = Problem::new(&runs, &tank.rig, &[0], PriorTable::default()).ok()?;
    let wanted = format!("free_force surge {along}");
    let table = problem
        .body
        .candidates
        .iter()
        .position(|c| c.name() == wanted)?;
    let cell = Cell {
        size: 8,
        correlation: 1,
    };
    let cells = Cells::of([cell; 6]);
    let alone = problem.fit(&[], &problem.body.begin(), cells, Effort::default())?;
    let (terms, point) = problem.with(&alone, table, &[0.0; POINTS]);
    let fit = problem.fit(&terms, &point, alone.cells.clone(), Effort::default())?;
    let mut found = Found {
        problem,
        models: [(alone.terms.clone(), alone), (terms, fit.clone())].into(),
        fits: 2,
        given_up: Vec::new(),
        account: Account::default(),
    };
    let info = find("written_force")?;
    let one = one(&mut found, info, table, &fit, Limit::NONE)?;
    Some((found, one))
}

fn names(found: &Found, form: &Form) -> Vec<&'static str> {
    let c = &found.problem.body.candidates[form.candidate];
    c.words[2..4].iter().map(|w| FORMS[*w]).collect()
}

#[test]
fn a_bump_is_written_down_and_three_are_not() {
    let of = |seed: u64| {
        let (_, along, effect) = drawn(seed);
        asked(&Tank::new(&[0], vec![effect]), along, seed).unwrap()
    };
    let (found, bump) = of(24);
    assert!(bump.replaces_table && bump.none < 0.01, "{}", bump.none);
    assert_eq!(names(&found, &bump.forms[0]), ["bump", "none"]);
    let (form, table) = bump.one_run_out.unwrap();
    let [form, table] = [form, table].map(|rms| rms[Channel::X]);
    assert!(form < table, "{form} {table}");
    let (_, three) = of(11);
    assert!(!three.replaces_table && three.none > 0.9, "{}", three.none);
}
