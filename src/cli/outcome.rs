//! Exit codes, in one place: what each error of each room means to whoever typed the command.
//!
//! [`EXIT_CODES`] says what each code means.

mod sorted;

pub(crate) use sorted::Sorted;

use std::path::Path;
use std::process::ExitCode;

const DONE: u8 = 0;
const FAILED: u8 = 1;
const BAD_INPUT: u8 = 2;
const LOSSY: u8 = 3;

/// Every exit code: number, name, meaning.
pub const EXIT_CODES: [(u8, &str, &str); 4] = [
    (DONE, "done", "The command came to its end."),
    (
        FAILED,
        "failed",
        "What was given is sound, but the work did not come to its end, or not to what was asked of it.",
    ),
    (
        BAD_INPUT,
        "bad arguments or config",
        "What was given cannot be used: a word, a value, or a file that is missing, unreadable or of the wrong kind. Nothing was made of it.",
    ),
    (
        LOSSY,
        "done, but something was lost",
        "The result is there, but it lacks something, as the words on stderr say: a lossy recovery, dropped frames, a disk that filled up after a readable file.",
    ),
];

/// A command that came to its end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// The whole result is there.
    Done,
    /// Done, but something was lost; the words were already printed.
    Lossy,
}

impl Outcome {
    /// Of a result that is there; `lossy` = something of it was lost.
    pub(crate) fn of(lossy: bool) -> Self {
        if lossy { Self::Lossy } else { Self::Done }
    }
}

/// Why a command has no result.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum CliError {
    /// Input that cannot be used: arguments, a config file, an input file.
    #[error("{0}")]
    Config(String),
    #[error("{0}")]
    Run(String),
}

impl CliError {
    /// Error of the input, from anything that can be shown.
    pub(crate) fn config(error: impl std::fmt::Display) -> Self {
        Self::Config(error.to_string())
    }

    /// Error of the run, from anything that can be shown.
    pub(crate) fn run(error: impl std::fmt::Display) -> Self {
        Self::Run(error.to_string())
    }

    /// An input file that could not be read; `next` = what to do.
    pub(crate) fn reading(path: &Path, error: &std::io::Error, next: &str) -> Self {
        let words = format!("{}: {error}; {next}", path.display());
        if sorted::is_no_file(error.kind()) {
            Self::Config(words)
        } else {
            Self::Run(words)
        }
    }

    /// The same, headed by the file it is about, unless that is named already.
    pub(crate) fn about(self, path: &Path) -> Self {
        let shown = path.display().to_string();
        match self {
            Self::Config(words) if !words.contains(&shown) => {
                Self::Config(format!("{shown}: {words}"))
            }
            Self::Run(words) if !words.contains(&shown) => Self::Run(format!("{shown}: {words}")),
            named => named,
        }
    }

    /// An output file that could not be written. Where it was to go was looked at before the work began, so the disk
    /// is to blame, not the argument.
    pub(crate) fn writing(path: &Path, error: &impl std::fmt::Display) -> Self {
        Self::Run(format!(
            "{}: {error}; check that the folder is writable and the disk has room",
            path.display()
        ))
    }
}

impl<E: Sorted> From<E> for CliError {
    fn from(error: E) -> Self {
        let words = match error.next_step() {
            Some(next) => format!("{error}; {next}"),
            None => error.to_string(),
        };
        if error.is_input() {
            Self::Config(words)
        } else {
            Self::Run(words)
        }
    }
}

/// By [`EXIT_CODES`].
pub fn exit_code(result: &Result<Outcome, CliError>) -> ExitCode {
    ExitCode::from(match result {
        Ok(Outcome::Done) => DONE,
        Ok(Outcome::Lossy) => LOSSY,
        Err(CliError::Run(_)) => FAILED,
        Err(CliError::Config(_)) => BAD_INPUT,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{Error, ErrorKind};

    #[test]
    fn a_file_that_is_not_there_is_an_argument_and_a_failing_disk_is_a_run() {
        let path = Path::new("/logs/a.csv");
        let sort = |kind: ErrorKind| CliError::reading(path, &Error::from(kind), "check the path");
        for kind in [
            ErrorKind::NotFound,
            ErrorKind::IsADirectory,
            ErrorKind::NotADirectory,
            ErrorKind::PermissionDenied,
            ErrorKind::InvalidData,
        ] {
            let error = sort(kind);
            assert!(matches!(error, CliError::Config(_)), "{kind:?}");
            assert!(error.to_string().starts_with("/logs/a.csv: "), "{error}");
            assert!(error.to_string().ends_with("; check the path"), "{error}");
        }
        for kind in [ErrorKind::Other, ErrorKind::Interrupted] {
            assert!(matches!(sort(kind), CliError::Run(_)), "{kind:?}");
        }
    }

    #[test]
    fn what_a_log_lacks_is_the_argument_and_what_is_damaged_in_it_the_run() {
        use hydroline_log::LogError;
        let path = std::path::PathBuf::from("a.mcap");
        let missing = LogError::Read {
            path: path.clone(),
            source: ErrorKind::NotFound.into(),
        };
        let broken_disk = LogError::Read {
            path: path.clone(),
            source: Error::from_raw_os_error(5), // EIO
        };
        let code = |error: LogError| match CliError::from(error) {
            CliError::Run(_) => 1,
            CliError::Config(_) => 2,
        };
        assert_eq!(code(missing), 2);
        assert_eq!(code(broken_disk), 1);
        assert_eq!(code(LogError::Empty { path: path.clone() }), 2);
        let stopped = LogError::Stopped {
            reason: "no room".to_owned(),
        };
        assert_eq!(code(stopped), 1);
        // However deep it comes from.
        let found = b"text".to_vec();
        let nested = hydroline_diagnose::profiles::ImageError::Load(
            hydroline_identify::data::LoadError::Log(LogError::NotMcap { path, found }),
        );
        let error = CliError::from(nested);
        assert!(matches!(error, CliError::Config(_)));
        assert!(error.to_string().contains("hydroline import"), "{error}");
    }
}
