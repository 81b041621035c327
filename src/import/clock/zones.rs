//! Zones of a column of stamps, and the seconds that a leap adds.

use chrono::{DateTime, Datelike};

use crate::check::{Finding, FindingList};
use crate::stamp::{SECOND_NS, Zone};

const MINUTE_NS: i128 = 60 * SECOND_NS;

/// Zones in the order in which they came.
#[derive(Debug, Default)]
pub(super) struct Zones {
    /// Offset of stamps that state none \[min\].
    stated_min: Option<i32>,
    seen: Vec<(Zone, u64)>,
    /// Zone of the row before, and its time \[ns\].
    last: Option<(Zone, i128)>,
    /// A zone changed without a word of its own, or the time jumped by as much as the zone did.
    is_mixed: bool,
}

fn words(zone: &Zone) -> String {
    match zone {
        Zone::Open => "no zone".to_owned(),
        Zone::Offset(minutes) => {
            let sign = if *minutes < 0 { '-' } else { '+' };
            let size = minutes.abs();
            format!("UTC{sign}{:02}:{:02}", size / 60, size % 60)
        }
        Zone::Named(name) => format!("'{name}'"),
    }
}

impl Zones {
    pub fn new(stated_min: Option<i32>) -> Zones {
        Zones {
            stated_min,
            ..Zones::default()
        }
    }

    /// UNIX time of a stamp \[ns\]: as it is, or by the map's offset where it states none.
    pub fn row(&mut self, zone: &Zone, ns: i128, line: u64) -> i128 {
        if !self.seen.iter().any(|s| s.0 == *zone) {
            self.seen.push((zone.clone(), line));
        }
        let ns = match (zone, self.stated_min) {
            (Zone::Open | Zone::Named(_), Some(minutes)) => ns - i128::from(minutes) * MINUTE_NS,
            _ => ns,
        };
        let changed = match &mut self.last {
            Some((before, at_ns)) if before == zone => {
                *at_ns = ns;
                return ns;
            }
            last => last.replace((zone.clone(), ns)),
        };
        if let Some((before, at_ns)) = changed {
            self.is_mixed |= match (self.offset_min(&before), self.offset_min(zone)) {
                // An offset that a row forgot to follow shows as a jump of its size.
                (Some(a), Some(b)) => {
                    a != b && 2 * (ns - at_ns).abs() >= i128::from((a - b).abs()) * MINUTE_NS
                }
                _ => true,
            };
        }
        ns
    }

    fn offset_min(&self, zone: &Zone) -> Option<i32> {
        match zone {
            Zone::Offset(minutes) => Some(*minutes),
            Zone::Open => self.stated_min,
            // One offset is not that of two names.
            Zone::Named(_) => None,
        }
    }

    pub fn report(&self, findings: &mut Vec<Finding>) {
        let named = |s: &&(Zone, u64)| matches!(s.0, Zone::Named(_));
        if let Some((zone, line)) = self.seen.iter().find(named)
            && self.stated_min.is_none()
        {
            findings.fault_at("zone_name", Some(*line), format!("stamps are in the zone {} (line {line}), a name that states no offset and that several zones have: [time] utc_offset = \"+02:00\" (or whichever it is) says it, or export stamps with an offset", words(zone)));
        }
        match &self.seen[..] {
            [] => return,
            [(Zone::Open, line)] if self.stated_min.is_none() => {
                findings.warning_at("time_zone_missing", Some(*line), "stamps carry no time zone: read as UTC; a change of daylight saving time between them could not be distinguished from a gap. [time] utc_offset = \"+01:00\" says another".to_owned());
                return;
            }
            [_] => return,
            _ => {}
        }
        let all: Vec<String> = self
            .seen
            .iter()
            .map(|(zone, line)| format!("{} from line {line}", words(zone)))
            .collect();
        let all = format!(
            "stamps are in {} time zones: {}",
            self.seen.len(),
            all.join(", ")
        );
        if !self.is_mixed {
            findings.info(
                "time_zones",
                format!("{all}; each is stated and time goes on through the change"),
            );
            return;
        }
        let is_open = self.seen.iter().any(|s| s.0 == Zone::Open);
        let hint = if is_open && self.stated_min.is_none() {
            "; [time] utc_offset = \"+00:00\" (or whichever it is) is the zone of those that state none"
        } else {
            ""
        };
        findings.fault_at(
            "mixed_time_zones",
            Some(self.seen[1].1),
            format!("{all}{hint}"),
        );
    }
}

/// The sixtieth second of a minute: a leap second, after which a run goes on a second later, or a fraction that was
/// rounded up.
#[derive(Debug, Default)]
pub(super) struct Leap {
    /// Last stamp with a sixtieth second, while no other followed \[ns\].
    last_ns: Option<i128>,
    /// Seconds that leaps added so far.
    added: i128,
    /// Line of the first sixtieth second.
    line: Option<u64>,
}

/// Whether a sixtieth second ends June or December in UTC, when leap seconds are.
fn is_announced(ns: i128) -> bool {
    let day = i64::try_from(ns.div_euclid(SECOND_NS)).ok();
    let after = day.and_then(|s| DateTime::from_timestamp(s, 0));
    ns.rem_euclid(86_400 * SECOND_NS) < SECOND_NS
        && after.is_some_and(|d| d.day() == 1 && matches!(d.month(), 1 | 7))
}

impl Leap {
    /// Time of a stamp that counts every second \[ns\].
    pub fn row(&mut self, ns: i128, is_second_60: bool, is_dated: bool, line: u64) -> i128 {
        if is_second_60 {
            self.line.get_or_insert(line);
            self.last_ns = Some(ns);
        } else if let Some(last_ns) = self.last_ns.take()
            && (ns <= last_ns || (is_dated && is_announced(last_ns)))
        {
            // UTC repeats the number; the run goes on.
            self.added += 1;
        }
        ns + self.added * SECOND_NS
    }

    pub fn report(&self, findings: &mut Vec<Finding>) {
        let Some(line) = self.line else { return };
        let words = if self.added > 0 {
            "a leap second: it is counted, so that time goes on and later rows are that much behind UTC's number"
        } else {
            "a fraction that was rounded up: the next minute's beginning"
        };
        findings.info(
            "second_60",
            format!("the second 60 on line {line} is read as {words}"),
        );
    }
}
