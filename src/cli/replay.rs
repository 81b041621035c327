//! `hydroline replay`: every frame of a log, or of a folder of images, extracted again.

use super::calibrated::UseArgs;
use super::live::{self, LiveArgs, Shown};
use super::many::{self, Many, Results};
use super::print::{self, errln, outln};
use super::{CliError, Outcome, images, inputs, progress};
use clap::{Args as _, FromArgMatches as _};
use hydroline_calib::analytic::IdealMap;
use hydroline_calib::calibration::MapParameters;
use hydroline_calib::plane::PlaneMap;
use hydroline_calib::{Calibration, ImageSize};
use hydroline_capture::ImageFolder;
use hydroline_core::build_info::BuildInfo;
use hydroline_core::frame::GreyRule;
use hydroline_daemon::calibrate::medium;
use hydroline_daemon::replay::gaps::Gap;
use hydroline_daemon::replay::{Options, RefineReport, Report, replay};
use hydroline_daemon::response::ResponseReport;
use hydroline_log::LogReader;
use hydroline_pose::joint::refine::Wanted;
use hydroline_pose::run::PoseRun;
use hydroline_rigs::Rig;
use schemars::JsonSchema;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Plane coordinates come from --calibration, else from the calibration in the log, else from the ideal camera of the \
rig's numbers; without a rig too they are left out. What `record` remembers is not asked: a log replays the same anywhere.

Examples:
  hydroline replay run.mcap --out run-poses.mcap
  hydroline replay run.mcap --calibration calib.toml --keep-images --out run-poses.mcap
  hydroline replay run-1.mcap run-2.mcap --rig my.toml --out poses    # into the folder poses/
  hydroline replay logs --out poses --update    # what has no poses yet
  hydroline replay run.mcap --out run-poses.mcap --live    # http://127.0.0.1:8080
  hydroline replay frames/ --rate-hz 25 --rig my.toml --out poses.mcap    # a folder of images
  hydroline replay bag.mcap --image-topic /cam/image_raw --rig my.toml --out poses.mcap

A folder without images stands for all logs in it and below it. Of several logs --out is the folder in which each gets its new \
log by its own name; a log that cannot be replayed is reported, and the others are done. --update makes it a command to repeat.

Exit codes: 0 done; 1 the log is damaged (`hydroline recover` first), or refining or smoothing fails; 2 bad arguments, \
rig or calibration, or no log with images; 3 done, but profiles that were extracted live came out otherwise with the \
same rig and settings, frames are damaged or cannot be read, fewer than half of them have a pose, the log's own rig, calibration or \
session are damaged, or some of several logs could not be replayed.")]
pub struct Args {
    /// Logs with images, folders of images (PNG, JPEG), or folders of logs
    #[arg(required = true, value_name = "LOG|FOLDER")]
    logs: Vec<PathBuf>,
    /// Rig to use instead of the one in the log
    #[arg(long, value_name = "RIG")]
    rig: Option<String>,
    /// New log; with several logs a folder, which is created
    #[arg(long, value_name = "LOG.mcap")]
    out: PathBuf,
    /// Leaves what is done: a new log that is whole and no older than its log
    #[arg(long)]
    update: bool,
    /// Topic of the logs' images; default: /camera/image, else the only one with images (of ROS 2 or Foxglove)
    #[arg(long, value_name = "TOPIC")]
    image_topic: Option<String>,
    /// Frames in a second of a folder: the number at the end of each name counts them; without it the names end with
    /// UNIX times in nanoseconds
    #[arg(long, value_parser = images::rate, value_name = "HZ")]
    rate_hz: Option<f64>,
    /// Copies the images too, so that the new log can be viewed on its own
    #[arg(long)]
    keep_images: bool,
    /// The whole-pixel stripe of the paper (central pixel) instead of the sub-pixel one
    #[arg(long)]
    whole_pixel: bool,
    #[command(flatten)]
    using: UseArgs,
    /// Refines over the whole run what is only nearly known of the rig, prints it with its sd and fits
    /// the poses under it; several with commas
    #[arg(long, value_enum, value_delimiter = ',', value_name = "WHAT")]
    refine: Vec<Refine>,
    /// Binds the poses of the run through the rig's vehicle and the log's commands, and states the
    /// smoothed sd; smoothed poses lean on the rig's coefficients: identify from unsmoothed ones
    #[arg(long)]
    smooth: bool,
    #[command(flatten)]
    live: LiveArgs,
    /// Prints one JSON object
    #[arg(long)]
    json: bool,
}

/// Property of the rig that a run may show.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Refine {
    /// The laser sheet's thickness
    Thickness,
    /// Brightness of the line (each frame's own; its mean and scatter)
    Brightness,
    /// The sheet's tilt against the rig's upright one, both ways
    SheetTilt,
    /// Refused: no image shows it
    TargetOffset,
    /// Refused: no image shows it
    FloorSlope,
}

/// Properties asked for that can be refined; those that no image shows are refused with the reason.
fn wanted(asked: &[Refine]) -> Result<Option<Wanted>, CliError> {
    let has = |what: Refine| asked.contains(&what);
    if has(Refine::TargetOffset) {
        return Err(CliError::Config(
            "--refine target-offset: frames of the target do not show where it lies in the tank: moving it moves every pose \
             with it and leaves every image as it is; measure it and give it as `origin` in the target's file"
                .to_owned(),
        ));
    }
    if has(Refine::FloorSlope) {
        return Err(CliError::Config(
            "--refine floor-slope: frames of the target do not show how the floor slopes: tilting floor and target tilts every \
             pose with them and leaves every image as it is; level it, or give the slope as floor_slope in [[physics]]"
                .to_owned(),
        ));
    }
    Ok((!asked.is_empty()).then(|| Wanted {
        tilt: has(Refine::SheetTilt),
        thickness: has(Refine::Thickness) || has(Refine::Brightness),
    }))
}

/// Output of `--json`.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct Printed {
    /// The logs in the order given.
    replays: Vec<Replayed>,
    /// Logs of several that could not be replayed.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    refused: Vec<Refused>,
}

/// A log that was not replayed.
#[derive(Debug, Serialize, JsonSchema)]
struct Refused {
    /// The log, or a folder of images.
    log: PathBuf,
    /// Reason why it was not replayed.
    error: String,
}

/// A log that was replayed.
#[derive(Debug, Serialize, JsonSchema)]
struct Replayed {
    /// The log, or a folder of images.
    log: PathBuf,
    /// The new log.
    out: PathBuf,
    /// Report on its frames.
    report: Report,
}

pub fn run(args: &Args, build: BuildInfo) -> Result<Outcome, CliError> {
    wanted(&args.refine)?;
    let rig = args.rig.as_deref().map(inputs::rig).transpose()?;
    let calibration = args.using.load()?;
    let many = Many::but(&args.logs, many::LOG, |folder| {
        ImageFolder::open(folder).is_ok()
    })?;
    if many.single {
        readable(args, &many.logs[0])?;
    }
    if args.rate_hz.is_some() && !many.logs.iter().any(|log| log.is_dir()) {
        return Err(CliError::Config(
            "--rate-hz is for folders of images; a log says itself when its frames were true"
                .to_owned(),
        ));
    }
    args.live.check()?;
    let places = places(args, &many)?;
    let shown = args.live.start(false)?;
    let of = |log: &Path| {
        let out = &places[log];
        if args.update && many::is_log_up_to_date(out, log) {
            errln!("hydroline: {}: up to date", out.display());
            return Ok(None);
        }
        if !many.single {
            readable(args, log)?;
        }
        let given = (rig.as_ref(), calibration.as_ref(), shown.as_ref());
        let made = in_folder(&many, out, || match args.update {
            // In the place of an older or broken-off one, which stays until this one is whole.
            true => {
                inputs::takes_file("--out", out)?;
                each(args, (log, out), given, build)
            }
            false => {
                inputs::new_file("--out", out)?;
                each(args, (log, out), given, build)
            }
        });
        made.map(Some)
    };
    let mut reports = Vec::new();
    let mut refused = Vec::new();
    let report = |log: &Path, done: Option<(Report, Outcome)>| {
        let Some((report, outcome)) = done else {
            return Ok(Outcome::Done);
        };
        reports.push(Replayed {
            log: log.to_owned(),
            out: places[log].clone(),
            report,
        });
        Ok(outcome)
    };
    let outcome = many.each(1, of, report, |log, error| {
        refused.push(Refused {
            log: log.to_owned(),
            error: error.to_string(),
        });
        Ok(())
    })?;
    if args.json {
        print::json(&Printed {
            replays: reports,
            refused,
        })?;
    }
    Ok(outcome)
}

/// Makes the folder of one of several results, which does not stay where there is no result.
fn in_folder<T>(
    many: &Many,
    out: &Path,
    make: impl FnOnce() -> Result<T, CliError>,
) -> Result<T, CliError> {
    let folder = match out.parent() {
        Some(folder) if !many.single && !folder.exists() => folder,
        _ => return make(),
    };
    std::fs::create_dir_all(folder).map_err(|e| CliError::writing(folder, &e))?;
    let made = make();
    if made.is_err() {
        // Only an empty one goes.
        std::fs::remove_dir(folder).ok();
    }
    made
}

/// Refuses what is no log and no folder of images, before any work is done.
fn readable(args: &Args, log: &Path) -> Result<(), CliError> {
    if log.is_dir() {
        let folder = ImageFolder::open(log)?;
        if let Some(words) = folder.skipped() {
            errln!("hydroline: {words}");
        }
        folder.frames(args.rate_hz)?;
    } else {
        inputs::readable_file(log, "name a log (.mcap) with images, or a folder of them")?;
        LogReader::open(log)?;
    }
    Ok(())
}

/// Inputs common to all logs: rig, calibration, live page.
type ForAll<'a> = (Option<&'a Rig>, Option<&'a Calibration>, Option<&'a Shown>);

/// One log into its new one.
fn each(
    args: &Args,
    (log, out): (&Path, &Path),
    (rig, calibration, shown): ForAll<'_>,
    build: BuildInfo,
) -> Result<(Report, Outcome), CliError> {
    let mut outcome = Outcome::Done;
    let (mut options, comparable) = options(args, log, rig, calibration)?;
    (options.build, options.over) = (build, args.update);
    if let Some(shown) = shown {
        let name = log.file_name().unwrap_or_default().to_string_lossy();
        let live = shown.run(live::title(&["replay", &name]), out);
        let toml = options.rig_toml.clone().or_else(|| own_rig(log));
        let rig = toml.and_then(|text| Rig::from_toml(&text, "rig", None).ok());
        options.live = Some((live, rig.map(Box::new)));
    }
    let bar = progress::bar(0, "frames");
    let result = replay(log, out, &options, &mut |frames| {
        bar.set_length(frames.max(bar.length().unwrap_or(0)));
        bar.set_position(frames);
    });
    bar.finish_and_clear();
    let (report, _) = result?;
    if !args.json {
        print_report(log, out, &report, comparable);
    }
    if comparable && report.live_different > 0 {
        errln!(
            "hydroline: {}: {} of {} profiles extracted live came out otherwise with the same rig and settings: \
                 another version recorded it (`hydroline info` shows `version`), or the extraction is not reproducible: report it as a bug",
            log.display(),
            report.live_different,
            report.live
        );
        outcome = Outcome::Lossy;
    }
    for (name, words) in &report.damaged_metadata {
        // A rig or calibration that is given takes the place of the damaged one.
        let replaced =
            name == "rig" && rig.is_some() || name == "calibration" && calibration.is_some();
        if replaced {
            continue;
        }
        errln!(
            "hydroline: {}: {words}: give --rig and --calibration from their files",
            log.display()
        );
        outcome = Outcome::Lossy;
    }
    if let Some(words) = &report.picture_blocks {
        errln!("hydroline: {}: {words}", log.display());
    }
    if let Some(words) = lacks(&report, &names(args, log, &report)) {
        errln!("hydroline: {}: {words}", log.display());
        outcome = Outcome::Lossy;
    }
    Ok((report, outcome))
}

/// One log with all of `replay`'s defaults, in silence but for what was lost: stretches without a pose, and worse.
pub(super) fn one(log: &Path, out: &Path, build: BuildInfo) -> Result<Outcome, CliError> {
    let words = [
        "replay".as_ref(),
        log.as_os_str(),
        "--out".as_ref(),
        out.as_os_str(),
        "--json".as_ref(),
    ];
    let matches = Args::augment_args(clap::Command::new("replay"))
        .try_get_matches_from(words)
        .map_err(CliError::config)?;
    let args = Args::from_arg_matches(&matches).map_err(CliError::config)?;
    inputs::new_file("--out", out)?;
    let (report, outcome) = each(&args, (log, out), (None, None, None), build)?;
    for line in gaps(&report.gaps) {
        errln!("hydroline: {}: {line}", log.display());
    }
    Ok(outcome)
}

/// The rig in a log's head, for the live page.
fn own_rig(log: &Path) -> Option<String> {
    LogReader::open(log).ok()?.rig_toml().map(str::to_owned)
}

/// Names of the frames that cannot be read: numbers, of a folder the images' files.
fn names(args: &Args, log: &Path, report: &Report) -> Vec<String> {
    let folder = ImageFolder::open(log).ok().filter(|_| log.is_dir());
    let frames = folder.and_then(|f| f.frames(args.rate_hz).ok());
    let name = |sequence: &u32| {
        let file = frames.as_ref().and_then(|f| f.file(*sequence));
        let file = file.and_then(Path::file_name);
        file.map_or_else(
            || sequence.to_string(),
            |file| file.to_string_lossy().into_owned(),
        )
    };
    report.undecodable_frames.iter().map(name).collect()
}

/// Reason why a replay is no whole result: frames that are damaged or that nobody can read, or that mostly have no pose.
fn lacks(report: &Report, names: &[String]) -> Option<String> {
    let mut lost = Vec::new();
    if report.marked_damaged > 0 {
        lost.push(format!(
            "{} of {} frames are marked as damaged by the recording and are lost",
            report.marked_damaged, report.frames
        ));
    }
    if report.undecodable > 0 {
        let more = report.undecodable - report.undecodable_frames.len() as u64;
        lost.push(format!(
            "{} of {} frames cannot be read and are lost: {}{}; why is said above, and by `hydroline doctor` of a log",
            report.undecodable,
            report.frames,
            names.join(", "),
            match more {
                0 => String::new(),
                more => format!(" and {more} more"),
            }
        ));
    }
    let without: u64 = report.without_pose.values().sum();
    // While it searched for a board, the board stood where the target would.
    let mostly = without > report.poses && !report.calibrates;
    lost.extend(mostly.then(|| {
        let most = report.without_pose.iter().max_by_key(|(_, n)| **n);
        let stated = report
            .response
            .as_ref()
            .and_then(|r| r.stated_by_rig.as_ref());
        // A response that the frames speak against is the likelier reason than what the frames look like under it.
        let reason = stated.and_then(|s| s.contradiction.as_ref()).map_or_else(
            || {
                format!(
                    "most often: {}",
                    most.map_or("", |(reason, _)| reason.as_str())
                )
            },
            |words| format!("under the camera's response that the rig states {words}"),
        );
        format!(
            "only {} of {} frames have a pose; {reason}",
            report.poses,
            report.poses + without,
        )
    }));
    (!lost.is_empty()).then(|| lost.join("; "))
}

/// Where each log's new one goes.
fn places(args: &Args, many: &Many) -> Result<Results, CliError> {
    if many.single {
        if !args.update {
            inputs::new_file("--out", &args.out)?;
        }
        return Ok(many.each_to(|_| args.out.clone()));
    }
    inputs::folder("--out", &args.out)?;
    many.results(&args.out, |name| {
        let mut name = name.as_os_str().to_owned();
        let is_log = Path::new(&name)
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("mcap"));
        if !is_log {
            // A folder's log is named after it.
            name.push(".mcap");
        }
        name.into()
    })
}

/// Rig: from --rig, else from the log's head. A log without either is extracted without plane coordinates.
/// True: rig and settings are those of the recording, so that live profiles must come out the same.
fn options(
    args: &Args,
    log: &Path,
    rig: Option<&Rig>,
    given: Option<&Calibration>,
) -> Result<(Options, bool), CliError> {
    // A folder says nothing of itself.
    let reader = match log.is_dir() {
        true => None,
        false => Some(LogReader::open(log)?),
    };
    let reader = reader.as_ref();
    // A rig or calibration that does not read may be damaged, not somebody's mistake.
    let findings = reader.map(LogReader::seal_findings).unwrap_or_default();
    let damaged: Vec<_> = findings.into_iter().filter(|f| f.damaged()).collect();
    let named = |what: &str| {
        let finding = damaged.iter().find(|f| f.name == what);
        let words = finding.map_or_else(String::new, |f| {
            format!(" ({f}: give --{what} from its file)")
        });
        format!("{what} in {}{words}", log.display())
    };
    let logged_rig = reader.and_then(LogReader::rig_toml);
    let session = reader.and_then(|r| r.metadata().get("session"));
    let own = match rig {
        Some(_) => None,
        None => logged_rig
            .map(|text| Rig::from_toml(text, &named("rig"), None))
            .transpose()?,
    };
    // A replay's profiles were not extracted live, and with settings of their own.
    let is_replay = session.is_some_and(|s| s.contains_key("replay.of"));
    let same_rig = rig.is_none_or(|r| logged_rig == Some(r.effective_toml.as_str()));
    let rig = rig.or(own.as_ref());
    let logged = reader
        .and_then(LogReader::calibration_toml)
        .map(|text| Calibration::from_toml(text, &named("calibration")))
        .transpose()?;
    let calibration = in_force(log, rig, logged.as_ref(), given);
    let run = args.using.medium.or_else(|| medium::of_log(session, rig));
    let index = |medium| medium::index_of_log(medium, session);
    let image = own.as_ref().map(|rig| ImageSize::of(&rig.camera));
    let (calibration, warning) = match (calibration, run) {
        (Some(calibration), Some(run)) => {
            let (fitted, warning) = args.using.fit_to_run(calibration, run, index(run), image)?;
            (Some(fitted), warning)
        }
        (calibration, _) => (calibration, None),
    };
    let same_calibration = same_calibration(logged.as_ref(), calibration.as_ref());
    let comparable = same_rig && same_calibration && !args.whole_pixel && !is_replay;
    if let Some(words) = warning {
        errln!("hydroline: {}: {words}", log.display());
    }
    let mut options = Options {
        keep_images: args.keep_images,
        ..Options::default()
    };
    options.rate_hz = args.rate_hz;
    if reader.is_some() {
        options.image_topic = images::topic(log, args.image_topic.as_deref())?;
    }
    options.extractor.whole_pixel = args.whole_pixel;
    options.map = calibration.as_ref().map(|c| Arc::from(c.to_map()));
    options.calibration_toml = calibration.as_ref().and_then(|c| c.to_toml().ok());
    options.calibration = calibration.filter(|_| !same_calibration);
    options.poses = rig
        .zip(options.map.clone())
        .map(|(rig, map)| PoseRun::new(rig, map));
    options.refine = wanted(&args.refine)?;
    if options.refine.is_some() && options.poses.is_none() {
        return Err(CliError::Config(format!(
            "--refine needs the rig and its target: {} holds no rig, give --rig",
            log.display()
        )));
    }
    if args.smooth {
        let rig = rig.ok_or_else(|| {
            CliError::Config(format!(
                "--smooth needs the vehicle: {} holds no rig, give --rig",
                log.display()
            ))
        })?;
        options.smooth = Some(Box::new(rig.clone()));
    }
    options.rule = rig.map_or_else(GreyRule::default, Rig::grey_rule);
    options.rig_toml = rig.map(|rig| rig.effective_toml.clone());
    Ok((options, comparable))
}

/// The calibration to use: the one named, the log's own, the rig's ideal camera, or none. Says what it is.
fn in_force(
    log: &Path,
    rig: Option<&Rig>,
    logged: Option<&Calibration>,
    given: Option<&Calibration>,
) -> Option<Calibration> {
    let name = log.display();
    // A log's ideal camera follows from its rig; under another rig it follows from that.
    let made = |c: &&Calibration| !matches!(c.map, MapParameters::Ideal(_));
    if let Some(calibration) = given.or(logged.filter(made)) {
        return Some(calibration.clone());
    }
    let ideal = rig.map(|rig| IdealMap::of(rig).describe());
    let ideal = ideal.or_else(|| logged.cloned());
    match &ideal {
        Some(_) => errln!(
            "hydroline: {name}: no calibration: plane coordinates come from the ideal camera of the rig's numbers, their sd is that of the stripe alone"
        ),
        None => errln!(
            "hydroline: {name}: no calibration and no rig in it, no --calibration and no --rig: profiles get no laser-plane coordinates"
        ),
    }
    ideal
}

/// Whether live profiles were computed with this calibration.
fn same_calibration(logged: Option<&Calibration>, used: Option<&Calibration>) -> bool {
    match (logged, used) {
        (Some(logged), Some(used)) => logged == used,
        // A log that says nothing was not written by `record`; its live profiles, if any, had the rig's map.
        (None, Some(used)) => matches!(used.map, MapParameters::Ideal(_)),
        (_, None) => true,
    }
}

fn print_refined(refined: &RefineReport) {
    outln!(
        "  refined over {} frames ({} of them gave no pose and were left out):",
        refined.frames,
        refined.failed
    );
    if let Some([thickness_m, sd_m]) = refined.thickness_m {
        outln!(
            "    sheet's thickness (standard deviation of its light) {:.4} mm, sd {:.4}",
            thickness_m * 1e3,
            sd_m * 1e3
        );
    }
    let [brightness, scatter] = refined.brightness;
    outln!(
        "    brightness of the line {brightness:.2} grey levels, from frame to frame sd {scatter:.2}"
    );
    let tilts = [
        ("pitch", refined.tilt_pitch_rad),
        ("yaw", refined.tilt_yaw_rad),
    ];
    for (name, tilt) in tilts {
        if let Some([tilt_rad, sd_rad]) = tilt {
            outln!(
                "    sheet's tilt in {name} {:.4} deg, sd {:.4}",
                tilt_rad.to_degrees(),
                sd_rad.to_degrees()
            );
        }
    }
}

/// A gamma this near to one, about its sd where there is no curve, is not worth a word.
const GAMMA_SILENT: f64 = 0.005;

/// The camera's response, where it is worth a word.
fn camera(response: &ResponseReport) -> Option<String> {
    let [gamma, gamma_sd] = response.gamma;
    let stated = response.stated_by_rig.as_ref();
    let whose = match (stated, response.found_by) {
        (Some(_), _) => "as the rig states it, the line from",
        (None, "recording") => "as the recording found it,",
        _ => "found in this log,",
    };
    if !response.known {
        return Some(response.unknown());
    }
    let contradiction = stated.and_then(|s| s.contradiction.as_deref());
    let worth = (gamma - 1.0).abs() > GAMMA_SILENT || contradiction.is_some();
    worth.then(|| {
        let against = contradiction.map_or_else(String::new, |words| format!("; but {words}"));
        format!(
            "camera's response {whose} {} frames: gamma {gamma:.3} (sd {gamma_sd:.3}), black level {:.1} (sd {:.1}){against}",
            response.frames, response.black_levels[0], response.black_levels[1]
        )
    })
}

fn print_report(log: &Path, out: &Path, report: &Report, comparable: bool) {
    outln!("{} -> {}", log.display(), out.display());
    outln!(
        "  {} frames, {} with a stripe, {} points, {} commands",
        report.frames,
        report.with_stripe,
        report.points,
        report.commands
    );
    if report.frames_missing > 0 {
        outln!(
            "  {} frames are missing: the numbers in the images' names leave them out",
            report.frames_missing
        );
    }
    if let Some(words) = &report.hidden_clipping {
        outln!("  {words}");
    }
    for (reason, n) in &report.without_stripe {
        outln!("  {n} frames without: {reason}");
    }
    for (topic, n) in &report.foreign {
        outln!("  {n} messages of {topic} not carried over: not a topic and schema of hydroline");
    }
    if let Some(refined) = &report.refined {
        print_refined(refined);
    }
    if report.poses > 0 || !report.without_pose.is_empty() {
        outln!("  {} poses in /vehicle/motion", report.poses);
    }
    if let Some(s) = &report.smoothed {
        let millimetres = |v: [f64; 6]| [v[0] * 1e3, v[1] * 1e3, v[2] * 1e3];
        let degrees = |v: [f64; 6]| [v[3], v[4], v[5]].map(f64::to_degrees);
        outln!(
            "  smoothed: sd of x y z {:.3?} mm (single frames {:.3?}), of roll pitch yaw {:.4?} deg ({:.4?}); {} frames filled in, {} downweighted, chi2 {:.2}",
            millimetres(s.sd_smoothed),
            millimetres(s.sd_single),
            degrees(s.sd_smoothed),
            degrees(s.sd_single),
            s.filled,
            s.downweighted,
            s.chi2
        );
    }
    if let Some(words) = report.response.as_ref().and_then(camera) {
        outln!("  {words}");
    }
    for line in gaps(&report.gaps) {
        outln!("  {line}");
    }
    let mut reasons: Vec<(&String, &u64)> = report.without_pose.iter().collect();
    reasons.sort_by(|a, b| b.1.cmp(a.1).then(a.0.cmp(b.0)));
    for (reason, n) in reasons.iter().take(REASONS) {
        outln!("  {n} frame(s) without a pose: {reason}");
    }
    let rest: u64 = reasons.iter().skip(REASONS).map(|r| r.1).sum();
    if rest > 0 {
        outln!("  {rest} frame(s) without a pose for other reasons (--json lists them)");
    }
    if report.live > 0 {
        outln!(
            "  {} of {} frames extracted live came out bit for bit the same{}",
            report.live_identical,
            report.live,
            match comparable {
                true => "",
                false => ": another rig, calibration or setting than the recording's was given",
            }
        );
    }
}

/// Reasons for a missing pose that are printed, the most frequent first.
const REASONS: usize = 3;
/// Stretches without a pose that are printed, the longest.
const GAPS: usize = 5;

/// From when to when there is no pose, a line each.
fn gaps(gaps: &[Gap]) -> Vec<String> {
    let length_s = |g: &Gap| g.to_s - g.from_s;
    let mut longest: Vec<&Gap> = gaps.iter().collect();
    longest.sort_by(|a, b| length_s(b).total_cmp(&length_s(a)));
    longest.truncate(GAPS);
    longest.sort_by(|a, b| a.from_s.total_cmp(&b.from_s));
    let reported = longest.into_iter().map(|gap| {
        let to = match gap.to_the_end {
            true => "to the end".to_owned(),
            false => format!("to {:.1} s", gap.to_s),
        };
        format!(
            "no pose from {:.1} s {to} ({} frames), first because: {}",
            gap.from_s, gap.frames, gap.first_reason
        )
    });
    let mut lines: Vec<String> = reported.collect();
    if gaps.len() > GAPS {
        lines.push(format!(
            "{} shorter stretches without a pose",
            gaps.len() - GAPS
        ));
    }
    lines
}
