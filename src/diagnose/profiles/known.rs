//! Test of whether the frames show effects whose numbers are known: the observer's side of a sealed case.
//!
//! Fits begin at the known numbers, so that no search stands between the frames and the answer: an effect is shown where
//! the model with all that is there is worth more than the one without it, by what establishes it. Compared with what a
//! search found, it tells a search that failed from frames that cannot show more.

use super::candidate::{Base, Candidate, library};
use super::findings::{ImageError, moving, problem};
use super::fit::{Fitted, Free, Problem};
use super::geometry::Geometry;
use super::light::Looked;
use super::observe::ImageRun;
use super::search::Searched;
use crate::verdict::ESTABLISHED;
use hydroline_rigs::{PhysicsEntry, Rig};
use hydroline_sim::effect::{CheckedEffect, check};

/// A run's poses with their times \[s\].
pub type Poses = Vec<(f64, [f64; 6])>;

/// Whether the frames show each of the effects that are there, in the order given.
///
/// # Errors
/// [`ImageError`].
pub fn shown(
    runs: &[ImageRun],
    rig: &Rig,
    truth: &[PhysicsEntry],
) -> Result<Vec<bool>, ImageError> {
    let base = Base::new(rig)?;
    let candidates = library(&base);
    let known = check(truth)?;
    let moves = |e: &CheckedEffect| candidates.iter().position(|c| c.info.id == e.info.id);
    let moved: Vec<(usize, &CheckedEffect)> = (known.iter())
        .filter_map(|e| Some((moves(e)?, e)))
        .collect();
    let chosen: Vec<&Candidate> = moved.iter().map(|(k, _)| &candidates[*k]).collect();
    let numbers: Vec<Vec<f64>> = moved.iter().map(|(_, e)| e.numbers.clone()).collect();
    let more: Vec<_> = (chosen.iter().zip(&numbers))
        .map(|(c, n)| (c.info, n.as_slice()))
        .collect();
    let optics = base.optics(&more).ok_or(ImageError::NoPose)?;
    let geometry = Geometry::new(rig, optics);
    let light: Vec<CheckedEffect> = known
        .iter()
        .filter(|e| moves(e).is_none())
        .cloned()
        .collect();
    let looked = Looked::known(runs, rig, &base, &geometry, &light);
    let without = looked.as_ref().filter(|_| !light.is_empty());
    let cleared = without.and_then(|(l, _)| l.removed(runs, &geometry, None));
    let cleared = moving(&cleared.unwrap_or_else(|| runs.to_vec()));
    let problem = problem(&cleared, rig, base.clone())?;
    let odds = (ESTABLISHED / (1.0 - ESTABLISHED)).ln();
    let fit = |but: Option<usize>| without_one(&problem, &candidates, &moved, but);
    let all = fit(None);
    Ok((known.iter())
        .map(|e| match moves(e) {
            Some(k) => {
                let less = fit(Some(k)).map_or(f64::NEG_INFINITY, |f| Searched::score(&f));
                all.as_ref()
                    .is_some_and(|a| Searched::score(a) > less + odds)
            }
            None => {
                let place = light.iter().position(|l| l.info.id == e.info.id);
                let gains = looked.as_ref().map(|(_, gains)| gains);
                place
                    .and_then(|p| gains?.get(p).copied())
                    .is_some_and(|g| g > odds)
            }
        })
        .collect())
}

/// Fit of the effects that move the stripe, from their known numbers, but for one candidate.
fn without_one(
    problem: &Problem<'_>,
    candidates: &[Candidate],
    moved: &[(usize, &CheckedEffect)],
    but: Option<usize>,
) -> Option<Fitted> {
    let kept = || moved.iter().filter(|(k, _)| Some(*k) != but);
    let chosen: Vec<&Candidate> = kept().map(|(k, _)| &candidates[*k]).collect();
    let numbers = kept().map(|(_, e)| e.numbers.clone()).collect();
    let begin = problem.placed(&chosen, numbers, false)?;
    let effects: Vec<usize> = kept().map(|(k, _)| *k).collect();
    problem
        .fit(candidates, &effects, begin, Free::All)
        .inspect(|f| f.trace("truth"))
}

/// Poses of frames in which there is no effect, as the profiles give them; `None` where they give none.
///
/// # Errors
/// [`ImageError`].
pub fn poses(runs: &[ImageRun], rig: &Rig) -> Result<Option<Vec<Poses>>, ImageError> {
    let base = Base::new(rig)?;
    let candidates = library(&base);
    let runs = moving(runs);
    let problem = problem(&runs, rig, base)?;
    let fit = without_one(&problem, &candidates, &[], None);
    let timed = |(run, poses): (&ImageRun, &Vec<[f64; 6]>)| {
        let frames = run.frames.iter().zip(poses);
        frames.map(|(f, p)| (f.t_s, *p)).collect()
    };
    Ok(fit.map(|f| runs.iter().zip(&f.state.poses).map(timed).collect()))
}
