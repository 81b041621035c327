//! `hydroline import`: a table recorded by something else becomes a log.

use std::path::PathBuf;

use super::print::{errln, outln};
use super::{CliError, Outcome, inputs};
use hydroline_core::build_info::BuildInfo;
use hydroline_import::{Map, Options, Severity, import, read_for};
use hydroline_rigs::bounded;

#[derive(Debug, clap::Args)]
#[command(after_help = "\
MAP.toml says which column is what; everything but [time] and one channel is optional:
  [file]            separator = \",\"   decimal = \".\"
  [time]            column = \"t\"  unit = \"s\" (ms us ns iso8601)  clock = \"relative\" (unix)
                    from_s, to_s: only these rows; compare_column, compare_unit: a second clock
  [motion.phi_rad]  column = \"roll\"  unit = \"deg\"  sign = -1  offset = 0.0  sd = 0.001
  [[command]]       thruster = \"surge\"  column = \"u\"  scale = 35.15  between = \"hold\" (linear)

Examples:
  hydroline import mocap.csv --map mocap.toml --out run.mcap
  hydroline import mocap.csv --map mocap.toml --rig my.toml --out run.mcap --accept-faults

Exit codes: 0 done; 1 the log could not be written; 2 bad arguments or map, or a table with faults (nothing is \
written); 3 done, but what --accept-faults left out is lost.")]
pub struct Args {
    /// Table to import (CSV or text)
    #[arg(value_name = "DATA.csv")]
    data: PathBuf,
    /// What its columns are
    #[arg(long, value_name = "MAP.toml")]
    map: PathBuf,
    /// Log to write
    #[arg(long, value_name = "LOG.mcap")]
    out: PathBuf,
    /// Imports what is sound although there are faults; what is left out is counted (exit code 3)
    #[arg(long)]
    accept_faults: bool,
    /// Rig file or built-in name: names and sizes of the commands are held against it
    #[arg(long, value_name = "RIG")]
    rig: Option<String>,
    /// Prints the findings as one JSON object
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args, build: BuildInfo) -> Result<Outcome, CliError> {
    let map = Map::load(&args.map)?;
    let map_text = inputs::text(&args.map, "check the path")?;
    inputs::new_file("--out", &args.out)?;
    let bytes = bounded::read_table(&args.data)
        .map_err(|e| CliError::reading(&args.data, &e, "name a table (CSV)"))?;
    let text = String::from_utf8(bytes).map_err(|e| {
        CliError::Config(format!(
            "{}: byte {} is not UTF-8; export the table as UTF-8 text",
            args.data.display(),
            e.utf8_error().valid_up_to()
        ))
    })?;
    let rig = args.rig.as_deref().map(inputs::rig).transpose()?;
    let data = read_for(&text, &map, rig.as_ref());
    for f in &data.findings {
        let word = match f.severity {
            Severity::Info => "info",
            Severity::Warning => "WARNING",
            Severity::Fault => "FAULT",
        };
        errln!("{word} {}: {}", f.kind, f.message);
    }
    let options = Options {
        accept_faults: args.accept_faults,
        build,
    };
    let result = import(&data, &map, &map_text, &args.out, options);
    if args.json {
        let findings = serde_json::json!({
            "written": result.is_ok(),
            "samples": result.as_ref().ok().map(|o| o.samples),
            "commands": result.as_ref().ok().map(|o| o.commands),
            "lost": result.as_ref().ok().map(|o| o.lost),
            "findings": data.findings,
        });
        outln!("{findings}");
    }
    let outcome = result.map_err(|e| CliError::from(e).about(&args.data))?;
    if !args.json {
        outln!(
            "{}: {} motion samples, {} commands",
            args.out.display(),
            outcome.samples,
            outcome.commands
        );
        let lost = outcome.lost;
        if lost.total() > 0 {
            outln!(
                "  left out: {} rows, {} cells of motion, {} cells of commands",
                lost.rows,
                lost.motion_cells,
                lost.command_cells
            );
        }
    }
    Ok(if data.has_faults() || outcome.lost.total() > 0 {
        Outcome::Lossy
    } else {
        Outcome::Done
    })
}
