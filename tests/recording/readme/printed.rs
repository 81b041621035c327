//! Comparison of the output on a page with the output printed: words equal, numbers within a tolerance.

/// As a line: any lines; at the end of a line: the rest of it.
const ANY: &str = "...";

/// Compares; `open_ended`: other lines may stand before and after.
///
/// Spaces between words do not count: columns move with the width of their numbers.
///
/// # Errors
/// The first line that differs, with both readings and the number at fault.
pub fn compare(
    expected: &str,
    printed: &str,
    tolerance: f64,
    open_ended: bool,
) -> Result<(), String> {
    let have: Vec<&str> = printed.lines().filter(|l| !l.trim().is_empty()).collect();
    let want: Vec<&str> = expected.lines().filter(|l| !l.trim().is_empty()).collect();
    let chunks: Vec<&[&str]> = want.split(|l| l.trim() == ANY).collect();
    let (mut from, last) = (0, chunks.len() - 1);
    for (k, chunk) in chunks.iter().enumerate() {
        let anchored = (k == 0 && !open_ended, k == last && !open_ended);
        let places: Vec<usize> = match (anchored, have.len().checked_sub(chunk.len())) {
            (_, None) => Vec::new(),
            ((true, _), Some(_)) => vec![from],
            ((false, true), Some(end)) => (end >= from).then_some(end).into_iter().collect(),
            ((false, false), Some(end)) => (from..=end).collect(),
        };
        let place = places
            .iter()
            .find(|p| agreeing(chunk, &have[**p..], tolerance).is_ok());
        match place {
            Some(place) => from = place + chunk.len(),
            None => return Err(closest(chunk, &have, &places, tolerance)),
        }
    }
    match have.get(from) {
        Some(more) if !open_ended && want.last().is_some_and(|l| l.trim() != ANY) => {
            Err(format!("printed, but not on the page: '{more}'"))
        }
        _ => Ok(()),
    }
}

/// Checks that the lines of `have` begin as `want` says; else how many do, and how the next one differs.
fn agreeing(want: &[&str], have: &[&str], tolerance: f64) -> Result<(), (usize, String)> {
    for (k, line) in want.iter().enumerate() {
        let Some(other) = have.get(k) else {
            return Err((k, format!("on the page, but not printed: '{line}'")));
        };
        same(line, other, tolerance).map_err(|e| (k, e))?;
    }
    Ok(())
}

/// The difference at the place where most lines agree.
fn closest(chunk: &[&str], have: &[&str], places: &[usize], tolerance: f64) -> String {
    places
        .iter()
        .filter_map(|p| agreeing(chunk, &have[(*p).min(have.len())..], tolerance).err())
        .max_by_key(|(lines, _)| *lines)
        .map_or_else(
            || {
                format!(
                    "on the page, but not printed (fewer lines came): '{}'",
                    chunk.first().unwrap_or(&"")
                )
            },
            |(_, words)| words,
        )
}

/// Compares two lines.
fn same(want: &str, have: &str, tolerance: f64) -> Result<(), String> {
    let (beginning, open) = want
        .trim_end()
        .strip_suffix(ANY)
        .map_or((want, false), |b| (b, true));
    let (wanted, mut had) = (pieces(beginning), pieces(have));
    if open {
        cut(&wanted, &mut had);
    }
    let words = |what: String| format!("{what}\n    on the page: {want}\n    printed:     {have}");
    if wanted.len() != had.len() {
        return Err(words("other words".to_owned()));
    }
    for pair in wanted.iter().zip(&had) {
        match pair {
            (Piece::Word(a), Piece::Word(b)) if a == b => {}
            (Piece::Number(a), Piece::Number(b)) => {
                let (x, y) = (value(a), value(b));
                // A last digit may be rounded the other way.
                let allowed = (tolerance * x.abs().max(y.abs())).max(1.001 * last_digit(a));
                if (x - y).abs() > allowed {
                    return Err(words(format!(
                        "{b} printed where the page says {a}: allowed are {} % or one of the last decimal",
                        100.0 * tolerance
                    )));
                }
            }
            (Piece::Word(a) | Piece::Number(a), Piece::Word(b) | Piece::Number(b)) => {
                return Err(words(format!("'{b}' printed where the page says '{a}'")));
            }
        }
    }
    Ok(())
}

/// Shortens a line to what a beginning of it has; a word may be begun.
fn cut(beginning: &[Piece], line: &mut Vec<Piece>) {
    line.truncate(beginning.len());
    if let (Some(Piece::Word(want)), Some(Piece::Word(have))) = (beginning.last(), line.last_mut())
        && have.starts_with(want.as_str())
    {
        have.truncate(want.len());
    }
}

#[derive(Debug, Clone, PartialEq)]
enum Piece {
    Word(String),
    Number(String),
}

/// A line cut into words and numbers. A number begins where no letter, digit, `_` or `.` stands before it, nor a `-` that
/// belongs to a word: `x_2`, `surge-8n` and `next-slow-sine-50` are words.
fn pieces(line: &str) -> Vec<Piece> {
    let text: Vec<char> = line.chars().collect();
    let mut found: Vec<Piece> = Vec::new();
    let mut at = 0;
    while at < text.len() {
        if text[at].is_whitespace() {
            at += 1;
            continue;
        }
        let length = number(&text[at..]);
        let end = if length > 0 {
            at + length
        } else {
            word(&text, at)
        };
        let piece: String = text[at..end].iter().collect();
        found.push(if length > 0 {
            Piece::Number(piece)
        } else {
            Piece::Word(piece)
        });
        at = end;
    }
    found
}

/// Where the word that begins at `at` ends: at a space, or behind a sign such as `=` or `(` before which a number begins.
fn word(text: &[char], at: usize) -> usize {
    let mut end = at + 1;
    while end < text.len() && !text[end].is_whitespace() {
        let joined = text[end - 1].is_alphanumeric() || "_.-+".contains(text[end - 1]);
        if !joined && number(&text[end..]) > 0 {
            break;
        }
        end += 1;
    }
    end
}

/// Length of the number that begins here: sign, digits, point, exponent; 0 = none, as where a letter follows (`8n`).
fn number(text: &[char]) -> usize {
    let digits = |from: usize| {
        text[from..]
            .iter()
            .take_while(|c| c.is_ascii_digit())
            .count()
    };
    let mut end = usize::from(text.first().is_some_and(|c| "+-".contains(*c)));
    let whole = digits(end);
    if whole == 0 {
        return 0;
    }
    end += whole;
    if text.get(end) == Some(&'.') {
        let behind = digits(end + 1);
        end += if behind > 0 { 1 + behind } else { 0 };
    }
    if matches!(text.get(end), Some('e' | 'E')) {
        let sign = usize::from(text.get(end + 1).is_some_and(|c| "+-".contains(*c)));
        let exponent = if end + 1 + sign <= text.len() {
            digits(end + 1 + sign)
        } else {
            0
        };
        end += if exponent > 0 { 1 + sign + exponent } else { 0 };
    }
    match text.get(end) {
        Some(c) if c.is_alphanumeric() || *c == '_' => 0,
        _ => end,
    }
}

fn value(number: &str) -> f64 {
    number.parse().unwrap_or(f64::NAN)
}

/// Value of one unit of the last digit; 0 for a whole number, which was not rounded.
fn last_digit(number: &str) -> f64 {
    let (mantissa, exponent) = match number.find(['e', 'E']) {
        Some(at) => (&number[..at], number[at + 1..].parse().unwrap_or(0)),
        None => (number, 0),
    };
    mantissa.split_once('.').map_or(0.0, |(_, decimals)| {
        10f64.powi(exponent - decimals.len() as i32)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAGE: &str = "Left out: thruster_lag (8.19 mm; lag_s = 0.2500).\n  x_m  1.072e-2 before\n  plan slow-sine-50\n";

    fn against(page: &str, printed: &str) -> Result<(), String> {
        compare(page, printed, 0.01, false)
    }

    #[test]
    fn numbers_may_differ_by_the_tolerance_and_no_more() {
        assert_eq!(against(PAGE, PAGE), Ok(()));
        let near = PAGE.replace("8.19", "8.25").replace("1.072e-2", "1.065e-2");
        assert_eq!(against(PAGE, &near), Ok(()));
        let error = against(PAGE, &PAGE.replace("8.19", "8.30")).unwrap_err();
        assert!(
            error.contains("8.30 printed where the page says 8.19"),
            "{error}"
        );
        assert!(against(PAGE, &PAGE.replace("1.072e-2", "1.072e-3")).is_err());
        assert!(against(PAGE, &PAGE.replace("0.2500", "-0.2500")).is_err());
        assert!(against("p 1.000", "p NaN").is_err());
        assert_eq!(against("p 0.001", "p 0.002"), Ok(()));
        assert!(against("p 0.001", "p 0.003").is_err());
        assert!(against("3 frames", "4 frames").is_err());
    }

    #[test]
    fn words_and_numbers_in_names_are_equal_or_differ() {
        assert!(against(PAGE, &PAGE.replace("lag_s", "delay_s")).is_err());
        assert!(against(PAGE, &PAGE.replace("sine-50", "sine-51")).is_err());
        assert!(against("surge-8n 2", "surge-9n 2").is_err());
        assert_eq!(against("a   1  b", "a 1 b"), Ok(()));
    }

    #[test]
    fn lines_missing_or_too_many_are_reported() {
        let error = against(PAGE, &format!("{PAGE}  note: more\n")).unwrap_err();
        assert!(error.contains("note: more"), "{error}");
        assert!(against(&format!("{PAGE}more\n"), PAGE).is_err());
        assert!(against(PAGE, "").is_err());
    }

    #[test]
    fn three_points_stand_for_any_lines() {
        let page = "a 1\n...\nc 3\n";
        assert_eq!(against(page, "a 1\nb\nb\nc 3\n"), Ok(()));
        assert_eq!(against(page, "a 1\nc 3\n"), Ok(()));
        assert!(against(page, "a 1\nb\nc 4\n").is_err());
        assert!(against(page, "a 1\nc 3\nd\n").is_err());
        assert_eq!(against("...\nc 3\n...\n", "a\nc 3\nd\n"), Ok(()));
        assert_eq!(
            against("left 0.25 nothing...", "left 0.25 nothing; but 7 more"),
            Ok(())
        );
        assert_eq!(against("left 0.25 no...", "left 0.25 nothing"), Ok(()));
        assert!(against("left 0.25 nothing...", "left 0.30 nothing; but").is_err());
        assert!(against("left 0.25 nothing ...", "left 0.25").is_err());
        assert_eq!(compare("c 3\n", "a\nc 3\nd\n", 0.0, true), Ok(()));
        assert!(compare("c 3\nd\n", "a\nc 3\ne\n", 0.0, true).is_err());
    }

    #[test]
    fn a_line_is_cut_into_words_and_numbers() {
        let numbers = |line| {
            pieces(line)
                .into_iter()
                .filter_map(|p| matches!(&p, Piece::Number(_)).then_some(p))
                .map(|p| match p {
                    Piece::Number(n) | Piece::Word(n) => n,
                })
                .collect::<Vec<_>>()
        };
        assert_eq!(
            numbers("lag_s = 0.25 (sd 1.6e-4), p=.5"),
            ["0.25", "1.6e-4"]
        );
        assert_eq!(
            numbers("-5 .. +7.5; sine-50 x_2 8n 720x576"),
            ["-5", "+7.5"]
        );
        assert_eq!(numbers("[1100,-39.9]"), ["1100", "-39.9"]);
    }
}
