//! Cells that say that there is no number.

use super::ascii::is_dash;

/// Words for nothing, for what is no number, and for one without bounds.
const WORDS: [&str; 26] = [
    "nan",
    "nanq",
    "nans",
    "qnan",
    "snan",
    "na",
    "n/a",
    "n.a.",
    "n/d",
    "n.d.",
    "nat",
    "nil",
    "null",
    "none",
    "<na>",
    "<null>",
    "(null)",
    "missing",
    "no data",
    "nodata",
    "not available",
    "undef",
    "undefined",
    "inf",
    "infinity",
    "#nv",
];

/// Errors of spreadsheets that end in neither `!` nor `?`.
const SPREADSHEET: [&str; 4] = ["#n/a", "#n/d", "#nd", "#getting_data"];

/// Whether neither a letter nor a digit stands in a cell: `--.--`, `****`, `#####`, `?`, `∞`.
fn is_fill(cell: &str) -> bool {
    let marks = |c: char| {
        c.is_ascii_punctuation() || c == ' ' || is_dash(c) || matches!(c, '…' | '·' | '∞')
    };
    cell.chars().all(marks)
}

/// `1.#QNAN`, `1.#INF00`, `1,#J`: infinities and no numbers of Microsoft's C library, also where they were rounded.
fn is_of_msvc(unsigned: &str) -> bool {
    let rest = unsigned
        .strip_prefix("1.#")
        .or_else(|| unsigned.strip_prefix("1,#"));
    rest.is_some_and(|r| {
        r.starts_with(|c: char| c.is_ascii_alphabetic())
            && r.bytes().all(|b| b.is_ascii_alphanumeric())
    })
}

/// `#DIV/0!`, `#NAME?`, `#N/A`, `Err:502`.
fn is_of_spreadsheet(lower: &str) -> bool {
    let named = SPREADSHEET.contains(&lower);
    let marked = lower.starts_with('#') && lower.len() <= 16 && lower.ends_with(['!', '?']);
    let numbered = lower
        .strip_prefix("err:")
        .is_some_and(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()));
    named || marked || numbered
}

/// Whether a cell says that there is nothing: empty, a word for it, an error that its writer left, or marks alone.
pub(crate) fn says_nothing(cell: &str) -> bool {
    let unsigned = cell.strip_prefix(['-', '+']).unwrap_or(cell);
    // Most cells: a number.
    if unsigned.starts_with(|c: char| c.is_ascii_digit()) {
        return is_of_msvc(unsigned);
    }
    let lower = unsigned.to_lowercase();
    // C's `nan(ind)`, `nan(0x8000)`.
    let with_payload = lower.starts_with("nan(");
    WORDS.contains(&lower.as_str()) || with_payload || is_of_spreadsheet(&lower) || is_fill(cell)
}

/// Cause of a cell of marks alone, for a message; empty = none is known.
pub(crate) fn cause(cell: &str) -> &'static str {
    let all = |mark: char| cell.len() > 1 && cell.chars().all(|c| c == mark);
    if all('*') {
        "; asterisks are numbers too wide for their field: export with a wider one"
    } else if all('#') {
        "; numbers too wide for a spreadsheet's column: widen it and export anew"
    } else {
        ""
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_programs_write_for_nothing_is_nothing() {
        for cell in [
            "",
            "NaN",
            "-nan",
            "nan(ind)",
            "-nan(0x8000000)",
            "1.#QNAN",
            "-1.#IND",
            "1.#INF00",
            "1,#J",
            "inf",
            "-Infinity",
            "∞",
            "--.--",
            "-.-",
            "****",
            "#####",
            "—",
            "?",
            ".",
            "N/A",
            "#DIV/0!",
            "#N/A",
            "#WERT!",
            "#NAME?",
            "#¡VALOR!",
            "Err:502",
            "None",
            "<NA>",
        ] {
            assert!(says_nothing(cell), "{cell}");
        }
        for cell in [
            "0", "-0.5", "1.5", "1.", "1.#", "OVER", "lost", "#1", "# note", "\u{fffd}", "x",
            "nano",
        ] {
            assert!(!says_nothing(cell), "{cell}");
        }
    }
}
