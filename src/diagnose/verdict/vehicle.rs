//! The vehicle's own coefficients.

use std::collections::BTreeMap;

use serde::Serialize;

use super::Value;

/// The vehicle's own coefficients without and with the effects.
#[derive(Debug, Clone, PartialEq, Default, Serialize, schemars::JsonSchema)]
pub struct Parameters {
    /// Without effects, SI.
    pub before: BTreeMap<String, Value>,
    /// With the effects, averaged over the sets in which the same matters.
    pub after: BTreeMap<String, Value>,
    /// Of the model that `--write-rig` writes, coefficients and effects of one fit: of the most probable set what is established and said.
    pub written: BTreeMap<String, Value>,
    /// The same for the effects' own parameters, by effect.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub written_effects: BTreeMap<String, BTreeMap<String, Value>>,
}

/// A coefficient at a physical limit, or far from the rig's.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct AtLimit {
    /// Its key in the rig file.
    pub key: String,
    /// Its number over the rig's.
    pub factor: f64,
}
