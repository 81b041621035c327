//! Numbers of hulls that float or weigh, and of what waves do to them, found in runs that are simulated.

use hydroline_core::run::{Channel, Command, Companions, PerChannel, Run, Sample};
use hydroline_rigs::Rig;
use hydroline_sim::Given;
use hydroline_sim::given::Curve;
use hydroline_sim::model::{Model, ModelState};
use hydroline_sim::trajectory::Trajectory;
use rand::{SeedableRng, rngs::StdRng};
use rand_distr::{Distribution, StandardNormal};

use super::Body;
use crate::fit::{Effort, Fit, Problem};
use crate::hyper::{Cell, Cells};
use crate::noise::estimate;
use crate::prior::PriorTable;
use crate::recording::Recording;
use crate::tests::fixtures::{Tank, entry};

const HEAVE: usize = 2;

/// The built-in rig, floating at the height at which simulated runs begin.
fn floating(stiffness: [f64; 3], net_weight_n: f64) -> Rig {
    let mut rig = Rig::builtin("lshpi").unwrap();
    rig.vehicle.stiffness = stiffness;
    rig.vehicle.net_weight_n = net_weight_n;
    rig.vehicle.float_z_m = Some(1.0);
    rig
}

fn problem(runs: &[Run], rig: &Rig, dofs: &[usize]) -> Problem {
    Problem::new(runs, rig, dofs, PriorTable::default()).unwrap()
}

fn alone(problem: &Problem) -> Fit {
    let small = Cell {
        size: 1,
        correlation: 1,
    };
    let cells = Cells::of([small; 6]);
    let begin = problem.body.begin();
    problem.fit(&[], &begin, cells, Effort::DEFAULT).unwrap()
}

/// One of the vehicle's own numbers in a fit.
fn own(problem: &Problem, fit: &Fit, name: &str) -> f64 {
    let body = &problem.body;
    let place = body.own.iter().position(|o| o.name() == name).unwrap();
    body.natural(&fit.terms, &fit.point)[place].0
}

#[test]
fn only_a_rig_that_floats_or_weighs_has_numbers_for_it() {
    let short = |dofs: &[usize]| {
        let tank = Tank {
            seconds: 6.0,
            hz: 10.0,
            ..Tank::new(dofs, vec![])
        };
        tank.runs(1, 1)
    };
    let names = |rig: &Rig, dofs: &[usize]| -> Vec<&'static str> {
        let recording = Recording::new(&short(dofs), 0.1);
        let body = Body::new(recording, rig, dofs, &[], PriorTable::default()).unwrap();
        body.own.iter().map(|o| o.name()).collect()
    };
    let under_water = Rig::builtin("lshpi").unwrap();
    let usual = [
        "z_wdot",
        "z_w",
        "z_ww",
        "k_pdot",
        "k_p",
        "k_pp",
        "restoring_nm",
    ];
    assert_eq!(names(&under_water, &[2, 3]), usual);
    let all = floating([200.0, 4.0, 6.0], 3.0);
    let more = [
        "heave_stiffness_npm",
        "roll_stiffness_nmprad",
        "net_weight_n",
    ];
    assert_eq!(names(&all, &[2, 3]), [&usual[..], &more].concat());
    assert_eq!(names(&all, &[0]), ["x_udot", "x_u", "x_uu"]);
}

#[test]
fn the_stiffness_and_weight_of_a_hull_are_found_where_the_rig_is_off() {
    let (stiffness_npm, weight_n) = (260.0, 3.6);
    let tank = Tank {
        seconds: 16.0,
        hz: 12.5,
        rig: floating([stiffness_npm, 0.0, 0.0], weight_n),
        ..Tank::new(&[HEAVE], vec![])
    };
    let runs = tank.runs(2, 5);
    let problem = problem(&runs, &floating([200.0, 0.0, 0.0], 3.0), &[HEAVE]);
    let fit = alone(&problem);
    let found_npm = own(&problem, &fit, "heave_stiffness_npm");
    let found_n = own(&problem, &fit, "net_weight_n");
    assert!(
        (found_npm / stiffness_npm - 1.0).abs() < 0.05,
        "{found_npm} N/m"
    );
    assert!((found_n / weight_n - 1.0).abs() < 0.05, "{found_n} N");
}

/// Mass of a ball \[kg\], and its weight less buoyancy \[N\].
const BALL_KG: f64 = 2.3;
const BALL_N: f64 = 20.0;

/// A ball whose heave has these linear and quadratic damping coefficients.
fn ball(linear: f64, quadratic: f64) -> Rig {
    let mut rig = floating([0.0; 3], BALL_N);
    rig.vehicle.mass_kg = BALL_KG;
    let heave = &mut rig.vehicle.coefficients[HEAVE];
    (heave.added, heave.linear, heave.quadratic) = (-1.0, linear, quadratic);
    rig
}

/// The ball falls from rest for as long.
fn fall(rig: &Rig, seconds: f64) -> Run {
    let start = ModelState::at_rest([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
    let mut path = Trajectory::new(Model::from_rig(rig).unwrap(), start, 0.005).unwrap();
    let at_rest = Command {
        t_s: 0.0,
        wrench: [0.0; 6],
    };
    path.command(at_rest.t_s, at_rest.wrench).unwrap();
    let mut run = Run {
        name: format!("fall of {seconds} s"),
        commands: vec![at_rest],
        ..Run::default()
    };
    let mut rng = StdRng::seed_from_u64(7);
    let samples = (100.0 * seconds) as u32;
    for k in 0..samples {
        let t_s = 0.006 + 0.01 * f64::from(k);
        let normal: f64 = StandardNormal.sample(&mut rng);
        let mut values = PerChannel::NAN;
        values[Channel::Z] = path.state_at(t_s).unwrap().vehicle.eta[HEAVE] + 2e-4 * normal;
        run.samples.push(Sample {
            t_s,
            values,
            covariance: None,
        });
    }
    run
}

/// The vehicle alone, with the noise as it is beside its first fit.
fn settled(problem: &mut Problem) -> Fit {
    let first = alone(problem);
    let predicted = problem.predicted(&[], &first.point);
    problem.noises = estimate(&problem.body, &predicted, Some(&problem.noises));
    let cells = first.cells.clone();
    problem
        .fit(&[], &first.point, cells, Effort::DEFAULT)
        .unwrap()
}

/// Value and sd of one of the vehicle's own numbers.
fn with_sd(problem: &Problem, fit: &Fit, name: &str) -> (f64, f64) {
    let body = &problem.body;
    let place = body.own.iter().position(|o| o.name() == name).unwrap();
    let (value, slope) = body.natural(&fit.terms, &fit.point)[place];
    (value, slope.abs() * fit.covariance[(place, place)].sqrt())
}

/// It was called -2.25 kg/m, and a fall that was held out missed by 11.5 m.
#[test]
fn a_ball_without_drag_in_the_rig_has_none_where_it_falls_freely() {
    let rig = ball(0.0, 0.0);
    let runs = [0.9, 1.2].map(|seconds| fall(&rig, seconds));
    let mut problem = problem(&runs, &rig, &[HEAVE]);
    assert!(problem.body.begin()[..4].iter().all(|v| *v == 0.0));
    let fit = settled(&mut problem);
    for name in ["z_w", "z_ww"] {
        let (value, sd) = with_sd(&problem, &fit, name);
        assert!(value <= 0.0 && -value < 2.0 * sd, "{name} {value} +- {sd}");
        assert!(value > -0.01, "{name} {value} +- {sd}");
    }
}

#[test]
fn drag_that_a_rig_does_not_have_is_found_where_it_acts() {
    let quadratic = -0.05;
    let water = ball(0.0, quadratic);
    let runs = [0.9, 1.2].map(|seconds| fall(&water, seconds));
    let mut problem = problem(&runs, &ball(0.0, 0.0), &[HEAVE]);
    let fit = settled(&mut problem);
    let (found, sd) = with_sd(&problem, &fit, "z_ww");
    assert!((found / quadratic - 1.0).abs() < 0.1, "{found} +- {sd}");
    let (linear, sd) = with_sd(&problem, &fit, "z_w");
    assert!(linear > -0.05, "{linear} +- {sd}");
}

/// Height of the water and its rate: two waves of different lengths.
fn wave(t_s: f64) -> (f64, f64) {
    let parts = [(0.05, 1.1, 0.0), (0.03, 2.3, 0.4)];
    parts.iter().fold((0.0, 0.0), |sum, (height_m, w, phase)| {
        let (sin, cos) = (w * t_s + phase).sin_cos();
        (sum.0 + height_m * sin, sum.1 + height_m * w * cos)
    })
}

/// A run in heave under steps of the load and waves that are measured.
fn in_waves(water: &Rig) -> Run {
    let knots = (0..400).map(|k| 0.05 * f64::from(k)).map(|t_s| {
        let (height_m, rate) = wave(t_s);
        (t_s, height_m, rate)
    });
    let curve = Curve::new(&knots.collect::<Vec<_>>());
    let beside = Given {
        companions: [None, None, None, Some(curve)],
        ..Given::default()
    };
    let start = ModelState::at_rest([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
    let model = Model::from_rig(water).unwrap();
    let mut path = Trajectory::new(model, start, 0.005).unwrap().beside(beside);
    let mut run = Run {
        name: "waves".to_owned(),
        ..Run::default()
    };
    for (t_s, load_n) in [(0.0, 4.0), (4.0, -5.0), (9.0, 3.0), (14.0, 0.0)] {
        let wrench = [0.0, 0.0, load_n, 0.0, 0.0, 0.0];
        path.command(t_s, wrench).unwrap();
        run.commands.push(Command { t_s, wrench });
    }
    let mut rng = StdRng::seed_from_u64(11);
    let mut companions = Companions::default();
    for k in 0..225 {
        let t_s = 0.006 + 0.08 * f64::from(k);
        let normal: f64 = StandardNormal.sample(&mut rng);
        let mut values = PerChannel::NAN;
        let z_m = path.state_at(t_s).unwrap().vehicle.eta[HEAVE];
        values[Channel::Z] = z_m + 2e-4 * normal;
        companions.push(t_s, [f64::NAN, f64::NAN, f64::NAN, wave(t_s).0]);
        run.samples.push(Sample {
            t_s,
            values,
            covariance: None,
        });
    }
    run.companions = companions;
    run
}

#[test]
fn what_a_measured_wave_does_to_a_hull_is_fitted() {
    let (a, b) = (-120.0, 30.0);
    let rig = Rig::builtin("lshpi").unwrap();
    let mut water = rig.clone();
    let numbers = [("a_npm", a), ("b_nspm", b)];
    water.physics = vec![entry("wave_force", &numbers, &[("dof", "heave")])];
    let problem = problem(&[in_waves(&water)], &rig, &[HEAVE]);
    let candidates = &problem.body.candidates;
    let waves = candidates
        .iter()
        .position(|c| c.name() == "wave_force heave");
    let waves = waves.unwrap();
    let alone = alone(&problem);
    let start = [-50.0, 0.0, 0.0, 0.0, 10.0];
    let (terms, point) = problem.with(&alone, waves, &start);
    let small = Cells::of([Cell::default(); 6]);
    let fit = problem.fit(&terms, &point, small, Effort::DEFAULT).unwrap();
    let natural = problem.body.natural(&fit.terms, &fit.point);
    let first = problem.body.places(&fit.terms)[0];
    let (found_a, found_b) = (natural[first].0, natural[first + 1].0);
    assert!((found_a / a - 1.0).abs() < 0.1, "{found_a} N/m");
    assert!((found_b / b - 1.0).abs() < 0.1, "{found_b} N s/m");
    let gain = fit.ln_score - alone.ln_score;
    assert!(gain > 20.0, "{gain} nats over the vehicle alone");
}
