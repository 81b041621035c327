//! Stamps by a pattern as of `strftime`.

use std::borrow::Cow;

use chrono::Timelike;
use chrono::format::{
    Fixed, Item, Parsed, StrftimeItems, parse as parse_items, parse_and_remainder,
};

use super::half_day::with_usual_half;
use super::{Instant, SECOND_NS, Zone, zone};
use crate::number::{ascii, exact, nanoseconds};

const HOUR_NS: i128 = 3600 * SECOND_NS;
const DAY_NS: i128 = 24 * HOUR_NS;

/// A pattern made ready.
pub(crate) struct Pattern {
    /// Up to a zone's name, or all.
    items: Vec<Item<'static>>,
    /// Behind a zone's name; `None` = the pattern has none.
    behind_zone: Option<Vec<Item<'static>>>,
    /// Whether it names the half of a day.
    has_half_day: bool,
    /// Digits before the decimal sign where the whole pattern is `hhmmss`: written as a number it loses its zeros in front.
    hhmmss_digits: Option<usize>,
    /// Numbers between colons where the whole pattern is such a clock: its first may go beyond 23 or 59.
    colon_parts: Option<usize>,
}

/// A stamp read by a pattern.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Stamp {
    /// With a date.
    Date(Instant),
    /// Without a date: since midnight, or since the full hour.
    Clock {
        /// Since then \[ns\].
        ns: i128,
        /// After which it begins again from 0: a day or an hour \[ns\].
        turn_ns: i128,
        /// Whether its second is the sixtieth.
        is_second_60: bool,
        /// Whether its first number is beyond those of a clock: time that counts on, or a wrong digit.
        is_beyond: bool,
    },
}

fn hhmmss_digits(format: &str) -> Option<usize> {
    match format.strip_prefix("%H%M%S")? {
        "" | "%.f" | "%.3f" | "%.6f" | "%.9f" => Some(6),
        "%3f" => Some(9),
        "%6f" => Some(12),
        "%9f" => Some(15),
        _ => None,
    }
}

fn colon_parts(format: &str) -> Option<usize> {
    let whole = ["%.f", "%.3f", "%.6f", "%.9f"]
        .iter()
        .find_map(|f| format.strip_suffix(f))
        .unwrap_or(format);
    match whole {
        "%H:%M:%S" | "%T" => Some(3),
        "%M:%S" => Some(2),
        _ => None,
    }
}

/// `mm:ss.f` or `hh:mm:ss.f`, its first number of any size.
fn elapsed(text: &str, parts: usize) -> Option<Stamp> {
    let numbers: Vec<&str> = text.split(':').map(str::trim).collect();
    let (last, before) = numbers.split_last().filter(|_| numbers.len() == parts)?;
    let whole = |t: &&str| t.len() <= 6 && t.bytes().all(|b| b.is_ascii_digit());
    let second_ns = nanoseconds(exact(last, '.')?, SECOND_NS)?;
    if !before.iter().all(whole) || !(0..60 * SECOND_NS).contains(&second_ns) {
        return None;
    }
    let mut minutes = 0_i128;
    for (i, part) in before.iter().enumerate() {
        let own: i128 = part.parse().ok().filter(|v| i == 0 || *v < 60)?;
        minutes = 60 * minutes + own;
    }
    let ns = 60 * minutes * SECOND_NS + second_ns;
    let turn_ns = if parts == 2 { HOUR_NS } else { DAY_NS };
    Some(Stamp::Clock {
        ns,
        turn_ns,
        is_second_60: false,
        is_beyond: ns >= turn_ns,
    })
}

impl Pattern {
    /// `None` = no pattern.
    pub fn new(format: &str) -> Option<Pattern> {
        let mut items = StrftimeItems::new(format).parse_to_owned().ok()?;
        let is_half = |i: &Item<'_>| matches!(i, Item::Fixed(Fixed::LowerAmPm | Fixed::UpperAmPm));
        let has_half_day = items.iter().any(is_half);
        let is_name = |i: &Item<'_>| matches!(i, Item::Fixed(Fixed::TimezoneName));
        let behind_zone = items.iter().position(is_name).map(|at| {
            let behind = items.split_off(at + 1);
            items.truncate(at);
            behind
        });
        Some(Pattern {
            items,
            behind_zone,
            has_half_day,
            hhmmss_digits: hhmmss_digits(format),
            colon_parts: colon_parts(format),
        })
    }

    pub fn parse(&self, text: &str) -> Option<Stamp> {
        let text = ascii(text);
        let mut text = Cow::Borrowed(text.trim());
        if self.has_half_day
            && let Some(usual) = with_usual_half(&text)
        {
            text = Cow::Owned(usual);
        }
        if let Some(width) = self.hhmmss_digits {
            let whole = text.find('.').unwrap_or(text.len());
            if whole < width && text.starts_with(|c: char| c.is_ascii_digit()) {
                text = Cow::Owned(format!("{}{text}", "0".repeat(width - whole)));
            }
        }
        let beyond = || self.colon_parts.and_then(|parts| elapsed(&text, parts));
        self.by_items(&text).or_else(beyond)
    }

    fn by_items(&self, text: &str) -> Option<Stamp> {
        let mut parsed = Parsed::new();
        let mut named = Zone::Open;
        match &self.behind_zone {
            None => parse_items(&mut parsed, text, self.items.iter()).ok()?,
            Some(behind) => {
                let rest = parse_and_remainder(&mut parsed, text, self.items.iter()).ok()?;
                let rest = rest.trim_start();
                let (name, rest) =
                    rest.split_at(rest.find(char::is_whitespace).unwrap_or(rest.len()));
                named = zone(name)?;
                parse_items(&mut parsed, rest, behind.iter()).ok()?;
            }
        }
        let ns = |s: i64, nanos: u32| i128::from(s) * SECOND_NS + i128::from(nanos);
        let is_second_60 = parsed.second() == Some(60);
        if parsed.offset().is_some() || parsed.timestamp().is_some() {
            let at = parsed.to_datetime().ok()?;
            return Some(Stamp::Date(Instant {
                ns: ns(at.timestamp(), at.timestamp_subsec_nanos()),
                zone: Zone::Offset(at.offset().local_minus_utc() / 60),
                is_second_60,
            }));
        }
        if let Ok(at) = parsed.to_naive_datetime_with_offset(0) {
            let utc = at.and_utc();
            let east_s = match named {
                Zone::Offset(minutes) => i64::from(minutes) * 60,
                _ => 0,
            };
            return Some(Stamp::Date(Instant {
                ns: ns(utc.timestamp() - east_s, utc.timestamp_subsec_nanos()),
                zone: named,
                is_second_60,
            }));
        }
        // A date that is none, or one without a clock.
        if parsed.year().is_some() || parsed.month().is_some() || parsed.day().is_some() {
            return None;
        }
        let hour = parsed.hour_div_12().is_some() || parsed.hour_mod_12().is_some();
        let (ns, turn_ns) = match parsed.minute() {
            Some(minute) if !hour => {
                let second = parsed.second().unwrap_or(0);
                let nanos = parsed.nanosecond().unwrap_or(0);
                (ns(i64::from(60 * minute + second), nanos), HOUR_NS)
            }
            _ => {
                let at = parsed.to_naive_time().ok()?;
                let seconds = i64::from(at.num_seconds_from_midnight());
                (ns(seconds, at.nanosecond()), DAY_NS)
            }
        };
        Some(Stamp::Clock {
            ns,
            turn_ns,
            is_second_60,
            is_beyond: false,
        })
    }
}
