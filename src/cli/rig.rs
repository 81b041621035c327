//! `hydroline rig`: a commented rig for one's own vehicle, and what is built in.

use super::output::Output;
use super::print::{errln, out, outln};
use super::{CliError, Outcome, inputs};
use clap::Subcommand;
use hydroline_rigs::{Plan, Rig};
use std::path::PathBuf;

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Writes a complete, commented rig file to fill in
    #[command(after_help = "\
Examples:
  hydroline rig new --out my.toml

Exit codes: 0 done; 2 the file exists, or its folder takes none.")]
    New {
        /// File to write
        #[arg(long, value_name = "RIG.toml")]
        out: PathBuf,
        #[command(flatten)]
        output: Output,
    },
    /// Checks a rig file and prints it as the daemon reads it, defaults written out
    #[command(after_help = "\
Examples:
  hydroline rig show my.toml
  hydroline rig show lshpi --json

Exit codes: 0 the rig is sound; 2 it is not, or there is none: every mistake with file, line and key.")]
    Show {
        /// Rig file or built-in name
        #[arg(value_name = "RIG")]
        rig: String,
        /// Prints one JSON object instead of TOML
        #[arg(long)]
        json: bool,
    },
    /// Names of the built-in rigs and plans
    #[command(after_help = "\
Examples:
  hydroline rig list")]
    List,
    /// Every [[physics]] effect: law, parameters with their plausible range, what it is mistaken for (Markdown)
    #[command(after_help = "\
Examples:
  hydroline rig effects > effects.md")]
    Effects,
}

pub fn run(command: &Command) -> Result<Outcome, CliError> {
    match command {
        Command::New { out, output } => {
            output.file("--out", out)?;
            output.write(out, Rig::template())?;
            outln!("{}", out.display());
            errln!(
                "edit it, then: hydroline rig show {0}; hydroline check --rig {0}",
                out.display()
            );
        }
        Command::Show { rig, json: false } => out!("{}", inputs::rig(rig)?.effective_toml),
        Command::Show { rig, json: true } => {
            let text = inputs::rig(rig)?.effective_toml;
            let table: toml::Table = toml::from_str(&text).map_err(CliError::config)?;
            outln!("{}", serde_json::json!(table));
        }
        Command::Effects => out!("{}", hydroline_sim::effect::markdown_table()),
        Command::List => {
            for name in Rig::builtin_names() {
                outln!("rig  {name}");
            }
            for name in Plan::builtin_names() {
                outln!("plan {name}");
            }
        }
    }
    Ok(Outcome::Done)
}
