//! Result of an identification; serialised as `identify --json`.

use hydroline_numerics::noise::Noise;
use hydroline_numerics::statistics::Whiteness;
use serde::Serialize;
use std::collections::BTreeMap;

use super::expanded::half_width;
use super::model_test::ModelTest;
use super::seen::Seen;

/// One coefficient.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Estimate {
    /// As the paper writes it.
    pub symbol: String,
    /// SI unit.
    pub unit: String,
    /// Estimated value, in that unit.
    pub value: f64,
    /// Standard deviation by the samples (Type A); `None` = the runs say nothing about it.
    pub sd: Option<f64>,
    /// The same by the scatter between repeats of a plan, where it has three or more: beside `sd`, in no sum.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub repeat_sd: Option<f64>,
    /// Combined standard uncertainty: with what the fit takes as known and is not (Type B, `budget`).
    pub combined_sd: Option<f64>,
    /// Expanded uncertainty, twice the combined one: the value lies within it in some 95 % of cases.
    pub u95: Option<f64>,
    /// Source of the largest share of it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub largest_share: Option<String>,
    /// 95 % interval by the samples alone: by profile likelihood where there is one, else value -+ t sd.
    pub low: Option<f64>,
    /// Its upper end.
    pub high: Option<f64>,
    /// Profile likelihood, where the direction is weak.
    pub profile: Option<Profile>,
    /// Value in the rig file.
    pub rig: f64,
    /// Determined by these runs: sd below half of its size, or of what the rig takes for its size.
    pub excited: bool,
    /// Ended on the search range.
    pub at_bound: bool,
}

/// Ends of a 95 % interval by profile likelihood: all other numbers fitted anew at each trial value.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Profile {
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
    /// The lower end is the search range, not the data.
    pub low_open: bool,
    /// The upper end is the search range, not the data.
    pub high_open: bool,
}

/// Noise of one channel.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct SlotNoise {
    /// Level and colour.
    #[serde(flatten)]
    pub noise: Noise,
    /// Share of samples left out.
    pub outliers: f64,
    /// `measured at rest` or `residuals`: which of the two is the louder.
    pub source: String,
    /// Noise in motion over noise at rest; absent = no stretch at rest measured this channel.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub over_rest: Option<f64>,
    /// sd of the samples as the logs say it, by which they were weighed; absent = the logs say none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub logged: Option<Logged>,
}

/// sd of a channel's samples as the logs say it, in its unit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Logged {
    /// Of a sample that says as much as the mean one; the noise beside it is that of such a sample.
    pub reference_sd: f64,
    /// Of the best sample.
    pub least_sd: f64,
    /// Of the worst one.
    pub greatest_sd: f64,
    /// Noise found over noise logged: 1 = the logs say it right.
    pub scale: f64,
}

/// Whiteness of one run's residuals in one channel.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Residuals {
    /// Name of the run.
    pub run: String,
    /// Channel; x and y along the body's axes.
    pub slot: String,
    /// rms of measured - fitted, in the channel's unit.
    pub rms: f64,
    /// Residuals as they are.
    pub plain: Option<Whiteness>,
    /// After the noise's colour was taken out.
    pub filtered: Option<Whiteness>,
}

/// A run predicted by the others.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct CrossValidation {
    /// Run left out.
    pub run: String,
    /// Coefficients that the other runs leave open: known there as the rig says them.
    pub held: Vec<String>,
    /// rms per channel when it is left out of the fit (only its start is fitted).
    pub left_out: BTreeMap<String, f64>,
    /// rms per channel when it takes part.
    pub fitted: BTreeMap<String, f64>,
}

/// Effect or parameter that these runs cannot show.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct NotIdentifiable {
    /// Effect id or parameter name.
    pub what: String,
    /// Reason why they cannot show it.
    pub why: String,
    /// Experiment that would show it.
    pub experiment: String,
}

/// One run of the fit.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct RunSummary {
    /// Name of the run.
    pub name: String,
    /// Number of samples.
    pub samples: usize,
    /// Last stamp \[s\].
    pub length_s: f64,
    /// rms of measured - fitted per channel, SI.
    pub rms: BTreeMap<String, f64>,
    /// Motion that it showed, by DOF: the range in which its coefficients were seen.
    pub seen: BTreeMap<String, Seen>,
    /// Oddities of the run's data, one sentence each.
    pub notes: Vec<String>,
    /// Start values found, with sd.
    pub start: BTreeMap<String, (f64, Option<f64>)>,
}

/// Source of uncertainty, and what it does to each coefficient.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct BudgetLine {
    /// Source: the samples, a number that is held, an effect that these runs cannot show.
    pub source: String,
    /// `A` (by the samples) or `B` (JCGM 100:2008).
    pub kind: String,
    /// Standard deviation of the source, in its unit; absent of the samples, and of an effect, which is as large as is typical.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sd: Option<f64>,
    /// Probability that an effect acts, by its prior and by what the runs say of it; absent = the source acts for certain. Its
    /// contributions are those of something that acts with this probability.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub probability: Option<f64>,
    /// Unit of the source; 1 = a share.
    pub unit: String,
    /// Reason for that sd: `the rig`, `assumed`, `not identifiable` or where else it is from.
    pub basis: String,
    /// Change of each coefficient by one unit of the source, by key \[the coefficient's unit over the source's\]; none where the source is
    /// several numbers, or has no unit.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub sensitivities: BTreeMap<String, f64>,
    /// Standard uncertainty of each coefficient by this source, by key \[the coefficient's unit\].
    pub contributions: BTreeMap<String, f64>,
    /// Measurement that would reduce it.
    pub reduce: String,
}

/// Coverage factor of the expanded uncertainty (GUM, 6.2): about 95 %.
pub const COVERAGE: f64 = 2.0;

/// Series for plots; not in the JSON.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Trace {
    /// Name of the run.
    pub run: String,
    /// Name of the channel.
    pub channel: String,
    /// Stamps \[s\].
    pub times_s: Vec<f64>,
    /// Measured values \[SI\]; NaN = not measured.
    pub measured: Vec<f64>,
    /// Fitted values \[SI\].
    pub fitted: Vec<f64>,
    /// (time, load) of the commands in the channel's DOF \[s; N, N m\].
    pub edges: Vec<(f64, f64)>,
    /// Noise of a sample \[SI\]; `None` = not known.
    pub noise_sd: Option<f64>,
}

impl Trace {
    /// Measured minus fitted; NaN where nothing was measured.
    pub fn residual(&self) -> Vec<f64> {
        let pairs = self.measured.iter().zip(&self.fitted);
        pairs.map(|(m, f)| m - f).collect()
    }

    /// First and last stamp \[s\].
    pub fn span_s(&self) -> Option<[f64; 2]> {
        Some([*self.times_s.first()?, *self.times_s.last()?])
    }
}

/// Everything a fit found.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Identification {
    /// Equations: `surge` .. `yaw` (one DOF), `eq1` or `decoupled`.
    pub model: String,
    /// Whether the priors of coefficients and starts say nothing (`--flat-priors`: maximum likelihood).
    pub flat_priors: bool,
    /// Log evidence of the model, its numbers integrated out, up to the samples that count \[nat\].
    pub ln_evidence: f64,
    /// Number of fits: from several starts, beside each noise, and along the profiles.
    pub fits: usize,
    /// Coefficients by key.
    pub parameters: BTreeMap<String, Estimate>,
    /// Order of rows and columns below.
    pub order: Vec<String>,
    /// Covariance of the coefficients by the samples (Type A); `null` rows = not determined.
    pub covariance: Vec<Vec<Option<f64>>>,
    /// The same of all of the budget: what a rig is written with, and a prediction's band is made of. Empty = no budget was made.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub covariance_combined: Vec<Vec<Option<f64>>>,
    /// Budget of the uncertainty, source by source, the samples first.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub budget: Vec<BudgetLine>,
    /// Correlation matrix of the coefficients.
    pub correlation: Vec<Vec<f64>>,
    /// Noise by channel.
    pub noise: BTreeMap<String, SlotNoise>,
    /// Residual variance over that of the noise at rest, where it was measured, else over the noise found (1 = the noise explains the residuals).
    pub variance_ratio: f64,
    /// Whiteness by run and channel.
    pub residuals: Vec<Residuals>,
    /// Test of whether the model explains the runs, the same as in `diagnose`.
    pub test: ModelTest,
    /// Its sentence where the model does not; empty = it does.
    pub misfit: Vec<String>,
    /// Leave-one-run-out.
    pub cross_validation: Vec<CrossValidation>,
    /// Effects and parameters that these runs cannot show.
    pub blind_spots: Vec<NotIdentifiable>,
    /// Effects in the rig's `[[physics]]`: held as they are, not fitted.
    pub held_effects: Vec<String>,
    /// Runs that were fitted.
    pub runs: Vec<RunSummary>,
    /// Remarks on the fit, one sentence each.
    pub notes: Vec<String>,
    /// For plots.
    #[serde(skip)]
    pub traces: Vec<Trace>,
}

impl Identification {
    /// Sentence on the rig's `[[physics]]`, which is held; `None` where it has none.
    pub fn held(&self) -> Option<String> {
        let held = &self.held_effects;
        (!held.is_empty()).then(|| {
            format!(
                "[[physics]] of the rig is held, not fitted ({}): what its numbers are off by is in no interval; `hydroline diagnose` fits effects",
                held.join(", ")
            )
        })
    }

    /// Writes the combined and expanded uncertainty of each coefficient, and its largest share: of the combined covariance and the budget.
    pub fn combine(&mut self) {
        for (i, key) in self.order.iter().enumerate() {
            let Some(p) = self.parameters.get_mut(key) else {
                continue;
            };
            let row = self.covariance_combined.get(i);
            let variance = row.and_then(|row| row.get(i).copied().flatten());
            p.combined_sd = variance.map(f64::sqrt);
            let effects = self.budget.iter().filter_map(|l| {
                let (chance, share) = (l.probability?, l.contributions.get(key)?);
                (chance > 0.0).then(|| (chance, share / chance.sqrt()))
            });
            let effects: Vec<(f64, f64)> = effects.collect();
            let of_effects: f64 = effects.iter().map(|(p, sd)| p * sd * sd).sum();
            p.u95 = variance.map(|v| half_width((v - of_effects).max(0.0), &effects));
            let of = |l: &BudgetLine| l.contributions.get(key).copied().unwrap_or(0.0);
            let largest = self
                .budget
                .iter()
                .max_by(|a, b| of(a).total_cmp(&of(b)))
                .filter(|l| of(l) > 0.0);
            p.largest_share = largest.map(|l| l.source.clone());
        }
    }

    /// Value of a coefficient by key.
    pub fn value(&self, key: &str) -> Option<f64> {
        self.parameters.get(key).map(|p| p.value)
    }
}
