//! The verdict, as `diagnose --json` prints it (reference/interfaces.md, verdict).

use std::collections::BTreeMap;

use serde::Serialize;

/// Probability from which an effect is established, and goes into a rig.
pub const ESTABLISHED: f64 = 0.95;

/// One word. Ordered: of two verdicts on the same logs the later one stands.
#[derive(
    Debug,
    Clone,
    Copy,
    Default,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Serialize,
    schemars::JsonSchema,
    serde::Deserialize,
)]
#[serde(rename_all = "snake_case")]
pub enum Word {
    /// Nothing established, or nothing that matters.
    #[default]
    None,
    /// The list is the best explanation by far.
    Named,
    /// Sets that this data cannot distinguish.
    Ambiguous,
    /// Something matters and nothing in the library explains it.
    Unknown,
    /// The data are wrong before any physics.
    DataFault,
}

/// Whether an effect acts by the library's law.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Law {
    /// Nothing speaks against it.
    Exact,
    /// The mechanism is right, its law is not quite.
    Inexact,
}

/// A number with its spread.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Value {
    /// Estimate.
    pub value: f64,
    /// Standard deviation; `None` = not determined.
    pub sd: Option<f64>,
}

/// An effect that was left out.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Effect {
    /// Id of the effect.
    pub effect: String,
    /// Its parameters that are words, as `dof`.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub words: BTreeMap<String, String>,
    /// Degree of freedom that it acts in, where its words say so.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dof: Option<String>,
    /// Probability that it is part of the explanation.
    pub probability: f64,
    /// Probable enough to be written into a rig.
    pub established: bool,
    /// Effect size: rms of its part of the motion per channel, after the vehicle's coefficients are refitted \[SI\].
    pub weight: BTreeMap<String, f64>,
    /// Whether it is practically significant: effect size above the rig's tolerance.
    pub matters: bool,
    /// Whether its law is that of the library.
    pub law: Law,
    /// Probability that the law is the library's; absent where that was not asked.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub law_exact_probability: Option<f64>,
    /// How a law that is not exact differs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub law_note: Option<String>,
    /// Its parameters, SI.
    pub parameters: BTreeMap<String, Value>,
    /// Effects that this data cannot tell from it, all others as they are; of those that matter `equivalent`
    /// holds the complete sets.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub or: Vec<String>,
    /// What lies outside of what a tank is expected to show.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
}

/// An effect that may be left out, at one place.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Candidate {
    /// Id of the effect.
    pub effect: String,
    /// Its parameters that are words, as `dof`.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub words: BTreeMap<String, String>,
    /// Probability that it is in the model.
    pub probability: f64,
}

/// Where the mismatch acts.
#[derive(Debug, Clone, PartialEq, Default, Serialize, schemars::JsonSchema)]
pub struct Where {
    /// Stage of the heaviest effect.
    pub stage: Option<String>,
    /// Degrees of freedom that the effects act in.
    pub dof: Vec<String>,
    /// Windows of the first run in which the model without effects misses by more than its noise \[s\].
    pub windows_s: Vec<[f64; 2]>,
    /// The same, run by run.
    pub windows: BTreeMap<String, Vec<[f64; 2]>>,
    /// What it depends on, in words with numbers.
    pub regime: String,
    /// Log Bayes factor of an unnamed force as a function of each variable, without effects.
    pub depends_on: BTreeMap<String, f64>,
}

/// Is there a mismatch at all?
#[derive(Debug, Clone, PartialEq, Default, Serialize, schemars::JsonSchema)]
pub struct Test {
    /// What was tested.
    pub statistic: String,
    /// Its value.
    pub value: f64,
    /// Degrees of freedom.
    pub freedom: f64,
    /// Probability of it without any effect.
    pub p_value: f64,
    /// Ljung-Box p of the whitened residuals that are left, per run.
    pub whiteness_p: Vec<f64>,
    /// Noise per channel \[SI\].
    pub noise_rms: BTreeMap<String, f64>,
}

/// rms per channel before and after.
#[derive(Debug, Clone, PartialEq, Default, Serialize, schemars::JsonSchema)]
pub struct BeforeAfter {
    /// The vehicle's coefficients refitted, without effects \[SI\].
    pub before: BTreeMap<String, f64>,
    /// With the effects \[SI\].
    pub after: BTreeMap<String, f64>,
    /// Noise of the measurement \[SI\].
    pub noise: BTreeMap<String, f64>,
}

/// Fit and prediction.
#[derive(Debug, Clone, PartialEq, Default, Serialize, schemars::JsonSchema)]
pub struct FitTable {
    /// rms of the residuals per channel on the runs fitted.
    pub train: BeforeAfter,
    /// The same on the runs held out (or, without any, each run predicted by the others).
    pub held_out: BeforeAfter,
    /// What `held_out` is of, in words.
    pub held_out_by: String,
    /// Where a law is not quite the library's: rms on the runs held out of the rig file written, which can
    /// only hold the library's \[SI\].
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub held_out_written: BTreeMap<String, f64>,
}

/// The vehicle's own coefficients without and with the effects.
#[derive(Debug, Clone, PartialEq, Default, Serialize, schemars::JsonSchema)]
pub struct Parameters {
    /// Without effects, SI.
    pub before: BTreeMap<String, Value>,
    /// With the effects, averaged over the sets in which the same matters.
    pub after: BTreeMap<String, Value>,
    /// With the effects, of the most probable set alone: what `--write-rig` writes, coefficients and effects of one fit.
    pub written: BTreeMap<String, Value>,
    /// The same for the effects' own parameters, by effect.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub written_effects: BTreeMap<String, BTreeMap<String, Value>>,
}

/// Noise of a channel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, schemars::JsonSchema)]
pub struct NoiseFound {
    /// sd of one sample \[SI\].
    pub sd: f64,
    /// White part \[SI\].
    pub white_sd: f64,
    /// Correlated part \[SI\].
    pub coloured_sd: f64,
    /// Its correlation time; 0 = white \[s\].
    pub correlation_s: f64,
    /// Share of samples left out.
    pub outliers: f64,
}

/// Something wrong with the data.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct DataFault {
    /// Kind of fault.
    pub fault: String,
    /// Channel of the measurement that has it.
    pub channel: String,
    /// Run that has it.
    pub run: String,
    /// What shows it.
    pub evidence: String,
    /// Whether it stops the diagnosis.
    pub fatal: bool,
}

/// An explanation and how it did.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Alternative {
    /// Its effects.
    pub effects: Vec<String>,
    /// Log evidence of the runs fitted, over that of the first.
    pub log_evidence: f64,
    /// Probability, with what the runs held out that help to choose say.
    pub probability: f64,
    /// rms on the runs fitted per channel \[SI\].
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub train: BTreeMap<String, f64>,
    /// rms on runs held out per channel \[SI\].
    pub held_out: BTreeMap<String, f64>,
}

/// One effect more, in the order of what they gain; the first one stands for none at all.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct AblationStep {
    /// Added here; empty for the vehicle alone.
    pub effect: String,
    /// rms on the runs fitted per channel, all effects up to here refitted together \[SI\].
    pub train: BTreeMap<String, f64>,
    /// The same on runs held out \[SI\].
    pub held_out: BTreeMap<String, f64>,
}

/// A force or change that nothing in the library explains.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Unexplained {
    /// Channel it shows in.
    pub channel: String,
    /// Weight there \[SI\].
    pub weight: f64,
    /// Variable it depends on best.
    pub depends_on: String,
    /// Where it acts, in the variable's unit.
    pub range: [f64; 2],
    /// Mean force there \[N, N m\].
    pub force: f64,
    /// The sparse term in words.
    pub term: String,
    /// Knots of the free function, in the variable's unit; times of several runs as laid end to end.
    pub knots: Vec<f64>,
    /// Force at each \[N, N m\].
    pub force_at: Vec<f64>,
    /// Standard deviation of each \[N, N m\].
    pub force_sd: Vec<f64>,
    /// Log Bayes factor over none.
    pub log_bayes_factor: f64,
    /// The same force as an expression of its variable, where one was looked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub closed_form: Option<ClosedForm>,
}

/// A force of no known effect, written down as an expression of its variable.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct ClosedForm {
    /// One form is likely enough to be called the law.
    pub sure: bool,
    /// The first form stands in the rig that is written; else the table does.
    pub written: bool,
    /// Probability that none of the grammar's forms is it: that of the table.
    pub none_probability: f64,
    /// Forms within odds of twenty of the likeliest, that one first.
    pub forms: Vec<WrittenForm>,
    /// Force of the first form at the table's knots \[N, N m\]; of a product at the rate that scales it.
    pub force_at: Vec<f64>,
    /// rms of held-out runs, predicted with the first form \[SI\]; empty where that was not asked.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub left_out: BTreeMap<String, f64>,
    /// The same with the table.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub left_out_table: BTreeMap<String, f64>,
    /// In words.
    pub sentence: String,
}

/// One form.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct WrittenForm {
    /// As it is read, numbers with their sds.
    pub expression: String,
    /// Probability among all forms and the table.
    pub probability: f64,
    /// Its pieces, which are added.
    pub pieces: Vec<Piece>,
}

/// A piece of a form.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Piece {
    /// Form, as rig files name it.
    pub form: String,
    /// Numbers by what they are; without an sd those that the form holds.
    pub numbers: BTreeMap<String, Value>,
}

/// What to run next.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct NextExperiment {
    /// Name of the plan.
    pub plan: String,
    /// The plan file.
    pub plan_toml: String,
    /// Explanations it parts.
    pub separates: Vec<Vec<String>>,
    /// Expected log Bayes factor between the two closest of them.
    pub expected_log_bayes_factor: f64,
    /// All plans asked, with the same figure.
    pub considered: BTreeMap<String, f64>,
    /// Why this one, in a sentence; empty where the figure says it.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub reason: String,
}

/// Everything.
#[derive(Debug, Clone, PartialEq, Default, Serialize, schemars::JsonSchema)]
pub struct Verdict {
    /// The verdict in one word.
    pub verdict: Word,
    /// The verdict in one sentence.
    pub sentence: String,
    /// The effects that the model left out, together; largest effect size first.
    pub effects: Vec<Effect>,
    /// Complete sets of what matters that this data cannot distinguish, most probable first.
    pub equivalent: Vec<Vec<String>>,
    /// Every effect with a probability of a hundredth and more, listed above or not.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub candidates: Vec<Candidate>,
    /// Where the mismatch acts.
    #[serde(rename = "where")]
    pub place: Where,
    /// Test of whether there is a mismatch at all.
    pub test: Test,
    /// How well the model fits and predicts, without and with the effects.
    pub fit: FitTable,
    /// The vehicle's coefficients, without and with the effects.
    pub parameters: Parameters,
    /// Coefficients at a limit or far from the rig's.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub at_limit: Vec<String>,
    /// Coefficients found over those of the rig.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub rig_factors: BTreeMap<String, Value>,
    /// Per DOF that moves the probability that a force of no known effect is worth more than the tolerance.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub unnamed: BTreeMap<String, f64>,
    /// Each run as the others predict it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub leave_one_run_out: Option<BeforeAfter>,
    /// What is structurally not identifiable: no data of this kind can show it.
    pub blind_spots: Vec<String>,
    /// DOFs in which these runs do not show them, where an effect acts in one by name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub blind_dofs: BTreeMap<String, Vec<String>>,
    /// The run that would say most next; `None` = none is needed, or none would.
    pub next_experiment: Option<NextExperiment>,
    /// Noise of the measurement, per channel.
    pub noise: BTreeMap<String, NoiseFound>,
    /// Faults of the data.
    pub data_faults: Vec<DataFault>,
    /// What else was considered.
    pub alternatives: Vec<Alternative>,
    /// The heavy effects one after the other, by what each gains in prediction.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub ablation: Vec<AblationStep>,
    /// What nothing explains.
    pub unexplained: Vec<Unexplained>,
    /// DOFs whose measured motion drove the others instead of being explained.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub given: Vec<String>,
    /// Remarks.
    pub notes: Vec<String>,
    /// Sets of effects looked at.
    pub sets_looked_at: usize,
}
