//! Leave-one-run-out.

use super::IdentifyError;
use super::conclude::UNEXCITED;
use super::fit::{Fit, hold_undetermined};
use crate::forward::Forward;
use crate::lm;
use crate::outcome::{CrossValidation, Identification};
use crate::parameter::Coefficient;
use crate::problem::Problem;
use crate::refit::ENOUGH;
use hydroline_core::run::Run;

/// Makes the equations of some runs with some coefficients free.
pub(super) type Make<'a> =
    dyn Fn(&[Run], &[Coefficient]) -> Result<Box<dyn Forward>, IdentifyError> + 'a;

/// Each run predicted with coefficients fitted to the others; only its own start is fitted to it. No fit is searched to its last
/// digit: where the model does not fit that takes many times as long, and changes a prediction by little beside its misfit.
pub(super) fn cross_validate(
    runs: &[Run],
    full: &Identification,
    fit: &Fit<'_>,
    make: &Make<'_>,
    coefficients: &[Coefficient],
) -> Result<Vec<CrossValidation>, IdentifyError> {
    let globals = coefficients.len();
    let mut out = Vec::new();
    for left in 0..runs.len() {
        let others: Vec<Run> = runs
            .iter()
            .enumerate()
            .filter(|(i, _)| *i != left)
            .map(|(_, r)| r.clone())
            .collect();
        let training = make(&others, coefficients)?;
        let mut problem = Problem::new(training.as_ref(), &vec![1.0; training.slots().len()]);
        problem.weigh(fit.problem.references().to_vec());
        problem.set_noise(&fit.noises, |run, slot, k| {
            let original = run + usize::from(run >= left);
            fit.problem.whiteners()[original][slot].counts(k)
        });
        let mut start: Vec<f64> = fit.at[..globals].to_vec();
        for run in (0..runs.len()).filter(|r| *r != left) {
            start.extend(fit.problem.of_run(run, &fit.at).into_iter().skip(globals));
        }
        let mut held = vec![false; start.len()];
        held[..globals].copy_from_slice(&fit.held[..globals]);
        // A coefficient that only the run left out shows would drift freely here: it stays at the rig's value.
        let mut start = lm::descend(&problem, start, &held, ENOUGH)?.0.parameters;
        let (now, _) = hold_undetermined(&problem, &mut start, &mut held, UNEXCITED)?;
        let trained = lm::descend(&problem, start, &held, ENOUGH)?.0;
        let alone = make(std::slice::from_ref(&runs[left]), coefficients)?;
        let mut own = Problem::new(alone.as_ref(), &vec![1.0; alone.slots().len()]);
        own.weigh(fit.problem.references().to_vec());
        own.set_noise(&fit.noises, |_, slot, k| {
            fit.problem.whiteners()[left][slot].counts(k)
        });
        let mut start = trained.parameters[..globals].to_vec();
        start.extend(fit.problem.of_run(left, &fit.at).into_iter().skip(globals));
        let held: Vec<bool> = (0..start.len()).map(|i| i < globals).collect();
        let predicted = lm::descend(&own, start, &held, ENOUGH)?.0;
        let channels = alone.channels(0, &predicted.parameters)?;
        out.push(CrossValidation {
            run: runs[left].name.clone(),
            held: now
                .iter()
                .map(|i| coefficients[*i].key().to_owned())
                .collect(),
            left_out: channels.iter().map(|c| (c.name.clone(), c.rms())).collect(),
            fitted: full
                .runs
                .get(left)
                .map(|r| r.rms.clone())
                .unwrap_or_default(),
        });
    }
    Ok(out)
}
