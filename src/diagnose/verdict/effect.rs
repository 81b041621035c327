//! Effects of a verdict, and the sets that were weighed.

use std::collections::BTreeMap;

use serde::Serialize;

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
    /// Estimate, SI.
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
    /// Remarks on numbers outside of what a tank is expected to show.
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

/// A set of effects that was looked at.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Alternative {
    /// Its effects; none = the vehicle alone.
    pub effects: Vec<String>,
    /// Log evidence of the runs fitted, over that of the first.
    pub log_evidence: f64,
    /// Posterior probability of the set.
    pub probability: f64,
    /// rms on the runs fitted per channel \[SI\].
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub train: BTreeMap<String, f64>,
}

/// One effect more, in the order of what they gain; the first step stands for none at all.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct AblationStep {
    /// Added here; empty for the vehicle alone.
    pub effect: String,
    /// rms on the runs fitted per channel, all effects up to here refitted together \[SI\].
    pub train: BTreeMap<String, f64>,
    /// The same on the runs held out or, without any, on each run as the others predict it \[SI\].
    pub predicted: BTreeMap<String, f64>,
}
