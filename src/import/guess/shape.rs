//! Places of names, units and data in a table of no known kind.

use hydroline_log::foreign::CONTROL_SEPARATORS;

use super::head::Head;
use super::stats::Stats;
use crate::cells::Splitter;
use crate::map::{FileMap, Separator};
use crate::number::{number, says_nothing, surely_grouped_by};
use crate::{stamp, unit, widths};

mod unit_text;
pub(super) use unit_text::is_unit;

/// Marks at the beginning of a line of notes.
const COMMENTS: [&str; 4] = ["#", "%", "//", ";"];
/// Rows of data that tell the separator.
const ROWS_JUDGED: usize = 200;

/// One column of the table.
#[derive(Debug, Clone, Default)]
pub(super) struct Named {
    /// As the header has it; empty = none.
    pub name: String,
    /// Text above the name: a marker, a body, a kind of value.
    pub group: String,
    /// Its unit, as the file writes it.
    pub unit: Option<String>,
}

#[derive(Debug, Clone)]
pub(super) struct Shape {
    pub kind: &'static str,
    pub file: FileMap,
    pub columns: Vec<Named>,
    /// Names in the file are no keys (none, or others than the columns): columns go by number.
    pub by_number: bool,
    /// Rows per second, where the file states it.
    pub rate_hz: Option<f64>,
    /// Units that the kind of file has where it writes none.
    pub units: Defaults,
    pub remarks: Vec<String>,
    /// Messages that unlabelled columns may be of: they are proposed, none is chosen.
    pub open: Vec<Proposal>,
}

/// A message that unlabelled columns may be of.
#[derive(Debug, Clone)]
pub(super) struct Proposal {
    pub message: &'static str,
    /// Keys of the map's tables, unit, column.
    pub tables: Vec<(String, &'static str, usize)>,
}

/// Units and axes of a kind of file where the file states none.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Defaults {
    /// For lengths and speeds.
    pub length: Option<&'static str>,
    /// For angles and rates.
    pub angle: Option<&'static str>,
    /// y stands up.
    pub y_up: bool,
    /// The length's unit stands in the file.
    pub stated: bool,
}

impl Shape {
    pub fn title(&self) -> String {
        format!("map guessed by hydroline from {}", self.kind)
    }

    /// As many columns as rows have cells.
    pub fn complete(&mut self, stats: &Stats) {
        self.columns.resize(
            stats.columns.len().max(self.columns.len()),
            Named::default(),
        );
        let empty = stats.columns.len();
        self.columns.truncate(empty);
    }

    /// A column as the map names it.
    pub fn key(&self, index: usize) -> String {
        let own = &self.columns[index].name;
        let same: Vec<usize> = (0..self.columns.len())
            .filter(|i| self.columns[*i].name == *own)
            .collect();
        if self.by_number || own.is_empty() {
            return format!("column = {}", index + 1);
        }
        let name = super::file::quoted(own);
        match same.iter().position(|i| *i == index) {
            Some(place) if same.len() > 1 => format!("column = {name}\nnth = {}", place + 1),
            _ => format!("column = {name}"),
        }
    }

    /// A column as reported.
    pub fn words(&self, index: usize) -> String {
        let Named { name, group, .. } = &self.columns[index];
        match (group.is_empty(), name.is_empty()) {
            (true, true) => format!("column {}", index + 1),
            (true, false) => format!("column '{name}'"),
            (false, _) => format!("column '{name}' of '{group}'"),
        }
    }
}

pub(super) fn file(head: &Head, separator: Separator, decimal: char) -> FileMap {
    FileMap {
        separator: Some(separator),
        decimal,
        encoding: head.encoding,
        ..FileMap::plain()
    }
}

pub(super) fn cells(separator: Separator, line: &str) -> Vec<String> {
    Splitter::new(separator)
        .split(line)
        .iter()
        .map(str::to_owned)
        .collect()
}

/// Numbers, with their thousands set apart or not.
fn is_number(cell: &str, decimal: char) -> bool {
    number(cell, decimal).is_some() || surely_grouped_by(cell, decimal).is_some()
}

/// Numbers and words of a line.
fn count(cells: &[String], decimal: char) -> (usize, usize) {
    let numbers = cells.iter().filter(|c| is_number(c, decimal)).count();
    let is_word =
        |c: &&String| !c.is_empty() && !is_number(c, decimal) && !is_stamp(c) && !says_nothing(c);
    (numbers, cells.iter().filter(is_word).count())
}

/// Digits with signs between them, as dates and clocks have.
fn is_stamp(cell: &str) -> bool {
    let with_signs = cell.contains([':', '/', '-'])
        && cell.starts_with(|c: char| c.is_ascii_digit())
        && cell.chars().filter(char::is_ascii_digit).count() >= 4;
    with_signs || stamp::parse(cell).is_some()
}

/// A line of the head: number, cells, and whether it is a note.
type Row = (u64, Vec<String>, bool);

/// Columns in which nearly every one of the last rows holds a number or a stamp.
fn filled(rows: &[Row], decimal: char) -> Vec<usize> {
    let judged: Vec<&Vec<String>> = rows
        .iter()
        .rev()
        .filter(|r| !r.2)
        .take(ROWS_JUDGED)
        .map(|r| &r.1)
        .collect();
    let width = judged.iter().map(|r| r.len()).max().unwrap_or(0);
    let holds = |row: &Vec<String>, i: usize| {
        row.get(i)
            .is_some_and(|c| is_number(c, decimal) || is_stamp(c))
    };
    (0..width)
        .filter(|i| {
            let without = judged.iter().filter(|r| !holds(r, *i)).count();
            20 * without <= judged.len()
        })
        .collect()
}

/// Whether a row is one of data, however little it holds: where columns of numbers are, it has numbers or nothing.
fn is_sparse_data(row: &[String], filled: &[usize], decimal: char) -> bool {
    let cells = filled.iter().filter_map(|i| row.get(*i));
    let (mut values, mut words) = (0, 0);
    for cell in cells {
        if is_number(cell, decimal) || is_stamp(cell) {
            values += 1;
        } else if !says_nothing(cell) {
            words += 1;
        }
    }
    values > 0 && words == 0
}

/// Widths of a table of blanks in which numbers run together: some lines have fewer cells than the others and are as long.
fn run_together(head: &Head, rows: &[Row], cells: usize) -> Option<Vec<usize>> {
    let lines = || rows.iter().filter(|r| !r.2).map(|r| head.line(r.0));
    let seen = widths::seen(lines(), cells)?;
    let all = seen.iter().sum::<usize>();
    let together = rows
        .iter()
        .filter(|r| !r.2 && r.1.len() < cells)
        .any(|r| head.line(r.0).trim_end().chars().count() == all);
    together.then_some(seen)
}

fn is_note(line: &str) -> bool {
    line.trim().is_empty() || COMMENTS.iter().any(|c| line.trim_start().starts_with(c))
}

/// Separator and decimal sign under which most cells are numbers.
fn separator(lines: &[(u64, String)]) -> Option<(Separator, char)> {
    let data: Vec<&str> = lines
        .iter()
        .rev()
        .map(|l| l.1.as_str())
        .filter(|l| !is_note(l))
        .take(ROWS_JUDGED)
        .collect();
    let mut best: Option<(f64, Separator, char)> = None;
    for byte in [b',', b';', b'\t', b'|', b' ']
        .into_iter()
        .chain(CONTROL_SEPARATORS)
    {
        for decimal in ['.', ','] {
            if byte == decimal as u8 {
                continue;
            }
            let separator = if byte == b' ' {
                Separator::Blanks
            } else {
                Separator::Byte(byte)
            };
            let rows: Vec<Vec<String>> = data.iter().map(|l| cells(separator, l)).collect();
            let mut widths: Vec<usize> = rows.iter().map(Vec::len).collect();
            widths.sort_unstable();
            let usual = widths.get(widths.len() / 2).copied().unwrap_or(0);
            let score: f64 = rows
                .iter()
                .map(|r| {
                    let (numbers, words) = count(r, decimal);
                    let even = if r.len() == usual { 1.0 } else { -1.0 };
                    even * (numbers as f64 - 0.5 * words as f64)
                })
                .sum();
            // A decimal comma must be seen to be one.
            let shown = decimal == '.' || data.iter().any(|l| l.contains(','));
            if shown && usual >= 2 && score > best.map_or(0.0, |b| b.0 * 1.001) {
                best = Some((score, separator, decimal));
            }
        }
    }
    best.map(|(_, separator, decimal)| (separator, decimal))
}

/// A table of names, perhaps units, and rows.
pub(super) fn plain(head: &Head) -> Option<Shape> {
    let (separator, decimal) = separator(&head.lines)?;
    let mut file = file(head, separator, decimal);
    let rows: Vec<Row> = head
        .lines
        .iter()
        .map(|(n, l)| (*n, cells(separator, l), is_note(l)))
        .collect();
    let like_data = |row: &[String]| {
        let (numbers, words) = count(row, decimal);
        let stamps = row.iter().any(|c| is_stamp(c));
        numbers + usize::from(stamps) >= 1 && 2 * numbers + usize::from(stamps) > words
    };
    // Data reach to the end: their first row is after the last line that is none.
    let mut widths: Vec<usize> = rows
        .iter()
        .rev()
        .filter(|r| !r.2)
        .take(ROWS_JUDGED)
        .map(|r| r.1.len())
        .collect();
    widths.sort_unstable();
    let width = *widths.get(widths.len() / 2)?;
    let fits = |row: &[String]| row.len() + 1 >= width && like_data(row);
    let first = rows.iter().position(|r| {
        !r.2 && fits(&r.1) && {
            // One row of numbers in a head is not yet data.
            let after = rows
                .iter()
                .skip_while(|o| o.0 <= r.0)
                .filter(|o| !o.2)
                .take(8);
            after.clone().count() == 0
                || 4 * after.clone().filter(|o| fits(&o.1)).count() > 3 * after.count()
        }
    })?;
    // Rows that begin a recording may hold little more than their time.
    let filled = filled(&rows[first..], decimal);
    let mut first = first;
    while let Some(before) = rows[..first].iter().rposition(|r| !r.2)
        && rows[before].1.len() + 1 >= width
        && is_sparse_data(&rows[before].1, &filled, decimal)
    {
        first = before;
    }
    let before: Vec<&Row> = rows[..first].iter().collect();
    let text = |row: &[String]| row.iter().filter(|c| !c.is_empty()).count();
    let full = |r: &&&Row| !r.2 && 2 * text(&r.1) >= width.min(4);
    let mut above = before.iter().rev().filter(full);
    let is_units = |row: &[String]| {
        let named: Vec<&String> = row.iter().filter(|c| !c.is_empty()).collect();
        !named.is_empty() && 2 * named.iter().filter(|c| is_unit(c)).count() > named.len()
    };
    let (mut names, mut units) = (above.next().copied(), None);
    if let Some(u) = names.filter(|u| is_units(&u.1))
        && let Some(n) = above.next().copied()
    {
        (names, units) = (Some(n), Some(u));
    }
    // Names may stand in the last line of notes.
    let mut by_number = false;
    let mut columns: Vec<Named> = Vec::new();
    let note = before
        .iter()
        .rev()
        .find(|r| r.2 && !head.line(r.0).trim().is_empty());
    if names.is_none()
        && let Some(note) = note
    {
        let bare = bare_note(head.line(note.0));
        let own = cells(separator, bare);
        if own.len() + 1 >= width && own.len() <= width + 1 && text(&own) == own.len() {
            if note.1.len() == own.len() && separator != Separator::Blanks {
                names = Some(note);
            } else {
                by_number = true;
                columns = own.iter().map(|name| named(name)).collect();
            }
        }
    }
    let comment = COMMENTS.iter().find(|c| {
        let begins = |r: &Row| head.line(r.0).trim_start().starts_with(*c);
        rows.iter()
            .any(|r| begins(r) && names.is_none_or(|n| n.0 != r.0))
    });
    file.comment = comment.map(|c| (*c).to_owned());
    match names {
        Some(n) => {
            // The first line that is no note is the header anyway.
            let plain_first = rows
                .iter()
                .find(|r| !r.2 && !is_separator_line(&head.line(r.0).to_lowercase()));
            file.header_line = (plain_first.map(|r| r.0) != Some(n.0)).then_some(n.0);
            columns = n.1.iter().map(|name| named(name)).collect();
        }
        None => {
            file.header = false;
            let start = rows[first].0;
            let skipped = rows[..first].iter().any(|r| !r.2);
            file.first_line = skipped.then_some(start);
        }
    }
    if let Some(u) = units {
        file.units_line = Some(u.0);
        for (column, unit) in columns.iter_mut().zip(&u.1) {
            let own = unit::written(unit).unwrap_or(unit);
            column.unit = Some(own.to_owned()).filter(|u| !u.is_empty());
        }
    }
    let mut remarks = Vec::new();
    let most = rows[first..].iter().filter(|r| !r.2).map(|r| r.1.len());
    let most = most.max().unwrap_or(0);
    let named_cells = names.map_or(most, |n| n.1.len());
    if separator == Separator::Blanks
        && let Some(widths) = run_together(head, &rows[first..], named_cells)
            .or_else(|| run_together(head, &rows[first..], most))
    {
        remarks.push(
            "numbers run together in some lines: columns are read by their widths".to_owned(),
        );
        if let Some(n) = names {
            let own = widths::names(head.line(n.0), &widths);
            if own.len() != columns.len() {
                columns = own.iter().map(|name| named(name)).collect();
            }
        }
        (file.separator, file.widths) = (None, widths);
    }
    let data = rows[first..].iter().filter(|r| !r.2).flat_map(|r| &r.1);
    let grouped = |c: &String| Some((surely_grouped_by(c, decimal)?, c.clone()));
    if let Some((mark, cell)) = data.filter_map(grouped).next() {
        file.thousands = Some(mark);
        remarks.push(format!(
            "numbers like '{cell}' are read with their thousands set apart by '{mark}'"
        ));
    }
    // `sep=` is obeyed by the reader; it needs no key.
    Some(Shape {
        kind: "a plain table",
        by_number: by_number || !file.header,
        file,
        columns,
        rate_hz: None,
        units: Defaults::default(),
        remarks,
        open: Vec::new(),
    })
}

fn is_separator_line(line: &str) -> bool {
    line.trim_matches('"').starts_with("sep=")
}

/// A line of notes without its mark.
pub(super) fn bare_note(line: &str) -> &str {
    let line = line.trim_start();
    let mark = COMMENTS.iter().find(|c| line.starts_with(**c));
    mark.map_or(line, |c| line[c.len()..].trim_start())
}

/// A name with the unit in its brackets.
pub(super) fn named(name: &str) -> Named {
    let unit = unit::written(name).filter(|u| is_unit(u));
    Named {
        name: name.to_owned(),
        group: String::new(),
        unit: unit.map(str::to_owned),
    }
}
