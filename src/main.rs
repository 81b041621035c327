//! The `hydroline` binary: arguments in, exit code out; everything else is the library's.

use clap::Parser;
use hydroline::cli::{Cli, exit_code};
use std::process::ExitCode;

fn main() -> ExitCode {
    let _diagnostics = hydroline::diagnostics::init();
    let result = Cli::parse().run();
    if let Err(error) = &result {
        eprintln!("hydroline: {error}");
    }
    exit_code(&result)
}
