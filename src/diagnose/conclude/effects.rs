//! The effects of an explanation, as the verdict lists them.

use std::collections::BTreeMap;

use super::words::twice_note;
use crate::choosing::Choosing;
use crate::explain::{Explanation, Recheck, needs};
use crate::fit::Fit;
use crate::posterior::{ALIKE, Group, Posterior};
use crate::search::Search;
use crate::verdict::{Effect, Law, Value};

/// Probability from which an effect counts as established.
const ESTABLISHED: f64 = 0.5;

/// The members of `first` that are established; `shares` = their weights, `second` = what the runs held out say of
/// their laws.
pub fn effects(
    search: &Search<'_>,
    found: &Explanation,
    first: &Fit,
    shares: &[f64],
    post: &Posterior,
    groups: &[Group],
    second: Option<&Recheck>,
) -> Vec<Effect> {
    let setting = search.setting;
    let simple = found.simple();
    let covariance = first.covariance();
    let places = setting.places(&first.set);
    let bent = found.bent();
    let needed = if simple {
        Vec::new()
    } else {
        needs(search, found)
    };
    let sizes = first.sizes(setting);
    let mut made = Vec::new();
    for (member, (candidate, weight)) in first.set.iter().zip(shares).enumerate() {
        let info = setting.vocabulary[*candidate].info;
        // Something is there when the set without it is worse; which of its kin it is, is another question.
        let (there, bounded) = if simple {
            evidence_share(search, &post.choosing, first, member, sizes[member])
        } else {
            let known = needed.iter().find(|n| n.0 == *candidate);
            known.map_or((share(sizes[member]), true), |n| (share(n.1), n.2))
        };
        // What was chosen by prediction is not dropped for a likelihood that decides nothing there.
        if there < ESTABLISHED && !found.by_prediction {
            continue;
        }
        let probability = if simple {
            post.inclusion.get(candidate).copied().unwrap_or(0.0)
        } else {
            there
        };
        let values = first.member(setting, member);
        let like = groups.first().map_or(Vec::new(), |g| g.matters.clone());
        let averaged = |i: usize| {
            if simple {
                post.averaged(setting, *candidate, i, &like)
            } else {
                None
            }
        };
        let weight = &averaged(0).map_or(*weight, |a| a.1);
        let mut notes = Vec::new();
        if bounded {
            notes.push(
                "its probability is the bound that its own sd gives: no fit without it succeeded"
                    .to_owned(),
            );
        }
        let parameters = info
            .parameters
            .iter()
            .enumerate()
            .map(|(i, p)| {
                let k = places[member] + i;
                let variance = covariance[(k, k)];
                // As scaled to the loads of these runs.
                let asked = &setting.vocabulary[*candidate];
                let beyond = asked.normal_sd(i).map_or(0.0, |sd| 3.0 * sd);
                let (low, high) = (asked.flat[i].0 - beyond, asked.flat[i].1 + beyond);
                if *weight > setting.tolerance && !(low..=high).contains(&values[i]) {
                    notes.push(format!(
                        "{} = {:.4} {} lies outside of the {low:.4} .. {high:.4} that such a run may show",
                        p.name, values[i], p.unit
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
        let or = if simple {
            in_its_place(search, first, member)
        } else {
            Vec::new()
        };
        if !or.is_empty() {
            notes.push(format!("these data do not tell it from {}", or.join(", ")));
        }
        let again = match second {
            Some(Recheck::Inexact(c, note)) if c == candidate => Some(note),
            _ => None,
        };
        let inexact = bent == Some(*candidate) || again.is_some();
        made.push(Effect {
            effect: info.id.to_owned(),
            words: info
                .words
                .iter()
                .zip(&setting.vocabulary[*candidate].words)
                .map(|(w, i)| (w.name.to_owned(), w.allowed[*i].to_owned()))
                .collect(),
            dof: Some(setting.dof.name().to_owned()),
            probability,
            established: probability >= crate::verdict::ESTABLISHED,
            weight: BTreeMap::from([(setting.channel().to_owned(), *weight)]),
            matters: *weight > setting.tolerance,
            law: if inexact { Law::Inexact } else { Law::Exact },
            law_exact_probability: None,
            law_note: if let Some(note) = again {
                Some(note.clone())
            } else if inexact {
                found
                    .twice
                    .as_ref()
                    .map(|(c, two)| twice_note(setting, *c, two))
                    .or_else(|| {
                        found.family.as_ref().map(|f| {
                            let what = match found.shoulder {
                                Some(_) => "what it leaves over".to_owned(),
                                None => format!("{} is not constant but", info.parameters[0].name),
                            };
                            format!(
                                "{what} depends on {} (log Bayes factor {:.1})",
                                f.family.variable.name(),
                                f.gain
                            )
                        })
                    })
            } else {
                None
            },
            parameters,
            or,
            notes,
        });
    }
    made
}

/// Probability of what is worth this log evidence.
fn share(lacks: f64) -> f64 {
    if lacks == 0.0 {
        // Not known at all.
        return 0.0;
    }
    1.0 / (1.0 + (-lacks).exp())
}

/// Probability of a member against the same set without it, fitted; from half chi-square of its size (and
/// `true`) where that fit failed.
fn evidence_share(
    search: &Search<'_>,
    choosing: &Choosing,
    fit: &Fit,
    member: usize,
    size: f64,
) -> (f64, bool) {
    let mut smaller = fit.set.clone();
    smaller.remove(member);
    let all = |f: &Fit| choosing.evidence(search.setting, &search.weights, f);
    match search.get(&smaller) {
        Some(without) => {
            let gain = all(fit) - all(without);
            // Where neither foretells anything the runs fitted decide.
            let fitted = fit.log_evidence - without.log_evidence;
            (share(if gain.is_nan() { fitted } else { gain }), false)
        }
        None => (share(size), true),
    }
}

/// Effects that do as well, in the runs fitted, in the place of a member, all others as they are: less likely by no more than a
/// factor of 20, or as likely but for what was likelier before any data.
fn in_its_place(search: &Search<'_>, first: &Fit, member: usize) -> Vec<String> {
    let setting = search.setting;
    let mut rest = first.set.clone();
    let own = rest.remove(member);
    let mut found: Vec<(f64, &str)> = search
        .fits
        .values()
        .filter(|f| f.set.len() == first.set.len() && rest.iter().all(|c| f.set.contains(c)))
        .filter_map(|f| {
            let other = *f.set.iter().find(|c| !rest.contains(c))?;
            let likely = f.log_evidence > first.log_evidence - ALIKE;
            let alike = f.at.len() == first.at.len() && f.cost < first.cost + ALIKE;
            (other != own && (likely || alike))
                .then_some((f.log_evidence, setting.vocabulary[other].info.id))
        })
        .collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found.into_iter().map(|(_, id)| id.to_owned()).collect()
}
