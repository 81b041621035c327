//! Values put into a rig file's text, its comments and order kept; and two rigs compared key by key.

use std::ops::Range;

use hydroline_rigs::Rig;
use hydroline_rigs::reference;
use schemars::JsonSchema;
use serde::Serialize;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::units::{UnitError, read};

/// Why a value cannot be put.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum EditError {
    #[error("{0}: write KEY=VALUE, as vehicle.mass_kg=11.5 or thruster[2].channel=4")]
    NoValue(String),
    #[error(
        "{key}: no such key in a rig{near}; the reference lists them (hydroline rig show RIG prints those of a rig)"
    )]
    NoKey { key: String, near: String },
    #[error("{key}: {source}")]
    Unit { key: String, source: UnitError },
    #[error("not valid TOML: {0}")]
    Syntax(String),
    #[error("{key}: {list} has {count} entries, counted from 0")]
    NoEntry {
        key: String,
        list: String,
        count: usize,
    },
    #[error(
        "{key}: its table is written in one line there; write it with a head of its own, [{table}]"
    )]
    Inline { key: String, table: String },
}

/// A change that was asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct Change {
    /// Path of the table, entries of lists by their place.
    table: Vec<Step>,
    /// Name of the key.
    name: String,
    /// Its new value, as TOML.
    value: String,
    /// A unit that was turned into that of the key, in words.
    pub said: Option<String>,
}

#[derive(Debug, Clone, PartialEq)]
struct Step {
    name: String,
    place: Option<usize>,
}

fn step(text: &str) -> Step {
    let parts = text.strip_suffix(']').and_then(|t| t.split_once('['));
    let place = parts.and_then(|(name, k)| Some((name, k.parse().ok()?)));
    match place {
        Some((name, place)) => Step {
            name: name.to_owned(),
            place: Some(place),
        },
        None => Step {
            name: text.to_owned(),
            place: None,
        },
    }
}

/// The declared key of a path; its name may lack the unit at its end, as `mass` of `mass_kg`.
fn declared(table: &[Step], name: &str) -> Option<(String, &'static str, String)> {
    let path: Vec<&str> = table.iter().map(|s| s.name.as_str()).collect();
    let path = path.join(".");
    let heads = [format!("[{path}]"), format!("[[{path}]]")];
    let tables = reference::rig();
    let keys = tables
        .iter()
        .filter(|t| t.heads.iter().any(|h| heads.contains(h)));
    let keys: Vec<&reference::Key> = keys.flat_map(|t| &t.keys).collect();
    let of = |matches: &dyn Fn(&str) -> bool| {
        keys.iter().find_map(|k| {
            let found = k.names.iter().find(|n| matches(n))?;
            let is_degrees = found.ends_with("_deg");
            let unit = match k.unit {
                "deg" | "rad" if is_degrees => "deg",
                "deg" | "rad" => "rad",
                unit => unit,
            };
            Some((found.clone(), unit, k.kind.clone()))
        })
    };
    of(&|n| n == name).or_else(|| {
        of(&|n| {
            n.strip_prefix(name)
                .is_some_and(|rest| rest.starts_with('_'))
        })
    })
}

/// Reads KEY=VALUE.
///
/// # Errors
/// [`EditError`].
pub fn change(text: &str) -> Result<Change, EditError> {
    let (path, value) = text
        .split_once('=')
        .ok_or_else(|| EditError::NoValue(text.to_owned()))?;
    let (path, value) = (path.trim(), value.trim());
    let mut table: Vec<Step> = path.split('.').map(step).collect();
    let last = table
        .pop()
        .filter(|s| s.place.is_none() && !s.name.is_empty());
    let last = last.ok_or_else(|| EditError::NoValue(text.to_owned()))?;
    // [[physics]] has the keys of its effect.
    let is_physics = table.first().is_some_and(|s| s.name == "physics");
    let found = declared(&table, &last.name);
    let (name, unit, kind) = match found {
        Some(found) => found,
        None if is_physics => (last.name.clone(), "", String::new()),
        None => {
            let all = reference::rig();
            let names = all.iter().flat_map(|t| {
                t.keys
                    .iter()
                    .flat_map(move |k| k.names.iter().map(move |n| (t, n)))
            });
            let near = names
                .filter(|(_, n)| **n == last.name || n.starts_with(&format!("{}_", last.name)))
                .filter_map(|(t, n)| {
                    Some(format!("{}.{n}", t.heads.first()?.trim_matches(['[', ']'])))
                })
                .take(3)
                .collect::<Vec<_>>();
            let near = match near.is_empty() {
                true => String::new(),
                false => format!(" (did you mean {}?)", near.join(", ")),
            };
            return Err(EditError::NoKey {
                key: path.to_owned(),
                near,
            });
        }
    };
    let is_number = kind.contains("number") && !value.starts_with('[');
    let (value, said) = if is_number || (is_physics && value.parse::<f64>().is_ok()) {
        let typed = read(value.trim_matches('"'), unit).map_err(|source| EditError::Unit {
            key: path.to_owned(),
            source,
        })?;
        // A whole number stays one: some keys take no other.
        let is_whole = value.parse::<i64>().is_ok();
        let text = if is_whole {
            value.to_owned()
        } else {
            format!("{:?}", typed.value)
        };
        (text, typed.said)
    } else if value.starts_with(['"', '[', '{']) || matches!(value, "true" | "false") {
        (value.to_owned(), None)
    } else {
        (format!("\"{value}\""), None)
    };
    Ok(Change {
        table,
        name,
        value,
        said,
    })
}

/// A table that was found in a text.
struct Place<'t> {
    table: &'t DeTable<'t>,
    span: Range<usize>,
    is_inline: bool,
}

fn found<'t>(
    root: &'t Spanned<DeTable<'t>>,
    change: &Change,
    text: &str,
) -> Result<Option<Place<'t>>, EditError> {
    let mut at = Place {
        table: root.get_ref(),
        span: 0..0,
        is_inline: false,
    };
    let key = || change.path();
    for step in &change.table {
        let Some(value) = at.table.get(step.name.as_str()) else {
            return Ok(None);
        };
        let (value, span) = match (value.get_ref(), step.place) {
            (DeValue::Array(list), Some(place)) => {
                let entry = list.get(place).ok_or_else(|| EditError::NoEntry {
                    key: key(),
                    list: step.name.clone(),
                    count: list.len(),
                })?;
                (entry.get_ref(), entry.span())
            }
            (of, None) => (of, value.span()),
            (_, Some(_)) => return Ok(None),
        };
        let DeValue::Table(table) = value else {
            return Ok(None);
        };
        let is_inline = text.get(span.clone()).is_some_and(|t| t.starts_with('{'));
        at = Place {
            table,
            span,
            is_inline,
        };
    }
    Ok(Some(at))
}

impl Change {
    /// The whole path, as it was typed.
    pub fn path(&self) -> String {
        let step = |s: &Step| match s.place {
            Some(place) => format!("{}[{place}]", s.name),
            None => s.name.clone(),
        };
        let steps: Vec<String> = self.table.iter().map(step).collect();
        format!("{}.{}", steps.join("."), self.name)
    }

    /// Its value, as TOML.
    pub fn value(&self) -> &str {
        &self.value
    }
}

/// The text with a change in it; all else stays as it is, to the byte.
///
/// # Errors
/// [`EditError`].
pub fn put(text: &str, change: &Change) -> Result<String, EditError> {
    let root = DeTable::parse(text).map_err(|e| EditError::Syntax(e.message().to_owned()))?;
    let head: Vec<&str> = change.table.iter().map(|s| s.name.as_str()).collect();
    let head = head.join(".");
    let line = format!("{} = {}\n", change.name, change.value);
    let Some(place) = found(&root, change, text)? else {
        let gap = if text.ends_with('\n') || text.is_empty() {
            ""
        } else {
            "\n"
        };
        return Ok(format!("{text}{gap}\n[{head}]\n{line}"));
    };
    // The other name of an angle is taken away with its value.
    let other = [("_deg", "_rad"), ("_rad", "_deg")]
        .into_iter()
        .find_map(|(a, b)| {
            let stem = change.name.strip_suffix(a)?;
            place.table.get_key_value(format!("{stem}{b}").as_str())
        });
    let there = place.table.get_key_value(change.name.as_str()).or(other);
    if let Some((key, value)) = there {
        let span = key.span().start..value.span().end;
        let new = format!("{} = {}", change.name, change.value);
        return Ok(format!("{}{new}{}", &text[..span.start], &text[span.end..]));
    }
    if place.is_inline {
        return Err(EditError::Inline {
            key: change.path(),
            table: head,
        });
    }
    // Behind the head's line.
    let from = place.span.start;
    let end = text[from..].find('\n').map(|k| from + k + 1);
    Ok(match end {
        Some(end) => format!("{}{line}{}", &text[..end], &text[end..]),
        None => format!("{text}\n{line}"),
    })
}

/// A key that two rigs have differently.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Difference {
    /// Path of the key, entries of lists counted from 0.
    pub key: String,
    /// Value of the first rig; `None` = it has none.
    pub first: Option<String>,
    /// Value of the second rig.
    pub second: Option<String>,
    /// Second over first, of numbers.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ratio: Option<f64>,
}

fn flat(path: &str, value: &toml::Value, all: &mut Vec<(String, toml::Value)>) {
    match value {
        toml::Value::Table(table) => {
            for (key, value) in table {
                let path = if path.is_empty() {
                    key.clone()
                } else {
                    format!("{path}.{key}")
                };
                flat(&path, value, all);
            }
        }
        toml::Value::Array(list) if list.iter().any(toml::Value::is_table) => {
            for (k, value) in list.iter().enumerate() {
                flat(&format!("{path}[{k}]"), value, all);
            }
        }
        other => all.push((path.to_owned(), other.clone())),
    }
}

/// All keys of a rig with their values, defaults written out.
fn keys(rig: &Rig) -> Vec<(String, toml::Value)> {
    let table: toml::Table = rig.to_toml().parse().unwrap_or_default();
    let mut all = Vec::new();
    flat("", &toml::Value::Table(table), &mut all);
    all
}

/// Keys in which two rigs differ, in the order of the first, then what only the second has.
pub fn differences(first: &Rig, second: &Rig) -> Vec<Difference> {
    between(&keys(first), &keys(second))
}

/// The same of two tables of any kind.
pub fn table_differences(first: &toml::Table, second: &toml::Table) -> Vec<Difference> {
    let keys = |table: &toml::Table| {
        let mut all = Vec::new();
        flat("", &toml::Value::Table(table.clone()), &mut all);
        all
    };
    between(&keys(first), &keys(second))
}

fn between(a: &[(String, toml::Value)], b: &[(String, toml::Value)]) -> Vec<Difference> {
    let number = |v: &toml::Value| v.as_float().or(v.as_integer().map(|i| i as f64));
    let mut made = Vec::new();
    for (key, value) in a {
        let other = b.iter().find(|(k, _)| k == key).map(|(_, v)| v);
        if other == Some(value) {
            continue;
        }
        let ratio = other.and_then(|o| Some(number(o)? / number(value)?));
        made.push(Difference {
            key: key.clone(),
            first: Some(value.to_string()),
            second: other.map(ToString::to_string),
            ratio: ratio.filter(|r| r.is_finite()),
        });
    }
    let new = b.iter().filter(|(key, _)| !a.iter().any(|(k, _)| k == key));
    made.extend(new.map(|(key, value)| Difference {
        key: key.clone(),
        first: None,
        second: Some(value.to_string()),
        ratio: None,
    }));
    made
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = include_str!("../../rigs/lshpi.toml");

    fn with(text: &str, changes: &[&str]) -> String {
        changes.iter().fold(text.to_owned(), |text, c| {
            put(&text, &change(c).unwrap()).unwrap()
        })
    }

    #[test]
    fn values_are_put_where_they_are_and_all_else_stays() {
        let made = with(
            TEXT,
            &[
                "vehicle.mass_kg=11500 g",
                "vehicle.surge.added = -5.5",
                "thruster[2].channel=9",
            ],
        );
        assert!(made.contains("mass_kg = 11.5\ninertia_kgm2"), "{made}");
        assert!(made.contains("added_kg = -5.5\nlinear_kgps = -20"));
        assert!(made.contains("# Surge: the paper, Table 6."));
        // Where the change is, and nowhere else.
        let lines = made.lines().zip(TEXT.lines()).filter(|(a, b)| a != b);
        assert_eq!(lines.count(), 3);
        let bare = with(&made, &["target.file=builtin:hexagons"]);
        let rig = Rig::from_toml(&bare, "r.toml", None).unwrap();
        assert_eq!(rig.vehicle.mass_kg, 11.5);
        assert_eq!(rig.vehicle.coefficients[0].added, -5.5);
        assert_eq!(rig.thrusters.thrusters[2].channel, 9);
    }

    #[test]
    fn keys_and_tables_that_are_not_there_are_added() {
        let text = with(
            TEXT,
            &[
                "target.file=builtin:hexagons",
                "vehicle.net_weight=2 lbf",
                "port.distance_m=3 cm",
                "port.glass=10 mm",
            ],
        );
        let rig = Rig::from_toml(&text, "r.toml", None).unwrap();
        assert!((rig.vehicle.net_weight_n - 8.896_443).abs() < 1e-6);
        assert!((rig.port.unwrap().distance_m - 0.03).abs() < 1e-15);
        let tilted = with(&text, &["mounts.camera_tilt_rad=40 deg"]);
        let rig = Rig::from_toml(&tilted, "r.toml", None).unwrap();
        assert!((rig.mounts.camera_tilt_rad - 40f64.to_radians()).abs() < 1e-12);
        assert!(!tilted.contains("camera_tilt_deg"));
    }

    #[test]
    fn what_cannot_be_put_is_refused_with_the_way_out() {
        let refused = |c: &str| match change(c) {
            Err(e) => e.to_string(),
            Ok(change) => put(TEXT, &change).unwrap_err().to_string(),
        };
        assert!(refused("vehicle.mass_kg").contains("KEY=VALUE"));
        assert!(refused("vehicle.weight=3").contains("no such key"));
        assert!(refused("mass=3").contains("did you mean vehicle.mass_kg"));
        assert!(refused("vehicle.mass_kg=3 m").contains("the key is in kg"));
        assert!(refused("thruster[99].channel=1").contains("8 entries"));
    }

    #[test]
    fn two_rigs_differ_in_the_keys_that_differ() {
        let first = Rig::builtin("lshpi").unwrap();
        let mut second = first.clone();
        assert!(differences(&first, &second).is_empty());
        second.vehicle.coefficients[0].linear = -40.0;
        second.vehicle.net_weight_n = 1.0;
        let made = differences(&first, &second);
        let keys: Vec<&str> = made.iter().map(|d| d.key.as_str()).collect();
        assert_eq!(keys, ["vehicle.surge.linear_kgps", "vehicle.net_weight_n"]);
        assert_eq!(made[0].ratio, Some(2.0));
        assert_eq!(made[1].first, None);
    }
}
