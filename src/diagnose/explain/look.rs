//! One set, and the best free function or second copy beside it.

use rayon::prelude::*;

use super::Explanation;
use super::doubled::merged;
use crate::bank::{View, joined, motion, outside, whitened, without};
use crate::descent::Effort;
use crate::family::{Acts, Family, FamilyFit, Variable, bends, forces};
use crate::fit::{Fit, Posed};
use crate::search::Search;
use crate::setting::{COEFFICIENTS, Setting};
use crate::weight::{weight_beyond, weights};

/// Log evidence that a free force must gain before it is believed.
pub(super) const BELIEVED: f64 = 5.0;
/// The same of a bend or a second copy, beyond what its choice costs: a law that is not quite the vocabulary's is nothing rare, and
/// says less than that something has no name at all.
pub const INEXACT: f64 = 1.0;

/// What a function must gain.
fn bar_of(function: &FamilyFit) -> f64 {
    match function.family.acts {
        Acts::Force => BELIEVED,
        Acts::Bends(_) => INEXACT,
    }
}

/// Free functions refitted nonlinearly.
const REFINED: usize = 3;
/// Of the best one's linear gain, what another must promise for that.
const WORTH_A_FIT: f64 = 0.5;
/// Half chi-square per sample above which a fit is far from the noise, which leaves 0.5.
const FAR_FROM_NOISE: f64 = 2.0;
/// Log of the choice between one law and the same law twice.
pub(super) const TWICE_PENALTY: f64 = 2.0;
/// A second copy begins with this share of the first one's size.
const SPLIT: f64 = 0.35;
/// Corners side by side lie between these shares of the one's: wide apart as thresholds that begin at nothing are, or close
/// together as limits are.
const CORNERS: [(f64, f64); 2] = [(0.2, 1.8), (0.6, 1.4)];
/// An effect whose weight is below this share of the heaviest is not asked whether its law bends.
const HEAVY_SHARE: f64 = 0.25;
/// A function whose cost ends this far above the best one's is not followed to its minimum.
const HOPELESSLY_FAR: f64 = 60.0;
/// Single effects bent in the place of a free force.
const INSTEAD: usize = 8;
/// Variables on which each of those may depend.
const ALONE_WAYS: usize = 2;
/// Sets of one and of two bent by themselves.
const ALONE: usize = 4;
/// Bent laws followed there.
const SEEDS: usize = 3;
/// Variables tried per mechanism that is bent early.
pub const WAYS: usize = 2;
/// Heavy members whose laws are bent, and of those the ones that may act twice.
const BENT: usize = 3;
/// See [`BENT`].
const DOUBLED: usize = 2;
/// Of an effect's weight, what a bend of its law may do.
pub(super) const MODEST: f64 = 0.5;
/// What a function gains over what it promises linearly, at most, and some log evidence on top: a
/// set that would stay below the bar even so is not looked at closer.
const AT_MOST: (f64, f64) = (1.3, 10.0);

/// Half chi-square per sample below which a function leaves little more than noise, which leaves 0.5.
const LITTLE_MORE: f64 = 0.75;
/// Log evidence that a knot costs at which nothing is, at most.
const A_KNOT: f64 = 3.0;

/// How closely a set is looked at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Care {
    /// Whether there is something: far from the noise right to a percent.
    Glance,
    /// To the minimum, where a log evidence above this is in reach.
    Above(f64),
}

/// A set with its best free function, if one is believed.
pub fn look(search: &Search<'_>, fit: &Fit, care: Care) -> Explanation {
    let setting = search.setting;
    let view = View::new(setting, &search.weights, fit);
    let weights = weights(setting, fit);
    let heaviest = weights.iter().copied().fold(0.0, f64::max);
    let mut families = forces(setting, fit);
    measured_where_far(search, fit, &mut families);
    let mut heavy: Vec<usize> = (0..fit.set.len())
        .filter(|m| weights[*m] > setting.tolerance && weights[*m] >= HEAVY_SHARE * heaviest)
        .collect();
    heavy.sort_by(|a, b| weights[*b].total_cmp(&weights[*a]));
    let candidates: Vec<usize> = heavy.iter().take(BENT).map(|m| fit.set[*m]).collect();
    families.extend(bends(setting, fit, &candidates));
    if care == Care::Glance {
        // What bends at small loads or speeds only hides no force.
        families.retain(|f| !matches!(f.variable, Variable::LoadRatio | Variable::SpeedRatio));
    }
    heavy.truncate(if care == Care::Glance { 0 } else { DOUBLED });
    let mut double: Option<(usize, Fit)> = None;
    for member in heavy {
        if let Some(two) = twice(search, fit, &view, member).filter(|two| {
            double
                .as_ref()
                .is_none_or(|d| two.log_evidence > d.1.log_evidence)
        }) {
            double = Some((fit.set[member], two));
        }
    }
    let double = double.filter(|d| d.1.log_evidence > fit.log_evidence + INEXACT);
    let mut found: Vec<FamilyFit> = families
        .iter()
        .filter_map(|f| f.fit(setting, &search.weights, fit, &view))
        .filter(|f| f.gain > bar_of(f))
        .collect();
    found.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    for f in found.iter().take(4) {
        tracing::debug!(
            "promised {:?} {:?} {:.1}",
            f.family.acts,
            f.family.variable,
            f.gain
        );
    }
    let top = found.first().map_or(0.0, |f| f.gain);
    if care == Care::Glance {
        // Only an unnamed force is asked for here. Where a bend promises more there is none, and a bend's
        // own fit is dear.
        if found.first().is_some_and(|f| f.family.acts != Acts::Force) {
            found.clear();
        }
        found.retain(|f| f.family.acts == Acts::Force);
    }
    let (most, bar) = match care {
        Care::Glance => (REFINED - 1, f64::NEG_INFINITY),
        Care::Above(bar) => (REFINED, bar),
    };
    // A force that does nothing at most knots gains what they cost.
    let quiet = found
        .iter()
        .filter(|f| f.family.acts == Acts::Force)
        .map(|f| A_KNOT * f.family.knots.len() as f64)
        .fold(0.0, f64::max);
    if fit.log_evidence + AT_MOST.0 * top + AT_MOST.1 + quiet < bar {
        found.clear();
    }
    // Large ones are not linear: the front runners are fitted again, together with the set; far from
    // the noise right to a percent, and no further than to see that another one is better.
    let mut refined: Option<(Fit, FamilyFit)> = None;
    for f in found
        .iter()
        .take(most)
        .filter(|f| f.gain >= WORTH_A_FIT * top)
    {
        let effort = Effort {
            limit: refined
                .as_ref()
                .map_or(f64::INFINITY, |(joint, _)| joint.cost + HOPELESSLY_FAR),
            ..search.weights.to_a_percent()
        };
        let made = f
            .close(setting, &search.weights, fit, effort)
            .filter(|(joint, f)| f.gain > bar_of(f) && modest(setting, joint, f));
        if let Some(made) = made
            && refined.as_ref().is_none_or(|r| made.1.gain > r.1.gain)
        {
            refined = Some(made);
        }
    }
    if let (Care::Above(_), Some((joint, function))) = (care, &refined)
        && joint.rough
    {
        let from = Fit {
            at: joint.at.clone(),
            ..fit.clone()
        };
        let effort = search.weights.to_a_percent();
        // Once more from there: a percent of what is left now.
        refined = function
            .refine(setting, &search.weights, &from, effort)
            .or(refined);
    }
    if let (Care::Above(_), Some(made)) = (care, refined.take_if(|r| near_noise(search, &r.0))) {
        refined = Some(FamilyFit::in_windows(setting, &search.weights, fit, made));
    }
    tracing::debug!(
        "beside {:?} ({:.1}): {:?}",
        fit.set
            .iter()
            .map(|c| setting.vocabulary[*c].info.id)
            .collect::<Vec<_>>(),
        fit.log_evidence,
        refined
            .as_ref()
            .map(|(_, f)| (f.family.acts, f.family.variable, f.gain))
    );
    let bar = refined
        .as_ref()
        .map_or(f64::NEG_INFINITY, |(joint, _)| joint.log_evidence);
    if let Some((candidate, two)) = double.filter(|d| d.1.log_evidence > bar) {
        tracing::debug!(
            "{} twice gains {:.1}",
            setting.vocabulary[candidate].info.id,
            two.log_evidence - fit.log_evidence
        );
        let once = merged(setting, &two, candidate);
        return Explanation::doubled(search, candidate, two, once.as_ref().unwrap_or(fit));
    }
    match refined {
        Some((joint, family)) => Explanation::with(search, joint, family),
        None => Explanation::plain(search, fit),
    }
}

/// Whether a function leaves little more than noise: windows are seen only there.
fn near_noise(search: &Search<'_>, joint: &Fit) -> bool {
    joint.cost < LITTLE_MORE * search.weights.samples() as f64
}

/// Far from the noise functions are asked about the place and rate measured: only so the motion is nearly linear
/// in them.
pub(super) fn measured_where_far(search: &Search<'_>, fit: &Fit, families: &mut [Family]) {
    if fit.cost > FAR_FROM_NOISE * search.weights.samples() as f64 {
        families.iter_mut().for_each(|f| f.measured = true);
    }
}

/// Whether a function that bends a law leaves it its law: one that does more than half as much as the
/// effect itself is a free force in disguise.
pub fn modest(setting: &Setting, joint: &Fit, function: &FamilyFit) -> bool {
    let Acts::Bends(candidate) = function.family.acts else {
        return true;
    };
    let own = joint
        .set
        .iter()
        .position(|c| *c == candidate)
        .map_or(0.0, |m| weights(setting, joint)[m]);
    weight_beyond(setting, joint, &function.response) <= MODEST * own
}

/// A set beside its best functions of different kinds (one of place always among them), most promising first, each fitted far enough to
/// go on from there: which kind is right may only show when named effects have joined it.
pub fn kinds(search: &Search<'_>, fit: &Fit, most: usize) -> Vec<Explanation> {
    let setting = search.setting;
    let view = View::new(setting, &search.weights, fit);
    let mut families = forces(setting, fit);
    measured_where_far(search, fit, &mut families);
    let mut found: Vec<FamilyFit> = families
        .iter()
        .filter_map(|f| f.fit(setting, &search.weights, fit, &view))
        .filter(|f| f.gain > BELIEVED)
        .collect();
    found.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    let effort = search.weights.to_a_percent();
    let mut seen = Vec::new();
    found.retain(|f| {
        let kind = f.family.variable.kind();
        let new = !seen.contains(&kind);
        seen.push(kind);
        new
    });
    let place = found
        .iter()
        .skip(most)
        .position(|f| f.family.variable.kind() == Variable::Place)
        .map(|i| found[most + i].clone());
    found.truncate(most);
    found.extend(place);
    found
        .par_iter()
        .filter_map(|f| f.close(setting, &search.weights, fit, effort))
        .map(|(joint, function)| Explanation::with(search, joint, function))
        .collect()
}

/// A set with the members whose laws may be bent.
pub type Base = (Fit, Vec<usize>);

/// The best sets of one effect and of two, `most` of each.
pub fn fewest(search: &Search<'_>, most: usize) -> Vec<Base> {
    let ranked = search.ranked();
    let of = |size: usize| {
        ranked
            .iter()
            .filter(move |f| f.set.len() == size)
            .take(most)
    };
    of(1)
        .chain(of(2))
        .map(|f| ((*f).clone(), f.set.clone()))
        .collect()
}

/// Mechanisms whose laws bend in the place of a free force, all that is named beside it as it is: a function of
/// the load may be a thruster's law, one of the rate a friction that is none of the vocabulary's.
pub fn instead(search: &Search<'_>, unnamed: &Explanation) -> Vec<Explanation> {
    let setting = search.setting;
    let beside = &unnamed.fit;
    let effort = search.weights.to_a_percent();
    let fit = |(set, at): (Vec<usize>, Vec<f64>)| {
        Posed::new(setting, &search.weights, &set)
            .fit_with(at, effort)
            .ok()
            .filter(|f| f.log_evidence.is_finite())
    };
    let sound = |f: &Fit| f.confounded(setting).is_empty();
    let ranked = search.ranked();
    let singles: Vec<&&Fit> = ranked
        .iter()
        .filter(|f| f.set.len() == 1)
        .take(INSTEAD)
        .collect();
    let mut bases: Vec<Base> = singles
        .into_par_iter()
        .filter_map(|single| {
            let candidate = single.set[0];
            // What is in the set already begins anew: beside the force it had other work to do.
            let rest = match beside.set.iter().position(|c| *c == candidate) {
                Some(member) => {
                    let (set, at) = without(setting, beside, member);
                    Fit {
                        set,
                        at,
                        ..beside.clone()
                    }
                }
                None => beside.clone(),
            };
            let job = joined(setting, &rest, candidate, single.member(setting, 0));
            Some((fit(job).filter(sound)?, vec![candidate]))
        })
        .collect();
    // Without the force others may do its work that are confounded then; the bend that takes it over ends that.
    let own: Option<Base> = fit((beside.set.clone(), beside.at.clone())).map(|own| {
        let heavy = weights(setting, &own)
            .into_iter()
            .zip(&own.set)
            .filter(|(w, _)| *w > setting.tolerance)
            .map(|(_, c)| *c)
            .collect();
        (own, heavy)
    });
    bases.extend(own.clone());
    // What is named beside the force may itself depend on what the force depends on: a current that is not the
    // same everywhere is a force of place to a search that knows only uniform ones.
    let mut found: Vec<Explanation> = own
        .into_iter()
        .zip(unnamed.kind())
        .flat_map(|((fit, heavy), (_, variable))| bent_by(search, &fit, &heavy, variable))
        .collect();
    found.extend(bent(search, bases, WAYS, SEEDS));
    found.retain(|e| {
        let function = e.family.as_ref();
        function.is_some_and(|f| modest(setting, &e.fit, f))
    });
    found
}

/// The members of a set each bent by such a variable, signed or its size, whatever that promises linearly: far from the noise
/// a promise compares little.
fn bent_by(
    search: &Search<'_>,
    fit: &Fit,
    members: &[usize],
    variable: Variable,
) -> Vec<Explanation> {
    let setting = search.setting;
    let view = View::new(setting, &search.weights, fit);
    let mut families = bends(setting, fit, members);
    families.retain(|f| f.variable.quantity() == variable.quantity());
    measured_where_far(search, fit, &mut families);
    families
        .par_iter()
        .filter_map(|f| closed(search, fit, &view, f))
        .collect()
}

/// A set with this function as fitted, whatever it promises.
pub(super) fn closed(
    search: &Search<'_>,
    fit: &Fit,
    view: &View,
    family: &Family,
) -> Option<Explanation> {
    let (setting, weights) = (search.setting, &search.weights);
    let linear = family.fit(setting, weights, fit, view)?;
    let (joint, function) = linear.close(setting, weights, fit, weights.to_a_percent())?;
    tracing::debug!(
        "bent {:?} {:?} by {:?}, without a promise: {:.1}",
        fit.set,
        family.acts,
        family.variable,
        joint.log_evidence
    );
    Some(Explanation::with(search, joint, function))
}

/// Few effects of which one bends: what is named beside a free force may only imitate its law. The best of each
/// mechanism as fitted, for a linear promise from so far off does not compare them.
pub fn bent_alone(search: &Search<'_>) -> Vec<Explanation> {
    let mut found: Vec<Explanation> = fewest(search, ALONE)
        .into_iter()
        .flat_map(|base| bent(search, vec![base], ALONE_WAYS, ALONE_WAYS))
        .filter(|e| {
            let function = e.family.as_ref();
            function.is_some_and(|f| modest(search.setting, &e.fit, f))
        })
        .collect();
    found.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
    let mut seen = Vec::new();
    found.retain(|e| {
        let new = !seen.contains(&e.bent());
        seen.push(e.bent());
        new
    });
    found.truncate(SEEDS);
    found
}

/// One of these members of a set out, and the law of another one bent in its place: what leads a search to an effect that is
/// not there may be a law that is not quite the vocabulary's.
pub fn in_the_place(search: &Search<'_>, best: &Fit, members: &[usize]) -> Vec<Explanation> {
    let setting = search.setting;
    let effort = search.weights.to_a_percent();
    let bases: Vec<Base> = members
        .par_iter()
        .filter_map(|out| {
            let member = best.set.iter().position(|c| c == out)?;
            let (set, at) = without(setting, best, member);
            let fit = Posed::new(setting, &search.weights, &set)
                .fit_with(at, effort)
                .ok()
                .filter(|f| f.log_evidence.is_finite())?;
            let others = members.iter().copied().filter(|c| c != out);
            Some((fit, others.collect()))
        })
        .collect();
    let mut found = bent(search, bases, WAYS, SEEDS);
    found.retain(|e| {
        let function = e.family.as_ref();
        function.is_some_and(|f| modest(setting, &e.fit, f))
    });
    found
}

/// Sets with one of their laws bent: those of different mechanisms that promise most, each fitted far enough to
/// go on from there.
pub fn bent(search: &Search<'_>, bases: Vec<Base>, ways: usize, most: usize) -> Vec<Explanation> {
    let setting = search.setting;
    let mut found: Vec<(f64, &Fit, FamilyFit)> = bases
        .par_iter()
        .flat_map_iter(|(fit, members)| {
            let view = View::new(setting, &search.weights, fit);
            let mut families = bends(setting, fit, members);
            measured_where_far(search, fit, &mut families);
            families
                .into_iter()
                .filter_map(|f| f.fit(setting, &search.weights, fit, &view))
                .filter(|f| f.gain > bar_of(f))
                .map(|f| (fit.log_evidence + f.gain, fit, f))
                .collect::<Vec<_>>()
        })
        .collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    // Of each mechanism some ways: which variable its law depends on shows when others have joined it.
    let mut seen: Vec<(Acts, Variable)> = Vec::new();
    found.retain(|(_, _, f)| {
        // Knots laid otherwise over the same variable are no other way.
        let way = (f.family.acts, f.family.variable.kind());
        let before = seen.iter().filter(|s| s.0 == way.0).count();
        let new = !seen.contains(&way) && before < ways;
        if new {
            seen.push(way);
        }
        new
    });
    found.truncate(most);
    let effort = search.weights.to_a_percent();
    found
        .par_iter()
        .filter_map(|(promised, fit, f)| {
            let (joint, function) = f.close(setting, &search.weights, fit, effort)?;
            tracing::debug!(
                "bent {:?} {:?} by {:?}: {:.1}, promised {promised:.1}",
                fit.set,
                f.family.acts,
                f.family.variable,
                joint.log_evidence
            );
            Some(Explanation::with(search, joint, function))
        })
        .collect()
}

/// A set with one of its members a second time, its evidence less the choice.
pub(super) fn twice(search: &Search<'_>, fit: &Fit, view: &View, member: usize) -> Option<Fit> {
    let setting = search.setting;
    let candidate = fit.set[member];
    let own = fit.member(setting, member).to_vec();
    let starts: Vec<(f64, f64)> = (0..setting.tracks.len())
        .map(|r| fit.start(setting, r))
        .collect();
    let plain = motion(setting, &fit.set, fit.globals(setting), &starts);
    // A share of the first one's size goes over to the copy, or the copy begins where it promises most.
    let part = |share: f64| {
        let mut copy = own.clone();
        copy[0] *= share;
        copy
    };
    let mut begins: Vec<(f64, Vec<f64>, f64)> = vec![(f64::INFINITY, part(SPLIT), 1.0 - SPLIT)];
    if setting.vocabulary[candidate].info.parameters[0].corner {
        begins = CORNERS
            .map(|(low, high)| (f64::INFINITY, part(low), high))
            .to_vec();
    } else if own.len() > 1 {
        begins.extend(setting.vocabulary[candidate].starts.iter().filter_map(|p| {
            let (set, at) = joined(setting, fit, candidate, p);
            let globals = &at[..COEFFICIENTS + setting.parameters(&set)];
            let moved = motion(setting, &set, globals, &starts) - &plain;
            let left = outside(&view.basis, &whitened(setting, &search.weights, &moved));
            let (product, energy) = (left.dot(&view.residual), left.norm_squared());
            (energy > 0.0 && product < 0.0)
                .then(|| (0.5 * product * product / energy, p.clone(), 1.0))
        }));
        begins.sort_by(|a, b| b.0.total_cmp(&a.0));
    }
    begins
        .into_iter()
        .take(2)
        .filter_map(|(_, copy, left)| {
            let (set, mut at) = joined(setting, fit, candidate, &copy);
            // The copy stands before the original.
            at[setting.places(&set)[member + 1]] *= left;
            let mut two = Posed::new(setting, &search.weights, &set).fit(at).ok()?;
            two.log_evidence -= TWICE_PENALTY;
            two.log_evidence.is_finite().then_some(two)
        })
        .max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{candidate, searched, setting, surge};

    /// A search may have come to an effect that is not there by a law that is not quite the vocabulary's.
    #[test]
    fn each_of_the_members_is_done_without_where_another_one_bends() {
        let effects: [(&str, &[(&str, f64)]); 2] = [
            ("coulomb_friction", &[("f_n", 0.4)]),
            ("thruster_saturation", &[("limit_n", 7.7)]),
        ];
        let own = setting(&[surge(0, &effects), surge(1, &effects), surge(2, &effects)]);
        let limit = candidate(&own, "thruster_saturation");
        let friction = candidate(&own, "coulomb_friction");
        let mut search = searched(&own);
        let single = search.finished(&[friction]).unwrap();
        let (set, at) = joined(&own, &single, limit, &[7.6]);
        let best = Posed::new(&own, &search.weights, &set).fit(at).unwrap();
        let found = in_the_place(&search, &best, &[limit, friction]);
        let without = |out: usize, bent: usize| {
            let of = |e: &&Explanation| !e.fit.set.contains(&out) && e.bent() == Some(bent);
            found.iter().find(of)
        };
        let plain = search.get(&[limit]).unwrap().log_evidence;
        let bent = without(friction, limit).unwrap();
        assert!(bent.log_evidence > plain + 10.0);
        for e in &found {
            assert_eq!(e.fit.set.len(), 1);
            assert!(modest(&own, &e.fit, e.family.as_ref().unwrap()));
        }
        // What is no member is nothing to do without.
        let other = candidate(&own, "seiche");
        assert!(in_the_place(&search, &best, &[other]).is_empty());
    }
}
