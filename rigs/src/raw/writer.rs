//! TOML text, key by key, in the order and form a person would write it.

use std::fmt::{Display, Write};

use super::Table;

/// Collects TOML text.
#[derive(Default)]
pub(crate) struct Writer {
    text: String,
    /// Path of the table that is written; empty before all tables.
    path: String,
}

impl Writer {
    /// A table's keys as a text of their own, below `path` (empty: a file).
    pub(crate) fn text_of(path: &str, write: impl FnOnce(&mut Writer)) -> String {
        let mut w = Writer {
            path: path.to_owned(),
            ..Writer::default()
        };
        write(&mut w);
        w.text
    }

    /// `[key]` below the table that is written, with its keys.
    pub(crate) fn table(&mut self, key: &str, table: &impl Table) {
        self.below(key, ["[", "]"], table);
    }

    /// An entry of `[[key]]`.
    pub(crate) fn entry(&mut self, key: &str, table: &impl Table) {
        self.below(key, ["[[", "]]"], table);
    }

    fn below(&mut self, key: &str, [open, close]: [&str; 2], table: &impl Table) {
        let above = self.path.clone();
        if !self.path.is_empty() {
            self.path.push('.');
        }
        self.path.push_str(key);
        if !self.text.is_empty() {
            self.text.push('\n');
        }
        self.line(format!("{open}{}{close}", self.path));
        table.write_keys(self);
        self.path = above;
    }

    fn line(&mut self, line: impl Display) {
        // Writing into a String cannot fail.
        let _ = writeln!(self.text, "{line}");
    }

    /// Integers and booleans.
    pub(crate) fn raw(&mut self, key: &str, value: impl Display) {
        self.line(format_args!("{} = {value}", bare(key)));
    }

    pub(crate) fn text(&mut self, key: &str, value: &str) {
        self.raw(key, toml::Value::String(value.to_owned()));
    }

    /// Numbers and lists of them, in the shortest form that reads back to the same bits, which is TOML.
    pub(crate) fn debug(&mut self, key: &str, value: impl std::fmt::Debug) {
        self.raw(key, format_args!("{value:?}"));
    }

    pub(crate) fn words(&mut self, key: &str, words: &[String]) {
        let list = words.iter().map(|w| toml::Value::String(w.clone()));
        self.raw(key, toml::Value::Array(list.collect()));
    }

    pub(crate) fn inline<'a>(&mut self, key: &str, pairs: impl Iterator<Item = (&'a str, f64)>) {
        let pairs: Vec<String> = pairs.map(|(k, v)| format!("{} = {v:?}", bare(k))).collect();
        if pairs.is_empty() {
            self.raw(key, "{}");
        } else {
            self.raw(key, format_args!("{{ {} }}", pairs.join(", ")));
        }
    }
}

/// A key, quoted when it has to be.
fn bare(key: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-');
    if !key.is_empty() && key.chars().all(plain) {
        key.to_owned()
    } else {
        toml::Value::String(key.to_owned()).to_string()
    }
}
