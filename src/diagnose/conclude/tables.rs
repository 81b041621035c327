//! The numbers of the verdict: fit, test, noise, coefficients.

use std::collections::BTreeMap;

use super::rivals::{Rivals, names};
use crate::explain::Explanation;
use crate::fit::Fit;
use crate::posterior::{Group, Posterior};
use crate::predict::{held_out, left_out, predicted_beside};
use crate::search::Search;
use crate::setting::Track;
use crate::verdict::{Alternative, BeforeAfter, NoiseFound, Value, Verdict};
use hydroline_identify::parameter::Coefficient;
use hydroline_numerics::statistics::{chi2_above, ljung_box};

/// How runs were predicted when none were held out.
pub const BY_THE_OTHERS: &str =
    "each run predicted by coefficients fitted to the others, the explanation chosen with all";
/// How they were else; the runs' names follow.
pub const HELD_OUT: &str = "runs held out";
/// Share of a coefficient by which the runs must differ from the rig for it to be said: a rig file is some 20 % off.
const FAR_OFF: f64 = 0.5;
/// Groups told of as alternatives, and of those the ones that are asked to predict.
const TOLD: (usize, usize) = (12, 6);

/// rms before and after, fitted and predicted. `plain` = the vehicle alone, `written` = what a rig file can
/// hold of the explanation; `held` = the runs held out that tell how well, and whether they also chose what does.
///
/// A law that is not quite the vocabulary's is fitted and predicts with its bend, a mechanism that acts twice
/// as two, an unnamed force that says something of other runs with it; what the written rig does without is said
/// beside.
pub fn predictions(
    verdict: &mut Verdict,
    search: &Search<'_>,
    found: &Explanation,
    [plain, written]: [&Fit; 2],
    held: &[Track],
    chose: bool,
) {
    let setting = search.setting;
    let noise = search.weights.noise;
    let channel = setting.channel();
    let put = |table: &mut BeforeAfter, before: Option<f64>, after: Option<f64>| {
        table.before.extend(before.map(|v| (channel.to_owned(), v)));
        table.after.extend(after.map(|v| (channel.to_owned(), v)));
        table.noise.insert(channel.to_owned(), noise.total_sd());
    };
    let function = found.family.as_ref().filter(|f| f.family.lasts());
    let two = found.twice.as_ref().map(|(_, two)| two);
    // A force in time says nothing of other runs, and is part of what was fitted.
    let trained = match found.family.is_some() || two.is_some() {
        true => rms_of(search, found.residuals(search)),
        false => rms(search, written),
    };
    put(
        &mut verdict.fit.train,
        Some(rms(search, plain)),
        Some(trained),
    );
    let names: Vec<&str> = held.iter().map(|t| t.name.as_str()).collect();
    let by = if held.is_empty() {
        BY_THE_OTHERS.to_owned()
    } else if chose {
        format!(
            "{HELD_OUT}: {}, which also helped to choose the explanation",
            names.join(", ")
        )
    } else {
        format!("{HELD_OUT}: {}, which chose nothing", names.join(", "))
    };
    let of = |fit: &Fit| {
        if held.is_empty() {
            left_out(setting, &search.weights, fit)
        } else {
            held_out(setting, held, fit, noise)
        }
    };
    verdict.fit.held_out_by = by;
    let own = of(written);
    let after = match (function, two) {
        (Some(f), _) => predicted_beside(setting, held, &found.fit, f, noise).map(|p| p.rms),
        (None, Some(two)) => of(two),
        (None, None) => None,
    };
    put(&mut verdict.fit.held_out, of(plain), after.or(own));
    if let (Some(_), Some(own)) = (after, own) {
        verdict.fit.held_out_written.insert(channel.to_owned(), own);
    }
}

/// The most probable explanations, then models with a term missing or a wrong one.
pub fn alternatives(
    verdict: &mut Verdict,
    search: &Search<'_>,
    post: &Posterior,
    rivals: &Rivals<'_>,
    first: &Fit,
    held: &[Track],
) {
    let channel = search.setting.channel();
    let one = |v: f64| BTreeMap::from([(channel.to_owned(), v)]);
    let mut all: Vec<Alternative> = Vec::new();
    for (rank, group) in post.groups.iter().take(TOLD.0).enumerate() {
        let miss = if rank < TOLD.1 {
            held_out(search.setting, held, &group.fit, search.weights.noise)
        } else {
            None
        };
        all.push(Alternative {
            effects: names(search, &group.fit.set),
            log_evidence: group.fit.log_evidence - first.log_evidence,
            probability: group.probability,
            train: one(rms(search, &group.fit)),
            held_out: miss.map(one).unwrap_or_default(),
        });
    }
    let top = post.groups.first().map_or(1.0, |g| g.probability);
    for rival in rivals.alternatives(top) {
        if !all.iter().any(|a| a.effects == rival.effects) {
            all.push(rival);
        }
    }
    verdict.alternatives.extend(all);
}

/// Is there a mismatch at all, and the noise it is held against.
pub fn test(
    verdict: &mut Verdict,
    search: &Search<'_>,
    found: &Explanation,
    [plain, first]: [&Fit; 2],
) {
    let setting = search.setting;
    // With its function, or its second copy: what is left is to be noise, and each number of it is counted.
    let (cost, more, left) = match (&found.family, &found.twice) {
        (Some(f), _) => (
            first.cost,
            f.family.knots.len(),
            f.residuals(setting, &search.weights, &found.fit),
        ),
        (None, Some((_, two))) => (
            two.cost,
            setting.parameters(&two.set) - setting.parameters(&first.set),
            two.residuals(setting),
        ),
        (None, None) => (first.cost, 0, first.residuals(setting)),
    };
    let noise = search.weights.noise;
    let channel = setting.channel().to_owned();
    let ratio = 2.0 * (plain.cost - cost);
    let freedom = (setting.parameters(&first.set) + more) as f64;
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
        verdict.test.whiteness_p = left
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
        channel,
        NoiseFound {
            sd: noise.total_sd(),
            white_sd: noise.white_sd,
            coloured_sd: noise.coloured_sd,
            correlation_s: noise.correlation_s,
            outliers: search.weights.outliers(),
        },
    );
}

/// The vehicle's own coefficients without and with the effects.
pub fn coefficients(
    verdict: &mut Verdict,
    search: &Search<'_>,
    [plain, first, written]: [&Fit; 3],
    post: &Posterior,
    groups: &[Group],
) {
    let setting = search.setting;
    let coefficients = |fit: &Fit| -> BTreeMap<String, Value> {
        let c = fit.covariance();
        Coefficient::of(setting.dof)
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
    verdict.parameters.before.extend(coefficients(plain));
    verdict.parameters.after.extend(coefficients(first));
    verdict.parameters.written.extend(coefficients(written));
    let spread = written.covariance();
    let places = setting.places(&written.set);
    for (member, (candidate, place)) in written.set.iter().zip(places).enumerate() {
        let info = setting.vocabulary[*candidate].info;
        if !verdict.effects.iter().any(|e| e.effect == info.id) {
            continue;
        }
        let values = info
            .parameters
            .iter()
            .zip(written.member(setting, member))
            .enumerate()
            .map(|(i, (p, value))| {
                let variance = spread[(place + i, place + i)];
                let sd = variance.is_finite().then(|| variance.sqrt());
                (p.name.to_owned(), Value { value: *value, sd })
            })
            .collect();
        verdict
            .parameters
            .written_effects
            .entry(info.id.to_owned())
            .or_insert(values);
    }
    if let Some(g) = groups.first() {
        for (i, k) in Coefficient::of(setting.dof).iter().enumerate() {
            if let Some(a) = post.averaged_coefficient(setting, i, &g.matters) {
                let value = Value {
                    value: a.value,
                    sd: a.sd,
                };
                verdict.parameters.after.insert(k.key().to_owned(), value);
            }
        }
    }
    // A model is also wrong where its own numbers are.
    for (k, own) in Coefficient::of(setting.dof)
        .iter()
        .zip(setting.coefficients())
    {
        let Some(found) = verdict.parameters.after.get(k.key()) else {
            continue;
        };
        let off = (found.value - own).abs();
        if own != 0.0 && off > FAR_OFF * own.abs() && found.sd.is_some_and(|sd| off > 5.0 * sd) {
            verdict.notes.push(format!(
                "{}: the rig has {own:.4}, these runs say {:.4} (sd {:.2e}), {:.2} times as much",
                k.key(),
                found.value,
                found.sd.unwrap_or(f64::NAN),
                found.value / own
            ));
        }
    }
}

/// rms of what a fit leaves in the samples that count \[m, rad\].
pub fn rms(search: &Search<'_>, fit: &Fit) -> f64 {
    rms_of(search, fit.residuals(search.setting))
}

/// The same of residuals, run by run.
fn rms_of(search: &Search<'_>, residuals: Vec<Vec<f64>>) -> f64 {
    let kept: Vec<f64> = residuals
        .iter()
        .zip(&search.weights.used)
        .flat_map(|(r, u)| r.iter().zip(u).filter(|(_, u)| **u).map(|(r, _)| *r))
        .collect();
    (kept.iter().map(|v| v * v).sum::<f64>() / kept.len().max(1) as f64).sqrt()
}
