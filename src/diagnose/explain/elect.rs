//! Which of several explanations stands, by evidence and by the runs held out.

use rayon::prelude::*;

use super::covered::covered;
use super::look::{BELIEVED, modest};
use super::{Explanation, FORETELLS};
use crate::bank::without;
use crate::choosing::Choosing;
use crate::descent::Effort;
use crate::family::{Acts, Variable};
use crate::fit::{Fit, Posed};
use crate::predict::{BETTER_T, Prediction, better_t, held_out, predicted, predicted_beside};
use crate::search::Search;
use crate::setting::Track;

/// rms of the runs held out over the least one, and over noise, above which an explanation is none; its square
/// where even the least is above that.
const MISSED: f64 = 2.0;
/// Log evidence below the best one from where on a function cuts nothing off the runs held out.
const IN_THE_RACE: f64 = 50.0;
/// Log evidence of all runs that what only those held out show must gain.
pub(super) const HELD_SHOWS: f64 = 5.0;
/// rms of the runs held out without a member over that with it up to which it is not needed.
const AS_WELL: f64 = 1.02;
/// An explanation that does with fewer effects because one law bends may be this much worse in log evidence:
/// invent nothing.
pub const SPARING: f64 = 4.0;

/// Bent laws that are asked without their lightest members, at most.
const LIGHTENED: usize = 3;

/// Of the tolerance: weight of a bend up to which it must gain as a force without a name must.
pub(super) const SLIGHT: f64 = 0.05;
/// Of the tolerance: weight of an effect that is worth to do without.
pub(super) const NOTABLE: f64 = 0.25;

/// The most likely, with what the runs held out say given the runs fitted, of those that do not miss them by far more
/// than noise and than another one does. A force in time tells nothing of other runs and is not asked: it is compared by
/// the runs fitted alone.
pub fn elect(
    search: &Search<'_>,
    contenders: &[Explanation],
    held: &[Track],
) -> Option<Explanation> {
    let setting = search.setting;
    let noise = search.weights.noise;
    let top = contenders
        .iter()
        .map(|e| e.log_evidence)
        .fold(f64::NEG_INFINITY, f64::max);
    let near: Vec<&Explanation> = contenders
        .iter()
        .filter(|e| e.log_evidence > top - IN_THE_RACE)
        .collect();
    let known = covered(&near, held);
    // Where what one of them knows is nowhere known to another, those are asked that know all of these runs: what is left
    // of a function beyond its range is nobody's.
    let unknown = known.is_empty();
    let samples = |held: &[Track]| held.iter().map(|t| t.times_s.len()).sum::<usize>();
    let knows_all = |e: &Explanation| samples(&covered(&[e], held)) == samples(held);
    let (asked, missed): (Vec<Option<Prediction>>, Vec<Option<f64>>) = contenders
        .iter()
        .map(|e| {
            let held = if unknown && knows_all(e) {
                held
            } else {
                &known
            };
            let p = prediction(search, e, held);
            let missed = miss(e, p.as_ref(), held);
            (p, missed)
        })
        .unzip();
    let held = if unknown { held } else { &known };
    let nothing = search
        .get(&[])
        .and_then(|f| held_out(setting, held, f, noise));
    let least = missed
        .iter()
        .chain([&nothing])
        .flatten()
        .copied()
        .fold(f64::INFINITY, f64::min);
    // Where none comes near the noise they differ by what lies outside of what the runs fitted showed.
    let near_noise = least < MISSED * noise.total_sd();
    let slack = if near_noise { MISSED } else { MISSED * MISSED };
    let bar = slack * least.max(noise.total_sd());
    let told: Vec<Option<f64>> = told(search, contenders, top, held, &asked)
        .into_iter()
        .zip(contenders)
        .map(|(told, e)| told.filter(|_| !unknown || knows_all(e)))
        .collect();
    for ((e, m), told) in contenders.iter().zip(&missed).zip(&told) {
        tracing::debug!(
            "contender {:?} {:?}: {:.1}, held out {m:?} of {least:.2e} {told:.1?}, weighs {:.5}, members {:.5?}",
            e.fit.set,
            e.kind(),
            e.log_evidence,
            e.family_weight,
            e.weights
        );
    }
    // What the runs fitted leave open of its numbers may take a right explanation far off in a long run: one that foretells
    // as well as those within the bar, by its own account of that, has not missed.
    let within = |m: &Option<f64>| m.is_none_or(|m| m.is_finite() && m <= bar);
    let best_within = missed
        .iter()
        .zip(&told)
        .filter(|(m, _)| within(m))
        .filter_map(|(_, told)| *told)
        .fold(f64::NAN, f64::max);
    let sound: Vec<bool> = missed
        .iter()
        .zip(&told)
        .map(|(m, told)| {
            let finite = m.is_some_and(f64::is_finite);
            within(m) || finite && told.is_some_and(|t| t >= best_within)
        })
        .collect();
    // A bent law that misses is none even where nothing else predicts either: the bend was a free force.
    let none = !sound.contains(&true);
    let any = !none || contenders.iter().any(Explanation::unnamed);
    let eligible: Vec<(&Explanation, Option<f64>)> = contenders
        .iter()
        .zip(&sound)
        .zip(told)
        .filter(|((e, sound), _)| !any || **sound || none && e.unnamed())
        .map(|((e, _), told)| (e, told))
        .collect();
    let chosen = choose(eligible.len(), |k, b| {
        let ((e, own), (other, theirs)) = (&eligible[k], &eligible[b]);
        let told = own.zip(*theirs).map_or(0.0, |(own, theirs)| own - theirs);
        e.log_evidence - sparing(search, other, e) - other.log_evidence
            + sparing(search, e, other)
            + told
    })?;
    let best = eligible[chosen].0;
    tracing::debug!(
        "elected {:?}, matters above {:.1e}",
        (best.kind(), best.log_evidence),
        setting.tolerance
    );
    Some(best.clone())
}

/// Log density of the runs held out under each contender, given the runs fitted; `None` where that cannot be asked.
fn told(
    search: &Search<'_>,
    contenders: &[Explanation],
    top: f64,
    held: &[Track],
    asked: &[Option<Prediction>],
) -> Vec<Option<f64>> {
    let (setting, weights) = (search.setting, &search.weights);
    // The samples that are no outliers under the one that predicts best count for all.
    let best = asked
        .iter()
        .flatten()
        .filter(|p| p.rms.is_finite() && p.runs() == held.len())
        .min_by(|a, b| a.rms.total_cmp(&b.rms));
    let Some(best) = best else {
        return vec![None; contenders.len()];
    };
    let choosing = Choosing::new(setting, weights, held, best.kept()).with(&search.shown);
    let foretold = best.rms < MISSED * weights.noise.total_sd()
        || contenders
            .par_iter()
            .any(|e| e.foretells(search, &choosing));
    contenders
        .par_iter()
        .map(|e| {
            let near = foretold && e.log_evidence > top - IN_THE_RACE;
            near.then(|| e.told(search, &choosing)).flatten()
        })
        .collect()
}

/// The likeliest of so many: the one whose least gain over another is largest; `gain(k, b)` = log evidence of k over b.
fn choose(many: usize, gain: impl Fn(usize, usize) -> f64) -> Option<usize> {
    // What is allowed for fewer effects is allowed pair by pair, so that three may beat each other in turn.
    let worst = |k: usize| {
        let others = (0..many).filter(|b| *b != k);
        others.map(|b| gain(k, b)).fold(f64::INFINITY, f64::min)
    };
    (0..many).reduce(|best, k| if worst(k) > worst(best) { k } else { best })
}

/// rms of the runs held out with all of an explanation; `None` where that cannot be asked: without such runs,
/// and of a force in time, which says nothing of others.
pub fn foretold(search: &Search<'_>, e: &Explanation, held: &[Track]) -> Option<f64> {
    miss(e, prediction(search, e, held).as_ref(), held)
}

/// The same as far as those runs go where its own function knows what it says.
pub fn foretold_where_known(search: &Search<'_>, e: &Explanation, held: &[Track]) -> Option<f64> {
    foretold(search, e, &covered(&[e], held))
}

/// The runs held out predicted with all of an explanation.
fn prediction(search: &Search<'_>, e: &Explanation, held: &[Track]) -> Option<Prediction> {
    let (setting, noise) = (search.setting, search.weights.noise);
    match (&e.family, &e.twice) {
        (Some(f), _) => predicted_beside(setting, held, &e.fit, f, noise),
        (None, Some((_, two))) => predicted(setting, held, two, noise),
        (None, None) => predicted(setting, held, &e.fit, noise),
    }
}

/// Whether a law that bends, or acts twice, foretells the runs held out worse than the same law as it is, which foretells
/// them to the noise: then it took up what the runs fitted have by chance, wherever these runs go.
pub fn straight_is_better(search: &mut Search<'_>, e: &Explanation, held: &[Track]) -> bool {
    if e.bent().is_none() || e.family.as_ref().is_some_and(|f| !f.family.lasts()) {
        return false;
    }
    let Some(straight) = search.alone(&e.fit) else {
        return false;
    };
    let noise = search.weights.noise;
    predicted(search.setting, held, &straight, noise)
        .zip(prediction(search, e, held))
        .is_some_and(|(straight, own)| {
            straight.rms < FORETELLS * noise.total_sd()
                && straight.rms < own.rms
                && straight.better_than(&own) > BETTER_T
        })
}

/// Its rms; a motion that runs off predicts nothing: that is a miss, not a question that was not asked.
fn miss(e: &Explanation, p: Option<&Prediction>, held: &[Track]) -> Option<f64> {
    let asked = !held.is_empty() && e.family.as_ref().is_none_or(|f| f.family.lasts());
    let rms = p.map(|p| p.rms).filter(|m| m.is_finite());
    asked.then(|| rms.unwrap_or(f64::INFINITY))
}

/// Laws that bend and miss the runs held out, each without one of the effects that hardly weigh beside it: what the runs
/// fitted leave open (a limit at their largest load) may be what those held out refute.
pub fn lightened(
    search: &Search<'_>,
    contenders: &[Explanation],
    held: &[Track],
) -> Vec<Explanation> {
    let (setting, noise) = (search.setting, search.weights.noise);
    let mut bent: Vec<&Explanation> = contenders
        .iter()
        .filter(|e| e.bent().is_some() && e.family.is_some())
        .collect();
    bent.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
    bent.truncate(LIGHTENED);
    bent.retain(|e| {
        foretold_where_known(search, e, held).is_some_and(|m| m > MISSED * noise.total_sd())
    });
    let jobs: Vec<(&Explanation, usize)> = bent
        .into_iter()
        .flat_map(|e| {
            let light = |m: &usize| {
                e.weights[*m] < NOTABLE * setting.tolerance && e.bent() != Some(e.fit.set[*m])
            };
            (0..e.fit.set.len())
                .filter(light)
                .map(move |m| (e, m))
                .collect::<Vec<_>>()
        })
        .collect();
    jobs.into_par_iter()
        .filter_map(|(e, member)| {
            let (set, at) = without(setting, &e.fit, member);
            let from = Fit {
                set,
                at,
                ..e.fit.clone()
            };
            let function = e.family.as_ref()?;
            let (joint, function) =
                function.refine(setting, &search.weights, &from, Effort::FULL)?;
            modest(setting, &joint, &function).then(|| Explanation::with(search, joint, function))
        })
        .collect()
}

/// A force in time foretells nothing, but the effects named beside it do: those without which the runs held
/// out are predicted better only mend the function, and go.
pub fn held_to_account(search: &Search<'_>, mut found: Explanation, held: &[Track]) -> Explanation {
    let setting = search.setting;
    let noise = search.weights.noise;
    loop {
        let Some(function) = found.family.as_ref().filter(|f| {
            f.family.acts == Acts::Force && f.family.variable.kind() == Variable::TimeEach
        }) else {
            return found;
        };
        let Some(own) = predicted(setting, held, &found.fit, noise) else {
            return found;
        };
        let bar = better_t(found.fit.set.len());
        let better = (0..found.fit.set.len())
            .into_par_iter()
            .filter_map(|m| {
                let (set, at) = without(setting, &found.fit, m);
                let from = Fit {
                    set,
                    at,
                    ..found.fit.clone()
                };
                let pair = function.refine(setting, &search.weights, &from, Effort::FULL)?;
                let missed = predicted(setting, held, &pair.0, noise)?;
                (missed.better_than(&own) > bar).then_some((pair, missed.rms))
            })
            .min_by(|a, b| a.1.total_cmp(&b.1));
        let Some(((joint, function), rms)) = better else {
            return found;
        };
        tracing::debug!(
            "beside a force in time {:?} predicts {rms:.2e} for {:.2e}",
            joint.set,
            own.rms
        );
        found = Explanation::with(search, joint, function);
    }
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

/// What an explanation may be worse in log evidence than another one: by one for every effect of practical
/// size that it does without (of some forty, one to three are: rarer than sizes spread evenly over decades
/// have it), by [`SPARING`] where it does without notable ones because a law bends, and by [`BELIEVED`] where it does
/// without a force that has no name or without a bend that hardly bends a law.
pub fn sparing(search: &Search<'_>, other: &Explanation, best: &Explanation) -> f64 {
    let heavy = |e: &Explanation| e.matters(search.setting.tolerance).len();
    let unnamed = |e: &Explanation| e.unnamed() && e.family_weight > search.setting.tolerance;
    match (unnamed(other), unnamed(best)) {
        // As over its own set: a friction that depends on speed in a way of its own and a force that does are the same.
        (false, true) => return BELIEVED,
        (true, _) => return 0.0,
        (false, false) => {}
    }
    let slight = |e: &Explanation| e.bends_slightly(search.setting.tolerance);
    let hardly = match slight(best) && other.bent().is_none() {
        true => BELIEVED,
        false => 0.0,
    };
    let fewer = heavy(best).saturating_sub(heavy(other)) as f64;
    // A second stage and a small delay beside one stage do nearly the same: there evidence alone decides. So it does
    // where what is done without hardly weighs: a tank has many such effects, and there is nothing to be invented.
    let notable = |e: &Explanation| e.matters(NOTABLE * search.setting.tolerance).len();
    let bends = notable(other) < notable(best)
        && other.bent().is_some()
        && (fewer > 0.0 || best.bent().is_none() && other.twice.is_none());
    hardly + fewer + if bends { SPARING } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bank::{View, joined};
    use crate::family::{bends, forces};
    use crate::testing::{candidate, searched, setting, surge};

    /// A bent law and a free force may be the same function: then what has a name stands.
    #[test]
    fn a_force_without_a_name_must_gain_over_what_has_one() {
        let own = setting(&[surge(0, &[]), surge(1, &[])]);
        let mut search = Search::still(&own, &|_| {});
        search.nothing();
        let fit = search.get(&[]).unwrap().clone();
        let named = Explanation::plain(&search, &fit);
        let view = View::new(&own, &search.weights, &fit);
        let function = forces(&own, &fit)[0].fit(&own, &search.weights, &fit, &view);
        let of_weight = |family_weight| Explanation {
            family: function.clone(),
            family_weight,
            ..named.clone()
        };
        let (heavy, light) = (
            of_weight(2.0 * own.tolerance),
            of_weight(0.1 * own.tolerance),
        );
        assert!(heavy.unnamed());
        assert_eq!(sparing(&search, &named, &heavy), BELIEVED);
        assert_eq!(sparing(&search, &heavy, &named), 0.0);
        assert_eq!(sparing(&search, &heavy, &heavy), 0.0);
        // One that does not matter is asked elsewhere.
        assert_eq!(sparing(&search, &named, &light), 0.0);
        // So it is with a law that hardly bends, beside what does without.
        let mut bends = function.clone();
        if let Some(f) = &mut bends {
            f.family.acts = Acts::Bends(candidate(&own, "coulomb_friction"));
        }
        let bend = |share: f64| Explanation {
            family: bends.clone(),
            family_weight: share * own.tolerance,
            ..named.clone()
        };
        assert_eq!(sparing(&search, &named, &bend(0.04)), BELIEVED);
        assert_eq!(sparing(&search, &bend(0.06), &bend(0.04)), 0.0);
        assert_eq!(sparing(&search, &bend(0.04), &bend(0.03)), 0.0);
        assert_eq!(sparing(&search, &named, &bend(0.06)), 0.0);
        assert_eq!(sparing(&search, &heavy, &bend(0.04)), 0.0);
    }

    /// A limit above the loads fitted, which a bent law had beside it, refuted it in the runs held out.
    #[test]
    fn a_bent_law_that_misses_is_asked_without_what_hardly_weighs() {
        let effects: [(&str, &[(&str, f64)]); 1] = [("coulomb_friction", &[("f_n", 0.4)])];
        let own = setting(&[surge(0, &effects), surge(1, &effects), surge(2, &effects)]);
        let friction = candidate(&own, "coulomb_friction");
        let limit = candidate(&own, "thruster_saturation");
        let mut search = searched(&own);
        let single = search.finished(&[friction]).unwrap();
        // The loads are 8 N at most: above them a limit does nothing, and nothing is known of it.
        let (set, at) = joined(&own, &single, limit, &[8.2]);
        let fit = Posed::new(&own, &search.weights, &set).fit(at).unwrap();
        let member = fit.set.iter().position(|c| *c == limit).unwrap();
        assert!((8.0..9.5).contains(&fit.member(&own, member)[0]));
        let view = View::new(&own, &search.weights, &fit);
        let law = bends(&own, &fit, &[friction])
            .into_iter()
            .find(|f| f.variable == Variable::SinceEdge)
            .and_then(|f| f.fit(&own, &search.weights, &fit, &view))
            .unwrap();
        let bent = Explanation::with(&search, fit, law);
        assert_eq!(bent.bent(), Some(friction));
        assert!(bent.weights[member] < NOTABLE * own.tolerance);
        let missed = |e: &Explanation, held: &[Track]| {
            foretold_where_known(&search, e, held).unwrap() / search.weights.noise.total_sd()
        };
        let larger = setting(&[surge(4, &effects)]).tracks;
        assert!(missed(&bent, &larger) > MISSED);
        let found = lightened(&search, std::slice::from_ref(&bent), &larger);
        assert_eq!(found.len(), 1);
        assert_eq!(
            (found[0].fit.set.clone(), found[0].bent()),
            (vec![friction], Some(friction))
        );
        assert!(missed(&found[0], &larger) < MISSED);
        // Nothing is asked of one that foretells them.
        let smaller = setting(&[surge(1, &effects)]).tracks;
        assert!(missed(&bent, &smaller) < MISSED);
        assert!(lightened(&search, &[bent], &smaller).is_empty());
    }

    /// Whatever the order they come in: the likeliest.
    #[test]
    fn an_election_does_not_depend_on_the_order_of_its_candidates() {
        let evidence = [100.0, 94.5, 89.0];
        for order in [
            [0, 1, 2],
            [0, 2, 1],
            [1, 0, 2],
            [1, 2, 0],
            [2, 0, 1],
            [2, 1, 0],
        ] {
            let gain = |k: usize, b: usize| evidence[order[k]] - evidence[order[b]];
            assert_eq!(order[choose(3, gain).unwrap()], 0);
        }
        assert_eq!(choose(0, |_, _| 0.0), None);
        assert_eq!(choose(1, |_, _| 0.0), Some(0));
        // Three that beat each other in turn: the first loses to the last by least.
        let cycle = [[0.0, 1.0, -0.5], [-1.0, 0.0, 0.7], [0.5, -0.7, 0.0]];
        for order in [[0, 1, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
            let gain = |k: usize, b: usize| cycle[order[k]][order[b]];
            assert_eq!(order[choose(3, gain).unwrap()], 0, "{order:?}");
        }
    }
}
