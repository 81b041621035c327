//! The effects of an explanation, as the verdict lists them.

use std::collections::BTreeMap;

use super::words::twice_note;
use crate::diagnose::explain::Explanation;
use crate::diagnose::fit::Fit;
use crate::diagnose::posterior::{Group, Posterior};
use crate::diagnose::search::Search;
use crate::diagnose::verdict::{Effect, Law, Value};

/// Probability from which an effect counts as established.
const ESTABLISHED: f64 = 0.5;

/// The members of `first` that are established; `shares` = their weights.
pub fn effects(
    search: &Search<'_>,
    found: &Explanation,
    first: &Fit,
    shares: &[f64],
    post: &Posterior,
    groups: &[Group],
) -> Vec<Effect> {
    let setting = search.setting;
    let simple = found.simple();
    let covariance = first.covariance();
    let places = setting.places(&first.set);
    let bent = found.bent();
    let mut made = Vec::new();
    for (member, (candidate, weight)) in first.set.iter().zip(shares).enumerate() {
        let info = setting.vocabulary[*candidate].info;
        // Something is there when the set without it is worse; which of its kin it is, is another question.
        let there = if simple {
            evidence_share(search, first, member)
        } else {
            needed(found, *candidate)
        };
        if there < ESTABLISHED {
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
        let parameters = info
            .parameters
            .iter()
            .enumerate()
            .map(|(i, p)| {
                let k = places[member] + i;
                let variance = covariance[(k, k)];
                // As scaled to the loads of these runs.
                let (low, high) = setting.vocabulary[*candidate].flat[i];
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
        let inexact = bent == Some(*candidate);
        made.push(Effect {
            effect: info.id.to_owned(),
            words: info
                .words
                .iter()
                .zip(&setting.vocabulary[*candidate].words)
                .map(|(w, i)| (w.name.to_owned(), w.allowed[*i].to_owned()))
                .collect(),
            probability,
            weight: BTreeMap::from([(setting.channel().to_owned(), *weight)]),
            matters: *weight > setting.tolerance,
            law: if inexact { Law::Inexact } else { Law::Exact },
            law_note: if inexact {
                found
                    .twice
                    .as_ref()
                    .map(|(c, two)| twice_note(setting, *c, two))
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
    made
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
