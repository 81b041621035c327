//! Words of others on a terminal: nothing in them moves the cursor, sets a colour or title, or hides what stands there.
//!
//! A log, a table or a file name may hold any character. What a terminal would act on instead of showing it is written
//! as JSON writes it (`\u001b`), so that the same text is also sound inside of a JSON string. In the cell of a table nothing
//! begins a formula ([`cell`]).

use std::borrow::Cow;
use std::fmt::{self, Write};

/// Whether a terminal acts on this character instead of showing it: C0 and C1 controls with DEL (ECMA-48), and the
/// characters that turn the direction of the text after them (Unicode UAX #9).
fn acts(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{200e}' | '\u{200f}' | '\u{061c}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

fn escaped(text: &str, kept: fn(char) -> bool) -> Cow<'_, str> {
    if !text.chars().any(|c| acts(c) && !kept(c)) {
        return Cow::Borrowed(text);
    }
    let mut shown = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if acts(c) && !kept(c) {
            // All of them lie below U+FFFF. Writing into a String cannot fail.
            let _ = write!(shown, "\\u{:04x}", u32::from(c));
        } else {
            shown.push(c);
        }
    }
    Cow::Owned(shown)
}

/// A text of several lines: line ends and tabulators stay.
pub fn text(text: &str) -> Cow<'_, str> {
    escaped(text, |c| matches!(c, '\n' | '\t'))
}

/// A name, value or message that came from outside, inside of one line of ours: it cannot begin a line of its own.
pub fn word(word: &str) -> Cow<'_, str> {
    escaped(word, |_| false)
}

/// Signs with which a formula begins. Spreadsheets take the wide forms of these signs for the signs.
const FORMULA: [char; 8] = ['=', '+', '-', '@', '＝', '＋', '－', '＠'];

/// A text for the cell of a table. A spreadsheet takes one that begins with `=`, `+`, `-` or `@` for a formula and runs it, so
/// an apostrophe goes ahead of it, which spreadsheets hide; numbers stay as they are.
pub fn cell(text: &str) -> Cow<'_, str> {
    // Spreadsheets look behind blanks.
    if text.trim_start().starts_with(FORMULA) && text.parse::<f64>().is_err() {
        Cow::Owned(format!("'{text}"))
    } else {
        Cow::Borrowed(text)
    }
}

/// A formatter on which each `writeln!` is one line, as of [`line`].
pub struct Lines<'a, 'b>(pub &'a mut fmt::Formatter<'b>);

impl Lines<'_, '_> {
    /// Takes what `writeln!` hands on.
    ///
    /// # Errors
    /// Those of the formatter.
    pub fn write_fmt(&mut self, text: fmt::Arguments<'_>) -> fmt::Result {
        let text = text.to_string();
        let text = text.strip_suffix('\n').unwrap_or(&text);
        line(self.0, format_args!("{text}"))
    }
}

/// Writes one line, whatever is in it.
///
/// # Errors
/// Those of `to`.
pub fn line(to: &mut impl Write, line: fmt::Arguments<'_>) -> fmt::Result {
    writeln!(to, "{}", word(&line.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn what_a_terminal_acts_on_is_shown_and_the_rest_is_left() {
        assert_eq!(text("Ü 3 µm\n\tb"), "Ü 3 µm\n\tb");
        assert_eq!(
            text("a\u{1b}[2Jb\r\u{9b}\u{7f}"),
            "a\\u001b[2Jb\\u000d\\u009b\\u007f"
        );
        assert_eq!(text("log\u{202e}pacm."), "log\\u202epacm.");
        assert_eq!(word("x\nsound"), "x\\u000asound");
        assert!(matches!(text("plain"), Cow::Borrowed(_)));
    }

    #[test]
    fn no_cell_begins_as_a_formula() {
        for formula in [
            "=HYPERLINK(\"http://evil.example\")",
            "+1+cmd|' /C calc'!A0",
            "-2+3",
            "@SUM(A1)",
            "\t=1+1",
            "\r\n=1+1",
            "＝HYPERLINK(1)",
            "＋1",
            "－1",
            " ＠SUM(A1)",
        ] {
            assert_eq!(cell(formula), format!("'{formula}"));
        }
        for own in ["still water", "a=b", "-0.5", "+4e-3", "'=1", ""] {
            assert!(matches!(cell(own), Cow::Borrowed(same) if same == own));
        }
    }

    proptest! {
        #[test]
        fn nothing_is_left_that_acts(any in "\\PC*|.*|[\\x00-\\x20]*") {
            prop_assert!(!word(&any).chars().any(acts));
            prop_assert!(!text(&any).chars().any(|c| acts(c) && c != '\n' && c != '\t'));
            // Inside of a JSON string it stays the same string.
            let json = serde_json::to_string(&any).unwrap();
            let shown: String = serde_json::from_str(&text(&json)).unwrap();
            prop_assert_eq!(shown, any);
        }
    }
}
