//! `hydroline campaign`: many logs, grouped, examined, fitted and compared; units of work for other machines.

use super::limit::LimitArgs;
use super::many::{LOG, below};
use super::print::{errln, outln};
use super::{CliError, Outcome, inputs, progress, replay};
use hydroline_campaign::group::{Group, groups};
use hydroline_campaign::kind::Kind;
use hydroline_campaign::store::Store;
use hydroline_campaign::survey::{Found, survey};
use hydroline_campaign::table::{Row, Table, word};
use hydroline_campaign::unit::{Task, Unit, units};
use hydroline_campaign::work::Campaign;
use hydroline_campaign::{page::page, store::write_whole};
use hydroline_core::build_info::BuildInfo;
use hydroline_diagnose::verdict::Word;
use hydroline_numerics::parallel;
use std::io::Write;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Logs are found below DIR (*.mcap) and grouped by the rig that they carry, their calibration and their water; days are \
UTC, and logs dated before 2001 or later than now have none. Each run: doctor, replay where there are images and no motion, identify, diagnose. Each day, and each group since its last \
change: the same of all its runs together. Between days: which single change (mass, damping, thrust, one thruster) explains the later one. A log \
that cannot be used is a row, not the end.

--out holds campaign.html, runs.csv and runs.jsonl, written anew each time, and store/: one sheet per unit of work, named by a \
hash of logs, rig and build. What is there is not done again; what was broken off goes on. A unit whose diagnosis was ended \
by --time-limit is done again under a longer one.

Other machines: `--list` prints units that can be done now, one per line, and `--only UNIT` does one; stores may be one shared \
folder, or copied together. Then `--list` again, until it prints nothing.

Examples:
  hydroline campaign logs --out campaign
  hydroline campaign logs --out campaign --fail-on unknown,drift
  hydroline campaign logs --out campaign --list > units

Exit codes: 0 done; 1 a unit could not be done, or --fail-on found something; 2 bad arguments, no log in DIR; 3 done, but \
some files cannot be used.")]
pub struct Args {
    /// Folder with logs, looked through to its bottom
    #[arg(value_name = "DIR")]
    dir: PathBuf,
    /// Folder of the campaign
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Folder of the sheets [default: OUT/store]
    #[arg(long, value_name = "DIR")]
    store: Option<PathBuf>,
    /// Rig file or built-in name for logs that carry none
    #[arg(long, value_name = "RIG")]
    rig: Option<String>,
    /// Prints the units that can be done now and are not, one per line
    #[arg(long, conflicts_with = "only")]
    list: bool,
    /// Does this unit (repeatable) and nothing else
    #[arg(long, value_name = "UNIT")]
    only: Vec<String>,
    #[command(flatten)]
    limit: LimitArgs,
    /// Ends with exit code 1 when the campaign holds this (several with commas), for scripts
    #[arg(long, value_enum, value_delimiter = ',', value_name = "WHAT")]
    fail_on: Vec<FailOn>,
    /// Prints one JSON object
    #[arg(long)]
    json: bool,
}

/// Findings that a script may want to hear of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum FailOn {
    /// A group's verdict is `unknown`
    Unknown,
    /// A group's fit leaves more than noise
    Misfit,
    /// Something changed between two days
    Drift,
}

/// Names of what a campaign writes beside its store.
const FILES: [&str; 3] = ["campaign.html", "runs.csv", "runs.jsonl"];

pub fn run(args: &Args, build: BuildInfo) -> Result<Outcome, CliError> {
    let rig = args.rig.as_deref().map(inputs::rig).transpose()?;
    if !args.dir.is_dir() {
        return Err(CliError::Config(format!(
            "{}: no such folder; name the one that the logs lie in",
            args.dir.display()
        )));
    }
    own_folder(&args.out)?;
    inputs::folder("--out", &args.out)?;
    let paths = logs(args)?;
    std::fs::create_dir_all(&args.out).map_err(|e| CliError::writing(&args.out, &e))?;
    let folder = args.store.clone().unwrap_or_else(|| args.out.join("store"));
    let mut store = Store::open(&folder).map_err(CliError::run)?;
    let found = survey(&args.dir, &paths, rig.as_ref(), &mut store).map_err(CliError::run)?;
    store.keep_hashes().map_err(CliError::run)?;
    let groups = groups(&found);
    let units = units(&found, &groups, &build.to_string());
    let replayed = |log: &Path, out: &Path| {
        replay::one(log, out, build)
            .map(|_| ())
            .map_err(|e| e.to_string())
    };
    let campaign = Campaign {
        logs: &found,
        groups: &groups,
        units: &units,
        store: &store,
        replay: &replayed,
        time_limit: args.limit.length(),
    };
    if args.list {
        let done = campaign.done();
        for (unit, is_done) in units.iter().zip(&done) {
            if !is_done && unit.needs.iter().all(|k| done[*k]) {
                outln!("{}", unit.name);
            }
        }
        return Ok(Outcome::Done);
    }
    if !args.only.is_empty() {
        for name in &args.only {
            let unit = units.iter().find(|u| u.name == *name).ok_or_else(|| {
                CliError::Config(format!(
                    "--only {name}: no such unit; `--list` prints those that can be done"
                ))
            })?;
            if !campaign.is_done(unit) {
                campaign.work(unit).map_err(CliError::run)?;
            }
        }
        return Ok(Outcome::Done);
    }
    let failures = work_all(&campaign);
    let [html, csv, lines] = FILES.map(|name| args.out.join(name));
    let table = Table::write(&campaign, &lines, &csv).map_err(CliError::run)?;
    let command: Vec<String> = std::env::args().skip(1).collect();
    let command = format!("hydroline {}", command.join(" "));
    let page = page(&campaign, &table, &command).map_err(CliError::run)?;
    write_whole(&html, |out| out.write_all(page.html().as_bytes())).map_err(CliError::run)?;
    errln!("{}", html.display());
    let joint = table.joint().map_err(CliError::run)?;
    if args.json {
        print_json(&table)?;
    } else {
        print(&found, &groups, &joint);
    }
    if !failures.is_empty() {
        return Err(CliError::Run(failures.join("\nhydroline: ")));
    }
    failed(&args.fail_on, &joint)?;
    match found.iter().any(|f| f.is.is_err()) {
        true => Ok(Outcome::Lossy),
        false => Ok(Outcome::Done),
    }
}

/// Logs of the folder, without those that the campaign itself has made.
fn logs(args: &Args) -> Result<Vec<PathBuf>, CliError> {
    let absolute =
        |path: &Path| std::path::absolute(path).map_err(|e| CliError::reading(path, &e, ""));
    let own = [Some(&args.out), args.store.as_ref()];
    let own: Vec<PathBuf> = own
        .into_iter()
        .flatten()
        .map(|path| absolute(path))
        .collect::<Result<_, _>>()?;
    let mut logs = below(&args.dir, LOG)?;
    logs.retain(|log| {
        std::path::absolute(log).is_ok_and(|log| !own.iter().any(|own| log.starts_with(own)))
    });
    match logs.is_empty() {
        true => Err(CliError::Config(format!(
            "{}: no log in it or below it but the campaign's own; name a folder that holds some",
            args.dir.display()
        ))),
        false => Ok(logs),
    }
}

/// Refuses a folder that holds something else: a campaign writes its files anew each time.
fn own_folder(out: &Path) -> Result<(), CliError> {
    let Ok(mut entries) = std::fs::read_dir(out) else {
        return Ok(());
    };
    let other = |name: &str| !name.starts_with('.') && name != "store" && !FILES.contains(&name);
    let found = entries.find_map(|e| {
        let name = e.ok()?.file_name().to_string_lossy().into_owned();
        other(&name).then_some(name)
    });
    match found {
        Some(name) => Err(CliError::Config(format!(
            "--out {}: holds {name}, which is no campaign's: name a new folder",
            out.display()
        ))),
        None => Ok(()),
    }
}

/// All units that are not done, those first that others need; units that could not be done, each with its reason. One that
/// fails ends no other.
fn work_all(campaign: &Campaign<'_>) -> Vec<String> {
    let done = campaign.done();
    let open: Vec<&Unit> = (campaign.units.iter().zip(done))
        .filter_map(|(unit, is_done)| (!is_done).then_some(unit))
        .collect();
    let bar = progress::bar(open.len() as u64, "units");
    let (runs, joint): (Vec<&Unit>, Vec<&Unit>) = open
        .into_iter()
        .partition(|u| matches!(u.task, Task::Run { .. }));
    let (groups, days): (Vec<&Unit>, Vec<&Unit>) = joint
        .into_iter()
        .partition(|u| matches!(u.task, Task::Group { .. }));
    let mut failed: Vec<String> = Vec::new();
    for stage in [runs, days, groups] {
        let of_stage = parallel::map_slice(&stage, |unit| {
            let result = campaign.work(unit);
            bar.inc(1);
            Some(format!("{}: {}", unit.name, result.err()?))
        });
        failed.extend(of_stage.into_iter().flatten());
    }
    bar.finish_and_clear();
    failed
}

/// One object, written row by row.
fn print_json(table: &Table) -> Result<(), CliError> {
    outln!("{{\"rows\": [");
    let mut before = String::new();
    for row in table.rows().map_err(CliError::run)? {
        if !before.is_empty() {
            outln!("{before},");
        }
        before = serde_json::to_string(&row.map_err(CliError::run)?)?;
    }
    outln!("{before}\n]}}");
    Ok(())
}

fn print(found: &[Found], groups: &[Group], rows: &[Row]) {
    for log in found {
        if let Err(why) = &log.is {
            outln!("cannot be used: {}: {why}", log.name);
        }
    }
    for group in groups {
        let dated: usize = group.days.iter().map(|d| d.logs.len()).sum();
        let undated = match group.undated.len() {
            0 => String::new(),
            n => format!(", {n} of them without a day: their clock is wrong (`doctor`)"),
        };
        outln!(
            "{} ({}): {} runs on {} day(s){undated}",
            group.vehicle,
            group.id,
            dated + group.undated.len(),
            group.days.len()
        );
        let own = rows.iter().filter(|r| word(r, "group") == group.id);
        for row in own {
            match Kind::of(row) {
                Some(Kind::Group) => outln!("  {} {}", word(row, "verdict"), word(row, "sentence")),
                Some(Kind::Day) => outln!(
                    "  {}: {} {}",
                    word(row, "date"),
                    word(row, "verdict"),
                    word(row, "sentence")
                ),
                Some(Kind::Change) => outln!("  {}{}", word(row, "sentence"), word(row, "remarks")),
                _ => {}
            }
        }
    }
}

/// An error where the campaign holds something that --fail-on names.
fn failed(wanted: &[FailOn], rows: &[Row]) -> Result<(), CliError> {
    let has = |what: &FailOn| -> Vec<String> {
        let named = |row: &Row, column: &str| {
            format!(
                "{} {}: {}",
                word(row, "group"),
                word(row, "date"),
                word(row, column)
            )
        };
        rows.iter()
            .filter_map(|row| match (what, Kind::of(row)?) {
                (FailOn::Unknown, Kind::Group) if word(row, "verdict") == Word::Unknown.name() => {
                    Some(named(row, "sentence"))
                }
                (FailOn::Misfit, Kind::Group) if !word(row, "misfit").is_empty() => {
                    Some(named(row, "misfit"))
                }
                (FailOn::Drift, Kind::Change) => {
                    let same = row.get("same_probability")?.as_f64()?;
                    (same < 0.5).then(|| named(row, "sentence"))
                }
                _ => None,
            })
            .collect()
    };
    let found: Vec<String> = wanted
        .iter()
        .flat_map(|what| {
            let name = match what {
                FailOn::Unknown => "unknown",
                FailOn::Misfit => "misfit",
                FailOn::Drift => "drift",
            };
            let all = has(what);
            all.into_iter()
                .map(move |w| format!("--fail-on {name}: {w}"))
        })
        .collect();
    match found.is_empty() {
        true => Ok(()),
        false => Err(CliError::Run(found.join("\nhydroline: "))),
    }
}
