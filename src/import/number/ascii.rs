//! ASCII form of numbers as locales, typesetters and Fortran write them.

use std::borrow::Cow;

/// Digits that an exponent without its letter has at most: Fortran drops the letter where three digits leave it no room.
const BARE_EXPONENT_DIGITS: usize = 3;
/// Zeros of other scripts' digits: Arabic-Indic, Persian, Devanagari, full width.
const ZEROS: [u32; 4] = [0x0660, 0x06F0, 0x0966, 0xFF10];

/// Marks that set the direction of writing or join words, and are not seen.
fn is_unseen(c: char) -> bool {
    matches!(c, '\u{61c}' | '\u{200b}'..='\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2060}'..='\u{2069}' | '\u{feff}')
}

/// Whether a character is a dash or a minus sign of any width.
pub(crate) fn is_dash(c: char) -> bool {
    matches!(
        c,
        '-' | '\u{2d7}' | '\u{2010}'
            ..='\u{2015}'
                | '\u{207b}'
                | '\u{2212}'
                | '\u{2796}'
                | '\u{fe58}'
                | '\u{fe63}'
                | '\u{ff0d}'
    )
}

fn plain(c: char) -> char {
    match c {
        _ if c.is_ascii() => c,
        _ if is_dash(c) => '-',
        '\u{207a}' | '\u{2795}' | '\u{fe62}' | '\u{ff0b}' => '+',
        '\u{66b}' | '\u{ff0e}' => '.',
        '\u{ff0c}' => ',',
        '\u{ff1a}' => ':',
        _ if c.is_whitespace() => ' ',
        _ => ZEROS
            .iter()
            .find_map(|zero| char::from_digit((c as u32).checked_sub(*zero)?, 10))
            .unwrap_or(c),
    }
}

/// A cell with signs, digits and blanks of any script as ASCII, without marks that are not seen.
pub(crate) fn ascii(cell: &str) -> Cow<'_, str> {
    if cell.is_ascii() {
        return Cow::Borrowed(cell);
    }
    let seen = cell.chars().filter(|c| !is_unseen(*c));
    Cow::Owned(seen.map(plain).collect::<String>().trim().to_owned())
}

/// Digits of an exponent with its sign.
fn is_exponent(text: &str) -> bool {
    let digits = text.strip_prefix(['-', '+']).unwrap_or(text);
    !digits.is_empty() && digits.bytes().all(|b| b.is_ascii_digit())
}

/// A number of another notation as every parser reads it: `−0,2`, `1.0D-01`, `3.1-114`, `2.5×10^-3`; `None` = it is none.
pub(crate) fn usual_notation(cell: &str, decimal: char) -> Option<String> {
    let own = ascii(cell);
    let (sign, rest) = match own.as_bytes().first()? {
        b'-' => ("-", own[1..].trim_start()),
        b'+' => ("", own[1..].trim_start()),
        _ => ("", &*own),
    };
    let is_part = |c: char| c.is_ascii_digit() || c == decimal;
    let (mantissa, exponent) = rest.split_at(rest.find(|c| !is_part(c)).unwrap_or(rest.len()));
    if mantissa.matches(decimal).count() > 1 || !mantissa.contains(|c: char| c.is_ascii_digit()) {
        return None;
    }
    let mantissa = mantissa.replace(decimal, ".");
    let exponent = if exponent.is_empty() {
        "0"
    } else if exponent.starts_with(['-', '+']) {
        // Between digits without a point a dash is that of a date or of a range.
        let fits = exponent.len() <= 1 + BARE_EXPONENT_DIGITS && mantissa.contains('.');
        Some(exponent).filter(|_| fits)?
    } else {
        ["×10^", "x10^", "*10^", "*^", "e", "E", "d", "D", "q", "Q"]
            .iter()
            .find_map(|mark| exponent.strip_prefix(mark))?
    };
    is_exponent(exponent).then(|| format!("{sign}{mantissa}e{exponent}"))
}

/// Whether the exponent of a number stands without its letter.
pub(crate) fn has_bare_exponent(number: &str) -> bool {
    let mut pairs = number.as_bytes().windows(2);
    pairs.any(|w| matches!(w, [b'0'..=b'9' | b'.' | b',', b'-' | b'+']))
}
