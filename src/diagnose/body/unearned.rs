//! Members of the likeliest model that make it predict worse: they are named by nobody.
//!
//! One rule for every member: runs that the others predict, and those held out, are predicted no worse with it than without
//! it ([`Problem::predicts_worse`]). What fails is in no model any more; the next likeliest is asked in turn.

use hydroline_inference::fit::{Effort, Fit, Problem};
use hydroline_inference::limit::Limit;
use hydroline_inference::posterior::Posterior;
use hydroline_inference::prediction::Prediction;
use hydroline_inference::search::Found;
use hydroline_inference::term::Kind;

use super::found::relative;

/// Members that are taken out, one after the other, at most.
const TAKEN_MOST: usize = 4;

/// Takes members of the likeliest model out of all models while it predicts worse with one of them than without it; their
/// names. `held` = runs held out. Ends early where the limit is over.
pub fn take_out_unearned(found: &mut Found, held: Option<&Problem>, limit: Limit) -> Vec<String> {
    let mut gone = Vec::new();
    while gone.len() < TAKEN_MOST && !limit.is_over() {
        let Some((candidate, without)) = unearned(found, held, limit) else {
            break;
        };
        gone.push(found.problem.body.candidates[candidate].name());
        let trend = |t: &usize| {
            let kind = found.problem.body.candidates[*t].kind;
            *t == candidate || kind == Kind::Trend { of: candidate }
        };
        found.models.retain(|terms, _| !terms.iter().any(trend));
        found.fits += 1;
        found.models.entry(without.terms.clone()).or_insert(without);
    }
    gone
}

/// The last member of the likeliest model without which runs are predicted better, with that model.
fn unearned(found: &Found, held: Option<&Problem>, limit: Limit) -> Option<(usize, Fit)> {
    let problem = &found.problem;
    let posterior = Posterior::new(found);
    let best = found.models.get(&posterior.models.first()?.0)?;
    let weights = problem.weights(best);
    let candidates = &problem.body.candidates;
    let asked: Vec<usize> = (0..best.terms.len())
        .filter(|m| {
            let of = &candidates[best.terms[*m]];
            of.kind != Kind::Effect || relative(&weights[*m], &problem.body.tolerance) > 1.0
        })
        .collect();
    // One effect alone is held against the vehicle alone elsewhere.
    if best.terms.len() < 2 || asked.is_empty() {
        return None;
    }
    let is_many = problem.body.recording.runs.len() > 1;
    let predict = |fit: &Fit| -> Option<[Option<Prediction>; 2]> {
        let others = match is_many {
            true => Some(problem.one_run_out_within(fit, limit)?),
            false => None,
        };
        Some([others, held.and_then(|over| over.predict(fit))])
    };
    let with = predict(best)?;
    for member in asked.into_iter().rev() {
        let (terms, point) = problem.without(best, member);
        let fit = match found.models.get(&terms) {
            Some(known) => known.clone(),
            None => problem.fit(&terms, &point, best.cells.clone(), Effort::default())?,
        };
        let without = predict(&fit)?;
        let of = [Some(problem), held];
        let mut each = with.iter().zip(&without).zip(of);
        let is_worse = each.any(|((with, without), problem)| {
            let both = with.as_ref().zip(without.as_ref()).zip(problem);
            both.is_some_and(|((with, without), p)| p.predicts_worse(with, without))
        });
        if is_worse {
            return Some((best.terms[member], fit));
        }
    }
    None
}
