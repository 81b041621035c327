//! `hydroline export`: tables and images out of logs.

use super::many::{self, Many, Results};
use super::output::Output;
use super::print::{errln, outln};
use super::{CliError, Outcome, inputs, progress};
use hydroline_identify::merged::Merged;
use hydroline_log::export::{ExportOptions, Exported, export, is_unfinished};
use hydroline_rigs::Rig;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  hydroline export run.mcap                        # into the new folder run/
  hydroline export run.mcap --out tables --tables-only
  hydroline export run.mcap --merged               # the new file run.csv: one row per pose
  hydroline export logs --merged --out tables --update    # what has no table yet

--merged writes t_s, timestamp_ns, pose and its sds, velocities, what was measured beside them, the load (surge_n .. \
yaw_nm) and each thruster's thrust, each as its mean until the next row, and flags (before_commands, gap_before, loads_change_in_gap, \
frame faults); an empty cell is \"not known\".

A folder stands for all logs in it and below it. Of several logs --out is the folder in which each gets a folder (a table with \
--merged) by its own name; a log that cannot be exported is reported, and the others are done. --update makes it a command to \
repeat: what is there and no older than its log is left.

The same command again goes on with an export that was killed, and says how many images were there.

Exit codes: 0 done; 1 the log is damaged (`hydroline recover` first), or the files could not be written; 2 no such \
file, no log, or the folder holds files already; 3 done, but of some frames there is no image, \
or some of several logs could not be exported.")]
pub struct Args {
    /// Logs to export, or folders of them
    #[arg(required = true, value_name = "LOG|FOLDER")]
    logs: Vec<PathBuf>,
    /// Folder to write to, made if need be; default: a new folder beside each log, named like it
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
    /// Leaves what is done: a result that is there and no older than its log
    #[arg(long)]
    update: bool,
    /// Prints one JSON object, one per line of several logs
    #[arg(long)]
    json: bool,
}

/// Output of `export --merged --json`.
#[derive(serde::Serialize, schemars::JsonSchema)]
pub(super) struct MergedRows {
    /// Rows by file.
    rows: BTreeMap<String, usize>,
}

/// Result of one log's export.
enum Made {
    UpToDate,
    /// Tables and images.
    Files(Exported),
    Merged {
        rows: usize,
        note: Option<String>,
    },
}

pub fn run(args: &Args) -> Result<Outcome, CliError> {
    let many = Many::of(&args.logs, many::LOG)?;
    let rig = args.rig.as_deref().map(inputs::rig).transpose()?;
    let places = places(args, &many)?;
    let bar = progress::bar(many.logs.len() as u64, "logs");
    let of = |log: &Path| {
        let made = made(args, log, &places[log], rig.as_ref());
        bar.inc(1);
        made
    };
    let report = |log: &Path, made: Made| {
        bar.suspend(|| self::report(args, &many, log, &places[log], &made))
    };
    let outcome = many.each(
        rayon::current_num_threads(),
        of,
        report,
        many.refused_line(args.json),
    );
    bar.finish_and_clear();
    outcome
}

/// Where each log's result goes.
fn places(args: &Args, many: &Many) -> Result<Results, CliError> {
    let ended = |name: &Path| match args.merged {
        true => name.with_extension("csv"),
        false => name.with_extension(""),
    };
    match (&args.out, many.single) {
        (Some(out), true) => Ok(many.each_to(|_| out.clone())),
        (Some(out), false) => {
            if out.exists() && !out.is_dir() {
                return Err(is_a_file(out));
            }
            inputs::folder("--out", out)?;
            many.results(out, ended)
        }
        (None, _) => Ok(many.each_to(ended)),
    }
}

fn is_a_file(out: &Path) -> CliError {
    CliError::Config(format!(
        "--out {} is a file: export writes a folder; name another --out or move it away",
        out.display()
    ))
}

fn made(args: &Args, log: &Path, place: &Path, rig: Option<&Rig>) -> Result<Made, CliError> {
    if args.merged {
        return merged(args, log, place, rig);
    }
    let options = ExportOptions {
        tables: !args.frames_only,
        frames: !args.tables_only,
    };
    // An export that was broken off goes on.
    if args.update && !is_unfinished(place) && is_done(place, log) {
        return Ok(Made::UpToDate);
    }
    vacant(args, log, place)?;
    Ok(Made::Files(export(log, place, options)?))
}

/// Refuses a file in the folder's place, and a folder that nobody named and that is there already.
fn vacant(args: &Args, log: &Path, place: &Path) -> Result<(), CliError> {
    if place == log {
        return Err(CliError::Config(format!(
            "{}: has no extension to leave out: name a folder with --out",
            log.display()
        )));
    }
    if place.exists() && !place.is_dir() {
        return Err(is_a_file(place));
    }
    if place.exists() && args.out.is_none() && !is_unfinished(place) {
        return Err(CliError::Config(format!(
            "{} exists: name another folder with --out{}",
            place.display(),
            match args.update {
                true => ", or move it away: it is older than its log",
                false => ", or give --update to leave what is done",
            }
        )));
    }
    Ok(())
}

/// Whether a folder holds files, none of them older than the log.
fn is_done(folder: &Path, log: &Path) -> bool {
    let Ok(entries) = std::fs::read_dir(folder) else {
        return false;
    };
    let mut files = entries.filter_map(Result::ok).peekable();
    files.peek().is_some() && files.all(|f| many::is_up_to_date(&f.path(), log))
}

/// One table of the whole run.
fn merged(args: &Args, log: &Path, out: &Path, rig: Option<&Rig>) -> Result<Made, CliError> {
    if args.update && many::is_up_to_date(out, log) {
        return Ok(Made::UpToDate);
    }
    if let (Some(named), Some(folder)) = (&args.out, out.parent())
        && out != named
    {
        // A folder of the folder that was named.
        std::fs::create_dir_all(folder).map_err(|e| CliError::writing(folder, &e))?;
    }
    let output = Output::replacing(args.update);
    output.file("--out", out)?;
    let table = Merged::read(log, rig)?;
    let mut text = Vec::new();
    table
        .write(&mut text)
        .map_err(|e| CliError::writing(out, &e))?;
    output.write(out, &text)?;
    Ok(Made::Merged {
        rows: table.rows(),
        note: table.note.clone(),
    })
}

fn report(
    args: &Args,
    many: &Many,
    log: &Path,
    place: &Path,
    made: &Made,
) -> Result<Outcome, CliError> {
    match made {
        Made::UpToDate => {
            errln!("hydroline: {}: up to date", place.display());
            Ok(Outcome::Done)
        }
        Made::Merged { rows, note } => {
            if let Some(note) = note {
                errln!("WARNING {note}");
            }
            match args.json {
                true => {
                    let rows = BTreeMap::from([(place.display().to_string(), *rows)]);
                    many.json(log, &MergedRows { rows })?;
                }
                false => outln!("{}: {rows} rows", place.display()),
            }
            Ok(Outcome::Done)
        }
        Made::Files(exported) => {
            let outcome = Outcome::of(exported.frames_undecodable > 0);
            if args.json {
                many.json(log, exported)?;
                return Ok(outcome);
            }
            for (file, rows) in &exported.rows {
                outln!("{}: {rows} rows", file.display());
            }
            if !args.tables_only {
                outln!(
                    "{}: {} frames as PNG{}, {} without an image, {} of them not marked as faulty",
                    place.display(),
                    exported.frames,
                    match exported.frames_resumed {
                        0 => String::new(),
                        n => format!(" ({n} of them made before the export was broken off)"),
                    },
                    exported.frames_skipped,
                    exported.frames_undecodable
                );
            }
            Ok(outcome)
        }
    }
}
