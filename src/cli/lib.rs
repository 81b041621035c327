//! The command line: arguments in, exit code out. Each subcommand is one file under `cli/`.
//!
//! Results go to stdout, diagnostics to stderr. Exit codes: 0 done; 1 the run failed; 2 bad
//! arguments or config; 3 done, but something was lost.

mod aim;
mod board;
mod calibrate;
mod calibrated;
mod check;
mod demo;
mod devices;
mod diagnose;
mod extract;
mod identify;
mod import;
mod inputs;
mod log_tools;
mod outcome;
mod predict;
mod print;
mod progress;
mod prove;
mod record;
mod replay;
mod reproduce;
mod rig;
mod rigging;
mod sim_controller;
mod simulate;
mod target;

use clap::{Parser, Subcommand};

pub use outcome::{CliError, Outcome, exit_code};

/// Exit codes and habits, shown under `--help`.
const AFTER_HELP: &str = "\
Exit codes: 0 done; 1 the run failed; 2 bad arguments or config; 3 done, but something was lost
(a lossy recovery, dropped frames, a disk that filled up after a readable file).

RIG, PLAN and BOARD are files, or names that are built in: `--rig lshpi`, `--plan surge-4n`.
Results go to stdout, diagnostics to stderr; RUST_LOG=debug says more.

Start with `hydroline demo`: the main job end to end, without hardware.";

/// Records a laser line on a tank floor against thruster commands, and turns it into motion.
#[derive(Debug, Parser)]
#[command(name = "hydroline", version, after_help = AFTER_HELP, max_term_width = 100)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Main job end to end on the built-in rig: simulate, record, extract, replay
    Demo(demo::Args),
    /// Cameras by stable id, serial ports, and what keeps you from using them
    Devices(devices::Args),
    /// Is everything a rig needs there and usable? Says what to fix
    Check(check::Args),
    /// Focus, exposure and laser at a glance, before a run
    Aim(aim::Args),
    /// The daemon: camera and thrusters into one log
    Record(Box<record::Args>),
    /// Re-extracts stripes from a log's images, offline and deterministic
    Replay(replay::Args),
    /// The paper's tables, computed and printed beside its numbers
    Reproduce(reproduce::Args),
    /// Renders a plan without hardware or waiting: same rig and seed, same bytes
    Simulate(simulate::Args),
    /// Images of a board become the map from image to laser plane, with its uncertainty
    Calibrate(Box<calibrate::Args>),
    /// A calibration board at true scale, to mill, cut or print
    Board(board::Args),
    /// A target at true scale, to mill, cut or print
    Target(target::Args),
    /// Stripe points of single images
    Extract(extract::Args),
    /// Motion and commands recorded by something else, into a log
    Import(import::Args),
    /// Hydrodynamic coefficients with their uncertainty
    Identify(identify::Args),
    /// Which physics the model left out, and proof
    Diagnose(diagnose::Args),
    /// Sealed cases of the simulator, diagnosed blind and scored beside an ideal observer
    Prove(prove::Args),
    /// The motion a plan will make, with its band
    Predict(predict::Args),
    /// Rig files
    #[command(subcommand)]
    Rig(rig::Command),
    /// What is in a log
    Info(log_tools::InfoArgs),
    /// Is a log sound? Every finding with its next step
    Doctor(log_tools::DoctorArgs),
    /// Mends a cut or damaged log into a new file; the original stays as it is
    Recover(log_tools::RecoverArgs),
    /// CSV or frames out of a log
    Export(log_tools::ExportArgs),
    /// A simulated thruster controller on a socket or pseudo-terminal (for tests of real drivers)
    #[command(hide = true)]
    SimController(sim_controller::Args),
}

impl Cli {
    /// Runs the command.
    ///
    /// # Errors
    /// Whatever kept it from its result, sorted by exit code.
    pub fn run(self) -> Result<Outcome, CliError> {
        match self.command {
            Command::Demo(args) => demo::run(&args),
            Command::Devices(args) => devices::run(&args),
            Command::Check(args) => check::run(&args),
            Command::Info(args) => log_tools::info(&args),
            Command::Doctor(args) => log_tools::doctor(&args),
            Command::Recover(args) => log_tools::recover(&args),
            Command::Export(args) => log_tools::export(&args),
            Command::Aim(args) => aim::run(&args),
            Command::Record(args) => record::run(&args),
            Command::Replay(args) => replay::run(&args),
            Command::Reproduce(args) => reproduce::run(&args),
            Command::Simulate(args) => simulate::run(&args),
            Command::Calibrate(args) => calibrate::run(&args),
            Command::Board(args) => board::run(&args),
            Command::Target(args) => target::run(&args),
            Command::Extract(args) => extract::run(&args),
            Command::Import(args) => import::run(&args),
            Command::Identify(args) => identify::run(&args),
            Command::Diagnose(args) => diagnose::run(&args),
            Command::Prove(args) => prove::run(&args),
            Command::Predict(args) => predict::run(&args),
            Command::Rig(command) => rig::run(&command),
            Command::SimController(args) => sim_controller::run(&args),
        }
    }
}
