//! A mechanism that acts twice (two stages, two springs), and what else is there beside it.
//!
//! Without the second one other effects imitate it, so the set is grown anew from the two alone.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::Explanation;
use super::beside::{SURELY_THERE, known, lacking, likeliest, too_slow};
use super::look::{INEXACT, TWICE_PENALTY, twice};
use crate::bank::{View, joined, motion, responses_at, whitened, without};
use crate::descent::Effort;
use crate::family::{Acts, Variable};
use crate::fit::{Fit, Posed};
use crate::rest::reduced;
use crate::search::Search;
use crate::setting::Setting;

/// Single effects that are doubled.
const DOUBLED: usize = 4;
/// Of those the ones that are grown.
const GROWN: usize = 2;
/// Steps at most.
const STEPS: usize = 6;
/// Additions fitted per step.
const ADDED: usize = 5;
/// Log evidence that a step must gain.
const STEP_GAIN: f64 = 0.1;
/// Share by which two equal stages may differ.
const EQUAL: f64 = 0.02;
/// A fit that would end this far above the present one's cost is not followed.
const TOO_FAR: f64 = 40.0;

/// The likeliest single effects doubled, each with what joins it; members of `also` with their numbers there.
pub fn doubled(search: &Search<'_>, also: &Fit, bar: f64) -> Vec<Explanation> {
    let ranked = search.ranked();
    let singles: Vec<&Fit> = ranked
        .into_iter()
        .filter(|f| f.set.len() == 1)
        .take(DOUBLED)
        .collect();
    let mut pairs: Vec<(usize, Fit)> = singles
        .into_par_iter()
        .filter_map(|fit| Some((fit.set[0], two_of(search, fit, 0)?)))
        .collect();
    pairs.sort_by(|a, b| b.1.log_evidence.total_cmp(&a.1.log_evidence));
    pairs
        .into_iter()
        .take(GROWN)
        .filter_map(|(candidate, two)| grown(search, candidate, two, also, bar))
        .collect()
}

/// Each heavy member of an explanation doubled, from itself alone on, with its numbers there or beside others, with what joins it.
pub fn doubled_members(search: &Search<'_>, found: &Explanation, bar: f64) -> Vec<Explanation> {
    let all = match found.simple() {
        true => Some(found.fit.clone()),
        // Without its function, and without the copy of what is two already.
        false => Posed::new(search.setting, &search.weights, &found.fit.set)
            .fit_with(found.fit.at.clone(), search.weights.to_a_percent())
            .ok(),
    };
    found
        .matters(search.setting.tolerance)
        .into_iter()
        .filter_map(|candidate| {
            // From where it is best by itself, and from the numbers that it has beside the others: so far from the noise
            // two may be no better than one where that one does the work of what is lacking.
            let own = by_itself(search, found, candidate);
            let two = search
                .get(&[candidate])
                .into_iter()
                .chain(&own)
                .filter_map(|fit| two_of(search, fit, 0))
                .max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))
                // A light one does too little by itself for a second one to show: beside the heaviest then, or all others.
                .or_else(|| {
                    let few = beside_the_heaviest(search, found, candidate)?;
                    let member = few.set.iter().position(|c| *c == candidate)?;
                    two_of(search, &few, member)
                })
                .or_else(|| {
                    let all = all.as_ref()?;
                    let member = all.set.iter().position(|c| *c == candidate)?;
                    two_of(search, all, member)
                })?;
            grown(search, candidate, two, &found.fit, bar)
        })
        .collect()
}

/// A set with a member a second time, where that gains.
fn two_of(search: &Search<'_>, fit: &Fit, member: usize) -> Option<Fit> {
    let view = View::new(search.setting, &search.weights, fit);
    let two = twice(search, fit, &view, member)?;
    (two.log_evidence > fit.log_evidence + INEXACT).then_some(two)
}

/// A member fitted alone, from its numbers in the explanation.
fn by_itself(search: &Search<'_>, found: &Explanation, candidate: usize) -> Option<Fit> {
    let setting = search.setting;
    let member = found.fit.set.iter().position(|c| *c == candidate)?;
    let nothing = search.get(&[])?;
    let numbers = found.fit.member(setting, member);
    let (set, at) = joined(setting, nothing, candidate, numbers);
    let posed = Posed::new(setting, &search.weights, &set);
    let fit = posed.fit_with(at, search.weights.to_a_percent()).ok()?;
    fit.log_evidence.is_finite().then_some(fit)
}

/// A member fitted with the heaviest other one, from their numbers in the explanation.
fn beside_the_heaviest(search: &Search<'_>, found: &Explanation, candidate: usize) -> Option<Fit> {
    let setting = search.setting;
    let heaviest = (0..found.fit.set.len())
        .filter(|m| found.fit.set[*m] != candidate)
        .max_by(|a, b| found.weights[*a].total_cmp(&found.weights[*b]))?;
    let first = by_itself(search, found, found.fit.set[heaviest])?;
    let member = found.fit.set.iter().position(|c| *c == candidate)?;
    let (set, at) = joined(
        setting,
        &first,
        candidate,
        found.fit.member(setting, member),
    );
    let posed = Posed::new(setting, &search.weights, &set);
    posed.fit_with(at, search.weights.to_a_percent()).ok()
}

/// Whether an explanation bends, by the load, a law that has a corner in it.
pub fn bends_a_corner(search: &Search<'_>, e: &Explanation) -> bool {
    let corner = |c: usize| search.setting.vocabulary[c].info.parameters[0].corner;
    let of_load = |(_, v): (Acts, Variable)| v.quantity() == Variable::Load;
    e.kind().is_some_and(of_load) && e.bent().is_some_and(corner)
}

/// Members with a corner in the load as several thrusters side by side have it, in the place of a free function of the
/// load: of a force all such members, of a bend the one that bends.
pub fn side_by_side(search: &Search<'_>, free: &Explanation, bar: f64) -> Vec<Explanation> {
    let setting = search.setting;
    let of_load = free
        .kind()
        .is_some_and(|(_, v)| v.quantity() == Variable::Load);
    if !of_load {
        return Vec::new();
    }
    let corner = |c: &&usize| {
        setting.vocabulary[**c].info.parameters[0].corner && free.bent().is_none_or(|b| b == **c)
    };
    let fit = Posed::new(setting, &search.weights, &free.fit.set)
        .fit(free.fit.at.clone())
        .ok();
    let Some(fit) = fit else { return Vec::new() };
    fit.set
        .iter()
        .filter(corner)
        .filter_map(|candidate| {
            let member = fit.set.iter().position(|c| c == candidate)?;
            let view = View::new(setting, &search.weights, &fit);
            let two = twice(search, &fit, &view, member)?;
            grown(search, *candidate, two, &free.fit, bar)
        })
        .collect()
}

/// One that was found before, under the search's present weights, with what joins it now.
pub fn doubled_from(
    search: &Search<'_>,
    found: &Explanation,
    also: &Fit,
    bar: f64,
) -> Option<Explanation> {
    let (candidate, two) = found.twice.as_ref()?;
    let mut fit = Posed::new(search.setting, &search.weights, &two.set)
        .fit(two.at.clone())
        .ok()?;
    fit.log_evidence -= TWICE_PENALTY;
    grown(search, *candidate, fit, also, bar)
}

/// Additions and removals beside the two until none is better; given up where they will not come near the
/// log evidence `bar`.
fn grown(
    search: &Search<'_>,
    candidate: usize,
    mut now: Fit,
    also: &Fit,
    bar: f64,
) -> Option<Explanation> {
    let setting = search.setting;
    for _ in 0..STEPS {
        let sizes = now.sizes(setting);
        let mut jobs: Vec<(Vec<usize>, Vec<f64>)> = (0..now.set.len())
            .filter(|m| now.set[*m] != candidate && sizes[*m] < SURELY_THERE)
            .map(|m| without(setting, &now, m))
            .collect();
        let view = View::but(
            setting,
            &search.weights,
            &now,
            equal(search, candidate, &now),
        );
        let points = lacking(setting, &now, also);
        let there = responses_at(setting, &now, &points, &|set, globals, starts| {
            motion(setting, set, globals, starts)
        });
        let white: Vec<_> = there
            .par_iter()
            .map(|r| whitened(setting, &search.weights, &r.column))
            .collect();
        let mut promises = view.promises(search.bank(), search.white(), &now.set);
        promises.extend(view.promises(&there, &white, &now.set));
        let likeliest = likeliest(search, promises).into_iter().take(ADDED);
        jobs.extend(likeliest.map(|p| {
            let point = known(&points, &p).unwrap_or_else(|| search.begin(&now, &p));
            joined(setting, &now, p.candidate, &point)
        }));
        let effort = Effort {
            limit: now.cost + TOO_FAR,
            ..search.weights.to_a_percent()
        };
        let best = jobs
            .into_par_iter()
            .filter_map(|(set, at)| {
                let mut fit = Posed::new(setting, &search.weights, &set)
                    .fit_with(at, effort)
                    .ok()?;
                fit.log_evidence -= TWICE_PENALTY;
                // Two equal stages are one another's twins: that confounds nothing.
                let twins = |c: &usize| *c == candidate;
                let sound =
                    fit.log_evidence.is_finite() && fit.confounded(setting).iter().all(twins);
                sound.then_some(fit)
            })
            .max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))
            .filter(|f| f.log_evidence > now.log_evidence + STEP_GAIN);
        tracing::trace!(
            "doubled {candidate} {:?} {:.1} -> {:?}",
            now.set,
            now.log_evidence,
            best.as_ref().map(|b| (&b.set, b.log_evidence))
        );
        let Some(better) = best else { break };
        let gained = better.log_evidence - now.log_evidence;
        now = better;
        if too_slow(gained, bar - now.log_evidence) {
            break;
        }
    }
    tracing::debug!("doubled {candidate}: {:?} {:.1}", now.set, now.log_evidence);
    // What a rig file can hold of it: each effect once.
    let once = merged(setting, &now, candidate).or_else(|| {
        let copy = now.set.iter().position(|c| *c == candidate)?;
        let (set, at) = without(setting, &now, copy);
        Posed::new(setting, &search.weights, &set).fit(at).ok()
    })?;
    Some(Explanation::doubled(search, candidate, now, &once))
}

/// One corner amid those side by side, all other numbers as they stand beside these; `None` for what acts in a row.
/// Fitted again with a single corner the others would do the work of the rest.
pub fn merged(setting: &Setting, two: &Fit, candidate: usize) -> Option<Fit> {
    if !setting.vocabulary[candidate].info.parameters[0].corner {
        return None;
    }
    let copy = two.set.iter().position(|c| *c == candidate)?;
    let k = setting.places(&two.set)[copy];
    let (mut set, mut at) = (two.set.clone(), two.at.clone());
    set.remove(copy);
    at[k + 1] = 0.5 * (at[k] + at[k + 1]);
    at.remove(k);
    // Derivatives to half their difference (first of the two) and to their mean.
    let n = two.at.len();
    let turned = DMatrix::from_fn(n, n, |i, j| match (i, j) {
        _ if i == k && j == k => -1.0,
        _ if i == k && j == k + 1 => 1.0,
        _ if i == k + 1 && j == k => 1.0,
        _ if i == j => 1.0,
        _ => 0.0,
    });
    let all = turned.tr_mul(&two.hessian) * &turned;
    let shared: Vec<usize> = (0..n).filter(|i| *i != k).collect();
    let (hessian, _) = reduced(&all, &DVector::zeros(n), &shared)?;
    Some(Fit {
        set,
        at,
        hessian,
        ..two.clone()
    })
}

/// Unknowns of the copy where both stages are equal. Their difference then spreads the response, and cannot spread
/// it less: taken as free to go either way it would seem to do what a delay beside them does.
fn equal(search: &Search<'_>, candidate: usize, two: &Fit) -> std::ops::Range<usize> {
    let setting = search.setting;
    let Some(copy) = two.set.iter().position(|c| *c == candidate) else {
        return 0..0;
    };
    let first = setting.places(&two.set)[copy];
    let n = setting.vocabulary[candidate].info.parameters.len();
    let same = |k: usize| {
        let (a, b) = (two.at[k], two.at[k + n]);
        (a - b).abs() < EQUAL * a.abs().max(b.abs())
    };
    if two.at.len() >= first + 2 * n && (first..first + n).all(same) {
        first..first + n
    } else {
        0..0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::family::bends;
    use crate::setting::{COEFFICIENTS, Setting};
    use crate::testing::{NOISE_M, candidate, setting, surge};
    use crate::weight::{weight_of, weight_of_all};

    /// The runs of two motions under this set and these numbers, with noise.
    fn tracked(made: &mut Setting, set: &[usize], numbers: &[f64]) {
        let mut globals = made.coefficients().to_vec();
        assert_eq!(globals.len(), COEFFICIENTS);
        globals.extend(numbers);
        let moved = motion(made, set, &globals, &vec![(0.0, 0.0); made.tracks.len()]);
        let mut first = 0;
        for track in &mut made.tracks {
            for (k, m) in track.measured.iter_mut().enumerate() {
                let wave = (1.7 * k as f64).sin() + (2.9 * k as f64).cos();
                *m = moved[first + k] + NOISE_M * wave;
            }
            first += track.measured.len();
        }
    }

    /// What the lag alone, doubled, ends in.
    fn lag_doubled(made: &Setting) -> (Fit, Vec<usize>, f64) {
        let lag = candidate(made, "thruster_lag");
        let mut search = Search::new(made, &|_| {});
        search.nothing();
        search.singles();
        let single = search.finished(&[lag]).unwrap();
        let heavy = Explanation {
            weights: vec![1.0],
            ..Explanation::plain(&search, &single)
        };
        let found = doubled_members(&search, &heavy, f64::NEG_INFINITY);
        let two = found.into_iter().next().and_then(|e| e.twice).unwrap().1;
        let equal = two.confounded(made);
        (two, equal, search.weights.samples() as f64)
    }

    /// Derivatives to two equal time constants are the same column: that was taken for a confounded set, and
    /// nothing joined two equal stages.
    #[test]
    fn two_equal_stages_confound_nothing() {
        let mut made = setting(&[surge(0, &[]), surge(1, &[])]);
        let lag = candidate(&made, "thruster_lag");
        let force = candidate(&made, "constant_force");
        let set = [lag, lag, force];
        tracked(&mut made, &set, &[0.3, 0.3, 0.15]);
        let (two, equal, samples) = lag_doubled(&made);
        assert_eq!(two.set, set.to_vec());
        assert!(equal.contains(&lag), "they are not equal");
        assert!(two.cost < 2.0 * samples);
    }

    /// A limit with a round shoulder was named exact with others that did the work of the shoulder, or a force of the load
    /// without a name.
    #[test]
    fn a_round_shoulder_is_one_of_many_limits() {
        let mut made = setting(&[surge(0, &[]), surge(1, &[]), surge(2, &[])]);
        let limit = candidate(&made, "thruster_saturation");
        tracked(&mut made, &[limit, limit], &[3.0, 8.0]);
        let mut search = Search::new(&made, &|_| {});
        search.nothing();
        search.singles();
        let single = search.finished(&[limit]).unwrap();
        let view = View::new(&made, &search.weights, &single);
        let two = twice(&search, &single, &view, 0).unwrap();
        assert!(two.log_evidence > single.log_evidence + 10.0);
        let numbers = [two.member(&made, 0)[0], two.member(&made, 1)[0]];
        assert!(numbers[0] < 4.0 && numbers[1] > 7.0, "{numbers:?}");
        let once = merged(&made, &two, limit).unwrap();
        assert_eq!((once.set.len(), once.at.len()), (1, two.at.len() - 1));
        let (mean, sd) = (
            once.member(&made, 0)[0],
            once.covariance()[(COEFFICIENTS, COEFFICIENTS)].sqrt(),
        );
        assert!((mean - 5.5).abs() < 4.0 * sd && sd < 0.5, "{mean} {sd}");
        // It weighs what all of it does, not what one limit amid them would.
        let found = Explanation::doubled(&search, limit, two.clone(), &once);
        assert_eq!(found.bent(), Some(limit));
        let all = weight_of_all(&made, &two, limit);
        assert!(all > 0.0 && found.weights == [all]);
        let starts: Vec<(f64, f64)> = (0..3).map(|r| (two.start(&made, r).0, 0.0)).collect();
        let moved = |set: &[usize], globals: &[f64]| motion(&made, set, globals, &starts);
        let does = moved(&two.set, two.globals(&made)) - moved(&[], &two.at[..COEFFICIENTS]);
        let expected = weight_of(&made, &two, &does);
        assert!((all / expected - 1.0).abs() < 1e-9, "{all} {expected}");
    }

    /// A limit bent by the load stood for a round shoulder where the search had come to it from a free force.
    #[test]
    fn a_limit_that_bends_by_the_load_is_asked_for_many_side_by_side() {
        let mut made = setting(&[surge(0, &[]), surge(1, &[]), surge(2, &[])]);
        let limit = candidate(&made, "thruster_saturation");
        tracked(&mut made, &[limit, limit], &[3.0, 8.0]);
        let mut search = Search::new(&made, &|_| {});
        search.nothing();
        search.singles();
        let single = search.finished(&[limit]).unwrap();
        let view = View::new(&made, &search.weights, &single);
        let bent_by = |variable: Variable| {
            let all = bends(&made, &single, &[limit]);
            let family = all.into_iter().find(|f| f.variable == variable).unwrap();
            let linear = family.fit(&made, &search.weights, &single, &view).unwrap();
            let (joint, function) = linear
                .close(&made, &search.weights, &single, Effort::FULL)
                .unwrap();
            Explanation::with(&search, joint, function)
        };
        let bend = bent_by(Variable::Load);
        assert!(bends_a_corner(&search, &bend) && bend.log_evidence > single.log_evidence);
        let many = side_by_side(&search, &bend, f64::NEG_INFINITY);
        assert_eq!(many.len(), 1);
        assert!(many[0].twice.as_ref().is_some_and(|(c, _)| *c == limit));
        assert!(many[0].log_evidence > bend.log_evidence);
        // What depends on speed is no corner in the load.
        let other = bent_by(Variable::Rate);
        assert!(!bends_a_corner(&search, &other));
        assert!(side_by_side(&search, &other, f64::NEG_INFINITY).is_empty());
    }

    /// The difference of two equal stages can only grow: taken as free it did in the linear view what a delay
    /// does, and none was ever promised beside them.
    #[test]
    fn a_delay_joins_two_equal_stages() {
        let mut made = setting(&[surge(0, &[]), surge(1, &[])]);
        let lag = candidate(&made, "thruster_lag");
        let late = candidate(&made, "command_latency");
        tracked(&mut made, &[late, lag, lag], &[0.08, 0.3, 0.3]);
        let (two, _, samples) = lag_doubled(&made);
        assert_eq!(two.set.len(), 3, "{:?}", two.set);
        assert_eq!(two.set.iter().filter(|c| **c == lag).count(), 2);
        assert!(two.cost < 2.0 * samples, "{}", two.cost);
    }
}
