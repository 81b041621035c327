//! Which of several explanations stands, by evidence and by the runs held out.

use rayon::prelude::*;

use super::Explanation;
use crate::diagnose::bank::without;
use crate::diagnose::fit::{Fit, Posed};
use crate::diagnose::predict::{held_out, predicted_beside};
use crate::diagnose::search::Search;
use crate::diagnose::setting::Track;

/// rms of the runs held out over the least one, and over noise, above which an explanation is none.
const MISSED: f64 = 2.0;
/// rms of the runs held out without a member over that with it up to which it is not needed.
const AS_WELL: f64 = 1.02;
/// An explanation with one mechanism less whose heavy law is inexact may be this much worse in log
/// evidence: invent nothing.
pub const SPARING: f64 = 4.0;

/// The most likely of those that do not miss the runs held out by far more than noise and than
/// another one does. A force in time tells nothing of other runs and is not asked.
pub fn elect(
    search: &Search<'_>,
    contenders: Vec<Explanation>,
    held: &[Track],
) -> Option<Explanation> {
    let setting = search.setting;
    let noise = search.weights.noise;
    let miss = |e: &Explanation| match (&e.family, &e.twice) {
        (Some(f), _) => predicted_beside(setting, held, &e.fit, f, noise),
        (None, Some((_, two))) => held_out(setting, held, two, noise),
        (None, None) => held_out(setting, held, &e.fit, noise),
    };
    let missed: Vec<Option<f64>> = contenders.iter().map(miss).collect();
    let nothing = search
        .get(&[])
        .and_then(|f| held_out(setting, held, f, noise));
    let least = missed
        .iter()
        .chain([&nothing])
        .flatten()
        .copied()
        .fold(f64::INFINITY, f64::min);
    let bar = MISSED * least.max(noise.total_sd());
    for (e, m) in contenders.iter().zip(&missed) {
        tracing::debug!(
            "contender {:?} {:?}: {:.1}, held out {m:?} of {least:.2e}",
            e.fit.set,
            e.kind(),
            e.log_evidence
        );
    }
    let sound = |m: &Option<f64>| m.is_none_or(|m| m <= bar);
    // A bent law that misses is none even where nothing else predicts either: the bend was a free force.
    let any = missed.iter().any(sound) || contenders.iter().any(Explanation::unnamed);
    let sound =
        |e: &Explanation, m: &Option<f64>| sound(m) || (!missed.iter().any(sound) && e.unnamed());
    let mut best: Option<Explanation> = None;
    for (e, _) in contenders
        .into_iter()
        .zip(&missed)
        .filter(|(e, m)| !any || sound(e, m))
    {
        let better = best
            .as_ref()
            .is_none_or(|b| e.log_evidence - sparing(b, &e) > b.log_evidence - sparing(&e, b));
        if better {
            best = Some(e);
        }
    }
    best
}

/// Members of a set taken out as long as the runs held out are predicted as well without them.
pub fn by_prediction(search: &Search<'_>, from: &Fit, held: &[Track]) -> Option<Explanation> {
    let setting = search.setting;
    let noise = search.weights.noise;
    let mut now = from.clone();
    let mut miss = held_out(setting, held, &now, noise)?;
    while !now.set.is_empty() {
        let best = (0..now.set.len())
            .into_par_iter()
            .filter_map(|m| {
                let (set, at) = without(setting, &now, m);
                let fit = Posed::new(setting, &search.weights, &set).fit(at).ok()?;
                let miss = held_out(setting, held, &fit, noise)?;
                Some((fit, miss))
            })
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .filter(|(_, without)| *without <= AS_WELL * miss);
        let Some((fit, without)) = best else { break };
        (now, miss) = (fit, without.min(miss));
    }
    Some(Explanation {
        by_prediction: true,
        ..Explanation::plain(search, &now)
    })
}

/// What a bent law with fewer mechanisms may be worse than a plain set.
pub fn sparing(other: &Explanation, best: &Explanation) -> f64 {
    let fewer = other.fit.set.len() < best.fit.set.len();
    if fewer && other.bent().is_some() && best.bent().is_none() && !best.unnamed() {
        SPARING
    } else {
        0.0
    }
}
