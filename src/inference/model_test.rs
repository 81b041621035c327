//! Residuals of the vehicle alone against its noise: the test that `identify` and `diagnose` share.

use hydroline_core::run::{Channel, PerChannel};
use hydroline_identify::model_test::{Late, LeftOver, ModelTest, driven};
use hydroline_numerics::cholesky::{PROJECTION_JITTER, ScaledCholesky};
use hydroline_numerics::statistics::{chi2_above, ljung_box, median};
use hydroline_rigs::Dof;
use nalgebra::{DMatrix, DVector};

use super::body::Simulated;
use super::fit::{Fit, Problem};
use super::posterior::{UNNAMED, above_tolerance};

/// Lags of the test for whiteness.
const LAGS: usize = 20;
/// Share of a row by which commands are moved for the derivative by their lateness.
const MOVED: f64 = 0.25;
/// A lateness of a row is estimated within this share of it.
const ROW_SLACK: f64 = 0.1;
/// Share of its square that has to go where lateness explains what is left.
const EXPLAINED: f64 = 0.9;

impl Problem {
    /// The test of whether a model explains the runs: of `identify` and `diagnose` alike that of the vehicle alone.
    pub fn model_test(&self, fit: &Fit) -> ModelTest {
        let left = self.left_over(fit);
        let commands = self.body.recording.runs.iter().flat_map(|r| &r.commands);
        let driven = driven(commands.map(|c| c.1));
        let none = self.body.dofs.iter().all(|d| !driven[*d]);
        // What moves only because another DOF is driven, or has traces of its load, is explained along with it.
        let asked = self.body.dofs.iter().filter(|d| none || driven[**d]);
        let explained: Vec<&str> = asked.map(|d| Dof::ALL[*d].name()).collect();
        let late = self.late(fit, &left);
        ModelTest::of(&left, &explained, driven, late)
    }

    /// Residual of every channel that is measured in a DOF that is explained.
    pub fn left_over(&self, fit: &Fit) -> Vec<LeftOver> {
        let closest = self.closest(&fit.terms, &fit.point);
        let rms = closest.map_or(PerChannel::NAN, |p| self.left_of(&p));
        let mut all = Vec::new();
        for (d, runs) in self.innovations(&fit.terms, &fit.point) {
            for (c, channel) in Channel::of(d).into_iter().enumerate() {
                let Some(noise) = self.noises.channels[channel] else {
                    continue;
                };
                let series: Vec<Vec<f64>> = runs
                    .iter()
                    .map(|r| r.iter().map(|v| v[c]).filter(|v| *v != 0.0).collect())
                    .collect();
                let count: usize = series.iter().map(Vec::len).sum();
                if count == 0 {
                    continue;
                }
                let square: f64 = series.iter().flatten().map(|v| v * v).sum();
                let white: Vec<f64> = series
                    .iter()
                    .filter(|s| s.len() > 2 * LAGS)
                    .filter_map(|s| ljung_box(s, LAGS).map(|w| w.p_value))
                    .collect();
                let least = white.iter().copied().fold(1.0, f64::min) * white.len().max(1) as f64;
                let level = chi2_above(square, count as f64);
                all.push(LeftOver {
                    channel,
                    rms: rms[channel],
                    noise: (noise.white_sd * self.usual_ratio(channel)).hypot(noise.coloured_sd),
                    tolerance: self.body.tolerance[channel],
                    // Size and colour, two tests.
                    p_value: (2.0 * level.min(least)).min(1.0),
                    lacks_force: above_tolerance(fit, d) >= UNNAMED,
                });
            }
        }
        all
    }

    /// rms over the samples that count of their white sd over the instrument's.
    fn usual_ratio(&self, channel: Channel) -> f64 {
        let runs = self.body.recording.runs.iter().zip(&self.noises.used);
        let ratios = runs.flat_map(|(r, used)| {
            let each = used.iter().enumerate();
            each.map(move |(k, u)| r.sd_ratio_of(k, channel, u[channel]))
        });
        let counting = ratios.filter(|ratio| *ratio > 0.0);
        let (sum, count) = counting.fold((0.0, 0.0), |(s, n), ratio| (s + ratio * ratio, n + 1.0));
        (sum / f64::max(count, 1.0)).sqrt()
    }

    /// Lateness of the commands by a row of the log or less that would leave what is left; `None` = there is none.
    fn late(&self, fit: &Fit, left: &[LeftOver]) -> Option<Late> {
        let wrong: Vec<&LeftOver> = left.iter().filter(|l| l.matters()).collect();
        if wrong.is_empty() {
            return None;
        }
        let mut gaps: Vec<f64> = (self.body.recording.runs.iter())
            .flat_map(|r| r.times_s.windows(2).map(|w| w[1] - w[0]))
            .collect();
        let row_s = median(&mut gaps).filter(|s| *s > 0.0)?;
        let all = self.simulate(&fit.terms, &fit.point)?;
        let step_s = MOVED * row_s;
        let mut later = self.clone();
        later.delay_commands(step_s);
        let moved = later.predicted(&fit.terms, &fit.point);
        let late_s = self.regressed(&all, &moved, step_s)?;
        if !(0.0..=(1.0 + ROW_SLACK) * row_s).contains(&late_s) {
            return None;
        }
        later.delay_commands(late_s - step_s);
        let closest = later.closest(&fit.terms, &fit.point)?;
        let rest = self.left_of(&closest);
        let explains = |l: &&LeftOver| {
            let beyond = (rest[l.channel].powi(2) - l.noise.powi(2)).max(0.0);
            beyond < (1.0 - EXPLAINED) * l.beyond().powi(2)
        };
        if !wrong.iter().all(explains) {
            return None;
        }
        let most = wrong
            .iter()
            .max_by(|a, b| (a.beyond() / a.tolerance).total_cmp(&(b.beyond() / b.tolerance)))?;
        Some(Late {
            late_s,
            row_s,
            rate: self.largest_rate(&all, most.channel),
            channel: most.channel.name().to_owned(),
        })
    }

    /// Least squares of the residual by lateness and all the model's numbers, channels in units of what matters \[s\].
    fn regressed(
        &self,
        all: &[Simulated],
        moved: &[Vec<PerChannel<f64>>],
        step_s: f64,
    ) -> Option<f64> {
        let numbers = all.iter().flat_map(|s| &s.columns).map(|c| c.0 + 1).max()?;
        let n = numbers + 1;
        let mut square = DMatrix::<f64>::zeros(n, n);
        let mut right = DVector::<f64>::zeros(n);
        for (run, (s, moved)) in all.iter().zip(moved).enumerate() {
            let r = &self.body.recording.runs[run];
            let used = &self.noises.used[run];
            for k in 0..used.len() {
                let measured = r.measured(k);
                for c in Channel::ALL.into_iter().filter(|c| used[k][*c]) {
                    let weight = (self.body.tolerance[c] * r.sd_ratio_of(k, c, true)).powi(-2);
                    let residual = measured[c] - s.values[k][c];
                    let by_lateness = (moved[k][c] - s.values[k][c]) / step_s;
                    let own = s.columns.iter().map(|(i, column)| (*i, column[k][c]));
                    let row: Vec<(usize, f64)> = own.chain([(numbers, by_lateness)]).collect();
                    for (i, a) in &row {
                        right[*i] += weight * a * residual;
                        for (j, b) in &row {
                            square[(*i, *j)] += weight * a * b;
                        }
                    }
                }
            }
        }
        let root = ScaledCholesky::new(&square, PROJECTION_JITTER)?;
        Some(root.solve(&right)[numbers])
    }

    /// Delays every command but the one that a run begins under \[s\].
    fn delay_commands(&mut self, by_s: f64) {
        let runs = self.body.recording.runs.iter_mut();
        for (t_s, _) in runs.flat_map(|r| r.commands.iter_mut().skip(1)) {
            *t_s += by_s;
        }
    }

    /// Largest rate of change of a channel along the model's motion.
    fn largest_rate(&self, all: &[Simulated], channel: Channel) -> f64 {
        let runs = all.iter().zip(&self.body.recording.runs);
        let rates = runs.flat_map(|(s, r)| {
            let pairs = s.values.windows(2).zip(r.times_s.windows(2));
            pairs.map(|(v, t)| ((v[1][channel] - v[0][channel]) / (t[1] - t[0]).max(1e-9)).abs())
        });
        rates.fold(0.0, f64::max)
    }
}
