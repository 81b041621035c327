//! Formats that are text and no table.

use super::Foreign;

/// Share of control characters from which a file is no text: random or packed bytes have a tenth, tables none but where a
/// disk damaged them.
const CONTROLS_MAX: f64 = 0.03;
/// Control characters that stand between the cells of tables: start of heading (as Hive writes it), file, group, record and unit
/// separator.
pub const CONTROL_SEPARATORS: [u8; 5] = [0x01, 0x1c, 0x1d, 0x1e, 0x1f];
/// Lines that hold equally many of a separator before it is one.
const EQUAL_LINES_LEAST: usize = 2;
/// Bytes that tell whether text is one of UTF-16.
const JUDGED_BYTES: usize = 512;
/// Characters in which a format's first words stand.
const BEGINNING_BYTES: usize = 4096;

/// Whether every other byte is 0 and those between are ASCII, as text of UTF-16 has it: the place of the zeros.
fn utf16_zeros(head: &[u8]) -> Option<usize> {
    match head {
        [0xff, 0xfe, ..] => return Some(1),
        [0xfe, 0xff, ..] => return Some(0),
        _ => {}
    }
    let own = &head[..head.len().min(JUDGED_BYTES)];
    [1, 0].into_iter().find(|zeros| {
        let share = |from: usize, fits: fn(&u8) -> bool| {
            let all: Vec<bool> = own.iter().skip(from).step_by(2).map(fits).collect();
            let fit = all.iter().filter(|f| **f).count();
            all.len() >= 8 && 10 * fit > 9 * all.len()
        };
        share(*zeros, |b| *b == 0)
            && share(1 - zeros, |b| {
                matches!(b, b'\t' | b'\n' | b'\r' | b' '..=b'~')
            })
    })
}

/// The control character that stands between the cells of a table: equally often in half of the lines and more.
fn control_separator(head: &[u8]) -> Option<u8> {
    CONTROL_SEPARATORS.into_iter().find(|separator| {
        let lines = head.split(|b| *b == b'\n').filter(|l| !l.is_empty());
        let count = |line: &[u8]| line.iter().filter(|b| *b == separator).count();
        let mut counts: Vec<usize> = lines.map(count).collect();
        counts.sort_unstable();
        let equal = counts.chunk_by(|a, b| a == b).filter(|own| own[0] > 0);
        let most = equal.map(<[usize]>::len).max().unwrap_or(0);
        most >= EQUAL_LINES_LEAST && 2 * most >= counts.len()
    })
}

/// Whether few enough bytes are control characters, but for one that separates cells.
fn has_few_controls(head: &[u8], separator: Option<u8>) -> bool {
    let (mut all, mut controls, mut before) = (0_usize, 0_usize, 1);
    for b in head {
        // A run of zeros counts once: a disk that lost its power leaves them in a table too.
        if *b != 0 || before != 0 {
            all += 1;
            let is_control = *b < b' ' && !matches!(b, b'\t'..=b'\r' | 0x1a | 0x1b);
            controls += usize::from((is_control || *b == 0x7f) && Some(*b) != separator);
        }
        before = *b;
    }
    controls as f64 <= CONTROLS_MAX * all as f64
}

/// Whether the bytes may be text, of whatever encoding.
pub(super) fn is_text(head: &[u8]) -> bool {
    utf16_zeros(head).is_some()
        || has_few_controls(head, None)
        || control_separator(head).is_some_and(|own| has_few_controls(head, Some(own)))
}

/// The first characters, without byte order mark and blanks; what is not ASCII is left out.
fn beginning(head: &[u8]) -> String {
    let own = &head[..head.len().min(BEGINNING_BYTES)];
    let from = utf16_zeros(head).map_or((0, 1), |zeros| (1 - zeros, 2));
    let bytes = own.iter().skip(from.0).step_by(from.1);
    let text: String = bytes
        .filter(|b| b.is_ascii())
        .map(|b| char::from(*b))
        .collect();
    text.trim_start().to_owned()
}

/// Whether a line is ArduPilot's record of a format, as text: `FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns`.
fn is_format_line(line: &[u8]) -> bool {
    let Some(rest) = line.strip_prefix(b"FMT,") else {
        return false;
    };
    let mut cells = rest.split(|b| *b == b',').map(|c| c.trim_ascii());
    let mut number = || {
        cells
            .next()
            .is_some_and(|c| !c.is_empty() && c.iter().all(u8::is_ascii_digit))
    };
    number() && number() && cells.count() >= 2
}

/// Whether text begins as JSON: an object, or an array of something that no header of a table holds.
fn is_json(text: &str) -> bool {
    let quoted = |text: &str| {
        let rest = text.strip_prefix('"')?;
        let end = rest.find('"')?;
        Some(rest[end + 1..].trim_start().to_owned())
    };
    if let Some(inside) = text.strip_prefix('{') {
        let inside = inside.trim_start();
        return inside.starts_with('}') || quoted(inside).is_some_and(|r| r.starts_with(':'));
    }
    let Some(inside) = text.strip_prefix('[') else {
        return false;
    };
    let inside = inside.trim_start();
    if inside.starts_with('{') || inside.starts_with('[') {
        return true;
    }
    // `[1] 0.5` is a print of R, `["t"]` a name.
    let end = inside.find([',', ']', '\n']).unwrap_or(inside.len());
    let (first, rest) = inside.split_at(end);
    let first = first.trim();
    let is_value = first.parse::<f64>().is_ok() || quoted(first).is_some_and(|r| r.is_empty());
    is_value && rest.starts_with(',')
}

/// Kind of a file that is text.
pub(super) fn find(head: &[u8]) -> Option<Foreign> {
    let text = beginning(head);
    let lower: String = text.chars().take(64).collect::<String>().to_lowercase();
    let begins = |words: &[&str]| words.iter().any(|w| lower.starts_with(w));
    let (what, next) = if begins(&["version https://git-lfs"]) {
        (
            "a pointer of Git LFS in the place of a file",
            "fetch the file itself: `git lfs pull` in its clone",
        )
    } else if begins(&["<!doctype html", "<html", "<head", "<body"]) {
        (
            "a page of HTML",
            "it may stand where a download was refused: fetch the file itself, or export a table (CSV)",
        )
    } else if begins(&["<?xml", "<gpx", "<kml", "<svg"]) {
        (
            "an XML file",
            "export a table (CSV) from the program that wrote it, and `hydroline import` that",
        )
    } else if begins(&["rosbag2_bagfile_information:"]) {
        (
            "the description of a bag of ROS 2 (metadata.yaml)",
            "name the folder in which it lies: `hydroline import FOLDER`",
        )
    } else if head.split(|b| *b == b'\n').any(is_format_line) {
        (
            "an ArduPilot DataFlash log as text (.log)",
            "`hydroline import` the .bin of which it was made, or write a message as a table: `mavlogdump.py --format csv --types ATT FILE > TABLE.csv` (pip install pymavlink)",
        )
    } else if is_json(&text) {
        (
            "a JSON file",
            "write it as a table, one row per sample: in Python `pandas.json_normalize(json.load(open(\"FILE\"))).to_csv(\"TABLE.csv\", index=False)`, and `hydroline import` that",
        )
    } else {
        return None;
    };
    Some(Foreign::new(what, next))
}
