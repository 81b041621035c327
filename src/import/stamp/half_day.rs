//! Halves of a day behind a clock of twelve hours.

/// The half of a day with which a text begins, as every parser reads it, and what stands behind it: `am`, `P.M.`, `a. m.`; `None` = it
/// begins with none.
pub(super) fn half_day(text: &str) -> Option<(&'static str, &str)> {
    let usual = match text.as_bytes().first()? {
        b'a' | b'A' => "AM",
        b'p' | b'P' => "PM",
        _ => return None,
    };
    let rest = &text[1..];
    let dotted = rest.strip_prefix('.').map(str::trim_start);
    let rest = dotted.unwrap_or(rest).strip_prefix(['m', 'M'])?;
    let rest = match dotted {
        Some(_) => rest.strip_prefix('.').unwrap_or(rest),
        None => rest,
    };
    // Longer words are names of zones: AMT, PMST.
    (!rest.starts_with(char::is_alphanumeric)).then_some((usual, rest))
}

/// A text whose half of a day is written as every parser reads it; `None` = there is none in it.
pub(super) fn with_usual_half(text: &str) -> Option<String> {
    text.char_indices().find_map(|(at, _)| {
        let before = &text[..at];
        let (usual, rest) =
            half_day(&text[at..]).filter(|_| !before.ends_with(char::is_alphabetic))?;
        Some(format!("{before}{usual}{rest}"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_of_a_day_are_known_in_any_spelling_and_names_of_zones_are_none() {
        for (text, usual) in [
            ("pm", "PM"),
            ("Am", "AM"),
            ("a.m.", "AM"),
            ("P.M.", "PM"),
            ("p. m.", "PM"),
            ("a.m", "AM"),
        ] {
            assert_eq!(half_day(text), Some((usual, "")), "{text}");
        }
        assert_eq!(half_day("pm CEST"), Some(("PM", " CEST")));
        for none in ["", "a", "p.", "AMT", "pm2", "PST", "m", "é.m."] {
            assert_eq!(half_day(none), None, "{none}");
        }
        assert_eq!(
            with_usual_half("01:11:12.04p.m.").as_deref(),
            Some("01:11:12.04PM")
        );
        assert_eq!(with_usual_half("01:11:12 spam"), None);
    }
}
