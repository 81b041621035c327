//! A force of no known effect that was drawn by composition: its covariate, and what is written down of it.

use hydroline_diagnose::Diagnosis;
use hydroline_diagnose::verdict::ClosedForm;
use hydroline_rigs::PhysicsEntry;
use rand::{SeedableRng, rngs::StdRng};

use super::Judged;
use crate::benchmark::case::Case;
use crate::benchmark::composed::Composed;
use crate::benchmark::error::ProveError;
use crate::benchmark::external_law::{ExternalLaw, Here};
use crate::benchmark::motion::Mover;
use crate::benchmark::plans;

/// Of the true force's largest size within the data: what a form that is called the law may be off by at most.
const WRONG: f64 = 0.2;
/// rms over the noise to which runs of twice the load are to be predicted.
const PREDICTED: f64 = 1.5;
/// Runs of twice the load.
const HARD_RUNS: usize = 2;
/// Points at either end of a table that are not compared: few samples lie there.
const ENDS: usize = 3;
/// Surge rate at which a force of place that goes with the rate is compared \[m/s\].
const RATE_MPS: f64 = 0.1;

/// rms of runs of twice the load that nobody has seen over their noise: by the rig that is written, and by an observer
/// that knows the law, and of all else what that rig says.
fn twice_the_load(
    case: &Case,
    made: &Diagnosis,
    truth: &ExternalLaw,
) -> Result<[f64; 2], ProveError> {
    let tank = &case.key.tank;
    let mut rng = StdRng::seed_from_u64(tank.seed);
    let drawn = plans::good(&mut rng).into_iter().take(HARD_RUNS);
    let hard = drawn.map(|plan| plans::times(plan, 2.0));
    let unnamed = |e: &&PhysicsEntry| ["written_force", "free_force"].contains(&e.effect.as_str());
    let known: Vec<PhysicsEntry> = made
        .rig
        .physics
        .iter()
        .filter(|e| !unnamed(e))
        .cloned()
        .collect();
    let movers =
        [(&made.rig.physics, None), (&known, Some(truth))].map(|(entries, external_law)| Mover {
            vehicle: &made.rig.vehicle,
            entries,
            external_law,
            start: case.sealed.rig.tank.start_pose,
        });
    let (mut square, mut noise) = ([0.0; 2], 0.0);
    for (k, plan) in hard.enumerate() {
        let run = tank.record(&plan, k, plans::RUN_S)?;
        let mut predicted = Vec::new();
        for mover in &movers {
            predicted.push(mover.positions(k, &run.edges, &run.times_s)?);
        }
        for i in (0..run.times_s.len()).filter(|i| !run.outlier[*i]) {
            let Some(seen_m) = run.motion[i].x_m else {
                continue;
            };
            for (square, x_m) in square.iter_mut().zip(&predicted) {
                *square += (seen_m - x_m[i]).powi(2);
            }
            noise += run.noise_m[i].powi(2);
        }
    }
    Ok(square.map(|s| (s / noise).sqrt()))
}

/// By how much of its largest size the written force is off, within the data.
fn off(law: &Composed, knots: &[f64], form: &ClosedForm) -> f64 {
    let force = |c: &f64| {
        law.force(&Here {
            t_s: 0.0,
            x_m: if law.of_speed { 0.0 } else { *c },
            u_mps: if law.of_speed { *c } else { RATE_MPS },
            drag: [0.0; 2],
            run: 0,
            load_n: 0.0,
        })
    };
    let truth: Vec<f64> = knots.iter().map(force).collect();
    let largest = truth.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let gaps: Vec<f64> = truth
        .iter()
        .zip(&form.force_at)
        .map(|(a, b)| a - b)
        .collect();
    // A constant beside a force of place may stand in either.
    let mean = match law.of_speed {
        true => 0.0,
        false => gaps.iter().sum::<f64>() / gaps.len().max(1) as f64,
    };
    let inner = gaps
        .iter()
        .skip(ENDS)
        .take(gaps.len().saturating_sub(2 * ENDS));
    inner.fold(0.0_f64, |m, g| m.max((g - mean).abs())) / largest
}

/// Adds the requirements of such a case beside the word.
pub(super) fn ask(case: &Case, made: &Diagnosis, judged: &mut Judged) -> Result<(), ProveError> {
    let Some(ExternalLaw::Composed(law)) = case.key.tank.external_law else {
        return Ok(());
    };
    let unnamed = made
        .verdict
        .unexplained
        .iter()
        .find(|u| !u.knots.is_empty());
    let along = if law.of_speed { "u" } else { "x" };
    let covariate = unnamed.is_some_and(|u| u.depends_on.as_deref() == Some(along));
    judged.passed.push(("covariate".into(), covariate));
    let [own, observer] = twice_the_load(case, made, &ExternalLaw::Composed(law))?;
    let form = unnamed.and_then(|u| Some((u, u.closed_form.as_ref()?)));
    let written = form.is_some_and(|(_, f)| f.written);
    judged
        .passed
        .push(("closed_form".into(), written && own <= PREDICTED));
    judged
        .passed_ideal
        .push(("closed_form".into(), observer <= PREDICTED));
    let wrong = form.is_some_and(|(u, f)| {
        f.sure && off(&law, &u.knots, f) > WRONG && own > PREDICTED * observer.max(1.0)
    });
    judged.passed.push(("closed_form_true".into(), !wrong));
    Ok(())
}
