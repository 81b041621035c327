//! The `hydroline` binary: arguments in, exit code out; everything else is the library's.

use hydroline::build_info::BuildInfo;
use hydroline::cli::{Cli, exit_code};
use std::process::ExitCode;

fn main() -> ExitCode {
    let _diagnostics = hydroline::diagnostics::init();
    let build = BuildInfo::from_build_script(
        env!("HYDROLINE_BUILD_COMMIT"),
        env!("HYDROLINE_BUILD_DIRTY"),
    );
    let result = Cli::read(build).run(build);
    if let Err(error) = &result {
        eprintln!("hydroline: {error}");
    }
    exit_code(&result)
}
