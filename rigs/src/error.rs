//! Errors of rig, target, board and plan files.
//!
//! A file is read to its end before anything is reported, so one run shows every
//! mistake in it; each [`Problem`] says where, what was typed, what is allowed and
//! what to do next.

use std::fmt;

/// Why a file did not become a rig, target, board or plan.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum RigError {
    #[error("{file}: cannot be read: {reason}. {next}")]
    Unreadable {
        file: String,
        /// The operating system's message, or why the content was refused.
        reason: String,
        next: String,
    },
    #[error("{}", list(.problems))]
    Invalid {
        /// All of them, in the order of the file.
        problems: Vec<Problem>,
    },
    #[error("no {kind} file and no built-in {kind} is called {name:?}{}. Give a path to a file or one of: {}", suggest(.suggestion), .known.join(", "))]
    UnknownName {
        /// `rig`, `plan`, `target` or `board`.
        kind: &'static str,
        name: String,
        /// Nearest built-in name, when one is near.
        suggestion: Option<String>,
        known: Vec<&'static str>,
    },
}

impl RigError {
    /// The problems found inside the file; empty when it could not be read or found.
    pub fn problems(&self) -> &[Problem] {
        match self {
            RigError::Invalid { problems } => problems,
            _ => &[],
        }
    }
}

/// One thing wrong in a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Problem {
    /// File as named by the caller (`builtin:NAME` for built-ins).
    pub file: String,
    /// Line, counted from 1, where known.
    pub line: Option<usize>,
    /// Key path, entries of lists counted from 0: `thruster[2].curve[3]`. Empty for the file as a whole.
    pub key: String,
    /// Kind of problem, with its message.
    pub kind: ProblemKind,
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.file)?;
        if let Some(line) = self.line {
            write!(f, ":{line}")?;
        }
        if !self.key.is_empty() {
            write!(f, ": {}", self.key)?;
        }
        write!(f, ": {}", self.kind)
    }
}

/// Kind of problem with a key or a value.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum ProblemKind {
    #[error(
        "not valid TOML: {message}. Mend the syntax at that line; the other checks run once it parses"
    )]
    Syntax { message: String },
    #[error("unknown key{}. Allowed here: {}", suggest(.suggestion), .allowed.join(", "))]
    UnknownKey {
        suggestion: Option<String>,
        /// Every key allowed in this table.
        allowed: Vec<String>,
    },
    #[error("missing. Add {expected}")]
    Missing { expected: String },
    #[error("is {typed}, but must be {expected}")]
    WrongType {
        typed: String,
        /// Expected content, with unit.
        expected: String,
    },
    #[error("is {typed}, but must be {allowed}{hint}")]
    OutOfRange {
        typed: String,
        /// Allowed range with unit.
        allowed: String,
        /// Extra advice, empty or starting with `. `.
        hint: String,
    },
    #[error("is {typed}, but must be one of {}{}", .allowed.join(", "), suggest(.suggestion))]
    NotOneOf {
        typed: String,
        allowed: Vec<String>,
        suggestion: Option<String>,
    },
    #[error("{what}. {next}")]
    Rule {
        /// The rule that is broken, with the values.
        what: String,
        next: String,
    },
}

fn suggest(suggestion: &Option<String>) -> String {
    suggestion
        .as_ref()
        .map(|word| format!(" (did you mean `{word}`?)"))
        .unwrap_or_default()
}

fn list(problems: &[Problem]) -> String {
    let lines: Vec<String> = problems.iter().map(ToString::to_string).collect();
    match lines.as_slice() {
        [one] => one.clone(),
        many => format!(
            "{} things to put right:\n  {}",
            many.len(),
            many.join("\n  ")
        ),
    }
}

/// The nearest of `known` to `typed`, if near enough to be a slip of the keyboard
/// (or one is the other plus a unit suffix, the commonest mistake in these files).
pub(crate) fn nearest<'a>(typed: &str, known: impl Iterator<Item = &'a str>) -> Option<String> {
    let lower = typed.to_lowercase();
    let limit = (typed.chars().count() / 3).clamp(1, 3);
    known
        .map(|word| {
            let suffix_missing = word
                .strip_prefix(typed)
                .is_some_and(|rest| rest.starts_with('_') && !typed.is_empty());
            let distance = if suffix_missing {
                0
            } else {
                strsim::osa_distance(&lower, &word.to_lowercase())
            };
            (distance, word)
        })
        .filter(|(distance, _)| *distance <= limit)
        .min()
        .map(|(_, word)| word.to_owned())
}
