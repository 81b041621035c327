//! `hydroline board`: what one needs to make a calibration board.

use super::output::Output;
use super::print::{errln, outln};
use super::{CliError, Outcome};
use hydroline_calib::drawing::{Sheet, board_sheet, dxf, svg};
use hydroline_rigs::Board;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Built in: wc-lines-50 (Wang and Cheng's grid lines), dots-50, chess-25 (to print). The drawing is at true scale: \
measure its 100 mm line before the board is trusted. Layers: CUT the outline, MARK what is dark, LIGHT what stays \
light inside a mark, BLOCK the gauge blocks with their height, NOTE dimensions.

Examples:
  hydroline board dots-50 --out dots-50.svg
  hydroline board my-board.toml --out my-board.dxf")]
pub struct Args {
    /// Board file or built-in name
    #[arg(value_name = "BOARD")]
    board: String,
    /// Drawing to write; .svg or .dxf says which
    #[arg(long, value_name = "X.svg|X.dxf")]
    out: PathBuf,
    #[command(flatten)]
    output: Output,
}

pub fn run(args: &Args) -> Result<Outcome, CliError> {
    let board = Board::load_or_builtin(&args.board)?;
    write(args.output, &args.out, &board_sheet(&board))?;
    if board.blocks.len() < 3 {
        errln!(
            "hydroline: '{}' has {} gauge blocks: how far it stands off the sheet will not be known (3 are needed)",
            board.name,
            board.blocks.len()
        );
    }
    Ok(Outcome::Done)
}

/// Writes a drawing as its file's ending says.
pub(super) fn write(output: Output, out: &Path, sheet: &Sheet) -> Result<(), CliError> {
    let ending = out
        .extension()
        .map(|e| e.to_string_lossy().to_ascii_lowercase());
    let text = match ending.as_deref() {
        Some("svg") => svg::write(sheet),
        Some("dxf") => dxf::write(sheet),
        _ => {
            return Err(CliError::Config(format!(
                "--out {}: a drawing ends in .svg (printer, laser cutter) or .dxf (mill, CAD)",
                out.display()
            )));
        }
    };
    output.file("--out", out)?;
    output.write(out, text)?;
    outln!(
        "{}: {}, {:.0} x {:.0} mm at true scale",
        out.display(),
        sheet.title,
        sheet.size_mm[0],
        sheet.size_mm[1]
    );
    Ok(())
}
