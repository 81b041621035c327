//! The score in words.

use std::collections::BTreeSet;
use std::fmt::Write;

use super::score::{Rate, Score};

fn rate(r: &Rate) -> String {
    if r.count == 0 {
        return "-".to_owned();
    }
    format!(
        "{:>5.1} % ({}/{}; {:.1}-{:.1})",
        100.0 * r.share,
        r.hits,
        r.count,
        100.0 * r.low,
        100.0 * r.high
    )
}

/// The whole table.
pub fn words(score: &Score) -> String {
    let mut s = String::new();
    let cases: Vec<String> = score
        .cases
        .iter()
        .map(|(name, n)| format!("{n} {name}"))
        .collect();
    // Writing to a String cannot fail.
    let _ = writeln!(s, "cases: {}", cases.join(", "));
    let _ = writeln!(
        s,
        "\n{:41} {:8} {:32} ideal observer",
        "share (hits/count; Wilson 95 %)", "asked", "diagnose"
    );
    for l in &score.lines {
        let ideal = l.ideal.as_ref().map_or("-".to_owned(), rate);
        let _ = writeln!(
            s,
            "{:41} {:8} {:32} {ideal}",
            l.what,
            l.asked,
            rate(&l.tool)
        );
    }
    let _ = writeln!(
        s,
        "\nrun held out, median rms over its noise where named: {:.1} before, {:.2} after",
        score.held_out[0], score.held_out[1]
    );
    if !score.errors.is_empty() {
        let _ = writeln!(
            s,
            "\n{:28} {:>14} {:>10}  95 % intervals",
            "parameter", "median error", "cases"
        );
        for e in &score.errors {
            let _ = writeln!(
                s,
                "{:28} {:>12.2} % {:>10}  {:.0} %",
                e.name,
                100.0 * e.median_relative,
                e.covered.count,
                100.0 * e.covered.share
            );
        }
    }
    let columns: BTreeSet<&String> = score.confusion.values().flat_map(|r| r.keys()).collect();
    let _ = writeln!(
        s,
        "\nheaviest there (row) and what was named as the heaviest:"
    );
    for (i, c) in columns.iter().enumerate() {
        let _ = writeln!(s, "  {:>2} {c}", i + 1);
    }
    let _ = write!(s, "{:20}", "");
    for i in 0..columns.len() {
        let _ = write!(s, "{:>4}", i + 1);
    }
    s.push('\n');
    for (row, counts) in &score.confusion {
        let _ = write!(s, "{row:20}");
        for c in &columns {
            match counts.get(*c) {
                Some(n) => {
                    let _ = write!(s, "{n:>4}");
                }
                None => s.push_str("   ."),
            }
        }
        s.push('\n');
    }
    s
}
