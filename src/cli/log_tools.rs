//! `hydroline info | doctor | recover`: what is in logs, whether they are sound, mending.

use super::many::{self, Many};
use super::print::{self, out, outln};
use super::{CliError, Outcome, inputs};
use hydroline_core::build_info::BuildInfo;
use hydroline_core::plain;
use hydroline_import::recorded::{Contents, RecordedError, Recording};
use hydroline_log::LogError;
use hydroline_log::doctor::Diagnosis;
use regex_lite::{Regex, RegexBuilder};
use std::fmt::Arguments;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Of a log of another program (MCAP, db3, ArduPilot .bin, .tlog, PX4 .ulg) it lists topics and fields that a map of \
`hydroline import` can name. A folder stands for all logs in it and below it; a log that cannot be read is reported, and the \
others are looked at.

It is at most forty lines of a log of ours: counts of nothing, hashes and matrices are left out and counted; --long prints all.

--grep looks through what --long prints and through all of the metadata (rig, plan, note, calibration) and prints lines, each \
behind its log. Capital or small is the same.

Examples:
  hydroline info run.mcap
  hydroline info run.mcap --long
  hydroline info run.mcap --json
  hydroline info logs --grep 'mass_kg = 12'    # which runs were made with this rig?
  hydroline info logs --json > logs.jsonl      # one object per line

Exit codes: 0 done, also of a log that is cut or damaged (`hydroline doctor` judges); 1 it cannot be read to its end, or no \
log holds what --grep names; 2 no such file, or no log; 3 done, but some of several logs could not be read.")]
pub struct InfoArgs {
    /// Logs to look at, or folders of them
    #[arg(required = true, value_name = "LOG|FOLDER")]
    logs: Vec<PathBuf>,
    /// Prints the lines in which this regular expression is found; with --json the logs that have one
    #[arg(long, value_parser = expression, value_name = "EXPRESSION")]
    grep: Option<Regex>,
    /// Prints all metadata, however long
    #[arg(long, conflicts_with = "json")]
    long: bool,
    /// Prints one JSON object, one per line of several logs
    #[arg(long)]
    json: bool,
}

#[derive(Debug, clap::Args)]
#[command(after_help = "\
A folder stands for all logs in it and below it; a log that cannot be read is reported, and the others are looked at.

Examples:
  hydroline doctor run.mcap
  hydroline doctor run.mcap --json
  hydroline doctor logs                # every log below the folder
  hydroline doctor logs --json > doctor.jsonl    # one object per line

Exit codes: 0 sound; 1 it cannot be read to its end; 2 no such file, or no log; 3 data is lost or damaged, as the \
findings say: frames that were lost while recording, a cut end, bytes that changed; or some of several logs could not be read.")]
pub struct DoctorArgs {
    /// Logs to look at, or folders of them
    #[arg(required = true, value_name = "LOG|FOLDER")]
    logs: Vec<PathBuf>,
    /// Prints one JSON object, one per line of several logs
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

fn expression(text: &str) -> Result<Regex, String> {
    let built = RegexBuilder::new(text).case_insensitive(true).build();
    built.map_err(|e| format!("{e}; write a regular expression, `\\.` for a full stop"))
}

/// Kind of a file, with its contents.
enum Looked {
    /// A log (MCAP of anyone).
    Log(Box<LogInfo>),
    /// A log of another program that is no MCAP file.
    Other(Contents),
}

/// A log, and what of it `import` can take.
#[derive(serde::Serialize, schemars::JsonSchema)]
pub(super) struct LogInfo {
    #[serde(flatten)]
    info: hydroline_log::info::Info,
    /// Fields that a map of `import` can name in it; absent where there are none.
    #[serde(skip_serializing_if = "Option::is_none")]
    importable: Option<Contents>,
    /// Why `import` can take nothing of a log of another program; absent where it can.
    #[serde(skip_serializing_if = "Option::is_none")]
    not_importable: Option<String>,
}

impl LogInfo {
    /// As a terminal shows it, short or all of it.
    fn text(&self, long: bool) -> String {
        let info = match long {
            true => self.info.to_string(),
            false => self.info.brief().to_string(),
        };
        let mut text = String::new();
        let mut line = |words: Arguments<'_>| {
            // A String takes everything.
            let _ = plain::line(&mut text, words);
        };
        let (first, rest) = info.split_once('\n').unwrap_or((&info, ""));
        line(format_args!("{first}"));
        // Of a loss nothing else in the log's own account speaks, and what follows may be long.
        let topics = self.importable.iter().flat_map(|c| &c.topics);
        for t in topics.filter(|t| t.undecoded > 0) {
            line(format_args!(
                "  NOT READ     {} of {} messages of {} cannot be decoded",
                t.undecoded, t.messages, t.topic
            ));
        }
        rest.lines().for_each(|own| line(format_args!("{own}")));
        if let Some(why) = &self.not_importable {
            line(format_args!("`hydroline import` cannot take it: {why}"));
        }
        if let Some(contents) = &self.importable {
            text.push_str("fields that a map of `hydroline import` can name\n");
            text.push_str(&contents.to_string());
        }
        text
    }
}

impl Looked {
    // An MCAP file of anyone is a log as well; of other kinds there is only what can be imported.
    fn at(log: &Path) -> Result<Self, CliError> {
        match (hydroline_log::info::info(log), Recording::open(log)) {
            (Ok(info), recording) => {
                let (recording, not_importable) = match recording {
                    Ok(recording) => (recording, None),
                    Err(why @ RecordedError::Nothing { .. }) => (None, Some(why.to_string())),
                    // Of one of ours, and of one that is damaged, the rest says what it is.
                    Err(_) => (None, None),
                };
                Ok(Self::Log(Box::new(LogInfo {
                    info,
                    importable: recording.map(|r| r.contents().clone()),
                    not_importable,
                })))
            }
            (Err(_), Ok(Some(recording))) => Ok(Self::Other(recording.contents().clone())),
            // It is a log of ours, packed.
            (Err(error @ LogError::Foreign { .. }), Err(RecordedError::Ours)) => Err(error.into()),
            // It is a log of another program, and that is why it cannot be read.
            (Err(LogError::Foreign { .. }), Err(error)) => Err(super::import::about(log, error)),
            (
                Err(_),
                Err(
                    error @ (RecordedError::Container(_)
                    | RecordedError::Nothing { .. }
                    | RecordedError::NotRead { .. }),
                ),
            ) => Err(super::import::about(log, error)),
            (Err(error), _) => Err(error.into()),
        }
    }

    fn text(&self, long: bool) -> String {
        match self {
            Self::Log(log) => log.text(long),
            Self::Other(contents) => contents.to_string(),
        }
    }

    /// Lines in which the expression is found: of what is printed, and of metadata that is printed as a number of lines.
    fn lines(&self, wanted: &Regex) -> Vec<String> {
        let mut lines: Vec<String> = self
            .text(true)
            .lines()
            .map(|l| l.trim().to_owned())
            .collect();
        if let Self::Log(log) = self {
            for (name, map) in &log.info.metadata {
                for (key, value) in map.iter().filter(|(_, value)| value.lines().count() > 1) {
                    lines.extend(value.lines().map(|line| format!("{name}.{key}: {line}")));
                }
            }
        }
        lines.retain(|line| wanted.is_match(line));
        lines
    }
}

pub fn info(args: &InfoArgs) -> Result<Outcome, CliError> {
    let many = Many::of(&args.logs, many::RECORDINGS)?;
    let mut found = 0;
    let report = |log: &Path, looked: Looked| {
        if let Some(wanted) = &args.grep {
            let lines = looked.lines(wanted);
            found += lines.len();
            if lines.is_empty() {
                return Ok(Outcome::Done);
            }
            if !args.json {
                for line in lines {
                    outln!("{}: {line}", log.display());
                }
                return Ok(Outcome::Done);
            }
        }
        match (args.json, &looked) {
            (true, Looked::Log(info)) => many.json(log, info.as_ref())?,
            (true, Looked::Other(contents)) => many.json(log, contents)?,
            (false, looked) => out!("{}", looked.text(args.long)),
        }
        Ok(Outcome::Done)
    };
    let outcome = many.each(
        rayon::current_num_threads(),
        Looked::at,
        report,
        many.refused_line(args.json),
    )?;
    match &args.grep {
        Some(wanted) if found == 0 => Err(CliError::Run(format!(
            "--grep {wanted}: found in none of {} log(s)",
            many.logs.len()
        ))),
        _ => Ok(outcome),
    }
}

pub fn doctor(args: &DoctorArgs) -> Result<Outcome, CliError> {
    let many = Many::of(&args.logs, many::LOG)?;
    let of = |log: &Path| Ok(hydroline_log::doctor::doctor(log)?);
    let report = |log: &Path, diagnosis: Diagnosis| {
        match args.json {
            true => many.json(log, &diagnosis)?,
            false => out!("{diagnosis}"),
        }
        Ok(Outcome::of(!diagnosis.complete()))
    };
    let refused = many.refused_line(args.json);
    many.each(rayon::current_num_threads(), of, report, refused)
}

pub fn recover(args: &RecoverArgs, build: BuildInfo) -> Result<Outcome, CliError> {
    inputs::new_file("--out", &args.out)?;
    let recovery = hydroline_log::recover::recover_as(&args.log, &args.out, build)?;
    match args.json {
        true => print::json(&recovery)?,
        false => out!("{recovery}"),
    }
    Ok(Outcome::of(recovery.lossy))
}
