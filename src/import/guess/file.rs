//! The guessed map's `[file]`.

use super::Draft;
use crate::map::{Encoding, FileMap, Separator};

/// A string as TOML writes it.
pub(super) fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

pub(super) fn write(file: &FileMap, draft: &mut Draft) {
    let mut keys = Vec::new();
    if !file.widths.is_empty() {
        keys.push(crate::widths::words(&file.widths));
    }
    match file.separator {
        _ if !file.widths.is_empty() => {}
        None | Some(Separator::Byte(b',')) => {}
        Some(own @ Separator::Byte(b)) if b.is_ascii_control() => {
            keys.push(format!("separator = \"{own}\""));
        }
        Some(other) => keys.push(format!("separator = {}", quoted(&other.to_string()))),
    }
    if file.decimal != '.' {
        keys.push(format!("decimal = \"{}\"", file.decimal));
    }
    if let Some(mark) = file.thousands {
        keys.push(format!("thousands = \"{mark}\""));
    }
    match file.encoding {
        None | Some(Encoding::Utf8) => {}
        Some(Encoding::Utf16Le) => keys.push("encoding = \"utf-16le\"".to_owned()),
        Some(Encoding::Utf16Be) => keys.push("encoding = \"utf-16be\"".to_owned()),
        Some(Encoding::Latin1) => keys.push("encoding = \"latin1\"".to_owned()),
    }
    if let Some(comment) = &file.comment {
        keys.push(format!("comment = {}", quoted(comment)));
    }
    if !file.header {
        keys.push("header = false".to_owned());
    }
    for (key, line) in [
        ("header_line", file.header_line),
        ("units_line", file.units_line),
        ("first_line", file.first_line),
        ("last_line", file.last_line),
    ] {
        if let Some(line) = line {
            keys.push(format!("{key} = {line}"));
        }
    }
    if !keys.is_empty() {
        draft.line("[file]");
        draft.toml.extend(keys);
    }
}
