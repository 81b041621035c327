//! Stamps of dates and clocks: ISO 8601, and by a pattern.

mod half_day;
mod iso;
mod pattern;

pub(crate) use iso::{parse, zone};
pub(crate) use pattern::{Pattern, Stamp};

pub(crate) const SECOND_NS: i128 = 1_000_000_000;

/// Zone of a stamp, as it is written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Zone {
    /// None.
    Open,
    /// Minutes east of Greenwich.
    Offset(i32),
    /// A name that says no offset by itself: CST is one in America, one in China and one in Australia.
    Named(String),
}

/// A stamp as it is read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Instant {
    /// UNIX time \[ns\]; as if in UTC where the zone states no offset.
    pub ns: i128,
    /// Zone that is written.
    pub zone: Zone,
    /// Whether its second is the sixtieth: a leap second, or a fraction that was rounded up.
    pub is_second_60: bool,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_read_what_people_write() {
        let read = |format: &str, text: &str| Pattern::new(format)?.parse(text);
        let date = |ns, zone| {
            Some(Stamp::Date(Instant {
                ns,
                zone,
                is_second_60: false,
            }))
        };
        let expected = date(1_709_633_472_123_000_000, Zone::Open);
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
            date(1_709_633_472_000_000_000, Zone::Offset(60))
        );
        let noon = 12 * 3600 * SECOND_NS;
        let day = |ns| {
            let turn_ns = 86_400 * SECOND_NS;
            Some(Stamp::Clock {
                ns,
                turn_ns,
                is_second_60: false,
                is_beyond: ns >= turn_ns,
            })
        };
        assert_eq!(read("%I:%M:%S %p", "12:00:00 PM"), day(noon));
        // A narrow blank, as newer programs write it before AM and PM.
        assert_eq!(read("%I:%M:%S %p", "12:00:00\u{202f}PM"), day(noon));
        for half in ["pm", "p.m.", "P.M.", "p.\u{a0}m."] {
            let text = format!("12:00:00 {half}");
            assert_eq!(read("%I:%M:%S %p", &text), day(noon), "{text}");
        }
        // A zone's name stands in no half of a day's place.
        assert_eq!(read("%d.%m.%Y %H:%M:%S %Z", "05.03.2024 01:11:12 PM"), None);
        // Hours of a clock that runs on beyond a day; zeros that a spreadsheet dropped.
        assert_eq!(read("%H:%M:%S%.f", "36:00:00.0"), day(3 * noon));
        assert_eq!(
            read("%H%M%S%.f", "93050.25"),
            day((9 * 3600 + 30 * 60 + 50) * SECOND_NS + 250_000_000)
        );
        let hour = |ns| {
            let turn_ns = 3600 * SECOND_NS;
            Some(Stamp::Clock {
                ns,
                turn_ns,
                is_second_60: false,
                is_beyond: ns >= turn_ns,
            })
        };
        assert_eq!(
            read("%M:%S%.f", "58:59.5"),
            hour((58 * 60 + 59) * SECOND_NS + 500_000_000)
        );
        assert_eq!(read("%M:%S%.f", "75:00"), hour(75 * 60 * SECOND_NS));
        assert_eq!(read("%M:%S%.f", "75:61"), None);
        let named = |text: &str| read("%Y-%m-%d %H:%M:%S %Z", text);
        assert_eq!(
            named("2024-03-05 10:11:12 UTC"),
            date(1_709_633_472_000_000_000, Zone::Offset(0))
        );
        assert_eq!(
            named("2024-03-05 10:11:12 CET"),
            date(1_709_633_472_000_000_000, Zone::Named("CET".into()))
        );
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
        let of = |ns, zone| {
            Some(Instant {
                ns,
                zone,
                is_second_60: false,
            })
        };
        let whole = |s: i128, zone| of(s * SECOND_NS, zone);
        assert_eq!(parse("1970-01-01T00:00:00Z"), of(0, Zone::Offset(0)));
        assert_eq!(
            parse("2020-09-13 12:26:40"),
            whole(1_600_000_000, Zone::Open)
        );
        for (text, zone) in [
            ("2020-09-13T14:26:40.5+02:00", Zone::Offset(120)),
            ("20200913T142640,5+02", Zone::Offset(120)),
            ("2020-257T12:26:40.5 UTC", Zone::Offset(0)),
            ("2020257T122640.5Z", Zone::Offset(0)),
            ("2020-W37-7T12:26:40.5", Zone::Open),
            (
                "2020-09-13T08:26:40.5\u{2212}04:00[America/New_York]",
                Zone::Offset(-240),
            ),
            ("2020-09-13 12:26:40.5 CEST", Zone::Named("CEST".into())),
            (
                "2020-09-13T12:26:40.5[Europe/Berlin]",
                Zone::Named("Europe/Berlin".into()),
            ),
        ] {
            assert_eq!(parse(text), of(1_600_000_000_500_000_000, zone), "{text}");
        }
        assert_eq!(
            parse("2024-02-29T00:00:00-0130"),
            whole(1_709_170_200, Zone::Offset(-90))
        );
        assert_eq!(
            parse("2020-09-12T24:00:00Z"),
            whole(1_599_955_200, Zone::Offset(0))
        );
        let leap = parse("2016-12-31T23:59:60.25Z").unwrap();
        assert_eq!(
            (leap.ns, leap.is_second_60),
            (1_483_228_800_250_000_000, true)
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
            "2020-01-01T24:00:01.5",
            "2020-01-01T12:00:61",
            "2020-01-01T1:2:3:4",
            "2020-01-01T12:00:00+25:00",
            "2020-01-01T12:00:00+02:75",
            "2020-366T12:00:00:00",
            "2021-366T12:00:00",
            "20200101120000",
            "2020-09-13 01:26:40.5 PM",
            "2020-09-13T01:26:40 am",
            "2020-09-13 01:26:40 p.m.",
        ] {
            assert_eq!(parse(bad), None, "{bad}");
        }
    }
}
