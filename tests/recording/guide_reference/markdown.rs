//! Markdown: the first lines of a chapter, cells and tables.

use std::fmt::Write;

/// Head of a generated chapter.
pub(super) fn head(title: &str, from: &str, introduction: &str) -> String {
    format!(
        "<!-- Generated from {from}: do not edit. HYDROLINE_UPDATE_REFERENCE=1 cargo test --test recording guide_reference -->\n\n\
         # {title}\n\n{introduction}\n"
    )
}

/// A table; rows have as many cells as the head.
pub(super) fn table<const N: usize>(text: &mut String, head: [&str; N], rows: &[[String; N]]) {
    let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
    text.push('\n');
    text.push_str(&line(&head.map(str::to_owned)));
    text.push_str(&line(&head.map(|_| "---".to_owned())));
    for row in rows {
        text.push_str(&line(&row.each_ref().map(|cell| cell_of(cell))));
    }
}

/// Text of a cell: on one line, and a bar does not end it.
fn cell_of(text: &str) -> String {
    let words: Vec<&str> = text.split_whitespace().collect();
    words.join(" ").replace('|', "\\|")
}

/// A link to another chapter, `at` = `#` and a heading in it.
pub(super) fn link(words: &str, chapter: &str, at: &str) -> String {
    format!("[{words}]({chapter}.md{at})")
}

/// Code within text.
pub(super) fn code(text: &str) -> String {
    format!("`{text}`")
}

/// A block of text as it is.
pub(super) fn block(text: &mut String, lines: &str) {
    // Writing to a string does not fail.
    let _ = write!(text, "\n```text\n{}\n```\n", lines.trim_end());
}

/// Text whose brackets, stars and angles Markdown and HTML would read as their own; code within it stays as it is.
pub(super) fn plain(text: &str) -> String {
    let escaped = |text: &str| {
        text.replace('<', "&lt;")
            .replace('[', "\\[")
            .replace(']', "\\]")
            .replace('*', "\\*")
    };
    let parts: Vec<&str> = text.split('`').collect();
    if parts.len().is_multiple_of(2) {
        return escaped(text); // a backtick by itself begins no code
    }
    let parts = parts.into_iter().enumerate();
    let parts: Vec<String> = parts
        .map(|(k, part)| match k % 2 {
            0 => escaped(part),
            _ => part.to_owned(),
        })
        .collect();
    parts.join("`")
}

/// A sentence: with a full stop.
pub(super) fn sentence(text: &str) -> String {
    let text = text.trim();
    match text.chars().last() {
        None | Some('.' | '?' | '!' | ':') => text.to_owned(),
        Some(_) => format!("{text}."),
    }
}
