//! Plans of the sealed runs: runs of different kinds in surge, drawn around those of the library.

use hydroline_rigs::{Plan, PlanStep, Shape, StepLoad, Wrench};
use rand::{RngExt, rngs::StdRng};

/// Length of a run \[s\].
pub const RUN_S: f64 = 24.0;

fn step(for_s: f64, surge_n: f64, shape: Shape) -> PlanStep {
    PlanStep {
        for_s,
        load: StepLoad::Wrench(Wrench::from_array([surge_n, 0.0, 0.0, 0.0, 0.0, 0.0])),
        shape,
    }
}

fn plan(name: &str, steps: Vec<PlanStep>) -> Plan {
    Plan {
        name: name.to_owned(),
        steps,
        source_toml: String::new(),
    }
}

/// Four runs that together excite everything: reversals, coast-down, two tones, chirp, the last one of these three drawn.
pub fn good(rng: &mut StdRng) -> Vec<Plan> {
    let mut between = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
    let hold = |t: f64, x: f64| step(t, x, Shape::Hold);
    let size = between(7.0, 10.0);
    let first = between(3.5, 5.0);
    let reversals = plan(
        "reversals",
        vec![
            hold(first, size),
            hold(1.5 * first, -size),
            hold(first, size),
            hold(3.0, -0.6 * size),
            hold(RUN_S, 0.0),
        ],
    );
    let size = between(6.0, 9.0);
    let up = between(5.0, 7.0);
    let coast = plan(
        "coast-down",
        vec![
            hold(up, size),
            hold(6.0, 0.0),
            hold(0.8 * up, -size),
            hold(RUN_S, 0.0),
        ],
    );
    let tone = |x: f64, period_s: f64, for_s: f64| {
        let shape = Shape::Sine {
            period_s,
            phase_rad: 1.31,
        };
        step(for_s, x, shape)
    };
    let two = plan(
        "two-tone",
        vec![
            tone(between(9.0, 13.0), between(7.0, 10.0), 13.0),
            tone(between(10.0, 14.0), between(2.5, 4.0), 9.0),
            hold(RUN_S, 0.0),
        ],
    );
    let sweep = Shape::Chirp {
        f0_hz: 0.05,
        f1_hz: between(0.4, 0.8),
    };
    let chirp = plan(
        "chirp",
        vec![step(21.0, between(8.0, 12.0), sweep), hold(RUN_S, 0.0)],
    );
    let mut all = vec![reversals, coast, two, chirp];
    let drawn = 1 + (between(0.0, 3.0) as usize).min(2);
    let last = all.remove(drawn);
    all.push(last);
    all
}

/// One more run, drawn anew: no reversals, which go farthest.
pub fn another(rng: &mut StdRng) -> Option<Plan> {
    good(rng).pop()
}

/// Two tones, each several times as fast as anything in the reversals and the coast-down of [`good`]; the first within a
/// fiftieth of a period.
pub fn fast(period_s: f64, rng: &mut StdRng) -> Plan {
    let mut between = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
    let mut tone = |size: (f64, f64), period_s: f64, for_s: f64| {
        let shape = Shape::Sine {
            period_s: period_s * between(0.98, 1.02),
            phase_rad: 1.31,
        };
        step(for_s, between(size.0, size.1), shape)
    };
    let steps = vec![
        tone((7.0, 10.0), period_s, 16.0),
        tone((3.0, 5.0), 0.8 * period_s, 6.0),
        step(RUN_S, 0.0, Shape::Hold),
    ];
    plan("fast-tones", steps)
}

/// The same plan with all wrenches this many times as large.
pub fn times(mut plan: Plan, factor: f64) -> Plan {
    for step in &mut plan.steps {
        if let StepLoad::Wrench(w) = &step.load {
            let scaled = w.to_array().map(|v| factor * v);
            step.load = StepLoad::Wrench(Wrench::from_array(scaled));
        }
    }
    plan
}
