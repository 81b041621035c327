//! `hydroline record`: the daemon on the command line.

mod conditions;
mod plan_once;
mod series;
pub(super) mod until;

use super::bring_back::{self, NearArgs, Way};
use super::calibrated::{MakeArgs, UseArgs};
use super::limit::LimitArgs;
use super::live::{self, LiveArgs, Shown};
use super::output::Output;
use super::print::{self, errln, out, outln};
use super::remembered::{Memory, RememberArgs};
use super::rigging::{self, Rigged};
use super::{CliError, Outcome, inputs, progress};
use hydroline_calib::analytic::IdealMap;
use hydroline_calib::calibration::Residuals;
use hydroline_calib::plane::PlaneMap;
use hydroline_calib::{Calibration, ImageSize};
use hydroline_capture::CaptureCounts;
use hydroline_core::build_info::BuildInfo;
use hydroline_core::clock::{Clock, SystemClock};
use hydroline_core::session::Conditions;
use hydroline_core::shutdown::Shutdown;
use hydroline_daemon::calibrate::{Setup, medium};
use hydroline_daemon::record::{
    self, Job, Parts, PoseCounts, Report, SessionInput, Status, keys::Keys,
};
use hydroline_log::{FileParts, Recorder, WriteSettings, bytes_per_s, check_space};
use hydroline_plan::preflight::{Preflight, Repeats, preflight_runs};
use hydroline_rigs::{CameraBackend, Dof, LinkPort, Plan, Rig};
use hydroline_stripe::ExtractorConfig;
use hydroline_thruster::service::check_set;
use schemars::JsonSchema;
use serde::Serialize;
use series::{Alike, AtTank, Session, Work};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

#[derive(Debug, clap::Args)]
#[command(after_help = "\
While recording: Space = thrusters to neutral at once (recording goes on), q or Ctrl-C = neutral and end cleanly. \
Pressed before a plan has begun or between runs, each of them keeps the plan from starting and ends the series. \
A plan is simulated first and refused when it leaves the tank, the target, or pulse and slew limits. Just before it begins it \
is simulated again from where the camera measures the vehicle, and does not begin where it would leave the tank or the limits.

With --runs each run starts where the one before has left the vehicle, and the whole series is simulated like that; \
with --return-to-start you bring it back by hand, shown the way by the camera (\"0.12 m forward, 0.03 m left, turn 4° \
left\", also on the live page), and Enter starts the next run.

With --next the plan is proposed that says most beside the runs that are there, with its reason; Enter starts it. With \
--until-decided this goes on: each run is replayed and diagnosed, and it ends when the verdict is decided, or when no \
plan that the rig runs would decide it. A diagnosis that --time-limit or Ctrl-C ended decides nothing. The same command \
again goes on from the logs.

With --live a page in the browser shows image, pose, loads and what the run cannot show so far; its STOP does what \
Space does. The page opens on this computer alone; a phone needs --live 0.0.0.0:8080 and --live-token.

Without --calibration the latest accepted one that is remembered for this camera, medium and board is used, and said \
with its age and fit; without one, the rig's ideal camera. The log holds what was used.

Examples:
  hydroline record --rig lshpi --plan surge-4n --dry-run
  hydroline record --rig lshpi --plan surge-4n --out run.mcap
  hydroline record --rig my.toml --calibrate --board dots-50 --out calib.mcap
  hydroline record --rig my.toml --plan surge-4n --calibration calib.calibration.toml --out run.mcap
  hydroline record --rig my.toml --plan surge-4n --runs 5 --settle 2m --out run.mcap
  hydroline record --rig my.toml --plan surge-4n --runs 5 --return-to-start --out run.mcap
  hydroline record --rig my.toml --plan surge-4n --live --out run.mcap    # http://127.0.0.1:8080
  hydroline record --rig my.toml --until-decided --out run.mcap    # run-1.mcap, run-2.mcap, ...
  hydroline record --rig my.toml --for 30s --note \"still water\" --out still.mcap

Exit codes: 0 done, also when you ended it; 1 the run failed (camera, controller, a limit, no calibration, a \
vehicle from whose place the plan does not begin): what was recorded is readable; 2 bad arguments, rig, plan or calibration: \
nothing was started; 3 done, but frames were lost or damaged, the disk filled up, fewer than half of the frames looked at \
have a pose, or the controller did not confirm neutral.")]
pub struct Args {
    /// Rig file or built-in name
    #[arg(long, value_name = "RIG")]
    rig: String,
    /// Plan to run, file or built-in name; without one the thrusters stay at neutral
    #[arg(long, value_name = "PLAN")]
    plan: Option<String>,
    /// Length of the recording; default: the plan and one second, or until stopped
    #[arg(long = "for", value_parser = inputs::some_duration, allow_hyphen_values = true, value_name = "TIME")]
    length: Option<Duration>,
    /// Repeats the plan N times, each into its own log (LOG-1.mcap, LOG-2.mcap, ...)
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1000), allow_negative_numbers = true, value_name = "N")]
    runs: u32,
    /// Pause between runs, so that the water comes to rest
    #[arg(long, value_parser = inputs::duration, allow_hyphen_values = true, default_value = "0s", value_name = "TIME")]
    settle: Duration,
    /// Waits before each further run until the vehicle has been brought back to the rig's start (Enter), and shows the
    /// way there: where it is, how far forward, to the side and turned; with --next and --until-decided before the first one, too
    #[arg(long)]
    return_to_start: bool,
    /// Proposes the plan that says most beside the runs LOG-1.mcap, LOG-2.mcap, ... that are there, and records it as the next
    #[arg(long, conflicts_with_all = ["plan", "runs", "length", "no_thrusters", "calibrate", "until_decided"])]
    next: bool,
    /// Goes on so, each run replayed and diagnosed on the spot, until the verdict is decided or no plan would decide it
    #[arg(long, conflicts_with_all = ["plan", "runs", "length", "no_thrusters", "calibrate"])]
    until_decided: bool,
    /// Most runs of the series with --until-decided
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=100), allow_negative_numbers = true, requires = "until_decided", value_name = "N")]
    max_runs: u32,
    /// DOFs that the first plan of --next or --until-decided drives, with commas between; default: all that the thrusters can
    #[arg(long, value_name = "DOF", value_delimiter = ',', value_parser = super::diagnose::dof)]
    dof: Vec<Dof>,
    /// Starts what --next or --until-decided proposes without asking
    #[arg(long)]
    yes: bool,
    #[command(flatten)]
    limit: LimitArgs,
    #[command(flatten)]
    near: NearArgs,
    /// Leaves the thrusters alone: no line is opened
    #[arg(long, conflicts_with = "plan")]
    no_thrusters: bool,
    #[command(flatten)]
    using: UseArgs,
    #[command(flatten)]
    remember: RememberArgs,
    #[command(flatten)]
    making: MakeArgs,
    #[command(flatten)]
    live: LiveArgs,
    /// With a simulated camera or controller: the vehicle and [[physics]] of the tank are those of this rig, and no longer
    /// those of --rig; to try whether a diagnosis finds what differs
    #[arg(long, value_name = "RIG")]
    tank: Option<String>,
    /// Free text for the log
    #[arg(long, value_name = "TEXT")]
    note: Option<String>,
    /// Water temperature [degC], for the log and the refractive index
    #[arg(long, value_name = "DEGC", allow_negative_numbers = true)]
    water_temp: Option<f64>,
    /// Salinity [g/kg]
    #[arg(long, value_parser = inputs::not_negative, allow_negative_numbers = true, value_name = "GPKG")]
    salinity: Option<f64>,
    /// Ballast on the vehicle [kg]
    #[arg(long, value_parser = inputs::not_negative, allow_negative_numbers = true, value_name = "KG")]
    ballast: Option<f64>,
    /// Who records, for the log
    #[arg(long, value_name = "NAME")]
    operator: Option<String>,
    /// Free key for the log, as often as wanted (in its session as set.KEY); water.temperature_c, water.salinity_gpkg and
    /// ballast_kg are those of --water-temp, --salinity and --ballast
    #[arg(long, value_name = "KEY=VALUE", value_parser = conditions::key_value)]
    set: Vec<(String, String)>,
    /// Shows what the plan will do and starts nothing
    #[arg(long)]
    dry_run: bool,
    /// Prints the report as one JSON object
    #[arg(long)]
    json: bool,
    /// Longest wait for the first good frame and the controller; in a service for a measured place before a plan, too
    #[arg(long, value_parser = inputs::some_duration, allow_hyphen_values = true, default_value = "10s", value_name = "TIME")]
    ready_within: Duration,
    /// Log to write
    #[arg(long, value_name = "LOG.mcap", required_unless_present = "dry_run")]
    out: Option<PathBuf>,
}

pub fn run(args: &Args, build: BuildInfo) -> Result<Outcome, CliError> {
    let rig = inputs::rig(&args.rig)?;
    let plan = args
        .plan
        .as_deref()
        .map(|p| inputs::plan(p, &rig))
        .transpose()?;
    let tank = args.tank.as_deref().map(inputs::rig).transpose()?;
    if tank.is_some() && !simulates(&rig) {
        return Err(CliError::Config(format!(
            "--tank: neither camera nor controller of {} is simulated (backend = \"sim\", port = \"sim\"): leave it out",
            args.rig
        )));
    }
    let conditions = conditions::of(args)?;
    if conditions.n_water().map_err(CliError::Config)?.is_none() && args.salinity.is_some() {
        errln!(
            "hydroline: --salinity without --water-temp: noted in the log, but no refractive index can be made of it"
        );
    }
    if !args.no_thrusters {
        check_set(&rig.thrusters)?;
    }
    let drives = !args.no_thrusters && !rig.thrusters.link.follows();
    if !args.no_thrusters && !drives && (plan.is_some() || args.next || args.until_decided) {
        return Err(CliError::Config(
            "thrusters.link.kind = \"mavlink\": the autopilot drives, and hydroline sends it no command: no plan can run; \
             fly the manoeuvre by the autopilot and leave --plan, --next and --until-decided out"
                .to_owned(),
        ));
    }
    inputs::warn_of_flush(&rig);
    args.live.check()?;
    let calibrate = args.making.setup(&rig, &conditions)?;
    let calibration = args.using.load()?;
    if args.next || args.until_decided {
        let shown = args.live.start(true)?;
        let calibration = match calibration {
            None => {
                Memory::of_user().for_run(args.remember, &rig, medium::of_run(&rig, &conditions))?
            }
            given => given,
        };
        let session = Session {
            args,
            rig: &rig,
            conditions: &conditions,
            build,
            shown: shown.as_ref(),
            tank: tank.as_ref(),
        };
        let proposing = until::Proposing::begin(&session, calibration.clone())?;
        let work = Work::Proposed(Box::new(proposing));
        let calibrating = Calibrating {
            calibration,
            calibrate: None,
            out: None,
        };
        let mut series = AtTank::new(&session, work, calibrating)?;
        // The last thing before the runs: what fails above has begun no plan.
        if !args.dry_run {
            plan_once::PlanOnce::of_service().refuse_again()?;
        }
        return series.run();
    }
    if args.yes || !args.dof.is_empty() {
        let flag = if args.yes { "--yes" } else { "--dof" };
        return Err(CliError::Config(format!(
            "{flag} is for what --next and --until-decided propose: give one of them"
        )));
    }
    let calibration = match calibration {
        // While a board is searched for, it is the rig's camera that is asked.
        None if calibrate.is_none() => {
            let medium = medium::of_run(&rig, &conditions);
            Memory::of_user().for_run(args.remember, &rig, medium)?
        }
        given => given,
    };
    // Refused here or not at all: before anything is opened, on --dry-run as well.
    let fitted = calibration
        .clone()
        .map(|c| match args.dry_run {
            true => checked_aloud(args, &rig, &conditions, c),
            false => checked(args, &rig, &conditions, c),
        })
        .transpose()?;
    let outs: Vec<PathBuf> = match &args.out {
        Some(out) => (1..=args.runs)
            .map(|k| run_path(out, k, args.runs))
            .collect(),
        None => Vec::new(),
    };
    for out in &outs {
        inputs::new_file("--out", out)?;
    }
    let check = plan
        .as_ref()
        .map(|plan| check_plan(&rig, plan, args, fitted.as_ref().map(|(c, _)| c)))
        .transpose()?;
    if args.dry_run {
        if plan.is_none() {
            errln!(
                "hydroline: --dry-run without --plan: the rig file is sound, there is nothing to simulate"
            );
        }
        return Ok(Outcome::Done);
    }
    let Some(out) = &args.out else {
        return Err(CliError::Config("--out is missing".to_owned()));
    };
    let calibration_out = match &calibrate {
        Some(_) => Some(args.making.file(out)?),
        None => None,
    };
    let calibrating = Calibrating {
        calibration,
        calibrate,
        out: calibration_out,
    };
    let shown = args.live.start(drives)?;
    // The last thing before the runs: what fails above has begun no plan.
    let withheld = match &plan {
        Some(plan) => plan_once::PlanOnce::of_service().begin(&plan.name)?,
        None => None,
    };
    let length = match (&plan, args.length) {
        (Some(plan), None) if withheld.is_some() => Some(plan_length(plan)),
        _ => args.length,
    };
    if let Some(words) = &withheld {
        errln!("hydroline: {words}");
    }
    let session = Session {
        args,
        rig: &rig,
        conditions: &conditions,
        build,
        shown: shown.as_ref(),
        tank: tank.as_ref(),
    };
    let work = Work::Alike(Alike {
        plan: plan.as_ref().filter(|_| withheld.is_none()),
        length,
        withheld,
        rigs: run_rigs(&rig, check.as_ref(), args.runs),
        outs,
    });
    let mut series = AtTank::new(&session, work, calibrating)?;
    let result = series.run();
    if args.json {
        print::json(&Printed {
            runs: &series.reports,
        })?;
    }
    result
}

/// Whether any part of a rig is simulated.
fn simulates(rig: &Rig) -> bool {
    matches!(rig.camera.backend, CameraBackend::Sim) || rig.thrusters.link.port == LinkPort::Sim
}

/// The calibration in force and the one in the making.
struct Calibrating {
    calibration: Option<Calibration>,
    calibrate: Option<Setup>,
    /// Where an accepted one goes.
    out: Option<PathBuf>,
}

/// The rig of each run: its start is where the vehicle will be then.
fn run_rigs(rig: &Rig, check: Option<&Preflight>, runs: u32) -> Vec<Rig> {
    let starts = check.map_or(&[][..], |c| &c.starts);
    (0..runs as usize)
        .map(|k| {
            let mut rig = rig.clone();
            if let Some(start) = starts.get(k) {
                rig.tank.start_pose = start.pose;
            }
            rig
        })
        .collect()
}

/// The calibration with what must be said of its use in this run.
fn checked(
    args: &Args,
    rig: &Rig,
    conditions: &Conditions,
    calibration: Calibration,
) -> Result<(Calibration, Option<String>), CliError> {
    let run = medium::of_run(rig, conditions);
    let index = medium::index_of(
        run,
        conditions.water_temperature_c,
        conditions.salinity_gpkg,
    );
    let image = Some(ImageSize::of(&rig.camera));
    args.using.fit_to_run(calibration, run, index, image)
}

/// The same, with its warning printed.
fn checked_aloud(
    args: &Args,
    rig: &Rig,
    conditions: &Conditions,
    calibration: Calibration,
) -> Result<(Calibration, Option<String>), CliError> {
    let (calibration, warning) = checked(args, rig, conditions, calibration)?;
    if let Some(words) = &warning {
        errln!("hydroline: {words}");
    }
    Ok((calibration, warning))
}

/// Writes an accepted calibration; the log holds it too.
fn store(file: &Path, calibration: &Calibration) -> Result<(), CliError> {
    let text = calibration.to_toml()?;
    Output::default().write(file, text).map_err(|e| {
        CliError::Run(format!(
            "{e}; the log holds the calibration too, on /laser/calibration"
        ))
    })?;
    errln!("hydroline: calibration written to {}", file.display());
    Ok(())
}

/// Sequence of the runs, for the simulation before them.
fn repeats(plan: &Plan, args: &Args) -> Repeats {
    let length_s = args
        .length
        .map_or_else(|| plan.duration_s() + AROUND_PLAN_S, |l| l.as_secs_f64());
    let in_sequence = args.runs > 1 && !args.return_to_start;
    Repeats {
        runs: if in_sequence { args.runs } else { 1 },
        // Closing one log and opening the next takes a second or two more: the vehicle is then only calmer.
        cycle_s: if in_sequence {
            length_s + args.settle.as_secs_f64()
        } else {
            0.0
        },
        active_s: length_s,
    }
}

/// Simulates the plan, all runs of it; shows it on --dry-run, refuses a bad one always.
fn check_plan(
    rig: &Rig,
    plan: &Plan,
    args: &Args,
    calibration: Option<&Calibration>,
) -> Result<Preflight, CliError> {
    let map = calibration.map(Calibration::to_map);
    let report = preflight_runs(rig, plan, repeats(plan, args), map.as_deref())?;
    if args.dry_run {
        if args.json {
            print::json(&report)?;
        } else {
            out!("{report}");
            if args.return_to_start && args.runs > 1 {
                outln!(
                    "{} runs, each from the rig's start: you bring the vehicle back, Enter starts the next",
                    args.runs
                );
            }
        }
    }
    match report.violations.first() {
        None => Ok(report),
        Some(first) => Err(CliError::Config(format!(
            "plan '{}' is refused: {}{}; {}; --dry-run shows the whole check{}",
            plan.name,
            first,
            if report.violations.len() > 1 {
                format!(" (and {} more)", report.violations.len() - 1)
            } else {
                String::new()
            },
            super::plan::size_that_fits(
                rig,
                plan,
                args.plan.as_deref().unwrap_or(&plan.name),
                repeats(plan, args),
                map.as_deref()
            ),
            if report.runs > 1 {
                ", or bring the vehicle back between the runs (--return-to-start)"
            } else {
                ""
            },
        ))),
    }
}

/// LOG.mcap for one run, LOG-k.mcap for several.
fn run_path(out: &Path, k: u32, runs: u32) -> PathBuf {
    if runs == 1 {
        return out.to_owned();
    }
    let stem = out.file_stem().unwrap_or_default().to_string_lossy();
    let extension = out
        .extension()
        .map_or_else(String::new, |e| format!(".{}", e.to_string_lossy()));
    out.with_file_name(format!("{stem}-{k}{extension}"))
}

/// Whether Space or q was pressed: between runs both mean that no plan starts any more.
fn stopped(keys: Option<&Keys>) -> bool {
    keys.is_some_and(|keys| keys.space() || keys.quit())
}

/// Waits between runs; false when a signal, a key or the page's STOP ended the wait.
fn settle(pause: Duration, session: &Session<'_>) -> Result<bool, CliError> {
    let signals = hydroline_daemon::signals::listen().map_err(CliError::run)?;
    let keys = Keys::watch(None);
    let bar = progress::bar(pause.as_secs(), "settling [s]");
    let end = Instant::now() + pause;
    loop {
        if signals.heard().is_some() || stopped(keys.as_ref()) || session.stopped() {
            return Ok(false);
        }
        let left = end.saturating_duration_since(Instant::now());
        if left.is_zero() {
            bar.finish_and_clear();
            return Ok(!keys.is_some_and(Keys::finish));
        }
        bar.set_position((pause - left).as_secs());
        std::thread::sleep(left.min(Duration::from_millis(50)));
    }
}

/// Recorded around a plan \[s\]: half a second of lead and one second after it, so that the log shows rest, motion and
/// the beginning of coasting.
const AROUND_PLAN_S: f64 = 1.5;

/// Length of the recording of a plan.
fn plan_length(plan: &Plan) -> Duration {
    Duration::from_secs_f64(plan.duration_s() + AROUND_PLAN_S)
}

/// One run: everything opened, recorded, closed.
pub(super) struct Recording<'a> {
    pub rig: &'a Rig,
    pub plan: Option<&'a Plan>,
    /// Why the plan that was asked for is not run; `None` = it is.
    pub withheld: Option<&'a str>,
    pub conditions: &'a Conditions,
    /// Run k of n, from 1.
    pub run: (u32, u32),
    /// `None` = the plan and a second and a half, or until stopped.
    pub length: Option<Duration>,
    pub ready_within: Duration,
    pub with_thrusters: bool,
    /// The calibration in force, and what must be said of its use; `None` = the rig's ideal camera.
    pub calibration: Option<(Calibration, Option<String>)>,
    /// The calibration in the making.
    pub calibrate: Option<Setup>,
    /// The recording program.
    pub build: BuildInfo,
    /// Where it shows itself.
    pub live: Option<hydroline_daemon::live::Live>,
    /// The rig whose vehicle and physics simulated parts have; `None` = this one's.
    pub tank: Option<&'a Rig>,
    /// Whether nobody watches: no plan begins at a place that is not measured.
    pub unattended: bool,
}

impl Recording<'_> {
    /// The calibration in force, and what must be said of it.
    fn in_force(&self) -> (Calibration, Option<String>) {
        match &self.calibration {
            Some(given) => given.clone(),
            None => {
                let ideal = IdealMap::of(self.rig).describe();
                let run = medium::of_run(self.rig, self.conditions);
                // The ideal map is never refused, only warned of.
                let warning = medium::check(&ideal, run, true).unwrap_or_default();
                (ideal, warning)
            }
        }
    }

    fn length(&self) -> Option<Duration> {
        self.length.or(self.plan.map(plan_length))
    }

    pub fn record(&self, out: &Path) -> Result<Report, CliError> {
        let clock: Arc<dyn Clock> = Arc::new(SystemClock);
        let camera = &self.rig.camera;
        let length = self.length();
        if let Some(length) = length {
            // Bytes as they come from the camera: what compression saves is not guaranteed.
            let bytes_per_s = bytes_per_s(camera);
            check_space(
                out,
                length.as_secs_f64(),
                bytes_per_s,
                self.rig.log.min_free_bytes,
            )?;
        }
        if let (Some(length), Some(plan)) = (length, self.plan)
            && length.as_secs_f64()
                < plan.duration_s() + hydroline_daemon::record::LEAD.as_secs_f64()
        {
            errln!(
                "hydroline: --for {:.1} s is shorter than plan '{}' ({:.1} s, begun half a second in): the plan will be cut",
                length.as_secs_f64(),
                plan.name,
                plan.duration_s()
            );
        }
        let Rigged {
            source,
            line,
            vehicle,
            controller,
        } = rigging::open_with_board(
            self.rig,
            &clock,
            self.with_thrusters,
            self.calibrate.as_ref().map(|setup| &setup.board),
            self.tank,
        )?;
        let (calibration, warning) = self.in_force();
        let map: Arc<dyn PlaneMap> = Arc::from(calibration.to_map());
        let description = source.describe();
        let mut head = record::head(&SessionInput {
            rig: self.rig,
            plan: self.plan,
            planned_s: length.map(|l| l.as_secs_f64()),
            source: &description,
            conditions: self.conditions,
            calibration_toml: calibration.to_toml().ok(),
            run: self.run,
            build: self.build,
        })
        .map_err(CliError::Config)?;
        if let Some(words) = warning {
            head.session.insert("calibration.warning".to_owned(), words);
        }
        if let Some(words) = self.withheld {
            head.session
                .insert("plan.withheld".to_owned(), words.to_owned());
        }
        let opener = Box::new(FileParts {
            path: out.to_owned(),
            replace: false,
        });
        let settings = WriteSettings::live(&self.rig.log, Some(camera.pixel_format));
        let recorder = Recorder::start(opener, head, settings, clock.clone())?;
        if let Some((vehicle, start_ns)) = &vehicle {
            vehicle.log_truth(
                recorder.clone(),
                clock.triple().monotonic_to_unix_ns(*start_ns),
            );
        }
        let _log_lines = hydroline_daemon::diagnostics::into_log(&recorder);
        let job = Job {
            rig: self.rig.clone(),
            plan: self.plan.cloned(),
            length,
            ready_within: self.ready_within,
            extractor: ExtractorConfig::default(),
            calibrate: self.calibrate.clone(),
            unattended: self.unattended,
        };
        let bar = progress::bar(length.map_or(0, |l| l.as_secs()), "recording [s]");
        let parts = Parts {
            source,
            line,
            recorder,
            clock,
            map: Some(map),
            live: self.live.clone(),
        };
        let shown = bar.clone();
        let watch = Box::new(move |status: &Status| show(&shown, status));
        let result = record::run(parts, &job, &Shutdown::new(), watch);
        bar.finish_and_clear();
        drop(controller);
        Ok(result?)
    }
}

fn show(bar: &indicatif::ProgressBar, status: &Status) {
    let Some(elapsed_s) = status.elapsed_s else {
        bar.set_message("waiting for camera and controller");
        return;
    };
    bar.set_position(elapsed_s as u64);
    let calibration = status
        .calibration
        .as_ref()
        .map_or_else(String::new, |line| format!(", {line}"));
    bar.set_message(format!(
        "{} frames, {} lost, stripe {}, {:.0} MB{calibration}",
        status.frames,
        status.lost + status.dropped,
        status.points,
        status.bytes as f64 / 1e6,
    ));
}

/// Runs as --json prints them.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct Printed<'a> {
    /// The runs in turn.
    runs: &'a [Recorded],
}

/// A run that was recorded.
#[derive(Debug, Serialize, JsonSchema)]
struct Recorded {
    /// The log.
    log: PathBuf,
    /// Its files: more than one where it went on in a new part.
    files: Vec<PathBuf>,
    /// Why the run ended.
    stop: String,
    /// Whether anything was lost.
    lost: bool,
    /// The account of frames.
    capture: CaptureCounts,
    /// Frames that the log did not take since the disk was too slow.
    frames_dropped: u64,
    /// Frames whose stripe was extracted while recording.
    frames_analysed: u64,
    /// Frames that a newer one replaced before that; `replay` extracts all.
    frames_not_analysed: u64,
    /// Frames that nothing marks and that could not be read while recording (marked ones: `capture.excluded`).
    frames_damaged: u64,
    /// Account of the stripes that were offered to the pose's fit; `None` = no poses in this recording.
    poses: Option<PoseCounts>,
    /// Sets of commands sent; `None` = without thrusters.
    command_sets: Option<u64>,
    /// Sets of commands that the controller echoed; `None` = without thrusters.
    command_sets_echoed: Option<u64>,
    /// Whether the controller confirmed neutral at the end; `None` = without thrusters.
    neutral_confirmed: Option<bool>,
    /// Bytes of the log.
    bytes: u64,
    /// With --calibrate: what came of it.
    calibration: Option<RecordedCalibration>,
}

/// A calibration in the making.
#[derive(Debug, Serialize, JsonSchema)]
struct RecordedCalibration {
    /// Whether one was accepted.
    accepted: bool,
    /// Its claim, in words; `None` = none was accepted.
    claim: Option<String>,
    /// Residuals of the board's nodes under its map; `None` = none was accepted.
    residuals: Option<Residuals>,
    /// Things that are missing for one, in words; empty where it was accepted.
    missing: String,
}

fn json_report(out: &Path, report: &Report) -> Recorded {
    let calibration = |c: &record::Calibrating| RecordedCalibration {
        accepted: c.accepted.is_some(),
        claim: c.accepted.as_ref().map(Calibration::claim),
        residuals: c.accepted.as_ref().and_then(|c| c.residuals),
        missing: c.missing.clone(),
    };
    Recorded {
        log: out.to_owned(),
        files: report.log.files.clone(),
        stop: report.stop.to_string(),
        lost: report.lost_anything(),
        capture: report.capture,
        frames_dropped: report.log.counts.frames_dropped,
        frames_analysed: report.analysed,
        frames_not_analysed: report.skipped,
        frames_damaged: report.unusable.damaged,
        poses: report.poses.clone(),
        command_sets: report.thrusters.map(|t| t.sets),
        command_sets_echoed: report.thrusters.map(|t| t.echoed),
        neutral_confirmed: report.thrusters.map(|t| !t.neutral_open),
        bytes: report.log.counts.bytes,
        calibration: report.calibration.as_ref().map(calibration),
    }
}

fn print_report(out: &Path, report: &Report) {
    let capture = &report.capture;
    outln!("{}: {}", out.display(), report.stop);
    outln!(
        "  frames: {} received + {} lost = {} expected; {} dropped by the log, {} extracted live",
        capture.received,
        capture.lost.total(),
        capture.expected,
        report.log.counts.frames_dropped,
        report.analysed,
    );
    if let Some(words) = report.unusable.words() {
        outln!("  kept and not used: {words}");
    }
    if capture.disagreement != 0 {
        outln!(
            "  the count by time differs by {} frames: see the log's events",
            capture.disagreement
        );
    }
    if let Some(poses) = &report.poses {
        let none: u64 = poses.none.values().sum();
        outln!(
            "  poses: {} fitted, {} flagged as misfit and {none} without a pose (not in the log), {} skipped for want of time: replay fits them",
            poses.fitted,
            poses.flagged,
            poses.skipped,
        );
    }
    if let Some(stats) = &report.thrusters {
        outln!(
            "  commands: {} sets sent, {} echoed, {} link losses",
            stats.sets,
            stats.echoed,
            stats.losses
        );
    }
    if let Some(accepted) = report
        .calibration
        .as_ref()
        .and_then(|c| c.accepted.as_ref())
    {
        outln!("  calibration accepted: {}", accepted.claim());
    }
    for file in report.log.files.iter().filter(|f| f.as_path() != out) {
        outln!("  and {}", file.display());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn several_runs_get_a_number_each() {
        assert_eq!(
            run_path(Path::new("/a/run.mcap"), 1, 1),
            Path::new("/a/run.mcap")
        );
        assert_eq!(
            run_path(Path::new("/a/run.mcap"), 2, 3),
            Path::new("/a/run-2.mcap")
        );
    }
}
