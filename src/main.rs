//! The `hydroline` binary: arguments in, exit code out; everything else is the library's.

use hydroline::build_info::BuildInfo;
use hydroline::cli::{Cli, conclude};
use std::process::ExitCode;

fn main() -> ExitCode {
    let _diagnostics = hydroline::diagnostics::init();
    let build = BuildInfo::from_build_script(
        env!("HYDROLINE_BUILD_COMMIT"),
        env!("HYDROLINE_BUILD_DIRTY"),
    );
    match Cli::read(build) {
        Ok(cli) => conclude(cli.run(build)),
        Err(code) => code,
    }
}
