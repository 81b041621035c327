//! Nothing, each, pairs and more: which explanation the profiles are evidence for.

use super::anytime::Anytime;
use super::candidate::Candidate;
use super::fit::{Fitted, Free, Problem, State};
use super::model::Kind;
use super::prior::FIRST;
use super::start;
use hydroline_numerics::parallel;
use hydroline_sim::effect::CheckedEffect;
use nalgebra::DVector;
use std::collections::HashSet;

/// log prior odds of each effect more: one in twenty.
pub const LOG_ODDS: f64 = -3.0;
/// Log posterior by which an explanation must beat nothing.
pub const ESTABLISHED: f64 = 6.0;
/// Log posterior within which two explanations are tied: one in a hundred.
pub const TIED: f64 = 4.6;
/// Rows left by more than this, and starting points other than the rig's own are tried \[px\].
pub(super) const ASTRAY_PX: f64 = 0.15;
/// Ends of tops left by more than this lie on the wrong sides \[px\].
const DISPLACED_PX: f64 = 0.3;
/// Times that poses are found anew at most.
const REPOSED: usize = 3;
/// Spread by kind with which a fit begins that is far off: no measurement passes for stray \[px\].
pub(super) const ANY_PX: [f64; 3] = [60.0, 5.0, 60.0];
/// Log posterior within which explanations are compared from equal starts.
const CLOSE: f64 = 40.0;
/// log evidence that an effect more must have predicted.
const PROMISING: f64 = 0.5;
/// Explanations that are built upon.
const BEAM: usize = 3;
/// log evidence that a start elsewhere must have predicted \[nat\].
const GAIN: f64 = 1.0;
/// Rounds in which explanations give each other what they found, at most.
const SHARED: usize = 6;
/// Explanations that each takes from.
const DONORS: usize = 2;
/// Effects in one explanation at most.
const DEEPEST: usize = 3;

/// Outcome of the search.
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

/// Searches as far as the limit leaves time for; `None` where no hypothesis gives the frames a pose.
pub fn search(
    problem: &Problem<'_>,
    candidates: &[Candidate],
    asked: &Anytime<'_>,
) -> Option<Searched> {
    asked.tell("image level: nothing left out");
    let nothing = problem
        .placed(&[], Vec::new(), false)
        .and_then(|s| problem.fit(candidates, &[], s, Free::All));
    // Where the rig's own camera hardly explains a frame, the poses it gives are no place to
    // start from: those under each effect at its typical size are.
    let astray = nothing
        .as_ref()
        .is_none_or(|f| f.rms_px(Kind::Row) > ASTRAY_PX);
    let mut others: Vec<(usize, Fitted)> = Vec::new();
    if astray {
        for (k, c) in candidates.iter().enumerate() {
            if nothing.is_some() && asked.is_over() {
                break;
            }
            asked.tell(c.info.id);
            let typical = CheckedEffect::typical(c.info).numbers;
            let middle: Vec<f64> = c
                .info
                .parameters
                .iter()
                .map(|p| 0.5 * (p.plausible.0 + p.plausible.1))
                .collect();
            for start in [typical, middle].into_iter().filter(|s| *s != c.neutral) {
                let begin = problem.placed(&[c], vec![start], true);
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
    keep_better(others.into_iter().map(|o| Some(o.1)).collect(), &mut all);
    let singles: Vec<usize> = (0..candidates.len()).collect();
    extend(
        problem,
        candidates,
        std::slice::from_ref(&nothing),
        &singles,
        &mut all,
        asked,
    );
    let mut tried = Tried::default();
    share(problem, candidates, &mut all, &mut tried, asked);
    for size in 1..DEEPEST {
        sort(&mut all);
        let beam: Vec<Fitted> = all
            .iter()
            .filter(|f| f.effects.len() == size)
            .take(BEAM)
            .cloned()
            .collect();
        let top = all.first().map(Searched::score);
        let nothing = all
            .iter()
            .find(|f| f.effects.is_empty())
            .map_or(f64::NEG_INFINITY, Searched::score);
        // Deeper only from what beats nothing, and while the last level was worth it.
        let worth = all
            .iter()
            .filter(|f| f.effects.len() == size)
            .any(|f| Searched::score(f) > nothing + 1.0 && Some(Searched::score(f)) == top);
        if !worth {
            break;
        }
        extend(problem, candidates, &beam, &singles, &mut all, asked);
        share(problem, candidates, &mut all, &mut tried, asked);
    }
    exchange(problem, candidates, &mut all, asked);
    for _ in 0..3 {
        prune(problem, candidates, &mut all, asked);
        sort(&mut all);
        let evened = even(problem, candidates, &mut all, asked);
        if !share(problem, candidates, &mut all, &mut tried, asked) && !evened {
            break;
        }
    }
    sort(&mut all);
    let nothing = all.iter().find(|f| f.effects.is_empty())?.clone();
    for f in all.iter().take(3 * BEAM) {
        f.trace("explanation");
    }
    Some(Searched { nothing, all })
}

/// Tries in place of the best explanation's effects another one each, and each alone, from the poses
/// that the best ended in: an effect whose own fit began where the rig's camera puts the vehicle may
/// have stopped far from its best, and two others together fit as well.
fn exchange(
    problem: &Problem<'_>,
    candidates: &[Candidate],
    all: &mut Vec<Fitted>,
    asked: &Anytime<'_>,
) {
    for _ in 0..DEEPEST {
        sort(all);
        let Some(best) = all.first().filter(|b| b.effects.len() > 1).cloned() else {
            return;
        };
        asked.tell("in place of what was found");
        let others = || (0..candidates.len()).filter(|k| !best.effects.contains(k));
        let instead = (0..best.effects.len()).flat_map(|place| {
            let best = &best;
            others().map(move |k| {
                let (mut effects, mut begin) = (best.effects.clone(), unsure(&best.state));
                (effects[place], begin.numbers[place]) = (k, candidates[k].neutral.clone());
                (effects, begin)
            })
        });
        let alone = (0..candidates.len()).map(|k| {
            let numbers = vec![candidates[k].neutral.clone()];
            let begin = State {
                numbers,
                ..unsure(&best.state)
            };
            (vec![k], begin)
        });
        let tries: Vec<(Vec<usize>, State)> = instead.chain(alone).collect();
        let found = parallel::map_owned(tries, |(effects, begin)| {
            if asked.is_over() {
                return None;
            }
            let fit = problem.fit(candidates, &effects, begin, Free::All)?;
            Some(settled(problem, candidates, fit, &best))
        });
        keep_better(found, all);
        sort(all);
        if all.first().is_some_and(|b| b.effects == best.effects) {
            return;
        }
    }
}

/// A state at which nothing passes for stray and any motion prior may come.
fn unsure(state: &State) -> State {
    State {
        motion_priors: FIRST,
        floors: ANY_PX,
        ..state.clone()
    }
}

/// Takes effects out again one by one, starting where the larger set ended: a set found late may
/// hold what it no longer needs, and a small set may have been left in a worse place.
fn prune(
    problem: &Problem<'_>,
    candidates: &[Candidate],
    all: &mut Vec<Fitted>,
    asked: &Anytime<'_>,
) {
    for _ in 0..DEEPEST {
        sort(all);
        let top = all.first().map_or(0.0, Searched::score);
        let tries: Vec<(Fitted, usize)> = all
            .iter()
            .filter(|f| Searched::score(f) > top - 2.0 * TIED)
            .take(BEAM)
            .flat_map(|f| (0..f.effects.len()).map(move |k| (f.clone(), k)))
            .collect();
        let found = parallel::map_owned(tries, |(f, k)| {
            if asked.is_over() {
                return None;
            }
            let mut begin = f.state.clone();
            begin.numbers.remove(k);
            let mut effects = f.effects.clone();
            effects.remove(k);
            problem.fit(candidates, &effects, begin, Free::All)
        });
        if !keep_better(found, all) {
            break;
        }
    }
}

/// Gives explanations that are close the motion priors of each other to start from: which of several local
/// optima a fit ends in must not decide between them. Whether any became better.
fn even(
    problem: &Problem<'_>,
    candidates: &[Candidate],
    all: &mut Vec<Fitted>,
    asked: &Anytime<'_>,
) -> bool {
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
            if from.state.motion_priors != to.state.motion_priors {
                let state = State {
                    motion_priors: from.state.motion_priors,
                    ..to.state.clone()
                };
                tries.push((to.clone(), state));
            }
        }
    }
    let found = parallel::map_owned(tries, |(f, state)| {
        if asked.is_over() {
            return None;
        }
        problem.fit(candidates, &f.effects, state, Free::All)
    });
    keep_better(found, all)
}

/// Gives every explanation that counts what the others found of the frames, until none becomes
/// better: a fit ends in one of many optima, and explanations are compared by what they can do, not
/// by where their fits happened to begin.
///
/// Two things are owed. An effect more can do nothing, so a set is worth at least what it is where a
/// part of it ended. And a frame lies on one flank of one hexagon whatever moved the stripe: where
/// the best has its measurements belong elsewhere, the others try them there too, with its motion priors.
fn share(
    problem: &Problem<'_>,
    candidates: &[Candidate],
    all: &mut Vec<Fitted>,
    tried: &mut Tried,
    asked: &Anytime<'_>,
) -> bool {
    let mut any = false;
    for _ in 0..SHARED {
        sort(all);
        let owed: Vec<Fitted> = all
            .iter()
            .enumerate()
            .filter(|(place, f)| *place < 2 * BEAM || f.effects.len() <= 1)
            .map(|(_, f)| f.clone())
            .collect();
        let mut tries: Vec<(Vec<usize>, State, Option<f64>)> = Vec::new();
        for to in &owed {
            let better = |f: &&Fitted| f.log_evidence > to.log_evidence;
            let part = all
                .iter()
                .filter(better)
                .filter(|f| f.effects.len() + 1 == to.effects.len())
                .filter(|f| f.effects.iter().all(|e| to.effects.contains(e)))
                .max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence));
            if let Some(part) = part.filter(|f| tried.news(to, f, 0)) {
                let mut begin = part.state.clone();
                let mut effects = part.effects.clone();
                let more = to.effects.iter().filter(|e| !part.effects.contains(e));
                for e in more {
                    begin.numbers.push(candidates[*e].neutral.clone());
                    effects.push(*e);
                }
                tries.push((effects, begin, Some(to.log_evidence + GAIN)));
            }
            for from in all.iter().filter(better).take(DONORS) {
                if let Some(state) = taken_over(to, from).filter(|_| tried.news(to, from, 1)) {
                    tries.push((to.effects.clone(), state, None));
                }
            }
        }
        if tries.is_empty() {
            break;
        }
        asked.tell("what one found of the frames, for the others");
        let found = parallel::map_owned(tries, |(effects, begin, least_gain)| {
            if asked.is_over() {
                return None;
            }
            if let Some(least) = least_gain
                && problem
                    .screened(candidates, &effects, begin.clone())?
                    .log_evidence
                    < least
            {
                return None;
            }
            problem.fit(candidates, &effects, begin, Free::All)
        });
        if !keep_better(found, all) {
            break;
        }
        any = true;
    }
    any
}

/// Starts of [`share`] that were tried already.
#[derive(Default)]
struct Tried(HashSet<(Place, Place, u8)>);

/// A set and what its fit is worth \[nat\].
type Place = (Vec<usize>, i64);

impl Tried {
    /// Whether a fit of `to` has not yet begun from what `from` found, in this way.
    fn news(&mut self, to: &Fitted, from: &Fitted, way: u8) -> bool {
        // To a nat: what gained less is no news.
        let key = |f: &Fitted| (f.effects.clone(), f.log_evidence.round() as i64);
        self.0.insert((key(to), key(from), way))
    }
}

/// `to` with the motion priors of `from` and with the frames whose measurements belong elsewhere in `from`
/// moved there: as far off `from`'s poses as the nearest frame is in which both agree. `None` where
/// they agree in all frames and in the motion priors.
fn taken_over(to: &Fitted, from: &Fitted) -> Option<State> {
    let agree: Vec<bool> = (to.belongs.iter())
        .zip(&from.belongs)
        .map(|(a, b)| a.agrees(b))
        .collect();
    // A stiff path with scattered ends of tops and a path that follows them are two optima of their
    // own: the motion priors alone are reason enough.
    if agree.iter().all(|a| *a) && to.state.motion_priors == from.state.motion_priors {
        return None;
    }
    let mut poses = from.state.poses.clone();
    let mut first = 0;
    for (own, other) in to.state.poses.iter().zip(&mut poses) {
        let agree = &agree[first..first + own.len()];
        first += own.len();
        let off: Vec<Option<[f64; 6]>> = (own.iter().zip(other.iter()).zip(agree))
            .map(|((o, f), same)| same.then(|| std::array::from_fn(|d| o[d] - f[d])))
            .collect();
        *other = start::filled(&off, other);
    }
    let least = Kind::ALL.map(|k| k.floors().1);
    Some(State {
        poses,
        motion_priors: from.state.motion_priors,
        floors: std::array::from_fn(|k| to.state.floors[k].max(least[k])),
        ..to.state.clone()
    })
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
    asked: &Anytime<'_>,
) {
    let tries: Vec<(&Fitted, usize)> = from
        .iter()
        .flat_map(|f| with.iter().map(move |k| (f, *k)))
        .filter(|(f, k)| !f.effects.contains(k))
        .collect();
    let found = parallel::map_slice(&tries, |&(f, k)| {
        if asked.is_over() {
            return None;
        }
        let mut effects = f.effects.clone();
        effects.push(k);
        let names: Vec<&str> = effects.iter().map(|e| candidates[*e].info.id).collect();
        asked.tell(&names.join(" + "));
        let mut begin = f.state.clone();
        begin.numbers.push(candidates[k].neutral.clone());
        // Onto what explains the frames already, only what has a predicted gain is worth a fit.
        if !f.effects.is_empty() {
            let seen = problem.screened(candidates, &effects, begin.clone())?;
            if seen.log_evidence < f.log_evidence + PROMISING {
                return None;
            }
        }
        // The motion priors of nothing make up for the very effect that is looked for: new ones too.
        let single = f.effects.is_empty();
        let anew = single.then(|| State {
            motion_priors: FIRST,
            ..begin.clone()
        });
        let fits = std::iter::once(begin)
            .chain(anew)
            .filter_map(|b| problem.fit(candidates, &effects, b, Free::All));
        let best = fits.max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))?;
        Some(if single {
            settled(problem, candidates, best, f)
        } else {
            best
        })
    });
    keep_better(found, all);
}

/// The same explanation from poses found anew under its numbers.
fn reposed(problem: &Problem<'_>, candidates: &[Candidate], fit: &Fitted) -> Option<Fitted> {
    let chosen: Vec<&Candidate> = fit.effects.iter().map(|k| &candidates[*k]).collect();
    let begin = problem.placed(&chosen, fit.state.numbers.clone(), false)?;
    problem.fit(candidates, &fit.effects, begin, Free::All)
}

/// A fit that leaves rows or ends of tops far off has numbers that are about right and frames that lie
/// on the wrong side of a step; and one that is better than `than` may still have single frames on the
/// other flank of a hexagon, where a disturbance makes up for them. Poses found anew under its numbers lead on.
fn settled(
    problem: &Problem<'_>,
    candidates: &[Candidate],
    first: Fitted,
    than: &Fitted,
) -> Fitted {
    let displaced = |f: &Fitted| {
        f.rms_px(Kind::Row) > ASTRAY_PX
            || f.state.floors[Kind::End as usize] > DISPLACED_PX
            || Searched::score(f) > Searched::score(than) + TIED
    };
    let mut best = first;
    for _ in 0..REPOSED {
        if !displaced(&best) {
            break;
        }
        match reposed(problem, candidates, &best) {
            Some(again) if again.log_evidence > best.log_evidence => {
                let little = again.log_evidence < best.log_evidence + TIED;
                best = again;
                if little {
                    break;
                }
            }
            _ => break,
        }
    }
    best
}

/// The better of two fits of a set stays; whether anything became better by what counts.
fn keep_better(found: Vec<Option<Fitted>>, all: &mut Vec<Fitted>) -> bool {
    let mut better = false;
    for fit in found.into_iter().flatten() {
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
