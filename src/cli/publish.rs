//! `hydroline publish`: runs as a data set that another group can use.

use super::coefficients::fitted;
use super::many::{self, Many};
use super::output::Output;
use super::print::{self, errln, outln};
use super::{CliError, Outcome, inputs, logs};
use hydroline_campaign::publish::{About, File, Published, files};
use hydroline_coefficients::table::{Asked, Table};
use hydroline_core::build_info::BuildInfo;
use hydroline_rigs::Rig;
use schemars::JsonSchema;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
#[command(after_help = "\
--out gets README.md (the data card: runs, frames and signs, vehicle, conditions, instruments, what is not known), runs.csv (one row per \
run: water, distances to walls, floor and surface, waiting time, speeds, amplitudes, frequencies, loads), runs/NAME.csv (one row per \
measurement, SI), columns.csv (unit and meaning of each column), rig.toml and SHA256SUMS. Frames stay in the logs.

Examples:
  hydroline publish logs --out data-set --title \"Surge and yaw\" --licence CC-BY-4.0
  hydroline publish a.mcap b.mcap --rig my.toml --result identified.json --out data-set

Exit codes: 0 done; 1 the files could not be written; 2 no such log, no motion in it, logs of different rigs, or the folder holds such \
files already; 3 done, but some of the logs could not be used.")]
pub struct Args {
    /// Logs to publish, or folders of them
    #[arg(required = true, value_name = "LOG|FOLDER")]
    logs: Vec<PathBuf>,
    /// Folder to write to, made if need be
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Rig file or built-in name of the vehicle; default: the one that the logs carry
    #[arg(long, value_name = "RIG")]
    rig: Option<String>,
    /// Title of the data set; default: the rig's name
    #[arg(long, value_name = "TEXT")]
    title: Option<String>,
    /// Who made the runs
    #[arg(long, value_name = "TEXT")]
    authors: Option<String>,
    /// Licence of the data, as CC-BY-4.0
    #[arg(long, value_name = "TEXT")]
    licence: Option<String>,
    /// Paper or report that they belong to, as a DOI
    #[arg(long, value_name = "TEXT")]
    reference: Option<String>,
    /// Adds coefficients.csv: of what identify --json or diagnose --json printed, or of a rig
    #[arg(long, value_name = "RESULT.json|RIG")]
    result: Option<String>,
    /// Prints one JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    output: Output,
}

/// Output of `--json`.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct Printed<'a> {
    /// Folder of the data set.
    out: &'a Path,
    /// Files in it, by their paths there.
    files: Vec<&'a str>,
    /// Rows by run.
    rows: BTreeMap<&'a str, usize>,
}

pub fn run(args: &Args, build: BuildInfo) -> Result<Outcome, CliError> {
    let many = Many::of(&args.logs, many::LOG)?;
    let names = names(&many)?;
    let tables: Vec<String> = names.values().map(|n| format!("runs/{n}.csv")).collect();
    let mut places = vec![
        "README.md",
        "runs.csv",
        "columns.csv",
        "rig.toml",
        "SHA256SUMS",
    ];
    places.extend(args.result.as_ref().map(|_| "coefficients.csv"));
    places.extend(tables.iter().map(String::as_str));
    args.output.folder("--out", &args.out, &places)?;
    let more = args.result.as_deref().map(coefficients).transpose()?;
    let rig = logs::rig(args.rig.as_deref(), many.logs.iter().map(PathBuf::as_path))?;
    let mut runs = Vec::new();
    let outcome = many.each(
        rayon::current_num_threads(),
        |log| read(log, &names, &rig),
        |_, run| {
            runs.push(run);
            Ok(Outcome::Done)
        },
        |_, _| Ok(()),
    )?;
    let about = About {
        title: args
            .title
            .clone()
            .unwrap_or_else(|| format!("Runs of {}", rig.name)),
        authors: args.authors.clone(),
        licence: args.licence.clone(),
        reference: args.reference.clone(),
        made_by: format!("hydroline {build}"),
    };
    let made = files(&runs, &rig, &about, more.into_iter().collect()).map_err(CliError::run)?;
    write(args, &made)?;
    let card = args.out.join("README.md");
    if args.json {
        print::json(&Printed {
            out: &args.out,
            files: made.iter().map(|f| f.0.as_str()).collect(),
            rows: runs.iter().map(|r| (r.name.as_str(), r.rows)).collect(),
        })?;
    } else {
        outln!("{}", card.display());
    }
    errln!(
        "the end of {} says what is not known: look at it before you give the folder away",
        card.display()
    );
    Ok(outcome)
}

/// Name of each log's run: its path in the folder that was named, without separators.
fn names(many: &Many) -> Result<BTreeMap<PathBuf, String>, CliError> {
    for (k, log) in many.logs.iter().enumerate() {
        if many.logs.iter().take(k).any(|before| before == log) {
            return Err(CliError::Config(format!(
                "{} is named twice: name each log once",
                log.display()
            )));
        }
    }
    let results = many.results(Path::new(""), |name| name.with_extension(""))?;
    let mut taken: BTreeMap<String, PathBuf> = BTreeMap::new();
    for (log, result) in results {
        let plain = |c: char| c.is_alphanumeric() || matches!(c, '-' | '_' | '.');
        let name = result.display().to_string();
        let name: String = name
            .chars()
            .map(|c| if plain(c) { c } else { '_' })
            .collect();
        if let Some(other) = taken.insert(name.clone(), log.clone()) {
            return Err(CliError::Config(format!(
                "{} and {} would both become the run {name}: rename one",
                other.display(),
                log.display()
            )));
        }
    }
    Ok(taken.into_iter().map(|(name, log)| (log, name)).collect())
}

fn read(log: &Path, names: &BTreeMap<PathBuf, String>, rig: &Rig) -> Result<Published, CliError> {
    inputs::readable_file(log, "name a log (.mcap) that can be read")?;
    let name = names.get(log).map_or("run", String::as_str);
    Ok(Published::read(name, log, rig)?)
}

/// The coefficients of a result as a table, every digit.
fn coefficients(result: &str) -> Result<File, CliError> {
    let table = Table::new(&fitted(result)?, &Asked::default())?;
    let text = table.csv().map_err(CliError::run)?;
    Ok(("coefficients.csv".to_owned(), text.into_bytes()))
}

fn write(args: &Args, made: &[File]) -> Result<(), CliError> {
    let folder = args.out.join("runs");
    std::fs::create_dir_all(&folder).map_err(|e| CliError::writing(&folder, &e))?;
    for (name, bytes) in made {
        args.output.write(&args.out.join(name), bytes)?;
    }
    Ok(())
}
