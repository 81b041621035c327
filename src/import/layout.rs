//! Places of names, units and data in a file.

use std::io::{self, Read};

use crate::cells::Splitter;
use crate::check::{Finding, FindingList};
use crate::map::{Column, FileMap, Separator};
use crate::source::Source;
use crate::text::{Format, Lines};
use crate::widths;

/// Bytes that tell the encoding.
const HEAD_BYTES: u64 = 1 << 16;
/// Rows that tell how many cells a row has.
const ROWS_JUDGED: usize = 200;
/// Lines kept for hints where a column is not found.
const LINES_KEPT: usize = 100;

/// Places of names, units and data.
#[derive(Debug, Clone)]
pub(crate) struct Layout {
    pub format: Format,
    pub separator: Separator,
    /// Characters of each column; empty = the separator stands between cells.
    pub widths: Vec<usize>,
    /// Names of the columns; their numbers where the file has none.
    pub header: Vec<String>,
    /// Units of the columns; empty = no line of them.
    pub units: Vec<String>,
    /// Data stand from here on.
    pub first_line: u64,
    /// Cells that most rows have.
    pub usual: usize,
    /// The first lines: (number, text).
    head: Vec<(u64, String)>,
    decimal: char,
}

/// Separator that a spreadsheet's first line `sep=;` states.
fn separator_line(number: u64, line: &str) -> Option<Separator> {
    let word = line.trim_matches(|c| c == '"' || c == ' ');
    let rest = word.get(..4).filter(|w| w.eq_ignore_ascii_case("sep="))?;
    match word.as_bytes()[rest.len()..] {
        [b] if number == 1 => Some(Separator::Byte(b)),
        [] if number == 1 => Some(Separator::Byte(b'\t')),
        _ => None,
    }
}

/// Whether a line holds nothing of the table.
pub(crate) fn is_aside(file: &FileMap, line: &str) -> bool {
    let comment = file.comment.as_deref();
    line.trim().is_empty() || comment.is_some_and(|c| line.trim_start().starts_with(c))
}

/// Names that are listed in a message, and characters of each: a message is read.
const NAMES_MAX: usize = 40;
const NAME_MAX: usize = 40;

/// A cell as a message shows it: one that is no text is not shown.
pub(crate) fn shown(cell: &str) -> String {
    if cell.contains(|c: char| c.is_control() || c == '\u{fffd}') {
        return "(no text)".to_owned();
    }
    match cell.char_indices().nth(NAME_MAX) {
        Some((end, _)) => format!("{}...", &cell[..end]),
        None => cell.to_owned(),
    }
}

/// Names of columns as a message lists them.
pub(crate) fn listed<S: AsRef<str>>(names: &[S]) -> String {
    let mut words: Vec<String> = names
        .iter()
        .take(NAMES_MAX)
        .map(|n| shown(n.as_ref()))
        .collect();
    let more = names.len().saturating_sub(NAMES_MAX);
    if more > 0 {
        words.push(format!("and {more} more"));
    }
    words.join(" | ")
}

impl Layout {
    /// Looks at the beginning of a file.
    pub fn find(source: &(impl Source + ?Sized), file: &FileMap) -> io::Result<Layout> {
        let mut head = Vec::new();
        source.open()?.take(HEAD_BYTES).read_to_end(&mut head)?;
        let format = Format::of(&head, file.encoding);
        let mut lines = Lines::new(source.open()?, format)?;
        let mut layout = Layout {
            format,
            separator: file.separator.unwrap_or(Separator::Byte(b',')),
            widths: file.widths.clone(),
            header: Vec::new(),
            units: Vec::new(),
            first_line: file.first_line.unwrap_or(1),
            usual: 0,
            head: Vec::new(),
            decimal: file.decimal,
        };
        let mut splitter = Splitter::of(layout.separator, &file.widths);
        let (mut named, mut counts) = (!file.header, Vec::<usize>::new());
        while let Some((number, line)) = lines.next_line()? {
            if layout.head.len() < LINES_KEPT {
                layout
                    .head
                    .push((number, line.chars().take(2000).collect()));
            }
            if let Some(separator) = separator_line(number, line) {
                layout.separator = file.separator.unwrap_or(separator);
                splitter = Splitter::of(layout.separator, &file.widths);
                layout.first_line = layout.first_line.max(number + 1);
                continue;
            }
            let cells = splitter.split(line);
            let own = || {
                if file.widths.is_empty() {
                    cells.iter().map(str::to_owned).collect()
                } else {
                    widths::names(line, &file.widths)
                }
            };
            // A line that the map names is taken even if it begins like a comment.
            let is_header = match file.header_line {
                Some(stated) => number == stated,
                None => !named && !is_aside(file, line),
            };
            if file.header && is_header {
                layout.header = own();
                named = true;
                layout.first_line = layout.first_line.max(number + 1);
            } else if file.units_line == Some(number) {
                layout.units = own();
                layout.first_line = layout.first_line.max(number + 1);
            } else if named
                && number >= layout.first_line.max(file.units_line.unwrap_or(0))
                && !is_aside(file, line)
            {
                counts.push(cells.len());
                if counts.len() == ROWS_JUDGED {
                    break;
                }
            }
        }
        counts.sort_unstable();
        let runs = counts.chunk_by(|a, b| a == b);
        layout.usual = runs.max_by_key(|r| r.len()).map_or(0, |r| r[0]);
        if !file.header {
            layout.header = (1..=layout.usual).map(|n| n.to_string()).collect();
        }
        Ok(layout)
    }

    /// Division of a line into cells, for messages.
    fn between(&self) -> String {
        if self.widths.is_empty() {
            format!("separator '{}'", self.separator)
        } else {
            widths::words(&self.widths)
        }
    }

    /// Widths of the columns where blanks separate them and a line of so many characters has all of them: its numbers run together.
    pub fn run_together(&self, characters: usize) -> Option<Vec<usize>> {
        if self.separator != Separator::Blanks || !self.widths.is_empty() {
            return None;
        }
        let data = self.head.iter().filter(|l| l.0 >= self.first_line);
        let seen = widths::seen(data.map(|l| l.1.as_str()), self.usual)?;
        (seen.iter().sum::<usize>() == characters).then_some(seen)
    }

    /// Cells beyond this one belong to no column.
    pub fn width(&self) -> usize {
        self.header.len()
    }

    /// Findings about columns that are dropped: cells beyond the header, names beyond the rows.
    pub fn notes(&self) -> Vec<Finding> {
        let mut notes = Vec::new();
        let width = self.width();
        if self.usual > width && width > 0 {
            notes.info(
                "empty_columns",
                format!(
                    "rows have {} cells, the header {width}: those beyond it are empty and dropped",
                    self.usual
                ),
            );
        } else if self.usual < width && self.usual > 0 {
            let named: Vec<&str> = self.header[self.usual..]
                .iter()
                .map(String::as_str)
                .filter(|n| !n.is_empty())
                .collect();
            let words = if named.is_empty() {
                "the header ends in names that are empty".to_owned()
            } else {
                format!("'{}' stands in no row", listed(&named))
            };
            notes.info(
                "empty_columns",
                format!(
                    "the header has {width} names, rows {} cells: {words}, dropped",
                    self.usual
                ),
            );
        }
        notes
    }

    /// The place of a column from 0; a finding where it is not there or not one.
    pub fn place(&self, column: &Column, key: &str, findings: &mut Vec<Finding>) -> Option<usize> {
        let (name, nth) = match column {
            Column::Number(n) => {
                let there = self.width().max(self.usual);
                if *n > there {
                    findings.fault(
                        "column_missing",
                        format!(
                            "{key}: no column {n}, there are {there}; {}",
                            self.between()
                        ),
                    );
                    return None;
                }
                return Some(n - 1);
            }
            Column::Name { name, nth } => (name, nth),
        };
        let places: Vec<usize> = (0..self.width())
            .filter(|i| self.header[*i] == *name)
            .collect();
        match (places.as_slice(), nth) {
            ([one], None) => Some(*one),
            (several, Some(n)) if (1..=several.len()).contains(n) => several.get(n - 1).copied(),
            ([], _) => {
                findings.fault(
                    "column_missing",
                    format!(
                        "{key}: no column '{name}' in the header ({}); {}{}",
                        listed(&self.header),
                        self.between(),
                        self.hint(name)
                    ),
                );
                None
            }
            (several, Some(n)) => {
                findings.fault(
                    "column_missing",
                    format!(
                        "{key}: nth = {n}, but the header has {} columns '{name}'",
                        several.len()
                    ),
                );
                None
            }
            (several, None) => {
                let numbers: Vec<String> = several.iter().map(|i| (i + 1).to_string()).collect();
                findings.fault(
                    "column_twice",
                    format!(
                        "{key}: the header has {} columns '{name}' (numbers {}); say which with nth = 1 .. {}, or give the number as column",
                        several.len(),
                        numbers.join(", "),
                        several.len(),
                    ),
                );
                None
            }
        }
    }

    /// Hint at the line or separator that has the name, if the header has not.
    fn hint(&self, name: &str) -> String {
        let separators = [b',', b';', b'\t']
            .map(Separator::Byte)
            .into_iter()
            .chain([Separator::Blanks])
            .filter(|s| *s != Separator::Byte(self.decimal as u8));
        for separator in [self.separator].into_iter().chain(separators) {
            let mut splitter = Splitter::new(separator);
            let holds = |l: &&(u64, String)| splitter.split(&l.1).iter().any(|c| c == name);
            if let Some((number, _)) = self.head.iter().find(holds) {
                return if separator == self.separator {
                    format!("; line {number} has it: [file] header_line = {number}?")
                } else {
                    format!("; with separator = \"{separator}\" line {number} has it")
                };
            }
        }
        "; `hydroline import --guess FILE` proposes a map".to_owned()
    }
}
