//! The map's `[time]`.

use chrono::format::{Item, StrftimeItems};

use super::Checker;
use crate::map::raw::{RawTime, RawUnits};
use crate::map::{Column, MapError, TimeMap, TimeSource};
use crate::stamp::{self, Zone};
use crate::unit::{self, Dimension};

/// Days from a spreadsheet's zero (1899-12-30) to 1970-01-01.
const SPREADSHEET_DAYS: i128 = 25_569;
/// Days from MATLAB's zero (0000-01-00) to 1970-01-01: `datenum(1970,1,1)`.
const MATLAB_DAYS: i128 = 719_529;
/// Seconds from LabVIEW's zero (1904-01-01) to 1970-01-01.
const LABVIEW_S: i128 = 2_082_844_800;
/// Runs of one file that can be chosen.
const RUNS_MAX: u32 = 10_000;
const SECOND_NS: i128 = 1_000_000_000;
const DAY_NS: i128 = 86_400_000_000_000;

/// Nanoseconds of a unit of time.
fn unit_ns(text: &str) -> Option<i128> {
    unit::find(Dimension::Time, text).map(|u| (u.factor * 1e9).round() as i128)
}

impl Checker<'_> {
    fn time_columns(&self, raw: &mut RawTime) -> Result<Vec<Column>, MapError> {
        match (raw.column.take(), raw.columns.take()) {
            (Some(_), Some(_)) => self.bad(
                "time.columns",
                "given",
                "time.column is given too: one of the two",
            ),
            (Some(one), None) => Ok(vec![self.column("time", one, raw.nth)?]),
            (None, Some(several)) if (1..=6).contains(&several.len()) => several
                .into_iter()
                .map(|c| self.column("time", c, None))
                .collect(),
            (None, Some(several)) => {
                self.bad("time.columns", several.len(), "it takes one to six columns")
            }
            (None, None) => Ok(Vec::new()),
        }
    }

    pub(super) fn time(&self, mut raw: RawTime) -> Result<TimeMap, MapError> {
        let columns = self.time_columns(&mut raw)?;
        if let Some(rate_hz) = raw.rate_hz.filter(|r| !(1e-3..=1e6).contains(r)) {
            return self.bad(
                "rate_hz",
                rate_hz,
                "it must be 0.001 .. 1000000 rows per second",
            );
        }
        let units: Vec<String> = match raw.unit.take() {
            None => Vec::new(),
            Some(RawUnits::One(one)) => vec![one],
            Some(RawUnits::Each(each)) => each,
        };
        let word = units.first().map_or("", String::as_str).to_owned();
        let (mut unix, mut epoch_ns) = (false, 0);
        let source = if let Some(format) = raw.format.take() {
            if !matches!(word.as_str(), "" | "iso8601") {
                return self.bad(
                    "time.unit",
                    word,
                    "time.format says how stamps are written: leave unit out",
                );
            }
            let items: Vec<Item<'_>> = StrftimeItems::new(&format).collect();
            if columns.is_empty() || items.iter().any(|i| matches!(i, Item::Error)) {
                return self.bad(
                    "time.format",
                    format,
                    "it is a pattern of strftime for time.column (or columns, joined by a blank), such as %d.%m.%Y %H:%M:%S%.f or %m/%d/%Y %I:%M:%S%.f %p",
                );
            }
            unix = ["%Y", "%y", "%F", "%D", "%s", "%c", "%+", "%x"]
                .iter()
                .any(|d| format.contains(d));
            TimeSource::Pattern(columns, format)
        } else if columns.is_empty() {
            if raw.rate_hz.is_none() {
                return self.bad(
                    "time",
                    "without column",
                    "give column = \"NAME\" (or its number) and unit, or rate_hz = .. for a table without time",
                );
            }
            TimeSource::Rows
        } else if word == "iso8601" {
            unix = true;
            TimeSource::Iso(columns)
        } else if let (true, Some(_), [frame]) = (
            matches!(word.as_str(), "" | "frames" | "frame"),
            raw.rate_hz,
            &columns[..],
        ) {
            TimeSource::Frames(frame.clone())
        } else {
            let days = |zero: i128| (zero * DAY_NS, true, vec![DAY_NS]);
            let ns: Vec<i128>;
            (epoch_ns, unix, ns) = match word.as_str() {
                "spreadsheet_days" | "excel_days" => days(-SPREADSHEET_DAYS),
                "matlab_days" | "datenum" => days(-MATLAB_DAYS),
                "labview_s" => (-LABVIEW_S * SECOND_NS, true, vec![SECOND_NS]),
                _ => {
                    let ns: Option<Vec<i128>> = units.iter().map(|u| unit_ns(u)).collect();
                    let Some(ns) = ns.filter(|n| !n.is_empty()) else {
                        return self.bad(
                            "time.unit",
                            units.join(" "),
                            format!(
                                "it must be one of {} (in days since a zero of their own: spreadsheet_days matlab_days; in seconds since 1904: labview_s), iso8601, frames with rate_hz, or time.format a pattern",
                                unit::names(Dimension::Time)
                            ),
                        );
                    };
                    (0, false, ns)
                }
            };
            if ns.len() != columns.len() {
                return self.bad(
                    "time.unit",
                    units.join(" "),
                    format!("there are {} columns of time, whose numbers are added: give each its unit, [\"s\", \"ns\"]", columns.len()),
                );
            }
            TimeSource::Numbers(columns.into_iter().zip(ns).collect())
        };
        let numbers = matches!(&source, TimeSource::Numbers(n) if n.len() == 1);
        if let Some(bits) = raw.unwrap.filter(|b| {
            !(8..=62).contains(b) || !(numbers || matches!(source, TimeSource::Frames(_)))
        }) {
            return self.bad(
                "time.unwrap",
                bits,
                "it is how many bits the counter in the one column of time has, 8 .. 62",
            );
        }
        match raw.clock.as_deref() {
            None => {}
            Some("relative") => unix = matches!(source, TimeSource::Iso(_)) || epoch_ns != 0,
            Some("unix") => unix = true,
            Some(other) => {
                return self.bad("time.clock", other, "it must be relative or unix");
            }
        }
        let counts = matches!(source, TimeSource::Numbers(_) | TimeSource::Frames(_)) && !unix;
        if let Some(boot) = raw.boot.filter(|b| !(1..=RUNS_MAX).contains(b) || !counts) {
            return self.bad(
                "time.boot",
                boot,
                format!(
                    "it is which run (1 .. {RUNS_MAX}) of a counter that starts anew; dates and UNIX times do not: from_s and to_s choose rows of those"
                ),
            );
        }
        for (key, value) in [
            ("start_unix_s", raw.start_unix_s),
            ("from_s", raw.from_s),
            ("to_s", raw.to_s),
        ] {
            if value.is_some_and(|v| !v.is_finite()) {
                return self.bad(
                    format!("time.{key}"),
                    value.unwrap_or(0.0),
                    "it must be finite",
                );
            }
        }
        let utc_offset_min = match raw.utc_offset.as_deref() {
            None => None,
            Some(text) => {
                let dated = matches!(source, TimeSource::Iso(_) | TimeSource::Pattern(..));
                let Some(Zone::Offset(minutes)) = stamp::zone(text).filter(|_| dated) else {
                    return self.bad(
                        "time.utc_offset",
                        text,
                        "it is the offset of stamps that state none, such as \"+02:00\" or \"Z\", for unit = \"iso8601\" and format",
                    );
                };
                Some(minutes)
            }
        };
        let compare = match raw.compare_column.take() {
            None => None,
            Some(column) => {
                let text = raw.compare_unit.as_deref().unwrap_or("s");
                let Some(unit) = unit::find(Dimension::Time, text) else {
                    return self.bad(
                        "time.compare_unit",
                        text,
                        format!("it must be one of {}", unit::names(Dimension::Time)),
                    );
                };
                Some((
                    self.column("time.compare_column", column, None)?,
                    unit.factor,
                ))
            }
        };
        Ok(TimeMap {
            source,
            unit: word,
            rate_hz: raw.rate_hz,
            unwrap_bits: raw.unwrap,
            unix,
            epoch_ns,
            start_unix_s: raw.start_unix_s,
            boot: raw.boot,
            utc_offset_min,
            from_s: raw.from_s,
            to_s: raw.to_s,
            compare,
        })
    }
}
