//! Closed forms of composed forces, for eyes and for figures:
//! `SEED=77 COUNT=8 cargo test -p hydroline-benchmark --lib -- --ignored --nocapture of_composed_forces`.
//!
//! The rig that is written predicts two runs of twice the load that nobody has seen, from rest.
use super::motion::Mover;
use super::{case, plans};
use crate::strange::{Here, Strange};
use hydroline_rigs::{PlanStep, StepLoad, Wrench};
use rand::{SeedableRng, rngs::StdRng};

/// Of the true force's largest size within the data: what a form that is called the law may be off by at most.
const WRONG: f64 = 0.2;

fn doubled(step: &PlanStep) -> PlanStep {
    match &step.load {
        StepLoad::Wrench(w) => PlanStep {
            load: StepLoad::Wrench(Wrench::from_array(w.to_array().map(|v| 2.0 * v))),
            ..step.clone()
        },
        _ => step.clone(),
    }
}

#[test]
#[ignore = "for eyes"]
fn of_composed_forces() {
    let var = |n: &str| std::env::var(n).ok().and_then(|s| s.parse::<usize>().ok());
    let seed = var("SEED").unwrap_or(77) as u64;
    let (from, count) = (var("FROM").unwrap_or(0), var("COUNT").unwrap_or(8));
    let (mut asked, mut unknown, mut right, mut closed, mut sure, mut wrong) = (0, 0, 0, 0, 0, 0);
    let (mut predicted, mut as_observer) = (0, 0);
    for index in from..from + count {
        let made = match case::make_composed(seed, index) {
            Ok(made) => made,
            Err(e) => {
                println!("== {index}: {e}");
                continue;
            }
        };
        let Some(Strange::Composed(law)) = made.key.tank.strange else {
            continue;
        };
        asked += 1;
        let begun = std::time::Instant::now();
        let found =
            hydroline_diagnose::diagnose(&made.sealed.sources, &[], &made.sealed.rig, &|_| {})
                .unwrap();
        let v = &found.verdict;
        let unnamed = v.unexplained.iter().find(|u| !u.knots.is_empty());
        println!(
            "== {index} {:.1} s {} fits | there: {law:.3?}, others {:?}\n   {:?}: {}",
            begun.elapsed().as_secs_f64(),
            v.sets_looked_at,
            made.key
                .truth
                .iter()
                .filter(|t| t.weight_m > 2e-4 && t.exact)
                .map(|t| format!("{} {:.2}", t.effect, t.weight_m * 1e3))
                .collect::<Vec<_>>(),
            v.verdict,
            v.sentence,
        );
        unknown += usize::from(v.verdict == hydroline_diagnose::verdict::Word::Unknown);
        let along = if law.of_speed { "u" } else { "x" };
        right += usize::from(unnamed.is_some_and(|u| u.depends_on == along));
        // Twice the load: the vehicle from rest, by the rig that is written.
        let mut rng = StdRng::seed_from_u64(seed ^ index as u64);
        let hard: Vec<_> = plans::good(&mut rng)
            .into_iter()
            .take(2)
            .map(|mut p| {
                p.steps = p.steps.iter().map(doubled).collect();
                p
            })
            .collect();
        // Beside it an observer that knows the law, and of all else what the rig says.
        let known: Vec<_> = found
            .rig
            .physics
            .iter()
            .filter(|e| !["written_force", "free_force"].contains(&e.effect.as_str()))
            .cloned()
            .collect();
        let truth = Strange::Composed(law);
        let start = made.sealed.rig.tank.start_pose;
        let movers =
            [(&found.rig.physics, None), (&known, Some(&truth))].map(|(entries, strange)| Mover {
                vehicle: &found.rig.vehicle,
                entries,
                strange,
                start,
            });
        let (mut square, mut count, mut noise) = ([0.0; 2], 0.0, 0.0);
        for (k, plan) in hard.iter().enumerate() {
            let Ok(run) = made.key.tank.record(plan, k, plans::RUN_S) else {
                continue;
            };
            let foretold = movers.map(|m| m.positions(k, &run.edges, &run.times_s).unwrap());
            for i in (0..run.times_s.len()).filter(|i| !run.outlier[*i]) {
                for (square, x) in square.iter_mut().zip(&foretold) {
                    *square += (run.motion[i].x_m.unwrap() - x[i]).powi(2);
                }
                noise += run.noise_m[i].powi(2);
                count += 1.0;
            }
        }
        let [over, observer] = square.map(|s| (s / noise).sqrt());
        println!(
            "   twice the load: {over:.2} x noise ({:.2} mm), observer {observer:.2}",
            (noise / count).sqrt() * 1e3
        );
        let Some(form) = unnamed.and_then(|u| Some((u, u.closed_form.as_ref()?))) else {
            continue;
        };
        let (u, form) = form;
        closed += usize::from(form.written);
        predicted += usize::from(form.written && over < 1.5);
        as_observer += usize::from(form.written && over < 1.5 * observer.max(1.0));
        // What the vehicle's own damping can take up is none of the form's errors: it is compared where it acts alone, in x.
        let truth: Vec<f64> = u
            .knots
            .iter()
            .map(|c| {
                let here = Here {
                    t_s: 0.0,
                    x_m: if law.of_speed { 0.0 } else { *c },
                    u_mps: if law.of_speed { *c } else { 0.1 },
                    drag: [0.0; 2],
                    run: 0,
                };
                law.force(&here)
            })
            .collect();
        let top = truth.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        let mean = truth
            .iter()
            .zip(&form.force_at)
            .map(|(a, b)| a - b)
            .sum::<f64>()
            / truth.len() as f64;
        let inner = 3..truth.len() - 3;
        let off = inner.fold(0.0_f64, |m, k| {
            m.max((truth[k] - form.force_at[k] - if law.of_speed { 0.0 } else { mean }).abs())
        });
        let is_wrong = off > WRONG * top && over > 1.5 * observer.max(1.0);
        sure += usize::from(form.sure);
        wrong += usize::from(form.sure && is_wrong);
        println!(
            "   written {} sure {} none {:.3}: {:?}; off by {:.2} of the largest",
            form.written,
            form.sure,
            form.none_probability,
            form.forms
                .iter()
                .map(|f| format!("{:.3} {}", f.probability, f.expression))
                .collect::<Vec<_>>(),
            off / top
        );
    }
    println!(
        "of {asked}: unknown {unknown}, covariate right {right}, written {closed}, of these within 1.5 x noise at twice the load {predicted} (or 1.5 x the observer's {as_observer}), sure {sure}, of these wrong {wrong}"
    );
}
