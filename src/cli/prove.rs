//! `hydroline prove`: sealed cases, diagnosed blind, scored.

mod beside;
mod unit;

pub(super) use beside::{OneHeldOut, OneInvariance, ProvedHeldOut, ProvedInvariance};

use std::path::Path;

use super::print::{self, errln, out};
use super::{CliError, Outcome, inputs, progress};
use clap::builder::RangedU64ValueParser;
use hydroline_core::build_info::BuildInfo;
use hydroline_diagnose::verdict::Verdict;
use hydroline_lab::benchmark::case::{FULL, Truth};
use hydroline_lab::benchmark::coupled::CoupledJudged;
use hydroline_lab::benchmark::disturbance::Disturbance;
use hydroline_lab::benchmark::external_law::ExternalLaw;
use hydroline_lab::benchmark::faulty::Fault;
use hydroline_lab::benchmark::images::ImageJudged;
use hydroline_lab::benchmark::instrument::Flaw;
use hydroline_lab::benchmark::score::Score;
use hydroline_lab::benchmark::score::complaint;
use hydroline_lab::benchmark::{Case, coupled, export, images};
use hydroline_lab::benchmark::{
    Category, How, Judged, Kept, ProveError, catalogue, judge, make, run as prove, score, table,
};
use schemars::JsonSchema;
use serde::Serialize;
use std::collections::BTreeMap;
use unit::Unit;

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Each case is a vehicle up to 20 % off the rig file, with effects of practical size over a background of small ones, \
laws that are not quite the library's, correlated noise, outliers and lost frames. The diagnosis sees the logs \
only. Then the key is opened. A case costs half a minute to a minute of one core.

Examples:
  hydroline prove                            # a tenth of the full set
  hydroline prove --cases 460                # the full set
  hydroline prove --cases 460 --keep proof   # the same, in as many sittings as it takes
  hydroline prove --category unnamed --cases 8
  hydroline prove --category modulated       # or composed, instrument: beside the full set
  hydroline prove --only single-7            # one case: whole verdict and key
  hydroline prove --images 90                # camera, sheet, target, water, light, or none
  hydroline prove --coupled 24               # surge, sway and yaw driven at once
  hydroline prove --held-out 80              # runs held out that are missed, or not
  hydroline prove --invariance 20            # rig scaled, a run cut in two, runs reordered
  hydroline prove --cases 46 --export cases  # tables for other tools, keys apart

Other machines: --list prints the cases that --keep does not hold yet, one per line, and `--only ID --keep DIR` does one. DIR may \
be one shared folder, or folders copied together; then the first command prints the score.
  hydroline prove --cases 46 --keep proof --list > ids
  xargs -P 2 -I ID hydroline prove --only ID --keep proof < ids
  hydroline prove --cases 46 --keep proof

Exit codes: 0 done, whatever the score; 1 a case could not be made or diagnosed; 2 bad arguments, or --keep holds \
other cases.")]
pub struct Args {
    /// Number of cases, in the proportions of the full set of 460 (with --category: of that kind)
    #[arg(long, default_value_t = FULL / 10, value_parser = some(), value_name = "N")]
    cases: usize,
    /// Cases of this kind only
    #[arg(long, value_enum)]
    category: Option<Category>,
    /// Seed of all cases
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// One case by its id (image-N: of the image level, coupled-N, held_out-N, invariance-N), with its whole verdict and its key (as one JSON object);
    /// with --keep it is laid there and nothing is printed; repeatable then
    #[arg(long, value_name = "ID", conflicts_with_all = ["cases", "category"])]
    only: Vec<String>,
    /// Prints the ids of the cases that are not in --keep, one per line
    #[arg(long, conflicts_with_all = ["only", "export", "json"])]
    list: bool,
    /// This many image-level cases instead: six effects and none in turn
    #[arg(long, value_parser = some(), value_name = "N", conflicts_with_all = ["cases", "category", "only"])]
    images: Option<usize>,
    /// This many coupled cases instead: surge, sway and yaw driven at once, an effect in one DOF, a cross term, or none
    #[arg(long, value_parser = some(), value_name = "N", conflicts_with_all = ["cases", "category", "only", "images"])]
    coupled: Option<usize>,
    /// This many cases with a run held out instead: in turn one beyond the runs fitted, of a vehicle of which they show too little (it is missed,
    /// and has to be said), and one inside of them, of a vehicle that the diagnosis describes; every third is coupled
    #[arg(long, value_parser = some(), value_name = "N", conflicts_with_all = ["cases", "category", "only", "images", "coupled", "export"])]
    held_out: Option<usize>,
    /// This many cases instead, each diagnosed four times: as it is, with the rig and all forces scaled by 60, with one run cut in two, and with the
    /// runs in the reverse order; every third is coupled
    #[arg(long, value_parser = some(), value_name = "N", conflicts_with_all = ["cases", "category", "only", "images", "coupled", "held_out", "export"])]
    invariance: Option<usize>,
    /// Folder for each judged case: what lies there already is not run again, so a long proof can be broken off
    /// (cases of another build are taken, and reported)
    #[arg(long, value_name = "DIR")]
    keep: Option<std::path::PathBuf>,
    /// Folder for the cases as tables for other tools (motion, loads, what each candidate law does along a run), their keys
    /// apart in DIR/keys; nothing is diagnosed
    #[arg(long, value_name = "DIR", conflicts_with_all = ["only", "images", "keep", "json", "no_ideal"])]
    export: Option<std::path::PathBuf>,
    /// Without the ideal observer: faster, and sets that the data cannot split count as errors
    #[arg(long)]
    no_ideal: bool,
    /// Prints one JSON object: score and every case
    #[arg(long)]
    json: bool,
}

/// At least one.
fn some() -> RangedU64ValueParser<usize> {
    RangedU64ValueParser::new().range(1..)
}

pub fn run(args: &Args, build: BuildInfo) -> Result<Outcome, CliError> {
    if let Some(folder) = &args.keep {
        inputs::folder("--keep", folder)?;
    }
    let kept = kept(args, build)?;
    if args.list {
        return unit::list(args, kept.as_ref());
    }
    match (args.only.as_slice(), &kept) {
        ([], _) => {}
        (ids, Some(kept)) => return unit::keep(args, ids, kept),
        ([id], None) => return only(args, id),
        _ => {
            return Err(CliError::Config(
                "--only: several cases at once only with --keep DIR, the folder for them"
                    .to_owned(),
            ));
        }
    }
    if let Some(count) = args.images {
        return images(args, count, kept.as_ref());
    }
    if let Some(folder) = &args.export {
        inputs::folder("--export", folder)?;
        return exported(args, folder);
    }
    if let Some(count) = args.coupled {
        return coupled(args, count, kept.as_ref());
    }
    if let Some(count) = args.held_out {
        return beside::held_out(args, count, kept.as_ref());
    }
    if let Some(count) = args.invariance {
        return beside::invariance(args, count, kept.as_ref());
    }
    let ids = catalogue(args.cases, args.category);
    let started = std::time::Instant::now();
    let run = |done: Done<'_, Judged>| prove(args.seed, &ids, how(args), kept.as_ref(), done);
    let judged = under_bar(ids.len(), "cases", kept.as_ref(), complaint, run)?;
    let total = score(&judged);
    if args.json {
        let (seed, score, cases) = (args.seed, &total, judged.as_slice());
        print::json(&Proved { seed, score, cases })?;
    } else {
        out!("{}", table::words(&total));
        // Cases that were kept took no time now.
        let run = judged.iter().filter(|j| j.seconds > 0.0).count();
        let each = judged.iter().map(|j| j.seconds).sum::<f64>() / run.max(1) as f64;
        errln!(
            "{} cases in {:.0} s; one diagnosis took {each:.1} s on average",
            judged.len(),
            started.elapsed().as_secs_f64()
        );
    }
    Ok(Outcome::Done)
}

/// Called with each case that is done.
type Done<'a, J> = &'a (dyn Fn(&J) + Sync);

/// Runs cases under a progress bar and complains of each that went wrong as it ends.
fn under_bar<J>(
    count: usize,
    what: &'static str,
    kept: Option<&Kept>,
    complaint: fn(&J) -> Option<String>,
    run: impl FnOnce(Done<'_, J>) -> Result<Vec<J>, ProveError>,
) -> Result<Vec<J>, CliError> {
    let bar = progress::bar(count as u64, what);
    let judged = run(&|j: &J| {
        if let Some(line) = complaint(j) {
            bar.suspend(|| errln!("{line}"));
        }
        bar.inc(1);
    })?;
    bar.finish_and_clear();
    say_other_builds(kept);
    Ok(judged)
}

/// Cases laid down for other tools.
fn exported(args: &Args, folder: &Path) -> Result<Outcome, CliError> {
    let count = args.coupled.unwrap_or(args.cases);
    let bar = progress::bar(count as u64, "cases laid down");
    if args.coupled.is_some() {
        for index in 0..count {
            export::coupled(folder, &coupled::make(args.seed, index)?)?;
            bar.inc(1);
        }
    } else {
        for (category, index) in catalogue(args.cases, args.category) {
            let case = make(args.seed, category, index)?;
            export::case(folder, &case, &serde_json::to_value(key(&case))?)?;
            bar.inc(1);
        }
    }
    bar.finish_and_clear();
    errln!("{count} cases in {}", folder.display());
    Ok(Outcome::Done)
}

/// Truth about a case, which only its key holds.
#[derive(Debug, Serialize, JsonSchema)]
struct Key<'a> {
    /// The effects that are there.
    truth: &'a [Truth],
    /// The effect from outside the candidate library, where there is one.
    external_law: Option<&'a ExternalLaw>,
    /// The vehicle's coefficients \[SI\].
    vehicle: BTreeMap<String, f64>,
    /// The disturbance of the motion.
    disturbance: &'a Disturbance,
    /// The fault of the data, where there is one.
    fault: Option<&'a Fault>,
    /// Flaws of the instruments.
    flaws: &'a [Flaw],
}

fn key(case: &Case) -> Key<'_> {
    Key {
        truth: &case.key.truth,
        external_law: case.key.tank.external_law.as_ref(),
        vehicle: case.key.coefficients().into_iter().collect(),
        disturbance: &case.key.tank.disturbance,
        fault: case.key.fault.as_ref(),
        flaws: &case.key.flaws,
    }
}

fn kept(args: &Args, build: BuildInfo) -> Result<Option<Kept>, CliError> {
    let folder = args.keep.as_ref();
    let kept = folder.map(|f| Kept::new(f, args.seed, &build.to_string()));
    Ok(kept.transpose()?)
}

fn say_other_builds(kept: Option<&Kept>) {
    let others = kept.map(Kept::other_builds).unwrap_or_default();
    if !others.is_empty() {
        errln!(
            "hydroline: some of the cases were diagnosed by other builds: {}",
            others.join(", ")
        );
    }
}

fn how(args: &Args) -> How {
    How {
        observe: !args.no_ideal,
    }
}

fn images(args: &Args, count: usize, kept: Option<&Kept>) -> Result<Outcome, CliError> {
    let indices: Vec<usize> = (0..count).collect();
    let run = |done: Done<'_, ImageJudged>| images::run(args.seed, &indices, kept, done);
    let judged = under_bar(count, "image cases", kept, images::complaint, run)?;
    if args.json {
        let (seed, images) = (args.seed, judged.as_slice());
        print::json(&ProvedImages { seed, images })?;
    } else {
        out!("{}", images::words(&judged));
    }
    Ok(Outcome::Done)
}

fn coupled(args: &Args, count: usize, kept: Option<&Kept>) -> Result<Outcome, CliError> {
    let indices: Vec<usize> = (0..count).collect();
    let run = |done: Done<'_, CoupledJudged>| coupled::run(args.seed, &indices, kept, done);
    let judged = under_bar(count, "coupled cases", kept, coupled::complaint, run)?;
    if args.json {
        let (seed, coupled) = (args.seed, judged.as_slice());
        print::json(&ProvedCoupled { seed, coupled })?;
    } else {
        out!("{}", coupled::words(&judged));
    }
    Ok(Outcome::Done)
}

fn only_coupled(args: &Args, index: usize) -> Result<Outcome, CliError> {
    let case = coupled::make(args.seed, index)?;
    let (judged, verdict) = coupled::judge(&case)?;
    let object = OneCoupled {
        id: &format!("coupled-{index}"),
        seed: args.seed,
        verdict: &verdict,
        judged: &judged,
    };
    printed(args, &object)?;
    Ok(Outcome::Done)
}

fn printed(args: &Args, object: &(impl Serialize + JsonSchema)) -> Result<(), CliError> {
    match args.json {
        true => print::json(object),
        false => print::pretty_json(object),
    }
}

/// Output of `--json`.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct Proved<'a> {
    /// Seed of all cases.
    seed: u64,
    /// The score.
    score: &'a Score,
    /// Every case.
    cases: &'a [Judged],
}

/// Output of `--images N --json`.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct ProvedImages<'a> {
    /// Seed of all cases.
    seed: u64,
    /// Every case.
    images: &'a [ImageJudged],
}

/// Output of `--coupled N --json`.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct ProvedCoupled<'a> {
    /// Seed of all cases.
    seed: u64,
    /// Every case.
    coupled: &'a [CoupledJudged],
}

/// Output of `--only ID`.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct One<'a> {
    /// Id of the case.
    id: &'a str,
    /// Seed of the case.
    seed: u64,
    /// The whole verdict, as `diagnose --json` prints it.
    verdict: Option<&'a Verdict>,
    /// Truth about the case, which only its key holds.
    key: Key<'a>,
    /// The case with its score, as `prove --json` prints each of its `cases`.
    judged: &'a Judged,
}

/// Output of `--only image-N`.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct OneImage<'a> {
    /// Id of the case.
    id: &'a str,
    /// Seed of the case.
    seed: u64,
    /// Verdict on the images, as `diagnose --json` prints it; `null` = nothing was found in them.
    verdict: Option<Verdict>,
    /// The case with its score, as `prove --images N --json` prints each of its `images`.
    judged: &'a ImageJudged,
}

/// Output of `--only coupled-N`.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct OneCoupled<'a> {
    /// Id of the case.
    id: &'a str,
    /// Seed of the case.
    seed: u64,
    /// The whole verdict, as `diagnose --json` prints it.
    verdict: &'a Verdict,
    /// The case with its score, as `prove --coupled N --json` prints each of its `coupled`.
    judged: &'a CoupledJudged,
}

fn only_image(args: &Args, index: usize) -> Result<Outcome, CliError> {
    let case = images::make(args.seed, index)?;
    let (judged, found) = images::judge(&case)?;
    let object = OneImage {
        id: &format!("image-{index}"),
        seed: args.seed,
        verdict: found.as_ref().map(|f| f.verdict()),
        judged: &judged,
    };
    printed(args, &object)?;
    Ok(Outcome::Done)
}

fn only(args: &Args, id: &str) -> Result<Outcome, CliError> {
    let (category, index) = match Unit::of(id)? {
        Unit::Image(index) => return only_image(args, index),
        Unit::Coupled(index) => return only_coupled(args, index),
        Unit::HeldOut(index) => return beside::only_held_out(args, index),
        Unit::Invariance(index) => return beside::only_invariance(args, index),
        Unit::Case(category, index) => (category, index),
    };
    let case = make(args.seed, category, index)?;
    let judged = judge(&case, how(args))?;
    let key = key(&case);
    let object = One {
        id,
        seed: args.seed,
        verdict: judged.verdict.as_ref(),
        key,
        judged: &judged,
    };
    printed(args, &object)?;
    errln!(
        "{}",
        complaint(&judged).unwrap_or_else(|| format!("{id}: all right"))
    );
    Ok(Outcome::Done)
}
