//! The whole way from logs to a verdict.

use std::collections::BTreeMap;

use hydroline_rigs::{Dof, ParameterValue, PhysicsEntry, Rig};
use hydroline_sim::effect::{ALL, EffectError};

use super::bank::{View, joined, outside, responses, whitened, without};
use super::explain::{Explanation, explain};
use super::family::{Acts, Variable};
use super::fit::{Fit, Posed};
use super::locate::{locate, stands_out, told};
use super::next::propose;
use super::posterior::{Group, posterior};
use super::predict::{held_out, left_out};
use super::search::Search;
use super::setting::{COEFFICIENTS, Setting, Track};
use super::source::Source;
use super::verdict::{
    Alternative, BeforeAfter, Effect, FitTable, Law, NoiseFound, Parameters, Test, Unexplained,
    Value, Verdict, Where, Word,
};
use super::weight::weights;
use crate::identify::data::{Run, is_still};
use crate::identify::parameter::Coefficient;
use crate::identify::statistics::{chi2_above, difference_sd, ljung_box};

/// Probability from which an effect counts as established.
const ESTABLISHED: f64 = 0.5;
/// Whitened size below which an effect at its most plausible could not be seen.
const UNSEEN: f64 = 4.0;
/// Share of an effect that the vehicle's own coefficients must not absorb.
const ABSORBED: f64 = 1e-3;
/// Half chi-square per sample above which no law is exact; noise leaves 0.5.
const INEXACT: f64 = 1.0;
/// rms of the runs held out over the noise above which no law is exact either.
const FAR_OFF: f64 = 2.0;
/// rms of the runs held out over that of the best explanation up to which another is as good.
const AS_GOOD: f64 = 1.1;
/// Motion below this many noise sd is rest.
const AT_REST_SD: f64 = 8.0;

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
}

/// Diagnoses logs against a rig; `held` are predicted only.
///
/// # Errors
/// [`DiagnoseError`].
pub fn diagnose(
    sources: &[Source],
    held: &[Source],
    rig: &Rig,
    progress: &(dyn Fn(&str) + Sync),
) -> Result<Diagnosis, DiagnoseError> {
    let mut verdict = empty();
    verdict.data_faults = sources
        .iter()
        .chain(held)
        .flat_map(|s| s.faults.clone())
        .collect();
    let fatal: Vec<String> = verdict
        .data_faults
        .iter()
        .filter(|f| f.fatal)
        .map(|f| format!("{} in {} of {}: {}", f.fault, f.channel, f.run, f.evidence))
        .collect();
    if let Some(first) = fatal.first() {
        verdict.verdict = Word::DataFault;
        verdict.sentence = format!("The data are at fault, not the model: {first}");
        return Ok(Diagnosis {
            verdict,
            rig: rig.clone(),
            explained: Vec::new(),
        });
    }
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
    let mut made = Diagnosis {
        verdict,
        rig: rig.clone(),
        explained: Vec::new(),
    };
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

fn empty() -> Verdict {
    Verdict {
        verdict: Word::None,
        sentence: String::new(),
        effects: Vec::new(),
        equivalent: Vec::new(),
        place: Where::default(),
        test: Test::default(),
        fit: FitTable::default(),
        parameters: Parameters::default(),
        blind_spots: Vec::new(),
        next_experiment: None,
        noise: BTreeMap::new(),
        data_faults: Vec::new(),
        alternatives: Vec::new(),
        unexplained: Vec::new(),
        notes: Vec::new(),
        sets_looked_at: 0,
    }
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

/// DOFs that are driven, or without any command move.
fn active(runs: &[Run], rig: &Rig) -> Vec<Dof> {
    let largest = runs.iter().fold([0.0_f64; 6], |m, r| {
        let w = r.largest_wrench();
        std::array::from_fn(|i| m[i].max(w[i]))
    });
    let top = largest.iter().copied().fold(0.0, f64::max);
    let mut found: Vec<(f64, Dof)> = Dof::ALL
        .into_iter()
        .filter_map(|dof| {
            let i = dof.index();
            let unit = if i < 3 {
                rig.tolerance.position_m
            } else {
                rig.tolerance.attitude_rad
            };
            let moved = runs
                .iter()
                .filter_map(|r| Track::of(r, dof))
                .map(|t| {
                    let sd = difference_sd(&t.measured);
                    let (low, high) = t
                        .measured
                        .iter()
                        .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
                            (l.min(*v), h.max(*v))
                        });
                    if high - low > 2.0 * AT_REST_SD * sd {
                        (high - low) / unit
                    } else {
                        0.0
                    }
                })
                .fold(0.0, f64::max);
            let driven = largest[i] > 0.01 * top && top > 0.0;
            (moved > 3.0 && (driven || top == 0.0)).then_some((moved, dof))
        })
        .collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    if top == 0.0 {
        found.truncate(1);
    }
    found.into_iter().map(|f| f.1).collect()
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
    let channel = setting.channel().to_owned();
    let mut search = Search::new(&setting, progress);
    search.nothing();
    if search.best().is_none() {
        return Err(DiagnoseError::NoFit { dof: dof.name() });
    }
    search.prepare();
    search.run();
    search.settle();
    let held_tracks: Vec<Track> = held.iter().filter_map(|r| Track::of(r, dof)).collect();
    progress("explanations");
    let Some(found) = explain(&mut search) else {
        return Err(DiagnoseError::NoFit { dof: dof.name() });
    };
    let Some(plain) = search.finished(&[]) else {
        return Err(DiagnoseError::NoFit { dof: dof.name() });
    };
    let post = posterior(&search);
    made.verdict.sets_looked_at += search.looked;
    // Sets without a free function compete among themselves; with one, the explanation stands alone.
    let simple = found.family.is_none() && found.twice.is_none();
    let mut groups: Vec<Group> = if simple {
        post.tied().into_iter().cloned().collect()
    } else {
        Vec::new()
    };
    if groups.len() > 1 && !held_tracks.is_empty() {
        // The runs fitted cannot tell them apart; the one that predicts best comes first.
        let miss = |g: &Group| {
            held_out(&setting, &held_tracks, &g.fit, search.weights.noise).unwrap_or(f64::INFINITY)
        };
        let mut missed: Vec<(f64, Group)> = groups.into_iter().map(|g| (miss(&g), g)).collect();
        let clear = missed.iter().map(|m| m.0).fold(0.0, f64::max)
            > 1.5 * missed.iter().map(|m| m.0).fold(f64::INFINITY, f64::min);
        if clear {
            missed.sort_by(|a, b| a.0.total_cmp(&b.0));
            if let Some((rms, g)) = missed.first() {
                let names: Vec<&str> = g
                    .matters
                    .iter()
                    .map(|c| setting.vocabulary[*c].info.id)
                    .collect();
                made.verdict.notes.push(format!("the runs fitted leave {} explanations open; the runs held out speak for {} (rms {rms:.2e})", missed.len(), names.join(" + ")));
            }
        }
        groups = missed.into_iter().map(|m| m.1).collect();
    }
    if simple && groups.len() == 1 && !held_tracks.is_empty() {
        let kin = as_good(&search, &groups[0], &held_tracks);
        if !kin.is_empty() {
            let names: Vec<&str> = kin.iter().map(|k| k.0).collect();
            made.verdict.notes.push(format!(
                "no law predicts to the noise, so likelihoods decide nothing; {} predict(s) the runs held out as well: not decided",
                names.join(", ")
            ));
            groups.extend(kin.into_iter().map(|k| k.1));
        }
    }
    // A function fitted along is no part of what a rig file can hold: predictions are the set's own.
    let first: Fit = groups.first().map_or(found.fit.clone(), |g| g.fit.clone());
    let verdict = &mut made.verdict;
    let shares = weights(&setting, &first);
    let covariance = first.covariance();
    let places = setting.places(&first.set);
    let bent = found.bent();
    for (member, (candidate, weight)) in first.set.iter().zip(&shares).enumerate() {
        let info = setting.vocabulary[*candidate].info;
        // Something is there when the set without it is worse; which of its kin it is, is another question.
        let there = if simple {
            evidence_share(&search, &first, member)
        } else {
            needed(&found, *candidate)
        };
        if there < ESTABLISHED {
            continue;
        }
        let probability = if simple {
            post.inclusion.get(candidate).copied().unwrap_or(0.0)
        } else {
            there
        };
        let values = first.member(&setting, member);
        let like = groups.first().map_or(Vec::new(), |g| g.matters.clone());
        let averaged = |i: usize| {
            if simple {
                post.averaged(&setting, *candidate, i, &like)
            } else {
                None
            }
        };
        let weight = &averaged(0).map_or(*weight, |a| a.1);
        let mut notes = Vec::new();
        let parameters = info
            .parameters
            .iter()
            .enumerate()
            .map(|(i, p)| {
                let k = places[member] + i;
                let variance = covariance[(k, k)];
                if *weight > setting.tolerance
                    && !(p.plausible.0..=p.plausible.1).contains(&values[i])
                {
                    notes.push(format!(
                        "{} = {:.4} {} lies outside of the {} .. {} that a tank run may show",
                        p.name, values[i], p.unit, p.plausible.0, p.plausible.1
                    ));
                }
                let plain = Value {
                    value: values[i],
                    sd: variance.is_finite().then(|| variance.sqrt()),
                };
                (
                    p.name.to_owned(),
                    averaged(i).map_or(plain, |(a, _)| Value {
                        value: a.value,
                        sd: a.sd,
                    }),
                )
            })
            .collect();
        let inexact = bent == Some(*candidate);
        verdict.effects.push(Effect {
            effect: info.id.to_owned(),
            words: info
                .words
                .iter()
                .zip(&setting.vocabulary[*candidate].words)
                .map(|(w, i)| (w.name.to_owned(), w.allowed[*i].to_owned()))
                .collect(),
            probability,
            weight: BTreeMap::from([(channel.clone(), *weight)]),
            matters: *weight > setting.tolerance,
            law: if inexact { Law::Inexact } else { Law::Exact },
            law_note: if inexact {
                found
                    .twice
                    .as_ref()
                    .map(|(c, two)| twice_note(&setting, *c, two))
                    .or_else(|| {
                        found.family.as_ref().map(|f| {
                            format!(
                                "{} is not constant but depends on {} (log Bayes factor {:.1})",
                                info.parameters[0].name,
                                f.family.variable.name(),
                                f.gain
                            )
                        })
                    })
            } else {
                None
            },
            parameters,
            notes,
        });
    }
    if found.unnamed() && found.family_weight > setting.tolerance {
        verdict.unexplained.extend(unexplained(&setting, &found));
    } else if let Some(f) = found
        .family
        .as_ref()
        .filter(|f| f.family.acts == Acts::Force)
    {
        verdict.notes.push(format!(
            "{}: a remaining dependence on {} weighs {:.2e}, below what matters",
            dof.name(),
            f.family.variable.name(),
            found.family_weight
        ));
    }
    let id = |set: &[usize]| -> Vec<String> {
        set.iter()
            .map(|c| setting.vocabulary[*c].info.id.to_owned())
            .collect()
    };
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
        verdict.equivalent = groups.iter().map(|g| id(&g.matters)).collect();
    }
    progress("predictions");
    // Fit and prediction.
    let noise = search.weights.noise;
    let put = |table: &mut BeforeAfter, before: Option<f64>, after: Option<f64>| {
        table.before.extend(before.map(|v| (channel.clone(), v)));
        table.after.extend(after.map(|v| (channel.clone(), v)));
        table.noise.insert(channel.clone(), noise.total_sd());
    };
    put(
        &mut verdict.fit.train,
        Some(rms(&search, &plain)),
        Some(rms(&search, &first)),
    );
    // A mechanism that acts twice predicts as two.
    let predicting = found.twice.as_ref().map_or(&first, |(_, two)| two);
    if held_tracks.is_empty() {
        verdict.fit.held_out_by = "each run predicted by the others".to_owned();
        put(
            &mut verdict.fit.held_out,
            left_out(&setting, &search.weights, &plain),
            left_out(&setting, &search.weights, predicting),
        );
    } else {
        verdict.fit.held_out_by = "runs held out".to_owned();
        put(
            &mut verdict.fit.held_out,
            held_out(&setting, &held_tracks, &plain, noise),
            held_out(&setting, &held_tracks, predicting, noise),
        );
    }
    for (group, rank) in post.groups.iter().zip(0..12) {
        let rms = if rank < 6 {
            held_out(&setting, &held_tracks, &group.fit, noise)
        } else {
            None
        };
        verdict.alternatives.push(Alternative {
            effects: id(&group.fit.set),
            log_evidence: group.fit.log_evidence - first.log_evidence,
            probability: group.probability,
            held_out: rms.map(|v| (channel.clone(), v)).into_iter().collect(),
        });
    }
    // Test.
    let ratio = 2.0 * (plain.cost - first.cost);
    let freedom = setting.parameters(&first.set) as f64;
    if ratio > verdict.test.value || verdict.test.statistic.is_empty() {
        verdict.test.statistic =
            "twice the log-likelihood ratio of the explanation over the vehicle alone".to_owned();
        verdict.test.value = ratio;
        verdict.test.freedom = freedom;
        verdict.test.p_value = if freedom > 0.0 {
            chi2_above(ratio, freedom)
        } else {
            1.0
        };
        verdict.test.whiteness_p = first
            .residuals(&setting)
            .into_iter()
            .enumerate()
            .filter_map(|(run, mut r)| {
                search.weights.whiten(run, r.iter_mut());
                Some(ljung_box(&r, 20)?.p_value)
            })
            .collect();
    }
    verdict
        .test
        .noise_rms
        .insert(channel.clone(), noise.total_sd());
    verdict.noise.insert(
        channel.clone(),
        NoiseFound {
            sd: noise.total_sd(),
            white_sd: noise.white_sd,
            coloured_sd: noise.coloured_sd,
            correlation_s: noise.correlation_s,
            outliers: search.weights.outliers(),
        },
    );
    // Coefficients.
    let coefficients = |fit: &Fit| -> BTreeMap<String, Value> {
        let c = fit.covariance();
        Coefficient::of(dof)
            .iter()
            .enumerate()
            .map(|(i, k)| {
                let sd = c[(i, i)].is_finite().then(|| c[(i, i)].sqrt());
                (
                    k.key().to_owned(),
                    Value {
                        value: fit.at[i],
                        sd,
                    },
                )
            })
            .collect()
    };
    verdict.parameters.before.extend(coefficients(&plain));
    verdict.parameters.after.extend(coefficients(&first));
    if let Some(g) = groups.first() {
        for (i, k) in Coefficient::of(dof).iter().enumerate() {
            if let Some(a) = post.averaged_coefficient(&setting, i, &g.matters) {
                let value = Value {
                    value: a.value,
                    sd: a.sd,
                };
                verdict.parameters.after.insert(k.key().to_owned(), value);
            }
        }
    }
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
        verdict.next_experiment = propose(rig, &setting, noise, &open);
    }
    made.explained.push(super::report::Explained::new(
        &setting,
        &search.weights,
        &plain,
        &first,
        &held_tracks,
    ));
    adopt(&mut made.rig, &setting, &first, &made.verdict.effects);
    Ok(())
}

/// Far from the noise likelihoods compare errors of laws, not laws: there a member's kin that
/// predicts the runs held out as well is as good an explanation (the exponent of a damping, say).
fn as_good(search: &Search<'_>, group: &Group, held: &[Track]) -> Vec<(&'static str, Group)> {
    let setting = search.setting;
    let fit = &group.fit;
    let noise = search.weights.noise;
    let Some(own) = held_out(setting, held, fit, noise) else {
        return Vec::new();
    };
    let near = fit.cost < INEXACT * search.weights.samples() as f64;
    if near && own < FAR_OFF * noise.total_sd() {
        return Vec::new();
    }
    let mut found = Vec::new();
    for (member, candidate) in fit.set.iter().enumerate() {
        if !group.matters.contains(candidate) {
            continue;
        }
        let info = setting.vocabulary[*candidate].info;
        let (smaller, at) = without(setting, fit, member);
        let gap = Fit {
            set: smaller,
            at,
            ..fit.clone()
        };
        for (other, kin) in setting.vocabulary.iter().enumerate() {
            let named = info.kin.contains(&kin.info.id) && kin.info.stage == info.stage;
            if !named || fit.set.contains(&other) || search.blind.contains(&other) {
                continue;
            }
            let made = kin
                .starts
                .iter()
                .filter_map(|point| {
                    let (set, from) = joined(setting, &gap, other, point);
                    Posed::new(setting, &search.weights, &set).fit(from).ok()
                })
                .min_by(|a, b| a.cost.total_cmp(&b.cost));
            let Some(made) = made.filter(|f| f.confounded(setting).is_empty()) else {
                continue;
            };
            if held_out(setting, held, &made, noise).is_some_and(|rms| rms < AS_GOOD * own) {
                let matters = group
                    .matters
                    .iter()
                    .map(|c| if c == candidate { other } else { *c })
                    .collect();
                found.push((
                    kin.info.id,
                    Group {
                        matters,
                        fit: made,
                        probability: 0.0,
                    },
                ));
            }
        }
    }
    found.truncate(5);
    found
}

/// How a mechanism that acts twice is told.
fn twice_note(setting: &Setting, candidate: usize, two: &Fit) -> String {
    let info = setting.vocabulary[candidate].info;
    let copies: Vec<String> = (0..two.set.len())
        .filter(|m| two.set[*m] == candidate)
        .map(|m| {
            info.parameters
                .iter()
                .zip(two.member(setting, m))
                .map(|(p, v)| format!("{} = {v:.4}", p.name))
                .collect::<Vec<_>>()
                .join(", ")
        })
        .collect();
    format!("acts as two in a row would: {}", copies.join(" and "))
}

/// Probability of a member against the best explanation without it, a free function on either side.
fn needed(found: &Explanation, candidate: usize) -> f64 {
    let lacks = found
        .needed
        .iter()
        .find(|(c, _)| *c == candidate)
        .map_or(f64::INFINITY, |(_, l)| *l);
    1.0 / (1.0 + (-lacks).exp())
}

/// Probability of a member against the same set without it.
fn evidence_share(search: &Search<'_>, fit: &Fit, member: usize) -> f64 {
    let mut smaller = fit.set.clone();
    smaller.remove(member);
    let without = search
        .get(&smaller)
        .map_or(f64::NEG_INFINITY, |f| f.log_evidence);
    1.0 / (1.0 + (without - fit.log_evidence).exp())
}

fn rms(search: &Search<'_>, fit: &Fit) -> f64 {
    let kept: Vec<f64> = fit
        .residuals(search.setting)
        .iter()
        .zip(&search.weights.used)
        .flat_map(|(r, u)| r.iter().zip(u).filter(|(_, u)| **u).map(|(r, _)| *r))
        .collect();
    (kept.iter().map(|v| v * v).sum::<f64>() / kept.len().max(1) as f64).sqrt()
}

fn unexplained(setting: &Setting, found: &Explanation) -> Option<Unexplained> {
    let f = found.family.as_ref()?;
    let (range, force) = stands_out(setting, f);
    let unit = match f.family.variable {
        Variable::Place | Variable::PlaceAgainst => {
            if setting.dof.index() < 3 {
                "m"
            } else {
                "rad"
            }
        }
        Variable::Rate | Variable::Speed => {
            if setting.dof.index() < 3 {
                "m/s"
            } else {
                "rad/s"
            }
        }
        Variable::Load | Variable::LoadSize => {
            if setting.dof.index() < 3 {
                "N"
            } else {
                "N m"
            }
        }
        _ => "s",
    };
    let load = if setting.dof.index() < 3 { "N" } else { "N m" };
    let (of, range) = told(setting, f.family.variable, range);
    Some(Unexplained {
        channel: setting.channel().to_owned(),
        weight: found.family_weight,
        depends_on: of.clone(),
        range,
        force,
        term: format!(
            "a force of about {force:.3} {load} for {} between {:.3} and {:.3} {unit}, near 0 elsewhere",
            of, range[0], range[1]
        ),
        knots: f.family.knots.clone(),
        force_at: f.amplitudes.clone(),
        force_sd: f.sds.clone(),
        log_bayes_factor: f.gain,
    })
}

/// What these runs cannot show: effects that act in this DOF but whose response, at their most
/// plausible, drowns in the noise or in the vehicle's own coefficients.
fn blind(search: &Search<'_>, fit: &Fit) -> Vec<String> {
    let setting = search.setting;
    let view = View::new(setting, &search.weights, fit);
    let mut best: BTreeMap<usize, (f64, f64)> = BTreeMap::new();
    for r in responses(setting, fit) {
        let w = whitened(setting, &search.weights, &r.column);
        let left = outside(&view.basis, &w).norm();
        let entry = best.entry(r.candidate).or_insert((0.0, 0.0));
        entry.0 = entry.0.max(left);
        entry.1 = entry.1.max(left / w.norm().max(1e-300));
    }
    // What would act here if the vehicle went astern and coasted: seen in a run that does.
    let probe = probe(setting);
    (0..setting.vocabulary.len())
        .filter(|c| !fit.set.contains(c))
        .filter(|c| {
            search.blind.contains(c)
                || match best.get(c) {
                    Some((size, share)) => *size < UNSEEN || *share < ABSORBED,
                    None => probe.contains(c),
                }
        })
        .map(|c| setting.vocabulary[c].info.id.to_owned())
        .collect()
}

/// Candidates that move this DOF in a run ahead, astern and at rest.
fn probe(setting: &Setting) -> Vec<usize> {
    let Some(like) = setting.tracks.first() else {
        return Vec::new();
    };
    let size = setting
        .tracks
        .iter()
        .flat_map(|t| &t.edges)
        .map(|e| e.1.abs())
        .fold(0.0, f64::max);
    let size = if size > 0.0 { size } else { 1.0 };
    let times_s: Vec<f64> = (0..200).map(|k| 0.006 + 0.1 * f64::from(k)).collect();
    let track = Track {
        measured: vec![0.0; times_s.len()],
        times_s,
        edges: vec![(0.0, size), (6.0, -size), (15.0, 0.0)],
        start_s: 0.0,
        ..like.clone()
    };
    let there = setting.with_tracks(vec![track]);
    let vehicle = setting.coefficients();
    let none = Fit {
        set: Vec::new(),
        at: vehicle.iter().copied().chain([0.0, 0.0]).collect(),
        cost: 0.0,
        hessian: nalgebra::DMatrix::zeros(0, 0),
        log_evidence: 0.0,
        rough: false,
    };
    let mut moved: Vec<usize> = responses(&there, &none)
        .iter()
        .map(|r| r.candidate)
        .collect();
    moved.dedup();
    moved
}

/// Puts the explanation into a rig.
fn adopt(rig: &mut Rig, setting: &Setting, fit: &Fit, effects: &[Effect]) {
    for (c, value) in Coefficient::of(setting.dof)
        .iter()
        .zip(&fit.at[..COEFFICIENTS])
    {
        c.put(&mut rig.vehicle, *value);
    }
    // The set's own fit, not the average over sets: coefficients and effects belong together.
    let fitted = |name: &str, e: &Effect| -> Option<f64> {
        let member = fit
            .set
            .iter()
            .position(|c| setting.vocabulary[*c].info.id == e.effect)?;
        let i = setting.vocabulary[fit.set[member]]
            .info
            .parameter_index(name)?;
        Some(fit.member(setting, member)[i])
    };
    for e in effects {
        let mut parameters: Vec<(String, ParameterValue)> = e
            .words
            .iter()
            .map(|(n, w)| (n.clone(), ParameterValue::Word(w.clone())))
            .collect();
        if let Some(info) = ALL.iter().find(|i| i.id == e.effect) {
            for p in info.parameters {
                if let Some(v) = fitted(p.name, e) {
                    parameters.push((p.name.to_owned(), ParameterValue::Number(v)));
                }
            }
        }
        let entry = PhysicsEntry {
            effect: e.effect.clone(),
            parameters,
        };
        if !rig.physics.iter().any(|o| o.effect == entry.effect) {
            rig.physics.push(entry);
        }
    }
}

fn sentence(v: &Verdict) -> String {
    let say = |e: &Effect| {
        let weight: Vec<String> = e
            .weight
            .iter()
            .map(|(c, w)| {
                if c.ends_with("_rad") {
                    format!("{:.2} deg", w.to_degrees())
                } else {
                    format!("{:.2} mm", w * 1e3)
                }
            })
            .collect();
        let numbers: Vec<String> = e
            .parameters
            .iter()
            .map(|(n, p)| format!("{n} = {:.4}", p.value))
            .collect();
        format!(
            "{} ({}; {})",
            e.effect,
            weight.join(", "),
            numbers.join(", ")
        )
    };
    let heavy: Vec<String> = v.effects.iter().filter(|e| e.matters).map(say).collect();
    let small = v.effects.iter().filter(|e| !e.matters).count();
    let also = if small > 0 {
        format!("; {small} small effect(s) established that do not matter")
    } else {
        String::new()
    };
    match v.verdict {
        Word::None => format!("Nothing that matters was left out{also}."),
        Word::Named => format!("Left out: {}{also}.", heavy.join(" and ")),
        Word::Ambiguous => format!(
            "These data cannot tell apart: {}{also}.",
            v.equivalent
                .iter()
                .map(|s| format!("[{}]", s.join(" + ")))
                .collect::<Vec<_>>()
                .join(" or ")
        ),
        Word::Unknown => format!(
            "Something that no effect of the vocabulary explains: {}{}{also}.",
            v.unexplained
                .iter()
                .map(|u| u.term.clone())
                .collect::<Vec<_>>()
                .join("; "),
            if heavy.is_empty() {
                String::new()
            } else {
                format!("; beside it {}", heavy.join(" and "))
            }
        ),
        Word::DataFault => v.sentence.clone(),
    }
}
