//! `hydroline simulate`: a plan through the forward model, without waiting.

use super::{CliError, Outcome, inputs, progress};
use crate::simulate::{Options, simulate};
use std::path::PathBuf;
use std::time::Duration;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Rig file or built-in name
    #[arg(long, value_name = "RIG")]
    rig: String,
    /// Plan file or built-in name
    #[arg(long, value_name = "PLAN")]
    plan: String,
    /// Seed of all noise; without it the rig's
    #[arg(long)]
    seed: Option<u64>,
    /// Measured motion with white noise instead of images
    #[arg(long)]
    motion_only: bool,
    /// With --motion-only: noise of the position, standard deviation [m]
    #[arg(long, value_parser = inputs::not_negative, default_value = "0.00015", value_name = "M")]
    position_noise_m: f64,
    /// With --motion-only: noise of the attitude, standard deviation [rad]
    #[arg(long, value_parser = inputs::not_negative, default_value = "0.000175", value_name = "RAD")]
    attitude_noise_rad: f64,
    /// Goes on after the plan's last step (coasting)
    #[arg(long, value_parser = inputs::duration, default_value = "0s", value_name = "TIME")]
    tail: Duration,
    /// Free text for the log
    #[arg(long)]
    note: Option<String>,
    /// Log to write
    #[arg(long, value_name = "LOG.mcap")]
    out: PathBuf,
}

pub fn run(args: &Args) -> Result<Outcome, CliError> {
    let rig = inputs::rig(&args.rig)?;
    let plan = inputs::plan(&args.plan, &rig)?;
    inputs::new_file(&args.out)?;
    let options = Options {
        seed: args.seed,
        motion_only: args.motion_only,
        position_noise_m: args.position_noise_m,
        attitude_noise_rad: args.attitude_noise_rad,
        tail_s: args.tail.as_secs_f64(),
        note: args.note.clone(),
    };
    let bar = progress::bar(0, "frames");
    let result = simulate(&rig, &plan, &args.out, &options, &mut |done, all| {
        bar.set_length(all);
        bar.set_position(done);
    });
    bar.finish_and_clear();
    result.map_err(CliError::run)?;
    println!("{}", args.out.display());
    Ok(Outcome::Done)
}
