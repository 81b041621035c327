//! Leave-one-run-out.

use std::collections::BTreeMap;

use hydroline_identify::CrossValidation;
use hydroline_inference::fit::{Effort, Fit};
use hydroline_numerics::parallel;
use hydroline_rigs::Rig;

use super::conclude::UNEXCITED;
use super::fitted::Fitted;
use super::numbers::Numbers;

/// Each run predicted with coefficients fitted to the others; only its own start is fitted to it. Runs of which the others give no
/// finite motion are missing.
pub(crate) fn cross_validate(fitted: &Fitted, rig: &Rig) -> Vec<CrossValidation> {
    let runs = &fitted.problem.body.recording.runs;
    let full = fitted.problem.predicted(&[], &fitted.fit.point);
    let full = fitted.problem.left_by_run(&full);
    let each = parallel::map(runs.len(), |left| {
        let made = without(fitted, left)?;
        let numbers = Numbers::at_mode(&made, rig)?;
        let own = fitted.problem.only(&[left]);
        let predicted = own.predict(&made.fit)?;
        let rms = own.left_by_run(&predicted.values).into_iter().next()?;
        let body = &made.problem.body;
        let is_open = |i: &usize| {
            let c = body.own[*i].coefficient();
            let size = c.map_or(1.0, |c| c.size(rig).max(numbers.values[*i].abs()));
            let sd = numbers.beside_held[(*i, *i)].sqrt();
            sd.is_nan() || sd >= UNEXCITED * size
        };
        let open = (0..body.own.len()).filter(is_open);
        Some(CrossValidation {
            run: runs[left].name.clone(),
            held: open.map(|i| body.own[i].name().to_owned()).collect(),
            left_out: rms.by_name(),
            fitted: full.get(left).map_or_else(BTreeMap::new, |r| r.by_name()),
        })
    });
    each.into_iter().flatten().collect()
}

/// The fit without a run; `None` where it has no finite motion.
fn without(fitted: &Fitted, left: usize) -> Option<Fitted> {
    let (mut problem, from) = fitted.problem.without_run(&fitted.fit, left);
    let own = problem.body.own.clone();
    // A coefficient that no prior knows and no run shows stays where it was held.
    problem.body.own.retain(|o| !fitted.is_held(o));
    let is_free = |i: &usize| own.get(*i).is_none_or(|o| !fitted.is_held(o));
    let start: Vec<f64> = (0..from.len()).filter(is_free).map(|i| from[i]).collect();
    let fit: Fit = problem.fit(&[], &start, fitted.fit.cells.clone(), Effort::default())?;
    // Of all numbers again: the run left out is predicted by the same body.
    let mut free = fit.point.iter().copied();
    let point: Vec<f64> = (0..from.len())
        .map(|i| match is_free(&i) {
            true => free.next().unwrap_or(0.0),
            false => 0.0,
        })
        .collect();
    let places: Vec<usize> = (0..from.len()).filter(is_free).collect();
    let mut covariance = nalgebra::DMatrix::zeros(point.len(), point.len());
    for (a, i) in places.iter().enumerate() {
        for (b, j) in places.iter().enumerate() {
            covariance[(*i, *j)] = fit.covariance[(a, b)];
        }
    }
    problem.body.own = own;
    Some(Fitted {
        problem,
        fit: Fit {
            point,
            covariance,
            ..fit
        },
        held: fitted.held.clone(),
        fits: 1,
    })
}
