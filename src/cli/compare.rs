//! `hydroline compare`: two results, rigs or logs on one page.

use super::coefficients::fitted;
use super::output::Output;
use super::print::{self, out};
use super::{CliError, Outcome, inputs};
use hydroline_coefficients::{Compared, ComparedRow, Fitted};
use hydroline_exchange::edit::{Difference, differences, table_differences};
use hydroline_log::IndexedLog;
use hydroline_report::{Document, significant};
use hydroline_rigs::Rig;
use schemars::JsonSchema;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// From so many sds on a difference is named: one in twenty is as large by chance.
const NAMED_SDS: f64 = 2.0;
/// Letters of a value in a table.
const VALUE_LETTERS: usize = 32;
/// Differences of a file that are listed; the rest is counted.
const LISTED: usize = 40;
/// Keys of a log's session that are another one in each run and say nothing of the tank.
const OF_THE_RUN: [&str; 8] = [
    "boot_id",
    "sha256",
    "source",
    "plan",
    "run",
    "start_pose",
    "planned_s",
    "seed",
];

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Of results and rigs the coefficients are compared: each with its 95 % interval, the difference B - A, and that in standard \
deviations, for independent errors and at the least (whatever errors both share); all at once by both covariances. Of rigs and logs \
it is said what differs in rig, water and other conditions, and calibration.

Examples:
  hydroline compare monday.json tuesday.json
  hydroline compare my.toml fitted.toml --report compare.html
  hydroline compare monday.mcap tuesday.mcap --json

Exit codes: 0 done; 2 there is no such file, or it holds neither coefficients nor a rig.")]
pub struct Args {
    /// Output of identify --json or diagnose --json, a rig (.toml or built-in name), or a log (its rig)
    #[arg(value_name = "A")]
    first: String,
    /// The other one
    #[arg(value_name = "B")]
    second: String,
    /// Writes the same as a page
    #[arg(long, value_name = "PAGE.html")]
    report: Option<PathBuf>,
    /// Prints one JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    output: Output,
}

/// Output of `compare --json`.
#[derive(Debug, Serialize, JsonSchema)]
pub(crate) struct Printed {
    /// A as it was named.
    first: String,
    /// B as it was named.
    second: String,
    /// Coefficients.
    coefficients: Compared,
    /// Keys of the rigs that differ; `None` = one side has no rig.
    rig: Option<Vec<Difference>>,
    /// Keys of the sessions that differ: water, ballast, medium, who records; `None` = one side is no log.
    session: Option<Vec<Difference>>,
    /// Keys of the calibrations that differ; `None` = one side is no log.
    calibration: Option<Vec<Difference>>,
    /// What is not known of one side or both, one sentence each.
    missing: Vec<String>,
}

/// One side.
struct Side {
    fitted: Fitted,
    rig: Option<Rig>,
    /// Session and calibration of a log.
    log: Option<[toml::Table; 2]>,
}

pub fn run(args: &Args) -> Result<Outcome, CliError> {
    if let Some(path) = &args.report {
        args.output.file("--report", path)?;
    }
    let (first, second) = (side(&args.first)?, side(&args.second)?);
    let printed = compared(args, &first, &second);
    let document = document(&printed);
    match args.json {
        true => print::json(&printed)?,
        false => out!("{}", document.text()),
    }
    if let Some(path) = &args.report {
        args.output.write(path, document.page().html())?;
    }
    Ok(Outcome::Done)
}

fn side(argument: &str) -> Result<Side, CliError> {
    let path = Path::new(argument);
    if path.extension().is_some_and(|e| e == "mcap") {
        return of_log(path);
    }
    let fitted = fitted(argument)?;
    // A result says nothing of the rig beside its coefficients.
    let is_result = fitted.mass_kg.is_none();
    let rig = (!is_result).then(|| inputs::rig(argument)).transpose()?;
    Ok(Side {
        fitted,
        rig,
        log: None,
    })
}

fn of_log(path: &Path) -> Result<Side, CliError> {
    let log = IndexedLog::open(path)?;
    let toml = |name: &str| log.metadata().get(name).and_then(|m| m.get("toml"));
    let Some(text) = toml("rig") else {
        return Err(CliError::Config(format!(
            "{}: it carries no rig: nothing of it can be compared; give a log of `hydroline record` or `simulate`, or a result",
            path.display()
        )));
    };
    let rig = Rig::from_toml(text, &format!("rig of {}", path.display()), None)?;
    let calibration = toml("calibration").and_then(|text| text.parse().ok());
    let session = log.metadata().get("session").cloned().unwrap_or_default();
    let kept: BTreeMap<String, String> = (session.into_iter())
        .filter(|(key, _)| !OF_THE_RUN.contains(&key.as_str()))
        .collect();
    let session = kept.into_iter().map(|(key, value)| (key, typed(&value)));
    Ok(Side {
        fitted: Fitted::of_rig(&rig)?,
        rig: Some(rig),
        log: Some([session.collect(), calibration.unwrap_or_default()]),
    })
}

/// A value of a session: a number where it is one.
fn typed(text: &str) -> toml::Value {
    match text.parse::<f64>() {
        Ok(number) => toml::Value::Float(number),
        Err(_) => toml::Value::String(text.to_owned()),
    }
}

fn compared(args: &Args, first: &Side, second: &Side) -> Printed {
    let of_logs = |k: usize| {
        let (a, b) = first.log.as_ref().zip(second.log.as_ref())?;
        Some(table_differences(&a[k], &b[k]))
    };
    let names = [(&args.first, first), (&args.second, second)];
    let mut missing: Vec<String> = Vec::new();
    for (name, side) in names {
        missing.extend(unknown(&side.fitted).map(|words| format!("{name}: {words}")));
        if side.rig.is_none() {
            missing.push(format!(
                "{name}: a result does not hold its rig; what differs in the rigs shows `hydroline rig diff A.toml B.toml`"
            ));
        }
    }
    Printed {
        first: args.first.clone(),
        second: args.second.clone(),
        coefficients: Compared::of(&first.fitted, &second.fitted),
        rig: (first.rig.as_ref().zip(second.rig.as_ref())).map(|(a, b)| differences(a, b)),
        session: of_logs(0),
        calibration: of_logs(1),
        missing,
    }
}

/// What is not known of a side's coefficients.
fn unknown(fitted: &Fitted) -> impl Iterator<Item = String> {
    let none = fitted.rows.iter().all(|r| r.sd.is_none());
    let uncertainty = none.then(|| "no uncertainty of any coefficient; `hydroline identify LOG... --json` or `--write-rig` gives it".to_owned());
    let covariance = (!none && fitted.covariance.is_empty()).then(|| {
        "no covariance: its coefficients are judged one by one; that of identify --json holds it".to_owned()
    });
    let basis = fitted
        .basis
        .as_ref()
        .map(|basis| format!("its intervals are of no run of this vehicle: {basis}"));
    uncertainty.into_iter().chain(covariance).chain(basis)
}

/// A value as a table shows it: a long list is cut, and --json has all of it.
fn short(value: &Option<String>) -> String {
    let Some(value) = value else {
        return "-".to_owned();
    };
    match value.chars().count() {
        ..=VALUE_LETTERS => value.clone(),
        _ => format!(
            "{}...",
            value.chars().take(VALUE_LETTERS - 3).collect::<String>()
        ),
    }
}

/// The whole in sentences and tables.
fn document(p: &Printed) -> Document {
    let title = format!("{} (A) and {} (B)", p.first, p.second);
    let mut document = Document::new(title, lead(&p.coefficients));
    document.section("Coefficients");
    document.table(
        [
            "", "unit", "A", "95 %", "B", "95 %", "B - A", "in sds", "at least",
        ],
        p.coefficients.rows.iter().map(cells).collect(),
    );
    document.words(
        "In sds: for independent errors of A and B. At least: by the largest sd that the difference can have, whatever errors both share.",
    );
    let undetermined = |row: &ComparedRow| {
        (!row.undetermined.is_empty())
            .then(|| format!("{} (by {})", row.symbol, row.undetermined.join(" and ")))
    };
    let undetermined: Vec<String> = p
        .coefficients
        .rows
        .iter()
        .filter_map(undetermined)
        .collect();
    if !undetermined.is_empty() {
        document.words(format!(
            "Not determined by the runs, so that what stands there is the prior's and the difference is not judged: {}.",
            undetermined.join(", ")
        ));
    }
    if p.coefficients.both_beside_prior {
        document.words(
            "Both were fitted beside a rig's numbers as prior: where it was the same, differences are drawn together; `identify --flat-priors` leaves it out.",
        );
    }
    if !p.coefficients.runs_in_both.is_empty() {
        document.warning(format!(
            "runs of the same name stand in both ({}): if they are the same, the errors are not independent, and how they hang together is not known",
            p.coefficients.runs_in_both.join(", ")
        ));
    }
    for (name, found) in [
        ("Rig", &p.rig),
        ("Water and session", &p.session),
        ("Calibration", &p.calibration),
    ] {
        if let Some(found) = found {
            section(&mut document, name, found);
        }
    }
    if !p.missing.is_empty() {
        document.section("Not known");
        for words in &p.missing {
            document.words(words);
        }
    }
    document
}

/// Whether both are the same, in one sentence.
fn lead(compared: &Compared) -> String {
    let judged = compared.judged();
    if judged == 0 {
        return "No difference can be judged: no coefficient has an uncertainty by runs on both sides."
            .to_owned();
    }
    let named: Vec<&str> = compared.beyond(NAMED_SDS).map(|r| r.symbol).collect();
    let each = match named.as_slice() {
        [] => format!("None of {judged} coefficients differs by {NAMED_SDS} sds or more."),
        some => format!(
            "{} of {judged} coefficients differ by {NAMED_SDS} sds or more (one in twenty would by chance): {}.",
            some.len(),
            some.join(", ")
        ),
    };
    match &compared.together {
        None => format!("{each} All at once cannot be judged: a covariance is missing."),
        Some(t) => format!(
            "{each} All {} at once: chi2 {} on {}, as large by chance with probability {}.",
            t.keys.len(),
            significant(t.chi2),
            t.keys.len(),
            significant(t.probability)
        ),
    }
}

fn cells(row: &ComparedRow) -> Vec<String> {
    let of = |v: Option<f64>| v.map_or("-".to_owned(), significant);
    let sds = |v: Option<f64>| v.map_or("-".to_owned(), |v| format!("{v:+.1}"));
    let ends = |low: Option<f64>, high: Option<f64>| {
        let ends = low.zip(high);
        ends.map_or("-".to_owned(), |(low, high)| {
            format!("{} .. {}", significant(low), significant(high))
        })
    };
    let (a, b) = (row.first, row.second);
    vec![
        row.symbol.to_owned(),
        row.unit.to_owned(),
        of(a.map(|s| s.value)),
        ends(a.and_then(|s| s.low), a.and_then(|s| s.high)),
        of(b.map(|s| s.value)),
        ends(b.and_then(|s| s.low), b.and_then(|s| s.high)),
        of(row.difference),
        sds(row.sds),
        sds(row.sds_at_least),
    ]
}

fn section(document: &mut Document, name: &str, found: &[Difference]) {
    document.section(name);
    if found.is_empty() {
        document.words("No key differs.");
        return;
    }
    let rows = found.iter().take(LISTED).map(|d| {
        let ratio = d.ratio.map_or("-".to_owned(), significant);
        vec![d.key.clone(), short(&d.first), short(&d.second), ratio]
    });
    document.table(["key", "A", "B", "B / A"], rows.collect());
    if found.len() > LISTED {
        document.words(format!(
            "And {} more keys, which --json lists.",
            found.len() - LISTED
        ));
    }
}
