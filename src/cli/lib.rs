//! The command line: arguments in, exit code out. Each subcommand is one file under `cli/`.
//!
//! Results go to stdout, diagnostics to stderr. Exit codes: 0 done; 1 the run failed; 2 bad
//! arguments or config; 3 done, but something was lost ([`outcome`](crate::exit_code) sorts them).
//!
//! ```
//! let program = hydroline_cli::command(hydroline_core::build_info::BuildInfo::default());
//! assert!(program.find_subcommand("record").is_some());
//! assert!(program.try_get_matches_from(["hydroline", "record"]).is_err()); // a rig is missing
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod aim;
mod board;
mod bring_back;
mod calibrate;
mod calibrated;
pub mod call;
mod campaign;
mod check;
mod coefficients;
mod compare;
mod completions;
mod demo;
mod design;
mod devices;
mod diagnose;
mod export;
mod extract;
mod fail_on;
mod flat;
mod groups;
mod identify;
mod images;
mod import;
mod inputs;
mod join;
mod limit;
mod live;
mod log_tools;
mod logs;
mod man;
mod many;
mod model;
mod outcome;
mod output;
mod paper;
mod plan;
mod predict;
mod print;
#[cfg(feature = "lab")]
#[doc(hidden)]
pub mod printed;
mod progress;
#[cfg(feature = "lab")]
mod prove;
mod publish;
mod record;
mod remembered;
mod replay;
#[cfg(feature = "lab")]
mod reproduce;
mod rig;
mod rigging;
mod sim_controller;
mod simulate;
mod system;
mod target;
#[cfg(test)]
mod tests;
mod view;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use hydroline_core::build_info::BuildInfo;
use std::io::{ErrorKind, Write};
use std::process::ExitCode;

#[doc(hidden)]
pub use groups::GROUPS;
pub use outcome::{CliError, EXIT_CODES, Outcome, exit_code};

/// A rig by file or built-in name, checked as every command does.
pub fn load_rig(argument: &str) -> Result<hydroline_rigs::Rig, CliError> {
    inputs::rig(argument)
}

/// The stripe of an image file, as `extract` finds it.
///
/// # Errors
/// [`CliError::Config`] for a file that is missing or no image.
pub fn extract_file(
    image: &std::path::Path,
    extractor: &mut hydroline_stripe::Extractor,
) -> Result<hydroline_stripe::Profile, CliError> {
    inputs::readable_file(image, "name a PNG or JPEG image")?;
    let found = images::load(image, &hydroline_core::frame::GreyRule::default())
        .map_err(|words| CliError::Config(format!("{}: {words}", image.display())))?;
    Ok(extractor.extract(&found))
}

/// Output of `extract --json` for one image.
///
/// # Errors
/// [`CliError::Run`] where it cannot be written as JSON.
pub fn extracted(
    image: &std::path::Path,
    profile: &hydroline_stripe::Profile,
) -> Result<String, CliError> {
    Ok(serde_json::to_string(&extract::object(image, profile))?)
}

/// The end of the program: what went wrong goes to stderr, unless it is stdout's failure, which was said when it came.
pub fn conclude(result: Result<Outcome, CliError>) -> ExitCode {
    if let Err(error) = &result {
        let words = error.to_string();
        let said = print::finish().is_err_and(|stdout| stdout.to_string() == words);
        if !said {
            print::errln!("hydroline: {words}");
        }
    }
    exit_code(&result)
}

/// Exit codes and habits, shown under `--help`.
const AFTER_HELP: &str = "\
RIG, PLAN, BOARD and TARGET are files, or names that are built in: `--rig lshpi`, `--plan surge-4n`. Results go to \
stdout, diagnostics to stderr; RUST_LOG=debug says more.

Examples:
  hydroline demo              # the main job end to end, without hardware: start here
  hydroline help record       # every flag of a command, with examples

Exit codes: 0 done; 1 the run failed; 2 bad arguments or config (a file that is missing, unreadable or of the wrong \
kind too); 3 done, but something was lost (a lossy recovery, dropped frames, a disk that filled up after a readable \
file).";

/// Records a laser line on a tank floor against thruster commands, and turns it into motion.
#[derive(Debug, Parser)]
#[command(name = "hydroline", after_help = AFTER_HELP, max_term_width = 100)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// The main job end to end, without hardware, in two minutes
    Demo(demo::Args),
    /// Rig files: a commented one to fill in, a check, what is built in
    #[command(
        subcommand,
        after_help = "\
Examples:
  hydroline rig new --out my.toml
  hydroline rig show my.toml"
    )]
    Rig(rig::Command),
    /// Plans: what is built in, what runs on a rig, and at which size
    #[command(
        subcommand,
        after_help = "\
Examples:
  hydroline plan list --rig my.toml
  hydroline plan show reversals --rig my.toml"
    )]
    Plan(plan::Command),
    /// Cameras and serial ports by stable id, and what keeps them
    Devices(devices::Args),
    /// Is everything a rig needs there and usable? Says what to fix
    Check(check::Args),
    /// Focus, exposure and laser at a glance, before a run
    Aim(aim::Args),
    /// A calibration board at true scale, to mill, cut or print
    Board(board::Args),
    /// A target at true scale, to mill, cut or print
    Target(target::Args),
    /// An exposure series becomes the camera's tone curve and ceiling
    Flat(flat::Args),
    /// Images of a board become the map from image to laser plane
    Calibrate(Box<calibrate::Args>),
    /// The daemon: camera and thrusters into one log
    Record(Box<record::Args>),
    /// Contents of a log
    Info(log_tools::InfoArgs),
    /// Is a log sound? Every finding with its next step
    Doctor(log_tools::DoctorArgs),
    /// Mends a cut or damaged log into a new file
    Recover(log_tools::RecoverArgs),
    /// CSV or frames out of a log
    Export(export::Args),
    /// Stripes and poses from a log's images again, bit for bit
    Replay(replay::Args),
    /// Finished logs on a page in the browser: frames, plots, events
    View(view::Args),
    /// Stripe points of single images
    Extract(extract::Args),
    /// Motion and commands recorded by something else, into a log
    Import(import::Args),
    /// Motion from one log, commands from another: one log, one clock
    Join(join::Args),
    /// Hydrodynamic coefficients with their uncertainty
    Identify(identify::Args),
    /// Tables of coefficients: primed, scaled, with intervals
    Coefficients(coefficients::Args),
    /// Two results, rigs or logs on one page: what differs, in sds
    Compare(compare::Args),
    /// Physics that the model left out, and proof
    Diagnose(diagnose::Args),
    /// The motion a plan will make, with its band
    Predict(predict::Args),
    /// A rig's model for another program, and draws of it
    Model(model::Args),
    /// A plan rendered without hardware: same seed, same bytes
    Simulate(simulate::Args),
    /// The paper's tables, computed and printed beside its numbers
    #[cfg(feature = "lab")]
    Reproduce(reproduce::Args),
    /// Many logs: grouped, examined, fitted, compared
    Campaign(campaign::Args),
    /// Data set of runs for another group: data card, tables in SI
    Publish(publish::Args),
    /// Sealed cases, diagnosed blind, beside an ideal observer
    #[cfg(feature = "lab")]
    Prove(prove::Args),
    /// Completions of commands and flags for a shell
    Completions(completions::Args),
    /// The manual pages
    Man(man::Args),
    /// A simulated thruster controller on a socket or pseudo-terminal (for tests of real drivers)
    #[command(hide = true)]
    SimController(sim_controller::Args),
}

/// The whole command line, as the parser, the help, the manual and the completions have it.
pub fn command(build: BuildInfo) -> clap::Command {
    groups::grouped(Cli::command().version(build.to_string()))
}

impl Cli {
    /// Reads the process' arguments.
    ///
    /// # Errors
    /// The exit code when there is nothing to run: help or version were asked for (0; 1 when stdout did not take
    /// them), or the arguments are wrong (2).
    pub fn read(build: BuildInfo) -> Result<Self, ExitCode> {
        let mut command = command(build);
        command
            .try_get_matches_from_mut(std::env::args_os())
            .and_then(|mut matches| Self::from_arg_matches_mut(&mut matches))
            .map_err(|error| {
                let error = error.format(&mut command);
                let printed = error.print().and_then(|()| std::io::stdout().flush());
                match printed {
                    _ if error.use_stderr() => exit_code(&Err(CliError::config(error))),
                    Err(e) if e.kind() != ErrorKind::BrokenPipe => conclude(Err(CliError::run(
                        format_args!("stdout: {e}; what is printed is not complete"),
                    ))),
                    _ => exit_code(&Ok(Outcome::Done)),
                }
            })
    }

    /// Runs the command; `build` goes into every log that it writes.
    ///
    /// # Errors
    /// Whatever kept it from its result, sorted by exit code; a result that stdout did not take is none.
    pub fn run(self, build: BuildInfo) -> Result<Outcome, CliError> {
        hydroline_core::descriptors::make_room()?;
        let outcome = self.dispatch(build)?;
        print::finish()?;
        Ok(outcome)
    }

    fn dispatch(self, build: BuildInfo) -> Result<Outcome, CliError> {
        match self.command {
            Command::Demo(args) => demo::run(&args, build),
            Command::Rig(command) => rig::run(&command),
            Command::Plan(command) => plan::run(&command),
            Command::Devices(args) => devices::run(&args),
            Command::Check(args) => check::run(&args),
            Command::Aim(args) => aim::run(&args),
            Command::Board(args) => board::run(&args),
            Command::Target(args) => target::run(&args),
            Command::Flat(args) => flat::run(&args),
            Command::Calibrate(args) => calibrate::run(&args),
            Command::Record(args) => record::run(&args, build),
            Command::Info(args) => log_tools::info(&args),
            Command::Doctor(args) => log_tools::doctor(&args),
            Command::Recover(args) => log_tools::recover(&args, build),
            Command::Export(args) => export::run(&args),
            Command::Replay(args) => replay::run(&args, build),
            Command::View(args) => view::run(&args),
            Command::Extract(args) => extract::run(&args),
            Command::Import(args) => import::run(&args, build),
            Command::Join(args) => join::run(&args, build),
            Command::Identify(args) => identify::run(&args),
            Command::Coefficients(args) => coefficients::run(&args),
            Command::Compare(args) => compare::run(&args),
            Command::Diagnose(args) => diagnose::run(&args),
            Command::Predict(args) => predict::run(&args),
            Command::Model(args) => model::run(&args, build),
            Command::Simulate(args) => simulate::run(&args, build),
            #[cfg(feature = "lab")]
            Command::Reproduce(args) => reproduce::run(&args),
            Command::Campaign(args) => campaign::run(&args, build),
            Command::Publish(args) => publish::run(&args, build),
            #[cfg(feature = "lab")]
            Command::Prove(args) => prove::run(&args, build),
            Command::Completions(args) => completions::run(&args, build),
            Command::Man(args) => man::run(&args, build),
            Command::SimController(args) => sim_controller::run(&args),
        }
    }
}
