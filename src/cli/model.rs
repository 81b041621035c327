//! `hydroline model`: a rig's model for another program, and draws from what is known of it.

use super::coefficients::fitted;
use super::output::Output;
use super::print::{self, errln, outln};
use super::{CliError, Outcome, inputs};
use clap::ValueEnum;
use hydroline_coefficients::Particulars;
use hydroline_coefficients::regime::{Range, VISCOSITY_M2PS, ranges, regime};
use hydroline_core::build_info::BuildInfo;
use hydroline_exchange::draws::{self, Draws, Weighted};
use hydroline_exchange::npz::npz;
use hydroline_exchange::target::{About, Summary, Target, export};
use hydroline_report::significant;
use hydroline_rigs::{Rig, bounded};
use schemars::JsonSchema;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Most draws: a table of a hundred megabytes.
const MOST_DRAWS: u32 = 1_000_000;

/// A language or a simulator.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum To {
    /// FMI 3.0 co-simulation: hydroline's own simulator in a library, nothing is lost
    Fmu,
    /// Gazebo, Garden and later: added mass, hydrodynamics and thruster plugins
    Sdf,
    /// URDF with UUV Simulator's plugins: added mass, damping, thrusters with curve and lag
    Urdf,
    /// A function of MATLAB and Octave, in the form of the MSS toolbox
    Mss,
    /// A Python module without dependencies: f(t, state, thrust)
    Python,
    /// A Python module that builds CasADi functions
    Casadi,
}

impl From<To> for Target {
    fn from(to: To) -> Target {
        match to {
            To::Fmu => Target::Fmu,
            To::Sdf => Target::Sdf,
            To::Urdf => Target::Urdf,
            To::Mss => Target::Mss,
            To::Python => Target::Python,
            To::Casadi => Target::Casadi,
        }
    }
}

#[derive(Debug, clap::Args)]
#[command(after_help = "\
--to writes the rig's equations with its effects, thrust curves and ranges of validity. What the target cannot hold is listed in the \
file and on stderr, with the difference it makes in mm over three plans.
--draws writes draws from the joint uncertainty: of the rig's [identified], or of --from (identify --json: coefficients; diagnose \
--json: coefficients and effects of all models, each drawn by its probability). hydroline simulate --draw N runs one of them.

Examples:
  hydroline model my.toml --to python --out model.py
  hydroline model my.toml --to sdf --out model.sdf --seen result.json
  hydroline model my.toml --to fmu --out my.fmu
  hydroline model fitted.toml --draws 1000 --out draws.npz
  hydroline model my.toml --from diagnose.json --draws 1000 --out draws.csv

Exit codes: 0 done; 1 the file cannot be written; 2 bad arguments or rig, no uncertainty to draw from, no library for an FMU.")]
pub struct Args {
    /// Rig file or built-in name
    #[arg(value_name = "RIG")]
    rig: String,
    /// Program or language to write for
    #[arg(
        long,
        value_enum,
        value_name = "TARGET",
        required_unless_present = "draws",
        conflicts_with = "draws"
    )]
    to: Option<To>,
    /// Number of draws (1 to 1000000)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=i64::from(MOST_DRAWS)))]
    draws: Option<u32>,
    /// With --draws: what identify --json or diagnose --json printed, in place of the rig's [identified]
    #[arg(long, value_name = "RESULT.json", requires = "draws")]
    from: Option<PathBuf>,
    /// With --draws: seed; the same seed gives the same draws, however many
    #[arg(
        long,
        value_name = "N",
        default_value_t = 1,
        allow_negative_numbers = true
    )]
    seed: u64,
    /// With --to: what identify --json printed of the runs: speeds, amplitudes and frequencies of the ranges of validity
    #[arg(long, value_name = "RESULT.json", conflicts_with = "draws")]
    seen: Option<PathBuf>,
    /// File to write; draws as .npz, .csv or .json by its ending
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Prints one JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    output: Output,
}

/// Output of `--json`.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct Printed<'a> {
    /// File that was written.
    file: &'a Path,
    /// With --to: what it holds and what not.
    #[serde(skip_serializing_if = "Option::is_none")]
    model: Option<Summary<'a>>,
    /// With --draws: names of the columns.
    #[serde(skip_serializing_if = "Option::is_none")]
    columns: Option<&'a [String]>,
    /// With --draws: number of rows.
    #[serde(skip_serializing_if = "Option::is_none")]
    rows: Option<usize>,
}

pub fn run(args: &Args, build: BuildInfo) -> Result<Outcome, CliError> {
    let rig = inputs::rig(&args.rig)?;
    args.output.file("--out", &args.out)?;
    match args.to {
        Some(to) => write(args, &rig, to.into(), build),
        None => draw(args, &rig),
    }
}

fn write(args: &Args, rig: &Rig, target: Target, build: BuildInfo) -> Result<Outcome, CliError> {
    let ranges = match &args.seen {
        Some(path) => seen(path)?,
        None => Vec::new(),
    };
    let library = match target {
        Target::Fmu => library()?,
        _ => None,
    };
    let function = function(&args.out)?;
    let about = About {
        made_by: &format!("hydroline {build}"),
        ranges: &ranges,
        function: if target == Target::Mss { &function } else { "" },
        library: library.as_deref(),
    };
    if target == Target::Mss && function.is_empty() {
        return Err(CliError::Config(format!(
            "--out {}: MATLAB calls the function by the file's name: letters, digits and _, a letter first, as {}.m",
            args.out.display(),
            "my_vehicle"
        )));
    }
    let made = export(rig, target, &about)?;
    args.output.write(&args.out, &made.bytes)?;
    for lost in &made.lost {
        errln!("lost in export: {}: {}", lost.what, lost.why);
    }
    for d in &made.differences {
        errln!(
            "over the plan {} that is up to {} mm and {} deg",
            d.plan,
            significant(d.position_mm),
            significant(d.attitude_deg)
        );
    }
    for words in &made.changed {
        errln!("changed: {words}");
    }
    if args.json {
        print::json(&Printed {
            file: &args.out,
            model: Some(Summary {
                held: &made.held,
                lost: &made.lost,
                differences: &made.differences,
                changed: &made.changed,
            }),
            columns: None,
            rows: None,
        })?;
    } else {
        outln!("{}", args.out.display());
    }
    Ok(Outcome::Done)
}

/// The name of a file as MATLAB's name of a function; empty where it is none.
fn function(path: &Path) -> Result<String, CliError> {
    let stem = path
        .file_stem()
        .and_then(|s| s.to_str())
        .unwrap_or_default();
    let is_name = stem.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
    let is_led = stem.starts_with(|c: char| c.is_ascii_alphabetic());
    Ok(if is_name && is_led {
        stem.to_owned()
    } else {
        String::new()
    })
}

/// Ranges of the runs of a result.
fn seen(path: &Path) -> Result<Vec<Range>, CliError> {
    let result = fitted(&path.display().to_string())?;
    if result.runs.is_empty() {
        errln!("note: {}: {}", path.display(), result.missing.join("; "));
    }
    // Speeds, amplitudes and frequencies are the same for any length.
    let hull = Particulars::of_length(1.0);
    let each = result.runs.iter().flat_map(|(run, seen)| {
        seen.iter()
            .map(move |(dof, seen)| regime(run, *dof, seen, &hull, VISCOSITY_M2PS))
    });
    Ok(ranges(&each.collect::<Vec<_>>()))
}

/// The library of an FMU: named by the environment, else beside the program, else where the package lays it.
fn library() -> Result<Option<Vec<u8>>, CliError> {
    let name = format!(
        "{}{}{}",
        std::env::consts::DLL_PREFIX,
        hydroline_exchange::target::FMU_LIBRARY,
        std::env::consts::DLL_SUFFIX
    );
    let named = std::env::var_os("HYDROLINE_FMU_LIBRARY").map(PathBuf::from);
    let program = std::env::current_exe().ok();
    let folder = program.as_deref().and_then(Path::parent);
    let beside = folder.map(|f| f.join(&name));
    let installed = folder.map(|f| f.join("../lib/hydroline").join(&name));
    let is_named = named.is_some();
    let places = named.into_iter().chain(beside).chain(installed);
    let Some(path) = places.into_iter().find(|p| is_named || p.is_file()) else {
        return Ok(None);
    };
    bounded::read_bytes(&path, bounded::RESULT_BYTES)
        .map(Some)
        .map_err(|e| CliError::reading(&path, &e, "name the library in HYDROLINE_FMU_LIBRARY"))
}

/// Models that draws come from: of a result, else of the rig.
pub(super) fn models(rig: &Rig, from: Option<&Path>) -> Result<Vec<Weighted>, CliError> {
    match from {
        Some(path) => {
            let text = inputs::text(
                path,
                "give the output of identify --json or diagnose --json",
            )?;
            Ok(draws::of_json(&text, &path.display().to_string())?)
        }
        None => {
            let source = rig.identified.as_ref().and_then(|k| k.source.as_ref());
            if let Some(source) = source {
                errln!("note: the draws are of no run of this vehicle: {source}");
            }
            Ok(draws::of_rig(rig)?)
        }
    }
}

fn draw(args: &Args, rig: &Rig) -> Result<Outcome, CliError> {
    let count = args.draws.unwrap_or(1) as usize;
    let ending = args
        .out
        .extension()
        .and_then(|e| e.to_str())
        .unwrap_or_default();
    let models = models(rig, args.from.as_deref())?;
    let drawn = draws::drawn(&models, count, args.seed);
    let table = draws::table(&models, &drawn);
    let bytes = match ending {
        "npz" => npz(&table).map_err(CliError::config)?,
        "csv" => csv(&table).into_bytes(),
        "json" => serde_json::to_string(&json(&table))?.into_bytes(),
        _ => {
            return Err(CliError::Config(format!(
                "--out {}: draws go into a file that ends in .npz, .csv or .json",
                args.out.display()
            )));
        }
    };
    let refused = draws::refused(rig, &models, &drawn);
    args.output.write(&args.out, bytes)?;
    if refused > 0 {
        errln!(
            "note: {refused} of {count} draws are of no rig (damping that drives, a number beyond its limits): the uncertainty is as large as the numbers; hydroline simulate --draw refuses them"
        );
    }
    if args.json {
        print::json(&Printed {
            file: &args.out,
            model: None,
            columns: Some(&table.names),
            rows: Some(table.rows.len()),
        })?;
    } else {
        outln!("{}", args.out.display());
    }
    Ok(Outcome::Done)
}

/// One row per draw; empty where the draw's model has no such number.
fn csv(table: &Draws) -> String {
    let mut text = format!("model,{}\n", table.names.join(","));
    for (model, row) in table.models.iter().zip(&table.rows) {
        let cells = row.iter().map(|v| {
            if v.is_nan() {
                String::new()
            } else {
                v.to_string()
            }
        });
        text += &format!("{model},{}\n", cells.collect::<Vec<_>>().join(","));
    }
    text
}

fn json(table: &Draws) -> serde_json::Value {
    serde_json::json!({ "names": table.names, "models": table.models, "values": table.rows })
}
