//! Findings of a search in runs that are simulated.

use super::*;
use crate::posterior::Posterior;
use crate::prior::PriorTable;
use crate::recording::Recording;
use crate::tests::fixtures::{Tank, entry};
use hydroline_rigs::PhysicsEntry;

/// Search over short runs, which every day has time for.
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
