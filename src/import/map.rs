//! `MAP.toml`: which column is what, in which unit.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;

use hydroline_identify::data::CHANNELS;

/// Between samples of a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Default)]
#[serde(rename_all = "snake_case")]
pub enum Between {
    /// The last value holds.
    #[default]
    Hold,
    /// Straight lines: written as steps of at most 10 ms.
    Linear,
}

/// One measured channel.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChannelMap {
    /// Column by its header.
    pub column: String,
    /// `m`, `cm`, `mm`, `rad`, `deg`, and per second `m/s`, `mm/s`, `rad/s`, `deg/s`.
    pub unit: String,
    /// 1 or -1.
    #[serde(default = "one")]
    pub sign: f64,
    /// Added after unit and sign, SI.
    #[serde(default)]
    pub offset: f64,
    /// Standard deviation of the instrument, SI; left out = not known.
    #[serde(default)]
    pub sd: Option<f64>,
}

/// One commanded load.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CommandMap {
    /// Thruster of the rig, or `surge` .. `yaw`.
    pub thruster: String,
    /// Column by its header.
    pub column: String,
    /// Newtons (newton metres) per unit of the column.
    #[serde(default = "one")]
    pub scale: f64,
    /// Added after the scale \[N, N m\].
    #[serde(default)]
    pub offset: f64,
    /// Between samples.
    #[serde(default)]
    pub between: Between,
}

/// The time column.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TimeMap {
    /// Column by its header.
    pub column: String,
    /// `s`, `ms`, `us`, `ns`, or `iso8601`.
    pub unit: String,
    /// `relative` (any zero) or `unix`.
    #[serde(default = "relative")]
    pub clock: String,
    /// UNIX time of zero for a relative clock \[s\].
    #[serde(default)]
    pub start_unix_s: Option<f64>,
    /// Only rows from here on \[s after the first row\].
    #[serde(default)]
    pub from_s: Option<f64>,
    /// Only rows up to here \[s after the first row\].
    #[serde(default)]
    pub to_s: Option<f64>,
    /// A second clock in the same rows, to measure drift.
    #[serde(default)]
    pub compare_column: Option<String>,
    /// Unit of the second clock.
    #[serde(default)]
    pub compare_unit: Option<String>,
}

/// How the file is written.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FileMap {
    /// Between cells: one character.
    #[serde(default = "comma")]
    pub separator: char,
    /// `.` or `,`.
    #[serde(default = "point")]
    pub decimal: char,
}

impl Default for FileMap {
    fn default() -> Self {
        FileMap {
            separator: ',',
            decimal: '.',
        }
    }
}

/// A checked map.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Map {
    /// How the file is written.
    #[serde(default)]
    pub file: FileMap,
    /// Time.
    pub time: TimeMap,
    /// Channels by their name in `/vehicle/motion` (`x_m` .. `r_radps`).
    #[serde(default)]
    pub motion: BTreeMap<String, ChannelMap>,
    /// Loads.
    #[serde(default, rename = "command")]
    pub commands: Vec<CommandMap>,
}

fn one() -> f64 {
    1.0
}
fn relative() -> String {
    "relative".to_owned()
}
fn comma() -> char {
    ','
}
fn point() -> char {
    '.'
}

/// What is wrong with a map.
#[derive(Debug, thiserror::Error)]
pub enum MapError {
    /// The file.
    #[error("{path}: {source}; check the path and permissions")]
    Unreadable {
        /// Path.
        path: String,
        /// Why.
        source: std::io::Error,
    },
    /// TOML or its keys.
    #[error(
        "{file}: {source}\nhydroline import --help shows a map; mend the line, or give another --map"
    )]
    Toml {
        /// File.
        file: String,
        /// Where and what.
        source: Box<toml::de::Error>,
    },
    /// A value.
    #[error("{file}: {key} is {value}; {allowed}")]
    Value {
        /// File.
        file: String,
        /// Key.
        key: String,
        /// As given.
        value: String,
        /// What it may be.
        allowed: String,
    },
}

impl Map {
    /// Reads a map file.
    ///
    /// # Errors
    /// [`MapError`].
    pub fn load(path: &Path) -> Result<Map, MapError> {
        let file = path.display().to_string();
        let text = hydroline_rigs::bounded::read_text(path, hydroline_rigs::bounded::CONFIG_BYTES)
            .map_err(|source| MapError::Unreadable {
                path: file.clone(),
                source,
            })?;
        Map::from_toml(&text, &file)
    }

    /// Reads a map from a text.
    ///
    /// # Errors
    /// [`MapError`].
    pub fn from_toml(text: &str, file: &str) -> Result<Map, MapError> {
        let map: Map = toml::from_str(text).map_err(|e| MapError::Toml {
            file: file.to_owned(),
            source: Box::new(e),
        })?;
        let bad = |key: String, value: &str, allowed: String| {
            Err(MapError::Value {
                file: file.to_owned(),
                key,
                value: format!("'{value}'"),
                allowed,
            })
        };
        if time_unit_s(&map.time.unit).is_none() && map.time.unit != "iso8601" {
            return bad(
                "time.unit".into(),
                &map.time.unit,
                "it must be s, ms, us, ns or iso8601".into(),
            );
        }
        if let Some(unit) = map
            .time
            .compare_unit
            .as_ref()
            .filter(|u| time_unit_s(u).is_none())
        {
            return bad(
                "time.compare_unit".into(),
                unit,
                "it must be s, ms, us or ns".into(),
            );
        }
        if !matches!(map.time.clock.as_str(), "relative" | "unix") {
            return bad(
                "time.clock".into(),
                &map.time.clock,
                "it must be relative or unix".into(),
            );
        }
        if !map.file.separator.is_ascii()
            || !matches!(map.file.decimal, '.' | ',')
            || map.file.separator == map.file.decimal
        {
            let given = format!(
                "separator {} decimal {}",
                map.file.separator, map.file.decimal
            );
            return bad(
                "file".into(),
                &given,
                "the decimal sign is . or , and differs from the separator, an ASCII character"
                    .into(),
            );
        }
        if map.motion.is_empty() {
            return bad(
                "motion".into(),
                "",
                format!(
                    "map at least one channel: [motion.x_m] .. of {}",
                    CHANNELS.join(" ")
                ),
            );
        }
        for (name, channel) in &map.motion {
            let Some(place) = CHANNELS.iter().position(|c| c == name) else {
                return bad(
                    format!("motion.{name}"),
                    name,
                    format!("channels are {}", CHANNELS.join(" ")),
                );
            };
            if unit_factor(place, &channel.unit).is_none() {
                return bad(
                    format!("motion.{name}.unit"),
                    &channel.unit,
                    format!("it must be one of {}", units(place).join(" ")),
                );
            }
            if channel.sign.abs() != 1.0 {
                return bad(
                    format!("motion.{name}.sign"),
                    &channel.sign.to_string(),
                    "it must be 1 or -1".into(),
                );
            }
            if channel.sd.is_some_and(|sd| !(sd > 0.0 && sd.is_finite()))
                || !channel.offset.is_finite()
            {
                return bad(
                    format!("motion.{name}"),
                    "sd or offset",
                    "sd must be > 0 and both finite".into(),
                );
            }
        }
        for (i, command) in map.commands.iter().enumerate() {
            if !(command.scale.is_finite() && command.scale != 0.0 && command.offset.is_finite()) {
                return bad(
                    format!("command {}", i + 1),
                    &command.scale.to_string(),
                    "scale must be finite and not 0".into(),
                );
            }
        }
        Ok(map)
    }

    /// Channels in the order of `/vehicle/motion`, with their factor to SI (sign included).
    pub(super) fn channels(&self) -> Vec<(usize, &ChannelMap, f64)> {
        let place = |name: &String| CHANNELS.iter().position(|c| c == name);
        self.motion
            .iter()
            .filter_map(|(name, c)| {
                place(name).map(|p| (p, c, unit_factor(p, &c.unit).unwrap_or(1.0) * c.sign))
            })
            .collect()
    }
}

const LENGTHS: [(&str, f64); 3] = [("m", 1.0), ("cm", 0.01), ("mm", 0.001)];
const ANGLES: [(&str, f64); 2] = [("rad", 1.0), ("deg", std::f64::consts::PI / 180.0)];
const SPEEDS: [(&str, f64); 3] = [("m/s", 1.0), ("cm/s", 0.01), ("mm/s", 0.001)];
const RATES: [(&str, f64); 2] = [("rad/s", 1.0), ("deg/s", std::f64::consts::PI / 180.0)];

fn table(place: usize) -> &'static [(&'static str, f64)] {
    match place {
        0..3 => &LENGTHS,
        3..6 => &ANGLES,
        6..9 => &SPEEDS,
        _ => &RATES,
    }
}

fn unit_factor(place: usize, unit: &str) -> Option<f64> {
    table(place)
        .iter()
        .find(|(name, _)| *name == unit)
        .map(|(_, f)| *f)
}

fn units(place: usize) -> Vec<&'static str> {
    table(place).iter().map(|(name, _)| *name).collect()
}

/// Seconds per unit of time.
pub(super) fn time_unit_s(unit: &str) -> Option<f64> {
    [("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)]
        .iter()
        .find(|(name, _)| *name == unit)
        .map(|(_, f)| *f)
}
