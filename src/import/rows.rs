//! The rows of a table, one after the other, and what is wrong with their form.

use std::io::{self, Read};

use crate::cells::{Cells, Splitter};
use crate::check::{Finding, FindingList};
use crate::layout::{Layout, is_aside, shown};
use crate::map::{FileMap, Separator};
use crate::text::Lines;

/// A quoted cell does not go on over more lines than this.
const QUOTED_LINES_MAX: usize = 50;

/// Lines with which a segment of a LabVIEW file (.lvm) begins, or its header ends.
const SEGMENT: [&str; 3] = ["Channels\t", "***End_of_Header***", "LabVIEW Measurement"];

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
    let mut splitter = Splitter::new(layout.separator);
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
        let sound = if count < least {
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

impl Form {
    /// Adds what was found.
    pub fn report(&self, layout: &Layout, findings: &mut Vec<Finding>) {
        let Tally { count, first } = self.short;
        if count > 0 {
            findings.fault_at(
                "truncated_rows",
                Some(first),
                format!(
                    "{count} row(s) have fewer cells than the header's {}, the first on line {first}; was the file cut?",
                    layout.width(),
                ),
            );
        }
        let Tally { count, first } = self.long;
        if count > 0 {
            let hint = if layout.separator == Separator::Byte(b',') {
                "decimal commas in a comma-separated file? Export with ; or decimal points"
            } else {
                "is the separator right?"
            };
            findings.fault_at(
                "too_many_cells",
                Some(first),
                format!(
                    "{count} row(s) have more cells than the header's {}, the first on line {first}; {hint}",
                    layout.width(),
                ),
            );
        }
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
