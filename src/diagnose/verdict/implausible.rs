//! Effects that these runs would need at a size that no such vehicle shows.

use std::collections::BTreeMap;

use serde::Serialize;

/// An effect whose size would have to be more than ten times as large as is plausible for this vehicle: it is not offered.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Implausible {
    /// Id of the effect.
    pub effect: String,
    /// Its parameters that are words, as `dof`.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub words: BTreeMap<String, String>,
    /// Degree of freedom that it acts in, where its words say so.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dof: Option<String>,
    /// Parameter that says how large it is.
    pub parameter: String,
    /// Size that these runs would need \[SI\].
    pub value: f64,
    /// Range in which it is plausible for a vehicle of this size \[SI\].
    pub plausible: [f64; 2],
    /// Probability of the models that hold it, had they been offered.
    pub probability: f64,
}
