//! The time of a row.

use crate::cells::Cells;
use crate::check::{Finding, FindingList};
use crate::layout::Layout;
use crate::map::{Column, Map, TimeMap, TimeSource};
use crate::number::{BadCells, exact, nanoseconds, number, ungrouped};
use crate::stamp::{self, Instant, Pattern, SECOND_NS, Stamp};
use crate::table::stated_unit;
use crate::unit::{self, Dimension};

mod boots;
mod even;
mod sexagesimal;
mod zones;
pub(crate) use boots::{Boots, COUNTERS, Counter};
pub(crate) use even::{EvenRows, granularity};
pub(crate) use sexagesimal::{Sexagesimal, may_be as may_be_sexagesimal};
use zones::{Leap, Zones};

/// Form of a row's time, with the columns' places.
enum Reading {
    Rows,
    Frames(usize),
    Numbers(Vec<(usize, i128)>),
    Iso(Vec<usize>),
    Pattern(Vec<usize>, Pattern),
}

/// A clock without a date.
#[derive(Clone, Copy)]
struct ClockCell {
    ns: i128,
    /// After which it begins again from 0 \[ns\].
    turn_ns: i128,
    /// Its first number is beyond those of a clock.
    is_beyond: bool,
}

impl ClockCell {
    /// Largest step by which a clock comes to count on beyond its turn \[ns\]: one of its first number. A wrong digit of that number
    /// adds at least so much to the step that there is.
    fn largest_step_ns(self) -> i128 {
        let parts = if self.turn_ns > 3600 * SECOND_NS {
            24
        } else {
            60
        };
        self.turn_ns / parts
    }

    /// Whether it goes on from the row before, where its first number is beyond those of a clock: the first row of such may have any,
    /// and one that was no step on is confirmed by the next that goes on from it.
    fn goes_on(self, before: Option<ClockCell>) -> bool {
        let Some(before) = before.filter(|_| self.is_beyond) else {
            return true;
        };
        let most_ns = if before.is_beyond {
            self.turn_ns / 2
        } else {
            self.largest_step_ns()
        };
        (0..=most_ns).contains(&(self.ns - before.ns))
    }
}

/// Reads the time of one row after the other.
pub(crate) struct Clock {
    reading: Reading,
    decimal: char,
    thousands: Option<char>,
    period_ns: f64,
    epoch_ns: i128,
    unwrap_bits: Option<u32>,
    /// Rows so far, broken ones included.
    rows: i128,
    last_count: Option<f64>,
    turns: i128,
    /// Times that a clock without a date began again, its last time and after how much it does \[ns\].
    clock_turns: i128,
    last_of_turn: i128,
    turn_ns: i128,
    /// The clock of the row before as it stands in the file, taken or not.
    last_clock: Option<ClockCell>,
    beyond_bits: Option<u64>,
    zones: Zones,
    leap: Leap,
    /// `None` = the numbers are of a unit in which no clock is written.
    sexagesimal: Option<Sexagesimal>,
}

impl Clock {
    /// `None` = a column is missing, which has been said.
    pub fn new(map: &Map, layout: &Layout, findings: &mut Vec<Finding>) -> Option<Clock> {
        let time = &map.time;
        let mut place = |c: &Column| layout.place(c, "time.column", findings);
        let mut places = |columns: &[Column]| -> Option<Vec<usize>> {
            // All of them, so that every one that is missing is said.
            let found: Vec<Option<usize>> = columns.iter().map(&mut place).collect();
            found.into_iter().collect()
        };
        let reading = match &time.source {
            TimeSource::Rows => Reading::Rows,
            TimeSource::Frames(column) => Reading::Frames(places(std::slice::from_ref(column))?[0]),
            TimeSource::Numbers(columns) => {
                let (names, units): (Vec<Column>, Vec<i128>) = columns.iter().cloned().unzip();
                Reading::Numbers(places(&names)?.into_iter().zip(units).collect())
            }
            TimeSource::Iso(columns) => Reading::Iso(places(columns)?),
            TimeSource::Pattern(columns, format) => {
                // A decimal comma of the file is one of its stamps too.
                let format = if map.file.decimal == ',' {
                    format.replace(',', ".")
                } else {
                    format.clone()
                };
                Reading::Pattern(places(columns)?, Pattern::new(&format)?)
            }
        };
        let sexagesimal = match &reading {
            Reading::Numbers(columns) => match columns[..] {
                [(column, _)] => {
                    let stated_s = stated_unit(layout, column, Dimension::Time).and_then(|s| s.1);
                    may_be_sexagesimal(stated_s).then(Sexagesimal::default)
                }
                _ => None,
            },
            _ => None,
        };
        Some(Clock {
            reading,
            decimal: map.file.decimal,
            thousands: map.file.thousands,
            period_ns: 1e9 / time.rate_hz.unwrap_or(1.0),
            epoch_ns: time.epoch_ns,
            unwrap_bits: time.unwrap_bits,
            rows: -1,
            last_count: None,
            turns: 0,
            clock_turns: 0,
            last_of_turn: 0,
            turn_ns: 0,
            last_clock: None,
            beyond_bits: None,
            zones: Zones::new(time.utc_offset_min),
            leap: Leap::default(),
            sexagesimal,
        })
    }

    /// Puts rounded stamps back to the map's rate; `None` = the map states none, or there are no stamps.
    pub fn even(&self, time: &TimeMap, granularity_ns: i128) -> Option<EvenRows> {
        let stamps = !matches!(self.reading, Reading::Rows | Reading::Frames(_));
        time.rate_hz
            .filter(|_| stamps)
            .map(|rate_hz| EvenRows::new(rate_hz, granularity_ns))
    }

    /// A row that could not be split: time goes on where rows are all there is.
    pub fn skip(&mut self) {
        self.rows += 1;
    }

    /// Time of a row \[ns\]; `None` = it cannot be read, which is noted.
    pub fn read(&mut self, cells: Cells<'_>, line: u64, bad: &mut BadCells) -> Option<i128> {
        self.rows += 1;
        let ns = self.stamp(cells, line);
        let (thousands, decimal) = (self.thousands, self.decimal);
        let plain = |cell| ungrouped(cell, thousands, decimal);
        if ns.is_none() {
            let at = match &self.reading {
                Reading::Rows => 0,
                Reading::Frames(i) => *i,
                Reading::Numbers(n) => n
                    .iter()
                    .map(|c| c.0)
                    .find(|i| number(&plain(cells.get(*i)), self.decimal).is_none())
                    .unwrap_or(n[0].0),
                Reading::Iso(i) | Reading::Pattern(i, _) => i[0],
            };
            bad.note("time", line, cells.get(at));
        }
        ns
    }

    fn stamp(&mut self, cells: Cells<'_>, line: u64) -> Option<i128> {
        // UNIX times of 1 .. 4000 CE and any counter fit; what does not is no time.
        let sane = |ns: &i128| ns.abs() < 64_000_000_000 * SECOND_NS;
        let (thousands, decimal) = (self.thousands, self.decimal);
        let plain = |cell| ungrouped(cell, thousands, decimal);
        match &self.reading {
            Reading::Rows => Some((self.rows as f64 * self.period_ns).round() as i128),
            Reading::Frames(column) => {
                let cell = plain(cells.get(*column));
                let frame = exact(&cell, decimal)?;
                let count = number(&cell, decimal)?;
                let whole = nanoseconds(frame, 1)?;
                let frame = whole.checked_add(self.rotated(count, line)?)?;
                Some((frame as f64 * self.period_ns).round() as i128).filter(sane)
            }
            Reading::Numbers(columns) if self.unwrap_bits.is_some() => {
                let (column, unit_ns) = columns[0];
                let cell = plain(cells.get(column));
                let count = number(&cell, decimal)?;
                let own = nanoseconds(exact(&cell, decimal)?, unit_ns)?;
                let rotated = self.rotated(count, line)?.checked_mul(unit_ns)?;
                own.checked_add(rotated).filter(sane)
            }
            Reading::Numbers(columns) => {
                let mut sum = self.epoch_ns;
                if let [(column, unit_ns)] = columns[..]
                    && let Some(watch) = &mut self.sexagesimal
                    && let Some(own) = number(&plain(bare(cells.get(column), unit_ns)), decimal)
                {
                    watch.row(own, line);
                }
                for (column, unit_ns) in columns {
                    let cell = plain(bare(cells.get(*column), *unit_ns));
                    let own = nanoseconds(exact(&cell, decimal)?, *unit_ns)?;
                    sum = sum.checked_add(own)?;
                }
                Some(sum).filter(sane)
            }
            Reading::Iso(columns) => {
                let read = match columns.as_slice() {
                    [one] => stamp::parse(cells.get(*one))?,
                    several => stamp::parse(&joined(cells, several))?,
                };
                Some(self.instant(&read, line))
            }
            Reading::Pattern(columns, pattern) => {
                let mut text = joined(cells, columns);
                if self.decimal == ',' {
                    text = text.replace(',', ".");
                }
                match pattern.parse(&text)? {
                    Stamp::Date(read) => Some(self.instant(&read, line)).filter(sane),
                    Stamp::Clock {
                        ns,
                        turn_ns,
                        is_second_60,
                        is_beyond,
                    } => {
                        let own = ClockCell {
                            ns,
                            turn_ns,
                            is_beyond,
                        };
                        if !own.goes_on(self.last_clock.replace(own)) {
                            return None;
                        }
                        // A clock that goes back by half its turn or more has begun again; one that counts on beyond it never does.
                        let counted_on = self.last_of_turn > turn_ns;
                        if !counted_on && self.last_of_turn - ns > turn_ns / 2 {
                            self.clock_turns += 1;
                        }
                        (self.last_of_turn, self.turn_ns) = (ns, turn_ns);
                        let ns = ns + self.clock_turns * turn_ns;
                        Some(self.leap.row(ns, is_second_60, false, line))
                    }
                }
            }
        }
    }

    /// Time of a dated stamp \[ns\], by its zone or the map's.
    fn instant(&mut self, read: &Instant, line: u64) -> i128 {
        let ns = self.zones.row(&read.zone, read.ns, line);
        self.leap.row(ns, read.is_second_60, true, line)
    }

    /// Counts to be added to the counter for its turns so far; `None` = the count is beyond its bits.
    fn rotated(&mut self, count: f64, line: u64) -> Option<i128> {
        let Some(bits) = self.unwrap_bits else {
            return Some(0);
        };
        let full = 1_i128 << bits;
        if count >= full as f64 || count < 0.0 {
            self.beyond_bits.get_or_insert(line);
            return None;
        }
        if self
            .last_count
            .is_some_and(|last| last - count > full as f64 / 2.0)
        {
            self.turns += 1;
        }
        self.last_count = Some(count);
        Some(self.turns * full)
    }

    /// Adds the clock's findings; `origin_ns` is the first row's time.
    pub fn report(
        &self,
        time: &TimeMap,
        even: Option<&EvenRows>,
        origin_ns: Option<i128>,
        findings: &mut Vec<Finding>,
    ) {
        if let Some(line) = self.beyond_bits {
            findings.fault_at(
                "unwrap",
                Some(line),
                format!(
                    "the counter on line {line} is none of {} bits: is time.unwrap right?",
                    self.unwrap_bits.unwrap_or(0)
                ),
            );
        }
        if self.turns > 0 {
            findings.info(
                "unwrapped",
                format!(
                    "the counter of time passed its end {} time(s) and was continued",
                    self.turns
                ),
            );
        } else if let Some(bits) = self.unwrap_bits {
            findings.info(
                "unwrapped",
                format!("the counter of time never passed the end of its {bits} bits"),
            );
        }
        if self.clock_turns > 0 {
            let what = if self.turn_ns > 3600 * SECOND_NS {
                "the clock of the day passed midnight"
            } else {
                "the clock of the hour passed the full hour"
            };
            findings.info(
                "midnight",
                format!("{what} {} time(s) and was continued", self.clock_turns),
            );
        }
        if let Some(carry) = self.sexagesimal.as_ref().and_then(Sexagesimal::carry) {
            findings.fault_at(
                "sexagesimal_time",
                Some(carry.line),
                format!(
                    "the stamps are clocks as hhmmss, no count: {} is followed by {} on line {}, as at the end of a minute ({} such step(s)). [time] format = \"{}\" in place of unit reads them",
                    carry.numbers[0], carry.numbers[1], carry.line, carry.count, carry.format,
                ),
            );
        }
        if let Some(even) = even {
            even.report(findings);
        }
        self.zones.report(findings);
        self.leap.report(findings);
        let Some(origin_ns) = origin_ns else {
            return;
        };
        let origin_s = origin_ns as f64 * 1e-9;
        if !time.unix && time.start_unix_s.is_none() && origin_ns != 0 {
            findings.info(
                "clock_zero",
                format!(
                    "the file's clock begins at {origin_s:.6} s: the log counts from there, and keeps that number for join"
                ),
            );
        }
        let numbers = matches!(time.source, TimeSource::Numbers(_)) && time.epoch_ns == 0;
        if time.unix && numbers && (0.0..UNIX_EARLIEST_S).contains(&origin_s) {
            findings.fault(
                "time_clock",
                format!(
                    "time.clock is 'unix' but the first stamp is {origin_s:.3} s, in {}: is the clock 'relative', or time.unit another than '{}'?",
                    1970 + (origin_s / 31_556_952.0) as i64,
                    time.unit,
                ),
            );
        }
    }
}

/// No table of motion on a UNIX clock is older \[s\]: 1980-01-01.
const UNIX_EARLIEST_S: f64 = 315_532_800.0;

/// A duration without its unit, if that is the map's: `0.01 sec`.
fn bare(cell: &str, unit_ns: i128) -> &str {
    let Some((value, word)) = cell.rsplit_once(' ') else {
        return cell;
    };
    match unit::find(Dimension::Time, word) {
        Some(u) if (u.factor * 1e9).round() as i128 == unit_ns => value.trim_end(),
        _ => cell,
    }
}

/// Cells joined by a blank.
fn joined(cells: Cells<'_>, columns: &[usize]) -> String {
    let words: Vec<&str> = columns.iter().map(|c| cells.get(*c)).collect();
    words.join(" ")
}

/// UNIX time of the first row \[ns\] and whether it is a possible one.
pub(crate) fn start_ns(time: &TimeMap, origin_ns: i128, findings: &mut Vec<Finding>) -> u64 {
    let unix_ns = if time.unix {
        origin_ns
    } else {
        let start_s = time
            .start_unix_s
            .unwrap_or(hydroline_core::clock::SIMULATION_START_UNIX_S as f64);
        (start_s * 1e9).round() as i128
    };
    // 1970 .. 2096.
    let range = 0..=4_000_000_000 * SECOND_NS;
    if !range.contains(&unix_ns) {
        findings.fault(
            "time_unit",
            format!(
                "the first stamp is UNIX {:.3e} s, outside 1970 .. 2096: is time.unit '{}' right?",
                unix_ns as f64 * 1e-9,
                time.unit
            ),
        );
    }
    u64::try_from(unix_ns.clamp(*range.start(), *range.end())).unwrap_or(0)
}
