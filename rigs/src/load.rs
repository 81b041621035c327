//! From files, texts and built-in names to checked objects, and back to text.

use std::path::{Path, PathBuf};

use crate::bounded::is_stdin;
use crate::builtin;
use crate::error::{RigError, nearest};
use crate::raw::{Includes, Problems, Table, Writer, read_document, read_text};
use crate::{Board, Plan, Rig, Target};

fn names(kind: &str) -> Vec<&'static str> {
    builtin::files(kind).iter().map(|(name, _)| *name).collect()
}

/// A path when a file is there or it looks like a path, otherwise a built-in name.
fn is_path(arg: &str) -> bool {
    let path = Path::new(arg);
    path.is_file() || is_stdin(path) || arg.contains('/') || arg.ends_with(".toml")
}

type Read<T> = Result<T, RigError>;

fn parse<T: Table>(text: &str, file_name: &str, problems: Problems) -> Read<T> {
    let table = read_document(file_name, text, &problems, T::read);
    problems.finish(file_name, table)
}

fn load<T>(path: &Path, parse: impl Fn(&str, &str) -> Read<T>) -> Read<T> {
    parse(&read_text(path)?, &path.display().to_string())
}

fn built_in<T>(kind: &'static str, name: &str, parse: impl Fn(&str, &str) -> Read<T>) -> Read<T> {
    match builtin::files(kind)
        .iter()
        .find(|(known, _)| *known == name)
    {
        Some((_, text)) => parse(text, &format!("builtin:{name}")),
        None => Err(RigError::UnknownName {
            kind,
            name: name.chars().take(200).collect(),
            suggestion: nearest(name, names(kind).into_iter()),
            known: names(kind),
        }),
    }
}

/// The table as a file of its own.
fn file(table: &impl Table) -> String {
    Writer::text_of("", |w| table.write_keys(w))
}

impl Rig {
    /// Reads a rig file; targets and boards it names are looked for beside it.
    ///
    /// # Errors
    /// [`RigError::Unreadable`], or [`RigError::Invalid`] with everything wrong in the file.
    pub fn load(path: &Path) -> Result<Rig, RigError> {
        let folder = path.parent().unwrap_or(Path::new(""));
        load(path, |text, name| Rig::from_toml(text, name, Some(folder)))
    }

    /// Reads a rig from a text. `file_name` is for messages; `base_dir` is where target
    /// and board files are looked for (`None`: only among the built-in ones).
    ///
    /// # Errors
    /// [`RigError::Invalid`] with everything wrong in the text.
    pub fn from_toml(
        text: &str,
        file_name: &str,
        base_dir: Option<&Path>,
    ) -> Result<Rig, RigError> {
        let folder = base_dir.map(|folder| Includes::Folder(PathBuf::from(folder)));
        let problems = Problems::with_includes(folder.unwrap_or_default());
        let mut rig: Rig = parse(text, file_name, problems)?;
        rig.effective_toml = rig.to_toml();
        Ok(rig)
    }

    /// A rig compiled in, e.g. `lshpi`.
    ///
    /// # Errors
    /// [`RigError::UnknownName`] with the names there are.
    pub fn builtin(name: &str) -> Result<Rig, RigError> {
        built_in("rig", name, |text, name| Rig::from_toml(text, name, None))
    }

    /// Loads the rig that `--rig` names: the path of a file or the name of a built-in rig.
    ///
    /// # Errors
    /// As [`Rig::load`] and [`Rig::builtin`].
    pub fn load_or_builtin(arg: &str) -> Result<Rig, RigError> {
        if is_path(arg) {
            Rig::load(Path::new(arg))
        } else {
            Rig::builtin(arg)
        }
    }

    /// Names of the built-in rigs.
    pub fn builtin_names() -> Vec<&'static str> {
        names("rig")
    }

    /// A complete, commented rig file to start from (`hydroline rig new`).
    pub fn template() -> &'static str {
        builtin::TEMPLATE
    }

    /// The rig as it is now as TOML: every include inlined, every default said. Reads back to the same rig, bit for bit:
    /// angles in radians, intrinsics as four numbers, floats in Rust's shortest exact form.
    pub fn to_toml(&self) -> String {
        file(self)
    }
}

/// Functions that plans, targets and boards have in common.
macro_rules! of_files {
    ($name:ident, $kind:literal, $option:literal) => {
        impl $name {
            #[doc = concat!("Reads a ", $kind, " file.")]
            ///
            /// # Errors
            /// [`RigError::Unreadable`], or [`RigError::Invalid`] with everything wrong in the file.
            pub fn load(path: &Path) -> Result<$name, RigError> {
                load(path, $name::from_toml)
            }

            #[doc = concat!("Value of ", $option, ": the path of a file or the name of a built-in ", $kind, ".")]
            ///
            /// # Errors
            /// As `load`; [`RigError::UnknownName`] for a name that is not built in.
            pub fn load_or_builtin(arg: &str) -> Result<$name, RigError> {
                if is_path(arg) {
                    $name::load(Path::new(arg))
                } else {
                    built_in($kind, arg, $name::from_toml)
                }
            }

            #[doc = concat!("Names of the built-in ", $kind, "s.")]
            pub fn builtin_names() -> Vec<&'static str> {
                names($kind)
            }

            #[doc = concat!("The ", $kind, " as a file that reads back to itself.")]
            pub fn to_toml(&self) -> String {
                file(self)
            }
        }
    };
}

of_files!(Plan, "plan", "`--plan`");
of_files!(Target, "target", "`hydroline target`");
of_files!(Board, "board", "`--board`");

impl Plan {
    /// Reads a plan from a text; a plan without a `name` is called after the file.
    ///
    /// # Errors
    /// [`RigError::Invalid`] with everything wrong in the text.
    pub fn from_toml(text: &str, file_name: &str) -> Result<Plan, RigError> {
        let mut plan: Plan = parse(text, file_name, Problems::default())?;
        plan.source_toml = text.to_owned();
        Ok(plan)
    }

    /// A plan compiled in, e.g. `surge-4n`.
    ///
    /// # Errors
    /// [`RigError::UnknownName`] with the names there are.
    pub fn builtin(name: &str) -> Result<Plan, RigError> {
        built_in("plan", name, Plan::from_toml)
    }
}

impl Target {
    /// Reads a target from a text.
    ///
    /// # Errors
    /// [`RigError::Invalid`] with everything wrong in the text.
    pub fn from_toml(text: &str, file_name: &str) -> Result<Target, RigError> {
        parse(text, file_name, Problems::default())
    }
}

impl Board {
    /// Reads a board from a text.
    ///
    /// # Errors
    /// [`RigError::Invalid`] with everything wrong in the text.
    pub fn from_toml(text: &str, file_name: &str) -> Result<Board, RigError> {
        parse(text, file_name, Problems::default())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_builtin_reads_and_round_trips() {
        for name in Rig::builtin_names() {
            let rig = Rig::builtin(name).unwrap_or_else(|e| panic!("{e}"));
            let again = Rig::from_toml(&rig.effective_toml, "effective.toml", None)
                .unwrap_or_else(|e| panic!("{e}"));
            assert_eq!(rig, again);
        }
        for name in Plan::builtin_names() {
            let plan = Plan::builtin(name).unwrap_or_else(|e| panic!("{e}"));
            let again =
                Plan::from_toml(&plan.to_toml(), "again.toml").unwrap_or_else(|e| panic!("{e}"));
            assert_eq!((&plan.name, &plan.steps), (&again.name, &again.steps));
        }
        for name in Target::builtin_names() {
            let target = Target::load_or_builtin(name).unwrap_or_else(|e| panic!("{e}"));
            assert_eq!(
                target,
                Target::from_toml(&target.to_toml(), "t").unwrap_or_else(|e| panic!("{e}"))
            );
        }
        for name in Board::builtin_names() {
            let board = Board::load_or_builtin(name).unwrap_or_else(|e| panic!("{e}"));
            assert_eq!(
                board,
                Board::from_toml(&board.to_toml(), "b").unwrap_or_else(|e| panic!("{e}"))
            );
        }
        Rig::from_toml(Rig::template(), "template.toml", None).unwrap_or_else(|e| panic!("{e}"));
    }
}
