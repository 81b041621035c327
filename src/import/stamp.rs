//! ISO 8601 stamps with their zone.

/// Zone of a stamp: minutes east of Greenwich, or none written.
pub type Zone = Option<i32>;

/// `2026-03-01T12:00:00.25+01:00` (T or blank; zone Z, +hh:mm, +hhmm or none) as UNIX \[s\] and zone.
///
/// Without a zone the stamp is read as UTC; that it had none is returned.
pub fn parse(text: &str) -> Option<(f64, Zone)> {
    let text = text.trim();
    let (date, rest) = text.split_at_checked(10)?;
    let mut parts = date.split('-');
    let mut number = || parts.next()?.parse::<i64>().ok();
    let (year, month, day) = (number()?, number()?, number()?);
    if !(1..=12).contains(&month) || !(1..=days_in(year, month)).contains(&day) {
        return None;
    }
    let rest = rest.strip_prefix(['T', 't', ' '])?;
    let zone_at = rest.find(['Z', 'z', '+', '-']).unwrap_or(rest.len());
    let (clock, zone) = rest.split_at(zone_at);
    let mut parts = clock.trim_end().split(':');
    let hour: i64 = parts.next()?.parse().ok()?;
    let minute: i64 = parts.next()?.parse().ok()?;
    let second: f64 = parts.next().unwrap_or("0").parse().ok()?;
    if !(0..24).contains(&hour)
        || !(0..60).contains(&minute)
        || !(0.0..61.0).contains(&second)
        || parts.next().is_some()
    {
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
    let whole = days(year, month, day) * 86_400 + hour * 3600 + minute * 60
        - i64::from(zone.unwrap_or(0)) * 60;
    Some((whole as f64 + second, zone))
}

/// Days of a month of the Gregorian calendar.
fn days_in(year: i64, month: i64) -> i64 {
    let (next_year, next) = if month == 12 {
        (year + 1, 1)
    } else {
        (year, month + 1)
    };
    days(next_year, next, 1) - days(year, month, 1)
}

/// Days since 1970-01-01 of a Gregorian date (Howard Hinnant, chrono-compatible date algorithms).
fn days(year: i64, month: i64, day: i64) -> i64 {
    let y = if month <= 2 { year - 1 } else { year };
    let era = y.div_euclid(400);
    let of_era = y - era * 400;
    let of_year = (153 * ((month + 9) % 12) + 2) / 5 + day - 1;
    era * 146_097 + of_era * 365 + of_era / 4 - of_era / 100 + of_year - 719_468
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_of_known_instants() {
        assert_eq!(parse("1970-01-01T00:00:00Z"), Some((0.0, Some(0))));
        assert_eq!(parse("2020-09-13 12:26:40"), Some((1_600_000_000.0, None)));
        assert_eq!(
            parse("2020-09-13T14:26:40.5+02:00"),
            Some((1_600_000_000.5, Some(120)))
        );
        assert_eq!(
            parse("2024-02-29T00:00:00-0130"),
            Some((1_709_170_200.0, Some(-90)))
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
