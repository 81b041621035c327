//! `hydroline rig new`: a commented rig for one's own vehicle.

use super::print::{out, outln};
use super::{CliError, Outcome, inputs};
use clap::Subcommand;
use hydroline_rigs::{Plan, Rig};
use std::path::PathBuf;

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Writes a complete, commented rig file to fill in
    New {
        /// File to write
        #[arg(long, value_name = "RIG.toml")]
        out: PathBuf,
    },
    /// Checks a rig file and prints it as the daemon reads it, defaults written out
    Show {
        /// File or built-in name
        rig: String,
        /// Prints one JSON object instead of TOML
        #[arg(long)]
        json: bool,
    },
    /// Names of the built-in rigs and plans
    List,
    /// Every `[[physics]]` effect: law, parameters with their plausible range, what it is mistaken for (Markdown)
    Effects,
}

pub fn run(command: &Command) -> Result<Outcome, CliError> {
    match command {
        Command::New { out } => {
            inputs::new_file("--out", out)?;
            std::fs::write(out, Rig::template()).map_err(|e| {
                CliError::Run(format!(
                    "{}: {e}; check that the folder is writable",
                    out.display()
                ))
            })?;
            outln!("{}", out.display());
            eprintln!(
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
