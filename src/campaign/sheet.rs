//! Sheets: results of the units of work, which are kept, and of which the table and the page are made.

use hydroline_core::run::Run;
use hydroline_diagnose::verdict::{Verdict, Word};
use hydroline_identify::Identification;
use serde::de::IgnoredAny;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt;
use std::time::Duration;

/// A coefficient.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Number {
    /// Estimate, SI.
    pub value: f64,
    /// Standard deviation; absent = these runs do not determine it.
    pub sd: Option<f64>,
    /// 95 % interval.
    pub low: Option<f64>,
    /// Its upper end.
    pub high: Option<f64>,
    /// Value in the rig.
    pub rig: f64,
}

/// Coefficients with their covariance.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Coefficients {
    /// Equations: a DOF, `eq1` or `decoupled`.
    pub model: String,
    /// By key.
    pub numbers: BTreeMap<String, Number>,
    /// Order of the covariance: the coefficients that are determined.
    pub order: Vec<String>,
    /// Covariance, SI.
    pub covariance: Vec<Vec<f64>>,
    /// Residual variance over the noise: 1 = the noise explains the residuals.
    pub variance_ratio: f64,
    /// What the model does not explain of the runs, in words; empty = it explains them.
    pub misfit: Vec<String>,
    /// Noise sd by channel, SI.
    pub noise_sd: BTreeMap<String, f64>,
    /// rms per run and channel of the fit to all runs, SI.
    pub rms: BTreeMap<String, BTreeMap<String, f64>>,
    /// rms per run and channel where the run is predicted by the others, SI.
    pub leave_one_run_out_rms: BTreeMap<String, BTreeMap<String, f64>>,
}

impl Coefficients {
    /// Of an identification; what is not determined has no sd and no row.
    pub fn of(found: &Identification) -> Self {
        let numbers = found.parameters.iter().map(|(key, p)| {
            let number = Number {
                value: p.value,
                sd: p.sd.filter(|_| p.excited),
                low: p.low.filter(|_| p.excited),
                high: p.high.filter(|_| p.excited),
                rig: p.rig,
            };
            (key.clone(), number)
        });
        let numbers: BTreeMap<String, Number> = numbers.collect();
        let kept: Vec<usize> = (0..found.order.len())
            .filter(|k| {
                numbers
                    .get(&found.order[*k])
                    .is_some_and(|n| n.sd.is_some())
                    && found.covariance[*k][*k].is_some()
            })
            .collect();
        let entry = |i: &usize, j: &usize| found.covariance[*i][*j].unwrap_or(0.0);
        Self {
            model: found.model.clone(),
            order: kept.iter().map(|k| found.order[*k].clone()).collect(),
            covariance: kept
                .iter()
                .map(|i| kept.iter().map(|j| entry(i, j)).collect())
                .collect(),
            numbers,
            variance_ratio: found.variance_ratio,
            misfit: found.misfit.clone(),
            noise_sd: found
                .noise
                .iter()
                .map(|(slot, n)| (slot.clone(), n.noise.white_sd.hypot(n.noise.coloured_sd)))
                .collect(),
            rms: found
                .runs
                .iter()
                .map(|r| (r.name.clone(), r.rms.clone()))
                .collect(),
            leave_one_run_out_rms: found
                .cross_validation
                .iter()
                .map(|c| (c.run.clone(), c.left_out.clone()))
                .collect(),
        }
    }
}

/// An effect of a verdict.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Effect {
    /// Id of the effect.
    pub effect: String,
    /// Where it acts; empty = its law has no place.
    pub dof: String,
    /// Posterior probability.
    pub probability: f64,
    /// Practically significant.
    pub matters: bool,
    /// Parameters with sd, SI.
    pub parameters: BTreeMap<String, (f64, Option<f64>)>,
}

/// A diagnosis in short; `diagnose` of the same logs prints the whole verdict.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Diagnosed {
    /// In a word.
    pub verdict: Word,
    /// In a sentence.
    pub sentence: String,
    /// Effects, heaviest first.
    pub effects: Vec<Effect>,
    /// Predicted rms without and with the effects, and the noise, by channel, SI.
    pub predicted: BTreeMap<String, [Option<f64>; 3]>,
    /// Faults of the data, in words.
    pub faults: Vec<String>,
    /// Plan to run next; empty = none.
    pub next_plan: String,
    /// End by the time limit; absent = the search came to its end.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub truncated: Option<Truncated>,
}

/// End of a diagnosis by its time limit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Truncated {
    /// The limit.
    pub limit_s: f64,
    /// Steps of the search that were made whole.
    pub steps: usize,
    /// Last work that was done, in words.
    pub after: String,
    /// Work that was left open, in words.
    pub open: Vec<String>,
}

/// The end of a sheet's diagnosis, of a sheet that may have none.
#[derive(Debug, Deserialize)]
pub(crate) struct End {
    #[serde(default)]
    diagnosed: Option<Result<Truncation, IgnoredAny>>,
}

#[derive(Debug, Deserialize)]
struct Truncation {
    #[serde(default)]
    truncated: Option<Truncated>,
}

impl End {
    /// Whether a longer limit than the one that ended it would go on.
    pub fn falls_short_of(&self, limit: Option<Duration>) -> bool {
        let Some(Ok(Truncation {
            truncated: Some(end),
        })) = &self.diagnosed
        else {
            return false;
        };
        limit.is_none_or(|limit| limit.as_secs_f64() > end.limit_s)
    }
}

impl Diagnosed {
    /// Of a verdict under a time limit.
    pub fn of(v: &Verdict, limit: Option<Duration>) -> Self {
        let effects = v.effects.iter().map(|e| Effect {
            effect: e.effect.clone(),
            dof: e.dof.clone().unwrap_or_default(),
            probability: e.probability,
            matters: e.matters,
            parameters: e
                .parameters
                .iter()
                .map(|(n, p)| (n.clone(), (p.value, p.sd)))
                .collect(),
        });
        let predicted = v.predicted();
        let predicted =
            predicted.map(|p| (p.channel.to_owned(), [Some(p.before), p.after, p.noise]));
        Self {
            verdict: v.verdict,
            sentence: v.sentence.clone(),
            effects: effects.collect(),
            predicted: predicted.collect(),
            faults: v
                .data_faults
                .iter()
                .map(|f| format!("{} in {} of {}: {}", f.fault, f.channel, f.run, f.evidence))
                .collect(),
            next_plan: v
                .next_experiment
                .as_ref()
                .map_or(String::new(), |n| n.plan.clone()),
            truncated: v
                .truncated
                .as_ref()
                .zip(limit)
                .map(|(end, limit)| Truncated {
                    limit_s: limit.as_secs_f64(),
                    steps: end.steps,
                    after: end.after.clone(),
                    open: end.open.clone(),
                }),
        }
    }
}

/// Samples of a run's motion that are kept to be drawn.
const MOTION_POINTS: usize = 200;

/// A run's motion to look at, thinned.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Motion {
    /// By channel: time since the log's first stamp \[s\], value \[SI\].
    pub channels: BTreeMap<String, Vec<[f32; 2]>>,
}

impl Motion {
    /// Of a run; channels that were not measured are not in it.
    pub fn of(run: &Run) -> Self {
        let step = run.samples.len().div_ceil(MOTION_POINTS).max(1);
        let mut channels: BTreeMap<String, Vec<[f32; 2]>> = BTreeMap::new();
        for sample in run.samples.iter().step_by(step) {
            for (channel, value) in sample.values.each() {
                if value.is_finite() {
                    // Seven digits are more than a line on a page shows.
                    let points = channels.entry(channel.name().to_owned()).or_default();
                    points.push([sample.t_s as f32, *value as f32]);
                }
            }
        }
        Self { channels }
    }

    /// A channel as a line; empty = not measured.
    pub fn line(&self, channel: &str) -> Vec<[f64; 2]> {
        let points = self.channels.get(channel).into_iter().flatten();
        points.map(|p| p.map(f64::from)).collect()
    }
}

/// Results of one run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunSheet {
    /// The file is whole and nothing in it is missing.
    pub sound: bool,
    /// Findings worse than a note.
    pub findings: Vec<Finding>,
    /// Frames that are not there.
    pub frames_lost: u64,
    /// Length \[s\].
    pub duration_s: f64,
    /// Samples of motion; 0 = none, and no replay gave any.
    pub samples: u64,
    /// The motion stands in the store, made by a replay of the log's images.
    pub replayed: bool,
    /// Motion measured: least and greatest per channel, SI.
    pub range: BTreeMap<String, [f64; 2]>,
    /// Largest load commanded per DOF \[N, N m\].
    pub largest_load: BTreeMap<String, f64>,
    /// Coefficients of this run alone, or why there are none.
    pub identified: Result<Coefficients, String>,
    /// Diagnosis of this run alone, or why there is none.
    pub diagnosed: Result<Diagnosed, String>,
}

/// Results of a day's runs together, or of a group's runs since its last change.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SetSheet {
    /// Logs that were fitted, by name.
    pub runs: Vec<String>,
    /// Logs that were left, each with its reason.
    pub left: Vec<String>,
    /// Coefficients, or why there are none.
    pub identified: Result<Coefficients, String>,
    /// Diagnosis, or why there is none.
    pub diagnosed: Result<Diagnosed, String>,
    /// Logs that the others predict far worse than each other, with the ratio to the median.
    pub outliers: Vec<(String, f64)>,
}

/// A finding of `doctor`, in words.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Finding {
    /// The log is used beside others all the same.
    Warning(String),
    /// It is not.
    Error(String),
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Warning(words) => f.write_str(words),
            Self::Error(words) => write!(f, "error: {words}"),
        }
    }
}

/// Kind of change between two days.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum What {
    /// No change.
    Nothing,
    /// A mass was added \[kg\].
    Mass,
    /// A factor on all damping.
    Drag,
    /// A factor on all thrusts.
    Thrust,
    /// The share of its thrust that the thruster of this name gives.
    Thruster(String),
    /// None of these.
    Else,
}

impl fmt::Display for What {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Nothing => f.write_str("nothing"),
            Self::Mass => f.write_str("mass"),
            Self::Drag => f.write_str("drag"),
            Self::Thrust => f.write_str("thrust"),
            Self::Thruster(name) => write!(f, "thruster {name}"),
            Self::Else => f.write_str("something else"),
        }
    }
}

/// One candidate for what changed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Cause {
    /// Kind of change.
    pub what: What,
    /// Its number; absent where it has none.
    pub value: Option<f64>,
    /// Standard deviation.
    pub sd: Option<f64>,
    /// Posterior probability among the candidates, nothing changed included.
    pub probability: f64,
}

/// Change from the days before to a day.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Change {
    /// Date of the day (UTC): `2026-11-27`.
    pub date: String,
    /// Days that it is compared with: those since the last change.
    pub since: Vec<String>,
    /// Probability that nothing changed.
    pub same_probability: f64,
    /// Candidates, likeliest first.
    pub causes: Vec<Cause>,
    /// Whitened chi-square per degree of freedom of the day: with nothing changed, and with the likeliest cause.
    pub chi2_per_dof: [f64; 2],
    /// In a sentence.
    pub sentence: String,
}

impl Change {
    /// Whether something changed, more likely than not.
    pub fn is_one(&self) -> bool {
        self.same_probability < 0.5
    }
}

/// A group's changes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ChangeSheet {
    /// Day by day, from the second on; or why it could not be said.
    pub changes: Vec<Result<Change, String>>,
}
