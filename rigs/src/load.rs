//! From files, texts and built-in names to checked objects.

use std::path::{Path, PathBuf};

use crate::builtin;
use crate::effective;
use crate::error::{RigError, nearest};
use crate::raw::{
    Includes, Problems, is_name, read_board, read_document, read_plan, read_rig, read_target,
    read_text,
};
use crate::{Board, Plan, Rig, Target};

fn names(kind: &str) -> Vec<&'static str> {
    builtin::files(kind).iter().map(|(name, _)| *name).collect()
}

fn builtin_text(kind: &'static str, name: &str) -> Result<&'static str, RigError> {
    builtin::files(kind)
        .iter()
        .find(|(known, _)| *known == name)
        .map(|(_, text)| *text)
        .ok_or_else(|| RigError::UnknownName {
            kind,
            name: name.chars().take(200).collect(),
            suggestion: nearest(name, names(kind).into_iter()),
            known: names(kind),
        })
}

/// A path when a file is there or it looks like a path, otherwise a built-in name.
fn is_path(arg: &str) -> bool {
    Path::new(arg).is_file() || arg.contains('/') || arg.ends_with(".toml")
}

impl Rig {
    /// Reads a rig file; targets and boards it names are looked for beside it.
    ///
    /// # Errors
    /// [`RigError::Unreadable`], or [`RigError::Invalid`] with everything wrong in the file.
    pub fn load(path: &Path) -> Result<Rig, RigError> {
        let folder = path.parent().unwrap_or(Path::new(""));
        Rig::from_toml(&read_text(path)?, &path.display().to_string(), Some(folder))
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
        let includes = match base_dir {
            Some(folder) => Includes::Folder(PathBuf::from(folder)),
            None => Includes::Builtin,
        };
        let problems = Problems::default();
        let rig = read_document(file_name, text, &problems, |root| read_rig(root, &includes));
        let mut rig = problems.finish(file_name, rig)?;
        rig.effective_toml = effective::rig(&rig);
        Ok(rig)
    }

    /// A rig compiled in, e.g. `lshpi`.
    ///
    /// # Errors
    /// [`RigError::UnknownName`] with the names there are.
    pub fn builtin(name: &str) -> Result<Rig, RigError> {
        Rig::from_toml(builtin_text("rig", name)?, &format!("builtin:{name}"), None)
    }

    /// What `--rig` takes: the path of a file or the name of a built-in rig.
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
}

impl Plan {
    /// Reads a plan file.
    ///
    /// # Errors
    /// [`RigError::Unreadable`], or [`RigError::Invalid`] with everything wrong in the file.
    pub fn load(path: &Path) -> Result<Plan, RigError> {
        Plan::from_toml(&read_text(path)?, &path.display().to_string())
    }

    /// Reads a plan from a text; a plan without a `name` is called after the file.
    ///
    /// # Errors
    /// [`RigError::Invalid`] with everything wrong in the text.
    pub fn from_toml(text: &str, file_name: &str) -> Result<Plan, RigError> {
        let stem = Path::new(file_name.strip_prefix("builtin:").unwrap_or(file_name))
            .file_stem()
            .and_then(|s| s.to_str())
            .filter(|s| is_name(s))
            .unwrap_or("plan");
        let problems = Problems::default();
        let plan = read_document(file_name, text, &problems, |root| read_plan(root, stem));
        let mut plan = problems.finish(file_name, plan)?;
        plan.source_toml = text.to_owned();
        Ok(plan)
    }

    /// A plan compiled in, e.g. `surge-4n`.
    ///
    /// # Errors
    /// [`RigError::UnknownName`] with the names there are.
    pub fn builtin(name: &str) -> Result<Plan, RigError> {
        Plan::from_toml(builtin_text("plan", name)?, &format!("builtin:{name}"))
    }

    /// What `--plan` takes: the path of a file or the name of a built-in plan.
    ///
    /// # Errors
    /// As [`Plan::load`] and [`Plan::builtin`].
    pub fn load_or_builtin(arg: &str) -> Result<Plan, RigError> {
        if is_path(arg) {
            Plan::load(Path::new(arg))
        } else {
            Plan::builtin(arg)
        }
    }

    /// Names of the built-in plans.
    pub fn builtin_names() -> Vec<&'static str> {
        names("plan")
    }

    /// The plan as a file that reads back to the same steps.
    pub fn to_toml(&self) -> String {
        effective::plan(self)
    }
}

impl Target {
    /// Reads a target file.
    ///
    /// # Errors
    /// [`RigError::Unreadable`], or [`RigError::Invalid`] with everything wrong in the file.
    pub fn load(path: &Path) -> Result<Target, RigError> {
        Target::from_toml(&read_text(path)?, &path.display().to_string())
    }

    /// Reads a target from a text.
    ///
    /// # Errors
    /// [`RigError::Invalid`] with everything wrong in the text.
    pub fn from_toml(text: &str, file_name: &str) -> Result<Target, RigError> {
        let problems = Problems::default();
        let target = read_document(file_name, text, &problems, read_target);
        problems.finish(file_name, target)
    }

    /// What `hydroline target` takes: the path of a file or the name of a built-in target.
    ///
    /// # Errors
    /// As [`Target::load`]; [`RigError::UnknownName`] for a name that is not built in.
    pub fn load_or_builtin(arg: &str) -> Result<Target, RigError> {
        if is_path(arg) {
            return Target::load(Path::new(arg));
        }
        Target::from_toml(builtin_text("target", arg)?, &format!("builtin:{arg}"))
    }

    /// Names of the built-in targets.
    pub fn builtin_names() -> Vec<&'static str> {
        names("target")
    }

    /// The target as a file that reads back to itself.
    pub fn to_toml(&self) -> String {
        effective::target_file(self)
    }
}

impl Board {
    /// Reads a board file.
    ///
    /// # Errors
    /// [`RigError::Unreadable`], or [`RigError::Invalid`] with everything wrong in the file.
    pub fn load(path: &Path) -> Result<Board, RigError> {
        Board::from_toml(&read_text(path)?, &path.display().to_string())
    }

    /// Reads a board from a text.
    ///
    /// # Errors
    /// [`RigError::Invalid`] with everything wrong in the text.
    pub fn from_toml(text: &str, file_name: &str) -> Result<Board, RigError> {
        let problems = Problems::default();
        let board = read_document(file_name, text, &problems, read_board);
        problems.finish(file_name, board)
    }

    /// What `--board` takes: the path of a file or the name of a built-in board.
    ///
    /// # Errors
    /// As [`Board::load`]; [`RigError::UnknownName`] for a name that is not built in.
    pub fn load_or_builtin(arg: &str) -> Result<Board, RigError> {
        if is_path(arg) {
            return Board::load(Path::new(arg));
        }
        Board::from_toml(builtin_text("board", arg)?, &format!("builtin:{arg}"))
    }

    /// Names of the built-in boards.
    pub fn builtin_names() -> Vec<&'static str> {
        names("board")
    }

    /// The board as a file that reads back to itself.
    pub fn to_toml(&self) -> String {
        effective::board_file(self)
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
