//! Files that a rig names: targets and boards.

use std::path::{Path, PathBuf};

use super::target::{Placement, read_placement};
use super::{Problems, Section, read_board, read_document, read_target, read_text};
use crate::builtin;
use crate::error::ProblemKind;
use crate::{Board, Target};

/// Where the files a rig names are looked for.
pub(crate) enum Includes {
    /// Beside the rig file.
    Folder(PathBuf),
    /// Among the files compiled in.
    Builtin,
}

/// Marks a built-in in a rig that lies on disk.
const BUILTIN_PREFIX: &str = "builtin:";

impl Includes {
    /// Name for messages, and the text; `Err` = what went wrong and what to do.
    fn text(&self, kind: &'static str, typed: &str) -> Result<(String, String), (String, String)> {
        let builtin_name = match (self, typed.strip_prefix(BUILTIN_PREFIX)) {
            (_, Some(name)) => Some(name),
            (Includes::Builtin, None) => Some(typed),
            (Includes::Folder(_), None) => None,
        };
        if let Some(name) = builtin_name {
            let stem = Path::new(name)
                .file_stem()
                .and_then(|s| s.to_str())
                .unwrap_or(name);
            let files = builtin::files(kind);
            return match files.iter().find(|(known, _)| *known == stem) {
                Some((known, text)) => Ok((format!("builtin:{known}"), (*text).to_owned())),
                None => Err((
                    format!("no built-in {kind} is called {stem:?}"),
                    format!(
                        "Enter one of {}, or write the table out",
                        files
                            .iter()
                            .map(|(n, _)| format!("{BUILTIN_PREFIX}{n}"))
                            .collect::<Vec<_>>()
                            .join(", ")
                    ),
                )),
            };
        }
        let Includes::Folder(folder) = self else {
            return Err((
                format!("{typed} cannot be found"),
                "Write the table out".to_owned(),
            ));
        };
        let path = folder.join(typed);
        match read_text(&path) {
            Ok(text) => Ok((path.display().to_string(), text)),
            Err(error) => Err((
                error.to_string(),
                format!(
                    "The path counts from the rig's own folder; built-in ones are {}",
                    builtin::files(kind)
                        .iter()
                        .map(|(n, _)| format!("{BUILTIN_PREFIX}{n}"))
                        .collect::<Vec<_>>()
                        .join(", ")
                ),
            )),
        }
    }
}

/// What a rig says about a target or board.
enum Source<'d> {
    /// `[target]` written out.
    Inline(Section<'d>),
    /// `target = "FILE"`, or `[target]` with `file = "FILE"` (the section then may place it).
    File(String, Option<Section<'d>>),
}

fn source<'d>(root: &Section<'d>, key: &str) -> Option<Option<Source<'d>>> {
    root.asks_for(key, "table", "");
    let Some(item) = root.item(key) else {
        return Some(None);
    };
    if let Some(file) = item.value.as_str() {
        return Some(Some(Source::File(file.to_owned(), None)));
    }
    let Some(section) = root.section_of(&item) else {
        root.wrong_type(
            &item,
            format!("a table [{key}] or the path of a {key} file"),
        );
        return None;
    };
    section.asks_for(
        "file",
        "text",
        "the path of a file beside the rig, or `\"builtin:NAME\"`",
    );
    if section.has("file") {
        let (file, _) = section.text_opt("file", "the path of a file")?;
        return Some(Some(Source::File(file, Some(section))));
    }
    Some(Some(Source::Inline(section)))
}

fn included<T>(
    root: &Section<'_>,
    includes: &Includes,
    kind: &'static str,
    file: &str,
    read: impl FnOnce(&Section<'_>) -> Option<T>,
) -> Option<T> {
    match includes.text(kind, file) {
        Ok((name, text)) => {
            let problems: &Problems = root.problems();
            read_document(&name, &text, problems, read)
        }
        Err((what, next)) => {
            if let Some(item) = root.item(kind) {
                root.report(&item, ProblemKind::Rule { what, next });
            }
            None
        }
    }
}

/// `Some(None)`: the rig has none. `None`: reported.
pub(super) fn read_rig_target(root: &Section<'_>, includes: &Includes) -> Option<Option<Target>> {
    match source(root, "target")? {
        None => Some(None),
        Some(Source::Inline(section)) => read_target(&section).map(Some),
        Some(Source::File(file, section)) => {
            let placement: Placement = match &section {
                Some(section) => {
                    let placement = read_placement(section);
                    section.finish();
                    placement?
                }
                None => (None, None),
            };
            let mut target = included(root, includes, "target", &file, read_target)?;
            if let Some([x, y]) = placement.0 {
                target.origin[0] = x;
                target.origin[1] = y;
            }
            if let Some(heading) = placement.1 {
                target.origin[2] = heading;
            }
            Some(Some(target))
        }
    }
}

/// `Some(None)`: the rig has none. `None`: reported.
pub(super) fn read_rig_board(root: &Section<'_>, includes: &Includes) -> Option<Option<Board>> {
    match source(root, "board")? {
        None => Some(None),
        Some(Source::Inline(section)) => read_board(&section).map(Some),
        Some(Source::File(file, section)) => {
            if let Some(section) = &section {
                section.finish();
            }
            included(root, includes, "board", &file, read_board).map(Some)
        }
    }
}
