//! Tables: names in the first column, numbers and words in the others.

use super::Inline;
use crate::colour::Colour;
use crate::markup::Element;

/// Share of the full colour behind a number: letters stay readable on it, black ones and on a dark screen white ones.
const BEHIND_LETTERS: f64 = 0.5;

/// Longest words of a cell that stand on one line \[characters\]: an interval with both its ends. A number is not broken at
/// its minus sign, nor a value from its unit.
const ONE_LINE: usize = 32;

/// From so many columns on a table is set smaller on paper: a sheet of A4 holds no more numbers of four digits beside
/// their names, and a browser would shrink the whole page.
const MANY_COLUMNS: usize = 12;

/// A table.
#[derive(Debug, Clone)]
pub struct Table {
    head: Vec<Inline>,
    rows: Vec<Row>,
}

/// A row, cells from the left.
#[derive(Debug, Clone, Default)]
pub struct Row {
    cells: Vec<Value>,
    warns: bool,
}

/// Cell of a table.
#[derive(Debug, Clone)]
pub struct Value {
    words: Inline,
    hint: String,
    columns: usize,
    /// Colour and opacity.
    background: Option<(Colour, f64)>,
    class: &'static str,
}

impl Table {
    /// A table without a row; `head` names its columns, with their unit where all of a column share it.
    pub fn new(head: impl IntoIterator<Item = impl Into<Inline>>) -> Self {
        Table {
            head: head.into_iter().map(Into::into).collect(),
            rows: Vec::new(),
        }
    }

    /// Adds a row.
    pub fn row(&mut self, cells: impl IntoIterator<Item = impl Into<Value>>) {
        self.push(Row::new(cells));
    }

    /// Adds a row that was made before.
    pub fn push(&mut self, row: Row) {
        let columns: usize = row.cells.iter().map(|c| c.columns).sum();
        debug_assert_eq!(columns, self.head.len(), "cells of a row");
        self.rows.push(row);
    }

    /// The table, unless it has no row.
    pub(super) fn element(self) -> Option<Element> {
        if self.rows.is_empty() {
            return None;
        }
        let columns = self.head.len();
        let mut head = Element::new("tr");
        for words in self.head {
            head.push(words.within("th"));
        }
        let table = Element::new("table");
        let mut table = match columns {
            ..MANY_COLUMNS => table,
            _ => table.class("many"),
        };
        table.push_line(head);
        for row in self.rows {
            table.push_line(row.element());
        }
        Some(table)
    }
}

impl Row {
    /// A row.
    pub fn new(cells: impl IntoIterator<Item = impl Into<Value>>) -> Self {
        Row {
            cells: cells.into_iter().map(Into::into).collect(),
            warns: false,
        }
    }

    /// Adds a cell at the right.
    #[must_use]
    pub fn cell(mut self, value: impl Into<Value>) -> Self {
        self.cells.push(value.into());
        self
    }

    /// Marks the row where `warns` holds.
    #[must_use]
    pub fn warning_if(mut self, warns: bool) -> Self {
        self.warns = warns;
        self
    }

    fn element(self) -> Element {
        let mut row = Element::new("tr");
        if self.warns {
            row = row.class("warning");
        }
        for value in self.cells {
            row.push(value.element());
        }
        row
    }
}

impl Value {
    /// Words that the pointer shows over the cell.
    #[must_use]
    pub fn hint(mut self, words: &str) -> Self {
        words.clone_into(&mut self.hint);
        self
    }

    /// Takes the room of several columns.
    #[must_use]
    pub fn across(mut self, columns: usize) -> Self {
        self.columns = columns.max(1);
        self
    }

    /// Colours the cell by a number between −1 (blue) and 1 (red).
    #[must_use]
    pub fn shaded(mut self, share: f64) -> Self {
        self.background = Some(Colour::diverging(BEHIND_LETTERS * share.clamp(-1.0, 1.0)));
        self
    }

    /// Sentences rather than a number: set from the left.
    #[must_use]
    pub fn prose(mut self) -> Self {
        self.class = "prose";
        self
    }

    /// Lines that are not to be broken, such as formulas.
    #[must_use]
    pub fn unbroken(mut self) -> Self {
        self.class = "unbroken";
        self
    }

    fn element(self) -> Element {
        let long = self.words.longest() > ONE_LINE;
        let mut cell = self.words.within("td");
        match self.class {
            "" if long => cell = cell.class("long"),
            "" => {}
            class => cell = cell.class(class),
        }
        if self.columns > 1 {
            cell = cell.with("colspan", self.columns);
        }
        if !self.hint.is_empty() {
            cell = cell.with("title", &self.hint);
        }
        if let Some((Colour([red, green, blue]), opacity)) = self.background {
            let rgb = format_args!("background:rgba({red},{green},{blue},{opacity:.3})");
            cell = cell.with("style", rgb);
        }
        cell
    }
}

impl<T: Into<Inline>> From<T> for Value {
    fn from(words: T) -> Self {
        Value {
            words: words.into(),
            hint: String::new(),
            columns: 1,
            background: None,
            class: "",
        }
    }
}
