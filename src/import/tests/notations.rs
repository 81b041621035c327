//! Numbers as locales, Fortran and instruments write them, what stands in their place, and rows whose cells change.

use super::kinds;
use crate::{Finding, Imported, Map, Severity, read};

const ROWS: usize = 200;

/// Position of a row \[m\]: a slow swing through zero.
fn x_m(k: usize) -> f64 {
    0.2 * (0.02 * k as f64 + 0.1).sin()
}

/// A table of t, x and `more`, its cells by `cell`.
fn table(header: &str, separator: &str, cell: impl Fn(usize, f64) -> String) -> String {
    let row = |k: usize| {
        [0.04 * k as f64, x_m(k)]
            .map(|v| cell(k, v))
            .join(separator)
            + "\n"
    };
    format!("{header}\n{}", (0..ROWS).map(row).collect::<String>())
}

fn map(file: &str, motion: &str) -> Map {
    let text = format!(
        "[file]\n{file}\n[time]\ncolumn = \"t\"\nunit = \"s\"\n[motion.x_m]\ncolumn = \"x\"\nunit = \"m\"\n{motion}"
    );
    Map::from_toml(&text, "map.toml").unwrap()
}

fn found<'a>(read: &'a Imported, kind: &str) -> &'a Finding {
    let found = read.findings.iter().find(|f| f.kind == kind);
    found.unwrap_or_else(|| panic!("no {kind}: {:?}", read.findings))
}

fn is_whole(read: &Imported) {
    assert_eq!(
        kinds(read, Severity::Warning),
        Vec::<&str>::new(),
        "{:?}",
        read.findings
    );
    assert_eq!(read.times_s.len(), ROWS);
    for (k, x) in read.motion[0].iter().enumerate() {
        assert!((x - x_m(k)).abs() < 1e-7, "row {k}: {x}");
        assert!((read.times_s[k] - 0.04 * k as f64).abs() < 1e-7, "row {k}");
    }
}

#[test]
fn minus_signs_and_blanks_of_any_locale_are_read() {
    let minus = [
        "\u{2212}",
        "\u{2013}",
        "\u{2012}",
        "\u{ff0d}",
        "\u{200e}\u{2212}",
        "\u{2212}\u{a0}",
    ];
    for minus in minus {
        let cell = |_, v: f64| {
            format!("{v:.8}\u{202f}")
                .replace('-', minus)
                .replace('.', ",")
        };
        let text = table("t;x", ";", cell);
        is_whole(&read(&text, &map("separator = \";\"\ndecimal = \",\"", "")));
    }
}

#[test]
fn exponents_of_fortran_are_read_with_d_and_without_a_letter() {
    let scientific = |v: f64| format!("{v:.9e}");
    for mark in ["D", "d", "Q", "E+", "D+0"] {
        let cell = |_, v: f64| {
            let (mantissa, exponent) = (v / 10.0, "1");
            format!("{mantissa:.9}{mark}{exponent}")
        };
        is_whole(&read(
            &table("t x", " ", cell),
            &map("separator = \"blanks\"", ""),
        ));
    }
    // The letter goes where an exponent of three digits needs its place.
    let text = table("t x", " ", |_, v| {
        let own = scientific(v);
        if own.contains("e-") {
            own.replace('e', "")
        } else {
            own
        }
    });
    let bare = read(&text, &map("separator = \"blanks\"", ""));
    is_whole(&bare);
    assert!(
        found(&bare, "bare_exponent")
            .message
            .contains("whose letter is left out")
    );
    // A range, a date and two numbers that run together are none.
    for bad in ["0.1-0.2", "10-12", "0.5-2024"] {
        let text = table("t,x", ",", |k, v| {
            if k == 7 && v == x_m(7) {
                bad.to_owned()
            } else {
                format!("{v:.8}")
            }
        });
        assert!(read(&text, &map("", "")).has_faults(), "{bad}");
    }
}

#[test]
fn texts_for_nothing_measured_are_covered_by_missing() {
    let spoilt = |word: &str| {
        table("t,x", ",", |k, v| {
            let lost = (100..105).contains(&k) && v == x_m(k);
            if lost {
                word.to_owned()
            } else {
                format!("{v:.8}")
            }
        })
    };
    let words = [
        "--.--",
        "****",
        "#DIV/0!",
        "#N/A",
        "#WERT!",
        "Err:502",
        "1.#QNAN",
        "-1.#IND00",
        "inf",
        "-Infinity",
        "nan(ind)",
        "N/A",
        "?",
    ];
    for word in words {
        let fault = read(&spoilt(word), &map("", ""));
        assert!(
            found(&fault, "nan").message.contains("missing = \"skip\""),
            "{word}"
        );
        let skipped = read(&spoilt(word), &map("", "missing = \"skip\"\n"));
        assert!(!skipped.has_faults(), "{word}: {:?}", skipped.findings);
        assert!(skipped.motion[0][102].is_nan() && skipped.motion[0][106].is_finite());
        let held = read(&spoilt(word), &map("", "missing = \"hold\"\n"));
        assert!((held.motion[0][103] - x_m(99)).abs() < 1e-7, "{word}");
    }
    // A text of the instrument's own is named by the map; the fault says how.
    let over = spoilt("OVER");
    let fault = read(&over, &map("", "missing = \"skip\"\n"));
    let words = &found(&fault, "not_a_number").message;
    assert!(words.contains("missing_value = \"OVER\""), "{words}");
    for value in ["\"OVER\"", "[-9999, \"BadVal\", \"over\"]"] {
        let named = map(
            "",
            &format!("missing = \"skip\"\nmissing_value = {value}\n"),
        );
        assert!(!read(&over, &named).has_faults(), "{value}");
    }
    assert!(
        !read(
            &spoilt("-9999.0"),
            &map("", "missing = \"skip\"\nmissing_value = [\"x\", -9999]\n")
        )
        .has_faults()
    );
    // Named, and yet not allowed to be missing.
    let strict = read(&over, &map("", "missing_value = \"OVER\"\n"));
    assert!(
        found(&strict, "missing_value")
            .message
            .contains("missing = \"skip\"")
    );
    // What is damaged says nothing of the kind.
    for bad in ["\u{fffd}\u{fffd}", "0.1O2", "1.2.3"] {
        assert!(
            read(&spoilt(bad), &map("", "missing = \"skip\"\n")).has_faults(),
            "{bad}"
        );
    }
}

#[test]
fn numbers_that_run_together_are_read_by_the_widths_of_their_columns() {
    // Below -100 nothing stands between the columns.
    let far = |k: usize| x_m(k) - 100.0;
    let row = |k: usize| format!("{:9.4}{:10.5}\n", 0.04 * k as f64, far(k));
    let text = "     t         x\n".to_owned() + &(0..ROWS).map(row).collect::<String>();
    let blanks = read(&text, &map("separator = \"blanks\"", ""));
    let fault = found(&blanks, "truncated_rows");
    assert!(
        fault.message.contains("[file] widths = [9, 10]"),
        "{}",
        fault.message
    );
    assert_eq!(fault.line, Some(155));
    let fixed = read(&text, &map("widths = [9, 10]", ""));
    assert_eq!(
        kinds(&fixed, Severity::Warning),
        Vec::<&str>::new(),
        "{:?}",
        fixed.findings
    );
    assert_eq!(fixed.times_s.len(), ROWS);
    for (k, x) in fixed.motion[0].iter().enumerate() {
        assert!((x - far(k)).abs() < 1e-5, "row {k}: {x}");
    }
    let wrong = read(&text, &map("widths = [8, 11]", ""));
    let says = |f: &Finding| f.message.contains("are the widths right?");
    assert!(
        wrong.has_faults() && wrong.findings.iter().any(says),
        "{:?}",
        wrong.findings
    );
    let beyond = read(&text, &map("widths = [9, 9]", ""));
    assert!(
        found(&beyond, "too_many_cells")
            .message
            .contains("[file] widths")
    );
    let both = Map::from_toml(
        "[file]\nwidths = [9]\nseparator = \";\"\n[time]\nrate_hz = 5\n[motion.x_m]\ncolumn = 1\nunit = \"m\"\n",
        "m",
    );
    assert!(both.unwrap_err().to_string().contains("file.widths"));
}

#[test]
fn columns_that_appear_or_go_in_mid_file_are_said_with_their_line() {
    let from = |line: usize, before: &str, after: &str| {
        let row = |k: usize| {
            let more = if k + 2 < line { before } else { after };
            format!("{:.4},{:.8}{more}\n", 0.04 * k as f64, x_m(k))
        };
        "t,x,y,z\n".to_owned() + &(0..ROWS).map(row).collect::<String>()
    };
    for (line, before, after, words) in [
        (12, ",1,2", ",1,2,3", "rows have 4 cells, from line 12 on 5"),
        (60, ",1,2", ",1", "rows have 4 cells, from line 60 on 3"),
    ] {
        let found = read(&from(line, before, after), &map("", ""));
        let fault = found
            .findings
            .iter()
            .find(|f| matches!(f.kind, "too_many_cells" | "columns_change"))
            .unwrap();
        assert!(fault.message.contains(words), "{}", fault.message);
        assert!(
            fault.message.contains(&format!("last_line = {}", line - 1)),
            "{}",
            fault.message
        );
    }
    // Cells that the header names, and that no row had before: said, for which is which is not known.
    let late = read(&from(180, "", ",1,2"), &map("", ""));
    assert_eq!(found(&late, "columns_change").line, Some(180));
    // One row that was cut is one row.
    let cut = table("t,x", ",", |_, v| format!("{v:.8}")) + "8.0";
    assert!(
        found(&read(&cut, &map("", "")), "truncated_rows")
            .message
            .contains("was the file cut?")
    );
}

#[test]
fn a_header_that_comes_again_is_said_with_the_way_to_both_recordings() {
    let one = table("t,x", ",", |_, v| format!("{v:.8}"));
    let twice = format!("{one}{}", one.replace("t,x", "x,t"));
    let fault = read(&twice, &map("", ""));
    let own = found(&fault, "header_again");
    assert_eq!(own.line, Some(ROWS as u64 + 2));
    assert!(own.message.contains("last_line = 201"), "{}", own.message);
    is_whole(&read(&twice, &map("last_line = 201", "")));
}

#[test]
fn missing_quaternions_are_zeros_too() {
    let text = |lost: &str| {
        "t,a,b,c,d\n".to_owned()
            + &(0..100)
                .map(|k| {
                    let (t, half) = (0.01 * k as f64, 0.002 * k as f64);
                    match k {
                        40..45 => format!("{t:.2},{lost}\n"),
                        _ => format!("{t:.2},0,0,{:.6},{:.6}\n", half.sin(), half.cos()),
                    }
                })
                .collect::<String>()
    };
    let map = |more: &str| {
        Map::from_toml(&format!("[time]\ncolumn = \"t\"\nunit = \"s\"\n[quaternion]\ncolumns = [\"a\", \"b\", \"c\", \"d\"]\norder = \"xyzw\"\n{more}"), "m").unwrap()
    };
    for lost in ["0,0,0,0", "0.000,-0.0,0,0e0", ",,,", "--,--,--,--"] {
        let skipped = read(&text(lost), &map("missing = \"skip\"\n"));
        assert!(!skipped.has_faults(), "{lost}: {:?}", skipped.findings);
        assert!(skipped.motion[5][42].is_nan() && (skipped.motion[5][50] - 0.2).abs() < 1e-5);
        let held = read(&text(lost), &map("missing = \"hold\"\n"));
        assert!((held.motion[5][44] - 0.156).abs() < 1e-5, "{lost}");
        assert!(read(&text(lost), &map("")).has_faults(), "{lost}");
    }
    // Another length than 1 is damage, whatever may be missing.
    assert!(read(&text("0,0,0,0.5"), &map("missing = \"skip\"\n")).has_faults());
}
