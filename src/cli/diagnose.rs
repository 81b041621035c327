//! `hydroline diagnose`: which physics the rig's model left out, from logs.

use std::path::{Path, PathBuf};

use super::fail_on::{FailOn, judged};
use super::limit::{LimitArgs, until_ctrl_c};
use super::output::Output;
use super::print::{self, errln, outln};
use super::progress::Stages;
use super::{CliError, Outcome, call, inputs, logs};
use hydroline_diagnose::verdict::{Verdict, Word};
use hydroline_diagnose::{Beside, Diagnosis, Part, Source, Watch, diagnose_beside, read, report};
use hydroline_identify::data::check_vehicle;
use hydroline_report::significant;
use hydroline_rigs::{Dof, Rig};

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Logs need /vehicle/motion (hydroline replay makes it from images, hydroline import from tables), or images: their \
stripes say what of camera, sheet, target and water the rig leaves out. The verdict is one of none, named, ambiguous, \
unknown, data_fault. Angles of rudder and elevator, shaft speed, waves and steady speeds that a log holds are inputs, and so is a DOF that moves \
though nothing commanded it and no model follows (the verdict says so). Runs that differ in kind (steps, reversals, coast-down, two tones) tell effects apart; constant \
thrust hardly does. A decay test (no thruster runs) is taken from where the hull swings freely. A log given alone is cut into \
four runs, each predicted by the others.

After --time-limit, or at Ctrl-C (the second one ends at once), the verdict is the one so far: its sentence says so and names \
what was still open (JSON: truncated), and the exit code is 0. A search that goes on may come to another verdict: \
--time-limit none waits for its end.

Examples:
  hydroline diagnose run1.mcap run2.mcap --rig lshpi --report out
  hydroline diagnose run*.mcap --rig my.toml --hold-out other.mcap --write-rig better.toml
  hydroline diagnose decay.mcap@9..34 --rig my.toml --json
  hydroline diagnose tank-day/    # all logs of a folder, by the rig that they carry
  hydroline diagnose zigzag.mcap --rig ship.toml --given sway,yaw

Exit codes: 0 there is a verdict, whichever; 1 no verdict could be reached, or --fail-on found what it names (the verdict is printed \
and written all the same); 2 bad arguments, rig or logs.")]
pub struct Args {
    /// Logs to explain, all of the same vehicle, folders of logs, or names with * or ? in quotes; LOG@9..34 is a window of one, in seconds
    /// since its first stamp
    #[arg(required = true, value_name = "LOG|FOLDER")]
    logs: Vec<Part>,
    /// Rig file or built-in name: the model that is asked what it left out. Without it the rig that the logs carry, where all carry
    /// the same
    #[arg(long, value_name = "RIG")]
    rig: Option<String>,
    /// Log that is predicted and never fitted (repeatable): an effect that predicts it worse is in no model;
    /// without any, each run is predicted by the others. LOG@34..64 is a window of one
    #[arg(long, value_name = "LOG")]
    hold_out: Vec<Part>,
    /// Takes logs whose own rig is another vehicle (name, mass or thrusters): after a change to the rig file that is
    /// right for these logs too
    #[arg(long)]
    other_rig: bool,
    /// Goes on although the data are at fault: what stands in the verdict then may be the fault's doing
    #[arg(long)]
    accept_faults: bool,
    /// Degree of freedom whose measured motion is an input and not to be explained (surge, sway, heave, roll, pitch, yaw;
    /// repeatable, or with commas): a towed or steered hull, a carriage
    #[arg(long, value_name = "DOF", value_delimiter = ',', value_parser = dof)]
    given: Vec<Dof>,
    /// Ends with exit code 1 when the result holds this (several with commas), for scripts
    #[arg(long, value_enum, value_delimiter = ',', value_name = "WHAT")]
    fail_on: Vec<FailOn>,
    #[command(flatten)]
    limit: LimitArgs,
    /// Prints one JSON object
    #[arg(long)]
    json: bool,
    /// Writes DIR/diagnose.html (the report), before-after.svg (its figure), diagnose.json, and
    /// next.toml: the plan of the next experiment
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// Writes the rig with refitted coefficients and the [[physics]] that were left out
    #[arg(long, value_name = "RIG")]
    write_rig: Option<PathBuf>,
    #[command(flatten)]
    output: Output,
}

pub(super) fn dof(name: &str) -> Result<Dof, String> {
    let found = Dof::ALL.into_iter().find(|d| d.name() == name);
    found.ok_or_else(|| {
        let known: Vec<&str> = Dof::ALL.iter().map(|d| d.name()).collect();
        format!(
            "'{name}' is no degree of freedom; one of {}",
            known.join(", ")
        )
    })
}

pub fn run(args: &Args) -> Result<Outcome, CliError> {
    let (logs, hold_out) = (logs::opened(&args.logs)?, logs::opened(&args.hold_out)?);
    let paths = logs.iter().chain(&hold_out).map(|p| p.path.as_path());
    let rig = logs::rig(args.rig.as_deref(), paths)?;
    if let Some(path) = &args.write_rig {
        args.output.file("--write-rig", path)?;
    }
    if let Some(dir) = &args.report {
        args.output.folder("--report", dir, &REPORT_FILES)?;
    }
    if let Some(held) = hold_out.iter().find(|h| logs.iter().any(|l| l.overlaps(h))) {
        return Err(CliError::Config(format!(
            "--hold-out {}: (part of) it is fitted too, and predicts nothing then; give another log, or windows that do not overlap (LOG@FROM..TO)",
            held.path.display()
        )));
    }
    for part in logs.iter().chain(&hold_out) {
        inputs::readable_file(&part.path, "name a log (.mcap) that can be read")?;
        if !args.other_rig {
            for words in check_vehicle(&part.path, &rig)? {
                errln!("hydroline: {words}");
            }
        }
    }
    let stages = Stages::begin("diagnosing");
    let tell = |what: &str| stages.tell(what);
    let load = |parts: &[Part]| -> Result<Vec<Source>, CliError> {
        let read = |part: &Part| {
            let mut source = read(part.clone(), &rig)?;
            for fault in &mut source.faults {
                fault.fatal &= !args.accept_faults;
            }
            Ok(source)
        };
        parts.iter().map(read).collect()
    };
    let beside = Beside {
        given: &args.given,
        ..Beside::default()
    };
    let (sources, held) = (load(&logs)?, load(&hold_out)?);
    let watch = Watch {
        progress: &tell,
        limit: until_ctrl_c(args.limit.begin()),
    };
    let mut found = diagnose_beside(&sources, &held, &rig, &beside, watch)?;
    drop(stages);
    if let Some(command) = fitting_too(args, (&logs, &hold_out), &held, &found.verdict) {
        let note = format!("to fit what was held out and missed, too: {command}");
        found.verdict.notes.push(note);
    }
    if let Some(dir) = &args.report {
        let page = write_report(args.output, dir, &found, &command())?;
        errln!("{}", page.display());
    }
    if let Some(path) = &args.write_rig {
        if found.verdict.verdict == Word::DataFault {
            errln!("hydroline: --write-rig: no rig written, the data are at fault");
        } else {
            args.output.write(path, found.rig.to_toml())?;
            errln!(
                "hydroline: {}: {}",
                path.display(),
                changed(&rig, &found.rig)
            );
        }
    }
    if args.json {
        print::pretty_json(&found.verdict)?;
    } else {
        print(&found.verdict);
    }
    let test = found.verdict.vehicle_alone.clone();
    call::offer(move || report::pages(&found, "hydroline.diagnose").page.html());
    judged(&args.fail_on, &test, "")?;
    Ok(Outcome::Done)
}

/// Command that fits, too, the logs held out that contradict a verdict, as a shell takes it; `None` where none does.
fn fitting_too(
    args: &Args,
    (logs, hold_out): (&[Part], &[Part]),
    held: &[Source],
    verdict: &Verdict,
) -> Option<String> {
    let is_missed = |source: &Source| {
        let name = &source.run.name;
        // A log with a gap is several runs, each named after it.
        let of_log = |log: &str| {
            log.strip_prefix(name)
                .is_some_and(|t| t.is_empty() || t.starts_with('@'))
        };
        verdict.contradicted_by.iter().any(|c| of_log(&c.log))
    };
    let mut words = vec!["hydroline".to_owned(), "diagnose".to_owned()];
    words.extend(logs.iter().map(Part::to_string));
    let mut still_held = Vec::new();
    for (part, source) in hold_out.iter().zip(held) {
        if is_missed(source) {
            words.push(part.to_string());
        } else {
            still_held.extend(["--hold-out".to_owned(), part.to_string()]);
        }
    }
    if words.len() == 2 + logs.len() {
        return None;
    }
    if let Some(rig) = &args.rig {
        words.extend(["--rig".to_owned(), rig.clone()]);
    }
    words.extend(still_held);
    let flags = [
        (args.other_rig, "--other-rig"),
        (args.accept_faults, "--accept-faults"),
    ];
    words.extend(flags.iter().filter(|f| f.0).map(|f| f.1.to_owned()));
    for dof in &args.given {
        words.extend(["--given".to_owned(), dof.name().to_owned()]);
    }
    let words: Vec<String> = words.iter().map(|w| quoted(w)).collect();
    Some(words.join(" "))
}

/// A word as a shell takes it: in quotes where it is not of letters, digits and what paths are made of.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "-_./@:+,=".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', "'\\''"))
}

/// Names of what a report's folder may hold.
const REPORT_FILES: [&str; 4] = [
    "diagnose.html",
    "diagnose.json",
    "before-after.svg",
    "next.toml",
];

/// Page, figure, verdict and next plan into a folder; the page's path.
pub(super) fn write_report(
    output: Output,
    dir: &Path,
    found: &Diagnosis,
    command: &str,
) -> Result<PathBuf, CliError> {
    let pages = report::pages(found, command);
    let json = serde_json::to_string_pretty(&found.verdict)?;
    let mut files = vec![
        ("diagnose.html", pages.page.html()),
        ("diagnose.json", json),
    ];
    if !pages.before_after_svg.is_empty() {
        files.push(("before-after.svg", pages.before_after_svg));
    }
    if let Some(next) = &found.verdict.next_experiment {
        files.push(("next.toml", next.plan_toml.clone()));
    }
    std::fs::create_dir_all(dir).map_err(|e| CliError::writing(dir, &e))?;
    for (name, text) in &files {
        output.write(&dir.join(name), text)?;
    }
    Ok(dir.join("diagnose.html"))
}

/// The command line, as it stands at the head of the report.
fn command() -> String {
    let words: Vec<String> = std::env::args().skip(1).collect();
    format!("hydroline {}", words.join(" "))
}

/// Parts of a rig that were written anew, in words.
fn changed(before: &Rig, after: &Rig) -> String {
    let known = after.identified.as_ref();
    let keys = known.map_or_else(Vec::new, |k| k.coefficients.clone());
    let mut parts = vec![match keys.is_empty() {
        true => "no coefficient".to_owned(),
        false => format!("{} with their covariance, as fitted", keys.join(", ")),
    }];
    let (old, new) = (&before.vehicle, &after.vehicle);
    for (key, from, to) in [
        ("r_bz_m", old.r_bz_m, new.r_bz_m),
        ("net_weight_n", old.net_weight_n, new.net_weight_n),
        ("heave.stiffness_npm", old.stiffness[0], new.stiffness[0]),
        ("roll.stiffness_nmprad", old.stiffness[1], new.stiffness[1]),
        ("pitch.stiffness_nmprad", old.stiffness[2], new.stiffness[2]),
    ] {
        if from != to {
            let (to, from) = (significant(to), significant(from));
            parts.push(format!("{key} {to} in place of {from}"));
        }
    }
    let new = after.physics.iter().filter(|p| !before.physics.contains(p));
    let new: Vec<&str> = new.map(|p| p.effect.as_str()).collect();
    if !new.is_empty() {
        parts.push(format!("[[physics]] {}", new.join(", ")));
    }
    parts.join("; ")
}

/// Effects that a sentence names of those that the runs cannot show.
const NAMED: usize = 4;

/// Sentence on the effects that these runs cannot show.
fn blind(spots: &[String]) -> String {
    let named = spots[..spots.len().min(NAMED)].join("; ");
    match spots.len() - spots.len().min(NAMED) {
        0 => format!("these runs cannot show {named}"),
        more => format!("these runs cannot show {named}; and {more} more (--json names them)"),
    }
}

/// A number of a table; "-" = there is none.
pub(super) fn cell(value: Option<f64>) -> String {
    value.map_or("-".to_owned(), |v| format!("{v:.3e}"))
}

pub(super) fn print(v: &Verdict) {
    outln!("{}", v.sentence);
    for words in v.vehicle_alone.misfit() {
        outln!("  the vehicle alone: {words}");
    }
    for e in &v.effects {
        let numbers: Vec<String> = e
            .parameters
            .iter()
            .map(|(n, p)| {
                format!(
                    "{n} = {} (sd {})",
                    significant(p.value),
                    p.sd.map_or("-".to_owned(), significant)
                )
            })
            .collect();
        let weight: Vec<String> = e
            .weight
            .iter()
            .map(|(c, w)| format!("{c} {w:.2e}"))
            .collect();
        outln!(
            "  {:<20} p {:.3}  weight {}  {}{}{}",
            e.effect,
            e.probability,
            weight.join(" "),
            if e.matters { "matters  " } else { "" },
            numbers.join(", "),
            e.law_note
                .as_ref()
                .map_or(String::new(), |n| format!("  LAW INEXACT: {n}"))
        );
        for note in &e.notes {
            outln!("    {note}");
        }
    }
    for u in &v.unexplained {
        let odds = u
            .log_bayes_factor
            .map(|f| format!("log Bayes factor {f:.1}"));
        let weight = u.weight.map(|w| format!("weight {w:.2e}"));
        let numbers: Vec<String> = weight.into_iter().chain(odds).collect();
        outln!("  unnamed: {} ({})", u.term, numbers.join(", "));
    }
    let open = v.candidates.iter().filter(|c| {
        (0.05..0.95).contains(&c.probability) && v.effects.iter().all(|e| e.effect != c.effect)
    });
    for c in open {
        outln!("  undecided: {} p {:.2}", c.effect, c.probability);
    }
    for set in &v.equivalent {
        outln!("  possible: {}", set.join(" + "));
    }
    if v.verdict != Word::None {
        outln!("  where: {}", v.place.regime);
    }
    for p in v.predicted() {
        outln!(
            "  {} predicted ({}): {:.3e} before, {} after, noise {}",
            p.channel,
            p.by,
            p.before,
            cell(p.after),
            cell(p.noise)
        );
    }
    for pair in v.ablation.windows(2) {
        for (channel, after) in &pair[1].predicted {
            let before = cell(pair[0].predicted.get(channel).copied());
            outln!("  + {}: {channel} {before} -> {after:.3e}", pair[1].effect);
        }
    }
    for f in &v.data_faults {
        outln!(
            "  data: {} in {} of {}: {}",
            f.fault,
            f.channel,
            f.run,
            f.evidence
        );
    }
    if !v.blind_spots.is_empty() {
        outln!("  {}", blind(&v.blind_spots));
    }
    if let Some(next) = &v.next_experiment {
        let reason = match next.reason.as_str() {
            "" => String::new(),
            words => format!(": {words}"),
        };
        outln!(
            "  next: plan {} (expected log Bayes factor {:.1}){reason}",
            next.plan,
            next.expected_log_bayes_factor
        );
    }
    for note in &v.notes {
        errln!("  note: {note}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser as _;
    use hydroline_diagnose::verdict::Contradiction;

    #[derive(Debug, clap::Parser)]
    struct Line {
        #[command(flatten)]
        args: Args,
    }

    fn source(name: &str) -> Source {
        let mut made = Source::default();
        made.run.name = name.to_owned();
        made
    }

    #[test]
    fn the_command_fits_what_was_missed_and_holds_out_the_rest() {
        let line = [
            "diagnose",
            "a.mcap",
            "--hold-out",
            "my runs/b.mcap@5..",
            "--hold-out",
            "c.mcap",
            "--rig",
            "it's.toml",
            "--other-rig",
            "--given",
            "yaw",
        ];
        let args = Line::try_parse_from(line).unwrap().args;
        let held = [source("b@5..60.00"), source("c")];
        let mut verdict = Verdict::default();
        let parts = (&args.logs[..], &args.hold_out[..]);
        assert_eq!(fitting_too(&args, parts, &held, &verdict), None);
        verdict.contradicted_by.push(Contradiction {
            log: "b@5..60.00@31.20..60.00".to_owned(),
            channel: "x_m".to_owned(),
            rms: 1.7e-3,
            band: 1.5e-4,
            p_value: 1e-9,
            outside: String::new(),
        });
        assert_eq!(
            fitting_too(&args, parts, &held, &verdict).unwrap(),
            "hydroline diagnose a.mcap 'my runs/b.mcap@5..' --rig 'it'\\''s.toml' --hold-out c.mcap --other-rig --given yaw"
        );
    }
}
