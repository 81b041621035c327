//! `hydroline import`: a table or a log recorded by something else becomes a log.

use std::path::{Path, PathBuf};

use super::print::{self, errln, outln};
use super::{CliError, Outcome, inputs};
use hydroline_core::build_info::BuildInfo;
use hydroline_import::guess::{guess, guess_recording};
use hydroline_import::recorded::{Foreign, RecordedError, Recording};
use hydroline_import::{
    Finding, Lost, Map, Options, Severity, Source, TableFile, import_table, survey,
};
use schemars::JsonSchema;
use serde::Serialize;

#[derive(Debug, clap::Args)]
#[command(after_help = "\
MAP.toml says which column is what; everything but one channel or command and the time is optional:
  [file]            separator = \",\" (\"\\t\" \";\" \"blanks\")  decimal = \".\"  encoding = \"utf-8\" (utf-16 latin1)
                    comment = \"#\"  header_line = 4  units_line = 5  first_line, last_line  header = false
                    thousands = \",\" (\".\" \"'\" \" \"): between groups of three digits, 1,234.5
                    widths = [9, 9, 12] in place of a separator: characters of each column
  [time]            column = \"t\"  unit = \"s\" (ms us ns min h d spreadsheet_days matlab_days iso8601)
                    columns = [\"Date\", \"Time\"]  format = \"%d.%m.%Y %H:%M:%S%.f\";  columns = [1, 2]  unit = [\"s\", \"ns\"]
                    rate_hz = 100: rows without time, a frame column without unit, or rounded stamps put back
                    boot = 2: the second run of a counter that starts anew in the file (an autopilot that restarted)
                    unwrap = 32 (bits of a counter)  clock = \"relative\" (unix)  start_unix_s
                    utc_offset = \"+02:00\": of stamps that state none
                    from_s, to_s: only these rows; compare_column, compare_unit: a second clock
  [motion.phi_rad]  column = \"roll\" (or its number)  nth = 2 (of one name)  unit = \"deg\"  sign = -1  scale = 1
                    offset = 0.0 (SI)  sd = 0.001  missing = \"fault\" (skip hold)
                    missing_value = 0, or \"OVER\", or a list of both: what else means an empty cell
                    value = 0.8 without column: a constant; u_mps v_mps w_mps: frame = \"body\" (tank)
                    beside the channels: rudder_rad elevator_rad shaft_radps wave_m
  [quaternion]      columns = [\"qx\", \"qy\", \"qz\", \"qw\"]  order = \"xyzw\" (wxyz)  axes = \"z_down\" (z_up)
  [[command]]       thruster = \"surge\"  column = \"u\"  unit = \"N\" (us: a pulse, by the curve of --rig)
                    scale = 35.15  offset = 0.0  between = \"hold\" (linear)  missing = \"fault\" (skip hold)

A log of another program (ROS 2 in MCAP or db3, a bag's folder, Foxglove's protobuf and JSON in MCAP, ArduPilot DataFlash .bin, \
MAVLink .tlog, PX4 .ulg; packed with gzip or zstd too) is imported with the same map. `hydroline info LOG` lists its topics and fields:
  [time]            column = \"stamp\" (the messages' own) or \"log_time\" (when recorded)  unit = \"ns\"  clock = \"unix\"
  [motion.x_m]      column = \"/odom.pose.pose.position.x\": TOPIC.FIELD, or the field alone where --topic leaves one topic

Examples:
  hydroline import --guess mocap.csv > mocap.toml
  hydroline import mocap.csv --map mocap.toml --out run.mcap
  hydroline import mocap.csv --map mocap.toml --rig my.toml --out run.mcap --accept-faults
  hydroline import --guess bag.mcap --topic /odom --topic /cmd > bag.toml
  hydroline import bag.mcap --map bag.toml --out run.mcap

Exit codes: 0 done; 1 the log could not be written; 2 bad arguments or map, or a table with faults (nothing is \
written); 3 done, but what --accept-faults left out is lost.")]
pub struct Args {
    /// Table (CSV or text; - = standard input) or log of another program to import
    #[arg(value_name = "DATA")]
    data: PathBuf,
    /// Map that says what its columns are
    #[arg(long, value_name = "MAP.toml", required_unless_present = "guess")]
    map: Option<PathBuf>,
    /// Log to write
    #[arg(long, value_name = "LOG.mcap", required_unless_present = "guess")]
    out: Option<PathBuf>,
    /// Prints a map for the table instead: to stdout, with what it is not sure of as comments; remarks to stderr
    #[arg(long, conflicts_with_all = ["map", "out", "accept_faults", "rig", "json"])]
    guess: bool,
    /// Of a log, only this topic (again for more): where fields without a topic are looked for, and what --guess looks at
    #[arg(long, value_name = "TOPIC")]
    topic: Vec<String>,
    /// Imports what is sound although there are faults; what is left out is counted (exit code 3)
    #[arg(long)]
    accept_faults: bool,
    /// Rig file or built-in name: names and sizes of the commands are held against it, pulses go through its curves
    #[arg(long, value_name = "RIG")]
    rig: Option<String>,
    /// Prints the findings as one JSON object
    #[arg(long)]
    json: bool,
}

/// Output of `--json`.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct Printed<'a> {
    /// Whether the log was written.
    written: bool,
    /// Motion samples written; `None` = no log.
    samples: Option<usize>,
    /// Commands written; `None` = no log.
    commands: Option<usize>,
    /// Numbers of rows and cells that were left out; `None` = no log.
    lost: Option<Lost>,
    /// Findings in the data.
    findings: &'a [Finding],
}

enum Input {
    Table(TableFile),
    Log(Box<Recording>),
}

pub(super) fn about(path: &Path, error: RecordedError) -> CliError {
    match error {
        RecordedError::Io(e) => CliError::reading(path, &e, "name a table (CSV) or a log"),
        // These say what to do themselves.
        own @ (RecordedError::Topic { .. }
        | RecordedError::NotRead { .. }
        | RecordedError::Flags { .. }
        | RecordedError::NoParts { .. }
        | RecordedError::Damaged { .. }) => CliError::Config(format!("{}: {own}", path.display())),
        other => CliError::Config(format!(
            "{}: {other}; check the file, or name another",
            path.display()
        )),
    }
}

fn open(args: &Args) -> Result<Input, CliError> {
    let path = &args.data;
    let found = Recording::open(path).map_err(|e| about(path, e))?;
    match found {
        Some(log) => {
            let log = log.with_topics(&args.topic).map_err(|e| about(path, e))?;
            Ok(Input::Log(Box::new(log)))
        }
        None if !args.topic.is_empty() => Err(CliError::Config(format!(
            "{}: --topic {} is for logs, and this is none that is known here (MCAP, db3, DataFlash, tlog, ULog): leave it out, or name a log",
            path.display(),
            args.topic[0]
        ))),
        None => {
            let reading =
                |e: std::io::Error| CliError::reading(path, &e, "name a table (CSV) or a log");
            let table = TableFile::open(path).map_err(reading)?;
            // What came through a pipe is looked at here.
            if let Some(Foreign { what, next }) = table.foreign().map_err(reading)? {
                return Err(about(path, RecordedError::NotRead { what, next }));
            }
            Ok(Input::Table(table))
        }
    }
}

/// Prints the map of a table or log.
fn guess_map(args: &Args) -> Result<Outcome, CliError> {
    let path = &args.data;
    let found = match open(args)? {
        Input::Table(table) => {
            guess(&table).map_err(|e| CliError::reading(path, &e, "name a table (CSV)"))?
        }
        Input::Log(log) => guess_recording(&log).map_err(|e| about(path, e))?,
    }
    .map_err(|why| CliError::Config(format!("{}: {why}", path.display())))?;
    for remark in &found.remarks {
        errln!("{remark}");
    }
    outln!("{}", found.toml.trim_end());
    Ok(Outcome::Done)
}

pub fn run(args: &Args, build: BuildInfo) -> Result<Outcome, CliError> {
    if args.guess {
        return guess_map(args);
    }
    let (Some(map_path), Some(out)) = (&args.map, &args.out) else {
        return Err(CliError::Config(
            "give --map and --out, or --guess for a map".to_owned(),
        ));
    };
    let (map, map_text) = Map::load_with_text(map_path)?;
    inputs::new_file("--out", out)?;
    match open(args)? {
        Input::Table(table) => write(args, build, &table, &map, Vec::new(), &map_text, out),
        Input::Log(log) => {
            let mut table = log.table(&map).map_err(|e| about(&args.data, e))?;
            let (findings, own) = (std::mem::take(&mut table.findings), table.map.clone());
            write(args, build, &table, &own, findings, &map_text, out)
        }
    }
}

/// Looks at a table, says what it found, and writes the log.
fn write(
    args: &Args,
    build: BuildInfo,
    table: &(impl Source + ?Sized),
    map: &Map,
    findings: Vec<Finding>,
    map_text: &str,
    out: &Path,
) -> Result<Outcome, CliError> {
    let data = &args.data;
    let rig = args.rig.as_deref().map(inputs::rig).transpose()?;
    let mut found = survey(table, map, rig.as_ref())
        .map_err(|e| CliError::reading(data, &e, "name a table (CSV)"))?;
    // A column that the log does not have is not in its table either: said once.
    let subject = |f: &Finding| f.message.split(':').next().map(str::to_owned);
    found.findings.retain(|f| {
        f.kind != "column_missing"
            || !findings
                .iter()
                .any(|o| o.kind == f.kind && subject(o) == subject(f))
    });
    found.findings.splice(0..0, findings);
    for f in &found.findings {
        let word = match f.severity {
            Severity::Info => "info",
            Severity::Warning => "WARNING",
            Severity::Fault => "FAULT",
        };
        errln!("{word} {}: {}", f.kind, f.message);
    }
    let options = Options {
        accept_faults: args.accept_faults,
        build,
    };
    let result = import_table(table, &found, map, map_text, rig.as_ref(), out, options);
    if args.json {
        let made = result.as_ref().ok();
        print::json(&Printed {
            written: result.is_ok(),
            samples: made.map(|o| o.samples),
            commands: made.map(|o| o.commands),
            lost: made.map(|o| o.lost),
            findings: &found.findings,
        })?;
    }
    let outcome = result.map_err(|e| CliError::from(e).about(data))?;
    if !args.json {
        outln!(
            "{}: {} motion samples, {} commands",
            out.display(),
            outcome.samples,
            outcome.commands
        );
        let lost = outcome.lost;
        if lost.total() > 0 {
            outln!(
                "  left out: {} rows, {} cells of motion, {} cells of commands",
                lost.rows,
                lost.motion_cells,
                lost.command_cells
            );
        }
    }
    Ok(Outcome::of(found.has_faults() || outcome.lost.total() > 0))
}
