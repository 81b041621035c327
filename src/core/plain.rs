//! Words of others on a terminal: nothing in them moves the cursor, sets a colour or title, or hides what stands there.
//!
//! A log, a table or a file name may hold any character. What a terminal would act on instead of showing it is written
//! as JSON writes it (`\u001b`), so that the same text is also sound inside of a JSON string.

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
