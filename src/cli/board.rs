//! `hydroline board`: what one needs to make a calibration board.

use super::paper::PaperArgs;
use super::print::errln;
use super::{CliError, Outcome};
use hydroline_calib::drawing::board_sheet;
use hydroline_rigs::Board;

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Built in: wc-lines-50 (Wang and Cheng's grid lines), dots-50, chess-25 and charuco-25 (to print). The drawing is at true scale: \
measure its 100 mm line before the board is trusted. Larger than a page, it goes with --tile onto several: print them \
at 100 %, cut at the marks, and put them together on a flat plate. Layers: CUT the outline, MARK what is dark, LIGHT what stays \
light inside a mark, BLOCK the gauge blocks with their height, NOTE dimensions.

Examples:
  hydroline board dots-50 --out dots-50.svg
  hydroline board dots-50 --tile a4 --out dots-50.pdf
  hydroline board charuco-25 --tile a4 --out charuco-25.pdf
  hydroline board my-board.toml --out my-board.dxf")]
pub struct Args {
    /// Board file or built-in name
    #[arg(value_name = "BOARD")]
    board: String,
    #[command(flatten)]
    paper: PaperArgs,
}

pub fn run(args: &Args) -> Result<Outcome, CliError> {
    let board = Board::load_or_builtin(&args.board)?;
    args.paper.write(&board_sheet(&board))?;
    if board.blocks.len() < 3 {
        errln!(
            "hydroline: '{}' has {} gauge blocks: how far it stands off the sheet will not be known (3 are needed)",
            board.name,
            board.blocks.len()
        );
    }
    Ok(Outcome::Done)
}
