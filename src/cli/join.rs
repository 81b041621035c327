//! `hydroline join`: motion from one log, commands from another, one log.

use std::path::PathBuf;

use super::print::{self, errln, outln};
use super::{CliError, Outcome, inputs};
use hydroline_core::build_info::BuildInfo;
use hydroline_import::join::{From, Given, join};

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Stamps of commands become t + OFFSET + DRIFT (t - t0), t0 being the first command; no value is resampled. Without \
--offset-s the offset comes from records of one clock in both logs (/clock, of one host), else it is estimated, with its sd, \
from how the motion answers to the commands. An estimated offset holds any latency between command and load: the log says so, \
and `diagnose` then names no latency that the offset could be. Where one is to be distinguished from the other, give an offset \
that was measured, with --offset-sd-s.

Examples:
  hydroline join mocap.mcap commands.mcap --out run.mcap
  hydroline join mocap.mcap commands.mcap --out run.mcap --offset-s -2.35 --offset-sd-s 0.004
  hydroline join mocap.mcap commands.mcap --out run.mcap --drift-ppm 0 --json

Exit codes: 0 done; 1 the log could not be written; 2 bad arguments or logs, or an offset that cannot be found (nothing is \
written).")]
pub struct Args {
    /// Log with the motion; its clock is kept
    #[arg(value_name = "MOTION.mcap")]
    motion: PathBuf,
    /// Log with the commands; its stamps are moved
    #[arg(value_name = "COMMANDS.mcap")]
    commands: PathBuf,
    /// Log to write
    #[arg(long, value_name = "LOG.mcap")]
    out: PathBuf,
    /// Time that is added to the commands' stamps, at the first of them [s]; default: found. Between two files whose clocks count from zeros of their own it is what lies between those clocks
    #[arg(long, value_name = "S", allow_negative_numbers = true, value_parser = seconds)]
    offset_s: Option<f64>,
    /// Standard deviation of --offset-s [s]
    #[arg(long, value_name = "S", default_value = "0", requires = "offset_s", value_parser = inputs::not_negative)]
    offset_sd_s: f64,
    /// Rate by which the motion's clock is faster [ppm]; default: found with the offset; beside a given one 0 with an sd of 50
    #[arg(long, value_name = "PPM", allow_negative_numbers = true, value_parser = parts)]
    drift_ppm: Option<f64>,
    /// Standard deviation of --drift-ppm [ppm]
    #[arg(long, value_name = "PPM", default_value = "0", requires = "drift_ppm", value_parser = inputs::not_negative)]
    drift_sd_ppm: f64,
    /// Largest offset from the stamps that is looked for [s]
    #[arg(long, value_name = "S", default_value = "600", value_parser = inputs::not_negative)]
    search_s: f64,
    /// Rig file or built-in name: what load the commands of its thrusters are
    #[arg(long, value_name = "RIG")]
    rig: Option<String>,
    /// Prints one JSON object
    #[arg(long)]
    json: bool,
}

fn bounded(text: &str, most: f64) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.abs() <= most => Ok(value),
        _ => Err(format!("'{text}' is not a number within {most} of 0")),
    }
}

/// A century.
fn seconds(text: &str) -> Result<f64, String> {
    bounded(text, 4e9)
}

/// No clock that is one is further off.
fn parts(text: &str) -> Result<f64, String> {
    bounded(text, 1e5)
}

pub fn run(args: &Args, build: BuildInfo) -> Result<Outcome, CliError> {
    inputs::new_file("--out", &args.out)?;
    let rig = args.rig.as_deref().map(inputs::rig).transpose()?;
    let given = Given {
        offset_s: args.offset_s,
        offset_sd_s: args.offset_sd_s,
        drift_ppm: args.drift_ppm,
        drift_sd_ppm: args.drift_sd_ppm,
        search_s: args.search_s,
    };
    let joined = join(
        &args.motion,
        &args.commands,
        given,
        rig.as_ref(),
        &args.out,
        build,
    )?;
    let r = &joined.relation;
    for warning in &r.warnings {
        errln!("WARNING {warning}");
    }
    if args.json {
        print::json(&joined)?;
        return Ok(Outcome::Done);
    }
    outln!(
        "{}: {} motion samples, {} commands ({} outside of the motion's time)",
        args.out.display(),
        joined.samples,
        joined.commands,
        joined.outside
    );
    let from = match r.from {
        From::Given => "as given",
        From::Clocks => "from records of one clock in both logs",
        From::Estimated => "from the motion's answer to the commands",
    };
    outln!(
        "  offset {:.6} s (sd {:.6} s) at the first command, drift {:.2} ppm (sd {:.2} ppm), {from}",
        r.offset_s,
        r.offset_sd_s,
        r.drift_ppm,
        r.drift_sd_ppm
    );
    if joined.left_out > 0 {
        outln!(
            "  left out: {} other records of the two logs (frames, events, clocks, ..)",
            joined.left_out
        );
    }
    Ok(Outcome::Done)
}
