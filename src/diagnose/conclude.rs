//! The whole way from logs to a verdict.

mod active;
mod adopt;
mod beliefs;
mod effects;
mod exponent;
mod kin;
mod rivals;
mod spots;
mod tables;
mod words;

use std::ops::ControlFlow;

use hydroline_rigs::{Dof, Rig};
use hydroline_sim::effect::EffectError;

use super::choosing::Choosing;
use super::explain::{Explanation, Recheck, explain, forward, of_a_thruster, recheck, renewed};
use super::family::Acts;
use super::fit::Fit;
use super::locate::locate;
use super::next::propose;
use super::posterior::{Fitted, Group, TIE, near, posterior};
use super::search::Search;
use super::setting::{Setting, Track};
use super::source::Source;
use super::verdict::{DataFault, Effect, Verdict, Word};
use super::weight::{weight_together, weights};
pub(super) use active::active;
use adopt::adopt;
use beliefs::likeliest;
use effects::effects;
use exponent::exponents;
use hydroline_identify::data::{Run, is_still};
use kin::as_good;
use rivals::{Rivals, names};
use spots::blind;
pub(super) use tables::HELD_OUT;
use tables::{alternatives, coefficients, predictions, rms, test};
use words::{sentence, unexplained};

/// Why there is no verdict.
#[derive(Debug, thiserror::Error)]
pub enum DiagnoseError {
    /// Nothing to fit.
    #[error(
        "no DOF moves in these {0} log(s): nothing to diagnose; give runs with commands, or a decay"
    )]
    NothingMoves(usize),
    /// The rig's effects.
    #[error(transparent)]
    Effect(#[from] EffectError),
    /// No fit.
    #[error(
        "{dof}: the rig's own model gives no finite motion; check its coefficients (all negative) and the commands' units"
    )]
    NoFit {
        /// DOF.
        dof: &'static str,
    },
}

/// A verdict, and the rig with what was left out put in.
#[derive(Debug, Clone)]
pub struct Diagnosis {
    /// For people and machines.
    pub verdict: Verdict,
    /// The rig with refitted coefficients and `[[physics]]` of the first explanation.
    pub rig: Rig,
    /// Per DOF what the report draws.
    pub explained: Vec<std::sync::Arc<super::report::Explained>>,
    /// The same, ready to be drawn.
    pub shown: Vec<super::report::Shown>,
}

/// Diagnoses logs against a rig; `held` are predicted only.
///
/// # Errors
/// [`DiagnoseError`].
pub fn explained(
    sources: &[Source],
    held: &[Source],
    rig: &Rig,
    progress: &(dyn Fn(&str) + Sync),
) -> Result<Diagnosis, DiagnoseError> {
    let mut made = match stopped_by_faults(sources, held, rig, |_| true) {
        ControlFlow::Break(stopped) => return Ok(stopped),
        ControlFlow::Continue(going_on) => going_on,
    };
    let tolerance = [rig.tolerance.position_m, rig.tolerance.attitude_rad];
    let runs: Vec<Run> = sources
        .iter()
        .map(|s| s.run.clone())
        .filter(|r| !is_still(r, tolerance))
        .collect();
    let held: Vec<Run> = held.iter().map(|s| s.run.clone()).collect();
    let dofs = active(&runs, rig);
    if dofs.is_empty() {
        return Err(DiagnoseError::NothingMoves(sources.len()));
    }
    for dof in dofs {
        one(&mut made, &runs, &held, rig, dof, progress)?;
    }
    let verdict = &mut made.verdict;
    verdict
        .effects
        .sort_by(|a, b| relative(b, rig).total_cmp(&relative(a, rig)));
    verdict.sentence = sentence(verdict);
    Ok(made)
}

/// A verdict with the data's faults: `Break` where one of them ends it, of those that `counts`.
pub(super) fn stopped_by_faults(
    sources: &[Source],
    held: &[Source],
    rig: &Rig,
    counts: impl Fn(&DataFault) -> bool,
) -> ControlFlow<Diagnosis, Diagnosis> {
    let mut verdict = Verdict::default();
    let all = sources.iter().chain(held);
    verdict.data_faults = all.flat_map(|s| s.faults.clone()).collect();
    for fault in &mut verdict.data_faults {
        fault.fatal &= counts(fault);
    }
    let fatal = verdict.data_faults.iter().find(|f| f.fatal);
    let stops = fatal.map(|f| format!("{} in {} of {}: {}", f.fault, f.channel, f.run, f.evidence));
    let mut made = Diagnosis {
        verdict,
        rig: rig.clone(),
        explained: Vec::new(),
        shown: Vec::new(),
    };
    let Some(first) = stops else {
        return ControlFlow::Continue(made);
    };
    made.verdict.verdict = Word::DataFault;
    made.verdict.sentence = format!("The data are at fault, not the model: {first}");
    ControlFlow::Break(made)
}

/// Weight over the channel's tolerance.
fn relative(e: &Effect, rig: &Rig) -> f64 {
    e.weight
        .iter()
        .map(|(c, w)| {
            w / if c.ends_with("_rad") {
                rig.tolerance.attitude_rad
            } else {
                rig.tolerance.position_m
            }
        })
        .fold(0.0, f64::max)
}

/// Runs held out that choose between explanations, and those that tell how well the chosen one predicts:
/// not the same where there are two.
fn halves(held: &[Track]) -> (Vec<Track>, Vec<Track>) {
    if held.len() < 2 {
        return (held.to_vec(), held.to_vec());
    }
    let every = |first: usize| held.iter().skip(first).step_by(2).cloned().collect();
    (every(0), every(1))
}

/// The explanation of a search; a force of the load in it is a thruster's law.
fn found(search: &mut Search<'_>, choosing: &[Track]) -> Option<Explanation> {
    let found = searched(search, choosing)?;
    Some(of_a_thruster(search, found))
}

/// The explanation: by prediction where no law is exact, else from the search; where it has a free function
/// that leaves clearly less noise, searched once more under that.
fn searched(search: &mut Search<'_>, choosing: &[Track]) -> Option<Explanation> {
    search.prepare();
    if search.no_law_is_exact()
        && !search.stopped_early()
        && let Some(found) = forward(search, choosing)
    {
        return Some(found);
    }
    search.run();
    search.settle();
    (search.progress)("explanations");
    let found = explain(search, choosing, None)?;
    let Some(function) = found
        .family
        .as_ref()
        .filter(|f| f.family.acts == Acts::Force && found.family_weight > search.setting.tolerance)
    else {
        return Some(found);
    };
    let before = search.weights.noise;
    if !search.reweigh_beside(&found.fit, function, before) {
        return Some(found);
    }
    if let Some(same) = renewed(search, &found, choosing) {
        return Some(same);
    }
    search.refresh(&[]);
    search.run();
    search.settle();
    explain(search, choosing, Some(&found)).or(Some(found))
}

/// Effects of this DOF that matter by themselves no longer do; their names.
fn cancelling(verdict: &mut Verdict, setting: &Setting) -> String {
    let own = verdict
        .effects
        .iter_mut()
        .filter(|e| e.matters && e.weight.contains_key(setting.channel()));
    let names: Vec<&str> = own
        .map(|e| {
            e.matters = false;
            e.effect.as_str()
        })
        .collect();
    names.join(", ")
}

fn one(
    made: &mut Diagnosis,
    runs: &[Run],
    held: &[Run],
    rig: &Rig,
    dof: Dof,
    progress: &(dyn Fn(&str) + Sync),
) -> Result<(), DiagnoseError> {
    let setting = Setting::new(runs, rig, dof)?;
    let mut search = Search::new(&setting, progress);
    search.nothing();
    if search.best().is_none() {
        return Err(DiagnoseError::NoFit { dof: dof.name() });
    }
    let held_tracks: Vec<Track> = held.iter().filter_map(|r| Track::of(r, dof)).collect();
    let (choosing, telling) = halves(&held_tracks);
    let Some(found) = found(&mut search, &choosing) else {
        return Err(DiagnoseError::NoFit { dof: dof.name() });
    };
    let (mut search, found) = likeliest(search, found, &choosing);
    let choice = search.best().map_or_else(Choosing::default, |best| {
        Choosing::like(&setting, &search.weights, &choosing, best)
            .with(&search.shown)
            .unless_far(&setting, &search.weights, &near(&search))
    });
    if found.simple() {
        // What the best sets are without each of their members, so that no probability is 1 for want of asking.
        let by_all = |f: &&Fit| choice.evidence(&setting, &search.weights, f);
        let mut front = near(&search);
        front.sort_by(|a, b| by_all(b).total_cmp(&by_all(a)));
        let front: Vec<Vec<usize>> = front.iter().take(2).map(|f| f.set.clone()).collect();
        search.reduce_below(&front, f64::INFINITY);
    }
    let Some(plain) = search.finished(&[]) else {
        return Err(DiagnoseError::NoFit { dof: dof.name() });
    };
    let post = posterior(&search, choice);
    made.verdict.sets_looked_at += search.looked;
    // Sets without a free function compete among themselves; with one, the explanation stands alone.
    let simple = found.simple();
    let mut groups: Vec<Group> = if simple {
        post.tied().into_iter().cloned().collect()
    } else if found.by_prediction {
        vec![Group {
            matters: found.matters(setting.tolerance),
            fit: found.fit.clone(),
            probability: 1.0,
            told: 0.0,
            fitted: Fitted::default(),
        }]
    } else {
        Vec::new()
    };
    if let [best, others @ ..] = &groups[..]
        && !others.is_empty()
    {
        let all = |g: &Group| g.fit.log_evidence + g.told;
        let next = others.iter().map(all).fold(f64::NEG_INFINITY, f64::max);
        let by = all(best) - next;
        if by > TIE && by.is_finite() && best.told != 0.0 {
            let names = names(&search, &best.matters);
            made.verdict.notes.push(format!(
                "the runs fitted leave {} explanations open; with the runs held out {} is likelier than any other of them (log Bayes factor {by:.1})",
                groups.len(),
                names.join(" + ")
            ));
        }
    }
    if groups.len() == 1 && !choosing.is_empty() {
        let kin = as_good(&search, &groups[0], &choosing);
        if !kin.is_empty() {
            let names: Vec<&str> = kin.iter().map(|k| k.0).collect();
            made.verdict.notes.push(format!(
                "no law predicts to the noise, so likelihoods decide nothing; {} predict(s) the runs held out as well: not decided",
                names.join(", ")
            ));
            groups.extend(kin.into_iter().map(|k| k.1));
        }
    }
    let first: Fit = groups.first().map_or(found.fit.clone(), |g| g.fit.clone());
    // A bend is no part of what a rig file can hold, and the numbers found beside it are not the best without
    // it: what is written, and what its rivals are compared with, is the set fitted alone.
    let written = match found.bent() {
        Some(_) => search
            .alone(&first)
            .filter(|alone| rms(&search, alone) < rms(&search, &first))
            .unwrap_or_else(|| first.clone()),
        None => first.clone(),
    };
    let verdict = &mut made.verdict;
    let shares = if simple {
        weights(&setting, &first)
    } else {
        found.weights.clone()
    };
    // A law that the runs fitted do not tell from the vocabulary's, the others may.
    let heavy = shares.iter().any(|w| *w > setting.tolerance);
    let second = (simple && heavy)
        .then(|| recheck(&search, &first, &held_tracks))
        .flatten();
    verdict.effects.extend(effects(
        &search,
        &found,
        &first,
        &shares,
        &post,
        &groups,
        second.as_ref(),
    ));
    let only: Vec<_> = search
        .shown
        .iter()
        .filter(|s| !first.set.contains(&s.0))
        .collect();
    if let [(_, _, gain), ..] = only[..] {
        let ids = only.iter();
        let ids: Vec<&str> = ids.map(|s| setting.vocabulary[s.0].info.id).collect();
        verdict.notes.push(format!(
            "{}: the runs held out show {} (log Bayes factor {gain:.1}), which the runs fitted do not reach; fit such a run too to have it named",
            dof.name(),
            ids.join(" and "),
        ));
    }
    if let Some(Recheck::Unnamed(note)) = second {
        verdict.notes.push(format!("{}: {note}", dof.name()));
    }
    if found.unnamed() && found.family_weight > setting.tolerance {
        verdict.unexplained.extend(unexplained(&setting, &found));
    } else if let Some(f) = found.family.as_ref().filter(|_| found.unnamed()) {
        verdict.notes.push(format!(
            "{}: a remaining dependence on {} weighs {:.2e}, below what matters",
            dof.name(),
            f.family.variable.name(),
            found.family_weight
        ));
    }
    // Effects that matter one by one and cancel each other leave nothing out that does.
    let several = shares.iter().filter(|w| **w > setting.tolerance).count() > 1
        && groups.len() < 2
        && found.twice.is_none()
        && !found.unnamed();
    let together = several.then(|| weight_together(&setting, &first, found.family.as_ref()));
    if let Some(together) = together.filter(|w| *w <= setting.tolerance) {
        let names = cancelling(verdict, &setting);
        verdict.notes.push(format!(
            "{}: {names} cancel each other: together they weigh {together:.2e}, below what matters",
            dof.name()
        ));
    }
    let matters = verdict.effects.iter().any(|e| e.matters);
    let word = if !verdict.unexplained.is_empty() {
        Word::Unknown
    } else if groups.len() > 1 {
        Word::Ambiguous
    } else if matters {
        Word::Named
    } else {
        Word::None
    };
    verdict.verdict = verdict.verdict.max(word);
    if groups.len() > 1 {
        verdict.equivalent = groups.iter().map(|g| names(&search, &g.matters)).collect();
    }
    progress("predictions");
    let chose = held_tracks.len() == 1;
    predictions(
        verdict,
        &search,
        &found,
        [&plain, &written],
        &telling,
        chose,
    );
    let mut rivals = Rivals::of(&search, &written, &shares, &telling).beside(&found.also);
    if found.by_prediction && !setting.is_restored() {
        rivals = rivals.in_windows();
    }
    verdict.notes.extend(rivals.undecided());
    alternatives(verdict, &search, &post, &rivals, &written, &telling);
    if !found.unnamed() {
        let established = |id: &str| verdict.effects.iter().any(|e| e.effect == id);
        let powers = exponents(&search, &written, &shares, &telling, &established);
        verdict.notes.extend(powers.iter().map(|p| p.told.clone()));
        verdict.parameters.exponents.extend(powers);
    }
    verdict.ladder.extend(rivals.ladder());
    test(verdict, &search, &found, [&plain, &first]);
    coefficients(verdict, &search, [&plain, &first, &written], &post, &groups);
    // Where.
    let heaviest = first
        .set
        .iter()
        .zip(&shares)
        .max_by(|a, b| a.1.total_cmp(b.1))
        .map(|(c, _)| setting.vocabulary[*c].info.stage.name());
    let place = locate(&search, &plain, heaviest);
    if verdict.place.dof.is_empty() {
        verdict.place = place;
    } else {
        verdict.place.dof.extend(place.dof);
        verdict.place.windows.extend(place.windows);
        verdict.place.regime =
            format!("{}; {}: {}", verdict.place.regime, dof.name(), place.regime);
    }
    for spot in blind(&search, &plain) {
        let open = verdict.effects.iter().any(|e| e.effect == spot)
            || verdict.equivalent.iter().any(|s| s.contains(&spot));
        if open {
            continue;
        }
        if !verdict.blind_spots.contains(&spot) {
            verdict.blind_spots.push(spot);
        }
    }
    progress("next experiment");
    let mut open: Vec<Fit> = groups.iter().map(|g| g.fit.clone()).collect();
    if open.len() < 2 {
        // Nothing is tied: the runner-up, or nothing at all, is what a new run would have to beat.
        open = vec![first.clone()];
        open.extend(
            post.groups
                .iter()
                .find(|g| g.fit.set != first.set)
                .map(|g| g.fit.clone()),
        );
        if open.len() < 2 && !first.set.is_empty() {
            open.push(plain.clone());
        }
    }
    if verdict.next_experiment.is_none() {
        verdict.next_experiment = propose(rig, &setting, &search.weights, &open);
    }
    made.explained.push(super::report::Explained::new(
        &setting,
        &search.weights,
        &plain,
        &written,
        &held_tracks,
    ));
    adopt(&mut made.rig, &setting, &written, &made.verdict.effects);
    Ok(())
}
