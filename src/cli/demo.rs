//! `hydroline demo`: the main job end to end on the built-in rig, without hardware.

use super::diagnose::{self, cell};
use super::limit::{LimitArgs, until_signal};
use super::output::Output;
use super::print::outln;
use super::record::Recording;
use super::{CliError, Outcome, inputs, progress};
use hydroline_calib::analytic::IdealMap;
use hydroline_calib::plane::PlaneMap;
use hydroline_core::build_info::BuildInfo;
use hydroline_core::run::Run;
use hydroline_core::session::Conditions;
use hydroline_core::shutdown::StopReason;
use hydroline_daemon::record::{Report, floor};
use hydroline_daemon::replay::{self, replay};
use hydroline_diagnose::{Beside, Source, Watch, diagnose_beside, read};
use hydroline_estimate::{ModelChoice, Options, identify};
use hydroline_identify::data::load;
use hydroline_log::{LogReader, Record};
use hydroline_plan::preflight::preflight;
use hydroline_pose::run::PoseRun;
use hydroline_report::significant;
use hydroline_rigs::{Dof, Plan, Rig};
use hydroline_stripe::{Extractor, ExtractorConfig, annotate};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// Ahead from rest, and ahead and astern in turns: constant thrust alone could not tell a lag from its confusable effects.
const PLANS: [&str; 2] = ["surge-8n", "reversals"];
/// Physics that the simulated vehicle has and the rig that identifies and diagnoses it has not.
const LEFT_OUT: &str = "[[physics]]\neffect = \"thruster_lag\"\nlag_s = 0.25\n";

#[derive(Debug, clap::Args)]
#[command(after_help = "\
The two runs are recorded in real time (36 s), as the daemon would at the tank, with a simulated camera and a \
simulated controller on a pseudo-terminal; the whole takes less than two minutes. The simulated thrusters lag by \
0.25 s and the rig that the runs are then analysed with does not know: diagnose must find it, from the poses of the \
recorded frames. `hydroline simulate` does not wait for the clock.

Examples:
  hydroline demo
  hydroline demo --out /tmp/demo

Exit codes: 0 done; 1 it failed; 2 the folder exists already; 3 done, but frames were lost (is the computer busy?).")]
pub struct Args {
    /// Folder for the logs; it must not exist yet
    #[arg(long, value_name = "DIR", default_value = "hydroline-demo")]
    out: PathBuf,
    #[command(flatten)]
    limit: LimitArgs,
}

pub fn run(args: &Args, build: BuildInfo) -> Result<Outcome, CliError> {
    if args.out.symlink_metadata().is_ok() {
        return Err(CliError::Config(format!(
            "{} exists; name another --out or remove it",
            args.out.display()
        )));
    }
    inputs::folder("--out", &args.out)?;
    std::fs::create_dir_all(&args.out).map_err(|e| CliError::writing(&args.out, &e))?;
    let rig = Rig::builtin("lshpi")?;
    let vehicle = Rig::from_toml(
        &format!("{}\n{LEFT_OUT}", rig.effective_toml),
        "lshpi with a lag",
        None,
    )?;
    let mut lossy = false;
    for name in PLANS {
        let plan = Plan::builtin(name)?;
        lossy |= one_run(args, &rig, &vehicle, &plan, name, build)?;
    }
    let stripes: Vec<PathBuf> = PLANS.iter().map(|n| stripes(&args.out, n)).collect();
    identified(&rig, &stripes)?;
    diagnosed(&rig, &args.out, args.limit)?;
    outln!();
    outln!("Everything is in {}. Look closer:", args.out.display());
    outln!(
        "  hydroline info {}",
        args.out.join("surge-8n.mcap").display()
    );
    outln!(
        "  hydroline doctor {}",
        args.out.join("surge-8n.mcap").display()
    );
    outln!("  or open the .mcap files in Foxglove: /camera/image with /camera/annotations over it");
    Ok(Outcome::of(lossy))
}

/// The log that a run is replayed into: stripes and poses, no images.
fn stripes(out: &Path, name: &str) -> PathBuf {
    out.join(format!("{name}-stripes.mcap"))
}

/// The vehicle's coefficients, by the model that lacks the lag.
fn identified(rig: &Rig, stripes: &[PathBuf]) -> Result<(), CliError> {
    let runs: Result<Vec<Run>, _> = stripes.iter().map(|p| load(p, rig)).collect();
    let options = Options {
        model: ModelChoice::Axis(Dof::Surge),
        cross_validate: false,
        budget: false,
        ..Options::default()
    };
    let found = identify(&runs?, rig, &options)?;
    outln!();
    outln!("identify, with a model that knows of no lag:");
    for p in found.order.iter().filter_map(|k| found.parameters.get(k)) {
        outln!(
            "  {:<8} {} +- {} {} (simulated with {})",
            p.symbol,
            significant(p.value),
            p.sd.map_or("-".to_owned(), significant),
            p.unit,
            significant(p.rig)
        );
    }
    Ok(())
}

/// Diagnoses the runs; prints the verdict, and writes the report and a rig with the physics that was left out.
fn diagnosed(rig: &Rig, out: &Path, limit: LimitArgs) -> Result<(), CliError> {
    let run = |name: &&str| -> Result<Source, CliError> {
        let recorded = out.join(format!("{name}.mcap"));
        Ok(read(&stripes(out, name), rig)?.with_frames_of(&recorded))
    };
    let sources: Result<Vec<Source>, _> = PLANS.iter().map(run).collect();
    let stages = progress::Stages::begin("diagnosing");
    let watch = Watch {
        progress: &|what| stages.tell(what),
        limit: until_signal(limit.begin())?,
    };
    let found = diagnose_beside(&sources?, &[], rig, &Beside::default(), watch);
    drop(stages);
    let found = found?;
    let page = diagnose::write_report(Output::default(), out, &found, "hydroline demo")?;
    let rig_file = out.join("rig-with-what-was-left-out.toml");
    Output::default().write(&rig_file, found.rig.to_toml())?;
    outln!();
    outln!("diagnose: {}", found.verdict.sentence);
    for p in found.verdict.predicted() {
        outln!(
            "  {}, {}: rms {:.2e} before, {} after, noise {}",
            p.channel,
            p.by,
            p.before,
            cell(p.after),
            cell(p.noise)
        );
    }
    outln!("  {}", page.display());
    outln!("  {}", rig_file.display());
    Ok(())
}

/// Records with the simulated vehicle, replays with the rig and describes one run; true when something was lost.
fn one_run(
    args: &Args,
    rig: &Rig,
    vehicle: &Rig,
    plan: &Plan,
    name: &str,
    build: BuildInfo,
) -> Result<bool, CliError> {
    let check = preflight(vehicle, plan)?;
    outln!(
        "{name}: {:.1} s, recorded in real time ...",
        check.duration_s
    );
    let log = args.out.join(format!("{name}.mcap"));
    let stripes = stripes(&args.out, name);
    let recording = Recording {
        rig: vehicle,
        plan: Some(plan),
        withheld: None,
        conditions: &Conditions {
            note: Some("hydroline demo".to_owned()),
            ..Conditions::default()
        },
        run: (1, 1),
        length: None,
        ready_within: Duration::from_secs(10),
        with_thrusters: true,
        calibration: None,
        calibrate: None,
        build,
        live: None,
        tank: None,
        unattended: false,
    };
    let report = recording.record(&log)?;
    print_recording(&report);
    match &report.stop {
        StopReason::Finished => {}
        StopReason::LogStopped(_) => return Ok(true),
        other => return Err(CliError::Run(other.to_string())),
    }
    let bar = progress::bar(report.capture.received, "replaying");
    let map: Arc<dyn PlaneMap> = Arc::new(IdealMap::of(rig));
    let options = replay::Options {
        poses: Some(PoseRun::new(rig, map.clone())),
        map: Some(map),
        rule: rig.grey_rule(),
        rig_toml: Some(rig.effective_toml.clone()),
        build,
        ..replay::Options::default()
    };
    let result = replay(&log, &stripes, &options, &mut |frames| {
        bar.set_position(frames)
    });
    bar.finish_and_clear();
    let (replayed, _) = result?;
    outln!(
        "  replayed: {} frames, {} with a stripe, {} points; {} of {} frames extracted live came out bit for bit the same; {} poses",
        replayed.frames,
        replayed.with_stripe,
        replayed.points,
        replayed.live_identical,
        replayed.live,
        replayed.poses
    );
    describe(rig, &stripes)?;
    let picture = args.out.join(format!("{name}.png"));
    draw_middle_frame(&log, rig, replayed.frames / 2, &picture)?;
    for path in [&log, &stripes, &picture] {
        outln!("  {}", path.display());
    }
    Ok(report.lost_anything())
}

fn print_recording(report: &Report) {
    let capture = &report.capture;
    outln!(
        "  recorded: {} frames received + {} lost = {} expected, {} extracted live, {:.1} MB",
        capture.received,
        capture.lost.total(),
        capture.expected,
        report.analysed,
        report.log.counts.bytes as f64 / 1e6
    );
    if let Some(stats) = report.thrusters {
        outln!(
            "  thrusters: {} command sets sent, {} echoed by the simulated controller",
            stats.sets,
            stats.echoed
        );
    }
}

/// Prints the results of a run at this stage: the vehicle's height and roll over the floor, and the links' timing.
fn describe(rig: &Rig, stripes: &Path) -> Result<(), CliError> {
    let (mut heights_m, mut rolls_rad, mut round_trips_s, mut clock) =
        (Vec::new(), Vec::new(), Vec::new(), None);
    for message in LogReader::open(stripes)? {
        match message?.record {
            Record::Profile(profile) => {
                let points: Vec<(f64, f64)> = profile
                    .xi_m
                    .iter()
                    .zip(&profile.eta_m)
                    .map(|(x, e)| (f64::from(*x), f64::from(*e)))
                    .filter(|p| p.0.is_finite())
                    .collect();
                if let Some(found) = floor::floor(&points, rig.mounts.h_centre_m) {
                    heights_m.push(found.height_m);
                    rolls_rad.push(found.phi_rad);
                }
            }
            Record::Echo(echo) => round_trips_s.push(echo.round_trip_s),
            Record::Clock(pair) => clock = pair.controller.or(clock),
            _ => {}
        }
    }
    outln!(
        "  floor seen {:.2} mm (median) below the CG, roll {:.3} deg, in {} frames; the rig says {:.2} mm",
        1e3 * median(&mut heights_m),
        median(&mut rolls_rad).to_degrees(),
        heights_m.len(),
        -1e3 * rig.tank.start_pose[2],
    );
    if let Some(clock) = clock {
        outln!(
            "  controller clock: drift {:.1} +- {:.1} ppm, offset known to {:.0} us, command round trip {:.2} ms (median)",
            clock.drift_ppm,
            clock.drift_sd_ppm,
            clock.offset_sd_us,
            1e3 * median(&mut round_trips_s)
        );
    }
    Ok(())
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

fn draw_middle_frame(log: &Path, rig: &Rig, index: u64, picture: &Path) -> Result<(), CliError> {
    let mut seen = 0;
    for message in LogReader::open(log)? {
        if let Record::Frame(frame) = message?.record {
            if seen < index {
                seen += 1;
                continue;
            }
            let image = frame.to_grey(&rig.grey_rule())?;
            let profile = Extractor::new(ExtractorConfig::default()).extract(&image);
            return Output::default().image(picture, annotate(&image, &profile));
        }
    }
    Ok(())
}
