//! `hydroline target`: what one needs to make a target.

use super::output::Output;
use super::{CliError, Outcome, board};
use hydroline_calib::drawing::target_sheet;
use hydroline_rigs::Target;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Built in: hexagons (surge and yaw), sway-board. The drawing is at true scale, seen from above, X to the right; \
measure its 100 mm line before the target is trusted.

Examples:
  hydroline target hexagons --out hexagons.dxf")]
pub struct Args {
    /// Target file or built-in name
    #[arg(value_name = "TARGET")]
    target: String,
    /// Drawing to write; .svg or .dxf says which
    #[arg(long, value_name = "X.svg|X.dxf")]
    out: PathBuf,
    #[command(flatten)]
    output: Output,
}

pub fn run(args: &Args) -> Result<Outcome, CliError> {
    let target = Target::load_or_builtin(&args.target)?;
    board::write(args.output, &args.out, &target_sheet(&target))?;
    Ok(Outcome::Done)
}
