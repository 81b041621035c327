//! Exit codes, in one place.

use std::process::ExitCode;

/// A command that came to its end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// Done.
    Done,
    /// Done, but something was lost; the words were already printed.
    Lossy,
}

/// Why a command has no result.
#[derive(Debug, thiserror::Error)]
pub enum CliError {
    /// Arguments or a config file are wrong: nothing was started.
    #[error("{0}")]
    Config(String),
    /// The run itself failed.
    #[error("{0}")]
    Run(String),
}

impl CliError {
    /// A config error from anything that can be shown.
    pub fn config(error: impl std::fmt::Display) -> Self {
        Self::Config(error.to_string())
    }

    /// A run error from anything that can be shown.
    pub fn run(error: impl std::fmt::Display) -> Self {
        Self::Run(error.to_string())
    }
}

/// 0 done, 1 failed, 2 bad arguments or config, 3 done but something was lost.
pub fn exit_code(result: &Result<Outcome, CliError>) -> ExitCode {
    ExitCode::from(match result {
        Ok(Outcome::Done) => 0,
        Ok(Outcome::Lossy) => 3,
        Err(CliError::Run(_)) => 1,
        Err(CliError::Config(_)) => 2,
    })
}
