//! `hydroline identify`: coefficients with their uncertainty from logs.

use std::path::PathBuf;

use hydroline_rigs::{Dof, Rig, ThrusterSet};

use super::fail_on::{FailOn, judged};
use super::output::Output;
use super::print::{self, errln, out, outln};
use super::progress::Stages;
use super::{CliError, Outcome, call, inputs, logs};
use hydroline_core::run::Run;
use hydroline_diagnose::Part;
use hydroline_estimate::{ModelChoice, Options, identify, refit};
use hydroline_identify::adopt::adopt;
use hydroline_identify::bollard::{self, Bollard};
use hydroline_identify::curve;
use hydroline_identify::data::{LoadError, STILL_MIN_S, check_vehicle, is_still, load};
use hydroline_identify::parameter::Coefficient;
use hydroline_identify::report::html;
use hydroline_identify::{Estimate, Identification};
use hydroline_report::significant;

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Logs need /vehicle/motion (hydroline replay makes it from images, hydroline import from tables) and, unless they are \
decay tests, /thruster/command. A log at rest for 20 s or more shows the least noise; so do the first 20 s or more of a \
run before its first load. Samples are weighed by the sd that their log says. The likelihood is that of diagnose, of the vehicle alone; \
priors of coefficients are about the rig's numbers (to some 30 %, rarely far off), and tell where runs do not.

Examples:
  hydroline identify run1.mcap run2.mcap --rig lshpi --report out
  hydroline identify tank-day/ --report out    # all logs of a folder, by the rig that they carry
  hydroline identify run1.mcap@9..34 run2.mcap --rig my.toml
  hydroline identify run1.mcap --rig my.toml --still still.mcap --write-rig fitted.toml
  hydroline identify --bollard pull.csv --rig my.toml --write-rig measured.toml
  hydroline identify run1.mcap --rig my.toml --json --fail-on misfit    # in a script

Exit codes: 0 done; 1 no coefficients could be found, or --fail-on found what it names (the result is printed and \
written all the same); 2 bad arguments, rig or logs.")]
pub struct Args {
    /// Logs, all of the same vehicle, folders of logs, or names with * or ? in quotes; LOG@9..34 is a window of one, in seconds since its
    /// first stamp
    #[arg(required_unless_present = "bollard", value_name = "LOG|FOLDER")]
    logs: Vec<Part>,
    /// Rig file or built-in name: mass, inertia, thrusters, and the priors of the coefficients. Without it the rig that the logs
    /// carry, where all carry the same
    #[arg(long, value_name = "RIG", required_unless_present = "logs")]
    rig: Option<String>,
    /// surge .. yaw (one DOF), coupled (the rig's model, all DOFs measured), or auto
    #[arg(long, default_value = "auto", value_name = "MODEL")]
    model: String,
    /// Coefficient to keep as the rig has it, e.g. k_pp (repeatable)
    #[arg(long, value_name = "KEY")]
    fix: Vec<String>,
    /// Every run starts at rest: initial velocities are known
    #[arg(long)]
    from_rest: bool,
    /// Only motion from this time of each log on [s]
    #[arg(long, value_parser = inputs::not_negative, default_value = "0", value_name = "S")]
    from: f64,
    /// Only motion up to this time of each log [s]
    #[arg(long, value_parser = inputs::not_negative, value_name = "S")]
    to: Option<f64>,
    /// Maximum likelihood: priors of coefficients and starts say nothing; what the runs do not determine is held at the rig's value
    #[arg(long)]
    flat_priors: bool,
    /// Readings of a bollard pull (pulse_us,thrust_n[,voltage_v]): fits the thrusters' curve, and
    /// uses it for the logs given, which makes the thrust scale identifiable
    #[arg(long, value_name = "DATA.csv")]
    bollard: Option<PathBuf>,
    /// Writes the rig with what was found: coefficients that the runs determine, with their covariance
    /// ([identified], of the whole budget; predict makes its band of it), and the curve of a bollard pull with its covariance
    /// ([bollard]; later fits carry it in their budgets). What was not determined keeps the rig's value with
    /// its uncertainty, and is named. A new curve ends the [identified] of the old one
    #[arg(long, value_name = "NEW.toml")]
    write_rig: Option<PathBuf>,
    /// A log of the plan `still` (>= 20 s at rest): its noise is the least that is looked for in the others. LOG@0..30 is a window of one
    #[arg(long, value_name = "LOG")]
    still: Option<Part>,
    /// Takes logs whose own rig is another vehicle (name, mass or thrusters): after a change to the rig file that is
    /// right for these logs too
    #[arg(long)]
    other_rig: bool,
    /// Ends with exit code 1 when the result holds this (several with commas), for scripts
    #[arg(long, value_enum, value_delimiter = ',', value_name = "WHAT")]
    fail_on: Vec<FailOn>,
    /// Prints one JSON object
    #[arg(long)]
    json: bool,
    /// Writes DIR/identify.html
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    #[command(flatten)]
    output: Output,
}

pub fn run(args: &Args) -> Result<Outcome, CliError> {
    let logs = &logs::opened(&args.logs)?[..];
    let paths = logs.iter().chain(&args.still).map(|p| p.path.as_path());
    let mut rig = logs::rig(args.rig.as_deref(), paths)?;
    if args.report.is_some() && args.logs.is_empty() {
        return Err(CliError::Config(
            "--report: nothing to report on without logs; give LOG... (the bollard pull's curve is printed, --json gives its covariance)".to_owned(),
        ));
    }
    if !args.fail_on.is_empty() && args.logs.is_empty() {
        return Err(CliError::Config(
            "--fail-on: nothing to judge without logs; give LOG...".to_owned(),
        ));
    }
    if let Some(path) = &args.write_rig {
        args.output.file("--write-rig", path)?;
    }
    if let Some(dir) = &args.report {
        args.output.folder("--report", dir, &["identify.html"])?;
    }
    // Before anything is measured: a word typed wrongly costs nothing yet.
    let model = model(&args.model)?;
    let fixed: Result<Vec<Coefficient>, CliError> = args
        .fix
        .iter()
        .map(|k| {
            Coefficient::find(k).ok_or_else(|| {
                CliError::Config(format!(
                    "--fix {k}: no such coefficient; they are x_udot x_u x_uu .. n_rdot n_r n_rr"
                ))
            })
        })
        .collect();
    let fixed = fixed?;
    let given = rig.thrusters.clone();
    let bollard = args
        .bollard
        .as_deref()
        .map(|path| measure_curve(path, &mut rig))
        .transpose()?;
    let outdated = match &bollard {
        Some(_) => outdated(&mut rig, &given),
        None => Vec::new(),
    };
    if let Some(found) = bollard.as_ref().filter(|_| args.logs.is_empty()) {
        if args.json {
            print::pretty_json(found)?;
        } else {
            out!("{}", found.to_toml());
        }
        write_rig(args, &rig, &outdated)?;
        return Ok(Outcome::Done);
    }
    let result = match fitted(args, logs, &rig, model, fixed) {
        Ok(found) => found,
        // A command that was wrong is typed again, and what it would have written is not in its way.
        Err(e @ CliError::Config(_)) => return Err(e),
        Err(e) => {
            if bollard.is_some() && args.write_rig.is_some() {
                if let Err(also) = write_rig(args, &rig, &outdated) {
                    errln!("hydroline: {also}");
                    return Err(e);
                }
                errln!(
                    "note: the logs gave no coefficients: the rig written holds the curve of the bollard pull only, its coefficients are those of {}",
                    args.rig.as_deref().unwrap_or(&rig.name)
                );
            }
            return Err(e);
        }
    };
    let shown = result.clone();
    call::offer(move || html(&shown, "hydroline.identify"));
    // A search may have taken hours: what can fail without it (a full disk, a folder that is not ours) comes after it is printed.
    if args.json {
        print::pretty_json(&result)?;
    } else {
        print(&result);
    }
    let reported = report(args, &result);
    if args.write_rig.is_some() {
        for words in adopt(&result, &mut rig) {
            errln!("note: not written: {words}");
        }
        if let Err(e) = write_rig(args, &rig, &outdated) {
            // Both are printed; the exit code is the same.
            if let Err(also) = reported {
                errln!("hydroline: {also}");
            }
            return Err(e);
        }
    }
    reported?;
    judged(
        &args.fail_on,
        &result.test,
        " `hydroline diagnose` says which physics the rig's model leaves out",
    )?;
    Ok(Outcome::Done)
}

/// Coefficients from the logs, with what a measured thrust curve does to them.
fn fitted(
    args: &Args,
    logs: &[Part],
    rig: &Rig,
    model: ModelChoice,
    fixed: Vec<Coefficient>,
) -> Result<Identification, CliError> {
    let runs = runs(args, logs, rig)?;
    let stages = Stages::begin("identifying");
    let tell = |what: &str| stages.tell(what);
    let options = Options {
        model,
        fixed,
        from_rest: args.from_rest,
        flat_priors: args.flat_priors,
        cross_validate: true,
        budget: true,
        progress: &tell,
    };
    let mut result = identify(&runs, rig, &options)?;
    thrust_scale(args, logs, rig, &runs, &mut result)?;
    Ok(result)
}

fn report(args: &Args, result: &Identification) -> Result<(), CliError> {
    let Some(dir) = &args.report else {
        return Ok(());
    };
    let path = dir.join("identify.html");
    let command = std::env::args().collect::<Vec<_>>().join(" ");
    std::fs::create_dir_all(dir).map_err(|e| CliError::writing(&path, &e))?;
    args.output.write(&path, html(result, &command))?;
    errln!("{}", path.display());
    Ok(())
}

/// Takes out what the rig's `[identified]` says where the thrusters' curve is another one than `before`: coefficients
/// are found in proportion to the thrust, and neither they nor their covariance belong to the new curve.
/// Returns whose.
fn outdated(rig: &mut Rig, before: &ThrusterSet) -> Vec<String> {
    let same = rig.thrusters.thrusters.len() == before.thrusters.len()
        && rig
            .thrusters
            .thrusters
            .iter()
            .zip(&before.thrusters)
            .all(|(now, was)| now.curve.points == was.curve.points);
    if same {
        return Vec::new();
    }
    rig.identified.take().map_or(Vec::new(), |k| k.coefficients)
}

/// Writes the rig that --write-rig asks for; `outdated` are coefficients whose uncertainty a new thrust curve ended.
fn write_rig(args: &Args, rig: &Rig, outdated: &[String]) -> Result<(), CliError> {
    let Some(path) = &args.write_rig else {
        return Ok(());
    };
    args.output.write(path, rig.to_toml())?;
    errln!("{}", path.display());
    let anew = rig.identified.as_ref().map(|k| &k.coefficients);
    let gone: Vec<&str> = outdated
        .iter()
        .filter(|key| anew.is_none_or(|keys| !keys.contains(key)))
        .map(String::as_str)
        .collect();
    if !gone.is_empty() {
        errln!(
            "note: {}: identified with the thrust curve that the bollard pull replaced; [vehicle] keeps the values, [identified] no longer says how well they are known: identify them again with the new rig",
            gone.join(", ")
        );
    }
    Ok(())
}

/// A log, or the window of it; the name says which window.
fn loaded(part: &Part, rig: &Rig) -> Result<Run, CliError> {
    let whole = load(&part.path, rig)?;
    let Some((from_s, to_s)) = part.window_s else {
        return Ok(whole);
    };
    let end_s = whole.end_s();
    let mut run = whole.window(from_s, to_s);
    if run.samples.is_empty() {
        return Err(CliError::from(LoadError::EmptyWindow {
            log: part.path.display().to_string(),
            from_s,
            to_s,
            end_s,
        }));
    }
    run.name = format!("{}@{from_s}..{:.2}", run.name, run.end_s());
    Ok(run)
}

/// Whether two parts of one recording hold the same motion.
fn overlap(a: &Part, b: &Part) -> bool {
    let ends = |p: &Part| p.window_s.unwrap_or((0.0, f64::INFINITY));
    let ((from, to), (begin, end)) = (ends(a), ends(b));
    from < end && begin < to
}

/// The logs' runs, and the one at rest.
fn runs(args: &Args, logs: &[Part], rig: &Rig) -> Result<Vec<Run>, CliError> {
    if !args.other_rig {
        for log in logs.iter().chain(&args.still) {
            for words in check_vehicle(&log.path, rig)? {
                errln!("hydroline: {words}");
            }
        }
    }
    let (mut runs, mut whole): (Vec<Run>, Vec<(Run, &Part)>) = (Vec::new(), Vec::new());
    for log in logs {
        let all = load(&log.path, rig)?;
        let same = |(r, part): &&(Run, &Part)| all.same_recording(r) && overlap(log, part);
        if let Some((_, first)) = whole.iter().find(same) {
            return Err(CliError::Config(format!(
                "{log} holds the same recording as {first}: counted twice it would make the intervals too narrow; give each log once"
            )));
        }
        whole.push((all, log));
        let run = loaded(log, rig)?;
        runs.push(if args.from > 0.0 || args.to.is_some() {
            run.window(args.from, args.to.unwrap_or(f64::INFINITY))
        } else {
            run
        });
    }
    if let Some(part) = &args.still {
        let all = load(&part.path, rig)?;
        let same = |(r, log): &(Run, &Part)| all.same_recording(r) && overlap(log, part);
        if whole.iter().any(same) {
            return Err(CliError::Config(format!(
                "--still {part}: the same recording is among the logs; give it once"
            )));
        }
        let still = loaded(part, rig)?;
        if !is_still(
            &still,
            [rig.tolerance.position_m, rig.tolerance.attitude_rad],
        ) {
            return Err(CliError::Config(format!(
                "--still {part}: {:.1} s, largest load {:.2}; it measures noise only when nothing was commanded and nothing moved beyond the rig's tolerance for {STILL_MIN_S} s or more (plan still)",
                still.end_s(),
                still.largest_wrench().into_iter().fold(0.0, f64::max)
            )));
        }
        runs.push(still);
    }
    Ok(runs)
}

/// Takes a measured thrust curve into the result: the thrust scale is identifiable then, the curve's uncertainty is in the budget.
fn thrust_scale(
    args: &Args,
    logs: &[Part],
    rig: &Rig,
    runs: &[Run],
    result: &mut Identification,
) -> Result<(), CliError> {
    let Some(pull) = &rig.bollard else {
        return Ok(());
    };
    let moved = curve::moved_rigs(rig);
    if moved.is_empty() {
        result.notes.push(
            "[bollard] of the rig belongs to another curve than the thrusters': its covariance was not used; measure again (identify --bollard --write-rig)".to_owned(),
        );
        return Ok(());
    }
    if !curve::is_measured(rig, runs) {
        result.notes.push(
            "the logs carry thrusts without pulses: the bollard pull's curve could not be used"
                .to_owned(),
        );
        return Ok(());
    }
    let mut values = Vec::new();
    for mut other in moved {
        // From where the fit ended: a refit is then a few steps.
        for (key, p) in &result.parameters {
            if let Some(c) = Coefficient::find(key) {
                c.put(&mut other.vehicle, p.value);
            }
        }
        let again = refit(
            &self::runs(args, logs, &other)?,
            &other,
            result,
            args.from_rest,
        )?;
        let value = |key: &String| again.values.get(key).copied().or_else(|| result.value(key));
        let of_all = result.order.iter().map(|k| value(k).unwrap_or(f64::NAN));
        values.push(of_all.collect());
    }
    curve::widen(result, &values);
    result.blind_spots.retain(|b| b.what != "thrust_scale");
    result.notes.push(format!(
        "thrust from a bollard pull (scatter {:.3} N); the curve's uncertainty is a line of the budget, and in U95",
        pull.scatter_n
    ));
    Ok(())
}

/// Fits the curve and puts it into every thruster of the rig.
fn measure_curve(path: &std::path::Path, rig: &mut Rig) -> Result<Bollard, CliError> {
    let text = inputs::text(path, "give a table pulse_us,thrust_n[,voltage_v]")?;
    let pulls = bollard::read(&text, &path.display().to_string())?;
    let set = &rig.thrusters;
    let range_us = (set.min_us, set.neutral_us, set.max_us);
    let mut found = bollard::fit(&pulls, range_us).map_err(|e| CliError::from(e).about(path))?;
    found.notes.extend(found.against(rig));
    for words in &found.notes {
        errln!("note: bollard pull: {words}");
    }
    found.put(rig)?;
    Ok(found)
}

fn model(word: &str) -> Result<ModelChoice, CliError> {
    match word {
        "auto" => Ok(ModelChoice::Auto),
        "coupled" => Ok(ModelChoice::Coupled),
        _ => Dof::ALL
            .into_iter()
            .find(|d| d.name() == word)
            .map(ModelChoice::Axis)
            .ok_or_else(|| {
                CliError::Config(format!(
                    "--model {word}: give auto, coupled, surge, sway, heave, roll, pitch or yaw"
                ))
            }),
    }
}

/// Standard uncertainty of a coefficient beside that of the samples.
fn rest(p: &Estimate) -> Option<f64> {
    let (all, own) = (p.combined_sd?, p.sd?);
    Some((all * all - own * own).max(0.0).sqrt())
}

/// Expanded uncertainties, and what has the largest share of each and would reduce it.
fn largest(result: &Identification) {
    let all = result.order.iter().filter_map(|k| result.parameters.get(k));
    for p in all.filter(|p| p.excited) {
        let (Some(u95), Some(source)) = (p.u95, &p.largest_share) else {
            continue;
        };
        let line = result.budget.iter().find(|l| l.source == *source);
        outln!(
            "  {}: U95 {} {}, most of it {source}; {} would reduce it",
            p.symbol,
            significant(u95),
            p.unit,
            line.map_or("more runs", |l| l.reduce.as_str())
        );
    }
}

fn print(result: &Identification) {
    outln!("{} ({} fits)", result.model, result.fits);
    outln!("  {}", result.test.sentence);
    if let Some(words) = result.held() {
        outln!("  {words}");
    }
    outln!(
        "  {:<9}{:>12} {:>11} {:>11}   {:<26}{:>10}  unit",
        "",
        "value",
        "+- samples",
        "+- rest",
        "95 % (samples)",
        "rig"
    );
    for p in result.order.iter().filter_map(|k| result.parameters.get(k)) {
        let number = |v: Option<f64>| v.map_or("-".to_owned(), significant);
        let remark = match (p.excited, p.at_bound, &p.profile) {
            (false, ..) => "  NOT DETERMINED by these runs",
            (_, true, _) => "  on its search range",
            (_, _, Some(_)) => "  (profile)",
            _ => "",
        };
        let interval = format!("{} .. {}", number(p.low), number(p.high));
        // The combining dot of X_u-dot takes no column.
        let width =
            9 + p.symbol.chars().count() - p.symbol.chars().filter(|c| *c != '\u{307}').count();
        outln!(
            "  {:<width$}{:>12} {:>11} {:>11}   {interval:<26}{:>10}  {}{remark}",
            p.symbol,
            significant(p.value),
            number(p.sd),
            number(rest(p)),
            significant(p.rig),
            p.unit
        );
    }
    largest(result);
    for (slot, n) in &result.noise {
        let colour = if n.noise.coloured_sd > 0.0 {
            format!(
                " + {:.3e} correlated over {:.2} s",
                n.noise.coloured_sd, n.noise.correlation_s
            )
        } else {
            " white".to_owned()
        };
        let rest = n
            .over_rest
            .map_or(String::new(), |r| format!("; {r:.2} x that at rest"));
        let logged = n.logged.map_or(String::new(), |l| {
            format!(
                "; {:.2} x the logged sd ({:.2e} .. {:.2e}), by which samples are weighed",
                l.scale, l.least_sd, l.greatest_sd
            )
        });
        outln!(
            "  noise {slot}: {:.3e}{colour}, outliers {:.2} %, from {}{rest}{logged}",
            n.noise.white_sd,
            100.0 * n.outliers,
            n.source
        );
    }
    for cv in &result.cross_validation {
        let words: Vec<String> = cv
            .left_out
            .iter()
            .map(|(c, rms)| {
                format!(
                    "{c} {rms:.3e} (fitted {:.3e})",
                    cv.fitted.get(c).copied().unwrap_or(f64::NAN)
                )
            })
            .collect();
        outln!(
            "  {} predicted by the others, rms: {}{}",
            cv.run,
            words.join(", "),
            if cv.held.is_empty() {
                String::new()
            } else {
                format!(
                    "; the others leave {} open: known there as the rig says",
                    cv.held.join(", ")
                )
            }
        );
    }
    for spot in &result.blind_spots {
        outln!(
            "  blind to {}: {}; {}",
            spot.what,
            spot.why,
            spot.experiment
        );
    }
    for note in result
        .notes
        .iter()
        .chain(result.runs.iter().flat_map(|r| &r.notes))
    {
        errln!("  note: {note}");
    }
}
