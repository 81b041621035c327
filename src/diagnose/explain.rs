//! From the best sets to an explanation: is a law only inexact, or is something unnamed at work?
//!
//! A law that is not quite the vocabulary's leaves residuals that other effects mend: the search
//! then invents small ones. So the best set is challenged (`look`): would a free bend of a heavy
//! effect's law, the same mechanism a second time (two stages, two springs, two modes), or a free
//! force, do with better evidence? And beside such a function the set is searched again (`beside`).

mod along;
mod beside;
mod covered;
mod crossed;
mod disguise;
mod doubled;
mod elect;
mod evenly;
mod explanation;
mod forward;
mod grow;
mod look;
mod nameless;
mod needs;
mod recheck;
mod thrust;
mod windows;

use std::collections::BTreeMap;

use super::choosing::Choosing;
use super::family::{Acts, FamilyFit, Variable};
use super::posterior::near;
use super::predict::{expected, held_out, predicted_beside};
use super::search::Search;
use super::setting::Track;
use along::shown;
use beside::{beside, squeezed};
use crossed::crossed;
use disguise::unmasked;
use doubled::{bends_a_corner, doubled, doubled_from, doubled_members, side_by_side};

use elect::{
    SLIGHT, by_prediction, elect, foretold, foretold_where_known, held_to_account, lightened,
    sparing, straight_is_better,
};
use evenly::evenly;
use grow::{again, grow, reduce, straightened};
use look::{INEXACT, WAYS, bent, bent_alone, fewest, in_the_place, instead, kinds};
use nameless::without_a_name;

pub use covered::covered;
pub use explanation::Explanation;
pub(super) use forward::GAINS;
pub use forward::forward;
pub use grow::renewed;
pub use look::{Care, look};
pub use needs::needs;
pub use recheck::{Recheck, recheck};
pub use thrust::of_a_thruster;
pub use windows::{Windows, pieces};

/// Kinds of functions looked at beside nothing and beside the heaviest effect.
const KINDS: usize = 2;
/// Functions, of different kinds, beside which the set is searched again.
const GROWN: usize = 3;
/// Members taken out at most, and parts of a set looked at each time.
const ROUNDS: usize = 6;
/// See [`ROUNDS`].
const PARTS: usize = 4;
/// Sets of one and of two from which laws are bent early, and bent ones that are grown.
const BASES: usize = 8;
/// Found before the large sets and followed on after them.
const KEPT_EARLY: usize = 3;
/// See [`BASES`].
const BENT_EARLY: usize = 4;
/// rms of the runs held out over what it is where the explanation is right, above which that is doubted.
const MISSES: f64 = 2.0;
/// The same below which named effects imitate nothing.
const FORETELLS: f64 = 1.2;
/// Effects that matter together from which they may imitate something though they foretell the runs held out.
const MANY: usize = 3;
/// Half chi-square per sample above which a function does not explain all there is; noise leaves 0.5.
const FAR_FROM_NOISE: f64 = 0.75;
/// rms of the runs held out over the noise above which a free force foretells nothing.
const FAR_FROM_FORETOLD: f64 = 4.0;
/// rms of the runs held out with the few effects that each gain in prediction over that with many that fit: no law is
/// exact where even these miss them.
const AS_GOOD_AS_MANY: f64 = 1.25;
/// Half chi-square per sample below which a function explains all there is.
const ALL_BUT_NOISE: f64 = 0.6;
/// Log evidence that another prior of a function must gain for its set to be searched again.
const WORTH_A_CLIMB: f64 = 2.0;
/// Log evidence below an explanation that leaves only noise, from where no set comes near it.
const OUT_OF_REACH: f64 = 200.0;
/// The same below any explanation, of a law that bends with all that joins it: a better prior mends less.
const LAW_OUT_OF_REACH: f64 = 50.0;
/// rms of the runs held out with a function over that of named effects alone below which it is believed
/// where nothing reaches the noise.
const CLEARLY: f64 = 0.7;

/// The best explanation: sets from the search, sets grown beside a free function, and sets with
/// members taken out, each with its best free function.
///
/// `held` = runs that are only predicted: an explanation that misses them badly is none; `also` = one of
/// an earlier look, under another noise.
pub fn explain(
    search: &mut Search<'_>,
    held: &[Track],
    also: Option<&Explanation>,
) -> Option<Explanation> {
    let first = search.best()?.clone();
    search.shown = shown(search, held, &first);
    let first = {
        let (setting, weights) = (search.setting, &search.weights);
        let near = near(search);
        Choosing::like(setting, weights, held, &first)
            .with(&search.shown)
            .unless_far(setting, weights, &near)
            .likeliest(setting, weights, &near)?
            .clone()
    };
    let mut best = look(search, &first, Care::Above(f64::NEG_INFINITY));
    if best.fit.set.len() < 2 && best.family.is_none() && best.twice.is_none() {
        // Nothing is left, and nothing to take away: what the search named stands on its own.
        return Some(best);
    }
    let mut tried: BTreeMap<Vec<usize>, Explanation> =
        BTreeMap::from([(first.set.clone(), best.clone())]);
    let known = covered(&[&best], held);
    let misses = foretold(search, &best, &known)
        .is_some_and(|m| m > MISSES * at_best(search, &best, &known));
    let mut seeds = challenge(search, &best, misses, &mut tried);
    seeds.extend(tried.values().filter(|e| e.family.is_some()).cloned());
    if let Some(other) = tried
        .values()
        .max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))
        .filter(|o| o.log_evidence > best.log_evidence)
    {
        best = other.clone();
    }
    // Nothing at all, and the heaviest alone, beside a free function: the search may have needed
    // several effects to imitate one that it has no name for.
    seeds.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
    let mut kinds = Vec::new();
    seeds.retain(|s| {
        let new = !kinds.contains(&s.kind());
        kinds.push(s.kind());
        new
    });
    let mut contenders: Vec<Explanation> = Vec::new();
    // A force at a place is what a tank has most of, and a wrong law of another kind may gain more at first.
    let place = |e: &Explanation| matches!(e.kind(), Some((Acts::Force, Variable::Place)));
    let late = seeds.iter().skip(GROWN).find(|s| place(s)).cloned();
    seeds.truncate(GROWN);
    seeds.extend(late);
    // A force in time does anything; one of place, rate or load that leaves only noise has shown what else is
    // there: laws that bend are asked in its place.
    let all = ALL_BUT_NOISE * search.weights.samples() as f64;
    let lasts = |e: &Explanation| e.family.as_ref().is_some_and(|f| f.family.lasts());
    let lasting = |e: &Explanation| e.unnamed() && lasts(e) && e.cost() < all;
    let bar = |contenders: &[Explanation], best: &Explanation| {
        let all = contenders.iter().map(|c| c.log_evidence);
        all.fold(best.log_evidence, f64::max)
    };
    let (forces, mut laws): (Vec<Explanation>, Vec<Explanation>) =
        seeds.into_iter().partition(|s| s.bent().is_none());
    for seed in &forces {
        let bar = bar(&contenders, &best);
        let explains_all = bar > first.log_evidence
            && seed.log_evidence < bar - OUT_OF_REACH
            && contenders.iter().chain([&best]).any(lasting);
        if !explains_all {
            contenders.extend(grow(search, seed, &best.fit, bar));
        }
    }
    let explained = contenders
        .iter()
        .chain(tried.values())
        .filter(|e| lasting(e) && e.log_evidence > first.log_evidence)
        .max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))
        .cloned();
    let notable = best.matters(elect::NOTABLE * search.setting.tolerance);
    let imitates = explained.is_some() || may_imitate(search, &best, held);
    if imitates && (best.simple() || best.bent().is_some()) && notable.len() > 1 {
        laws.extend(in_the_place(search, &best.fit, &notable));
    }
    if let Some(unnamed) = &explained {
        search.singles();
        let floor = bar(&contenders, &best) - OUT_OF_REACH;
        laws.extend(instead(search, unnamed));
        contenders.extend(side_by_side(search, unnamed, floor));
        for found in &search.early {
            contenders.extend(doubled_from(search, found, &best.fit, floor));
            laws.extend(again(search, found));
        }
        laws.retain(|s| s.log_evidence > floor);
        if search.early.is_empty() {
            // How far these are is seen only when others have joined them.
            laws.extend(bent_alone(search));
        }
    } else if imitates {
        let bar = bar(&contenders, &best);
        if search.early.is_empty() {
            search.singles();
            contenders.extend(doubled(search, &best.fit, bar));
            laws.extend(bent(search, fewest(search, BASES), WAYS, BENT_EARLY));
        } else {
            for found in &search.early {
                contenders.extend(doubled_from(search, found, &best.fit, bar));
                laws.extend(again(search, found));
            }
        }
    }
    // A force in time does anything, and says nothing of other runs: it is no bar for a law.
    let says = |e: &&Explanation| !e.unnamed() || lasts(e);
    // Two stages look like one and a delay: that foretells as well, and only the two tell it from there.
    if (best.simple() || best.bent().is_some())
        && best
            .matters(elect::NOTABLE * search.setting.tolerance)
            .len()
            > 1
    {
        let bar = bar(&contenders, &best);
        contenders.extend(doubled_members(search, &best, bar));
    }
    if best.simple() {
        let heavy = best.matters(search.setting.tolerance);
        laws.extend(evenly(search, &best.fit, &heavy));
    }
    for seed in &laws {
        let all = contenders.iter().chain([&best]).filter(says);
        let bar = all
            .map(|c| c.log_evidence)
            .fold(f64::NEG_INFINITY, f64::max);
        contenders.extend(grow(search, seed, &best.fit, bar));
    }
    let bar = bar(&contenders, &best);
    let of_a_corner = |e: &&Explanation| e.bent().is_some() && e.log_evidence > bar - OUT_OF_REACH;
    let laws = contenders.iter().chain([&best]).filter(of_a_corner);
    let likeliest = laws
        .filter(|e| bends_a_corner(search, e))
        .max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence));
    if let Some(law) = likeliest.cloned() {
        contenders.extend(side_by_side(search, &law, bar));
    }
    let all = contenders.iter().chain([&best]);
    let curve = all
        .filter(|e| {
            e.family
                .as_ref()
                .and_then(FamilyFit::straightened)
                .is_some()
        })
        .max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))
        .cloned();
    contenders.extend(curve.and_then(|e| straightened(search, &e, &best.fit, bar)));
    contenders.extend(crossed(search, &contenders));
    contenders.extend(also.and_then(|e| again(search, e)));
    // What the search ended for.
    contenders.extend(search.instead.as_ref().and_then(|e| again(search, e)));
    let beaten = contenders.iter().any(|g| {
        g.log_evidence - sparing(search, &best, g) > best.log_evidence - sparing(search, g, &best)
    });
    if !beaten {
        best = reduce(search, best, &mut tried);
    }
    contenders.push(best);
    contenders.extend(lightened(search, &contenders, held));
    for contender in &mut contenders {
        needed_at_all(search, contender);
    }
    let mut best = elect(search, &contenders, held)?;
    if best.unnamed()
        && search.stopped_early()
        && best.cost() > FAR_FROM_NOISE * search.weights.samples() as f64
        && let Some(job) = squeezed(search, &best)
    {
        // What the search gave up as hopeless the vocabulary may yet explain.
        search.fit(vec![job.clone()]);
        search.exchange();
        if let Some(named) = search.best().cloned() {
            let seen = look(search, &named, Care::Above(best.log_evidence));
            tracing::debug!(
                "squeezed to {:?}: {:.1} for {:.1}",
                job.0,
                seen.log_evidence,
                best.log_evidence
            );
            best = elect(search, &[best, seen.clone()], held)?;
            contenders.push(seen);
        }
    }
    // A free force takes up whatever the runs fitted leave over: that they come out as noise says nothing where the
    // runs held out do not.
    let noise = search.weights.noise;
    let takes_up = best.unnamed()
        && best.family_weight > search.setting.tolerance
        && foretold_where_known(search, &best, held)
            .is_some_and(|f| f > FAR_FROM_FORETOLD * noise.total_sd());
    let far = best.cost() > FAR_FROM_NOISE * search.weights.samples() as f64;
    if (takes_up || far)
        && let Some(sparse) = by_prediction(search, &first, held)
    {
        // Far from the noise likelihoods compare errors of laws: what predicts decides, and a function
        // must predict clearly better than named effects alone.
        // Where the function knows nothing of what was held out, nothing was asked: all of it is.
        let known = covered(&[&best], held);
        let held = if known.is_empty() { held } else { &known };
        let named = held_out(search.setting, held, &sparse.fit, noise).unwrap_or(f64::INFINITY);
        let free = best
            .family
            .as_ref()
            .and_then(|f| predicted_beside(search.setting, held, &best.fit, f, noise))
            .map(|p| p.rms)
            .or_else(|| held_out(search.setting, held, &best.twice.as_ref()?.1, noise));
        tracing::debug!(
            "by prediction {:?}: {named:.2e}, with a function {free:?}",
            sparse.fit.set
        );
        // One that explains the runs fitted goes only where names do better, and matter.
        let as_well = free.is_none_or(|f| f.is_nan() || f > CLEARLY * named);
        let better = free.is_some_and(|f| f.is_nan() || f > named)
            && !sparse.matters(search.setting.tolerance).is_empty();
        if (far && as_well) || (takes_up && better) {
            return Some(sparse);
        }
    }
    best = held_to_account(search, best, held);
    // A free force too light to matter is no reason to speak of something unnamed, nor to take from
    // the named effects what they explain: the best explanation without one stands. A law that hardly bends is
    // compared with all that does without; a force, which it has beaten, is not.
    let light = best.unnamed() && best.family_weight <= search.setting.tolerance;
    let refuted = straight_is_better(search, &best, held);
    if light || refuted || best.bends_slightly(search.setting.tolerance) {
        let law = best.bent();
        let stays = |e: &Explanation| !(e.unnamed() || refuted && e.bent() == law);
        let all = contenders.iter().chain(tried.values());
        let mut named: Vec<Explanation> = all.filter(|e| stays(e)).cloned().collect();
        let own = search.alone(&best.fit);
        let plain = [Some(first), own].into_iter().flatten();
        named.extend(
            plain
                .map(|fit| Explanation::plain(search, &fit))
                .filter(stays),
        );
        for e in &mut named {
            needed_at_all(search, e);
        }
        best = elect(search, &named, held)?;
    }
    // Stretches of decays differ in amplitude alone: what all laws together miss there is an error of laws, even where
    // so many of them fit the others to the noise.
    let decays = search.setting.tracks.iter().all(|t| t.edges.is_empty());
    if !decays {
        best = unmasked(search, &best, held).unwrap_or(best);
        let found = contenders.iter().chain(tried.values());
        best = without_a_name(search, &best, found, held).unwrap_or(best);
    } else if !best.unnamed()
        && let Some(own) = foretold(search, &best, held)
        && own > MISSES * noise.total_sd()
        && let Some(sparse) = forward(search, held)
        && !sparse.matters(search.setting.tolerance).is_empty()
        && foretold(search, &sparse, held).is_some_and(|f| f < AS_GOOD_AS_MANY * own)
    {
        return Some(sparse);
    }
    if let (true, Some(plain)) = (best.family.is_some(), search.alone(&best.fit))
        && let Some(family) = &mut best.family
    {
        family.gain = best.log_evidence - plain.log_evidence;
    }
    Some(best)
}

/// Looks at the heaviest alone and, where something seems to be left or bent or the best one `misses` the runs
/// held out, at nothing at all: with
/// what they are beside functions of different kinds.
fn challenge(
    search: &Search<'_>,
    best: &Explanation,
    misses: bool,
    tried: &mut BTreeMap<Vec<usize>, Explanation>,
) -> Vec<Explanation> {
    let heaviest = best
        .fit
        .set
        .iter()
        .zip(&best.weights)
        .max_by(|a, b| a.1.total_cmp(b.1))
        .map(|(c, _)| vec![*c]);
    let mut sets: Vec<Vec<usize>> = heaviest.into_iter().collect();
    if misses || best.family.is_some() || best.twice.is_some() {
        sets.push(Vec::new());
    }
    let mut seeds = Vec::new();
    for set in sets {
        let Some(fit) = search.get(&set) else {
            continue;
        };
        tried
            .entry(set)
            .or_insert_with(|| look(search, fit, Care::Above(f64::NEG_INFINITY)));
        if misses || best.family.is_some() {
            seeds.extend(kinds(search, fit, KINDS));
        }
    }
    seeds
}

/// Few effects of which one does not act by its law: the best of them that bend or act twice, each with what
/// joins it.
pub fn early(search: &Search<'_>) -> Vec<Explanation> {
    let Some(best) = search.best().cloned() else {
        return Vec::new();
    };
    let mut found = doubled(search, &best, best.log_evidence);
    for seed in bent(search, fewest(search, BASES), WAYS, BENT_EARLY) {
        let bar = found
            .iter()
            .map(|e: &Explanation| e.log_evidence)
            .fold(best.log_evidence, f64::max);
        found.extend(grow(search, &seed, &best, bar));
    }
    found.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
    found.truncate(KEPT_EARLY);
    found
}

/// The best unnamed force that lasts and matters, with what joins it from nothing on: fewer effects than the best
/// set has.
pub fn unnamed_from_nothing(search: &Search<'_>) -> Option<Explanation> {
    let (best, nothing) = (search.best()?, search.get(&[])?);
    let place = |e: &Explanation| matches!(e.kind(), Some((_, Variable::Place)));
    kinds(search, nothing, KINDS + 1)
        .iter()
        .filter(|seed| seed.family.as_ref().is_some_and(|f| f.family.lasts()))
        .enumerate()
        .filter(|(k, seed)| *k < KINDS || place(seed))
        .map(|(_, seed)| beside(search, seed, best, best.log_evidence))
        .filter(|e| e.fit.set.len() < best.set.len() && e.family_weight > search.setting.tolerance)
        .max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))
}

/// Whether the best explanation may be several effects that imitate one mechanism whose law is not the
/// vocabulary's: it misses the runs held out, has many that matter or, without such runs, two; or a function.
fn may_imitate(search: &Search<'_>, best: &Explanation, held: &[Track]) -> bool {
    let known = covered(&[best], held);
    match foretold(search, best, &known) {
        Some(m) if best.simple() => {
            m > FORETELLS * at_best(search, best, &known)
                || best.matters(search.setting.tolerance).len() >= MANY
        }
        _ => best.matters(search.setting.tolerance).len() > 1 || !best.simple(),
    }
}

/// rms of the runs held out that an explanation may have where it is right \[m, rad\].
fn at_best(search: &Search<'_>, e: &Explanation, held: &[Track]) -> f64 {
    let noise = search.weights.noise;
    match e.simple() {
        true => expected(search.setting, held, &e.fit, noise),
        false => noise.total_sd(),
    }
}

/// A bend that gains nothing to speak of over its own set without one is none.
fn needed_at_all(search: &mut Search<'_>, found: &mut Explanation) {
    if found.bent().is_none() {
        return;
    }
    if let Some(plain) = search.alone(&found.fit)
        && plain.log_evidence + INEXACT > found.log_evidence
    {
        tracing::debug!(
            "{:?} does without a bend: {:.1} for {:.1}",
            plain.set,
            plain.log_evidence,
            found.log_evidence
        );
        *found = Explanation::plain(search, &plain);
    }
}
