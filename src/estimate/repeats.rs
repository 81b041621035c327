//! Scatter between repeats of a plan, beside the scatter of samples.
//!
//! Each run's score at the mode is a step that the run alone would make the estimate go. Of repeats of one plan the steps scatter as
//! far as their samples say, unless something differs from run to run: trim, battery, water that is not at rest yet. The sd by repeats
//! is that of the samples with the part of these runs as they do scatter (the sandwich by runs: White 1982; Liang and Zeger 1986).

use hydroline_identify::Identification;
use hydroline_inference::body::Own;
use hydroline_inference::recording::Recorded;
use hydroline_numerics::statistics::chi2_above;
use hydroline_report::significant;
use nalgebra::{Cholesky, DMatrix, DVector};

use super::asked::Asked;
use super::fitted::Fitted;
use super::numbers::Numbers;

/// Fewest runs of a plan that show a scatter (ITTC 7.5-02-01-01).
const REPEATS_LEAST: usize = 3;
/// Largest difference of two repeats' stamps of one command \[s\]: some rows of a log.
const ALIKE_S: f64 = 0.2;
/// Largest difference of their loads over the largest: rounding of pulses, and a supply that sags.
const ALIKE_SHARE: f64 = 0.05;
/// Share of a variance below which these runs are not what a coefficient is known by.
const SHARE_LEAST: f64 = 0.1;
/// Probability below which repeats scatter by more than their samples say, over all coefficients.
const LEVEL: f64 = 0.01;

/// Score and information of one run, of the vehicle's numbers beside the run's start; natural.
struct Step {
    score: DVector<f64>,
    information: DMatrix<f64>,
}

/// Adds the sd by repeats to coefficients that repeats determine, and says where they scatter more than samples say.
pub(crate) fn add_repeats(
    result: &mut Identification,
    (fitted, numbers): (&Fitted, &Numbers),
    asked: &Asked,
) {
    let runs = &fitted.problem.body.recording.runs;
    let groups: Vec<Vec<usize>> = repeats(runs)
        .into_iter()
        .filter(|group| group.len() >= REPEATS_LEAST)
        .collect();
    let own = &fitted.problem.body.own;
    let n = own.len();
    let known = numbers.at_mode.view((0, 0), (n, n));
    let known = known.map(|v| if v.is_finite() { v } else { 0.0 });
    // Of each number: variance that samples give it by these runs, that by their scatter, and the test of the two.
    let (mut by_samples, mut by_scatter) = (DVector::<f64>::zeros(n), DVector::<f64>::zeros(n));
    let (mut square, mut freedom) = (DVector::<f64>::zeros(n), 0.0);
    for group in &groups {
        let steps: Option<Vec<Step>> = group.iter().map(|r| step(fitted, numbers, *r)).collect();
        let Some(steps) = steps else { return };
        let count = steps.len() as f64;
        let mut information = DMatrix::<f64>::zeros(n, n);
        let mut mean = DVector::<f64>::zeros(n);
        for step in &steps {
            information += &step.information;
            mean += &step.score / count;
        }
        let samples = (&known * information * &known).diagonal();
        let mut scatter = DVector::<f64>::zeros(n);
        for step in &steps {
            let away = &known * (&step.score - &mean);
            scatter += away.component_mul(&away) * (count / (count - 1.0));
        }
        for i in (0..n).filter(|i| samples[*i] > 0.0) {
            square[i] += (count - 1.0) * scatter[i] / samples[i];
        }
        freedom += count - 1.0;
        by_samples += samples;
        by_scatter += scatter;
    }
    let listed = asked.coefficients.len().max(1) as f64;
    for c in &asked.coefficients {
        let place = own.iter().position(|o| o.coefficient() == Some(*c));
        let Some(i) = place.filter(|i| by_samples[*i] > SHARE_LEAST * known[(*i, *i)]) else {
            continue;
        };
        let Some(p) = result.parameters.get_mut(c.key()).filter(|p| p.excited) else {
            continue;
        };
        let rest = (known[(i, i)] - by_samples[i]).max(0.0);
        let sd = (rest + by_scatter[i]).sqrt();
        p.repeat_sd = Some(sd);
        let p_value = (listed * chi2_above(square[i], freedom)).min(1.0);
        if p_value < LEVEL {
            let most = groups.iter().map(Vec::len).max().unwrap_or(0);
            result.notes.push(format!(
                "{}: {most} repeats of a plan scatter {:.1} times as far as their samples say (p = {p_value:.1e}): something differs from run to run (trim, battery, water not at rest yet); sd by repeats {}",
                c.key(),
                (by_scatter[i] / by_samples[i]).sqrt(),
                significant(sd)
            ));
        }
    }
}

/// Step that one run alone would make the estimate go, under the fit's random forces; `None` where its motion is not finite.
fn step(fitted: &Fitted, numbers: &Numbers, run: usize) -> Option<Step> {
    let Fitted { problem, fit, .. } = fitted;
    let n = problem.body.own.len();
    let places = problem.body.start_places(&[]);
    let mut point = fit.point[..n].to_vec();
    point.extend(&fit.point[places[run]..places[run + 1]]);
    let alone = problem.only(&[run]);
    let all = alone.simulate(&[], &point)?;
    let size = point.len();
    let mut information = DMatrix::<f64>::zeros(size, size);
    let mut score = DVector::<f64>::zeros(size);
    for d in &alone.body.dofs {
        let of = alone.normal(&all, *d, fit.cells.misfit[*d], size);
        information += of.information;
        score += of.gradient;
    }
    let densities = alone.body.densities(&[]);
    // What is the run's own has its prior here: the start, and the clock of its log.
    let clock = alone.body.recording.runs.first().and_then(|r| r.clock);
    let is_own = |i: &usize| match alone.body.own.get(*i) {
        Some(Own::ClockOffset(c) | Own::ClockDrift(c)) => clock == Some(*c),
        Some(_) => false,
        None => true,
    };
    for i in (0..size).filter(is_own) {
        let (slope, curvature) = densities[i].step(point[i]);
        score[i] += slope;
        information[(i, i)] += curvature;
    }
    // The start goes along.
    let starts = size - n;
    if starts > 0 {
        let own = information.view((n, n), (starts, starts)).into_owned();
        let across = information.view((0, n), (n, starts)).into_owned();
        let root = Cholesky::new(own)?;
        let by_start = root.solve(&score.rows(n, starts).into_owned());
        let shared = &across * root.solve(&across.transpose());
        let moved = &across * by_start;
        for i in 0..n {
            score[i] -= moved[i];
            for j in 0..n {
                information[(i, j)] -= shared[(i, j)];
            }
        }
    }
    let is_held = |i: usize| fitted.is_held(&problem.body.own[i]);
    let by = |i: usize| match is_held(i) {
        true => 0.0,
        false => numbers.slopes[i].recip(),
    };
    Some(Step {
        score: DVector::from_fn(n, |i, _| by(i) * score[i]),
        information: DMatrix::from_fn(n, n, |i, j| by(i) * by(j) * information[(i, j)]),
    })
}

/// Runs by the plan that drove them; those that nothing drove have none.
fn repeats(runs: &[Recorded]) -> Vec<Vec<usize>> {
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for (i, run) in runs.iter().enumerate() {
        if pushes(run).iter().all(|p| p.1.iter().all(|w| *w == 0.0)) {
            continue;
        }
        let like = |group: &&mut Vec<usize>| is_repeat(&runs[group[0]], run);
        match groups.iter_mut().find(like) {
            Some(group) => group.push(i),
            None => groups.push(vec![i]),
        }
    }
    groups
}

/// Loads from the first one that is not 0, by the time since then.
fn pushes(run: &Recorded) -> Vec<(f64, [f64; 6])> {
    let end_s = run.times_s.last().copied().unwrap_or(0.0);
    let is_load = |c: &&(f64, [f64; 6])| c.1.iter().any(|w| *w != 0.0);
    let first_s = run.commands.iter().find(is_load).map_or(0.0, |c| c.0);
    let each = run
        .commands
        .iter()
        .filter(|c| c.0 >= first_s && c.0 < end_s);
    each.map(|(t_s, wrench)| (t_s - first_s, *wrench)).collect()
}

/// Time of a command \[s\] and the wrench from then on \[N, N m\].
type Push = (f64, [f64; 6]);

/// Whether two runs are of one plan.
fn is_repeat(a: &Recorded, b: &Recorded) -> bool {
    let (a, b) = (pushes(a), pushes(b));
    let loads = || a.iter().chain(&b).flat_map(|p| p.1);
    let most = loads().fold(0.0_f64, |m, w| m.max(w.abs()));
    let alike = |(a, b): (&Push, &Push)| {
        let mut pairs = a.1.iter().zip(&b.1);
        (a.0 - b.0).abs() < ALIKE_S && pairs.all(|(a, b)| (a - b).abs() <= ALIKE_SHARE * most)
    };
    a.len() == b.len() && a.iter().zip(&b).all(alike)
}
