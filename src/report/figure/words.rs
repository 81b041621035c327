//! Width of text, before any font is known.
//!
//! The reader's sans-serif font draws it. Widths are those of DejaVu Sans, the widest of the usual ones
//! (Arial and Helvetica are about a tenth narrower), so that what fits here fits everywhere.

pub(super) fn width_px(words: &str, size_px: f64) -> f64 {
    words.chars().map(advance_em).sum::<f64>() * size_px
}

/// Bold letters are wider.
pub(super) const BOLD: f64 = 1.12;

fn advance_em(c: char) -> f64 {
    match c {
        'i' | 'j' | 'l' | '\'' => 0.28,
        ' ' | '.' | ',' | 'I' | '|' | ':' | ';' => 0.34,
        '-' | '(' | ')' | '[' | ']' | 'f' | 't' | 'r' | '/' | '!' | '"' => 0.42,
        '+' | '<' | '>' | '=' | '~' | '^' | '#' | '\u{b1}' | '\u{2212}' => 0.84,
        'm' | 'M' | 'w' | 'W' | '%' | '@' => 0.99,
        'A'..='Z' | '&' => 0.79,
        c if c.is_ascii() => 0.64,
        // Greek, accents, superscripts; ideographs and the like are a square.
        c if (c as u32) < 0x2e80 => 0.8,
        _ => 1.0,
    }
}

/// Breaks text into lines of at most `room_px`, between words where it can; at least one line.
pub(super) fn wrap(words: &str, size_px: f64, room_px: f64) -> Vec<String> {
    let fits = |text: &str| width_px(text, size_px) <= room_px;
    let mut lines = Vec::new();
    let mut line = String::new();
    for word in words.split_whitespace() {
        let longer = if line.is_empty() {
            word.to_owned()
        } else {
            format!("{line} {word}")
        };
        if fits(&longer) {
            line = longer;
            continue;
        }
        if !line.is_empty() {
            lines.push(std::mem::take(&mut line));
        }
        // A word that no line holds is cut.
        for c in word.chars() {
            line.push(c);
            if !fits(&line) && line.chars().count() > 1 {
                line.pop();
                lines.push(std::mem::replace(&mut line, c.to_string()));
            }
        }
    }
    if !line.is_empty() || lines.is_empty() {
        lines.push(line);
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn lines_break_between_words_and_a_word_too_long_is_cut() {
        assert_eq!(wrap("", 10.0, 100.0), [""]);
        assert_eq!(wrap("one two  three", 10.0, 50.0), ["one two", "three"]);
        assert_eq!(wrap("abcdef", 10.0, 20.0), ["abc", "def"]);
    }

    proptest! {
        #[test]
        fn every_line_fits_and_no_letter_is_lost(text in "\\PC{0,80}", room_px in 1.0..300.0f64) {
            let lines = wrap(&text, 11.0, room_px);
            for line in &lines {
                prop_assert!(line.chars().count() <= 1 || width_px(line, 11.0) <= room_px);
            }
            let letters = |s: &str| s.chars().filter(|c| !c.is_whitespace()).collect::<String>();
            prop_assert_eq!(letters(&lines.concat()), letters(&text));
        }
    }
}
