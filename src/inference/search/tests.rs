//! Findings of a search in runs that are simulated.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use super::*;
use crate::limit::Cause;
use crate::posterior::Posterior;
use crate::prior::PriorTable;
use crate::recording::Recording;
use crate::tests::fixtures::{Tank, entry};
use hydroline_rigs::PhysicsEntry;

/// Problem of short runs, which every day has time for.
fn problem(driven: &[usize], effects: Vec<PhysicsEntry>, seed: u64) -> Problem {
    let tank = Tank {
        seconds: 12.0,
        hz: 12.5,
        ..Tank::new(driven, effects)
    };
    let runs = tank.runs(3, seed);
    let dofs = Recording::new(&runs, 0.1).moving(&tank.rig.tolerance.channels());
    Problem::new(&runs, &tank.rig, &dofs, PriorTable::default()).unwrap()
}

/// Search over short runs.
fn short(driven: &[usize], effects: Vec<PhysicsEntry>, seed: u64) -> (Found, Posterior) {
    let problem = problem(driven, effects, seed);
    let found = search(problem, Options::default(), Watch::unlimited(&|_| {})).unwrap();
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

#[test]
fn a_limit_that_is_over_leaves_the_vehicle_alone_and_says_what_is_open() {
    let lag = entry("thruster_lag", &[("lag_s", 0.25)], &[("dof", "surge")]);
    let watch = Watch {
        progress: &|_| {},
        limit: Limit::after(Duration::ZERO),
    };
    let found = search(problem(&[0], vec![lag], 4), Options::default(), watch).unwrap();
    let visited: Vec<&Vec<usize>> = found.models.keys().collect();
    assert_eq!(visited, [&Vec::<usize>::new()]);
    assert_eq!(found.account.cause, Some(Cause::Time));
    assert_eq!(found.account.steps, 0);
    assert_eq!(found.account.last, "the vehicle alone");
    let first = found.account.open.first();
    assert_eq!(first.map(String::as_str), Some("beside the vehicle alone"));
    assert!(found.given_up.is_empty());
}

/// Wish of the test below; it is alone with it.
static WISH: AtomicBool = AtomicBool::new(false);

/// Models that the search looked beside, in turn; the wish to end is said while it looks beside so many.
fn looked_beside(end_at: Option<usize>) -> (Found, Vec<String>) {
    WISH.store(false, Ordering::Relaxed);
    let heard = Mutex::new(Vec::new());
    let progress = |what: &str| {
        let mut heard = heard.lock().unwrap();
        // Without the share of the budget and the best so far.
        let model = what.split(" (").next().unwrap_or(what);
        heard.push(model.to_owned());
        if end_at == Some(heard.len()) {
            WISH.store(true, Ordering::Relaxed);
        }
    };
    let watch = Watch {
        progress: &progress,
        limit: Limit::NONE.interrupted_by(|| WISH.load(Ordering::Relaxed)),
    };
    let lag = |dof| entry("thruster_lag", &[("lag_s", 0.25)], &[("dof", dof)]);
    let problem = problem(&[0, 5], vec![lag("surge"), lag("yaw")], 4);
    // Under one noise all models that were visited are kept.
    let options = Options {
        cost: 60,
        renewed_after: f64::INFINITY,
        noise_rounds: 0,
        shorter_gain: f64::INFINITY,
        ..Options::default()
    };
    let found = search(problem, options, watch).unwrap();
    (found, heard.into_inner().unwrap())
}

#[test]
fn a_limit_truncates_the_search_and_does_not_change_its_order() {
    let (whole, all) = looked_beside(None);
    assert_eq!(whole.account.cause, None);
    assert_eq!(whole.account.steps, all.len());
    assert!(all.len() >= 2, "{all:?}");
    // The wish comes when the second model is looked beside: no fit of that step begins, and it is open.
    let (cut, some) = looked_beside(Some(2));
    assert_eq!(some, all[..2]);
    assert_eq!(cut.account.cause, Some(Cause::Interrupt));
    assert_eq!((cut.account.steps, &cut.account.last), (1, &all[0]));
    assert!(cut.account.open.contains(&all[1]), "{:?}", cut.account);
    assert!(cut.models.len() < whole.models.len());
    assert!(cut.models.keys().all(|m| whole.models.contains_key(m)));
}
