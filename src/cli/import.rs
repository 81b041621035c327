//! `hydroline import`: a table recorded by something else becomes a log.

use std::path::PathBuf;

use super::print::outln;
use super::{CliError, Outcome, inputs};
use hydroline_import::{Map, Severity, import, read_for};

#[derive(Debug, clap::Args)]
#[command(after_help = "\
MAP.toml says which column is what; everything but [time] and one channel is optional:
  [file]            separator = \",\"   decimal = \".\"
  [time]            column = \"t\"  unit = \"s\" (ms us ns iso8601)  clock = \"relative\" (unix)
                    from_s, to_s: only these rows; compare_column, compare_unit: a second clock
  [motion.phi_rad]  column = \"roll\"  unit = \"deg\"  sign = -1  offset = 0.0  sd = 0.001
  [[command]]       thruster = \"surge\"  column = \"u\"  scale = 35.15  between = \"hold\" (linear)")]
pub struct Args {
    /// Table
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

pub fn run(args: &Args) -> Result<Outcome, CliError> {
    let map = Map::load(&args.map).map_err(CliError::config)?;
    let map_text = std::fs::read_to_string(&args.map)
        .map_err(|e| CliError::Config(format!("{}: {e}", args.map.display())))?;
    inputs::new_file("--out", &args.out)?;
    let bytes = std::fs::read(&args.data)
        .map_err(|e| CliError::Config(format!("{}: {e}; check the path", args.data.display())))?;
    let text = String::from_utf8(bytes).map_err(|e| {
        CliError::Run(format!(
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
        eprintln!("{word} {}: {}", f.kind, f.message);
    }
    let result = import(&data, &map, &map_text, &args.out, args.accept_faults);
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
    let outcome = result.map_err(CliError::run)?;
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
