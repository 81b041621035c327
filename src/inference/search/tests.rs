//! What a search finds in runs that are simulated.

use super::*;
use crate::posterior::Posterior;
use crate::prior::PriorTable;
use crate::recording::Recording;
use crate::testing::{Tank, entry};
use hydroline_rigs::{PhysicsEntry, Rig};
use std::time::Instant;

fn cases() -> Vec<(&'static str, Vec<usize>, Vec<PhysicsEntry>)> {
    let lag = |dof: &str| vec![entry("thruster_lag", &[("lag_s", 0.25)], &[("dof", dof)])];
    let cross = |dof: &str, a: &str, b: &str, c: f64| {
        vec![entry(
            "cross_flow_coupling",
            &[("c", c)],
            &[("dof", dof), ("a", a), ("b", b)],
        )]
    };
    vec![
        ("surge-nothing", vec![0], vec![]),
        ("surge-lag", vec![0], lag("surge")),
        ("planar-nothing", vec![0, 1, 5], vec![]),
        ("planar-lag-yaw", vec![0, 1, 5], lag("yaw")),
        (
            "planar-current",
            vec![0, 1, 5],
            vec![entry(
                "current",
                &[("vx_mps", -0.012), ("vy_mps", 0.008)],
                &[],
            )],
        ),
        ("planar-cross", vec![0, 1, 5], cross("yaw", "u", "r", -8.0)),
        (
            "planar-latency",
            vec![0, 1, 5],
            vec![entry("command_latency", &[("delay_s", 0.1)], &[])],
        ),
        (
            "surge-pitch",
            vec![0],
            vec![entry(
                "thrust_line_offset",
                &[("lever_m", 0.02)],
                &[("axis", "pitch")],
            )],
        ),
        ("surge-bump", vec![0], vec![bump()]),
        (
            "surge-two",
            vec![0],
            vec![
                entry("thruster_lag", &[("lag_s", 0.2)], &[("dof", "surge")]),
                entry("constant_force", &[("bias_n", 0.2)], &[("dof", "surge")]),
            ],
        ),
    ]
}

/// Short runs, so that every day has its share; `a_few_cases` has more.
fn short(driven: &[usize], effects: Vec<PhysicsEntry>, seed: u64) -> (Found, Posterior) {
    let tank = Tank {
        seconds: 12.0,
        hz: 12.5,
        ..Tank::new(driven, effects)
    };
    let runs = tank.runs(3, seed);
    let dofs = Recording::new(&runs, 0.1).moving(&tank.rig.tolerance.channels());
    let problem = Problem::new(&runs, &tank.rig, &dofs, PriorTable::default()).unwrap();
    let found = search(problem, Options::default(), &|_| {}).unwrap();
    let posterior = Posterior::new(&found);
    (found, posterior)
}

fn probability(found: &Found, posterior: &Posterior, name: &str) -> f64 {
    let body = &found.problem.body;
    let of = posterior
        .effects
        .iter()
        .find(|e| body.candidates[e.candidate].name() == name);
    of.map_or(0.0, |e| e.probability)
}

#[test]
fn nothing_left_out_is_nothing_found() {
    for driven in [&[0][..], &[0, 1, 5]] {
        let (_, posterior) = short(driven, vec![], 3);
        let nothing = posterior.models.iter().find(|m| m.0.is_empty()).unwrap();
        assert!(nothing.1 > 0.5, "{posterior:?}");
        assert!(
            posterior.effects.iter().all(|e| e.probability < 0.5),
            "{posterior:?}"
        );
        assert!(posterior.unnamed.iter().all(|u| u.1 < 0.1), "{posterior:?}");
    }
}

/// A lag in yaw alone, while surge and sway are driven as well, gave no verdict in ten minutes.
#[test]
fn a_lag_of_one_dof_of_three_is_named_there() {
    let lag = entry("thruster_lag", &[("lag_s", 0.25)], &[("dof", "yaw")]);
    let (found, posterior) = short(&[0, 1, 5], vec![lag], 4);
    assert!(
        probability(&found, &posterior, "thruster_lag yaw") > 0.95,
        "{posterior:?}"
    );
    let best = &found.models[&posterior.models[0].0];
    let body = &found.problem.body;
    let member = best
        .terms
        .iter()
        .position(|t| body.candidates[*t].name() == "thruster_lag yaw")
        .unwrap();
    let at = body.places(&best.terms)[member];
    let (lag_s, slope) = body.natural(&best.terms, &best.point)[at];
    let sd = slope * best.covariance[(at, at)].sqrt();
    assert!((lag_s - 0.25).abs() < 4.0 * sd && sd < 0.01, "{lag_s} {sd}");
}

/// Surge runs that pitch, which no command asks for, were taken for complete.
#[test]
fn a_dof_that_nobody_commanded_is_looked_at() {
    let offset = entry(
        "thrust_line_offset",
        &[("lever_m", 0.03)],
        &[("axis", "pitch")],
    );
    let (found, posterior) = short(&[0], vec![offset], 5);
    assert!(found.problem.body.dofs.contains(&4));
    assert!(
        probability(&found, &posterior, "thrust_line_offset pitch") > 0.95,
        "{posterior:?}"
    );
}

/// A force that no effect of the library is, at one place of the tank.
fn bump() -> PhysicsEntry {
    let points: Vec<(String, f64)> = (0..40)
        .map(|k| {
            let x_m = -1.0 + 2.0 * f64::from(k) / 39.0;
            let force_n = 1.2 * (-((x_m - 0.2) / 0.1_f64).powi(2)).exp();
            (format!("f{:02}_n", k + 1), force_n)
        })
        .collect();
    let mut numbers: Vec<(&str, f64)> = vec![("from", -1.0), ("to", 1.0)];
    numbers.extend(points.iter().map(|(n, v)| (n.as_str(), *v)));
    entry("free_force", &numbers, &[("dof", "surge"), ("along", "x")])
}

/// Such a force was explained by whatever came nearest.
#[test]
fn an_unnamed_force_is_a_table_and_no_effect() {
    let (found, posterior) = short(&[0], vec![bump()], 6);
    let table = probability(&found, &posterior, "free_force surge x");
    assert!(table > 0.9, "{posterior:?}");
}

/// What a search finds, for eyes.
fn report(problem: Problem, begun: Instant) {
    for d in &problem.body.dofs {
        println!(
            "   {d} {:?} {:?}",
            problem.noises.channels[*d], problem.body.responses[*d]
        );
    }
    let found = search(problem, Options::default(), &|what| {
        println!("   {:.1} s {what}", begun.elapsed().as_secs_f64());
    })
    .unwrap();
    let body = &found.problem.body;
    let dofs = &body.dofs;
    let posterior = Posterior::new(&found);
    println!(
        "   {} fits, {:.1} s",
        found.fits,
        begun.elapsed().as_secs_f64()
    );
    for (terms, p) in posterior.models.iter().take(6) {
        let fit = &found.models[terms];
        let names: Vec<String> = terms.iter().map(|t| body.candidates[*t].name()).collect();
        let places = body.places(terms);
        let natural = body.natural(terms, &fit.point);
        let numbers: Vec<String> = natural[places[0]..places[terms.len()]]
            .iter()
            .zip(places[0]..)
            .map(|(v, i)| {
                format!(
                    "{:.4}±{:.4}",
                    v.0,
                    v.1.abs() * fit.covariance[(i, i)].sqrt()
                )
            })
            .collect();
        let cells: Vec<_> = dofs
            .iter()
            .map(|d| (fit.cells.misfit[*d].size, fit.cells.misfit[*d].correlation))
            .collect();
        println!(
            "   p {p:.4} {:.2} {names:?} {numbers:?} {cells:?}",
            fit.ln_score
        );
    }
    for e in posterior.effects.iter().take(8) {
        println!(
            "   {:.4} {}",
            e.probability,
            body.candidates[e.candidate].name()
        );
    }
    let best = &found.models[&posterior.models[0].0];
    let natural = body.natural(&best.terms, &best.point);
    for (i, own) in body.own.iter().enumerate() {
        let ratio = best.point[i].exp();
        println!(
            "   {} {:.4} = {ratio:.3} of the rig's, ±{:.3}",
            own.name(),
            natural[i].0,
            best.covariance[(i, i)].sqrt()
        );
    }
    let short = |r: [f64; 12]| -> Vec<String> {
        r.iter()
            .filter(|v| v.is_finite())
            .map(|v| format!("{v:.2e}"))
            .collect()
    };
    println!(
        "   alone {:?}",
        short(found.problem.left(&[], &found.models[&Vec::new()].point))
    );
    println!(
        "   best  {:?}",
        short(found.problem.left(&best.terms, &best.point))
    );
    for (t, w) in best.terms.iter().zip(found.problem.weights(best)) {
        println!("   weight {} {:?}", body.candidates[*t].name(), short(w));
    }
    println!("   unnamed {:?}", posterior.unnamed);
    for d in dofs {
        println!(
            "   noise {d} {:?} {:?}",
            found.problem.noises.channels[*d],
            found.problem.noises.channels[6 + *d]
        );
    }
}

/// `RIG=rig.toml LOGS="a.mcap b.mcap" cargo test -p hydroline-inference --lib of_logs -- --ignored --nocapture`
#[test]
#[ignore]
fn of_logs() {
    let rig = std::env::var("RIG").unwrap_or_else(|_| "lshpi".to_owned());
    let rig = Rig::load_or_builtin(&rig).unwrap();
    let logs = std::env::var("LOGS").unwrap();
    let runs: Vec<_> = logs
        .split_whitespace()
        .map(|l| hydroline_identify::data::load(std::path::Path::new(l), &rig).unwrap())
        .collect();
    let begun = Instant::now();
    let dofs = Recording::new(&runs, 0.0).moving(&rig.tolerance.channels());
    println!("== {logs} dofs {dofs:?}");
    report(
        Problem::new(&runs, &rig, &dofs, PriorTable::default()).unwrap(),
        begun,
    );
}

/// `CASE=name SEED=n cargo test -p hydroline-inference --lib a_few -- --ignored --nocapture`
#[test]
#[ignore]
fn a_few_cases() {
    let one = std::env::var("CASE").unwrap_or_default();
    let seed: u64 = std::env::var("SEED")
        .ok()
        .and_then(|s| s.parse().ok())
        .unwrap_or(1);
    for (name, driven, effects) in cases() {
        if !name.contains(&one) {
            continue;
        }
        let tank = Tank::new(&driven, effects);
        let runs = tank.runs(4, seed);
        let begun = Instant::now();
        let recording = Recording::new(&runs, 0.1);
        let dofs = recording.moving(&tank.rig.tolerance.channels());
        let problem = Problem::new(&runs, &tank.rig, &dofs, PriorTable::default()).unwrap();
        println!(
            "== {name} dofs {dofs:?}, noise at {:.1} s",
            begun.elapsed().as_secs_f64()
        );
        report(problem, begun);
    }
}
