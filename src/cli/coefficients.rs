//! `hydroline coefficients`: coefficients as a paper prints them.

use super::print::{self, errln, out};
use super::system::System;
use super::{CliError, Outcome, inputs};
use clap::ValueEnum;
use hydroline_coefficients::froude::Scale;
use hydroline_coefficients::table::{Asked, Table};
use hydroline_coefficients::{Fitted, Particulars, Prime};
use hydroline_rigs::{Rig, bounded::is_stdin};
use std::path::{Path, PathBuf};

/// Form of the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Format {
    /// Columns to read
    Table,
    /// Every digit, for another program
    Csv,
    /// booktabs, for a paper
    Latex,
    /// One JSON object, as --json
    Json,
}

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Coefficients of a rig (with the uncertainty in its [identified]), or of a result: dimensional, in a prime system (SNAME I and II, \
bis), at another size by Froude's law, each with its 95 % interval. Of a result of identify --json it says, too, Re, Fn and KC of each \
run and the ranges of speed, amplitude and frequency in which each coefficient was seen; what the file does not hold is said on stderr.

Examples:
  hydroline coefficients fitted.toml
  hydroline coefficients fitted.toml --length 0.46 --prime bis --format latex > table.tex
  hydroline coefficients result.json --length 1.6 --speed 1.5 --prime I --rho 1025 --format csv
  hydroline coefficients result.json --rig my.toml --length 0.46 --prime bis --scale 7.5

Exit codes: 0 done; 2 there is no such file, it holds no coefficients, or the system needs a number that is not given.")]
pub struct Args {
    /// Rig (.toml, or a built-in name), or what identify --json or diagnose --json printed
    #[arg(value_name = "FITTED")]
    fitted: String,
    /// With a result and --length: the rig it is of, for the vehicle's mass and gravity
    #[arg(long, value_name = "RIG", requires = "length")]
    rig: Option<String>,
    /// Prime system
    #[arg(long, value_enum, value_name = "SYSTEM", ignore_case = true)]
    prime: Option<System>,
    /// Reference length L [m]
    #[arg(long, value_name = "M", value_parser = inputs::positive)]
    length: Option<f64>,
    /// Reference speed U [m/s], of I and II
    #[arg(long, value_name = "M/S", value_parser = inputs::positive, requires = "length")]
    speed: Option<f64>,
    /// Draught T [m], of II; of a body under water its height
    #[arg(long, value_name = "M", value_parser = inputs::positive, requires = "length")]
    draught: Option<f64>,
    /// Mass of the vehicle [kg], of bis; without it the rig's
    #[arg(long, value_name = "KG", value_parser = inputs::positive, requires = "length")]
    mass: Option<f64>,
    /// Density of the water [kg/m3]
    #[arg(long, value_name = "KG/M3", value_parser = inputs::positive, default_value = "1000")]
    rho: f64,
    /// Kinematic viscosity of the water [m2/s]; default: fresh water at 20 °C
    #[arg(long, value_name = "M2/S", value_parser = inputs::positive, requires = "length")]
    viscosity: Option<f64>,
    /// Gravitational acceleration [m/s2]; without it the rig's, else 9.81
    #[arg(long, value_name = "M/S2", value_parser = inputs::positive, requires = "length")]
    gravity: Option<f64>,
    /// Another size: its length over that of this vehicle, as 7.5
    #[arg(long, value_name = "S", value_parser = inputs::positive)]
    scale: Option<f64>,
    /// Density of the water at that size [kg/m3]; default: the same
    #[arg(long, value_name = "KG/M3", value_parser = inputs::positive, requires = "scale")]
    scaled_rho: Option<f64>,
    /// Form of the table
    #[arg(long, value_enum, value_name = "FORMAT", default_value = "table")]
    format: Format,
    /// Prints one JSON object
    #[arg(long, conflicts_with = "format")]
    json: bool,
}

pub fn run(args: &Args) -> Result<Outcome, CliError> {
    let rig = args.rig.as_deref().map(inputs::rig).transpose()?;
    let fitted = fitted(&args.fitted)?;
    let of_rig = rig.as_ref().map(|r| &r.vehicle);
    let mass_kg = args.mass.or(of_rig.map(|v| v.mass_kg));
    let gravity = args.gravity.or(of_rig.map(|v| v.gravity_mps2));
    let hull = args.length.map(|length_m| {
        let standard = Particulars::of_length(length_m);
        Particulars {
            speed_mps: args.speed,
            draught_m: args.draught,
            density_kgpm3: args.rho,
            mass_kg,
            gravity_mps2: gravity
                .or(fitted.gravity_mps2)
                .unwrap_or(standard.gravity_mps2),
            ..standard
        }
    });
    let asked = Asked {
        prime: args.prime.map(Prime::from),
        hull,
        scale: args.scale.map(|factor| Scale {
            factor,
            density_ratio: args.scaled_rho.map_or(1.0, |rho| rho / args.rho),
        }),
        density_kgpm3: Some(args.rho),
        viscosity_m2ps: args.viscosity,
    };
    let table = Table::new(&fitted, &asked)?;
    for words in &table.missing {
        errln!("note: {words}");
    }
    match args.format {
        _ if args.json => print::json(&table)?,
        Format::Json => print::json(&table)?,
        Format::Table => out!("{}", table.text()),
        Format::Latex => out!("{}", table.latex()),
        Format::Csv => out!("{}", table.csv().map_err(CliError::run)?),
    }
    Ok(Outcome::Done)
}

/// Coefficients of a rig or a result; JSON begins with a brace.
pub(super) fn fitted(argument: &str) -> Result<Fitted, CliError> {
    let path = PathBuf::from(argument);
    let is_file = path.is_file() || is_stdin(&path) || argument.ends_with(".json");
    if is_file && !argument.ends_with(".toml") {
        let text = inputs::text(&path, "give a rig, or the output of identify --json")?;
        if text.trim_start().starts_with('{') {
            return Ok(Fitted::from_json(&text, argument)?);
        }
        let folder = path.parent().unwrap_or(Path::new(""));
        return Ok(Fitted::of_rig(&Rig::from_toml(
            &text,
            argument,
            Some(folder),
        )?)?);
    }
    Ok(Fitted::of_rig(&inputs::rig(argument)?)?)
}
