//! Names, words and flags.

use super::{Item, Section};
use crate::error::{ProblemKind, nearest};

impl<'d> Section<'d> {
    /// `true` or `false`, with a default.
    pub(crate) fn flag_or(&self, key: &str, default: bool) -> bool {
        self.asks_for(key, "true or false", "");
        self.default_is(key, default);
        let Some(item) = self.item(key) else {
            return default;
        };
        item.value.as_bool().unwrap_or_else(|| {
            self.wrong_type(&item, "true or false");
            default
        })
    }

    /// A text that may be omitted.
    pub(crate) fn text_opt(&self, key: &str, expected: &str) -> Option<(String, Item<'d>)> {
        self.asks_for(key, "text", expected);
        let item = self.item(key)?;
        match item.value.as_str() {
            Some(text) => Some((text.to_owned(), item)),
            None => {
                self.wrong_type(&item, expected);
                None
            }
        }
    }

    /// A name: it ends up in file names, topics and tables, so no blanks or slashes.
    pub(crate) fn name(&self, key: &str) -> Option<String> {
        const EXPECTED: &str =
            "a name of 1 to 64 letters, digits, `_`, `-` or `.`, starting with a letter or digit";
        self.asks_for(key, "text", EXPECTED);
        self.requires(key);
        if !self.has(key) {
            self.item(key);
            self.missing(key, format!("`{key} = \"…\"`, {EXPECTED}"));
            return None;
        }
        let (name, item) = self.text_opt(key, EXPECTED)?;
        if is_name(&name) {
            return Some(name);
        }
        self.wrong_type(&item, EXPECTED);
        None
    }

    /// One of a list of words that may be omitted.
    pub(crate) fn choice_opt<T: Copy>(&self, key: &str, choices: &[(&str, T)]) -> Option<T> {
        let words: Vec<String> = choices.iter().map(|(w, _)| format!("`\"{w}\"`")).collect();
        self.asks_for(key, "text", words.join(", "));
        let item = self.item(key)?;
        let typed = item.value.as_str();
        if let Some((_, value)) = choices.iter().find(|(word, _)| Some(*word) == typed) {
            return Some(*value);
        }
        self.report(
            &item,
            ProblemKind::NotOneOf {
                typed: self.typed(&item),
                allowed: choices
                    .iter()
                    .map(|(word, _)| format!("\"{word}\""))
                    .collect(),
                suggestion: typed.and_then(|t| nearest(t, choices.iter().map(|(word, _)| *word))),
            },
        );
        None
    }

    /// One of a list of words that must be there.
    pub(crate) fn choice<T: Copy>(&self, key: &str, choices: &[(&str, T)]) -> Option<T> {
        self.requires(key);
        let value = self.choice_opt(key, choices);
        if value.is_none() && !self.has(key) {
            let words: Vec<String> = choices.iter().map(|(w, _)| format!("\"{w}\"")).collect();
            self.missing(key, format!("`{key} = …`, one of {}", words.join(", ")));
        }
        value
    }
}

/// Whether `text` may be a name.
pub(crate) fn is_name(text: &str) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.');
    text.len() <= 64
        && text.chars().all(plain)
        && text.starts_with(|c: char| c.is_ascii_alphanumeric())
}
