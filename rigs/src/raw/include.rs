//! Files that a rig names: targets and boards.

use std::marker::PhantomData;
use std::path::{Path, PathBuf};

use super::kinds::{One, text};
use super::{Described, Kind, Problems, Section, Table, Writer, read_document, read_text};
use crate::builtin;

/// Where the files a rig names are looked for.
#[derive(Default)]
pub(crate) enum Includes {
    /// Beside the rig file.
    Folder(PathBuf),
    /// Among the files compiled in.
    #[default]
    Builtin,
}

/// Marks a built-in in a rig that lies on disk.
const BUILTIN_PREFIX: &str = "builtin:";

/// The built-in files of a kind, as a rig on disk names them.
fn known(kind: &str) -> String {
    let names = builtin::files(kind).iter();
    let names: Vec<String> = names.map(|(n, _)| format!("{BUILTIN_PREFIX}{n}")).collect();
    names.join(", ")
}

impl Includes {
    /// Name for messages, and the text; `Err` = what went wrong and what to do.
    fn text(&self, kind: &str, typed: &str) -> Result<(String, String), (String, String)> {
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
                    format!("Enter one of {}, or write the table out", known(kind)),
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
                    known(kind)
                ),
            )),
        }
    }
}

/// A table that is written out, or stands in a file that the rig names: `key = "FILE"`, or `[key]` with `file = "FILE"`.
pub(crate) struct Included<T, P> {
    place: fn(&mut T, P),
    of: PhantomData<(T, P)>,
}

/// Beside `file` the keys of `P` may stand, which `place` the included table anew.
pub(crate) const fn included<T: Table, P: Table>(place: fn(&mut T, P)) -> Included<T, P> {
    Included {
        place,
        of: PhantomData,
    }
}

impl<T: Table, P: Table> Included<T, P> {
    /// Reads the file that `key` names.
    fn file(&self, s: &Section<'_>, key: &str, file: &str) -> Option<T> {
        let problems: &Problems = s.problems();
        match problems.includes.text(key, file) {
            Ok((name, text)) => read_document(&name, &text, problems, T::read),
            Err((what, next)) => {
                s.rule(key, what, next);
                None
            }
        }
    }
}

impl<T: Table, P: Table> Kind for Included<T, P> {
    type Value = T;

    fn typed(&self, s: &Section<'_>, key: &str) -> Option<Option<T>> {
        let Some(item) = s.item(key) else {
            return Some(None);
        };
        if let Some(file) = item.value.as_str() {
            return self.file(s, key, file).map(Some);
        }
        let Some(section) = s.section_of(&item) else {
            s.wrong_type(
                &item,
                format!("a table [{key}] or the path of a {key} file"),
            );
            return None;
        };
        match file().typed(&section, "file")? {
            None => T::read(&section).map(Some),
            Some(file) => {
                let placed = P::read(&section);
                let mut table = self.file(s, key, &file)?;
                (self.place)(&mut table, placed?);
                Some(Some(table))
            }
        }
    }

    fn left_out(&self, s: &Section<'_>, key: &str) -> Option<T> {
        s.missing(key, format!("the table [{key}]"));
        None
    }

    fn write(&self, w: &mut Writer, key: &str, value: &T) {
        w.table(key, value);
    }

    fn describe(&self, to: &mut Described<'_>, key: &str, about: &'static str) {
        to.table::<T>(key, |to| {
            file().optional().describe(to, "file", about);
            T::describe_keys(to);
        });
    }
}

/// The key that names the file.
fn file() -> One<String> {
    text(
        "the path of a file beside the rig, or `\"builtin:NAME\"`",
        |_| true,
    )
}
