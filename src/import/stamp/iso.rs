//! ISO 8601 stamps with their zone.

use chrono::{Days, NaiveDate, Weekday};

use super::half_day::half_day;
use super::{Instant, SECOND_NS, Zone};
use crate::number::{ascii, exact, nanoseconds};

/// Hours of the largest offset from UTC: +14:00 is the law's, local mean times reached 15.
const OFFSET_HOURS_MAX: i32 = 15;

/// Digits only, as a number.
fn digits<T: std::str::FromStr>(text: &str) -> Option<T> {
    let all = !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    text.parse().ok().filter(|_| all)
}

/// A stamp: date and clock in the extended or the basic form (calendar, ordinal or week date; `T` or a blank between
/// them), then the zone: `Z`, `+hh`, `+hhmm`, `+hh:mm`, `UTC`, a name, or none. RFC 9557's name in brackets is
/// passed over behind an offset.
///
/// Without an offset the stamp is read as in UTC; which zone it had is returned.
pub(crate) fn parse(text: &str) -> Option<Instant> {
    let text = ascii(text);
    let (date, rest) = date(text.trim())?;
    let rest = rest.strip_prefix(['T', 't', ' ', '_'])?.trim_start();
    let (rest, bracket) = match rest.split_once('[') {
        Some((before, name)) => (before.trim_end(), Some(name.strip_suffix(']')?)),
        None => (rest, None),
    };
    let is_clock = |c: char| c.is_ascii_digit() || matches!(c, ':' | '.' | ',');
    let (clock, written) = rest.split_at(rest.find(|c| !is_clock(c)).unwrap_or(rest.len()));
    let (hour, minute, second_ns) = clock_parts(clock)?;
    let date = match hour {
        // The end of a day.
        24 if minute == 0 && second_ns < SECOND_NS => date.checked_add_days(Days::new(1))?,
        _ => date,
    };
    let minutes = date
        .and_hms_opt(hour % 24, minute, 0)
        .filter(|_| hour <= 24)?;
    if hour == 24 && (minute, second_ns / SECOND_NS) != (0, 0) {
        return None;
    }
    let zone = match (zone(written)?, bracket) {
        (Zone::Open, Some(name)) => zone(name)?,
        (zone, _) => zone,
    };
    let east_min = match zone {
        Zone::Offset(minutes) => i64::from(minutes),
        _ => 0,
    };
    let utc_s = minutes.and_utc().timestamp() - east_min * 60;
    Some(Instant {
        ns: i128::from(utc_s) * SECOND_NS + second_ns,
        zone,
        is_second_60: second_ns >= 60 * SECOND_NS,
    })
}

/// A date, and what stands behind it.
fn date(text: &str) -> Option<(NaiveDate, &str)> {
    let part = |from: usize, to: usize| text.get(from..to).and_then(digits::<u32>);
    let year: i32 = digits(text.get(..4)?)?;
    let bytes = text.as_bytes();
    let is = |at: usize, mark: u8| bytes.get(at).is_some_and(|b| b.eq_ignore_ascii_case(&mark));
    let run = bytes.iter().take_while(|b| b.is_ascii_digit()).count();
    let calendar = |month, day| NaiveDate::from_ymd_opt(year, month, day);
    let week = |week, day: u32| {
        let day = Weekday::try_from(u8::try_from(day.checked_sub(1)?).ok()?).ok()?;
        NaiveDate::from_isoywd_opt(year, week, day)
    };
    let (date, end) = match run {
        8 => (calendar(part(4, 6)?, part(6, 8)?), 8),
        7 => (NaiveDate::from_yo_opt(year, part(4, 7)?), 7),
        4 if is(4, b'W') => (week(part(5, 7)?, part(7, 8)?), 8),
        4 if is(4, b'-') && is(5, b'W') && is(8, b'-') => (week(part(6, 8)?, part(9, 10)?), 10),
        4 if is(4, b'-') && is(7, b'-') => (calendar(part(5, 7)?, part(8, 10)?), 10),
        4 if is(4, b'-') => (NaiveDate::from_yo_opt(year, part(5, 8)?), 8),
        _ => return None,
    };
    Some((date?, &text[end..]))
}

/// Hour, minute and nanoseconds of the minute, from `hh:mm[:ss[.f]]` or `hhmm[ss[.f]]`.
fn clock_parts(text: &str) -> Option<(u32, u32, i128)> {
    let (hour, minute, second) = if text.contains(':') {
        let mut parts = text.split(':');
        let (hour, minute) = (parts.next()?, parts.next()?);
        let second = parts.next();
        if parts.next().is_some() || hour.len() > 2 || minute.len() > 2 {
            return None;
        }
        (hour, minute, second)
    } else {
        let whole = text.find(['.', ',']).unwrap_or(text.len());
        match whole {
            6 => (&text[..2], &text[2..4], Some(&text[4..])),
            4 if text.len() == 4 => (&text[..2], &text[2..], None),
            _ => return None,
        }
    };
    // Both signs of decimals are the standard's.
    let second = second.unwrap_or("0").replace(',', ".");
    let second_ns = nanoseconds(exact(&second, '.')?, SECOND_NS)?;
    (0..61 * SECOND_NS)
        .contains(&second_ns)
        .then_some((digits(hour)?, digits(minute)?, second_ns))
}

/// The zone that a text is; `None` = it is none at all, as the half of a day behind a clock of twelve hours is.
pub(crate) fn zone(text: &str) -> Option<Zone> {
    let text = ascii(text);
    let text = text.trim();
    if half_day(text).is_some() {
        return None;
    }
    let upper = text.to_ascii_uppercase();
    let behind = ["UTC", "GMT", "UT", "Z"]
        .iter()
        .find_map(|name| upper.strip_prefix(name));
    match behind {
        Some("") => return Some(Zone::Offset(0)),
        Some(offset) if offset.starts_with(['+', '-']) => return offset_min(offset),
        _ => {}
    }
    match text.chars().next() {
        None => Some(Zone::Open),
        Some('+' | '-') => offset_min(text),
        Some(_) => text
            .chars()
            .all(|c| c.is_alphabetic() || matches!(c, '/' | '_' | '-' | '+') || c.is_ascii_digit())
            .then(|| Zone::Named(text.to_owned()))
            .filter(|_| text.starts_with(char::is_alphabetic)),
    }
}

/// `+hh`, `+hhmm`, `+hh:mm`.
fn offset_min(text: &str) -> Option<Zone> {
    let sign = if text.starts_with('-') { -1 } else { 1 };
    let own = &text[1..];
    let (hours, minutes) = match own.split_once(':') {
        Some((hours, minutes)) if minutes.len() == 2 => (hours, minutes),
        Some(_) => return None,
        None => own.split_at_checked(own.len().min(2))?,
    };
    let hours: i32 = digits(hours)?;
    let minutes: i32 = match minutes {
        "" => 0,
        two if two.len() == 2 => digits(two)?,
        _ => return None,
    };
    (hours <= OFFSET_HOURS_MAX && minutes < 60)
        .then_some(Zone::Offset(sign * (60 * hours + minutes)))
}
