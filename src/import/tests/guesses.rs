//! Columns that were taken for what they are not.

use crate::guess::{Guess, GuessError, guess};
use crate::{Map, Severity, survey};

const ROWS: usize = 600;

fn x_m(t_s: f64) -> f64 {
    0.2 * (0.5 * t_s).sin()
}

/// A table of so many cells per row at 25 Hz.
fn table(header: &str, row: impl Fn(usize, f64) -> String) -> String {
    let rows = (0..ROWS).map(|k| row(k, 0.04 * k as f64) + "\n");
    format!("{header}\n{}", rows.collect::<String>())
}

fn guessed(text: &str) -> Guess {
    guess(text.as_bytes())
        .unwrap()
        .unwrap_or_else(|e| panic!("{e}"))
}

/// Lines of the map that are no comments.
fn keys(found: &Guess) -> Vec<&str> {
    let lines = found.toml.lines();
    lines.filter(|l| !l.starts_with('#')).collect()
}

/// Faults of an import by the guessed map.
fn faults(text: &str, found: &Guess) -> Vec<String> {
    let map = Map::from_toml(&found.toml, "guessed").unwrap();
    let survey = survey(text.as_bytes(), &map, None).unwrap();
    let faults = survey
        .findings
        .iter()
        .filter(|f| f.severity == Severity::Fault);
    faults
        .map(|f| format!("{}: {}", f.kind, f.message))
        .collect()
}

#[test]
fn a_square_wave_is_no_time() {
    for (name, load) in [("load", "wave"), ("u", "wave"), ("step", "stairs")] {
        let text = table(&format!("when,x,{name}"), |k, t| {
            let load = match load {
                "wave" => [-16.0, 16.0][k / 300],
                _ => 4.0 * (k / 50) as f64,
            };
            format!("w{t:.3},{:.6},{load}", x_m(t))
        });
        let error = guess(text.as_bytes()).unwrap().unwrap_err();
        assert!(matches!(error, GuessError::NoTime { .. }), "{error}");
        assert!(
            error.to_string().contains("column 'when' holds 'w0.000'"),
            "{error}"
        );
    }
    // A time that has a name of its own is still found.
    let text = table("tick,x", |_, t| format!("{t:.3},{:.6}", x_m(t)));
    assert!(keys(&guessed(&text)).contains(&"column = \"tick\""));
}

#[test]
fn stamps_of_19_digits_stay_whole_numbers() {
    let text = table("timestamp,x,force", |k, t| {
        let ns = 1_766_147_454_233_218_075_i64 + 40_000_000 * k as i64 + (k % 7) as i64;
        format!("{ns},,{:.1}\n{},{:.6},", t % 3.0, ns + 1, x_m(t))
    });
    let found = guessed(&text);
    assert!(
        !found.toml.contains("rate_hz") && !found.toml.contains("repeat"),
        "{}",
        found.toml
    );
    assert_eq!(
        faults(&text, &found),
        Vec::<String>::new(),
        "{}",
        found.toml
    );
}

#[test]
fn a_row_of_blanks_before_the_data_is_no_header() {
    let header = "Timestamp,roll,pitch,heading,flightMode,gps.lock,battery.voltage";
    let stamp = |k: usize| {
        format!(
            "2024-03-05 10:{:02}:{:02}.{:03}",
            k / 1500,
            k / 25 % 60,
            40 * (k % 25)
        )
    };
    let text = table(header, |k, t| match k {
        0..5 => format!("{},--.--,--.--,--.--,Manual,None,--.--", stamp(k)),
        _ => format!(
            "{},{:.4},{:.4},{:.3},Manual,None,14.8",
            stamp(k),
            5.0 * x_m(t),
            3.0 * x_m(0.7 * t),
            20.0 + 50.0 * x_m(t)
        ),
    });
    let found = guessed(&text);
    let keys = keys(&found);
    assert!(
        keys.contains(&"column = \"Timestamp\"") && keys.contains(&"column = \"roll\""),
        "{}",
        found.toml
    );
    assert!(!found.toml.contains("header_line"), "{}", found.toml);
}

#[test]
fn hhmmss_is_no_number_of_seconds() {
    let text = table("utc,x", |k, t| {
        let s = 10 * 3600 + 59 * 60 + 45 + k / 25;
        format!(
            "{}{:02}{:02}.{:02},{:.6}",
            s / 3600,
            s / 60 % 60,
            s % 60,
            4 * (k % 25),
            x_m(t)
        )
    });
    let found = guessed(&text);
    assert!(
        keys(&found).contains(&"format = \"%H%M%S%.f\""),
        "{}",
        found.toml
    );
    assert_eq!(faults(&text, &found), Vec::<String>::new());
}

#[test]
fn a_letter_behind_another_word_is_no_velocity() {
    let text = table("t,x,Battery V,Supply W,Water T", |_, t| {
        format!(
            "{t:.2},{:.6},{:.3},{:.3},{:.3}",
            x_m(t),
            14.8 - 0.01 * t,
            20.0 + x_m(t),
            12.0 + 0.001 * t
        )
    });
    let found = guessed(&text);
    for channel in ["v_mps", "w_mps"] {
        assert!(!found.toml.contains(channel), "{}", found.toml);
    }
    assert!(keys(&found).contains(&"column = \"t\""), "{}", found.toml);
}

#[test]
fn a_degree_sign_without_brackets_is_a_unit() {
    // Small angles: by their size alone they are radians.
    let text = table("t,Roll °,yaw rate °/s", |_, t| {
        format!("{t:.2},{:.6},{:.6}", x_m(t), 0.1 * (0.3 * t).cos())
    });
    let found = guessed(&text);
    let keys = keys(&found);
    for key in ["unit = \"deg\"", "unit = \"deg/s\""] {
        assert!(keys.contains(&key), "{}", found.toml);
    }
}

#[test]
fn numbers_of_other_notations_and_widths_are_a_table() {
    let fortran = table("  t   x", |_, t| {
        format!(" {:.7}D+00  {:.7}D+00", t, x_m(t))
    });
    assert!(keys(&guessed(&fortran)).contains(&"[motion.x_m]"));
    let minus = table("t;x", |_, t| {
        format!("{t:.3};{:.6}", x_m(t))
            .replace('-', "\u{2212}")
            .replace('.', ",")
    });
    assert_eq!(faults(&minus, &guessed(&minus)), Vec::<String>::new());
}
