//! The guessed map's `[time]`.

use super::Draft;
use super::meaning::Words;
use super::meaning::written::{self, unit_text};
use super::meaning::{Meaning, meaning};
use super::shape::Shape;
use super::stats::{Column, Stats};
use crate::clock::may_be_sexagesimal;
use crate::stamp::{self, Instant, Pattern, Stamp, Zone};
use crate::unit::{self, Dimension};

/// Patterns that people and programs write; several may fit one file.
const PATTERNS: [&str; 20] = [
    "%d.%m.%Y %H:%M:%S%.f",
    "%Y/%m/%d %H:%M:%S%.f",
    "%m/%d/%Y %I:%M:%S%.f %p",
    "%d/%m/%Y %I:%M:%S%.f %p",
    "%m/%d/%Y %H:%M:%S%.f",
    "%d/%m/%Y %H:%M:%S%.f",
    "%d-%b-%Y %H:%M:%S%.f",
    "%d-%m-%Y %H:%M:%S%.f",
    "%d %b %Y %H:%M:%S%.f",
    "%d.%m.%y %H:%M:%S%.f",
    "%Y-%m-%d %I:%M:%S%.f %p",
    "%Y%m%d %H:%M:%S%.f",
    "%Y%m%d %H%M%S%.f",
    "%H:%M:%S%.f",
    "%I:%M:%S%.f %p",
    "%M:%S%.f",
    "%H:%M:%S:%3f",
    "%Y-%m-%d %H:%M:%S:%3f",
    "%a, %d %b %Y %H:%M:%S%.f %z",
    "0 days %H:%M:%S%.f",
];
/// Rates that instruments are set to \[Hz\].
const RATES: [f64; 26] = [
    1.0, 2.0, 4.0, 5.0, 8.0, 10.0, 12.5, 15.0, 16.0, 20.0, 25.0, 30.0, 40.0, 50.0, 60.0, 64.0,
    75.0, 80.0, 90.0, 100.0, 120.0, 125.0, 150.0, 180.0, 200.0, 240.0,
];
const RATES_FAST: [f64; 10] = [
    250.0, 256.0, 300.0, 360.0, 400.0, 500.0, 512.0, 1000.0, 1024.0, 2000.0,
];

/// Columns that an error names.
const COLUMNS_NAMED: usize = 4;

/// Table `[time]` of the guessed map.
#[derive(Debug, Clone, Default)]
pub(super) struct Time {
    pub columns: Vec<usize>,
    /// Between rows \[s\].
    pub interval_s: f64,
    keys: Vec<String>,
    questions: Vec<String>,
}

impl Time {
    pub fn write(&self, draft: &mut Draft) {
        draft.line("[time]");
        for question in &self.questions {
            draft.question(question.clone());
        }
        draft.toml.extend(self.keys.iter().cloned());
    }
}

pub(super) fn find(shape: &Shape, stats: &Stats) -> Option<Time> {
    let of = |m: Meaning| -> Vec<usize> {
        (0..shape.columns.len())
            .filter(|i| means(shape, *i) == m)
            .collect()
    };
    let numeric = |i: &usize| stats.columns.get(*i).is_some_and(Column::is_numeric);
    // Seconds and their nanoseconds.
    if let (Some(s), Some(ns)) = (
        of(Meaning::Seconds).first(),
        of(Meaning::Nanoseconds).first(),
    ) && numeric(s)
        && numeric(ns)
    {
        return Some(seconds_and_nanoseconds(shape, stats, *s, *ns));
    }
    let mut named = of(Meaning::Time);
    named.extend(of(Meaning::Seconds));
    // A column that ascends comes before one that does not, and a message's own stamp before that of its receipt.
    let is_own = |i: usize| {
        let words = Words::of(&shape.columns[i].name).words;
        ["header", "stamp"]
            .iter()
            .all(|w| words.iter().any(|o| o == w))
    };
    let ascends = |i: usize| stats.columns.get(i).is_some_and(Column::ascends);
    named.sort_by_key(|i| {
        (
            !ascends(*i),
            !(shape.kind.starts_with("rostopic") && is_own(*i)),
        )
    });
    if let Some(time) = named
        .first()
        .and_then(|i| stamps(shape, stats, &of(Meaning::Date), *i))
    {
        return Some(time);
    }
    for date in of(Meaning::Date) {
        if let Some(time) = stamps(shape, stats, &[], date) {
            return Some(time);
        }
    }
    let mut numbers = named.iter().copied().filter(numeric);
    if let Some(i) = numbers.next() {
        let mut time = number(shape, stats, i, true);
        let others: Vec<String> = numbers
            .filter(|i| ascends(*i))
            .map(|i| shape.words(i))
            .collect();
        if !others.is_empty() {
            time.questions.push(format!(
                "time is {}; others go on too and are not used: {}",
                shape.words(i),
                others.join(", ")
            ));
        }
        return Some(time);
    }
    if let (Some(frame), Some(rate_hz)) = (of(Meaning::Frame).first(), shape.rate_hz) {
        return Some(Time {
            columns: vec![*frame],
            interval_s: 1.0 / rate_hz,
            keys: vec![shape.key(*frame), format!("rate_hz = {rate_hz}")],
            questions: Vec::new(),
        });
    }
    if let Some(rate_hz) = shape.rate_hz {
        return Some(Time {
            columns: Vec::new(),
            interval_s: 1.0 / rate_hz,
            keys: vec![format!("rate_hz = {rate_hz}")],
            questions: vec![format!(
                "rows carry no time: {rate_hz} rows per second as the head says"
            )],
        });
    }
    // One that is named and cannot be read has none in its place.
    if !named.is_empty() {
        return None;
    }
    // A first column that goes on evenly and whose name says nothing else.
    let first = (0..stats.columns.len().min(3)).find(|i| {
        let c = &stats.columns[*i];
        let is_unknown = written::column(&shape.columns[*i]).is() == Some(Meaning::Unknown);
        is_unknown && c.goes_on_evenly() && c.numbers + 1 >= c.rows() && c.numbers > 3
    });
    if let Some(i) = first {
        return Some(number(shape, stats, i, false));
    }
    (0..stats.columns.len().min(4))
        .find_map(|i| stamps(shape, stats, &[i + 1], i).or_else(|| stamps(shape, stats, &[], i)))
}

/// Meaning of a column's name; one in a unit of something else is no time.
fn means(shape: &Shape, i: usize) -> Meaning {
    let named = &shape.columns[i];
    let own = meaning(&named.name, &named.group);
    let other = unit_text(named).is_some_and(|u| unit::find(Dimension::Time, u).is_none());
    match own {
        Meaning::Time if other => Meaning::Unknown,
        own => own,
    }
}

/// Columns among the first, or named a time, that hold neither numbers nor stamps of a known form, with a cell of each; empty = there are none.
pub(super) fn unread(shape: &Shape, stats: &Stats) -> String {
    let is_unread = |i: &usize| {
        let c = &stats.columns[*i];
        c.words > 0 && !c.is_numeric() && (*i < COLUMNS_NAMED || means(shape, *i) == Meaning::Time)
    };
    let unread = (0..stats.columns.len().min(shape.columns.len())).filter(is_unread);
    let words: Vec<String> = unread
        .take(COLUMNS_NAMED)
        .map(|i| {
            let cell = stats.columns[i].word.as_deref().unwrap_or_default();
            let cell: String = cell.chars().take(40).collect();
            format!("{} holds '{cell}'", shape.words(i))
        })
        .collect();
    if words.is_empty() {
        return String::new();
    }
    format!(
        "; neither numbers nor stamps of a form that is known: {}",
        words.join(", ")
    )
}

fn seconds_and_nanoseconds(shape: &Shape, stats: &Stats, s: usize, ns: usize) -> Time {
    let unix = stats.columns[s].low > 3e8;
    let value = |i: usize, k: usize| {
        stats.columns[i]
            .cells
            .get(k)
            .and_then(|c| c.parse::<f64>().ok())
    };
    let mut steps: Vec<f64> = (1..stats.columns[s].cells.len())
        .filter_map(|k| {
            Some(value(s, k)? - value(s, k - 1)? + 1e-9 * (value(ns, k)? - value(ns, k - 1)?))
        })
        .filter(|d| *d > 0.0)
        .collect();
    let column = |i: usize| {
        if shape.by_number {
            (i + 1).to_string()
        } else {
            super::file::quoted(&shape.columns[i].name)
        }
    };
    let mut keys = vec![
        format!("columns = [{}, {}]", column(s), column(ns)),
        "unit = [\"s\", \"ns\"]".to_owned(),
    ];
    if unix {
        keys.push("clock = \"unix\"".to_owned());
    }
    Time {
        columns: vec![s, ns],
        interval_s: crate::check::quantile(&mut steps, 0.5).unwrap_or(0.01),
        keys,
        questions: Vec::new(),
    }
}

/// Dates and clocks, in one column or with that of the date.
fn stamps(shape: &Shape, stats: &Stats, dates: &[usize], clock: usize) -> Option<Time> {
    let own = stats.columns.get(clock)?;
    if own.is_numeric() || own.words == 0 {
        return None;
    }
    if let Some(time) = durations(shape, stats, clock) {
        return Some(time);
    }
    let date = dates.iter().copied().find(|d| {
        stats
            .columns
            .get(*d)
            .is_some_and(|c| c.words > 0 || c.whole)
    });
    for columns in [date.map(|d| vec![d, clock]), Some(vec![clock])]
        .into_iter()
        .flatten()
    {
        let texts: Vec<String> = (0..own.cells.len())
            .map(|k| {
                let words: Vec<&str> = columns
                    .iter()
                    .filter_map(|c| stats.columns[*c].cells.get(k))
                    .map(String::as_str)
                    .collect();
                let text = words.join(" ");
                if shape.file.decimal == ',' {
                    text.replace(',', ".")
                } else {
                    text
                }
            })
            .filter(|t| !t.trim().is_empty())
            .collect();
        if let Some((keys, questions, interval_s)) = pattern(&texts) {
            let list: Vec<String> = columns.iter().map(|c| shape.key(*c)).collect();
            let mut all = match list.as_slice() {
                [one] => vec![one.clone()],
                several => {
                    let bare: Vec<&str> = several
                        .iter()
                        .map(|k| {
                            k.lines()
                                .next()
                                .unwrap_or("")
                                .trim_start_matches("column = ")
                        })
                        .collect();
                    vec![format!("columns = [{}]", bare.join(", "))]
                }
            };
            all.extend(keys);
            return Some(Time {
                columns,
                interval_s,
                keys: all,
                questions,
            });
        }
    }
    None
}

/// `0.01 sec`, as MATLAB writes durations.
fn durations(shape: &Shape, stats: &Stats, column: usize) -> Option<Time> {
    let cells = &stats.columns[column].cells;
    let (_, word) = cells.first()?.rsplit_once(' ')?;
    let unit = unit::find(Dimension::Time, word)?;
    let values: Option<Vec<f64>> = cells
        .iter()
        .map(|c| c.strip_suffix(word)?.trim().parse().ok())
        .collect();
    let mut steps: Vec<f64> = values?
        .windows(2)
        .map(|w| (w[1] - w[0]) * unit.factor)
        .collect();
    Some(Time {
        columns: vec![column],
        interval_s: crate::check::quantile(&mut steps, 0.5).unwrap_or(0.01),
        keys: vec![shape.key(column), format!("unit = \"{}\"", unit.name)],
        questions: Vec::new(),
    })
}

/// The pattern of stamps: keys, questions, interval.
fn pattern(texts: &[String]) -> Option<(Vec<String>, Vec<String>, f64)> {
    if texts.len() < 2 {
        return None;
    }
    let interval = |ns: &[i128]| {
        let mut steps: Vec<f64> = ns
            .windows(2)
            .map(|w| (w[1] - w[0]) as f64 * 1e-9)
            .filter(|d| *d > 0.0)
            .collect();
        crate::check::quantile(&mut steps, 0.5).unwrap_or(1.0)
    };
    let iso: Option<Vec<Instant>> = texts.iter().map(|t| stamp::parse(t)).collect();
    if let Some(iso) = iso {
        let ns: Vec<i128> = iso.iter().map(|s| s.ns).collect();
        let mut questions = Vec::new();
        match &iso[0].zone {
            Zone::Offset(_) => {}
            Zone::Open => questions.push("stamps carry no zone: read as UTC".to_owned()),
            Zone::Named(name) => questions.push(format!(
                "stamps are in the zone '{name}', which states no offset: utc_offset = \"+hh:mm\" says it"
            )),
        }
        return Some((
            vec!["unit = \"iso8601\"".to_owned()],
            questions,
            interval(&ns),
        ));
    }
    let fits = |format: &&str| -> Option<Vec<i128>> {
        let pattern = Pattern::new(format)?;
        let ns: Option<Vec<i128>> = texts
            .iter()
            .map(|t| {
                pattern.parse(t).map(|s| match s {
                    Stamp::Date(Instant { ns, .. }) | Stamp::Clock { ns, .. } => ns,
                })
            })
            .collect();
        ns
    };
    let mut found: Vec<(&str, Vec<i128>)> = PATTERNS
        .iter()
        .filter_map(|p| Some((*p, fits(p)?)))
        .collect();
    // Of several, the one under which time goes on evenly.
    found.sort_by(|a, b| interval(&a.1).total_cmp(&interval(&b.1)));
    let (format, ns) = found.first()?;
    let mut questions = Vec::new();
    if let Some((other, _)) = found.get(1) {
        questions.push(format!(
            "day and month could be the other way round: format = \"{other}\" reads every stamp too"
        ));
    }
    if (format.contains("%Y") || format.contains("%y")) && !format.contains("%z") {
        questions.push("stamps carry no zone: read as UTC".to_owned());
    }
    Some((
        vec![format!("format = \"{format}\"")],
        questions,
        interval(ns),
    ))
}

/// A column of numbers.
fn number(shape: &Shape, stats: &Stats, i: usize, is_named: bool) -> Time {
    let column = &stats.columns[i];
    let mut time = Time {
        columns: vec![i],
        keys: vec![shape.key(i)],
        ..Time::default()
    };
    if !is_named {
        time.questions.push(format!(
            "{} only goes up: taken for the time",
            shape.words(i)
        ));
    }
    let own = &shape.columns[i];
    let written = own
        .unit
        .as_deref()
        .or(Words::of(&own.name).unit)
        .and_then(|u| unit::find(Dimension::Time, u));
    let may_be_clock = may_be_sexagesimal(written.map(|u| u.factor));
    if let Some(carry) = column.clock.carry().filter(|_| may_be_clock) {
        time.questions.push(format!(
            "{} is followed by {}: clocks as hhmmss, no count",
            carry.numbers[0], carry.numbers[1]
        ));
        time.keys.push(format!("format = \"{}\"", carry.format));
        time.interval_s = column.step;
        return time;
    }
    let (unit, factor) = match written {
        Some(u) if u.name == "s" && since_1904(column) => ("labview_s", 1.0),
        Some(u) => (u.name, u.factor),
        None => {
            let (unit, sure) = by_size(column);
            let factor = match unit {
                "matlab_days" | "spreadsheet_days" => 86_400.0,
                _ => unit::find(Dimension::Time, unit).map_or(1.0, |u| u.factor),
            };
            if !sure {
                time.questions.push(format!(
                    "the unit of time is not written: {unit} assumed, which makes {:.4} s between rows",
                    column.step * factor
                ));
            }
            (unit, factor)
        }
    };
    if unit == "labview_s" {
        time.questions.push("seconds since 1904, as LabVIEW counts them, in UTC; since 1970 they would be beyond 2066".to_owned());
    }
    time.keys.push(format!("unit = \"{unit}\""));
    time.interval_s = column.group_step * factor;
    if !matches!(unit, "matlab_days" | "spreadsheet_days" | "labview_s")
        && column.low * factor > 3e8
        && column.high * factor < 4e9
    {
        time.keys.push("clock = \"unix\"".to_owned());
    }
    turns(column, &mut time);
    if column.repeats * 50 > column.numbers {
        rounded(column, factor, &mut time);
    }
    time
}

/// A counter that starts again.
fn turns(column: &Column, time: &mut Time) {
    if column.back == 0 {
        return;
    }
    let bits = [16, 24, 32, 48].into_iter().find(|b| {
        let full = 2f64.powi(*b);
        // One that ends far from its last count was started anew.
        let ends = 0.9 * full..full;
        ends.contains(&column.high) && column.back_most > 0.5 * full && column.low >= 0.0
    });
    match bits {
        Some(bits) if column.whole => {
            time.questions.push(format!(
                "time goes back by {:.0}: a counter of {bits} bits that starts again from 0",
                column.back_most
            ));
            time.keys.push(format!("unwrap = {bits}"));
        }
        _ => time.questions.push(format!(
            "time goes back {} time(s), by {} at most; where its clock was started anew, boot = 2 takes the second run",
            column.back, column.back_most
        )),
    }
}

/// Stamps that repeat because they are rounded.
fn rounded(column: &Column, factor: f64, time: &mut Time) {
    let span_s = (column.last - column.first) * factor;
    if span_s <= 0.0 {
        time.questions
            .push(format!("{} stamps repeat the one before", column.repeats));
        return;
    }
    let rate_hz = (column.numbers - 1) as f64 / span_s;
    // Both ends may be rounded.
    let uncertain_hz = rate_hz * 2.0 * column.step * factor / span_s;
    let known = RATES
        .iter()
        .chain(&RATES_FAST)
        .find(|r| (*r - rate_hz).abs() <= uncertain_hz.max(1e-3 * rate_hz));
    match known {
        Some(rate) => {
            time.questions.push(format!(
                "{} stamps repeat the one before: rounded, {rate_hz:.3} rows per second; times are made of rate_hz = {rate}",
                column.repeats
            ));
            time.keys.push(format!("rate_hz = {rate}"));
            time.interval_s = 1.0 / rate;
        }
        None => time.questions.push(format!(
            "{} stamps repeat the one before, and {rate_hz:.3} rows per second are no usual rate: rate_hz = .. puts them back if rows came evenly",
            column.repeats
        )),
    }
}

/// From 1904 to 2000 and to 2040 \[s\]: before that nobody measured so, and since 1970 it would be 2066 and later.
const SINCE_1904_S: [f64; 2] = [3_029_529_600.0, 4_291_833_600.0];

/// Whether stamps are LabVIEW's.
fn since_1904(column: &Column) -> bool {
    column.low >= SINCE_1904_S[0] && column.high <= SINCE_1904_S[1] && column.step < 20.0
}

/// Unit of a time without one, by its size and its steps, and whether it can hardly be another.
fn by_size(column: &Column) -> (&'static str, bool) {
    let (first, step) = (column.first.abs(), column.step);
    match first {
        _ if first > 3e17 => ("ns", true),
        _ if first > 3e14 => ("us", true),
        _ if first > 3e11 => ("ms", true),
        _ if since_1904(column) => ("labview_s", true),
        _ if first > 3e8 && first < 4e9 && step < 20.0 => ("s", true),
        _ if (700_000.0..800_000.0).contains(&first) && step < 1e-2 => ("matlab_days", true),
        _ if (25_569.0..60_000.0).contains(&first) && step < 1e-4 => ("spreadsheet_days", true),
        // From zero: what makes a rate of 1 .. 2000 per second; fractions are of seconds.
        _ if !column.whole && step < 5.0 => ("s", (1e-4..=1.0).contains(&step)),
        _ if step <= 1.0 => ("s", false),
        _ if step <= 1000.0 => ("ms", false),
        _ if step <= 1e6 => ("us", false),
        _ => ("ns", false),
    }
}
