//! The next experiment: the plan that best parts what is still open.
//!
//! Data of a plan are predicted under each open explanation; the other is refitted to them together
//! with what the runs at hand already say (its Hessian as a prior). What it still cannot follow,
//! in half squares of the noise, is the expected log Bayes factor (Kullback-Leibler divergence of
//! the two predictions; Chaloner and Verdinelli 1995).

use std::collections::BTreeMap;

use hydroline_rigs::{Plan, PlanStep, Rig, Shape, StepLoad, Wrench};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::fit::Fit;
use super::setting::{COEFFICIENTS, Setting, Track};
use super::verdict::NextExperiment;
use super::weights::Weights;
use hydroline_identify::data::Command;
use hydroline_plan::preflight::preflight;
use hydroline_plan::setpoint::setpoint;
use hydroline_sim::Allocation;

/// Stamps of a run that is planned \[1/s\].
const RATE_HZ: f64 = 25.0;
/// What is watched after the plan's end \[s\].
const TAIL_S: f64 = 6.0;

/// Library of plans in one DOF at a size \[N, N m\].
pub fn library(dof: usize, size: f64) -> Vec<Plan> {
    let step = |for_s: f64, share: f64, shape: Shape| {
        let load = std::array::from_fn(|i| if i == dof { share * size } else { 0.0 });
        PlanStep {
            for_s,
            load: StepLoad::Wrench(Wrench::from_array(load)),
            shape,
        }
    };
    let hold = |for_s, share| step(for_s, share, Shape::Hold);
    let sine = |for_s, share, period_s| {
        step(
            for_s,
            share,
            Shape::Sine {
                period_s,
                phase_rad: 1.31,
            },
        )
    };
    let plan = |name: &str, steps: Vec<PlanStep>| Plan {
        name: name.to_owned(),
        steps,
        source_toml: String::new(),
    };
    vec![
        plan("next-constant", vec![hold(12.0, 1.0)]),
        plan("next-coast-down", vec![hold(6.0, 1.0), hold(14.0, 0.0)]),
        plan(
            "next-reversal",
            vec![hold(6.0, 1.0), hold(8.0, -1.0), hold(6.0, 0.0)],
        ),
        plan(
            "next-reversals",
            vec![
                hold(4.0, 1.0),
                hold(6.0, -1.0),
                hold(6.0, 1.0),
                hold(4.0, -1.0),
            ],
        ),
        plan(
            "next-steps",
            vec![
                hold(5.0, 0.25),
                hold(5.0, 0.5),
                hold(5.0, 1.0),
                hold(5.0, -0.25),
                hold(4.0, -1.0),
            ],
        ),
        plan(
            "next-small-steps",
            vec![
                hold(8.0, 0.1),
                hold(4.0, 0.0),
                hold(8.0, -0.1),
                hold(4.0, 0.05),
            ],
        ),
        plan(
            "next-still-then-go",
            vec![hold(12.0, 0.0), hold(6.0, 0.5), hold(6.0, -0.5)],
        ),
        plan(
            "next-chirp",
            vec![step(
                20.0,
                1.0,
                Shape::Chirp {
                    f0_hz: 0.05,
                    f1_hz: 1.0,
                },
            )],
        ),
        plan(
            "next-two-tone",
            vec![sine(12.0, 0.6, 8.0), sine(12.0, 1.0, 2.0)],
        ),
        plan("next-slow-sine", vec![sine(24.0, 0.5, 12.0)]),
    ]
}

/// What is sent by a plan, and the stamps of what is seen of it \[s\].
pub(crate) fn run_of(
    rig: &Rig,
    allocation: &Allocation,
    plan: &Plan,
) -> Option<(Vec<Command>, Vec<f64>)> {
    let end_s = plan.duration_s() + TAIL_S;
    let period_s = 1.0 / rig.thrusters.link.rate_hz;
    let mut commands: Vec<Command> = Vec::new();
    let mut k = 0u32;
    while f64::from(k) * period_s < end_s {
        let t_s = f64::from(k) * period_s;
        let set = setpoint(rig, allocation, plan, t_s).ok()?;
        let wrench = allocation.wrench(&set.thrust_n).ok()?.to_array();
        if commands.last().is_none_or(|c| c.wrench != wrench) {
            commands.push(Command { t_s, wrench });
        }
        k += 1;
    }
    let stamps = 0..(end_s * RATE_HZ) as u32;
    let times_s = stamps.map(|k| 0.006 + f64::from(k) / RATE_HZ).collect();
    Some((commands, times_s))
}

fn track(rig: &Rig, plan: &Plan, like: &Track) -> Option<Track> {
    let allocation = Allocation::new(&rig.thrusters).ok()?;
    let (commands, times_s) = run_of(rig, &allocation, plan)?;
    let mut edges: Vec<(f64, f64)> = commands
        .iter()
        .map(|c| (c.t_s, c.wrench[like.line.dof]))
        .collect();
    edges.dedup_by_key(|e| e.1);
    let mut line = like.line;
    line.rest = rig.tank.start_pose;
    Some(Track {
        name: plan.name.clone(),
        measured: vec![0.0; times_s.len()],
        times_s,
        edges,
        start_s: 0.0,
        line,
    })
}

/// How far one explanation can follow the data of another on a track: expected log Bayes factor.
/// The new run begins as still as those at hand.
fn apart(setting: &Setting, plan: &Track, like: &Weights, truth: &Fit, other: &Fit) -> Option<f64> {
    let there = setting.with_tracks(vec![plan.clone()]);
    let start = (plan.line.along(&plan.line.rest), 0.0);
    let used = vec![vec![true; plan.times_s.len()]];
    let weights = Weights::new(&there.tracks, like.noise, used);
    let g = COEFFICIENTS + setting.parameters(&other.set);
    // Slow and strong laws need more than one step of the refit.
    let mut at: Vec<f64> = other.at[..g].to_vec();
    let truth_motion = there.values(0, &truth.set, truth.globals(setting), start);
    // What the runs at hand leave free: the Hessian with the starts taken out.
    let prior = schur(&other.hessian, g)?;
    let mut offset = (start.0, start.1);
    let mut best = f64::INFINITY;
    for _ in 0..5 {
        let (values, jacobian) = there.sensitivities(0, &other.set, &at, offset);
        let mut d: Vec<f64> = values
            .iter()
            .zip(&truth_motion)
            .map(|(a, b)| a - b)
            .collect();
        weights.whiten(0, d.iter_mut());
        let d = DVector::from_vec(d);
        let shift = DVector::from_fn(g, |i, _| at[i] - other.at[i]);
        let now = 0.5 * d.norm_squared() + 0.5 * shift.dot(&(&prior * &shift));
        if !now.is_finite() {
            break;
        }
        best = best.min(now);
        let mut j = jacobian;
        for mut column in j.column_iter_mut() {
            weights.whiten(0, column.iter_mut());
        }
        let mut h = j.tr_mul(&j);
        let mut gradient = j.tr_mul(&d);
        for i in 0..g {
            for k in 0..g {
                h[(i, k)] += prior[(i, k)];
            }
            gradient[i] += (0..g).map(|k| prior[(i, k)] * shift[k]).sum::<f64>();
        }
        let believed = like.rest_precision(setting.tolerance);
        h[(g + 1, g + 1)] += believed;
        gradient[g + 1] += believed * offset.1;
        for i in 0..h.nrows() {
            h[(i, i)] *= 1.0 + 1e-9;
        }
        let step = h.cholesky()?.solve(&gradient);
        for i in 0..g {
            at[i] -= step[i];
        }
        offset.0 -= step[g];
        offset.1 -= step[g + 1];
    }
    best.is_finite().then_some(best)
}

/// Hessian of the first `g` unknowns with the others taken out.
fn schur(h: &DMatrix<f64>, g: usize) -> Option<DMatrix<f64>> {
    let n = h.nrows();
    let a = h.view((0, 0), (g, g)).into_owned();
    if n == g {
        return Some(a);
    }
    let b = h.view((0, g), (g, n - g)).into_owned();
    let mut c = h.view((g, g), (n - g, n - g)).into_owned();
    for i in 0..n - g {
        c[(i, i)] *= 1.0 + 1e-12;
        c[(i, i)] += 1e-12;
    }
    let solved = c.cholesky()?.solve(&b.transpose());
    Some(a - b * solved)
}

/// The plan that parts these explanations best: the largest of the smallest log Bayes factor over
/// pairs; pairs that no plan parts count in the sum only.
pub fn propose(
    rig: &Rig,
    setting: &Setting,
    weights: &Weights,
    open: &[Fit],
) -> Option<NextExperiment> {
    let like = setting.tracks.first()?;
    let name = |f: &Fit| -> Vec<String> {
        f.set
            .iter()
            .map(|c| setting.vocabulary[*c].info.id.to_owned())
            .collect()
    };
    if open.len() < 2 {
        return None;
    }
    let largest = setting
        .tracks
        .iter()
        .flat_map(|t| &t.edges)
        .map(|e| e.1.abs())
        .fold(0.0, f64::max);
    let size = if largest > 0.0 {
        largest
    } else if setting.dof.index() < 3 {
        8.0
    } else {
        1.0
    };
    let plans: Vec<Plan> = [1.0, 0.5]
        .iter()
        .flat_map(|share| {
            library(setting.dof.index(), size * share)
                .into_iter()
                .map(move |mut p| {
                    p.name = format!("{}-{:.0}", p.name, 100.0 * share);
                    p
                })
        })
        .filter(|p| preflight(rig, p).is_ok_and(|c| c.violations.is_empty()))
        .collect();
    let scored: Vec<(Plan, f64, f64)> = plans
        .into_par_iter()
        .filter_map(|plan| {
            let there = track(rig, &plan, like)?;
            let mut least = f64::INFINITY;
            let mut sum = 0.0;
            for (i, a) in open.iter().enumerate() {
                for b in open.iter().skip(i + 1) {
                    let factor = apart(setting, &there, weights, a, b)?
                        .min(apart(setting, &there, weights, b, a)?);
                    least = least.min(factor);
                    // Beyond twenty it is decided.
                    sum += factor.min(20.0);
                }
            }
            Some((plan, least, sum))
        })
        .collect();
    let considered: BTreeMap<String, f64> = scored
        .iter()
        .map(|(p, least, _)| (p.name.clone(), *least))
        .collect();
    let (plan, least, _) = scored.into_iter().max_by(|a, b| a.2.total_cmp(&b.2))?;
    Some(NextExperiment {
        plan_toml: plan.to_toml(),
        plan: plan.name,
        separates: open.iter().map(name).collect(),
        expected_log_bayes_factor: least,
        reason: String::new(),
        considered,
    })
}
