//! One table of a file, read key by key.

use std::cell::RefCell;
use std::ops::Range;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::{Document, Problems, Quantity};
use crate::error::{ProblemKind, nearest};

/// A value with its key path and place.
#[derive(Clone)]
pub(crate) struct Item<'d> {
    pub(crate) path: String,
    pub(crate) span: Range<usize>,
    pub(crate) value: &'d DeValue<'d>,
}

/// A table being read. Every reader method notes the key it was asked for, so
/// [`Section::finish`] knows which keys nobody wanted and which names to suggest.
pub(crate) struct Section<'d> {
    document: &'d Document<'d>,
    problems: &'d Problems,
    path: String,
    span: Option<Range<usize>>,
    table: Option<&'d DeTable<'d>>,
    /// A required table that is not there was reported once; its keys are not.
    silent: bool,
    known: RefCell<Vec<String>>,
}

impl<'d> Section<'d> {
    pub(crate) fn root(
        document: &'d Document<'d>,
        table: &'d DeTable<'d>,
        problems: &'d Problems,
    ) -> Self {
        Section {
            document,
            problems,
            path: String::new(),
            span: None,
            table: Some(table),
            silent: false,
            known: RefCell::default(),
        }
    }

    fn child(
        &self,
        path: String,
        span: Option<Range<usize>>,
        table: Option<&'d DeTable<'d>>,
    ) -> Self {
        Section {
            document: self.document,
            problems: self.problems,
            path,
            span,
            table,
            silent: false,
            known: RefCell::default(),
        }
    }

    /// Where problems of this file go.
    pub(crate) fn problems(&self) -> &'d Problems {
        self.problems
    }

    /// Full path of a key of this table.
    pub(crate) fn path_of(&self, key: &str) -> String {
        if self.path.is_empty() {
            key.to_owned()
        } else if key.is_empty() {
            self.path.clone()
        } else {
            format!("{}.{key}", self.path)
        }
    }

    fn lookup(&self, key: &str) -> Option<Item<'d>> {
        let (_, value) = self.table?.iter().find(|(name, _)| name.get_ref() == key)?;
        Some(Item {
            path: self.path_of(key),
            span: value.span(),
            value: value.get_ref(),
        })
    }

    /// The value of `key`, noting that the key is known.
    pub(crate) fn item(&self, key: &str) -> Option<Item<'d>> {
        {
            let mut known = self.known.borrow_mut();
            if !known.iter().any(|k| k == key) {
                known.push(key.to_owned());
            }
        }
        self.lookup(key)
    }

    /// Whether `key` was typed.
    pub(crate) fn has(&self, key: &str) -> bool {
        self.lookup(key).is_some()
    }

    /// All keys with their values in the order typed; marks every key as known.
    pub(crate) fn entries(&self) -> Vec<(String, Item<'d>)> {
        let Some(table) = self.table else {
            return Vec::new();
        };
        let mut keys: Vec<(usize, String)> = table
            .iter()
            .map(|(name, _)| (name.span().start, name.get_ref().to_string()))
            .collect();
        keys.sort();
        keys.into_iter()
            .filter_map(|(_, key)| self.item(&key).map(|item| (key, item)))
            .collect()
    }

    pub(crate) fn report(&self, item: &Item<'_>, kind: ProblemKind) {
        let line = self.document.line(item.span.start);
        self.problems
            .push(self.document.file, Some(line), item.path.clone(), kind);
    }

    /// Reports a broken rule at `key` (empty: the table itself).
    pub(crate) fn rule(&self, key: &str, what: impl Into<String>, next: impl Into<String>) {
        if self.silent {
            return;
        }
        let span = self
            .lookup(key)
            .map(|item| item.span)
            .or_else(|| self.span.clone());
        self.problems.push(
            self.document.file,
            span.map(|s| self.document.line(s.start)),
            self.path_of(key),
            ProblemKind::Rule {
                what: what.into(),
                next: next.into(),
            },
        );
    }

    pub(crate) fn missing(&self, key: &str, expected: impl Into<String>) {
        if self.silent {
            return;
        }
        let line = self.span.as_ref().map(|s| self.document.line(s.start));
        self.problems.push(
            self.document.file,
            line,
            self.path_of(key),
            ProblemKind::Missing {
                expected: expected.into(),
            },
        );
    }

    pub(crate) fn wrong_type(&self, item: &Item<'_>, expected: impl Into<String>) {
        self.report(
            item,
            ProblemKind::WrongType {
                typed: self.typed(item),
                expected: expected.into(),
            },
        );
    }

    pub(crate) fn typed(&self, item: &Item<'_>) -> String {
        match item.value {
            // The span of a table is its header or braces, which says nothing.
            DeValue::Table(_) => "a table".to_owned(),
            _ => self.document.typed(item.span.clone()),
        }
    }

    /// A number within its range.
    pub(crate) fn number_of(&self, item: &Item<'_>, allowed: &Quantity) -> Option<f64> {
        let Some(value) = as_f64(item.value) else {
            self.wrong_type(item, allowed.to_string());
            return None;
        };
        if allowed.contains(value) {
            // TOML knows -0.0; nothing here means anything by its sign.
            return Some(value + 0.0);
        }
        self.report(
            item,
            ProblemKind::OutOfRange {
                typed: self.typed(item),
                allowed: allowed.to_string(),
                hint: allowed.advice(),
            },
        );
        None
    }

    /// A number that may be left out.
    pub(crate) fn number_opt(&self, key: &str, allowed: Quantity) -> Option<f64> {
        self.number_of(&self.item(key)?, &allowed)
    }

    /// A number that must be there.
    pub(crate) fn number(&self, key: &str, allowed: Quantity) -> Option<f64> {
        let Some(item) = self.item(key) else {
            self.missing(key, format!("`{key} = …`, {allowed}"));
            return None;
        };
        self.number_of(&item, &allowed)
    }

    /// A number with a default.
    pub(crate) fn number_or(&self, key: &str, allowed: Quantity, default: f64) -> f64 {
        self.number_opt(key, allowed).unwrap_or(default)
    }

    /// An angle: `stem_rad` or `stem_deg`, range given in degrees, result in radians.
    pub(crate) fn angle_opt(&self, stem: &str, allowed_deg: Quantity) -> Option<f64> {
        let (rad_key, deg_key) = (format!("{stem}_rad"), format!("{stem}_deg"));
        match (self.item(&rad_key), self.item(&deg_key)) {
            (Some(_), Some(deg)) => {
                self.report(
                    &deg,
                    ProblemKind::Rule {
                        what: format!("{rad_key} and {deg_key} are both given"),
                        next: "Keep one of the two".to_owned(),
                    },
                );
                None
            }
            (Some(rad), None) => self.number_of(&rad, &allowed_deg.deg_to_rad()),
            (None, Some(deg)) => self.number_of(&deg, &allowed_deg).map(f64::to_radians),
            (None, None) => None,
        }
    }

    /// An angle that must be there.
    pub(crate) fn angle(&self, stem: &str, allowed_deg: Quantity) -> Option<f64> {
        let value = self.angle_opt(stem, allowed_deg);
        if value.is_none() && !self.has(&format!("{stem}_rad")) && !self.has(&format!("{stem}_deg"))
        {
            self.missing(
                &format!("{stem}_deg"),
                format!("`{stem}_deg = …`, {allowed_deg} (or `{stem}_rad`)"),
            );
        }
        value
    }

    /// A whole number that may be left out.
    pub(crate) fn integer_opt(&self, key: &str, min: i64, max: i64, unit: &str) -> Option<i64> {
        let item = self.item(key)?;
        let allowed = format!("a whole number from {min} to {max} {unit}");
        let Some(value) = as_i64(item.value) else {
            self.wrong_type(&item, allowed.trim_end());
            return None;
        };
        if (min..=max).contains(&value) {
            return Some(value);
        }
        self.report(
            &item,
            ProblemKind::OutOfRange {
                typed: self.typed(&item),
                allowed: allowed.trim_end().to_owned(),
                hint: String::new(),
            },
        );
        None
    }

    /// A whole number that must be there.
    pub(crate) fn integer(&self, key: &str, min: i64, max: i64, unit: &str) -> Option<i64> {
        let value = self.integer_opt(key, min, max, unit);
        if value.is_none() && !self.has(key) {
            let expected = format!("`{key} = …`, a whole number from {min} to {max} {unit}");
            self.missing(key, expected.trim_end());
        }
        value
    }

    /// `true` or `false`, with a default.
    pub(crate) fn flag_or(&self, key: &str, default: bool) -> bool {
        let Some(item) = self.item(key) else {
            return default;
        };
        item.value.as_bool().unwrap_or_else(|| {
            self.wrong_type(&item, "true or false");
            default
        })
    }

    /// A text that may be left out.
    pub(crate) fn text_opt(&self, key: &str, expected: &str) -> Option<(String, Item<'d>)> {
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

    /// One of a list of words that may be left out.
    pub(crate) fn choice_opt<T: Copy>(&self, key: &str, choices: &[(&str, T)]) -> Option<T> {
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
                suggestion: typed.and_then(|t| {
                    let lower = t.to_lowercase();
                    nearest(&lower, choices.iter().map(|(word, _)| *word))
                        .or_else(|| nearest(t, choices.iter().map(|(word, _)| *word)))
                }),
            },
        );
        None
    }

    /// One of a list of words that must be there.
    pub(crate) fn choice<T: Copy>(&self, key: &str, choices: &[(&str, T)]) -> Option<T> {
        let value = self.choice_opt(key, choices);
        if value.is_none() && !self.has(key) {
            let words: Vec<String> = choices.iter().map(|(w, _)| format!("\"{w}\"")).collect();
            self.missing(key, format!("`{key} = …`, one of {}", words.join(", ")));
        }
        value
    }

    /// The elements of a list, each with its own path.
    pub(crate) fn elements(&self, item: &Item<'d>, expected: &str) -> Option<Vec<Item<'d>>> {
        let Some(array) = item.value.as_array() else {
            self.wrong_type(item, expected);
            return None;
        };
        Some(
            array
                .iter()
                .enumerate()
                .map(|(i, element): (usize, &'d Spanned<DeValue<'d>>)| Item {
                    path: format!("{}[{i}]", item.path),
                    span: element.span(),
                    value: element.get_ref(),
                })
                .collect(),
        )
    }

    /// `N` numbers in the same range.
    pub(crate) fn numbers_of<const N: usize>(
        &self,
        item: &Item<'d>,
        allowed: &Quantity,
    ) -> Option<[f64; N]> {
        let expected = format!("a list of {N} numbers, each {allowed}");
        let elements = self.elements(item, &expected)?;
        if elements.len() != N {
            self.wrong_type(item, expected);
            return None;
        }
        let values: Vec<Option<f64>> = elements
            .iter()
            .map(|element| self.number_of(element, allowed))
            .collect();
        let values: Vec<f64> = values.into_iter().collect::<Option<_>>()?;
        values.try_into().ok()
    }

    /// `N` numbers that may be left out.
    pub(crate) fn numbers_opt<const N: usize>(
        &self,
        key: &str,
        allowed: Quantity,
    ) -> Option<[f64; N]> {
        self.numbers_of(&self.item(key)?, &allowed)
    }

    /// `N` numbers that must be there.
    pub(crate) fn numbers<const N: usize>(&self, key: &str, allowed: Quantity) -> Option<[f64; N]> {
        let Some(item) = self.item(key) else {
            self.missing(
                key,
                format!("`{key} = […]`, a list of {N} numbers, each {allowed}"),
            );
            return None;
        };
        self.numbers_of(&item, &allowed)
    }

    /// `[low, high]` with low below high.
    pub(crate) fn interval_opt(&self, key: &str, allowed: Quantity) -> Option<[f64; 2]> {
        let [low, high] = self.numbers_opt(key, allowed)?;
        if low < high {
            return Some([low, high]);
        }
        self.rule(
            key,
            format!("[{low}, {high}] is not an interval"),
            "Enter [lowest, highest] with the lowest first",
        );
        None
    }

    /// A table that may be left out (all its keys then take their defaults).
    pub(crate) fn table_or_default(&self, key: &str) -> Section<'d> {
        let mut section = match self.item(key) {
            Some(item) => match item.value.as_table() {
                Some(table) => self.child(item.path, Some(item.span), Some(table)),
                None => {
                    self.wrong_type(&item, format!("a table [{}]", self.path_of(key)));
                    let mut section = self.child(item.path, None, None);
                    section.silent = true;
                    section
                }
            },
            None => self.child(self.path_of(key), self.span.clone(), None),
        };
        section.silent |= self.silent;
        section
    }

    /// A table that must be there; reported once when it is not.
    pub(crate) fn table(&self, key: &str) -> Section<'d> {
        let mut section = self.table_or_default(key);
        if section.table.is_none() && !section.silent {
            self.missing(key, format!("the table [{}]", self.path_of(key)));
            section.silent = true;
        }
        section
    }

    /// The entries of `[[key]]`.
    pub(crate) fn tables(&self, key: &str) -> Vec<Section<'d>> {
        let Some(item) = self.item(key) else {
            return Vec::new();
        };
        let expected = format!("a list of tables, each headed [[{}]]", self.path_of(key));
        let Some(elements) = self.elements(&item, &expected) else {
            return Vec::new();
        };
        elements
            .into_iter()
            .filter_map(|element| match element.value.as_table() {
                Some(table) => Some(self.child(element.path, Some(element.span), Some(table))),
                None => {
                    self.wrong_type(&element, &*expected);
                    None
                }
            })
            .collect()
    }

    /// A table from an item already in hand.
    pub(crate) fn section_of(&self, item: &Item<'d>) -> Option<Section<'d>> {
        let table = item.value.as_table()?;
        Some(self.child(item.path.clone(), Some(item.span.clone()), Some(table)))
    }

    /// Reports every key that nobody asked for.
    pub(crate) fn finish(&self) {
        let Some(table) = self.table else { return };
        let known = self.known.borrow();
        let mut unknown: Vec<(usize, &str)> = table
            .iter()
            .filter(|(name, _)| !known.iter().any(|k| k == name.get_ref()))
            .map(|(name, _)| (name.span().start, name.get_ref().as_ref()))
            .collect();
        unknown.sort_unstable();
        for (offset, key) in unknown {
            let allowed: Vec<String> = known.clone();
            self.problems.push(
                self.document.file,
                Some(self.document.line(offset)),
                self.path_of(&key.chars().take(80).collect::<String>()),
                ProblemKind::UnknownKey {
                    suggestion: nearest(key, known.iter().map(String::as_str)),
                    allowed,
                },
            );
        }
    }
}

/// Whether `text` may be a name.
pub(crate) fn is_name(text: &str) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.');
    text.len() <= 64
        && text.chars().all(plain)
        && text.starts_with(|c: char| c.is_ascii_alphanumeric())
}

fn as_i64(value: &DeValue<'_>) -> Option<i64> {
    let integer = value.as_integer()?;
    i64::from_str_radix(integer.as_str(), integer.radix()).ok()
}

fn as_f64(value: &DeValue<'_>) -> Option<f64> {
    match value {
        DeValue::Float(float) => float.as_str().parse().ok(),
        DeValue::Integer(integer) if integer.radix() == 10 => integer.as_str().parse().ok(),
        DeValue::Integer(_) => as_i64(value).map(|i| i as f64),
        _ => None,
    }
}
