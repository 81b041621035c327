//! A map as typed.

use std::collections::BTreeMap;

use serde::Deserialize;

/// A column by its name or by its number from 1.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(untagged, expecting = "a column is its name, or its number from 1")]
pub enum RawColumn {
    /// From 1.
    Number(u32),
    /// As the header has it.
    Name(String),
}

/// One word or several.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(untagged, expecting = "a unit, or one for each column")]
pub enum RawUnits {
    /// For every column.
    One(String),
    /// Per column.
    Each(Vec<String>),
}

/// A cell that stands for nothing measured.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged, expecting = "a number, or a text as it stands in the cell")]
pub enum RawCell {
    /// Compared as a number.
    Number(f64),
    /// Compared as a text.
    Text(String),
}

/// One such cell or several.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged, expecting = "a number, a text, or a list of them")]
pub enum RawMissing {
    /// The only one.
    One(RawCell),
    /// Any of these.
    Each(Vec<RawCell>),
}

/// `[file]`
#[derive(Debug, Clone, PartialEq, Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub struct RawFile {
    pub separator: Option<String>,
    pub widths: Option<Vec<u32>>,
    pub decimal: Option<char>,
    pub thousands: Option<char>,
    pub encoding: Option<String>,
    pub comment: Option<String>,
    pub header: Option<bool>,
    pub header_line: Option<u64>,
    pub units_line: Option<u64>,
    pub first_line: Option<u64>,
    pub last_line: Option<u64>,
    pub rate_hz: Option<f64>,
}

/// `[time]`
#[derive(Debug, Clone, PartialEq, Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub struct RawTime {
    pub column: Option<RawColumn>,
    pub nth: Option<u32>,
    pub columns: Option<Vec<RawColumn>>,
    pub unit: Option<RawUnits>,
    pub format: Option<String>,
    pub rate_hz: Option<f64>,
    pub unwrap: Option<u32>,
    pub clock: Option<String>,
    pub start_unix_s: Option<f64>,
    pub boot: Option<u32>,
    pub utc_offset: Option<String>,
    pub from_s: Option<f64>,
    pub to_s: Option<f64>,
    pub compare_column: Option<RawColumn>,
    pub compare_unit: Option<String>,
}

/// `[motion.NAME]`
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RawChannel {
    pub column: Option<RawColumn>,
    pub nth: Option<u32>,
    pub value: Option<f64>,
    pub unit: Option<String>,
    pub sign: Option<f64>,
    pub scale: Option<f64>,
    pub offset: Option<f64>,
    pub sd: Option<f64>,
    pub missing: Option<String>,
    pub missing_value: Option<RawMissing>,
    pub frame: Option<String>,
}

/// `[quaternion]`
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RawQuaternion {
    pub columns: Vec<RawColumn>,
    pub order: String,
    pub axes: Option<String>,
    pub missing: Option<String>,
    pub missing_value: Option<RawMissing>,
}

/// `[[command]]`
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RawCommand {
    pub thruster: String,
    pub column: Option<RawColumn>,
    pub nth: Option<u32>,
    pub value: Option<f64>,
    pub unit: Option<String>,
    pub sign: Option<f64>,
    pub scale: Option<f64>,
    pub offset: Option<f64>,
    pub between: Option<String>,
    pub missing: Option<String>,
    pub missing_value: Option<RawMissing>,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RawMap {
    #[serde(default)]
    pub file: RawFile,
    #[serde(default)]
    pub time: RawTime,
    #[serde(default)]
    pub motion: BTreeMap<String, RawChannel>,
    pub quaternion: Option<RawQuaternion>,
    #[serde(default, rename = "command")]
    pub commands: Vec<RawCommand>,
}
