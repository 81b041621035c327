//! `hydroline rig`: a commented rig for one's own vehicle, and what is built in.

pub(super) mod change;

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
    /// Puts values into a rig file, its comments kept; values may have a unit
    #[command(after_help = "\
A value may have a unit, which is turned into that of the key and said: \"11500 g\", \"2 kn\", \"30 lbf\". A key's own unit may be left out: \
vehicle.mass is vehicle.mass_kg. Entries of lists are counted from 0.

Examples:
  hydroline rig set my.toml vehicle.mass=\"11500 g\" vehicle.surge.added_kg=-5.5 --out new.toml
  hydroline rig set bluerov2 tank.depth=\"12 ft\" --out my.toml

Exit codes: 0 done; 1 the file cannot be written; 2 no such key, a value that is none or beyond its range, or the file exists.")]
    Set(change::SetArgs),
    /// Coefficients from MSS, Gazebo, UUV Simulator or a table into a rig
    #[command(after_help = "\
Takes mass, inertia, added mass and damping of each degree of freedom; derivatives that Eq. 1 has no place for are named.

Examples:
  hydroline rig import model.sdf --rig my.toml --out new.toml
  hydroline rig import npsauv.m --rig my.toml --prime I --length 5.3 --speed 1.5 --out new.toml
  hydroline rig import table.csv --rig my.toml --positive --out new.toml

Exit codes: 0 done; 1 the file cannot be written; 2 the file holds no coefficients, or they are of no rig.")]
    Import(change::ImportArgs),
    /// Keys in which two rigs differ
    #[command(after_help = "\
Examples:
  hydroline rig diff my.toml fitted.toml
  hydroline rig diff bluerov2 my.toml --json")]
    Diff(change::DiffArgs),
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
        Command::Show { rig, json } => {
            let rig = inputs::rig(rig)?;
            inputs::warn_of_implausible(&rig);
            if *json {
                let table: toml::Table =
                    toml::from_str(&rig.effective_toml).map_err(CliError::config)?;
                outln!("{}", serde_json::json!(table));
            } else {
                out!("{}", rig.effective_toml);
            }
        }
        Command::Set(args) => return change::set(args),
        Command::Import(args) => return change::import(args),
        Command::Diff(args) => return change::diff(args),
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
