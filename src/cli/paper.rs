//! Drawings as files: SVG, DXF, and PDF whole or on pages of paper.

use super::CliError;
use super::output::Output;
use super::print::outln;
use hydroline_calib::drawing::tile::{self, Page, Paper, Tiling};
use hydroline_calib::drawing::{Sheet, dxf, pdf, svg};
use std::path::{Path, PathBuf};

/// Where a drawing goes, and on which paper.
#[derive(Debug, clap::Args)]
pub struct PaperArgs {
    /// Drawing to write; the ending says which: .svg, .dxf, or .pdf
    #[arg(long, value_name = "X.svg|X.dxf|X.pdf")]
    out: PathBuf,
    /// Cuts the drawing into pages of this paper, a4 or a3, for any printer (.pdf): each with cut marks, a 100 mm line
    /// and its row and column; dimensions stay on the whole drawing
    #[arg(long, value_parser = paper, value_name = "PAPER")]
    tile: Option<Paper>,
    /// With --tile: what stays white around each page, 5 to 50 [mm]
    #[arg(
        long,
        default_value_t = 10.0,
        allow_negative_numbers = true,
        requires = "tile",
        value_name = "MM"
    )]
    margin_mm: f64,
    /// With --tile: each page draws so far beyond its right and lower cuts, to glue the next page on, 0 to 30 [mm];
    /// 0 = pages are cut at every mark and put edge to edge
    #[arg(
        long,
        default_value_t = 0.0,
        allow_negative_numbers = true,
        requires = "tile",
        value_name = "MM"
    )]
    overlap_mm: f64,
    #[command(flatten)]
    output: Output,
}

fn paper(name: &str) -> Result<Paper, String> {
    Paper::from_name(name).ok_or_else(|| {
        let names: Vec<_> = Paper::ALL.iter().map(|p| p.name()).collect();
        format!("'{name}' is none of {}", names.join(", "))
    })
}

impl PaperArgs {
    /// Writes the drawing as its file's ending says, and says what to do with it.
    pub fn write(&self, sheet: &Sheet) -> Result<(), CliError> {
        let ending = ending(&self.out);
        if self.tile.is_some() && ending != "pdf" {
            return Err(CliError::Config(format!(
                "--tile with --out {}: pages go into a .pdf; name one that ends in .pdf, or leave --tile away",
                self.out.display()
            )));
        }
        let mut pages = vec![Page::whole(sheet)];
        if let Some(paper) = self.tile {
            let tiling = Tiling {
                paper,
                margin_mm: self.margin_mm,
                overlap_mm: self.overlap_mm,
            };
            pages = tile::pages(sheet, &tiling)
                .map_err(|e| CliError::Config(format!("--tile {}: {e}", paper.name())))?;
        }
        let bytes = match ending.as_str() {
            "svg" => svg::write(sheet).into_bytes(),
            "dxf" => dxf::write(sheet).into_bytes(),
            "pdf" => pdf::write(sheet, &pages),
            _ => {
                return Err(CliError::Config(format!(
                    "--out {}: a drawing ends in .svg (laser cutter), .dxf (mill, CAD) or .pdf (printer; --tile a4)",
                    self.out.display()
                )));
            }
        };
        self.output.file("--out", &self.out)?;
        self.output.write(&self.out, bytes)?;
        outln!(
            "{}: {}, {}",
            self.out.display(),
            sheet.title,
            size(self, sheet, &pages)
        );
        Ok(())
    }
}

fn ending(path: &Path) -> String {
    path.extension()
        .map(|e| e.to_string_lossy().to_ascii_lowercase())
        .unwrap_or_default()
}

/// Size of the print; of a tiled one the number of pages.
fn size(args: &PaperArgs, sheet: &Sheet, pages: &[Page]) -> String {
    match (args.tile, pages.last()) {
        (Some(paper), Some(last)) => format!(
            "{} pages of {} ({} rows, {} columns): print at 100 % (actual size) and measure the 100 mm line",
            pages.len(),
            paper.name().to_uppercase(),
            last.place[0],
            last.place[1]
        ),
        _ => format!(
            "{:.0} x {:.0} mm at true scale",
            sheet.size_mm[0], sheet.size_mm[1]
        ),
    }
}
