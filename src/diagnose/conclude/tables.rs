//! The numbers of the verdict: fit, test, noise, coefficients.

use std::collections::BTreeMap;

use super::rivals::{Rivals, names};
use crate::diagnose::fit::Fit;
use crate::diagnose::posterior::{Group, Posterior};
use crate::diagnose::predict::{held_out, left_out};
use crate::diagnose::search::Search;
use crate::diagnose::setting::Track;
use crate::diagnose::verdict::{Alternative, BeforeAfter, NoiseFound, Value, Verdict};
use crate::identify::parameter::Coefficient;
use crate::identify::statistics::{chi2_above, ljung_box};

/// Groups told of as alternatives, and of those the ones that are asked to predict.
const TOLD: (usize, usize) = (12, 6);

/// rms before and after, fitted and predicted. `fits`: none, the first set, and what predicts for it.
pub fn predictions(
    verdict: &mut Verdict,
    search: &Search<'_>,
    [plain, first, predicting]: [&Fit; 3],
    held: &[Track],
) {
    let setting = search.setting;
    let noise = search.weights.noise;
    let channel = setting.channel();
    let put = |table: &mut BeforeAfter, before: Option<f64>, after: Option<f64>| {
        table.before.extend(before.map(|v| (channel.to_owned(), v)));
        table.after.extend(after.map(|v| (channel.to_owned(), v)));
        table.noise.insert(channel.to_owned(), noise.total_sd());
    };
    put(
        &mut verdict.fit.train,
        Some(rms(search, plain)),
        Some(rms(search, first)),
    );
    let by = if held.is_empty() {
        "each run predicted by the others"
    } else {
        "runs held out"
    };
    let of = |fit: &Fit| {
        if held.is_empty() {
            left_out(setting, &search.weights, fit)
        } else {
            held_out(setting, held, fit, noise)
        }
    };
    verdict.fit.held_out_by = by.to_owned();
    put(&mut verdict.fit.held_out, of(plain), of(predicting));
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
pub fn test(verdict: &mut Verdict, search: &Search<'_>, plain: &Fit, first: &Fit) {
    let setting = search.setting;
    let noise = search.weights.noise;
    let channel = setting.channel().to_owned();
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
            .residuals(setting)
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
    plain: &Fit,
    first: &Fit,
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
}

/// rms of what a fit leaves in the samples that count \[m, rad\].
pub fn rms(search: &Search<'_>, fit: &Fit) -> f64 {
    let kept: Vec<f64> = fit
        .residuals(search.setting)
        .iter()
        .zip(&search.weights.used)
        .flat_map(|(r, u)| r.iter().zip(u).filter(|(_, u)| **u).map(|(r, _)| *r))
        .collect();
    (kept.iter().map(|v| v * v).sum::<f64>() / kept.len().max(1) as f64).sqrt()
}
