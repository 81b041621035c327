//! `hydroline info | doctor | recover | export`: what is in a log, whether it is sound, mending, getting things out.

use super::print::{out, outln};
use super::{CliError, Outcome, inputs};
use hydroline_log::LogError;
use hydroline_log::export::ExportOptions;
use std::io::ErrorKind;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct InfoArgs {
    /// Log
    log: PathBuf,
    /// Prints one JSON object
    #[arg(long)]
    json: bool,
}

#[derive(Debug, clap::Args)]
#[command(after_help = "Exit code 0: sound; 3: data is lost or damaged, as the findings say.")]
pub struct DoctorArgs {
    /// Log
    log: PathBuf,
    /// Prints one JSON object
    #[arg(long)]
    json: bool,
}

#[derive(Debug, clap::Args)]
#[command(
    after_help = "Exit code 0: everything is in the new file; 3: something that was in the original is not."
)]
pub struct RecoverArgs {
    /// Cut or damaged log; it is only read
    log: PathBuf,
    /// New file
    #[arg(long, value_name = "NEW.mcap")]
    out: PathBuf,
    /// Prints one JSON object
    #[arg(long)]
    json: bool,
}

#[derive(Debug, clap::Args)]
pub struct ExportArgs {
    /// Log
    log: PathBuf,
    /// Folder to write to, made if need be; default: a new folder beside the log, named like it
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Only the tables (CSV per topic)
    #[arg(long, conflicts_with = "frames_only")]
    tables_only: bool,
    /// Only the frames (PNG each)
    #[arg(long)]
    frames_only: bool,
    /// Prints one JSON object
    #[arg(long)]
    json: bool,
}

/// A file that is not there or not a log is a bad argument; damage inside is a failed run.
fn failed(error: LogError) -> CliError {
    match error {
        LogError::NotMcap { .. }
        | LogError::Empty { .. }
        | LogError::OutputExists { .. }
        | LogError::NotEmpty { .. } => CliError::config(error),
        LogError::Read { ref source, .. } if is_no_file(source.kind()) => {
            CliError::Config(format!("{error}; name a log (.mcap) that can be read"))
        }
        other => CliError::run(other),
    }
}

/// There is nothing to be read under that name, as against a disk that fails while reading.
fn is_no_file(kind: ErrorKind) -> bool {
    matches!(
        kind,
        ErrorKind::NotFound
            | ErrorKind::NotADirectory
            | ErrorKind::IsADirectory
            | ErrorKind::PermissionDenied
    )
}

fn print(json: bool, value: &(impl serde::Serialize + std::fmt::Display)) -> Result<(), CliError> {
    if json {
        outln!("{}", serde_json::to_string(value).map_err(CliError::run)?);
    } else {
        out!("{value}");
    }
    Ok(())
}

pub fn info(args: &InfoArgs) -> Result<Outcome, CliError> {
    let info = hydroline_log::info::info(&args.log).map_err(failed)?;
    print(args.json, &info)?;
    Ok(Outcome::Done)
}

pub fn doctor(args: &DoctorArgs) -> Result<Outcome, CliError> {
    let diagnosis = hydroline_log::doctor::doctor(&args.log).map_err(failed)?;
    print(args.json, &diagnosis)?;
    Ok(if diagnosis.sound {
        Outcome::Done
    } else {
        Outcome::Lossy
    })
}

pub fn recover(args: &RecoverArgs) -> Result<Outcome, CliError> {
    inputs::new_file("--out", &args.out)?;
    let recovery = hydroline_log::recover::recover(&args.log, &args.out).map_err(failed)?;
    print(args.json, &recovery)?;
    Ok(if recovery.lossy {
        Outcome::Lossy
    } else {
        Outcome::Done
    })
}

/// `--out`, or the log's name without its extension beside it: only if nothing is there yet, since
/// nobody named it.
fn export_folder(args: &ExportArgs) -> Result<PathBuf, CliError> {
    if let Some(out) = &args.out {
        if out.exists() && !out.is_dir() {
            return Err(CliError::Config(format!(
                "--out {} is a file: export writes a folder; name another --out or move it away",
                out.display()
            )));
        }
        return Ok(out.clone());
    }
    let out = args.log.with_extension("");
    if out == args.log {
        return Err(CliError::Config(format!(
            "{}: has no extension to leave out: name a folder with --out",
            args.log.display()
        )));
    }
    if out.exists() {
        return Err(CliError::Config(format!(
            "{} exists: name another folder with --out",
            out.display()
        )));
    }
    Ok(out)
}

pub fn export(args: &ExportArgs) -> Result<Outcome, CliError> {
    let options = ExportOptions {
        tables: !args.frames_only,
        frames: !args.tables_only,
    };
    let out = export_folder(args)?;
    let exported = hydroline_log::export::export(&args.log, &out, options).map_err(failed)?;
    if args.json {
        outln!(
            "{}",
            serde_json::to_string(&exported).map_err(CliError::run)?
        );
        return Ok(Outcome::Done);
    }
    for (file, rows) in &exported.rows {
        outln!("{}: {rows} rows", file.display());
    }
    if options.frames {
        outln!(
            "{}: {} frames as PNG, {} without an image",
            out.display(),
            exported.frames,
            exported.frames_skipped
        );
    }
    Ok(Outcome::Done)
}
