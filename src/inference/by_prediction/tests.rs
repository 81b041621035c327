//! Findings by the simulation error in runs that are simulated.

use super::*;
use crate::hyper::Tables;
use crate::limit::Limit;
use crate::prior::PriorTable;
use crate::recording::Recording;
use crate::search::{Options, search};
use crate::tests::fixtures::{Tank, entry};
use hydroline_core::run::Channel;
use hydroline_rigs::PhysicsEntry;

fn problem(effects: Vec<PhysicsEntry>, white_m: f64) -> Problem {
    let tank = Tank {
        seconds: 12.0,
        hz: 12.5,
        white: [white_m, 1e-4],
        coloured: 0.0,
        ..Tank::new(&[0], effects)
    };
    let runs = tank.runs(3, 5);
    let dofs = Recording::new(&runs, 0.1).moving(&tank.rig.tolerance.channels());
    Problem::new(&runs, &tank.rig, &dofs, PriorTable::default()).unwrap()
}

fn watch() -> Watch<'static> {
    Watch {
        progress: &|_| {},
        limit: Limit::NONE,
    }
}

/// Friction and drag that differs by direction: of the pair that is right either alone gains little.
fn friction_and_drag() -> Vec<PhysicsEntry> {
    vec![
        entry("coulomb_friction", &[("f_n", 1.5)], &[("dof", "surge")]),
        entry("astern_drag", &[("gain", 1.6)], &[("dof", "surge")]),
    ]
}

#[test]
fn two_laws_that_were_left_out_are_found_by_the_simulation_error() {
    let problem = problem(friction_and_drag(), 2e-5);
    let begin = problem.body.begin();
    let alone = problem.least_squares(&[], &begin, &Tables::new()).unwrap();
    let (laws, _) = problem.explained_most(&alone, watch()).unwrap();
    let names = problem.names(&laws.fit);
    assert!(
        names.contains(&"coulomb_friction surge".to_owned()),
        "{names:?}"
    );
    assert!(names.contains(&"astern_drag surge".to_owned()), "{names:?}");
}

#[test]
fn a_pair_is_worth_no_less_than_the_better_of_its_laws() {
    let problem = problem(friction_and_drag(), 2e-5);
    let begin = problem.body.begin();
    let alone = problem.least_squares(&[], &begin, &Tables::new()).unwrap();
    let coarse = problem.coarse(&problem.left(&[], &alone.point));
    let pairs = coarse.predicted_pairs(&alone);
    assert!(pairs.len() > 20);
    assert!(pairs.windows(2).all(|w| w[0].gain >= w[1].gain));
    let best = &pairs[0];
    assert!(best.gain >= best.better_alone - 1e-6, "{best:?}");
    assert!(best.members[0].0 != best.members[1].0);
}

/// Nothing is asked where no force and no table is left, and nothing is changed.
#[test]
fn a_law_that_explains_all_is_left_as_the_search_found_it() {
    let lag = entry("thruster_lag", &[("lag_s", 0.25)], &[("dof", "surge")]);
    let mut found = search(problem(vec![lag], 1.5e-4), Options::default(), watch()).unwrap();
    let before: Vec<Vec<usize>> = found.models.keys().cloned().collect();
    assert!(!decide_by_prediction(&mut found, None, watch()));
    assert!(found.models.keys().cloned().eq(before));
}

/// White noise is worth all its samples, and a slow error few of them.
#[test]
fn slow_errors_count_as_few_samples() {
    let nothing = problem(Vec::new(), 1.5e-4);
    let lag = problem(
        vec![entry(
            "thruster_lag",
            &[("lag_s", 0.4)],
            &[("dof", "surge")],
        )],
        1.5e-4,
    );
    let share = |p: &Problem| {
        let begin = p.body.begin();
        let fit = p.least_squares(&[], &begin, &Tables::new()).unwrap();
        p.independent_samples(&fit.terms, &fit.point)[Channel::X] / p.samples()[Channel::X]
    };
    let (white, slow) = (share(&nothing), share(&lag));
    assert!(white > 0.4 && slow < 0.3 * white, "{white} {slow}");
}
