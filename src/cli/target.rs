//! `hydroline target`: what one needs to make a target.

use super::paper::PaperArgs;
use super::{CliError, Outcome};
use hydroline_calib::drawing::target_sheet;
use hydroline_rigs::Target;

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Built in: hexagons (surge and yaw), sway-board. The drawing is at true scale, seen from above, X to the right; \
measure its 100 mm line before the target is trusted. As a template on paper: --tile, printed at 100 %.

Examples:
  hydroline target hexagons --out hexagons.dxf
  hydroline target hexagons --tile a3 --overlap-mm 10 --out hexagons.pdf")]
pub struct Args {
    /// Target file or built-in name
    #[arg(value_name = "TARGET")]
    target: String,
    #[command(flatten)]
    paper: PaperArgs,
}

pub fn run(args: &Args) -> Result<Outcome, CliError> {
    let target = Target::load_or_builtin(&args.target)?;
    args.paper.write(&target_sheet(&target))?;
    Ok(Outcome::Done)
}
