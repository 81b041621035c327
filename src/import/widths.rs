//! Columns of fixed widths: their borders in a line, their names, and widths that a table of blanks shows.

/// Lines that show widths: fewer agree by chance.
const LINES_LEAST: usize = 5;

/// Byte in a line at which each column ends; the line's end for what it does not reach.
pub(crate) fn borders<'a>(line: &'a str, widths: &'a [usize]) -> impl Iterator<Item = usize> + 'a {
    let mut characters = line.char_indices();
    widths.iter().map(move |width| {
        for _ in 0..*width {
            if characters.next().is_none() {
                break;
            }
        }
        characters.offset()
    })
}

/// Whether a border stands inside a word of a line.
fn cuts_a_word(line: &str, widths: &[usize]) -> bool {
    let blank = |c: Option<char>| c.is_none_or(char::is_whitespace);
    borders(line, widths)
        .any(|at| !blank(line[..at].chars().next_back()) && !blank(line[at..].chars().next()))
}

/// Whether a border stands inside what looks like one number: columns that run together have a sign there, or a blank.
pub(crate) fn cuts_a_number(line: &str, widths: &[usize]) -> bool {
    let part = |c: Option<char>| c.is_some_and(|c| c.is_ascii_digit() || c == '.');
    borders(line, widths)
        .any(|at| part(line[..at].chars().next_back()) && part(line[at..].chars().next()))
}

/// Names of the columns: often they do not stand above their numbers, and then as many words are as many names.
pub(crate) fn names(line: &str, widths: &[usize]) -> Vec<String> {
    let mut from = 0;
    let mut by_width: Vec<String> = Vec::with_capacity(widths.len());
    for to in borders(line, widths) {
        by_width.push(line[from..to].trim().to_owned());
        from = to;
    }
    let all_named = by_width.iter().all(|n| !n.is_empty()) && line[from..].trim().is_empty();
    let words: Vec<&str> = line.split_whitespace().collect();
    if words.len() == widths.len() && (!all_named || cuts_a_word(line, widths)) {
        return words.into_iter().map(str::to_owned).collect();
    }
    by_width
}

/// Widths of columns whose cells all end at the same character, by the lines that have as many cells; `None` = there are none.
pub(crate) fn seen<'a>(lines: impl Iterator<Item = &'a str>, cells: usize) -> Option<Vec<usize>> {
    let (mut common, mut count): (Option<Vec<usize>>, usize) = (None, 0);
    for line in lines {
        let own = ends(line);
        if own.len() != cells {
            continue;
        }
        count += 1;
        if common.get_or_insert_with(|| own.clone()) != &own {
            return None;
        }
    }
    let ends = common.filter(|_| count >= LINES_LEAST)?;
    let starts = std::iter::once(0).chain(ends.iter().copied());
    Some(
        ends.iter()
            .zip(starts)
            .map(|(to, from)| to - from)
            .collect(),
    )
}

/// Character at which each word of a line ends.
fn ends(line: &str) -> Vec<usize> {
    let mut out = Vec::new();
    let (mut inside, mut at) = (false, 0);
    for c in line.chars() {
        let word = !c.is_whitespace();
        if inside && !word {
            out.push(at);
        }
        inside = word;
        at += 1;
    }
    if inside {
        out.push(at);
    }
    out
}

/// Widths as a map has them.
pub(crate) fn words(widths: &[usize]) -> String {
    let numbers: Vec<String> = widths.iter().map(usize::to_string).collect();
    format!("widths = [{}]", numbers.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn widths_are_seen_where_cells_end_and_names_need_not_stand_above() {
        let line = |k: i32| format!("{:9.4}{:9.5}{:9.5}", f64::from(k), -0.5, 0.1 * f64::from(k));
        let lines: Vec<String> = (0..20).map(line).collect();
        let found = seen(lines.iter().map(String::as_str), 3);
        assert_eq!(found.as_deref(), Some(&[9, 9, 9][..]));
        assert_eq!(
            seen(["1 2", "10 20", "1 2", "1 2", "1 2"].into_iter(), 2),
            None
        );
        assert_eq!(
            names("   t             x             u", &[9, 9, 9]),
            ["t", "x", "u"]
        );
        assert_eq!(
            names("  time    pos x    load", &[6, 9, 8]),
            ["time", "pos x", "load"]
        );
        assert!(cuts_a_number("   1.0000  0.50000", &[8, 9]));
        assert!(!cuts_a_number("   1.0000-99.50000", &[9, 9]));
    }
}
