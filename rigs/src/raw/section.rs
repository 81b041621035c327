//! One table of a file, read key by key.

mod numbers;
mod words;

pub(crate) use words::is_name;

use std::cell::RefCell;
use std::ops::Range;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::{Document, Problems};
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

    /// The file's name.
    pub(super) fn file(&self) -> &'d str {
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

    fn lookup(&self, key: &str) -> Option<Item<'d>> {
        let value = self.table?.get(key)?;
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
        self.asks(key);
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
        self.asks_for(key, "table", "");
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

    /// The entries of `[[key]]`, at most `most` of them.
    pub(crate) fn tables(&self, key: &str, most: usize) -> Vec<Section<'d>> {
        self.asks_for(key, "table", "");
        let Some(item) = self.item(key) else {
            return Vec::new();
        };
        let expected = format!("a list of tables, each headed [[{}]]", self.path_of(key));
        let Some(elements) = self.elements(&item, &expected) else {
            return Vec::new();
        };
        if elements.len() > most {
            self.report(
                &item,
                ProblemKind::Rule {
                    what: format!("{} entries", elements.len()),
                    next: format!("At most {most} are allowed: leave the others out"),
                },
            );
        }
        elements
            .into_iter()
            .take(most)
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
