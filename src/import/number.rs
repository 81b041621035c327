//! Numbers in cells, and what stands there instead.

mod ascii;
mod nothing;

use std::borrow::Cow;

use super::check::{Finding, FindingList};
use super::map::{FileMap, Map};
use ascii::usual_notation;
pub(crate) use ascii::{ascii, has_bare_exponent};
pub(crate) use nothing::says_nothing;

/// A finite number with the file's decimal sign, in the notation of any locale or of Fortran.
pub(crate) fn number(cell: &str, decimal: char) -> Option<f64> {
    let value: Option<f64> = if decimal == ',' {
        // A point in a file of decimal commas would be a separator of thousands, which the map names or not.
        if cell.contains('.') {
            None
        } else {
            cell.replace(',', ".").parse().ok()
        }
    } else {
        cell.parse().ok()
    };
    value
        .or_else(|| usual_notation(cell, decimal)?.parse().ok())
        .filter(|v| v.is_finite())
}

/// A decimal number as mantissa and power of ten, exactly; `None` beyond 30 digits or for anything else.
pub(crate) fn exact(cell: &str, decimal: char) -> Option<(i128, i32)> {
    exactly(cell, decimal).or_else(|| exactly(&usual_notation(cell, decimal)?, '.'))
}

fn exactly(cell: &str, decimal: char) -> Option<(i128, i32)> {
    let (negative, digits) = match cell.as_bytes() {
        [b'-', rest @ ..] => (true, rest),
        [b'+', rest @ ..] => (false, rest),
        rest => (false, rest),
    };
    let (mut mantissa, mut power, mut seen, mut point) = (0_i128, 0_i32, 0, false);
    for (i, b) in digits.iter().enumerate() {
        match b {
            b'0'..=b'9' => {
                mantissa = mantissa * 10 + i128::from(b - b'0');
                seen += 1;
                power -= i32::from(point);
            }
            _ if *b == decimal as u8 && !point => point = true,
            b'e' | b'E' if seen > 0 => {
                let exponent: i32 = std::str::from_utf8(&digits[i + 1..]).ok()?.parse().ok()?;
                power = power.checked_add(exponent)?;
                return finish(negative, mantissa, power, seen);
            }
            _ => return None,
        }
        if seen > 30 {
            return None;
        }
    }
    finish(negative, mantissa, power, seen)
}

fn finish(negative: bool, mantissa: i128, power: i32, seen: usize) -> Option<(i128, i32)> {
    (seen > 0 && power.abs() <= 60).then_some((if negative { -mantissa } else { mantissa }, power))
}

/// An exact number times nanoseconds per unit, rounded to whole nanoseconds.
pub(crate) fn nanoseconds((mantissa, power): (i128, i32), unit_ns: i128) -> Option<i128> {
    let product = mantissa.checked_mul(unit_ns)?;
    let ten = 10_i128.checked_pow(power.unsigned_abs())?;
    if power >= 0 {
        return product.checked_mul(ten);
    }
    let half = ten / 2 * product.signum();
    Some((product + half) / ten)
}

/// Whether a character sets thousands apart in a file where `thousands` does.
fn is_mark(c: char, thousands: char) -> bool {
    match thousands {
        ' ' => matches!(c, ' ' | '\u{a0}' | '\u{202f}'),
        '\'' => matches!(c, '\'' | '’'),
        own => c == own,
    }
}

/// The mark between a number's thousands, where it has one and groups of three: `1,234.5`, `1.234,5`, `1 234.5`, `1'234.5`.
fn grouped_by(cell: &str, decimal: char) -> Option<char> {
    let own = ascii(cell);
    let whole = own
        .trim_start_matches(['-', '+'])
        .split(decimal)
        .next()
        .unwrap_or("");
    let marks = [',', '.', ' ', '\''].into_iter().filter(|m| *m != decimal);
    marks.into_iter().find(|mark| {
        let groups: Vec<&str> = whole.split(|c| is_mark(c, *mark)).collect();
        let digits = |g: &str| !g.is_empty() && g.chars().all(|c| c.is_ascii_digit());
        groups.len() > 1
            && groups.iter().all(|g| digits(g))
            && groups[0].len() <= 3
            && groups[1..].iter().all(|g| g.len() == 3)
    })
}

/// The same where the cell can be nothing else: `1,234` may also have a decimal comma.
pub(crate) fn surely_grouped_by(cell: &str, decimal: char) -> Option<char> {
    let mark = grouped_by(cell, decimal)?;
    (!matches!(mark, ',' | '.') || number(cell, mark).is_none()).then_some(mark)
}

/// A cell without the marks between its thousands, where the map names one and they stand between groups of three; else as it is.
pub(crate) fn ungrouped(cell: &str, thousands: Option<char>, decimal: char) -> Cow<'_, str> {
    let Some(mark) = thousands.filter(|m| grouped_by(cell, decimal) == Some(*m)) else {
        return Cow::Borrowed(cell);
    };
    let own = ascii(cell);
    let (whole, rest) = own.split_at(own.find(decimal).unwrap_or(own.len()));
    let digits = whole.chars().filter(|c| !is_mark(*c, mark));
    Cow::Owned(digits.chain(rest.chars()).collect())
}

/// Cells that are no numbers, by kind.
#[derive(Default)]
pub(crate) struct BadCells {
    seen: Vec<BadCell>,
}

struct BadCell {
    kind: &'static str,
    column: String,
    first_line: u64,
    first_cell: String,
    count: usize,
}

impl BadCells {
    pub fn note(&mut self, column: &str, line: u64, cell: &str) {
        let kind = if cell.is_empty() {
            "empty_cells"
        } else if says_nothing(cell) {
            "nan"
        } else if [cell.replace(',', "."), cell.replace(['.', ','], "")]
            .iter()
            .any(|c| number(c, '.').is_some())
        {
            "decimal_separator"
        } else {
            "not_a_number"
        };
        self.note_as(kind, column, line, cell);
    }

    /// Notes a cell that the map says is empty, where none may be.
    pub fn note_stated(&mut self, column: &str, line: u64, cell: &str) {
        self.note_as("missing_value", column, line, cell);
    }

    fn note_as(&mut self, kind: &'static str, column: &str, line: u64, cell: &str) {
        let mut seen = self.seen.iter_mut();
        match seen.find(|s| s.kind == kind && s.column == column) {
            Some(s) => s.count += 1,
            None => self.seen.push(BadCell {
                kind,
                column: column.to_owned(),
                first_line: line,
                first_cell: cell.chars().take(40).collect(),
                count: 1,
            }),
        }
    }

    /// Hint for a cell whose thousands are set apart; empty = there is none.
    fn thousands(cell: &str, file: &FileMap) -> String {
        match (grouped_by(cell, file.decimal), file.thousands) {
            (Some(mark), _) => {
                format!("; are its thousands set apart? Say [file] thousands = \"{mark}\"")
            }
            (None, Some(mark)) => format!(
                "; with thousands = \"{mark}\" a number has groups of three digits before its decimal sign"
            ),
            (None, None) => String::new(),
        }
    }

    pub fn report(&self, map: &Map, findings: &mut Vec<Finding>) {
        for seen in &self.seen {
            let (kind, column, count) = (seen.kind, &seen.column, seen.count);
            let (line, cell) = (seen.first_line, &seen.first_cell);
            // A row without its time is lost, whatever the map says.
            let missing = if column == "time" {
                ""
            } else {
                "; where that is no loss, the map says missing = \"skip\" or \"hold\" there"
            };
            let words = match kind {
                "empty_cells" => format!(
                    "column '{column}': {count} empty cell(s), the first on line {line}{missing}"
                ),
                "nan" => format!(
                    "column '{column}': {count} cell(s) hold '{cell}' or the like, the first on line {line}{}{missing}",
                    nothing::cause(cell)
                ),
                "missing_value" => format!(
                    "column '{column}': {count} cell(s) hold '{cell}' or another missing_value of the map, the first on line {line}{missing}"
                ),
                "decimal_separator" => format!(
                    "column '{column}': {count} cell(s) like '{cell}' (line {line}) do not fit the decimal sign '{}'; set file.decimal, or mend the export{}",
                    map.file.decimal,
                    Self::thousands(cell, &map.file)
                ),
                _ => format!(
                    "column '{column}': {count} cell(s) are no numbers, the first on line {line}: '{cell}'{}{}",
                    Self::thousands(cell, &map.file),
                    if column == "time" {
                        String::new()
                    } else {
                        format!(
                            "; if it says that nothing was measured: missing = \"skip\" and missing_value = {}",
                            toml::Value::String(cell.clone())
                        )
                    }
                ),
            };
            findings.fault_at(kind, Some(line), words);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn times_are_exact() {
        let ns = |cell: &str, unit_ns| nanoseconds(exact(cell, '.')?, unit_ns);
        assert_eq!(
            ns("1709633472.123456789", 1_000_000_000),
            Some(1_709_633_472_123_456_789)
        );
        assert_eq!(
            ns("1.709633472123456789e9", 1_000_000_000),
            Some(1_709_633_472_123_456_789)
        );
        assert_eq!(
            ns("1709633472123456789", 1),
            Some(1_709_633_472_123_456_789)
        );
        assert_eq!(ns("-0.0005", 1_000_000), Some(-500));
        assert_eq!(ns("1e-30", 1), Some(0));
        assert_eq!(nanoseconds(exact("0,25", ',').unwrap(), 4), Some(1));
        for bad in [
            "",
            "-",
            "e5",
            "1e",
            "1.2.3",
            "0x10",
            "1 2",
            "nan",
            "1e99999999999",
        ] {
            assert_eq!(exact(bad, '.'), None, "{bad}");
        }
    }

    #[test]
    fn numbers_of_locales_and_of_fortran_are_read() {
        for (cell, decimal, expected) in [
            ("\u{2212}0,20", ',', -0.2),
            ("\u{2013}0.20", '.', -0.2),
            ("\u{ff0d}0.20", '.', -0.2),
            ("\u{200e}\u{2212}0.20", '.', -0.2),
            ("\u{2212}\u{a0}0.20\u{202f}", '.', -0.2),
            ("\u{ff11}\u{ff12}.5", '.', 12.5),
            ("1.0D-01", '.', 0.1),
            ("-.1000000d+01", '.', -1.0),
            ("1,5Q2", ',', 150.0),
            ("3.1-114", '.', 3.1e-114),
            ("0.5771964+104", '.', 0.577_196_4e104),
            ("2.5×10^\u{2212}3", '.', 2.5e-3),
        ] {
            let found = number(cell, decimal).unwrap_or(f64::NAN);
            assert!((found / expected - 1.0).abs() < 1e-12, "{cell}: {found}");
        }
        assert_eq!(exact("\u{2212}1.5D+01", '.'), Some((-15, 0)));
        for bad in [
            "10-12", "1.0-2024", "1.0D", "D5", "--1", "1.0-1.0", "1.2.3D4", "\u{2212}", "1.5.",
            "(1.5)",
        ] {
            assert_eq!(number(bad, '.'), None, "{bad}");
        }
        assert!(has_bare_exponent("3.1-114") && !has_bare_exponent("-3.1e-114"));
    }

    #[test]
    fn thousands_are_set_apart_by_the_maps_mark_only() {
        let read = |cell, mark, decimal| number(&ungrouped(cell, Some(mark), decimal), decimal);
        assert_eq!(read("-1,234,567.25", ',', '.'), Some(-1_234_567.25));
        assert_eq!(read("1.234,5", '.', ','), Some(1234.5));
        assert_eq!(read("1\u{a0}234.5e1", ' ', '.'), Some(12_345.0));
        assert_eq!(read("12’345", '\'', '.'), Some(12_345.0));
        assert_eq!(read("987.125", ',', '.'), Some(987.125));
        for bad in ["1,23.5", "1234,567", "1,234.5,6", ",234", "1 234", "1,2345"] {
            assert_eq!(read(bad, ',', '.'), None, "{bad}");
        }
        assert_eq!(surely_grouped_by("1,234.5", '.'), Some(','));
        assert_eq!(surely_grouped_by("1,234", '.'), None, "or a decimal comma");
    }

    proptest! {
        #[test]
        fn an_exact_number_is_the_float(value in -1e9..1e9_f64) {
            let text = format!("{value:.6}");
            let (m, p) = exact(&text, '.').unwrap();
            let back = m as f64 * 10f64.powi(p);
            prop_assert!((back - value).abs() <= 1e-6);
        }

        #[test]
        fn any_cell_is_a_number_or_not(cell in "\\PC{0,40}") {
            if let Some(e) = exact(&cell, '.') {
                let _ = nanoseconds(e, 86_400_000_000_000);
                prop_assert!(number(&cell, '.').is_some() || cell.contains(['e', 'E']), "{}", cell);
            }
        }
    }
}
