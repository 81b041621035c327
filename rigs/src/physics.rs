//! `[[physics]]` entries: which effects are switched on, with their parameters.
//!
//! This crate does not know the effects; the `sim` crate checks ids, parameter
//! names and ranges when it builds the effect.

use toml::de::DeValue;

use crate::raw::{Described, Item, Kind, Section, Writer, is_name, name, number};

/// A parameter as typed.
#[derive(Debug, Clone, PartialEq)]
pub enum ParameterValue {
    /// A number in the unit its name carries.
    Number(f64),
    /// A word, e.g. `dof = "surge"`.
    Word(String),
}

table! {
    /// An effect beyond the vehicle's equations, and its parameters as further keys: [Effects](effects.md) lists them.
    /// Omitted: none.
    pub struct PhysicsEntry as EntryTyped {
        /// Id of the effect.
        pub effect: String = name(),
        /// Parameters by name, in the order typed.
        pub parameters: Vec<(String, ParameterValue)> = Parameters,
    }
}

/// All keys but `effect`.
struct Parameters;

impl Kind for Parameters {
    type Value = Vec<(String, ParameterValue)>;

    fn typed(&self, s: &Section<'_>, _: &str) -> Option<Option<Self::Value>> {
        let mut parameters = Vec::new();
        let mut sound = true;
        for (key, item) in s.entries().into_iter().filter(|(key, _)| key != "effect") {
            if !is_name(&key) || key.contains('.') {
                s.wrong_type(
                    &item,
                    "under a parameter name of letters, digits, `_` or `-`",
                );
                sound = false;
            }
            match value(s, &item) {
                Some(value) => parameters.push((key, value)),
                None => sound = false,
            }
        }
        sound.then_some(Some(parameters))
    }

    fn left_out(&self, _: &Section<'_>, _: &str) -> Option<Self::Value> {
        None
    }

    fn write(&self, w: &mut Writer, _: &str, parameters: &Self::Value) {
        for (name, value) in parameters {
            match value {
                ParameterValue::Number(number) => w.debug(name, number),
                ParameterValue::Word(word) => w.text(name, word),
            }
        }
    }

    fn describe(&self, _: &mut Described<'_>, _: &str, _: &'static str) {}
}

fn value(s: &Section<'_>, item: &Item<'_>) -> Option<ParameterValue> {
    let expected = match item.value {
        DeValue::String(word) if is_name(word) => {
            return Some(ParameterValue::Word(word.to_string()));
        }
        DeValue::String(_) => "a number, or a word of letters, digits, `_`, `-` or `.`",
        DeValue::Float(_) | DeValue::Integer(_) => {
            let number = s.number_of(item, &number(-1e12, 1e12, ""));
            return number.map(ParameterValue::Number);
        }
        _ => "a number or a word",
    };
    s.wrong_type(item, expected);
    None
}
