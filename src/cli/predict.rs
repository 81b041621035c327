//! `hydroline predict`: the motion a plan will make, with its band.

use std::path::{Path, PathBuf};

use super::output::Output;
use super::print::{self, errln, outln};
use super::{CliError, Outcome, call, inputs, logs};
use hydroline_diagnose::Part;
use hydroline_identify::data::{check_vehicle, load};
use hydroline_identify::predict::report::pages;
use hydroline_identify::predict::residuals::{Measured, beside, plan_start_s, start_pose};
use hydroline_identify::predict::{Identified, Prediction, predict};
use hydroline_report::Quantity;
use hydroline_rigs::{Plan, Rig};
use serde::Serialize;

#[derive(Debug, clap::Args)]
#[command(after_help = "\
The band comes from the uncertainty of the coefficients: of --identified, or of a rig that `identify --write-rig` wrote.
With --measured the prediction starts where the log does (its pose before the first load, or in the first 0.5 s of it), \
and at the same moment: the first load of the log is that of the plan. The rms residual of each DOF goes to stderr.

Examples:
  hydroline predict --rig lshpi --plan surge-4n
  hydroline predict --rig my.toml --plan reversals --identified found.json --tail 5 > motion.csv
  hydroline predict --rig fitted.toml --plan surge-4n --measured run3.mcap --report out

Exit codes: 0 done; 1 the motion runs away; 2 bad arguments, rig, plan, log or identification.")]
pub struct Args {
    /// Rig file or built-in name. Without it the rig that the log of --measured carries
    #[arg(long, value_name = "RIG", required_unless_present = "measured")]
    rig: Option<String>,
    /// Plan file or built-in name
    #[arg(long, value_name = "PLAN")]
    plan: String,
    /// Output of `identify --json`: its coefficients replace the rig's, its covariance makes the band
    /// (a rig that `identify --write-rig` wrote has both in it)
    #[arg(long, value_name = "IDENTIFIED.json")]
    identified: Option<PathBuf>,
    /// Rows per second
    #[arg(long, default_value = "25", value_parser = inputs::not_negative, value_name = "HZ")]
    rate: f64,
    /// Goes on for this long after the plan's last step (coasting) [s]
    #[arg(long, default_value = "0", value_parser = inputs::not_negative, value_name = "S")]
    tail: f64,
    /// A measured run of the plan: a log with /vehicle/motion (hydroline replay makes it from images), compared with
    /// the prediction: rms residual of each DOF, and its motion in the report's figures. LOG@9..34 is a window of one
    #[arg(long, value_name = "LOG")]
    measured: Option<Part>,
    /// Takes a log whose own rig is another vehicle (name, mass or thrusters)
    #[arg(long, requires = "measured")]
    other_rig: bool,
    /// Prints one JSON object instead of CSV
    #[arg(long)]
    json: bool,
    /// Writes DIR/predict.html (the report) and predict.svg (its figures)
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    #[command(flatten)]
    output: Output,
}

/// Names of what a report's folder may hold.
const REPORT_FILES: [&str; 2] = ["predict.html", "predict.svg"];

/// Output of `--json`.
#[derive(Serialize, schemars::JsonSchema)]
pub(super) struct Printed<'a> {
    #[serde(flatten)]
    made: &'a Prediction,
    /// With --measured: the measured run beside the prediction.
    #[serde(skip_serializing_if = "Option::is_none")]
    measured: Option<&'a Measured>,
}

pub fn run(args: &Args) -> Result<Outcome, CliError> {
    let paths = args.measured.iter().map(|p| p.path.as_path());
    let mut rig = logs::rig(args.rig.as_deref(), paths)?;
    let plan = inputs::plan(&args.plan, &rig)?;
    if args.rate == 0.0 || args.rate > 10_000.0 {
        return Err(CliError::Config(format!(
            "--rate {}: give more than 0 and at most 10000",
            args.rate
        )));
    }
    if let Some(dir) = &args.report {
        args.output.folder("--report", dir, &REPORT_FILES)?;
    }
    let identified = match &args.identified {
        None => Identified::of_rig(&rig)?,
        Some(path) => {
            let text = inputs::text(path, "give the output of `hydroline identify --json`")?;
            Some(Identified::from_json(&text, &path.display().to_string())?)
        }
    };
    for words in identified.iter().flat_map(Identified::implausible) {
        errln!("WARNING {words}");
    }
    let (made, measured) = match &args.measured {
        None => (made(args, &rig, &plan, identified.as_ref())?, None),
        Some(log) => {
            let (made, measured) = compared(args, &mut rig, &plan, identified.as_ref(), log)?;
            (made, Some(measured))
        }
    };
    if identified.is_none() {
        errln!(
            "no band: the rig's coefficients carry no uncertainty; give --identified (hydroline identify LOG... --json), or a rig that identify --write-rig wrote"
        );
    }
    let of_rig = rig
        .identified
        .as_ref()
        .filter(|_| args.identified.is_none());
    if let Some(source) = of_rig.and_then(|k| k.source.as_ref()) {
        errln!("note: the band is of no run of this vehicle: {source}");
    }
    if !made.without_uncertainty.is_empty() {
        errln!(
            "note: the band is too narrow where {} are not as the rig says: they carry no uncertainty, and this plan moves their degrees of freedom; identify runs that excite them",
            made.without_uncertainty.join(", ")
        );
    }
    if let Some(measured) = &measured {
        tell(measured);
    }
    if args.json {
        let (made, measured) = (&made, measured.as_ref());
        print::json(&Printed { made, measured })?;
    } else {
        csv(&made);
    }
    if let Some(dir) = &args.report {
        report(args, dir, &rig, (&plan, &made), measured.as_ref())?;
    }
    call::offer(move || {
        let of = pages(
            &rig,
            &plan.name,
            &made,
            measured.as_ref(),
            "hydroline.predict",
        );
        of.page.html()
    });
    Ok(Outcome::Done)
}

fn made(
    args: &Args,
    rig: &Rig,
    plan: &Plan,
    identified: Option<&Identified>,
) -> Result<Prediction, CliError> {
    Ok(predict(rig, plan, identified, args.rate, args.tail)?)
}

/// The prediction from where a measured run begins, and the run beside it.
fn compared(
    args: &Args,
    rig: &mut Rig,
    plan: &Plan,
    identified: Option<&Identified>,
    part: &Part,
) -> Result<(Prediction, Measured), CliError> {
    let log = part.path.as_path();
    inputs::readable_file(log, "name a log (.mcap) that can be read")?;
    if !args.other_rig {
        for words in check_vehicle(log, rig)? {
            errln!("hydroline: {words}");
        }
    }
    let mut run = load(log, rig)?;
    if let Some((from_s, to_s)) = part.window_s {
        run = run.window(from_s, to_s);
    }
    // When the plan's first load comes does not depend on where the vehicle is.
    let first_load_s = made(args, rig, plan, None)?.first_load_s();
    let start_s = plan_start_s(&run, first_load_s);
    let pose = start_pose(&run, start_s + first_load_s.unwrap_or(0.0));
    for (start, measured) in rig.tank.start_pose.iter_mut().zip(pose) {
        *start = measured.unwrap_or(*start);
    }
    let first_s = first_load_s.unwrap_or(0.0);
    let off = beside(&made(args, rig, plan, None)?, &run, start_s)?.start_off(first_s);
    for (start, off) in rig.tank.start_pose.iter_mut().zip(off) {
        *start += off;
    }
    let made = made(args, rig, plan, identified)?;
    let mut measured = beside(&made, &run, start_s)?;
    measured.compare_loads(&made, &run);
    measured.compare(rig, &run);
    Ok((made, measured))
}

/// The rms residual of each DOF, beside what is printed.
fn tell(measured: &Measured) {
    for row in &measured.channels {
        let quantity = Quantity::of(row.channel);
        let within = row.within_two_sd.map_or(String::new(), |share| {
            format!(", {:.0} % within 2 sd", 100.0 * share)
        });
        errln!(
            "{}: rms residual {} over {} samples (largest {} at {:.2} s{within})",
            quantity.name,
            quantity.amount(row.rms),
            row.samples,
            quantity.amount(row.largest),
            row.largest_at_s
        );
    }
    if !measured.test.sentence.is_empty() {
        errln!("{}", measured.test.sentence);
    }
    for words in &measured.notes {
        errln!("WARNING {words}");
    }
}

fn report(
    args: &Args,
    dir: &Path,
    rig: &Rig,
    (plan, made): (&Plan, &Prediction),
    measured: Option<&Measured>,
) -> Result<(), CliError> {
    let command = std::env::args().collect::<Vec<_>>().join(" ");
    let pages = pages(rig, &plan.name, made, measured, &command);
    std::fs::create_dir_all(dir).map_err(|e| CliError::writing(dir, &e))?;
    let [html, svg] = REPORT_FILES.map(|name| dir.join(name));
    args.output.write(&html, pages.page.html())?;
    args.output.write(&svg, pages.svg)?;
    errln!("{}", html.display());
    Ok(())
}

fn csv(made: &Prediction) {
    let mut header = format!("t_s,{}", made.channels.join(","));
    if !made.sd.is_empty() {
        header += &made
            .channels
            .iter()
            .map(|c| format!(",{c}_sd"))
            .collect::<String>();
    }
    outln!("{header}");
    for (k, (t_s, row)) in made.t_s.iter().zip(&made.motion).enumerate() {
        let cells = row
            .iter()
            .chain(made.sd.get(k).into_iter().flatten())
            .map(|v| format!(",{v}"))
            .collect::<String>();
        outln!("{t_s}{cells}");
    }
}
