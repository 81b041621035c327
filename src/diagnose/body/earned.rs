//! Conditions that a verdict has to meet: what is left passes as the instruments' noise or is below the tolerance, no
//! coefficient ends on a limit, and each run is predicted by the others no worse than by the vehicle alone.

use std::collections::BTreeMap;

use hydroline_core::run::{Channel, PerChannel};
use hydroline_identify::parameter::Term;
use hydroline_inference::body::Own;
use hydroline_inference::prediction::Prediction;
use hydroline_numerics::statistics::{chi2_above, ljung_box};

use super::found::Judged;
use crate::verdict::{AtLimit, Unexplained, Value};

/// Lags of the test for whiteness.
const LAGS: usize = 20;
/// p below which innovations of good noise are called none, shared by all channels (Bonferroni).
const NOT_NOISE: f64 = 1e-3;
/// Ratio to the rig's from which a coefficient is part of what is said.
const FAR_OFF: f64 = 2.0;
/// Share of its limit's distance at which a coefficient counts as being there.
const AT_LIMIT: f64 = 0.99;
/// Residual of a channel.
#[derive(Debug, Clone, PartialEq)]
pub struct Left {
    pub channel: Channel,
    /// rms of the residuals that no change of the model's numbers takes away \[SI\].
    pub rms: f64,
    /// sd of the instrument \[SI\].
    pub noise: f64,
    /// p of the squared innovations, pooled over runs.
    pub level_p: f64,
    /// Ljung-Box p of each run that is long enough to be asked.
    pub white_p: Vec<Option<f64>>,
    /// Level and colour are the noise's.
    pub is_noise: bool,
}

/// The least of several p, by Bonferroni; 1 without any.
pub fn worst(all: &[Option<f64>]) -> f64 {
    let asked = all.iter().flatten().count() as f64;
    let least = all.iter().flatten().copied().fold(1.0, f64::min);
    (least * asked.max(1.0)).min(1.0)
}

impl Left {
    /// rms of the residual beside the noise \[SI\]; 0 where the noise is larger, NaN where there is none.
    pub fn beyond(&self) -> f64 {
        let square = self.rms.powi(2) - self.noise.powi(2);
        if square < 0.0 { 0.0 } else { square.sqrt() }
    }
}

impl Judged<'_> {
    /// Residuals of the likeliest model in every channel of every DOF that moves.
    pub fn look_at_what_is_left(&self) -> Vec<Left> {
        let problem = &self.found.problem;
        let closest = problem.closest(&self.best.terms, &self.best.point);
        let rms = closest.map_or(PerChannel::NAN, |p| problem.left_of(&p));
        let mut all = Vec::new();
        for (d, runs) in problem.innovations(&self.best.terms, &self.best.point) {
            for (c, channel) in Channel::of(d).into_iter().enumerate() {
                let Some(noise) = problem.noises.channels[channel] else {
                    continue;
                };
                let series: Vec<Vec<f64>> = runs
                    .iter()
                    .map(|r| r.iter().map(|v| v[c]).filter(|v| *v != 0.0).collect())
                    .collect();
                let count: usize = series.iter().map(Vec::len).sum();
                let square: f64 = series.iter().flatten().map(|v| v * v).sum();
                let long = |s: &Vec<f64>| s.len() > 2 * LAGS;
                let white = |s: &Vec<f64>| ljung_box(s, LAGS).map(|w| w.p_value);
                let white_p: Vec<Option<f64>> = series
                    .iter()
                    .map(|s| long(s).then(|| white(s)).flatten())
                    .collect();
                all.push(Left {
                    channel,
                    rms: rms[channel],
                    noise: noise.total_sd(),
                    level_p: chi2_above(square, count.max(1) as f64),
                    white_p,
                    is_noise: true,
                });
            }
        }
        let threshold = NOT_NOISE / (2 * all.len()).max(1) as f64;
        for l in &mut all {
            // NaN is no noise either.
            l.is_noise =
                l.level_p >= threshold && worst(&l.white_p) >= threshold && l.rms.is_finite();
        }
        all
    }

    /// Channels in which something is left that is neither noise nor below the tolerance, but those of DOFs named already.
    pub fn not_noise(&self, named: &[Unexplained]) -> Vec<Unexplained> {
        let body = &self.found.problem.body;
        let left = self.left.iter().filter(|l| {
            let beyond = l.beyond();
            let large = beyond.is_nan() || beyond > body.tolerance[l.channel];
            !l.is_noise && large
        });
        left.filter(|l| {
            let of = |u: &Unexplained| {
                let at = Channel::named(&u.channel);
                at.is_some_and(|c| c.dof() == l.channel.dof())
            };
            !named.iter().any(of)
        })
        .map(|l| Unexplained {
            channel: l.channel.name().to_owned(),
            weight: Some(l.beyond()).filter(|w| w.is_finite()),
            term: format!(
                "{:.2e} rms is left in {} ({}), where the instrument's noise is {:.2e}",
                l.rms,
                l.channel.name(),
                l.channel.dof().name(),
                l.noise
            ),
            ..Unexplained::default()
        })
        .collect()
    }

    /// Coefficients at a limit or far from the rig's, with their factor.
    pub fn at_limit(&self) -> Vec<AtLimit> {
        let each = self.far_off().into_iter();
        each.map(|(key, factor)| AtLimit {
            key,
            factor: factor.value,
        })
        .collect()
    }

    /// The same with the factor's sd.
    pub fn far_off(&self) -> BTreeMap<String, Value> {
        let body = &self.found.problem.body;
        let after = self.own_after();
        let bounds = body.bounds(&self.best.terms);
        let mut made = BTreeMap::new();
        for (i, own) in body.own.iter().enumerate() {
            let Some(number) = after.get(own.name()) else {
                continue;
            };
            let factor = number.value / own.unit();
            // Of the logarithm: the share by which it is known.
            let sd = number
                .sd
                .map_or(f64::INFINITY, |sd| (sd / number.value).abs());
            // Of what the rig says nothing there is no factor.
            let known =
                own.is_said() && factor.ln().abs() > FAR_OFF.ln() && sd < 0.5 * factor.ln().abs();
            if known || self.is_at_limit(i, bounds[i]) {
                let value = Value {
                    value: factor,
                    sd: Some(factor * sd).filter(|s| s.is_finite()),
                };
                made.insert(own.name().to_owned(), value);
            }
        }
        made
    }

    /// Whether one of the vehicle's numbers is as far off as is looked. One of which the rig says 0 and that is none is at no
    /// limit.
    fn is_at_limit(&self, place: usize, (low, high): (f64, f64)) -> bool {
        let said = self.found.problem.body.own[place].is_said();
        let at = self.best.point[place];
        (at <= AT_LIMIT * low && said) || at >= AT_LIMIT * high
    }

    /// Whether a coefficient ended on a limit that speaks against the model. Damping as good as none does not: a hull may have
    /// none of that power, and where negative damping was wanted what is left is no noise.
    pub fn on_a_limit(&self) -> bool {
        let body = &self.found.problem.body;
        let bounds = body.bounds(&self.best.terms);
        let none = |i: usize| self.is_no_damping(i, bounds[i]);
        (0..body.own.len()).any(|i| self.is_at_limit(i, bounds[i]) && !none(i))
    }

    /// Whether a damping coefficient that the rig has is as small as is looked.
    fn is_no_damping(&self, place: usize, (low, _): (f64, f64)) -> bool {
        let own = &self.found.problem.body.own[place];
        let damping = matches!(own, Own::Coefficient(c, _) if c.term != Term::Added);
        damping && self.best.point[place] <= AT_LIMIT * low
    }

    /// Damping coefficients that are as good as zero.
    pub fn no_damping(&self) -> Vec<&str> {
        let body = &self.found.problem.body;
        let bounds = body.bounds(&self.best.terms);
        let each = body.own.iter().enumerate();
        each.filter(|(i, _)| self.is_no_damping(*i, bounds[*i]))
            .map(|(_, own)| own.name())
            .collect()
    }

    /// Whether runs are predicted worse by the others than by the vehicle alone, both by least squares and beside a random
    /// force: with the band that this leaves, a law that one run alone shows is not worse.
    pub fn predicts_worse(&self) -> bool {
        let problem = &self.found.problem;
        let Some(predicted) = &self.one_run_out else {
            return false;
        };
        let is_worse = |than: &Prediction| problem.predicts_worse(&predicted.after, than);
        is_worse(&predicted.before) && self.alone_run_out.as_ref().is_none_or(is_worse)
    }
}
