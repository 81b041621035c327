//! Cells of a text, and the same in SI.

use super::check::{Finding, Severity};
use super::map::{Map, time_unit_s};
use super::stamp;

/// No table of motion on a UNIX clock is older \[s\]: 1980-01-01.
const UNIX_EARLIEST_S: f64 = 315_532_800.0;

/// Cells by column, with the line each row stands on.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    /// Column names.
    pub header: Vec<String>,
    /// Rows that have as many cells as the header.
    pub rows: Vec<(u64, Vec<String>)>,
    /// Rows that do not.
    pub broken: usize,
}

/// A table in SI.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Imported {
    /// Since the first row \[s\], ascending only if the file is.
    pub times_s: Vec<f64>,
    /// UNIX time of the first row \[ns\].
    pub start_ns: u64,
    /// Line of each row.
    pub lines: Vec<u64>,
    /// Per channel of `/vehicle/motion`; NaN = nothing usable in the cell. Empty = not mapped.
    pub motion: [Vec<f64>; 12],
    /// Per `[[command]]` of the map \[N, N m\].
    pub commands: Vec<Vec<f64>>,
    /// Second clock \[s\]; empty = none.
    pub compare_s: Vec<f64>,
    /// Rows left out: too few or too many cells, or no time that can be read.
    pub lost_rows: usize,
    /// What was found.
    pub findings: Vec<Finding>,
}

impl Imported {
    /// Whether a finding forbids the import.
    pub fn has_faults(&self) -> bool {
        self.findings.iter().any(|f| f.severity == Severity::Fault)
    }
}

/// Splits a text into cells.
pub(super) fn cells(text: &str, map: &Map) -> (Table, Vec<Finding>) {
    let mut findings = Vec::new();
    let mut reader = csv::ReaderBuilder::new()
        .delimiter(map.file.separator as u8)
        .flexible(true)
        .trim(csv::Trim::All)
        .from_reader(text.as_bytes());
    let header: Vec<String> = match reader.headers() {
        Ok(h) => h.iter().map(str::to_owned).collect(),
        Err(error) => {
            findings.push(Finding::fault(
                "header",
                None,
                format!("the header cannot be read: {error}"),
            ));
            return (Table::default(), findings);
        }
    };
    let mut table = Table {
        header,
        ..Table::default()
    };
    let (mut short, mut long): (Vec<u64>, Vec<u64>) = (Vec::new(), Vec::new());
    let mut record = csv::StringRecord::new();
    loop {
        match reader.read_record(&mut record) {
            Ok(false) => break,
            Ok(true) => {
                let line = record.position().map_or(0, csv::Position::line);
                match record.len().cmp(&table.header.len()) {
                    std::cmp::Ordering::Less => short.push(line),
                    std::cmp::Ordering::Greater => long.push(line),
                    std::cmp::Ordering::Equal => table
                        .rows
                        .push((line, record.iter().map(str::to_owned).collect())),
                }
            }
            Err(error) => {
                findings.push(Finding::fault(
                    "unreadable_row",
                    error.position().map(csv::Position::line),
                    error.to_string(),
                ));
                short.push(0);
                if error.position().is_none() {
                    break;
                }
            }
        }
    }
    let columns = table.header.len();
    if let Some(first) = short.first() {
        findings.push(Finding::fault(
            "truncated_rows",
            Some(*first),
            format!("{} row(s) have fewer cells than the header's {columns}, the first on line {first}; was the file cut?", short.len()),
        ));
    }
    if let Some(first) = long.first() {
        let hint = if map.file.separator == ',' {
            "decimal commas in a comma-separated file? Export with ; or decimal points"
        } else {
            "is the separator right?"
        };
        findings.push(Finding::fault(
            "too_many_cells",
            Some(*first),
            format!("{} row(s) have more cells than the header's {columns}, the first on line {first}; {hint}", long.len()),
        ));
    }
    table.broken = short.len() + long.len();
    findings.extend(cut_number(&table, text));
    (table, findings)
}

/// The file's very last cell when no line end follows and it is shorter than any other of its column: cut inside a
/// number it still is one. Where every other cell has the same number of decimals it surely was cut; else it may
/// be a number that happens to be short. A complete last line raises no doubt.
fn cut_number(table: &Table, text: &str) -> Option<Finding> {
    if text.ends_with(['\n', '\r']) {
        return None;
    }
    let (last, before) = table.rows.split_last()?;
    if before.len() < 8 {
        return None;
    }
    let cell = |row: &(u64, Vec<String>)| row.1.last().cloned().unwrap_or_default();
    let shortest = before.iter().map(|r| cell(r).len()).min()?;
    let own = cell(last);
    if own.len() >= shortest {
        return None;
    }
    let decimals = |cell: &str| cell.rsplit_once(['.', ',']).map_or(0, |(_, d)| d.len());
    let fixed = decimals(&cell(&before[0]));
    let all_alike = before.iter().all(|r| decimals(&cell(r)) == fixed);
    let words = format!(
        "the last cell of the file, '{own}' on line {}, is shorter than any other of its column (at least {shortest} characters) and no line end follows",
        last.0
    );
    Some(if all_alike && decimals(&own) < fixed {
        Finding::fault(
            "cut_number",
            Some(last.0),
            format!(
                "{words}: the file was cut inside a number (all others have {fixed} decimals); take its last line away"
            ),
        )
    } else {
        Finding::warning(
            "cut_number",
            Some(last.0),
            format!("{words}: was the file cut?"),
        )
    })
}

/// Cells to numbers in SI.
pub(super) fn convert(table: &Table, map: &Map, findings: &mut Vec<Finding>) -> Imported {
    let mut find = |name: &str, key: &str| -> Option<usize> {
        let places: Vec<usize> = table
            .header
            .iter()
            .enumerate()
            .filter(|(_, h)| *h == name)
            .map(|(i, _)| i)
            .collect();
        if places.len() > 1 {
            findings.push(Finding::fault(
                "column_twice",
                None,
                format!("{key}: the header has {} columns '{name}'", places.len()),
            ));
        }
        if places.is_empty() {
            findings.push(Finding::fault(
                "column_missing",
                None,
                format!(
                    "{key}: no column '{name}' in the header ({}); separator '{}'",
                    table.header.join(" | "),
                    map.file.separator
                ),
            ));
        }
        places.first().copied().filter(|_| places.len() == 1)
    };
    let time = find(&map.time.column, "time.column");
    let compare = map
        .time
        .compare_column
        .as_ref()
        .and_then(|name| find(name, "time.compare_column"));
    let motion: Vec<_> = map
        .channels()
        .into_iter()
        .map(|(place, c, factor)| {
            (
                place,
                c,
                factor,
                find(
                    &c.column,
                    &format!("motion.{}", hydroline_identify::data::CHANNELS[place]),
                ),
            )
        })
        .collect();
    let commands: Vec<_> = map
        .commands
        .iter()
        .map(|c| (c, find(&c.column, &format!("command {}", c.thruster))))
        .collect();
    let mut out = Imported {
        commands: vec![Vec::new(); commands.len()],
        lost_rows: table.broken,
        ..Imported::default()
    };
    let Some(time) = time else { return out };
    let mut bad = BadCells::default();
    let mut zones: Vec<(stamp::Zone, u64)> = Vec::new();
    let mut origin: Option<f64> = None;
    for (line, row) in &table.rows {
        let cell = row.get(time).map_or("", String::as_str);
        let absolute_s = if map.time.unit == "iso8601" {
            stamp::parse(cell).map(|(s, zone)| {
                if !zones.iter().any(|z| z.0 == zone) {
                    zones.push((zone, *line));
                }
                s
            })
        } else {
            bad.number(cell, map.file.decimal)
                .map(|v| v * time_unit_s(&map.time.unit).unwrap_or(1.0))
        };
        let Some(absolute_s) = absolute_s.filter(|s| s.is_finite()) else {
            bad.note("time", *line, cell);
            out.lost_rows += 1;
            continue;
        };
        let zero = *origin.get_or_insert(absolute_s);
        let t_s = absolute_s - zero;
        if map.time.from_s.is_some_and(|from| t_s < from)
            || map.time.to_s.is_some_and(|to| t_s > to)
        {
            continue;
        }
        out.times_s.push(t_s);
        out.lines.push(*line);
        for (place, c, factor, column) in &motion {
            let Some(column) = column else { continue };
            let cell = row.get(*column).map_or("", String::as_str);
            let value = bad.number(cell, map.file.decimal).filter(|v| v.is_finite());
            if value.is_none() {
                bad.note(&c.column, *line, cell);
            }
            out.motion[*place].push(value.map_or(f64::NAN, |v| v * factor + c.offset));
        }
        for (i, (c, column)) in commands.iter().enumerate() {
            let Some(column) = column else { continue };
            let cell = row.get(*column).map_or("", String::as_str);
            let value = bad.number(cell, map.file.decimal).filter(|v| v.is_finite());
            if value.is_none() {
                bad.note(&c.column, *line, cell);
            }
            out.commands[i].push(value.map_or(f64::NAN, |v| v * c.scale + c.offset));
        }
        if let Some(column) = compare {
            let unit_s = map
                .time
                .compare_unit
                .as_deref()
                .and_then(time_unit_s)
                .unwrap_or(1.0);
            let cell = row.get(column).map_or("", String::as_str);
            out.compare_s.push(
                bad.number(cell, map.file.decimal)
                    .map_or(f64::NAN, |v| v * unit_s),
            );
        }
    }
    bad.report(map, findings);
    if zones.len() > 1 {
        let words: Vec<String> = zones
            .iter()
            .map(|(z, line)| match z {
                Some(m) => format!("UTC{:+03}:{:02} from line {line}", m / 60, (m % 60).abs()),
                None => format!("no zone from line {line}"),
            })
            .collect();
        findings.push(Finding::fault(
            "mixed_time_zones",
            zones.get(1).map(|z| z.1),
            format!(
                "stamps are in {} time zones: {}",
                zones.len(),
                words.join(", ")
            ),
        ));
    }
    if zones.len() == 1 && zones[0].0.is_none() {
        findings.push(Finding::warning(
            "time_zone_missing",
            Some(zones[0].1),
            "stamps carry no time zone: read as UTC; a change of daylight saving time between them could not be told from a gap".to_owned(),
        ));
    }
    if map.time.clock == "unix" && origin.is_some_and(|s| (0.0..UNIX_EARLIEST_S).contains(&s)) {
        findings.push(Finding::fault(
            "time_clock",
            None,
            format!(
                "time.clock is 'unix' but the first stamp is {:.3} s, in {}: is the clock 'relative', or time.unit another than '{}'?",
                origin.unwrap_or(0.0),
                1970 + (origin.unwrap_or(0.0) / 31_556_952.0) as i64,
                map.time.unit
            ),
        ));
    }
    let unix_s = match (map.time.clock.as_str(), map.time.unit.as_str()) {
        ("unix", _) | (_, "iso8601") => origin.unwrap_or(0.0),
        _ => map
            .time
            .start_unix_s
            .unwrap_or(hydroline_core::clock::SIMULATION_START_UNIX_S as f64),
    };
    if !(0.0..=4e9).contains(&unix_s) {
        findings.push(Finding::fault("time_unit", None, format!("the first stamp is UNIX {unix_s:.3e} s, outside 1970 .. 2096: is time.unit '{}' right?", map.time.unit)));
    }
    out.start_ns = (unix_s.clamp(0.0, 4e9) * 1e9) as u64;
    out
}

/// Cells that are no numbers, by kind.
#[derive(Default)]
struct BadCells {
    /// (kind, column, first line, first cell, count)
    seen: Vec<(&'static str, String, u64, String, usize)>,
}

impl BadCells {
    fn number(&self, cell: &str, decimal: char) -> Option<f64> {
        if decimal == ',' {
            // A point in a file of decimal commas would be a thousands separator: not guessed.
            if cell.contains('.') {
                None
            } else {
                cell.replace(',', ".").parse().ok()
            }
        } else {
            cell.parse().ok()
        }
    }

    fn note(&mut self, column: &str, line: u64, cell: &str) {
        let lower = cell.to_ascii_lowercase();
        let kind = if cell.is_empty() {
            "empty_cells"
        } else if lower.contains("nan") || lower.contains("inf") || lower == "na" || lower == "null"
        {
            "nan"
        } else if cell.replace(',', ".").parse::<f64>().is_ok()
            || cell.replace(['.', ','], "").parse::<f64>().is_ok()
        {
            "decimal_separator"
        } else {
            "not_a_number"
        };
        match self.seen.iter_mut().find(|s| s.0 == kind && s.1 == column) {
            Some(s) => s.4 += 1,
            None => self.seen.push((
                kind,
                column.to_owned(),
                line,
                cell.chars().take(40).collect(),
                1,
            )),
        }
    }

    fn report(self, map: &Map, findings: &mut Vec<Finding>) {
        for (kind, column, line, cell, count) in self.seen {
            let words = match kind {
                "empty_cells" => {
                    format!("column '{column}': {count} empty cell(s), the first on line {line}")
                }
                "nan" => format!(
                    "column '{column}': {count} cell(s) hold '{cell}' or the like, the first on line {line}"
                ),
                "decimal_separator" => format!(
                    "column '{column}': {count} cell(s) like '{cell}' (line {line}) do not fit the decimal sign '{}'; set file.decimal, or mend the export",
                    map.file.decimal
                ),
                _ => format!(
                    "column '{column}': {count} cell(s) are no numbers, the first on line {line}: '{cell}'"
                ),
            };
            findings.push(Finding::fault(kind, Some(line), words));
        }
    }
}
