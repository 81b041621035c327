//! The noise during a search: estimated anew beside better models, and asked whether its slow part is misfit.

use hydroline_core::run::PerChannel;

use super::Search;
use crate::fit::{Effort, Fit};
use crate::hyper::Noises;
use crate::noise::estimate;

impl Search<'_> {
    /// Sets the floor of the noise: a share of what is tolerated.
    pub(super) fn set_floor(&mut self) {
        let tolerance = &self.problem.body.tolerance;
        let share = self.options.floor_over_tolerance;
        self.problem.noises.floor_sd = PerChannel::from_fn(|c| share * tolerance[c]);
    }

    /// Noise beside the best model; whether it changed by so much that scores have to be taken again.
    ///
    /// Residuals of a model on the way hold what it misses: with `only_less` no channel's noise becomes larger by it.
    pub(super) fn renew_noise(&mut self, only_less: bool) -> bool {
        let Some(best) = self.best().cloned() else {
            return false;
        };
        let Some(predicted) = self.problem.closest(&best.terms, &best.point) else {
            return false;
        };
        let mut noises = estimate(&self.problem.body, &predicted, Some(&self.problem.noises));
        if only_less {
            noises.no_larger_than(&self.problem.noises);
        }
        let pairs = noises.channels.iter().zip(&self.problem.noises.channels);
        let change = pairs
            .filter_map(|(a, b)| Some((a.as_ref()?.total_sd() / b.as_ref()?.total_sd()).ln().abs()))
            .fold(0.0, f64::max);
        let rejected = noises.used != self.problem.noises.used;
        if change < self.options.noise_change && !rejected {
            return false;
        }
        tracing::debug!(
            "noise {:?}",
            noises.channels.iter().flatten().collect::<Vec<_>>()
        );
        // On the samples that count now the new noise must not make the model less likely by more than that: noise that is
        // estimated of a residual by itself sometimes does.
        let before = self.problem.noises.clone();
        let kept = Noises {
            channels: before.channels,
            used: noises.used.clone(),
            floor_sd: before.floor_sd,
            has_force: before.has_force,
            at_rest: before.at_rest,
        };
        let [old, new] = [kept, noises].map(|noises| {
            self.problem.noises = noises;
            self.problem
                .fit(
                    &best.terms,
                    &best.point,
                    best.cells.clone(),
                    Effort::default(),
                )
                .map(|f| (f.ln_score, self.problem.noises.clone()))
        });
        let Some((score, noises)) = new else {
            self.problem.noises = before;
            return false;
        };
        let worse = old.filter(|(before, _)| *before > score + self.options.noise_gain);
        let is_worse = worse.is_some();
        self.problem.noises = worse.map_or(noises, |w| w.1);
        !is_worse || rejected
    }

    /// Scores of the models at the front under the present noise; the others are dropped.
    pub(super) fn rescore(&mut self) {
        let Some(floor) = self.best().map(|b| b.ln_score - 3.0 * self.options.window) else {
            return;
        };
        let mut kept: Vec<Fit> = std::mem::take(&mut self.models).into_values().collect();
        kept.sort_by(|a, b| b.ln_score.total_cmp(&a.ln_score));
        let jobs = kept
            .into_iter()
            .enumerate()
            .filter(|(k, f)| {
                *k < self.options.rescored && f.ln_score >= floor || f.terms.is_empty()
            })
            .map(|(_, f)| f)
            .map(|f| (f.terms, f.point, f.cells))
            .collect();
        self.expanded.clear();
        self.fit(jobs, Effort::default());
    }

    /// Asks whether the slow part of coloured noise is what a law misses: residuals alone show only how fast such noise
    /// changes, \sigma^2 / \tau of its Ornstein-Uhlenbeck process. Under a shorter \tau at the same \sigma^2 / \tau a
    /// table has to gain more than the noise explained; `cost` is what the search may go on for then.
    pub(super) fn with_shorter_noise(&mut self, cost: usize) {
        let Some(best) = self.best().cloned() else {
            return;
        };
        let before = self.problem.noises.clone();
        let only_laws = self.followed_by_laws();
        let mut most: Option<(f64, Noises)> = None;
        for factor in self.options.shorter {
            let mut noises = before.clone();
            for noise in noises.channels.iter_mut().flatten() {
                noise.correlation_s /= factor;
                noise.coloured_sd /= factor.sqrt();
            }
            self.problem.noises = noises;
            self.cost += self.problem.body.passes_of(&best.terms);
            self.fits += 1;
            let made = self.problem.fit(
                &best.terms,
                &best.point,
                best.cells.clone(),
                Effort::default(),
            );
            let Some(fit) = made else { continue };
            let tables = self.problem.tables(&fit, &only_laws);
            let gain = tables.first().map_or(0.0, |t| t.gain.max(0.0));
            tracing::debug!(
                "noise {factor} times shorter: {:.1}, with a table {:.1}",
                fit.ln_score,
                fit.ln_score + gain
            );
            if gain > self.options.least_gain
                && most.as_ref().is_none_or(|m| fit.ln_score + gain > m.0)
            {
                most = Some((fit.ln_score + gain, self.problem.noises.clone()));
            }
        }
        self.problem.noises = before.clone();
        let Some((_, noises)) = most.filter(|m| m.0 > best.ln_score + self.options.shorter_gain)
        else {
            return;
        };
        let (models, expanded) = (self.models.clone(), self.expanded.clone());
        self.problem.noises = noises;
        self.rescore();
        self.options.cost = self.cost + cost;
        self.run();
        let stands = |b: &Fit| b.ln_score > best.ln_score + self.options.shorter_gain;
        if !self.best().is_some_and(stands) {
            self.problem.noises = before;
            self.models = models;
            self.expanded = expanded;
        }
    }
}
