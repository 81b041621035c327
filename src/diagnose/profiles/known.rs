//! What an explanation is worth whose numbers are known: the observer's side of a sealed case.
//!
//! The fit begins at the known numbers and at the poses that they give the frames, so that no search
//! stands between the frames and the answer. Compared with what a search found, it tells a search
//! that failed from frames that cannot show more.

use super::candidate::{Base, vocabulary};
use super::findings::{Findings, ImageError, moving, problem};
use super::fit::Free;
use super::observe::ImageRun;
use super::search::Searched;
use hydroline_rigs::{PhysicsEntry, Rig};
use hydroline_sim::effect::{CheckedEffect, check};

/// Log posterior of one effect fitted from its known numbers \[nat\], with haze pulling as in `found`: on the
/// scale of [`Findings::score_of_nothing`]; `None` where the effect does not move the stripe or its
/// numbers give no pose.
///
/// # Errors
/// [`ImageError`].
pub fn score(
    runs: &[ImageRun],
    rig: &Rig,
    truth: &PhysicsEntry,
    found: &Findings,
) -> Result<Option<f64>, ImageError> {
    let runs = moving(runs);
    let base = Base::new(rig)?;
    let candidates = vocabulary(&base);
    let known: Vec<CheckedEffect> = check(std::slice::from_ref(truth))?;
    let Some((k, numbers)) = known.first().and_then(|e| {
        let at = candidates.iter().position(|c| c.info.id == e.info.id)?;
        Some((at, vec![e.numbers.clone()]))
    }) else {
        return Ok(None);
    };
    let problem = problem(&runs, rig, base)?;
    let begin = problem.placed(&[&candidates[k]], numbers, false);
    Ok(begin
        .and_then(|b| problem.fit(&candidates, &[k], b, Free::All))
        .inspect(|f| f.told("truth"))
        .map(|f| Searched::score(&f)))
}
