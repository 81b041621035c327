//! TOML text, key by key, in the order and form a person would write it.

use std::fmt::{Display, Write};

/// Collects TOML text.
#[derive(Default)]
pub(super) struct Writer(String);

impl Writer {
    pub(super) fn table(&mut self, path: &str) {
        self.head(format_args!("[{path}]"));
    }

    pub(super) fn entry(&mut self, path: &str) {
        self.head(format_args!("[[{path}]]"));
    }

    fn head(&mut self, head: impl Display) {
        if !self.0.is_empty() {
            self.0.push('\n');
        }
        self.line(head);
    }

    fn line(&mut self, line: impl Display) {
        // Writing into a String cannot fail.
        let _ = writeln!(self.0, "{line}");
    }

    /// Integers and booleans.
    pub(super) fn raw(&mut self, key: &str, value: impl Display) {
        self.line(format_args!("{} = {value}", bare(key)));
    }

    pub(super) fn number(&mut self, key: &str, value: f64) {
        // {:?} is the shortest text that reads back to the same bits, and is TOML.
        self.raw(key, format_args!("{value:?}"));
    }

    pub(super) fn text(&mut self, key: &str, value: &str) {
        self.raw(key, toml::Value::String(value.to_owned()));
    }

    pub(super) fn numbers(&mut self, key: &str, values: &[f64]) {
        self.raw(key, format_args!("{values:?}"));
    }

    pub(super) fn words(&mut self, key: &str, words: &[String]) {
        let list = words.iter().map(|w| toml::Value::String(w.clone()));
        self.raw(key, toml::Value::Array(list.collect()));
    }

    pub(super) fn pairs(&mut self, key: &str, pairs: &[[f64; 2]]) {
        self.raw(key, format_args!("{pairs:?}"));
    }

    pub(super) fn rows(&mut self, key: &str, rows: &[Vec<f64>]) {
        self.raw(key, format_args!("{rows:?}"));
    }

    pub(super) fn inline<'a>(&mut self, key: &str, pairs: impl Iterator<Item = (&'a str, f64)>) {
        let pairs: Vec<String> = pairs.map(|(k, v)| format!("{} = {v:?}", bare(k))).collect();
        if pairs.is_empty() {
            self.raw(key, "{}");
        } else {
            self.raw(key, format_args!("{{ {} }}", pairs.join(", ")));
        }
    }

    pub(super) fn finish(self) -> String {
        self.0
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
