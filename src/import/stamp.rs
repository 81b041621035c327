//! ISO 8601 stamps with their zone, and stamps by a pattern.

use chrono::NaiveDate;
use chrono::format::{Item, Parsed, StrftimeItems, parse as parse_items};

use super::number::{exact, nanoseconds};

pub(crate) const SECOND_NS: i128 = 1_000_000_000;

/// Zone of a stamp: minutes east of Greenwich, or none written.
pub type Zone = Option<i32>;

/// `2026-03-01T12:00:00.25+01:00` (T or blank; zone Z, +hh:mm, +hhmm or none) as UNIX \[ns\] and zone.
///
/// Without a zone the stamp is read as UTC; that it had none is returned.
pub fn parse(text: &str) -> Option<(i128, Zone)> {
    let text = text.trim();
    let (date, rest) = text.split_at_checked(10)?;
    let mut parts = date.split('-');
    let mut number = || parts.next()?.parse::<u32>().ok();
    let (year, month, day) = (number()?, number()?, number()?);
    let date = NaiveDate::from_ymd_opt(year.try_into().ok()?, month, day)?;
    let rest = rest.strip_prefix(['T', 't', ' '])?;
    let zone_at = rest.find(['Z', 'z', '+', '-']).unwrap_or(rest.len());
    let (clock, zone) = rest.split_at(zone_at);
    let mut parts = clock.trim_end().split(':');
    let hour: u32 = parts.next()?.parse().ok()?;
    let minute: u32 = parts.next()?.parse().ok()?;
    let to_the_minute = date.and_hms_opt(hour, minute, 0)?.and_utc().timestamp();
    // Both signs are the standard's.
    let second = parts.next().unwrap_or("0").replace(',', ".");
    let second_ns = nanoseconds(exact(&second, '.')?, SECOND_NS)?;
    if !(0..61 * SECOND_NS).contains(&second_ns) || parts.next().is_some() {
        return None;
    }
    let zone = match zone.trim() {
        "" => None,
        "Z" | "z" => Some(0),
        offset => {
            let sign = if offset.starts_with('-') { -1 } else { 1 };
            let digits: String = offset.chars().filter(char::is_ascii_digit).collect();
            let (h, m) = digits.split_at_checked(2)?;
            Some(
                sign * (h.parse::<i32>().ok()? * 60
                    + if m.is_empty() {
                        0
                    } else {
                        m.parse::<i32>().ok()?
                    }),
            )
        }
    };
    let utc = to_the_minute - i64::from(zone.unwrap_or(0)) * 60;
    Some((i128::from(utc) * SECOND_NS + second_ns, zone))
}

/// A pattern as of `strftime`, made ready.
pub(crate) struct Pattern {
    items: Vec<Item<'static>>,
}

/// A stamp read by a pattern.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Stamp {
    /// UNIX \[ns\] and zone.
    Date(i128, Zone),
    /// Since midnight \[ns\]: the pattern has no date.
    OfDay(i128),
}

impl Pattern {
    /// `None` = no pattern.
    pub fn new(format: &str) -> Option<Pattern> {
        let items = StrftimeItems::new(format).parse_to_owned().ok()?;
        Some(Pattern { items })
    }

    pub fn parse(&self, text: &str) -> Option<Stamp> {
        let mut parsed = Parsed::new();
        parse_items(&mut parsed, text.trim(), self.items.iter()).ok()?;
        let ns = |s: i64, nanos: u32| i128::from(s) * SECOND_NS + i128::from(nanos);
        if parsed.offset().is_some() || parsed.timestamp().is_some() {
            let at = parsed.to_datetime().ok()?;
            let zone = at.offset().local_minus_utc() / 60;
            return Some(Stamp::Date(
                ns(at.timestamp(), at.timestamp_subsec_nanos()),
                Some(zone),
            ));
        }
        if let Ok(at) = parsed.to_naive_datetime_with_offset(0) {
            let utc = at.and_utc();
            return Some(Stamp::Date(
                ns(utc.timestamp(), utc.timestamp_subsec_nanos()),
                None,
            ));
        }
        // A date that is none, or one without a clock.
        if parsed.year().is_some() || parsed.month().is_some() || parsed.day().is_some() {
            return None;
        }
        use chrono::Timelike;
        let at = parsed.to_naive_time().ok()?;
        Some(Stamp::OfDay(ns(
            i64::from(at.num_seconds_from_midnight()),
            at.nanosecond(),
        )))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_read_what_people_write() {
        let read = |format: &str, text: &str| Pattern::new(format)?.parse(text);
        let expected = Some(Stamp::Date(1_709_633_472_123_000_000, None));
        for (format, text) in [
            ("%d.%m.%Y %H:%M:%S%.f", "05.03.2024 10:11:12.123"),
            ("%m/%d/%Y %I:%M:%S%.f %p", "03/05/2024 10:11:12.123 AM"),
            ("%d-%b-%Y %H:%M:%S%.f", "05-Mar-2024 10:11:12.123"),
            ("%Y/%m/%d %H:%M:%S%.f", "2024/03/05 10:11:12.123"),
        ] {
            assert_eq!(read(format, text), expected, "{text}");
        }
        assert_eq!(
            read("%Y-%m-%d %H:%M:%S %z", "2024-03-05 11:11:12 +0100"),
            Some(Stamp::Date(1_709_633_472_000_000_000, Some(60)))
        );
        let noon = 12 * 3600 * SECOND_NS;
        assert_eq!(read("%I:%M:%S %p", "12:00:00 PM"), Some(Stamp::OfDay(noon)));
        assert_eq!(read("%d.%m.%Y", "05.03.2024"), None);
        assert_eq!(read("%d.%m.%Y %H:%M", "31.02.2024 10:00"), None);
        assert!(Pattern::new("%Q").is_none());
    }

    proptest::proptest! {
        #[test]
        fn any_text_and_pattern_is_read_or_not(format in "[%a-zA-Z.: /]{0,12}", text in "\\PC{0,20}") {
            let _ = parse(&text);
            if let Some(pattern) = Pattern::new(&format) {
                let _ = pattern.parse(&text);
            }
        }
    }

    #[test]
    fn stamps_of_known_instants() {
        assert_eq!(parse("1970-01-01T00:00:00Z"), Some((0, Some(0))));
        assert_eq!(
            parse("2020-09-13 12:26:40"),
            Some((1_600_000_000 * SECOND_NS, None))
        );
        assert_eq!(
            parse("2020-09-13T14:26:40.5+02:00"),
            Some((1_600_000_000_500_000_000, Some(120)))
        );
        assert_eq!(
            parse("2024-02-29T00:00:00-0130"),
            Some((1_709_170_200 * SECOND_NS, Some(-90)))
        );
        for bad in [
            "",
            "12:00",
            "2020-13-01T00:00:00",
            "2020-01-01T25:00:00",
            "2020-01-01",
            "2026-02-31T12:00:00Z",
            "2025-02-29T12:00:00Z",
            "2026-04-31T12:00:00Z",
            "é020-01-01T0",
        ] {
            assert_eq!(parse(bad), None, "{bad}");
        }
    }
}
