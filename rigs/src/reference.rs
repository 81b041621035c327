//! Every key of rig and plan files, for the book: the tables as they are declared, in words.

use crate::raw::{Columns, Table as Declared};
use crate::{Plan, Rig};

/// A key of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Key {
    /// As written; of an angle both names, joined by ` or `.
    pub names: Vec<String>,
    /// Type, in words.
    pub kind: String,
    /// Unit; "" = none.
    pub unit: &'static str,
    /// Allowed values; "" = any of the type.
    pub allowed: String,
    /// Value when it is left out, and whether it may be.
    pub default: Default,
    /// Meaning: the first paragraph of the doc comment of its row.
    pub meaning: String,
}

/// Meaning of a key that is left out.
#[derive(Debug, Clone, PartialEq)]
pub enum Default {
    /// The file is refused.
    Required,
    /// Nothing is assumed; the meaning says what that means.
    None,
    /// It has this value.
    Value(String),
}

/// A table of a file with its keys.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// Its head as written, `[camera]`; of several tables with the same keys all heads.
    pub heads: Vec<String>,
    /// Meaning: the first paragraph of the doc comment of its struct.
    pub meaning: String,
    /// Its keys.
    pub keys: Vec<Key>,
}

/// Tables of a rig file.
pub fn rig() -> Vec<Table> {
    let mut tables = Vec::new();
    Described::file::<Rig>(&mut tables);
    tables
}

/// Tables of a plan file; the first has the keys that stand before all tables.
pub fn plan() -> Vec<Table> {
    let mut tables = Vec::new();
    Described::file::<Plan>(&mut tables);
    tables
}

/// The table that is being described, among those of its file.
pub(crate) struct Described<'t> {
    tables: &'t mut Vec<Table>,
    /// Place of the table that is described.
    at: usize,
    /// Its path, `[]` after a list of tables; "" = before all tables.
    path: String,
    /// Whether the last row was a key, not a table.
    last_is_key: bool,
}

impl Described<'_> {
    fn file<T: Declared>(tables: &mut Vec<Table>) {
        let root = Table {
            heads: Vec::new(),
            meaning: first_paragraph(T::ABOUT),
            keys: Vec::new(),
        };
        tables.push(root);
        T::describe_keys(&mut Described {
            tables,
            at: 0,
            path: String::new(),
            last_is_key: false,
        });
        tables.retain(|t| !(t.heads.is_empty() && t.keys.is_empty()));
    }

    /// Adds a key that must be there.
    pub(crate) fn key(&mut self, names: Vec<String>, columns: Columns, about: &str) {
        self.last_is_key = true;
        self.tables[self.at].keys.push(Key {
            names,
            kind: columns.kind,
            unit: columns.unit,
            allowed: columns.allowed,
            default: Default::Required,
            meaning: first_paragraph(about),
        });
    }

    /// Sets the default of the key added last; `None` = nothing is assumed. Of tables their own words say it.
    pub(crate) fn left_out_is(&mut self, said: Option<&str>) {
        let key = self.tables[self.at].keys.last_mut();
        if let Some(key) = key.filter(|_| self.last_is_key) {
            key.default = said.map_or(Default::None, |s| Default::Value(s.to_owned()));
        }
    }

    /// Whether a key of this name was added.
    pub(crate) fn has(&self, name: &str) -> bool {
        let keys = &self.tables[self.at].keys;
        keys.iter().any(|k| k.names.iter().any(|n| n == name))
    }

    /// Adds a table below this one, `[]` after the name of a list of tables. The same table as the one before is
    /// another head of that.
    pub(crate) fn table<T: Declared>(&mut self, name: &str, keys: impl FnOnce(&mut Described<'_>)) {
        self.last_is_key = false;
        let path = match self.path.as_str() {
            "" => name.to_owned(),
            above => format!("{above}.{name}"),
        };
        let head = path.replace("[]", "");
        let head = match path.ends_with("[]") {
            true => format!("[[{head}]]"),
            false => format!("[{head}]"),
        };
        let at = self.tables.len();
        self.tables.push(Table {
            heads: vec![head],
            meaning: first_paragraph(T::ABOUT),
            keys: Vec::new(),
        });
        keys(&mut Described {
            tables: self.tables,
            at,
            path,
            last_is_key: false,
        });
        let (before, new) = self.tables.split_at_mut(at);
        if let (Some(before), [new]) = (before.last_mut(), new)
            && (&before.meaning, &before.keys) == (&new.meaning, &new.keys)
        {
            before.heads.append(&mut new.heads);
            self.tables.pop();
        }
    }
}

/// The first paragraph of a doc comment, on one line.
fn first_paragraph(about: &str) -> String {
    let lines = about.lines().map(str::trim);
    let lines: Vec<&str> = lines.take_while(|line| !line.is_empty()).collect();
    lines.join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_key_and_table_has_a_meaning_and_every_key_a_type() {
        let tables = [rig(), plan()].concat();
        assert!(tables.iter().map(|t| t.keys.len()).sum::<usize>() > 140);
        for table in tables {
            assert!(!table.meaning.is_empty(), "{:?}", table.heads);
            for key in table.keys {
                assert!(
                    !key.meaning.is_empty() && !key.kind.is_empty(),
                    "{:?}.{:?}",
                    table.heads,
                    key.names
                );
            }
        }
    }
}
