//! `[[physics]]` as typed.

use toml::de::DeValue;

use super::{Section, quantity};
use crate::{ParameterValue, PhysicsEntry};

/// Reads the entries; effect ids and parameter names are the `sim` crate's to check.
pub(super) fn read_physics(root: &Section<'_>) -> Option<Vec<PhysicsEntry>> {
    let mut entries = Vec::new();
    let mut sound = true;
    for s in root.tables("physics", 256) {
        match read_entry(&s) {
            Some(entry) => entries.push(entry),
            None => sound = false,
        }
    }
    sound.then_some(entries)
}

fn read_entry(s: &Section<'_>) -> Option<PhysicsEntry> {
    let effect = s.name("effect");
    let mut parameters = Vec::new();
    let mut sound = true;
    for (key, item) in s.entries() {
        if key == "effect" {
            continue;
        }
        let value = match item.value {
            DeValue::String(word) => {
                if super::is_name(word) {
                    Some(ParameterValue::Word(word.to_string()))
                } else {
                    s.wrong_type(
                        &item,
                        "a number, or a word of letters, digits, `_`, `-` or `.`",
                    );
                    None
                }
            }
            DeValue::Float(_) | DeValue::Integer(_) => s
                .number_of(&item, &quantity(-1e12, 1e12, ""))
                .map(ParameterValue::Number),
            _ => {
                s.wrong_type(&item, "a number or a word");
                None
            }
        };
        if !super::is_name(&key) || key.contains('.') {
            s.wrong_type(
                &item,
                "under a parameter name of letters, digits, `_` or `-`",
            );
            sound = false;
        }
        match value {
            Some(value) => parameters.push((key, value)),
            None => sound = false,
        }
    }
    sound.then_some(())?;
    Some(PhysicsEntry {
        effect: effect?,
        parameters,
    })
}
