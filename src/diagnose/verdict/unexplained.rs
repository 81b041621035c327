//! Motion that nothing in the library explains.

use std::collections::BTreeMap;

use serde::Serialize;

use super::Value;

/// Motion that nothing in the library explains.
#[derive(Debug, Clone, PartialEq, Default, Serialize, schemars::JsonSchema)]
pub struct Unexplained {
    /// Channel it shows in.
    pub channel: String,
    /// Weight there; absent where the model gives no finite motion \[SI\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub weight: Option<f64>,
    /// In words.
    pub term: String,
    /// Variable that the force depends on: a covariate, or `time` where it is random.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depends_on: Option<String>,
    /// Where the force acts, in the variable's unit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub range: Option<[f64; 2]>,
    /// Its largest value there; of a random force its sd \[N, N m\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub force: Option<f64>,
    /// Points of the force's table, in the variable's unit; times of several runs as laid end to end.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub knots: Vec<f64>,
    /// Force at each \[N, N m\].
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub force_at: Vec<f64>,
    /// Standard deviation of each \[N, N m\].
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub force_sd: Vec<f64>,
    /// Log Bayes factor of the force over none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub log_bayes_factor: Option<f64>,
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
    /// rms of each run as the others predict it with the first form \[SI\]; absent where that was not asked.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub leave_one_run_out: BTreeMap<String, f64>,
    /// The same with the table \[SI\].
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub leave_one_run_out_table: BTreeMap<String, f64>,
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
