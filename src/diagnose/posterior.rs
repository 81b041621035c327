//! Probabilities of explanations, and which of them this data cannot tell apart.

mod beyond;

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::choosing::Choosing;
use super::fit::Fit;
use super::rest;
use super::search::Search;
use super::setting::Setting;
use super::weight::weights;
use beyond::Beyond;

/// Sets further below the best than this carry no probability worth a weight.
pub const FAR: f64 = 12.0;
/// Most sets weighed.
const MOST: usize = 60;
/// Log evidence within which two explanations count as tied.
pub const TIE: f64 = 4.0;
/// Half chi-square within which two sets with as many parameters fit alike: a factor
/// of 20 between their likelihoods. Which of them is likelier before any data splits nothing.
pub const ALIKE: f64 = 3.0;
/// Probability of nothing that matters above which nothing else is tied with it: the rate of false alarms, for something
/// that does what the vehicle's own numbers do is never ruled out by much.
const SURELY_NOTHING: f64 = 0.9;
/// Most sets reported.
const REPORTED: usize = 6;

/// One explanation: what matters, and the best set that holds just that.
#[derive(Debug, Clone)]
pub struct Group {
    /// What matters: candidates, ascending.
    pub matters: Vec<usize>,
    /// Best full set.
    pub fit: Fit,
    /// Sum over all sets of this kind.
    pub probability: f64,
    /// Log density of the runs held out that help to choose, under that set.
    pub told: f64,
    /// What the runs fitted say by themselves.
    pub fitted: Fitted,
}

/// An explanation by the runs fitted alone.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Fitted {
    /// Sum over all sets of this kind.
    pub probability: f64,
    /// Log evidence of the best of them.
    pub log_evidence: f64,
    /// Its half chi-square with the priors' share.
    pub cost: f64,
    /// Its unknowns.
    pub unknowns: usize,
}

/// Posterior over the sets fitted.
#[derive(Debug)]
pub struct Posterior {
    /// Explanations, most probable first.
    pub groups: Vec<Group>,
    /// Probability of each candidate being part of the explanation.
    pub inclusion: BTreeMap<usize, f64>,
    /// Sets near the best, with their probability and the weight of each member.
    pub members: Vec<(Fit, f64, Vec<f64>)>,
    /// The runs held out that were asked.
    pub choosing: Choosing,
    /// What effects that no set holds, and drifts at the start, may do to the best one.
    beyond: Option<(Vec<usize>, Beyond)>,
}

/// A parameter over all sets that hold its effect (Hoeting et al. 1999): the spread between sets counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Averaged {
    /// Mean.
    pub value: f64,
    /// sd within and between sets; `None` = not determined in one of them.
    pub sd: Option<f64>,
}

/// Sets that the runs fitted do not rule out, best first.
pub fn near<'a>(search: &'a Search<'_>) -> Vec<&'a Fit> {
    let ranked = search.ranked();
    let top = ranked.first().map_or(0.0, |f| f.log_evidence);
    ranked
        .into_iter()
        .filter(|f| f.log_evidence > top - FAR)
        .take(MOST)
        .collect()
}

/// A set near the best.
struct Weighed<'a> {
    /// Over those of the likeliest, by all runs.
    odds: f64,
    fit: &'a Fit,
    told: f64,
    matters: Vec<usize>,
    weights: Vec<f64>,
}

/// Posterior over the sets of a search, given the runs fitted and those held out that help to choose.
pub fn posterior(search: &Search<'_>, choosing: Choosing) -> Posterior {
    let mut told: Vec<(&Fit, f64)> = near(search)
        .into_par_iter()
        .map(|fit| (fit, choosing.of(search.setting, &search.weights, fit)))
        .collect();
    if !told.iter().any(|t| t.1.is_finite()) {
        // None of them foretells anything: nothing was asked.
        told.iter_mut().for_each(|t| t.1 = 0.0);
    }
    let all = |(fit, told): &(&Fit, f64)| fit.log_evidence + told;
    let top = told.iter().map(all).fold(f64::NEG_INFINITY, f64::max);
    let weighed: Vec<Weighed<'_>> = told
        .into_par_iter()
        .map(|both| {
            let (fit, told) = both;
            let weights = weights(search.setting, fit);
            let matters = fit
                .set
                .iter()
                .zip(&weights)
                .filter(|(_, w)| **w > search.setting.tolerance)
                .map(|(c, _)| *c)
                .collect();
            Weighed {
                odds: (all(&both) - top).exp(),
                fit,
                told,
                matters,
                weights,
            }
        })
        .collect();
    let sum: f64 = weighed.iter().map(|w| w.odds).sum();
    let evidence = weighed.iter().map(|w| w.fit.log_evidence);
    let fitted_top = evidence.fold(f64::NEG_INFINITY, f64::max);
    let fitted = |fit: &Fit| (fit.log_evidence - fitted_top).exp();
    let fitted_sum: f64 = weighed.iter().map(|w| fitted(w.fit)).sum();
    let mut groups: BTreeMap<Vec<usize>, Group> = BTreeMap::new();
    let mut inclusion: BTreeMap<usize, f64> = BTreeMap::new();
    let mut members = Vec::new();
    let mut best: Option<(f64, &Fit)> = None;
    for Weighed {
        odds,
        fit,
        told,
        matters,
        weights,
    } in weighed
    {
        let p = odds / sum;
        if best.is_none_or(|b| p > b.0) {
            best = Some((p, fit));
        }
        members.push((fit.clone(), p, weights));
        for c in &fit.set {
            *inclusion.entry(*c).or_default() += p;
        }
        let group = groups.entry(matters.clone()).or_insert_with(|| Group {
            matters,
            fit: fit.clone(),
            probability: 0.0,
            told,
            fitted: Fitted {
                log_evidence: f64::NEG_INFINITY,
                ..Fitted::default()
            },
        });
        if fit.log_evidence + told > group.fit.log_evidence + group.told {
            (group.fit, group.told) = (fit.clone(), told);
        }
        group.probability += p;
        group.fitted.probability += fitted(fit) / fitted_sum;
        if fit.log_evidence > group.fitted.log_evidence {
            group.fitted = Fitted {
                log_evidence: fit.log_evidence,
                cost: fit.cost,
                unknowns: fit.hessian.nrows(),
                ..group.fitted
            };
        }
    }
    let mut groups: Vec<Group> = groups.into_values().collect();
    groups.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    let beyond = best.map(|(_, best)| {
        let mut variance = rest::spread(search.setting, &search.weights, best);
        if let Some(effects) = Beyond::of(search, best) {
            for (all, more) in variance.iter_mut().zip(effects.variance) {
                *all += more;
            }
        }
        (best.set.clone(), Beyond { variance })
    });
    Posterior {
        groups,
        inclusion,
        members,
        choosing,
        beyond,
    }
}

/// Members that matter.
fn heavy<'a>(
    setting: &'a Setting,
    fit: &'a Fit,
    weights: &'a [f64],
) -> impl Iterator<Item = usize> + 'a {
    fit.set
        .iter()
        .zip(weights)
        .filter(|(_, w)| **w > setting.tolerance)
        .map(|(c, _)| *c)
}

impl Posterior {
    /// A candidate's parameter (by index) and its weight, averaged over the sets that hold it and
    /// in which it matters as much as in `like`.
    pub fn averaged(
        &self,
        setting: &Setting,
        candidate: usize,
        parameter: usize,
        like: &[usize],
    ) -> Option<(Averaged, f64)> {
        let (mut total, mut mean, mut square, mut weight, mut known) = (0.0, 0.0, 0.0, 0.0, true);
        for (fit, p, weights) in &self.members {
            let Some(member) = fit.set.iter().position(|c| *c == candidate) else {
                continue;
            };
            if !heavy(setting, fit, weights).eq(like.iter().copied()) {
                continue;
            }
            let k = setting.places(&fit.set)[member] + parameter;
            let variance = fit.covariance()[(k, k)];
            known &= variance.is_finite() || *p < 1e-3;
            total += p;
            mean += p * fit.at[k];
            square += p * (fit.at[k].powi(2) + if variance.is_finite() { variance } else { 0.0 });
            weight += p * weights[member];
        }
        if total <= 0.0 {
            return None;
        }
        let value = mean / total;
        let variance = (square / total - value * value).max(0.0);
        let wider = self.beyond(|set| {
            let member = set.iter().position(|c| *c == candidate)?;
            Some(setting.places(set)[member] + parameter)
        });
        Some((
            Averaged {
                value,
                sd: known
                    .then(|| (variance + wider).sqrt())
                    .filter(|v| v.is_finite()),
            },
            weight / total,
        ))
    }

    /// Mean square change of an unknown by what no set holds; `place` = where it stands in the best set.
    fn beyond(&self, place: impl Fn(&[usize]) -> Option<usize>) -> f64 {
        self.beyond
            .as_ref()
            .and_then(|(set, beyond)| {
                let k = place(set)?;
                Some(beyond.variance[k])
            })
            .unwrap_or(0.0)
    }

    /// A coefficient of the vehicle (by index), averaged over the sets in which the same matters as
    /// in `like`: which small effects are there is a part of what is not known about it.
    pub fn averaged_coefficient(
        &self,
        setting: &Setting,
        index: usize,
        like: &[usize],
    ) -> Option<Averaged> {
        let (mut total, mut mean, mut square) = (0.0, 0.0, 0.0);
        for (fit, p, weights) in &self.members {
            if !heavy(setting, fit, weights).eq(like.iter().copied()) {
                continue;
            }
            let variance = fit.covariance()[(index, index)];
            if !variance.is_finite() {
                return None;
            }
            total += p;
            mean += p * fit.at[index];
            square += p * (fit.at[index].powi(2) + variance);
        }
        (total > 0.0).then(|| {
            let value = mean / total;
            let wider = self.beyond(|_| Some(index));
            let variance = (square / total - value * value).max(0.0);
            Averaged {
                value,
                sd: Some((variance + wider).sqrt()).filter(|v| v.is_finite()),
            }
        })
    }

    /// The explanations that the runs fitted do not tell from the first, at most six, the first included: what the runs held
    /// out add says which comes first. Two that hold the same effects, one of them just below what matters in the one,
    /// are the same.
    pub fn tied(&self) -> Vec<&Group> {
        let Some(first) = self.groups.first() else {
            return Vec::new();
        };
        if first.matters.is_empty() && first.fitted.probability > SURELY_NOTHING {
            return vec![first];
        }
        let mut kept: Vec<&Group> = Vec::new();
        for g in &self.groups {
            let same = |k: &&Group| {
                k.matters.iter().all(|c| g.fit.set.contains(c))
                    && g.matters.iter().all(|c| k.fit.set.contains(c))
            };
            let (own, best) = (&g.fitted, &first.fitted);
            let likely = own.probability > best.probability * (-TIE).exp();
            let alike = own.unknowns == best.unknowns && own.cost < best.cost + ALIKE;
            // Likelier by the runs fitted, and refuted by the others.
            let refuted = own.probability > best.probability * TIE.exp();
            if (likely || alike) && !refuted && !kept.iter().any(same) {
                kept.push(g);
            }
        }
        kept.truncate(REPORTED);
        kept
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{candidate, setting, surge};

    /// A friction of nothing was said to be tied with nothing: it is never ruled out by much.
    #[test]
    fn what_is_surely_nothing_is_tied_with_nothing_else() {
        let own = setting(&[surge(0, &[]), surge(1, &[])]);
        let friction = candidate(&own, "coulomb_friction");
        let force = candidate(&own, "constant_force");
        let mut search = Search::still(&own, &|_| {});
        search.nothing();
        search.singles();
        let tied = |first: &[usize], second: &[usize], probability: f64| {
            let of = |set: &[usize], probability: f64| {
                let fit = search.get(set).unwrap().clone();
                let fitted = Fitted {
                    probability,
                    log_evidence: probability.ln(),
                    cost: fit.cost,
                    unknowns: 3 + set.len(),
                };
                Group {
                    matters: set.to_vec(),
                    fit,
                    probability,
                    told: 0.0,
                    fitted,
                }
            };
            let posterior = Posterior {
                groups: vec![of(first, probability), of(second, 1.0 - probability)],
                inclusion: BTreeMap::new(),
                members: Vec::new(),
                choosing: Choosing::default(),
                beyond: None,
            };
            posterior.tied().len()
        };
        // Within TIE both of them.
        assert_eq!(tied(&[], &[friction], 0.92), 1);
        assert_eq!(tied(&[], &[friction], 0.88), 2);
        assert_eq!(tied(&[force], &[friction], 0.92), 2);
        // exp(-TIE) = .018, and by one number more it does not fit alike.
        assert_eq!(tied(&[], &[friction], 0.99), 1);
    }
}
