//! `hydroline info | doctor | recover | export`: what is in a log, whether it is sound, mending, getting things out.

use super::output::Output;
use super::print::{self, errln, out, outln};
use super::{CliError, Outcome, inputs};
use hydroline_core::build_info::BuildInfo;
use hydroline_core::plain;
use hydroline_identify::merged::Merged;
use hydroline_import::recorded::{Contents, RecordedError, Recording};
use hydroline_log::export::ExportOptions;
use std::collections::BTreeMap;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Of a log of another program (MCAP, db3, ArduPilot .bin, .tlog, PX4 .ulg) it lists topics and fields that a map of \
`hydroline import` can name.

Examples:
  hydroline info run.mcap
  hydroline info run.mcap --json

Exit codes: 0 done, also of a log that is cut or damaged (`hydroline doctor` judges); 1 it cannot be read to its end; \
2 no such file, or no log.")]
pub struct InfoArgs {
    /// Log to look at
    #[arg(value_name = "LOG")]
    log: PathBuf,
    /// Prints one JSON object
    #[arg(long)]
    json: bool,
}

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  hydroline doctor run.mcap
  hydroline doctor run.mcap --json

Exit codes: 0 sound; 1 it cannot be read to its end; 2 no such file, or no log; 3 data is lost or damaged, as the \
findings say: frames that were lost while recording, a cut end, bytes that changed.")]
pub struct DoctorArgs {
    /// Log to look at
    #[arg(value_name = "LOG")]
    log: PathBuf,
    /// Prints one JSON object
    #[arg(long)]
    json: bool,
}

#[derive(Debug, clap::Args)]
#[command(after_help = "\
The new file is read again and compared before it gets its name.

Examples:
  hydroline recover broken.mcap --out mended.mcap

Exit codes: 0 everything is in the new file; 1 it could not be written; 2 no such file, no log, or the new file is \
there already; 3 done, but something that was in the original is lost.")]
pub struct RecoverArgs {
    /// Cut or damaged log; it is only read
    #[arg(value_name = "LOG")]
    log: PathBuf,
    /// New file
    #[arg(long, value_name = "NEW.mcap")]
    out: PathBuf,
    /// Prints one JSON object
    #[arg(long)]
    json: bool,
}

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  hydroline export run.mcap                        # into the new folder run/
  hydroline export run.mcap --out tables --tables-only
  hydroline export run.mcap --merged               # the new file run.csv: one row per pose

--merged writes t_s, timestamp_ns, pose and its sds, velocities, what was measured beside them, the load in force (surge_n .. \
yaw_nm), each thruster's thrust and flags (before_commands, gap_before, frame faults); an empty cell is \"not known\".

Exit codes: 0 done; 1 the log is damaged (`hydroline recover` first), or the files could not be written; 2 no such \
file, no log, or the folder holds files already; 3 done, but of some frames there is no image.")]
pub struct ExportArgs {
    /// Log to look at
    #[arg(value_name = "LOG")]
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
    /// One table of the whole run instead, with a row for each pose; --out is the file then, default: the log's name with .csv
    #[arg(long, conflicts_with_all = ["tables_only", "frames_only"])]
    merged: bool,
    /// Rig file or built-in name whose thrusters make the load of --merged; default: the log's
    #[arg(long, value_name = "RIG", requires = "merged")]
    rig: Option<String>,
    /// Prints one JSON object
    #[arg(long)]
    json: bool,
}

fn print(
    json: bool,
    value: &(impl serde::Serialize + schemars::JsonSchema + std::fmt::Display),
) -> Result<(), CliError> {
    if json {
        print::json(value)?;
    } else {
        out!("{value}");
    }
    Ok(())
}

pub fn info(args: &InfoArgs) -> Result<Outcome, CliError> {
    // An MCAP file of anyone is a log as well; of other kinds there is only what can be imported.
    match (
        hydroline_log::info::info(&args.log),
        Recording::open(&args.log),
    ) {
        (Ok(info), recording) => {
            let (recording, not_importable) = match recording {
                Ok(recording) => (recording, None),
                Err(why @ RecordedError::Nothing { .. }) => (None, Some(why.to_string())),
                // Of one of ours, and of one that is damaged, the rest says what it is.
                Err(_) => (None, None),
            };
            let importable = recording.as_ref().map(Recording::contents);
            let log = LogInfo {
                info,
                importable,
                not_importable,
            };
            print(args.json, &log)?;
        }
        (Err(_), Ok(Some(recording))) => print(args.json, recording.contents())?,
        // It is a log of another program, and that is why it cannot be read.
        (
            Err(_),
            Err(
                error @ (RecordedError::Container(_)
                | RecordedError::Nothing { .. }
                | RecordedError::NotRead { .. }),
            ),
        ) => return Err(super::import::about(&args.log, error)),
        (Err(error), _) => return Err(error.into()),
    }
    Ok(Outcome::Done)
}

/// A log, and what of it `import` can take.
#[derive(serde::Serialize, schemars::JsonSchema)]
pub(super) struct LogInfo<'a> {
    #[serde(flatten)]
    info: hydroline_log::info::Info,
    /// What a map of `import` can name in it; absent where it is nothing.
    #[serde(skip_serializing_if = "Option::is_none")]
    importable: Option<&'a Contents>,
    /// Why `import` can take nothing of a log of another program; absent where it can.
    #[serde(skip_serializing_if = "Option::is_none")]
    not_importable: Option<String>,
}

impl std::fmt::Display for LogInfo<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", self.info)?;
        if let Some(why) = &self.not_importable {
            plain::line(f, format_args!("`hydroline import` cannot take it: {why}"))?;
        }
        match self.importable {
            Some(contents) => write!(
                f,
                "fields that a map of `hydroline import` can name\n{contents}"
            ),
            None => Ok(()),
        }
    }
}

pub fn doctor(args: &DoctorArgs) -> Result<Outcome, CliError> {
    let diagnosis = hydroline_log::doctor::doctor(&args.log)?;
    print(args.json, &diagnosis)?;
    Ok(if diagnosis.complete() {
        Outcome::Done
    } else {
        Outcome::Lossy
    })
}

pub fn recover(args: &RecoverArgs, build: BuildInfo) -> Result<Outcome, CliError> {
    inputs::new_file("--out", &args.out)?;
    let recovery = hydroline_log::recover::recover_as(&args.log, &args.out, build)?;
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

/// What `export --merged --json` prints.
#[derive(serde::Serialize, schemars::JsonSchema)]
pub(super) struct MergedRows {
    /// Rows by file.
    rows: BTreeMap<String, usize>,
}

/// One table of the whole run.
fn merged(args: &ExportArgs) -> Result<Outcome, CliError> {
    let out = match &args.out {
        Some(out) => out.clone(),
        None => args.log.with_extension("csv"),
    };
    let output = Output::default();
    output.file("--out", &out)?;
    let rig = args.rig.as_deref().map(inputs::rig).transpose()?;
    let table = Merged::read(&args.log, rig.as_ref())?;
    if let Some(note) = &table.note {
        errln!("WARNING {note}");
    }
    let mut text = Vec::new();
    table
        .write(&mut text)
        .map_err(|e| CliError::writing(&out, &e))?;
    output.write(&out, &text)?;
    if args.json {
        let rows = BTreeMap::from([(out.display().to_string(), table.rows())]);
        print::json(&MergedRows { rows })?;
    } else {
        outln!("{}: {} rows", out.display(), table.rows());
    }
    Ok(Outcome::Done)
}

pub fn export(args: &ExportArgs) -> Result<Outcome, CliError> {
    if args.merged {
        return merged(args);
    }
    let options = ExportOptions {
        tables: !args.frames_only,
        frames: !args.tables_only,
    };
    let out = export_folder(args)?;
    let exported = hydroline_log::export::export(&args.log, &out, options)?;
    let outcome = if exported.frames_undecodable > 0 {
        Outcome::Lossy
    } else {
        Outcome::Done
    };
    if args.json {
        print::json(&exported)?;
        return Ok(outcome);
    }
    for (file, rows) in &exported.rows {
        outln!("{}: {rows} rows", file.display());
    }
    if options.frames {
        outln!(
            "{}: {} frames as PNG, {} without an image, {} of them not marked as faulty",
            out.display(),
            exported.frames,
            exported.frames_skipped,
            exported.frames_undecodable
        );
    }
    Ok(outcome)
}
