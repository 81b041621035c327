//! A measured run beside its prediction: the log's time laid on the plan's, residuals and their rms.

use super::Prediction;
use crate::model_test::{LeftOver, ModelTest, driven};
use hydroline_core::run::{Channel, Command, PerChannel, Run, Sample};
use hydroline_numerics::statistics::{chi2_above, median};
use hydroline_rigs::{Dof, Rig};
use serde::Serialize;

/// Loads that differ by more than this share of the plan's largest are other loads: set-points are rounded to
/// whole pulses, which moves a load by less.
const OTHER_LOAD: f64 = 0.05;
/// Share of samples with other loads above which the log is of another plan: steps are sent some samples late.
const OTHER_PLAN: f64 = 0.1;

/// Failure to lay a run on a prediction.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error(
    "{log}: no motion during the prediction (0 .. {length_s:.2} s, which begins at {start_s:.2} s of the log); its motion is of {first_s:.2} .. {last_s:.2} s: give a log of this plan, or the plan of this log (--plan)"
)]
pub struct NotBeside {
    log: String,
    start_s: f64,
    length_s: f64,
    first_s: f64,
    last_s: f64,
}

/// A measured run in the prediction's time.
#[derive(Debug, Clone, Default, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Measured {
    /// The run.
    pub log: String,
    /// The log's time at the prediction's start \[s\].
    pub start_s: f64,
    /// Residuals of each channel that is measured.
    pub channels: Vec<Beside>,
    /// Since the prediction's start \[s\].
    #[serde(skip)]
    pub t_s: Vec<f64>,
    /// Measured motion; NaN = not measured \[SI\].
    #[serde(skip)]
    pub motion: Vec<PerChannel<f64>>,
    /// Measured minus predicted \[SI\].
    #[serde(skip)]
    pub residual: Vec<PerChannel<f64>>,
    /// sd of the residual: of the prediction, and of the sample as the log says it; NaN = neither is known \[SI\].
    #[serde(skip)]
    pub sd: Vec<PerChannel<f64>>,
    /// Test of whether the prediction explains the run, the same as in `identify` and `diagnose`, of the channels in which noise or
    /// band are known.
    pub test: ModelTest,
    /// Remarks on the comparison (loads that are not the plan's), one sentence each.
    pub notes: Vec<String>,
}

/// Residuals of one channel against the prediction \[SI\].
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Beside {
    /// Name, unit in it.
    pub channel: &'static str,
    /// Number of samples in which it is measured.
    pub samples: usize,
    /// rms of measured minus predicted.
    pub rms: f64,
    /// Largest |measured - predicted|.
    pub largest: f64,
    /// When it is the largest \[s\].
    pub largest_at_s: f64,
    /// Share of samples within two sd of prediction and measurement together; `None` = neither is known.
    pub within_two_sd: Option<f64>,
}

/// Where in the log the plan begins: first loads coincide; a log or a plan without a load begins with its log.
pub fn plan_start_s(run: &Run, plan_first_load_s: Option<f64>) -> f64 {
    let loaded = |c: &&Command| c.wrench.iter().any(|v| *v != 0.0);
    let first = run.commands.iter().find(loaded).map(|c| c.t_s);
    match (first, plan_first_load_s) {
        (Some(of_log), Some(of_plan)) => of_log - of_plan,
        _ => 0.0,
    }
}

/// Samples before the first load from which the start is known well enough: the median of five has half the sd of one.
const START_SAMPLES: usize = 5;
/// Else the start is found over so long from the first load on \[s\]: noise averages out, and a wrong coefficient has
/// moved the vehicle by little yet.
const START_S: f64 = 0.5;

/// The pose at the plan's start as far as it is measured: median of what was measured before the first load, else the
/// first sample of the plan.
pub fn start_pose(run: &Run, first_load_s: f64) -> [Option<f64>; 6] {
    Channel::POSES.map(|c| {
        let values = |until_s: f64| {
            let samples = run.samples.iter().take_while(move |s| s.t_s <= until_s);
            samples.map(|s| s.values[c]).filter(|v| v.is_finite())
        };
        let mut before: Vec<f64> = values(first_load_s).collect();
        median(&mut before).or_else(|| values(f64::INFINITY).next())
    })
}

impl Measured {
    /// How far the start that was taken from one or a few samples is off: median residual shortly after the first
    /// load. Nothing where the start was measured before it.
    pub fn start_off(&self, first_load_s: f64) -> [f64; 6] {
        Channel::POSES.map(|c| {
            let until = |until_s: f64| {
                let rows = self.t_s.iter().zip(&self.residual);
                let rows = rows.take_while(move |(t, _)| **t <= until_s);
                rows.map(move |(_, row)| row[c]).filter(|v| v.is_finite())
            };
            if until(first_load_s).count() >= START_SAMPLES {
                return 0.0;
            }
            let mut early: Vec<f64> = until(first_load_s + START_S).collect();
            median(&mut early).unwrap_or(0.0)
        })
    }
}

/// Lays a run on a prediction that begins at `start_s` of the log.
///
/// # Errors
/// [`NotBeside`] where no sample falls within it.
pub fn beside(made: &Prediction, run: &Run, start_s: f64) -> Result<Measured, NotBeside> {
    let length_s = made.t_s.last().copied().unwrap_or(0.0);
    let mut found = Measured {
        log: run.name.clone(),
        start_s,
        ..Measured::default()
    };
    for sample in &run.samples {
        let t_s = sample.t_s - start_s;
        if let Some(at) = place(&made.t_s, t_s) {
            let predicted = between(&made.motion, at);
            let left = PerChannel::from_fn(|c| sample.values[c] - predicted[c]);
            found.t_s.push(t_s);
            found.motion.push(sample.values);
            found.residual.push(left);
            let band = (!made.sd.is_empty()).then(|| between(&made.sd, at));
            let shared = run.shared_errors.as_ref();
            let shared = shared.map_or([0.0; 6], |s| s.variance_at(sample.t_s));
            found.sd.push(sd((sample, shared), band));
        }
    }
    if found.t_s.is_empty() {
        return Err(NotBeside {
            log: run.name.clone(),
            start_s,
            length_s,
            first_s: run.samples.first().map_or(0.0, |s| s.t_s),
            last_s: run.end_s(),
        });
    }
    let channels = Channel::ALL.into_iter();
    found.channels = channels.filter_map(|c| channel(&found, c)).collect();
    Ok(found)
}

/// sd of a residual from the prediction's, the sample's own and what its run shares, which are independent.
fn sd((sample, shared): (&Sample, [f64; 6]), band: Option<PerChannel<f64>>) -> PerChannel<f64> {
    PerChannel::from_fn(|c| {
        let logged = sample.variance(c).map(|own| own + shared[c.index()]);
        let logged = logged.filter(|v| v.is_finite());
        let parts = [band.map(|sd| sd[c] * sd[c]), logged];
        let variance = parts.into_iter().flatten().reduce(|a, b| a + b);
        variance.map_or(f64::NAN, f64::sqrt)
    })
}

fn channel(found: &Measured, c: Channel) -> Option<Beside> {
    let all = found.t_s.iter().zip(&found.residual);
    let left: Vec<(f64, f64)> = all
        .map(|(t, row)| (*t, row[c]))
        .filter(|(_, v)| v.is_finite())
        .collect();
    let (largest_at_s, largest) = left
        .iter()
        .copied()
        .max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))?;
    let samples = left.len();
    let square: f64 = left.iter().map(|(_, v)| v * v).sum();
    let known = found.residual.iter().zip(&found.sd);
    let known: Vec<bool> = known
        .filter(|(r, sd)| r[c].is_finite() && sd[c].is_finite())
        .map(|(r, sd)| r[c].abs() <= 2.0 * sd[c])
        .collect();
    let within = known.iter().filter(|within| **within).count();
    Some(Beside {
        channel: c.name(),
        samples,
        rms: (square / samples as f64).sqrt(),
        largest: largest.abs(),
        largest_at_s,
        within_two_sd: (!known.is_empty()).then(|| within as f64 / known.len() as f64),
    })
}

/// Between which rows a time lies, and how far on.
fn place(times_s: &[f64], t_s: f64) -> Option<(usize, f64)> {
    let after = times_s.partition_point(|t| *t <= t_s);
    let before = after.checked_sub(1)?;
    match times_s.get(after) {
        Some(next) => {
            let from = times_s[before];
            Some((before, (t_s - from) / (next - from)))
        }
        None => (times_s[before] == t_s).then_some((before, 0.0)),
    }
}

fn between(rows: &[PerChannel<f64>], (row, part): (usize, f64)) -> PerChannel<f64> {
    let next = rows.get(row + 1).unwrap_or(&rows[row]);
    PerChannel::from_fn(|c| rows[row][c] + part * (next[c] - rows[row][c]))
}

impl Measured {
    /// Says so where the log's loads are not the prediction's: residuals then are of the loads too.
    pub fn compare_loads(&mut self, made: &Prediction, run: &Run) {
        let planned = |t_s: f64| {
            let after = made.commands.partition_point(|c| c.0 <= t_s);
            after
                .checked_sub(1)
                .map_or([0.0; 6], |i| made.commands[i].1)
        };
        let names = ["X", "Y", "Z", "K", "M", "N"];
        for (dof, name) in names.into_iter().enumerate() {
            let (mut most, mut other, mut worst) = (0.0f64, 0usize, (0.0, 0.0, 0.0));
            for t_s in &self.t_s {
                let (sent, asked) = (run.wrench_at(t_s + self.start_s)[dof], planned(*t_s)[dof]);
                most = most.max(asked.abs()).max(sent.abs());
                if (sent - asked).abs() > OTHER_LOAD * most {
                    other += 1;
                }
                if (sent - asked).abs() > f64::abs(worst.1 - worst.2) {
                    worst = (*t_s, sent, asked);
                }
            }
            if other as f64 > OTHER_PLAN * self.t_s.len() as f64 {
                let (t_s, sent, asked) = worst;
                self.notes.push(format!(
                    "{}: {name} is not the plan's in {:.0} % of the samples (most at {t_s:.2} s: {sent:.3} sent, {asked:.3} planned); the residuals hold that difference too: give the plan of this log",
                    self.log,
                    100.0 * other as f64 / self.t_s.len() as f64
                ));
            }
        }
    }
}

impl Measured {
    /// Tests whether the prediction explains the run to within the rig's tolerance.
    ///
    /// Errors of a prediction hang together over the whole run. As if they all were one, their mean square in units of its sd is
    /// chi-square with one degree of freedom, whose tail is the longest that it can have.
    pub fn compare(&mut self, rig: &Rig, run: &Run) {
        let tolerance = rig.tolerance.channels();
        let mut left = Vec::new();
        for c in Channel::ALL {
            let pairs = self.residual.iter().zip(&self.sd);
            let known: Vec<(f64, f64)> = pairs
                .map(|(r, sd)| (r[c], sd[c]))
                .filter(|(r, sd)| r.is_finite() && *sd > 0.0)
                .collect();
            if known.is_empty() {
                continue;
            }
            let mean = |of: &dyn Fn(&(f64, f64)) -> f64| {
                known.iter().map(of).sum::<f64>() / known.len() as f64
            };
            left.push(LeftOver {
                channel: c,
                rms: mean(&|(r, _)| r * r).sqrt(),
                noise: mean(&|(_, sd)| sd * sd).sqrt(),
                tolerance: tolerance[c],
                p_value: chi2_above(mean(&|(r, sd)| (r / sd).powi(2)), 1.0),
                lacks_force: false,
            });
        }
        if left.is_empty() {
            return;
        }
        let driven = driven(std::iter::once(run.largest_wrench()));
        let explained: Vec<&str> = Dof::ALL
            .iter()
            .filter(|d| driven[d.index()] && left.iter().any(|l| l.channel.dof() == **d))
            .map(|d| d.name())
            .collect();
        self.test = ModelTest::of(&left, &explained, driven, None);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One metre per second from rest in x, sampled every second for ten.
    fn made() -> Prediction {
        let row = |x: f64| PerChannel::from_fn(|c| if c == Channel::X { x } else { 0.0 });
        Prediction {
            channels: PerChannel::from_fn(Channel::name),
            t_s: (0..=10).map(f64::from).collect(),
            motion: (0..=10).map(|k| row(f64::from(k))).collect(),
            sd: vec![row(0.1); 11],
            commands: vec![(1.0, row6(4.0))],
            without_uncertainty: Vec::new(),
        }
    }

    fn row6(x: f64) -> [f64; 6] {
        [x, 0.0, 0.0, 0.0, 0.0, 0.0]
    }

    /// Begins three seconds earlier than the plan and is 0.3 m ahead of it.
    fn run(load: f64) -> Run {
        let sample = |t_s: f64| Sample {
            t_s,
            values: PerChannel::from_fn(|c| {
                if c == Channel::X {
                    t_s - 3.0 + 0.3
                } else {
                    f64::NAN
                }
            }),
            covariance: None,
        };
        Run {
            name: "a".to_owned(),
            commands: vec![Command {
                t_s: 4.0,
                wrench: row6(load),
            }],
            samples: (0..50).map(|k| sample(0.25 * f64::from(k))).collect(),
            ..Run::default()
        }
    }

    #[test]
    fn first_loads_coincide_and_residuals_are_between_the_rows() {
        let (made, run) = (made(), run(4.0));
        let start_s = plan_start_s(&run, Some(1.0));
        assert_eq!(start_s, 3.0);
        let mut found = beside(&made, &run, start_s).unwrap();
        let x = &found.channels[0];
        assert_eq!(found.channels.len(), 1, "only x is measured");
        assert_eq!((x.channel, x.samples), ("x_m", 38));
        assert!((x.rms - 0.3).abs() < 1e-9 && (x.largest - 0.3).abs() < 1e-9);
        assert_eq!(x.within_two_sd, Some(0.0));
        found.compare_loads(&made, &run);
        assert!(found.notes.is_empty(), "{:?}", found.notes);
    }

    #[test]
    fn a_start_from_one_sample_is_found_anew_from_the_first_half_second() {
        let found = beside(&made(), &run(4.0), 3.0).unwrap();
        // A load at once: the three residuals of the first half second. Five samples before a load are enough.
        let off = found.start_off(0.0);
        assert!((off[0] - 0.3).abs() < 1e-9 && off[5] == 0.0, "{off:?}");
        assert_eq!(found.start_off(1.0)[0], 0.0);
    }

    #[test]
    fn the_sd_of_a_residual_is_of_prediction_and_sample() {
        let mut covariance = [0.0; 36];
        covariance[0] = 16.0;
        let sample = Sample {
            t_s: 0.0,
            values: PerChannel::splat(0.0),
            covariance: Some(Box::new(covariance)),
        };
        let none = [0.0; 6];
        let band = Some(PerChannel::splat(3.0));
        assert_eq!(sd((&sample, none), band)[Channel::X], 5.0);
        let shared = [20.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        assert_eq!(sd((&sample, shared), None)[Channel::X], 6.0);
        assert_eq!(sd((&sample, none), None)[Channel::X], 4.0);
        assert_eq!(sd((&sample, none), band)[Channel::U], 3.0);
        assert!(sd((&sample, none), None)[Channel::U].is_nan());
    }

    #[test]
    fn a_log_of_another_plan_is_named() {
        let (made, run) = (made(), run(6.0));
        let mut found = beside(&made, &run, 3.0).unwrap();
        found.compare_loads(&made, &run);
        assert!(
            found.notes[0].contains("6.000 sent, 4.000 planned"),
            "{:?}",
            found.notes
        );
        let words = beside(&made, &run, 60.0).unwrap_err().to_string();
        for word in ["a: no motion", "60.00 s", "0.00 .. 12.25 s", "--plan"] {
            assert!(words.contains(word), "no {word:?} in {words}");
        }
    }

    #[test]
    fn the_start_is_what_was_measured_before_the_first_load() {
        let pose = start_pose(&run(4.0), 2.0);
        assert!((pose[0].unwrap() - -1.7).abs() < 1e-9);
        assert_eq!(pose[5], None);
    }
}
