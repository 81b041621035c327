//! Errors of the crates as exceptions of `hydroline._errors`.

use hydroline_cli::CliError;
use hydroline_cli::call::CallError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// An exception of that class with these words.
fn raised(py: Python<'_>, class: &str, words: &str, attributes: &Bound<'_, PyDict>) -> PyErr {
    let made = py
        .import("hydroline._errors")
        .and_then(|module| module.getattr(class))
        .and_then(|class| class.call((words,), Some(attributes)));
    match made {
        Ok(exception) => PyErr::from_value(exception),
        Err(error) => error,
    }
}

/// Error of the input.
pub fn input(py: Python<'_>, words: impl std::fmt::Display) -> PyErr {
    raised(py, "InputError", &words.to_string(), &PyDict::new(py))
}

/// Error of the run.
pub fn run(py: Python<'_>, words: impl std::fmt::Display) -> PyErr {
    raised(py, "RunError", &words.to_string(), &PyDict::new(py))
}

/// Any error that the command line sorts into an exit code.
pub fn sorted(py: Python<'_>, error: impl Into<CliError>) -> PyErr {
    match error.into() {
        CliError::Config(words) => input(py, words),
        CliError::Run(words) => run(py, words),
    }
}

/// A call's.
pub fn called(py: Python<'_>, error: CallError) -> PyErr {
    let attributes = PyDict::new(py);
    match error {
        CallError::Command(error) => sorted(py, error),
        CallError::Argument {
            words,
            argument,
            value,
            allowed,
        } => {
            let keyword = argument.trim_start_matches('-').replace('-', "_");
            let set = [("argument", keyword), ("value", value)]
                .into_iter()
                .try_for_each(|(name, text)| attributes.set_item(name, text))
                .and_then(|()| attributes.set_item("allowed", allowed));
            match set {
                Ok(()) => raised(py, "ArgumentError", &words, &attributes),
                Err(error) => error,
            }
        }
    }
}
