//! Stamps as programs and instruments write them: offsets that change, leap seconds, clocks without a date.

use chrono::{DateTime, Duration, FixedOffset, Utc};

use super::kinds;
use crate::{Imported, Map, Severity, read};

const ROWS: i64 = 500;
const STEP_MS: i64 = 40;

fn at(text: &str) -> DateTime<Utc> {
    text.parse().unwrap()
}

/// A table of stamps by `stamp`, of each row's instant, and a slow way.
fn table(start: &str, stamp: impl Fn(i64, DateTime<Utc>) -> String) -> String {
    let start = at(start);
    let row = |k| {
        let own = stamp(k, start + Duration::milliseconds(STEP_MS * k));
        format!("\"{own}\",{:.6}\n", 0.2 * (0.02 * k as f64).sin())
    };
    "t,x\n".to_owned() + &(0..ROWS).map(row).collect::<String>()
}

fn by(time: &str, text: &str) -> Imported {
    let map =
        format!("[time]\ncolumn = \"t\"\n{time}\n[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\n");
    read(text, &Map::from_toml(&map, "map.toml").unwrap())
}

const ISO: &str = "unit = \"iso8601\"";

/// Every row at its time, without a warning but those of `may`.
fn is_even(read: &Imported, may: &[&str]) {
    let mut said = kinds(read, Severity::Warning);
    said.retain(|k| !may.contains(k));
    assert_eq!(said, Vec::<&str>::new(), "{:?}", read.findings);
    assert_eq!(read.times_s.len(), ROWS as usize);
    for (k, t_s) in read.times_s.iter().enumerate() {
        assert!((t_s - 0.04 * k as f64).abs() < 1e-6, "row {k} at {t_s}");
    }
}

fn says(read: &Imported, kind: &str, words: &str) -> bool {
    let mut all = read.findings.iter().filter(|f| f.kind == kind);
    all.any(|f| f.message.contains(words))
}

#[test]
fn offsets_that_change_and_are_stated_are_instants() {
    let summer = at("2026-03-29T01:00:00Z");
    let text = table("2026-03-29T00:59:50Z", |_, t| {
        let hours = if t >= summer { 2 } else { 1 };
        let zone = FixedOffset::east_opt(3600 * hours).unwrap();
        t.with_timezone(&zone)
            .format("%Y-%m-%dT%H:%M:%S%.3f%:z")
            .to_string()
    });
    for time in [ISO, "format = \"%Y-%m-%dT%H:%M:%S%.f%z\""] {
        let found = by(time, &text);
        is_even(&found, &[]);
        assert!(says(
            &found,
            "time_zones",
            "UTC+01:00 from line 2, UTC+02:00 from line 252"
        ));
        assert_eq!(found.start_ns, 1_774_745_990_000_000_000);
    }
    // A zone on some rows only is none that is stated.
    let text = table("2026-03-29T00:59:50Z", |k, t| {
        let own = t.format("%Y-%m-%dT%H:%M:%S%.3f").to_string();
        if k % 2 == 0 { own } else { own + "Z" }
    });
    let found = by(ISO, &text);
    assert!(
        says(&found, "mixed_time_zones", "utc_offset"),
        "{:?}",
        found.findings
    );
    is_even(&by("unit = \"iso8601\"\nutc_offset = \"Z\"", &text), &[]);
}

#[test]
fn a_second_60_is_a_leap_or_was_rounded_up_and_time_goes_on() {
    let last = at("2016-12-31T23:59:59Z");
    let leap = |pattern: &'static str| {
        table("2016-12-31T23:59:50Z", move |_, t| {
            let s = (t - last).num_milliseconds();
            let own = match s {
                ..1000 => t,
                _ => t - Duration::seconds(1),
            };
            let text = own.format(pattern).to_string();
            if (1000..2000).contains(&s) {
                text.replace(":59.", ":60.")
            } else {
                text
            }
        })
    };
    let found = by(ISO, &leap("%Y-%m-%dT%H:%M:%S%.3fZ"));
    is_even(&found, &[]);
    assert!(
        says(&found, "second_60", "leap second"),
        "{:?}",
        found.findings
    );
    is_even(
        &by(
            "format = \"%d.%m.%Y %H:%M:%S%.f\"",
            &leap("%d.%m.%Y %H:%M:%S%.3f"),
        ),
        &["time_zone_missing"],
    );
    // Decimals that were rounded after the second was split off.
    let rounded = table("2026-05-04T09:00:50Z", |_, t| {
        let own = t.format("%Y-%m-%dT%H:%M:%S%.3fZ").to_string();
        own.replace("09:01:00.000", "09:00:60.000")
    });
    let found = by(ISO, &rounded);
    is_even(&found, &[]);
    assert!(
        says(&found, "second_60", "rounded up"),
        "{:?}",
        found.findings
    );
}

#[test]
fn basic_ordinal_and_week_dates_of_iso_8601_are_read() {
    for pattern in [
        "%Y%m%dT%H%M%S%.3fZ",
        "%Y-%jT%H:%M:%S%.3fZ",
        "%Y%jT%H%M%S%.3fZ",
        "%G-W%V-%uT%H:%M:%S%.3fZ",
        "%Y-%m-%d %H:%M:%S%.3f UTC",
        "%Y-%m-%dT%H:%M:%S%.3f\u{2212}00:00",
        "%Y-%m-%dT%H:%M:%S%.3f+00:00[Etc/UTC]",
    ] {
        let found = by(
            ISO,
            &table("2026-05-03T23:59:50Z", |_, t| t.format(pattern).to_string()),
        );
        is_even(&found, &[]);
        assert_eq!(found.start_ns, 1_777_852_790_000_000_000, "{pattern}");
    }
}

#[test]
fn clocks_of_minutes_and_seconds_go_on_over_the_hour() {
    let format = "format = \"%M:%S%.f\"";
    let text = table("2026-05-04T09:59:50Z", |_, t| {
        t.format("%M:%S%.3f").to_string()
    });
    let found = by(format, &text);
    is_even(&found, &[]);
    assert!(
        says(&found, "midnight", "passed the full hour 1 time"),
        "{:?}",
        found.findings
    );
    // Or they count on.
    let beyond = table("2026-05-04T00:59:50Z", |_, t| {
        let s = (t - at("2026-05-04T00:00:00Z")).num_milliseconds();
        format!("{:02}:{:02}.{:03}", s / 60_000, s / 1000 % 60, s % 1000)
    });
    is_even(&by(format, &beyond), &[]);
}

#[test]
fn one_wrong_digit_in_a_clock_cost_the_rest_of_the_file() {
    let spoilt = |format: &'static str, from: &'static str, to: &'static str| {
        table("2026-05-04T01:11:02Z", move |_, t| {
            t.format(format).to_string().replace(from, to)
        })
    };
    for (format, text) in [
        (
            "%H:%M:%S%.f",
            spoilt("%H:%M:%S%.3f", "01:11:12.000", "94:11:12.000"),
        ),
        // An hour beyond the clock's last is nearer than half a turn.
        (
            "%H:%M:%S%.f",
            spoilt("23:%M:%S%.3f", "23:11:12.000", "24:11:12.000"),
        ),
        ("%M:%S%.f", spoilt("%M:%S%.3f", "11:12.000", "91:12.000")),
    ] {
        let found = by(&format!("format = \"{format}\""), &text);
        let faults = kinds(&found, Severity::Fault);
        assert_eq!(faults, ["not_a_number"], "{format}: {:?}", found.findings);
        assert_eq!(found.times_s.len(), ROWS as usize - 1, "{format}");
        assert!((found.times_s[400] - 0.04 * 401.0).abs() < 1e-6);
    }
    // A day ends at 24:00:00, where some begin the next.
    let text = table("2026-05-03T23:59:50Z", |_, t| {
        t.format("%H:%M:%S%.3f")
            .to_string()
            .replace("00:00:00.000", "24:00:00.000")
    });
    is_even(&by("format = \"%H:%M:%S%.f\"", &text), &[]);
    // Behind a gap a clock that counts on loses one row.
    let gap = table("2026-05-04T00:59:50Z", |k, t| {
        let s = (t - at("2026-05-04T00:00:00Z")).num_milliseconds() + 120_000 * (k / 250);
        format!("{:02}:{:02}.{:03}", s / 60_000, s / 1000 % 60, s % 1000)
    });
    let found = by("format = \"%M:%S%.f\"", &gap);
    assert_eq!(found.times_s.len(), ROWS as usize - 1);
}

#[test]
fn names_of_zones_are_refused_until_the_map_says_their_offset() {
    let text = table("2026-05-04T09:00:00Z", |_, t| {
        t.format("%Y-%m-%d %H:%M:%S%.3f CEST").to_string()
    });
    for time in [ISO, "format = \"%Y-%m-%d %H:%M:%S%.f %Z\""] {
        let found = by(time, &text);
        assert!(
            says(&found, "zone_name", "utc_offset"),
            "{:?}",
            found.findings
        );
        assert!(found.has_faults());
        let stated = by(&format!("{time}\nutc_offset = \"+02:00\""), &text);
        is_even(&stated, &[]);
        assert_eq!(
            stated.start_ns + 7_200_000_000_000,
            1_777_885_200_000_000_000
        );
    }
    for bad in [
        "utc_offset = \"CEST\"\nunit = \"iso8601\"",
        "utc_offset = \"+02:00\"\nunit = \"s\"",
    ] {
        let map =
            format!("[time]\ncolumn = \"t\"\n{bad}\n[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\n");
        let error = Map::from_toml(&map, "m").unwrap_err().to_string();
        assert!(error.contains("time.utc_offset"), "{error}");
    }
}

#[test]
fn hhmmss_taken_for_seconds_is_a_fault_that_names_the_format() {
    for start in ["2026-05-04T10:30:50Z", "2026-05-04T09:59:50Z"] {
        let text = table(start, |_, t| {
            let own = t.format("%H%M%S%.3f").to_string();
            own.trim_start_matches('0').to_owned()
        });
        let found = by("unit = \"s\"", &text);
        assert!(
            says(&found, "sexagesimal_time", "format = \"%H%M%S%.f\"") && found.has_faults(),
            "{:?}",
            found.findings
        );
        is_even(&by("format = \"%H%M%S%.f\"", &text), &[]);
    }
    let millis = table("2026-05-04T09:59:50Z", |_, t| {
        t.format("%H%M%S%3f").to_string()
    });
    assert!(says(
        &by("unit = \"ms\"", &millis),
        "sexagesimal_time",
        "%3f"
    ));
    is_even(&by("format = \"%H%M%S%3f\"", &millis), &[]);
}

#[test]
fn a_stamp_behind_noon_was_read_as_of_the_night_in_a_zone_called_pm() {
    for (am, pm) in [
        ("AM", "PM"),
        ("am", "pm"),
        ("a.m.", "p.m."),
        ("A.M.", "P.M."),
    ] {
        let text = table("2026-05-04T11:59:50Z", |_, t| {
            let own = t.format("%Y-%m-%d %I:%M:%S%.3f %p").to_string();
            own.replace("AM", am).replace("PM", pm)
        });
        let found = crate::guess::guess(text.as_bytes()).unwrap().unwrap();
        let format = "format = \"%Y-%m-%d %I:%M:%S%.f %p\"";
        assert!(found.toml.contains(format), "{pm}: {}", found.toml);
        let read = by(format, &text);
        is_even(&read, &["time_zone_missing"]);
        assert_eq!(read.start_ns, 1_777_895_990_000_000_000, "{pm}");
        // By hours of a whole day it is no stamp.
        let wrong = by(&format!("{ISO}\nutc_offset = \"Z\""), &text);
        assert!(wrong.has_faults() && wrong.times_s.is_empty(), "{pm}");
    }
}

#[test]
fn an_even_count_of_milliseconds_was_called_a_clock_as_hhmmss() {
    for (name, unit, step) in [("t", "ms", 50), ("t", "us", 50_000), ("t [ms]", "ms", 50)] {
        let rows =
            (0..100).map(|k| format!("{},{:.6}\n", step * k, 0.2 * (0.1 * f64::from(k)).sin()));
        let text = format!("{name},x\n{}", rows.collect::<String>());
        let found = crate::guess::guess(text.as_bytes()).unwrap().unwrap();
        assert!(!found.toml.contains("format = "), "{name}: {}", found.toml);
        let map = format!(
            "[time]\ncolumn = \"{name}\"\nunit = \"{unit}\"\n[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\n"
        );
        let read = read(&text, &Map::from_toml(&map, "map.toml").unwrap());
        assert_eq!(
            kinds(&read, Severity::Fault),
            Vec::<&str>::new(),
            "{:?}",
            read.findings
        );
        assert!((read.times_s[99] - 4.95).abs() < 1e-9);
    }
}
