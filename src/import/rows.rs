//! The rows of a table, one after the other, and what is wrong with their form.

mod counts;

use std::io::{self, Read};

use crate::cells::{Cells, Splitter};
use crate::check::{Finding, FindingList};
use crate::layout::{Layout, is_aside, shown};
use crate::map::{FileMap, Separator};
use crate::number::number;
use crate::text::Lines;
use crate::widths;
use counts::Counts;

/// A quoted cell does not go on over more lines than this.
const QUOTED_LINES_MAX: usize = 50;

/// Lines with which a segment of a LabVIEW file (.lvm) begins, or its header ends.
const SEGMENT: [&str; 3] = ["Channels\t", "***End_of_Header***", "LabVIEW Measurement"];

/// Share of rows in which a border inside a number shows wrong widths: columns that touch are the exception.
const CUT_SHARE: f64 = 0.5;

/// Rows with a fault: how many, and where the first stands.
#[derive(Debug, Clone, Copy, Default)]
struct Tally {
    count: usize,
    first: u64,
}

impl Tally {
    fn add(&mut self, line: u64) {
        if self.count == 0 {
            self.first = line;
        }
        self.count += 1;
    }
}

#[derive(Debug, Default)]
pub(crate) struct Form {
    short: Tally,
    long: Tally,
    open: Tally,
    endless: Option<u64>,
    wrong_encoding: Option<u64>,
    /// Another header of the same file, as LabVIEW begins each segment with.
    segment: Option<u64>,
    /// Rows that hold the header's names again.
    names: Tally,
    counts: Counts,
    /// Characters of the first row with too few cells.
    short_characters: usize,
    /// Rows, and those in which a border of fixed widths stands inside a number.
    rows: usize,
    cut_numbers: Tally,
    /// First row of fixed widths, as it was divided.
    divided: Option<(u64, String)>,
    cut: Cut,
}

/// Calls `row` with the line and cells of every row of data, `None` for cells that are too few or too many.
pub(crate) fn each_row<R: Read>(
    source: R,
    layout: &Layout,
    file: &FileMap,
    mut row: impl FnMut(u64, Option<Cells<'_>>) -> io::Result<bool>,
) -> io::Result<Form> {
    let mut lines = Lines::new(source, layout.format)?;
    let mut splitter = Splitter::of(layout.separator, &file.widths);
    let mut form = Form::default();
    let (width, least) = (layout.width(), layout.width().min(layout.usual));
    let mut joined = String::new();
    let mut rows_end_open = false;
    // Rows of numbers were seen: what is a header now is another one.
    let mut numbers = false;
    while let Some((number, line)) = lines.next_line()? {
        if file.last_line.is_some_and(|last| number > last) {
            break;
        }
        if number < layout.first_line || file.units_line == Some(number) || is_aside(file, line) {
            continue;
        }
        // The next segment has a clock and columns of its own: it is none of this table.
        if form.segment.is_some() || (numbers && SEGMENT.iter().any(|s| line.starts_with(s))) {
            form.segment.get_or_insert(number);
            row(number, None)?;
            continue;
        }
        let mut line = line;
        if splitter.is_open(line) {
            joined.clear();
            joined.push_str(line);
            let mut more = 0;
            while splitter.is_open(&joined) && more < QUOTED_LINES_MAX {
                let Some((_, next)) = lines.next_line()? else {
                    break;
                };
                joined.push('\n');
                joined.push_str(next);
                more += 1;
            }
            if splitter.is_open(&joined) {
                form.open.add(number);
                row(number, None)?;
                continue;
            }
            line = &joined;
        }
        let cells = splitter.split(line);
        let count = cells.len();
        if numbers && names_again(cells, layout) {
            form.names.add(number);
            row(number, None)?;
            continue;
        }
        form.counts.row(number, count, cells.filled());
        form.rows += 1;
        if !file.widths.is_empty() {
            form.divide(number, line, cells, file);
        }
        let sound = if count < least {
            if form.short.count == 0 {
                form.short_characters = line.trim_end().chars().count();
            }
            form.short.add(number);
            None
        } else if count > width && !cells.empty_from(width) {
            form.long.add(number);
            None
        } else {
            if !numbers {
                let first = cells.iter().find(|c| !c.is_empty()).unwrap_or("");
                numbers = first.starts_with(|c: char| c.is_ascii_digit() || "+-.,".contains(c));
            }
            form.cut.row(number, cells.get(count - 1));
            Some(cells)
        };
        rows_end_open = sound.is_some();
        if !row(number, sound)? {
            break;
        }
    }
    form.cut.ends_open = rows_end_open && !lines.complete;
    form.wrong_encoding = lines.wrong_encoding;
    form.endless = lines.endless.then_some(layout.first_line);
    Ok(form)
}

/// Whether a row holds names of the header: another recording was written behind the first.
fn names_again(cells: Cells<'_>, layout: &Layout) -> bool {
    let first = cells.iter().find(|c| !c.is_empty()).unwrap_or("");
    if !first.starts_with(|c: char| c.is_alphabetic() || c == '_' || c == '/' || c == '%') {
        return false;
    }
    let is_name = |c: &&str| {
        number(c, '.').is_none() && !c.is_empty() && layout.header.iter().any(|h| h == c)
    };
    let (names, filled) = (
        cells.iter().filter(is_name).count(),
        cells.iter().filter(|c| !c.is_empty()).count(),
    );
    names >= 2 && 2 * names > filled
}

impl Form {
    /// Notes how a row of fixed widths is divided.
    fn divide(&mut self, number: u64, line: &str, cells: Cells<'_>, file: &FileMap) {
        if self.divided.is_none() {
            let cells: Vec<&str> = cells.iter().collect();
            self.divided = Some((number, cells.join(" | ")));
        }
        if widths::cuts_a_number(line, &file.widths) {
            self.cut_numbers.add(number);
        }
    }

    /// Way on for rows whose number of cells changes in mid-file; `None` = it does not.
    fn change(&self, layout: &Layout) -> Option<String> {
        let line = self.counts.changes_at()?;
        Some(format!(
            "{}, the header {}: did columns appear or go? Which cell is which after that the names do not say. [file] last_line = {} takes the rows before; for those from line {line} on, a map with first_line = {line}, header = false and columns by number",
            self.counts.words(),
            layout.width(),
            line - 1,
        ))
    }

    /// Findings about the number of cells in the rows.
    fn report_counts(&self, layout: &Layout, findings: &mut Vec<Finding>) {
        let change = self.change(layout);
        let Tally { count, first } = self.short;
        if count > 0 {
            let together = layout.run_together(self.short_characters);
            let words = match (&together, &change) {
                (Some(widths), _) => format!(
                    "{count} row(s) have fewer cells than the others' {}, the first on line {first}, and are as long: numbers that run together? [file] {} in place of the separator",
                    layout.usual,
                    widths::words(widths),
                ),
                (None, Some(change)) => change.clone(),
                (None, None) => format!(
                    "{count} row(s) have fewer cells than the header's {}, the first on line {first}; was the file cut?",
                    layout.width(),
                ),
            };
            findings.fault_at("truncated_rows", Some(first), words);
        }
        let Tally { count, first } = self.long;
        if count > 0 {
            let words = change.clone().unwrap_or_else(|| {
                let hint = if !layout.widths.is_empty() {
                    "characters stand beyond the last of [file] widths"
                } else if layout.separator == Separator::Byte(b',') {
                    "decimal commas in a comma-separated file? Export with ; or decimal points"
                } else {
                    "is the separator right?"
                };
                format!(
                    "{count} row(s) have more cells than the header's {}, the first on line {first}; {hint}",
                    layout.width(),
                )
            });
            findings.fault_at("too_many_cells", Some(first), words);
        }
        if self.short.count == 0
            && self.long.count == 0
            && let Some(change) = change
        {
            findings.fault_at("columns_change", self.counts.changes_at(), change);
        }
        let Tally { count, first } = self.names;
        if count > 0 {
            findings.fault_at(
                "header_again",
                Some(first),
                format!(
                    "{count} row(s) hold the header's names again, the first on line {first}: several recordings in one file? Import each into a log of its own: [file] last_line = {} is the first, header_line = {first} the next",
                    first - 1,
                ),
            );
        }
    }

    /// Findings about fixed widths.
    fn report_widths(&self, layout: &Layout, findings: &mut Vec<Finding>) {
        let Some((line, divided)) = &self.divided else {
            return;
        };
        findings.info(
            "fixed_widths",
            format!(
                "{}: line {line} is read as {divided}",
                widths::words(&layout.widths)
            ),
        );
        let Tally { count, first } = self.cut_numbers;
        if count as f64 > CUT_SHARE * self.rows as f64 {
            findings.warning_at(
                "fixed_widths",
                Some(first),
                format!(
                    "in {count} of {} rows a border of the columns stands between two digits, first on line {first}: are the widths right? Line {line} is read as {divided}",
                    self.rows
                ),
            );
        }
    }

    /// Adds what was found.
    pub fn report(&self, layout: &Layout, findings: &mut Vec<Finding>) {
        self.report_counts(layout, findings);
        self.report_widths(layout, findings);
        let Tally { count, first } = self.open;
        if count > 0 {
            findings.fault_at("unreadable_row", Some(first), format!("{count} quoted cell(s) have no end, the first begins on line {first}; mend the quotes"));
        }
        if let Some(line) = self.segment {
            findings.fault_at(
                "segments",
                Some(line),
                format!(
                    "line {line} begins another segment with a header of its own, as LabVIEW writes them: import each into a log of its own. [file] last_line = {} is the first; cut the file before line {line} for the next",
                    line - 1,
                ),
            );
        }
        if self.endless.is_some() {
            findings.fault(
                "unreadable_row",
                "a line of more than 4 MiB: no table, or line ends of another kind".to_owned(),
            );
        }
        if let Some(line) = self.wrong_encoding {
            findings.fault_at(
                "encoding",
                Some(line),
                format!(
                    "line {line} is not UTF-8 text: set [file] encoding = \"latin1\" (or \"utf-16\"), or export the table as UTF-8"
                ),
            );
        }
        findings.extend(self.cut.finding());
    }
}

/// The file's very last cell when no line end follows and it is shorter than any other of its column: cut inside a
/// number it still is one. Where every other cell has the same number of decimals it surely was cut; else it may
/// be a number that happens to be short. A complete last line raises no question.
#[derive(Debug, Default)]
struct Cut {
    rows: usize,
    shortest: usize,
    decimals: usize,
    uneven: bool,
    last: String,
    last_line: u64,
    ends_open: bool,
}

fn decimals(cell: &str) -> usize {
    cell.rsplit_once(['.', ',']).map_or(0, |(_, d)| d.len())
}

impl Cut {
    fn row(&mut self, line: u64, cell: &str) {
        if self.rows > 0 {
            let own = decimals(&self.last);
            if self.rows == 1 {
                (self.shortest, self.decimals) = (self.last.len(), own);
            }
            self.shortest = self.shortest.min(self.last.len());
            self.uneven |= own != self.decimals;
        }
        self.rows += 1;
        self.last.clear();
        self.last.push_str(cell);
        self.last_line = line;
    }

    fn finding(&self) -> Option<Finding> {
        if !self.ends_open || self.rows < 9 || self.last.len() >= self.shortest {
            return None;
        }
        let words = format!(
            "the last cell of the file, '{}' on line {}, is shorter than any other of its column (at least {} characters) and no line end follows",
            shown(&self.last),
            self.last_line,
            self.shortest
        );
        Some(if !self.uneven && decimals(&self.last) < self.decimals {
            Finding::fault(
                "cut_number",
                Some(self.last_line),
                format!(
                    "{words}: the file was cut inside a number (all others have {} decimals); take its last line away",
                    self.decimals
                ),
            )
        } else {
            Finding::warning(
                "cut_number",
                Some(self.last_line),
                format!("{words}: was the file cut?"),
            )
        })
    }
}
