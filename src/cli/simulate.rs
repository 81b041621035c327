//! `hydroline simulate`: a plan through the forward model, without waiting.

use super::live::{self, LiveArgs};
use super::print::{self, errln, outln};
use super::{CliError, Outcome, call, inputs, progress};
use hydroline_core::build_info::BuildInfo;
use hydroline_core::clock::SIMULATION_START_UNIX_S;
use hydroline_daemon::simulate::{Options, simulate};
use hydroline_exchange::draws;
use hydroline_numerics::cancel;
use hydroline_plan::preflight::preflight;
use hydroline_rigs::{Board, Plan, Rig};
use schemars::JsonSchema;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

#[derive(Debug, clap::Args)]
#[command(after_help = "\
The log is what `record` would have written, without waiting for the clock.

Examples:
  hydroline simulate --rig lshpi --plan surge-4n --out sim.mcap
  hydroline simulate --rig lshpi --plan reversals --motion-only --seed 7 --out motion.mcap
  hydroline simulate --rig lshpi --plan reversals --live --out sim.mcap    # http://127.0.0.1:8080
  hydroline simulate --rig fitted.toml --plan reversals --draw 17 --motion-only --out draw.mcap
  hydroline simulate --rig lshpi --plan still --show-board dots-50 --out board.mcap

Exit codes: 0 done; 1 the motion runs away, or the log cannot be written; 2 bad arguments, rig or plan.")]
pub struct Args {
    /// Rig file or built-in name
    #[arg(long, value_name = "RIG")]
    rig: String,
    /// Plan file or built-in name
    #[arg(long, value_name = "PLAN")]
    plan: String,
    /// Seed of all noise; without it the rig's
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    seed: Option<u64>,
    /// Measured motion with white noise instead of images
    #[arg(long)]
    motion_only: bool,
    /// With --motion-only: noise of the position, standard deviation [m]
    #[arg(long, value_parser = inputs::not_negative, allow_negative_numbers = true, default_value = "0.00015", value_name = "M")]
    position_noise_m: f64,
    /// With --motion-only: noise of the attitude, standard deviation [rad]
    #[arg(long, value_parser = inputs::not_negative, allow_negative_numbers = true, default_value = "0.000175", value_name = "RAD")]
    attitude_noise_rad: f64,
    /// Goes on after the plan's last step (coasting)
    #[arg(long, value_parser = inputs::duration, allow_hyphen_values = true, default_value = "0s", value_name = "TIME")]
    tail: Duration,
    /// Calibration board standing in the sheet instead of the tank, file or built-in name
    #[arg(long, value_name = "BOARD", conflicts_with = "motion_only")]
    show_board: Option<String>,
    /// With --show-board: its face stands so far behind the sheet [m]; negative = in front
    #[arg(
        long,
        default_value_t = 0.0,
        allow_negative_numbers = true,
        requires = "show_board",
        value_name = "M"
    )]
    board_offset_m: f64,
    #[command(flatten)]
    live: LiveArgs,
    /// Free text for the log
    #[arg(long, value_name = "TEXT")]
    note: Option<String>,
    /// Simulates the vehicle of this rig, with its thrusters' curves and [[physics]]; the log names --rig only
    #[arg(long, value_name = "RIG")]
    tank: Option<String>,
    /// Simulates draw N of the rig's uncertainty (1 is the first row of `model --draws`); the log names --rig only
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000), conflicts_with = "tank")]
    draw: Option<u32>,
    /// With --draw: what identify --json or diagnose --json printed, in place of the rig's [identified]
    #[arg(long, value_name = "RESULT.json", requires = "draw")]
    draw_from: Option<PathBuf>,
    /// With --draw: seed of the draws, as that of `model --draws`
    #[arg(
        long,
        value_name = "N",
        default_value_t = 1,
        requires = "draw",
        allow_negative_numbers = true
    )]
    draw_seed: u64,
    /// The log's first second, e.g. 2026-05-04T09:30:00Z; default: 2020-09-13T12:26:40Z
    #[arg(long, value_parser = inputs::time, value_name = "TIME")]
    start: Option<u64>,
    /// Prints one JSON object
    #[arg(long)]
    json: bool,
    /// Log to write
    #[arg(long, value_name = "LOG.mcap")]
    out: PathBuf,
}

/// Output of `--json`.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct Printed<'a> {
    /// The log.
    log: &'a Path,
    /// Length of the run \[s\].
    length_s: f64,
    /// Messages written, by topic.
    messages: BTreeMap<&'static str, u64>,
    /// Bytes written.
    bytes: u64,
}

pub fn run(args: &Args, build: BuildInfo) -> Result<Outcome, CliError> {
    let rig = inputs::rig(&args.rig)?;
    let plan = inputs::plan(&args.plan, &rig)?;
    inputs::new_file("--out", &args.out)?;
    let board = args.show_board.as_deref().map(Board::load_or_builtin);
    let board = board.transpose()?;
    args.live.check()?;
    warn(&rig, &plan)?;
    let shown = args.live.start(false)?;
    let tank = match args.draw {
        Some(draw) => Some(drawn(args, &rig, draw)?),
        None => args.tank.as_deref().map(inputs::rig).transpose()?,
    };
    let options = Options {
        seed: args.seed,
        motion_only: args.motion_only,
        position_noise_m: args.position_noise_m,
        attitude_noise_rad: args.attitude_noise_rad,
        tail_s: args.tail.as_secs_f64(),
        note: args.note.clone(),
        board: board.map(|board| (board, args.board_offset_m)),
        build,
        live: shown
            .as_ref()
            .map(|shown| shown.run(live::title(&[&rig.name, &plan.name]), &args.out)),
        start_unix_s: args.start.unwrap_or(SIMULATION_START_UNIX_S),
        tank,
    };
    let length_s = plan.duration_s() + options.tail_s;
    let frames = (length_s * rig.camera.rate_fps) as u64;
    let bar = progress::bar(frames, "frames");
    let result = simulate(&rig, &plan, &args.out, &options, &mut |done, _| {
        cancel::check();
        call::progress("frames", done, Some(frames));
        bar.set_position(done)
    });
    bar.finish_and_clear();
    let outcome = result?;
    if args.json {
        print::json(&Printed {
            log: &args.out,
            length_s,
            messages: outcome.counts.messages,
            bytes: outcome.counts.bytes,
        })?;
    } else {
        outln!("{}", args.out.display());
    }
    Ok(Outcome::Done)
}

/// The rig of a draw, counted from 1.
fn drawn(args: &Args, rig: &Rig, draw: u32) -> Result<Rig, CliError> {
    let models = super::model::models(rig, args.draw_from.as_deref())?;
    let all = draws::drawn(&models, draw as usize, args.draw_seed);
    let Some(last) = all.last() else {
        return Err(CliError::Config("--draw: no model to draw from".to_owned()));
    };
    Ok(draws::applied(
        rig,
        &models,
        last,
        draw as usize,
        args.draw_seed,
    )?)
}

/// A simulation may leave the tank; the person should know that a recording of this plan would be refused.
fn warn(rig: &Rig, plan: &Plan) -> Result<(), CliError> {
    let report = preflight(rig, plan)?;
    for violation in &report.violations {
        errln!("hydroline: `record` would refuse this plan: {violation}");
    }
    Ok(())
}
