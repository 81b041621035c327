//! What the readers ask a file for: the book's table of keys is made of it, so that a key's unit, range and default
//! stand in one place only, the call that reads it.

use std::fmt::Display;

use super::{Quantity, Section};

/// Whether a key must be there.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Need {
    /// It must.
    Required,
    /// It may be left out.
    Optional,
    /// It may be left out and is then this.
    Default(String),
}

/// A key that a reader asked for.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Asked {
    pub(crate) file: String,
    /// Its path, list positions left out: `thruster[].name`.
    pub(crate) path: String,
    /// Its type; "" = nobody has said yet, `table` = a table or list of tables.
    pub(crate) kind: String,
    pub(crate) unit: &'static str,
    /// What values it may have.
    pub(crate) allowed: String,
    pub(crate) need: Need,
}

/// A path without the positions in lists.
fn without_positions(path: &str) -> String {
    let mut plain = String::new();
    let mut inside = false;
    for c in path.chars() {
        inside &= c != ']';
        if !inside {
            plain.push(c);
        }
        inside |= c == '[';
    }
    plain
}

impl Section<'_> {
    /// Notes what is asked for; what is said later of the same key replaces it.
    fn note(&self, key: &str, change: impl FnOnce(&mut Asked)) {
        let Some(asked) = self.problems().asked() else {
            return;
        };
        let mut asked = asked.borrow_mut();
        let path = without_positions(&self.path_of(key));
        let file = self.file().to_owned();
        let known = asked.iter().position(|a| a.path == path && a.file == file);
        let place = known.unwrap_or_else(|| {
            asked.push(Asked {
                file,
                path,
                kind: String::new(),
                unit: "",
                allowed: String::new(),
                need: Need::Optional,
            });
            asked.len() - 1
        });
        change(&mut asked[place]);
    }

    /// That a key was looked at.
    pub(super) fn asks(&self, key: &str) {
        self.note(key, |_| {});
    }

    /// What kind of value a key has, by one that is read by its own rules.
    pub(crate) fn asks_for(&self, key: &str, kind: impl Display, allowed: impl Display) {
        self.note(key, |a| {
            a.kind = kind.to_string();
            a.allowed = allowed.to_string();
        });
    }

    /// The same for numbers: one (`kind` = number) or a list of them.
    pub(crate) fn asks_number(&self, key: &str, kind: impl Display, range: &Quantity) {
        self.note(key, |a| {
            a.kind = kind.to_string();
            a.allowed = range.interval();
            a.unit = range.unit();
        });
    }

    /// The same for a whole number.
    pub(crate) fn asks_integer(&self, key: &str, unit: &'static str, range: String) {
        self.note(key, |a| {
            a.kind = "whole number".to_owned();
            a.allowed = range;
            a.unit = unit;
        });
    }

    /// That it must be there.
    pub(crate) fn requires(&self, key: &str) {
        self.note(key, |a| a.need = Need::Required);
    }

    /// What it is when it is left out.
    pub(crate) fn default_is(&self, key: &str, value: impl Display) {
        self.note(key, |a| a.need = Need::Default(value.to_string()));
    }
}
