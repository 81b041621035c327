//! One table of a file, read key by key.

use std::cell::RefCell;
use std::ops::Range;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::{Document, Problems, Quantity};
use crate::error::{ProblemKind, nearest};

/// Keys of a free-form table (effect parameters, thrust per thruster).
const MOST_KEYS: usize = 256;

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
    /// The keys before all tables.
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

    /// A table below; `None` = all its keys are left out.
    fn child(
        &self,
        path: String,
        span: Option<Range<usize>>,
        table: Option<&'d DeTable<'d>>,
    ) -> Self {
        Section {
            path,
            span,
            table,
            silent: self.silent,
            known: RefCell::default(),
            ..*self
        }
    }

    pub(crate) fn file(&self) -> &'d str {
        self.document.file
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

    /// `key` of this table, or of one below it: `table.key`, `list[2].key`.
    fn lookup(&self, key: &str) -> Option<Item<'d>> {
        let table = self.table?;
        let value = match table.get(key) {
            Some(value) => value,
            None => below(table, key)?,
        };
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
        if table.len() > MOST_KEYS {
            self.rule(
                "",
                format!("{} keys in one table", table.len()),
                format!("At most {MOST_KEYS} are read"),
            );
        }
        let mut keys: Vec<(usize, &str)> = table
            .iter()
            .map(|(name, _)| (name.span().start, name.get_ref().as_ref()))
            .collect();
        keys.sort_unstable();
        keys.into_iter()
            .take(MOST_KEYS)
            .filter_map(|(_, key)| {
                // Free names: they are none of the file's keys.
                self.known.borrow_mut().push(key.to_owned());
                self.lookup(key).map(|item| (key.to_owned(), item))
            })
            .collect()
    }

    fn push(&self, span: Option<&Range<usize>>, path: String, kind: ProblemKind) {
        let line = span.map(|s| self.document.line(s.start));
        self.problems.push(self.document.file, line, path, kind);
    }

    pub(crate) fn report(&self, item: &Item<'_>, kind: ProblemKind) {
        self.push(Some(&item.span), item.path.clone(), kind);
    }

    /// Reports a broken rule at `key` (empty: the table itself).
    pub(crate) fn rule(&self, key: &str, what: impl Into<String>, next: impl Into<String>) {
        if self.silent {
            return;
        }
        let item = self.lookup(key);
        let span = item.as_ref().map(|item| &item.span).or(self.span.as_ref());
        let (what, next) = (what.into(), next.into());
        self.push(span, self.path_of(key), ProblemKind::Rule { what, next });
    }

    /// Reports a broken rule at an item in hand.
    pub(crate) fn rule_at(&self, item: &Item<'_>, what: String, next: &str) {
        let next = next.to_owned();
        self.report(item, ProblemKind::Rule { what, next });
    }

    pub(crate) fn missing(&self, key: &str, expected: impl Into<String>) {
        if !self.silent {
            let expected = expected.into();
            let kind = ProblemKind::Missing { expected };
            self.push(self.span.as_ref(), self.path_of(key), kind);
        }
    }

    pub(crate) fn wrong_type(&self, item: &Item<'_>, expected: impl Into<String>) {
        let (typed, expected) = (self.typed(item), expected.into());
        self.report(item, ProblemKind::WrongType { typed, expected });
    }

    pub(crate) fn typed(&self, item: &Item<'_>) -> String {
        match item.value {
            // The span of a table is its header or braces, which says nothing.
            DeValue::Table(_) => "a table".to_owned(),
            _ => self.document.typed(item.span.clone()),
        }
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

    /// A table that may be omitted (all its keys then take their defaults).
    pub(crate) fn table_or_default(&self, key: &str) -> Section<'d> {
        let Some(item) = self.item(key) else {
            return self.child(self.path_of(key), self.span.clone(), None);
        };
        self.section_of(&item).unwrap_or_else(|| {
            self.wrong_type(&item, format!("a table [{}]", self.path_of(key)));
            let mut section = self.child(item.path, None, None);
            section.silent = true;
            section
        })
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

    /// The entries of `[[key]]`, at most `most` of them.
    pub(crate) fn tables(&self, key: &str, most: usize) -> Vec<Section<'d>> {
        let Some(item) = self.item(key) else {
            return Vec::new();
        };
        let expected = format!("a list of tables, each headed [[{}]]", self.path_of(key));
        let Some(elements) = self.elements(&item, &expected) else {
            return Vec::new();
        };
        if elements.len() > most {
            let next = format!("At most {most} are allowed: leave the others out");
            self.rule_at(&item, format!("{} entries", elements.len()), &next);
        }
        elements
            .into_iter()
            .take(most)
            .filter_map(|element| {
                let section = self.section_of(&element);
                if section.is_none() {
                    self.wrong_type(&element, &*expected);
                }
                section
            })
            .collect()
    }

    /// A table from an item already in hand.
    pub(crate) fn section_of(&self, item: &Item<'d>) -> Option<Section<'d>> {
        let table = item.value.as_table()?;
        Some(self.child(item.path.clone(), Some(item.span.clone()), Some(table)))
    }

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
            let kind = ProblemKind::UnknownKey {
                suggestion: nearest(key, known.iter().map(String::as_str)),
                allowed: known.clone(),
            };
            let path = self.path_of(&key.chars().take(80).collect::<String>());
            self.push(Some(&(offset..offset)), path, kind);
        }
    }
}

/// The value at a path of names and places in lists.
fn below<'d>(table: &'d DeTable<'d>, path: &str) -> Option<&'d Spanned<DeValue<'d>>> {
    let (above, last) = path.rsplit_once('.')?;
    let (name, place) = match above.strip_suffix(']').and_then(|a| a.split_once('[')) {
        Some((name, place)) => (name, Some(place.parse::<usize>().ok()?)),
        None => (above, None),
    };
    let value = match table.get(name) {
        Some(value) => value,
        None => below(table, name)?,
    };
    let value = match place {
        Some(place) => value.get_ref().as_array()?.get(place)?,
        None => value,
    };
    value.get_ref().as_table()?.get(last)
}

/// A whole number of any notation.
pub(crate) fn as_i64(value: &DeValue<'_>) -> Option<i64> {
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
