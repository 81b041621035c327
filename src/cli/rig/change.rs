//! `hydroline rig set`, `rig import`, `rig diff`: values into a rig's text, coefficients of other programs' files, two rigs compared.

use std::path::{Path, PathBuf};

use hydroline_coefficients::{Particulars, Prime};
use hydroline_exchange::edit::{self, Difference};
use hydroline_exchange::foreign;
use hydroline_report::significant;
use hydroline_rigs::Rig;
use schemars::JsonSchema;
use serde::Serialize;

use crate::output::Output;
use crate::print::{self, errln, outln};
use crate::system::System;
use crate::{CliError, Outcome, inputs};

/// Keys and their new values.
#[derive(Debug, clap::Args)]
pub struct SetArgs {
    /// Rig file or built-in name
    #[arg(value_name = "RIG")]
    rig: String,
    /// Key and value, as vehicle.mass_kg=11.5, vehicle.mass="11500 g" or thruster[2].channel=4 (several)
    #[arg(required = true, value_name = "KEY=VALUE")]
    changes: Vec<String>,
    /// Rig to write
    #[arg(long, value_name = "NEW.toml")]
    out: PathBuf,
    #[command(flatten)]
    output: Output,
}

/// A file of another program, and the rig that its numbers go into.
#[derive(Debug, clap::Args)]
pub struct ImportArgs {
    /// MSS vessel (.m), model of Gazebo or UUV Simulator (.sdf, .urdf, .xacro), or table coefficient,value[,unit] (.csv)
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Rig file or built-in name that gets the numbers; what the file does not say stays
    #[arg(long, value_name = "RIG")]
    rig: String,
    /// The file's numbers are in this prime system
    #[arg(
        long,
        value_enum,
        value_name = "SYSTEM",
        ignore_case = true,
        requires = "length"
    )]
    prime: Option<System>,
    /// With --prime: reference length L [m]
    #[arg(long, value_name = "M", value_parser = inputs::positive, requires = "prime")]
    length: Option<f64>,
    /// With --prime: reference speed U [m/s]
    #[arg(long, value_name = "M/S", value_parser = inputs::positive, requires = "prime")]
    speed: Option<f64>,
    /// With --prime: draught T [m], of II
    #[arg(long, value_name = "M", value_parser = inputs::positive, requires = "prime")]
    draught: Option<f64>,
    /// With --prime: density of the water [kg/m3]
    #[arg(long, value_name = "KG/M3", value_parser = inputs::positive, requires = "prime", default_value = "1000")]
    rho: f64,
    /// The file has damping and added mass as positive numbers
    #[arg(long)]
    positive: bool,
    /// Rig to write
    #[arg(long, value_name = "NEW.toml")]
    out: PathBuf,
    #[command(flatten)]
    output: Output,
}

/// Two rigs.
#[derive(Debug, clap::Args)]
pub struct DiffArgs {
    /// Rig file or built-in name
    #[arg(value_name = "A")]
    first: String,
    /// The other one
    #[arg(value_name = "B")]
    second: String,
    /// Prints one JSON object
    #[arg(long)]
    json: bool,
}

/// Output of `rig diff --json`.
#[derive(Debug, Serialize, JsonSchema)]
pub(crate) struct Compared<'a> {
    /// Name of the first rig.
    first: &'a str,
    /// Name of the second rig.
    second: &'a str,
    /// Keys that differ, in the order of the first rig.
    differences: Vec<Difference>,
}

/// The text of a rig: of a file as it is, of a built-in one with all defaults.
fn text(argument: &str) -> Result<String, CliError> {
    let rig = inputs::rig(argument)?;
    let path = Path::new(argument);
    if path.is_file() {
        inputs::text(path, "name a rig file")
    } else {
        Ok(rig.effective_toml)
    }
}

/// Puts changes into a rig's text, checks what comes out, and writes it.
fn write(argument: &str, changes: &[String], out: &Path, output: Output) -> Result<(), CliError> {
    output.file("--out", out)?;
    let mut text = text(argument)?;
    for typed in changes {
        let change = edit::change(typed)?;
        if let Some(said) = &change.said {
            errln!("{}: {said}", change.path());
        }
        text = edit::put(&text, &change)?;
    }
    // Targets and boards that it names are beside the new file.
    let folder = out.parent().unwrap_or(Path::new(""));
    let rig = Rig::from_toml(&text, &out.display().to_string(), Some(folder))?;
    hydroline_sim::EffectStack::<f64>::build(&rig.physics)?;
    if let Some(known) = &rig.identified {
        let stale = known
            .coefficients
            .iter()
            .zip(&known.values)
            .any(|(key, value)| {
                hydroline_identify::parameter::Coefficient::find(key)
                    .is_some_and(|c| c.of_vehicle(&rig.vehicle) != *value)
            });
        if stale {
            errln!(
                "WARNING: [identified] belongs to coefficients that were changed: predict refuses the rig until that table is mended or taken out"
            );
        }
    }
    output.write(out, text)?;
    outln!("{}", out.display());
    Ok(())
}

/// Runs `rig set`.
pub fn set(args: &SetArgs) -> Result<Outcome, CliError> {
    write(&args.rig, &args.changes, &args.out, args.output)?;
    Ok(Outcome::Done)
}

/// Runs `rig import`.
pub fn import(args: &ImportArgs) -> Result<Outcome, CliError> {
    let rig = inputs::rig(&args.rig)?;
    let name = args.file.display().to_string();
    let text = inputs::text(
        &args.file,
        "name a file of MSS, Gazebo or UUV Simulator, or a table",
    )?;
    let mut found = foreign::read(&text, &name)?;
    if args.positive {
        found = found.turned();
    }
    if let (Some(system), Some(length_m)) = (args.prime, args.length) {
        let hull = Particulars {
            speed_mps: args.speed,
            draught_m: args.draught,
            density_kgpm3: args.rho,
            mass_kg: Some(rig.vehicle.mass_kg),
            gravity_mps2: rig.vehicle.gravity_mps2,
            length_m,
        };
        found = found.dimensional(&Prime::from(system).units(&hull)?);
    }
    for words in &found.left {
        errln!("left: {words}");
    }
    let changes = found.changes(&name, rig.vehicle.inertia_kgm2)?;
    for change in &changes {
        errln!("{change}");
    }
    write(&args.rig, &changes, &args.out, args.output)?;
    Ok(Outcome::Done)
}

/// Runs `rig diff`.
pub fn diff(args: &DiffArgs) -> Result<Outcome, CliError> {
    let (first, second) = (inputs::rig(&args.first)?, inputs::rig(&args.second)?);
    let differences = edit::differences(&first, &second);
    if args.json {
        print::json(&Compared {
            first: &first.name,
            second: &second.name,
            differences,
        })?;
        return Ok(Outcome::Done);
    }
    for d in &differences {
        let of = |v: &Option<String>| v.clone().unwrap_or_else(|| "-".to_owned());
        let ratio = d
            .ratio
            .map_or(String::new(), |r| format!("  (x {})", significant(r)));
        outln!("{}: {} | {}{ratio}", d.key, of(&d.first), of(&d.second));
    }
    if differences.is_empty() {
        errln!("no key differs");
    }
    Ok(Outcome::Done)
}
