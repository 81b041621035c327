//! Nothing, each, pairs and more: which explanation the profiles are evidence for.

use super::candidate::Candidate;
use super::fit::{Fitted, Free, Problem, State};
use super::model::Kind;
use super::prior::FIRST;
use super::start;
use hydroline_sim::effect::CheckedEffect;
use nalgebra::DVector;
use rayon::prelude::*;

/// log prior odds of each effect more: one in twenty.
pub const LOG_ODDS: f64 = -3.0;
/// Log posterior by which an explanation must beat nothing.
pub const ESTABLISHED: f64 = 6.0;
/// Log posterior within which two explanations are tied: one in a hundred.
pub const TIED: f64 = 4.6;
/// Rows left by more than this, and starting points other than the rig's own are tried \[px\].
pub(super) const ASTRAY_PX: f64 = 0.15;
/// Log posterior within which explanations are compared from equal starts.
const CLOSE: f64 = 40.0;
/// log evidence that an effect more must promise.
const PROMISING: f64 = 0.5;
/// Explanations that are built upon.
const BEAM: usize = 3;
/// Effects in one explanation at most.
const DEEPEST: usize = 3;

/// What the search found.
pub struct Searched {
    /// Without effects.
    pub nothing: Fitted,
    /// All explanations tried, most probable first; `nothing` is among them.
    pub all: Vec<Fitted>,
}

impl Searched {
    /// log posterior up to a constant.
    pub fn score(fit: &Fitted) -> f64 {
        fit.log_evidence + fit.simpler + LOG_ODDS * fit.effects.len() as f64
    }

    /// The most probable explanation, without what it could do without: each effect must be worth
    /// [`ESTABLISHED`] to what remains, and all of them to nothing.
    pub fn best(&self) -> &Fitted {
        let Some(mut best) = self.all.first() else {
            return &self.nothing;
        };
        loop {
            let within = |f: &&Fitted| {
                !f.effects.is_empty()
                    && f.effects.len() < best.effects.len()
                    && f.effects.iter().all(|e| best.effects.contains(e))
                    && Self::score(f) > Self::score(best) - ESTABLISHED
            };
            match self
                .all
                .iter()
                .filter(within)
                .max_by(|a, b| Self::score(a).total_cmp(&Self::score(b)))
            {
                Some(simpler) => best = simpler,
                None => break,
            }
        }
        if Self::score(best) > Self::score(&self.nothing) + ESTABLISHED {
            best
        } else {
            &self.nothing
        }
    }

    /// Explanations tied with the best, itself first, none containing another.
    pub fn tied(&self) -> Vec<&Fitted> {
        let best = self.best();
        let mut out: Vec<&Fitted> = vec![best];
        if best.effects.is_empty() {
            return out;
        }
        let limit = Self::score(best) - TIED;
        for fit in self
            .all
            .iter()
            .filter(|f| Self::score(f) > limit && !f.effects.is_empty())
        {
            let contained = |o: &&Fitted| {
                o.effects.iter().all(|e| fit.effects.contains(e))
                    || fit.effects.iter().all(|e| o.effects.contains(e))
            };
            if !out.iter().any(contained) {
                out.push(fit);
            }
        }
        out
    }

    /// Probability that an effect is part of the explanation, over all tried.
    pub fn probability(&self, effect: usize) -> f64 {
        let top = self
            .all
            .iter()
            .map(Self::score)
            .fold(f64::NEG_INFINITY, f64::max);
        let (with, all) = self.all.iter().fold((0.0, 0.0), |(w, a), f| {
            let p = (Self::score(f) - top).exp();
            (
                if f.effects.contains(&effect) {
                    w + p
                } else {
                    w
                },
                a + p,
            )
        });
        if all > 0.0 { with / all } else { 0.0 }
    }
}

/// Searches; `None` where no hypothesis gives the frames a pose.
pub fn search(
    problem: &Problem<'_>,
    candidates: &[Candidate],
    progress: &(dyn Fn(&str) + Sync),
) -> Option<Searched> {
    progress("image level: nothing left out");
    let poses = |effects: &[&Candidate], numbers: &[Vec<f64>], rough: bool| {
        let g = problem.geometry(effects, numbers)?;
        start::poses(problem.rig, &g, problem.runs, &problem.motions, rough)
    };
    let own = poses(&[], &[], false).map(|p| problem.first(p));
    let nothing = own.and_then(|s| problem.fit(candidates, &[], s, Free::All));
    // Where the rig's own camera hardly explains a frame, the poses it gives are no place to
    // start from: those under each effect at its typical size are.
    let astray = nothing
        .as_ref()
        .is_none_or(|f| f.rms_px(Kind::Row) > ASTRAY_PX);
    let mut others: Vec<(usize, Fitted)> = Vec::new();
    if astray {
        for (k, c) in candidates.iter().enumerate() {
            progress(c.info.id);
            let typical = CheckedEffect::typical(c.info).numbers;
            let middle: Vec<f64> = c
                .info
                .parameters
                .iter()
                .map(|p| 0.5 * (p.plausible.0 + p.plausible.1))
                .collect();
            for start in [typical, middle].into_iter().filter(|s| *s != c.neutral) {
                let numbers = vec![start];
                let begin = poses(&[c], &numbers, true).map(|p| State {
                    numbers,
                    ..problem.first(p)
                });
                if let Some(f) = begin.and_then(|s| problem.fit(candidates, &[k], s, Free::All)) {
                    others.push((k, f));
                }
            }
        }
    }
    let nothing = match nothing {
        Some(nothing) => nothing,
        None => {
            let best = others
                .iter()
                .max_by(|a, b| a.1.log_evidence.total_cmp(&b.1.log_evidence))?;
            let begin = State {
                numbers: Vec::new(),
                ..best.1.state.clone()
            };
            problem.fit(candidates, &[], begin, Free::All)?
        }
    };
    let mut all = vec![nothing.clone()];
    keep_better(others.into_iter().map(|o| o.1).collect(), &mut all);
    let mut nothing = nothing;
    let singles: Vec<usize> = (0..candidates.len()).collect();
    extend(
        problem,
        candidates,
        &[nothing.clone()],
        &singles,
        &mut all,
        progress,
    );
    // Where an effect's fit found better poses, nothing is owed the same start.
    sort(&mut all);
    if let Some(best) = all.first().filter(|b| !b.effects.is_empty()) {
        let begin = State {
            numbers: Vec::new(),
            ..best.state.clone()
        };
        if let Some(again) = problem.fit(candidates, &[], begin, Free::All)
            && again.log_evidence > nothing.log_evidence
        {
            nothing = again;
            all.retain(|f| !f.effects.is_empty());
            all.push(nothing.clone());
        }
    }
    for size in 1..DEEPEST {
        sort(&mut all);
        let beam: Vec<Fitted> = all
            .iter()
            .filter(|f| f.effects.len() == size)
            .take(BEAM)
            .cloned()
            .collect();
        let top = all.first().map(Searched::score);
        // Deeper only from what beats nothing, and while the last level was worth it.
        let worth = all.iter().filter(|f| f.effects.len() == size).any(|f| {
            Searched::score(f) > Searched::score(&nothing) + 1.0 && Some(Searched::score(f)) == top
        });
        if !worth {
            break;
        }
        extend(problem, candidates, &beam, &singles, &mut all, progress);
    }
    for _ in 0..2 {
        prune(problem, candidates, &mut all);
        sort(&mut all);
        if !even(problem, candidates, &mut all) {
            break;
        }
    }
    sort(&mut all);
    if let Some(again) = all.iter().find(|f| f.effects.is_empty()) {
        nothing = again.clone();
    }
    Some(Searched { nothing, all })
}

/// Takes effects out again one by one, starting where the larger set ended: a set found late may
/// hold what it no longer needs, and a small set may have been left in a worse place.
fn prune(problem: &Problem<'_>, candidates: &[Candidate], all: &mut Vec<Fitted>) {
    for _ in 0..DEEPEST {
        sort(all);
        let top = all.first().map_or(0.0, Searched::score);
        let tries: Vec<(Fitted, usize)> = all
            .iter()
            .filter(|f| Searched::score(f) > top - 2.0 * TIED)
            .take(BEAM)
            .flat_map(|f| (0..f.effects.len()).map(move |k| (f.clone(), k)))
            .collect();
        let found: Vec<Fitted> = tries
            .into_par_iter()
            .filter_map(|(f, k)| {
                let mut begin = f.state.clone();
                begin.numbers.remove(k);
                let mut effects = f.effects.clone();
                effects.remove(k);
                problem.fit(candidates, &effects, begin, Free::All)
            })
            .collect();
        if !keep_better(found, all) {
            break;
        }
    }
}

/// Gives explanations that are close the wobbles of each other to start from: which of several local
/// optima a fit ends in must not decide between them. Whether any became better.
fn even(problem: &Problem<'_>, candidates: &[Candidate], all: &mut Vec<Fitted>) -> bool {
    let top = all.first().map_or(0.0, Searched::score);
    let close: Vec<Fitted> = all
        .iter()
        .filter(|f| Searched::score(f) > top - CLOSE)
        .take(2 * BEAM)
        .cloned()
        .collect();
    let mut tries: Vec<(Fitted, State)> = Vec::new();
    for to in &close {
        for from in close.iter().take(BEAM) {
            if from.state.wobbles != to.state.wobbles {
                let state = State {
                    wobbles: from.state.wobbles,
                    ..to.state.clone()
                };
                tries.push((to.clone(), state));
            }
        }
        let quiet = quieted(&to.state);
        tries.push((to.clone(), quiet));
    }
    let found: Vec<Fitted> = tries
        .into_par_iter()
        .filter_map(|(f, state)| problem.fit(candidates, &f.effects, state, Free::All))
        .collect();
    keep_better(found, all)
}

fn sort(all: &mut [Fitted]) {
    all.sort_by(|a, b| Searched::score(b).total_cmp(&Searched::score(a)));
}

/// Fits every explanation of `from` with one candidate more; the better of two fits of a set stays.
fn extend(
    problem: &Problem<'_>,
    candidates: &[Candidate],
    from: &[Fitted],
    with: &[usize],
    all: &mut Vec<Fitted>,
    progress: &(dyn Fn(&str) + Sync),
) {
    let tries: Vec<(&Fitted, usize)> = from
        .iter()
        .flat_map(|f| with.iter().map(move |k| (f, *k)))
        .filter(|(f, k)| !f.effects.contains(k))
        .collect();
    let found: Vec<Fitted> = tries
        .into_par_iter()
        .filter_map(|(f, k)| {
            let mut effects = f.effects.clone();
            effects.push(k);
            let names: Vec<&str> = effects.iter().map(|e| candidates[*e].info.id).collect();
            progress(&names.join(" + "));
            let mut begin = f.state.clone();
            begin.numbers.push(candidates[k].neutral.clone());
            // Onto what explains the frames already, only what promises something is worth a fit.
            if !f.effects.is_empty() {
                let seen = problem.glance(candidates, &effects, begin.clone())?;
                if seen.log_evidence < f.log_evidence + PROMISING {
                    return None;
                }
            }
            // The wobbles of nothing make up for the very effect that is looked for: quiet ones too.
            let single = f.effects.is_empty();
            let quiet = single.then(|| quieted(&begin));
            let anew = single.then(|| State {
                wobbles: FIRST,
                ..begin.clone()
            });
            let fits = std::iter::once(begin)
                .chain(quiet)
                .chain(anew)
                .filter_map(|b| problem.fit(candidates, &effects, b, Free::All));
            fits.max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))
        })
        .collect();
    keep_better(found, all);
}

/// A state with nearly no wobble: what is needed grows back, what was only in the way does not.
fn quieted(state: &State) -> State {
    let mut quiet = state.clone();
    for w in &mut quiet.wobbles {
        (w.sd, w.drive) = (0.03 * w.sd, 0.01 * w.drive);
    }
    quiet
}

/// The better of two fits of a set stays; whether anything became better by what counts.
fn keep_better(found: Vec<Fitted>, all: &mut Vec<Fitted>) -> bool {
    let mut better = false;
    for fit in found {
        let same = |o: &Fitted| {
            o.effects.len() == fit.effects.len()
                && o.effects.iter().all(|e| fit.effects.contains(e))
        };
        match all.iter_mut().find(|o| same(o)) {
            Some(old) if old.log_evidence >= fit.log_evidence => {}
            Some(old) => {
                better |= fit.log_evidence > old.log_evidence + 0.5;
                *old = fit;
            }
            None => {
                better = true;
                all.push(fit);
            }
        }
    }
    better
}

/// Log Bayes factor that these frames would give a candidate of typical size: what is left of it
/// once poses and shared numbers have taken what they can (masked sensitivities).
pub fn visibility(candidate: &Candidate, fit: &Fitted) -> f64 {
    let typical = CheckedEffect::typical(candidate.info).numbers;
    let n = candidate.neutral.len();
    if fit.masked.nrows() != n {
        return f64::NAN;
    }
    let size = DVector::from_iterator(
        n,
        (0..n).map(|k| (typical[k] - candidate.neutral[k]) / candidate.prior_sd[k]),
    );
    // The posterior's precision holds the prior's, which is one.
    0.5 * (size.dot(&(&fit.masked * &size)) - size.norm_squared()).max(0.0)
}
