//! A sheet on pages of paper: what is larger than a page is cut into cells that lie side by side.
//!
//! The cells part the drawn part (plate or slabs) exactly; dimensions and title stay on the whole drawing. A page draws
//! its cell, the overlap beyond the cuts to the right and below, and a little beyond the part's own edge, so that its
//! line is whole. Cut marks stand outside of what is drawn.

mod layout;

use super::{Layer, Shape, Sheet};
use layout::Layout;

/// Paper of a printer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Paper {
    /// 210 x 297 mm.
    A4,
    /// 297 x 420 mm.
    A3,
}

impl Paper {
    /// All of them.
    pub const ALL: [Paper; 2] = [Paper::A4, Paper::A3];

    /// Name on the command line and on the page.
    pub fn name(self) -> &'static str {
        match self {
            Paper::A4 => "a4",
            Paper::A3 => "a3",
        }
    }

    /// By its name, in either case.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL
            .into_iter()
            .find(|paper| paper.name().eq_ignore_ascii_case(name))
    }

    /// Width and height upright \[mm\] (ISO 216).
    pub fn upright_mm(self) -> [f64; 2] {
        match self {
            Paper::A4 => [210.0, 297.0],
            Paper::A3 => [297.0, 420.0],
        }
    }
}

/// Paper, margin and overlap of a sheet's pages.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tiling {
    /// The paper.
    pub paper: Paper,
    /// Margin that stays white all around \[mm\]; holds the cut marks.
    pub margin_mm: f64,
    /// Length by which the drawing goes on beyond the cuts to the right and below \[mm\].
    pub overlap_mm: f64,
}

/// Smallest and largest margin \[mm\]: printers leave 3 to 5 mm white, and the cut marks take five; above 50 an A4 page
/// has no room for the 100 mm line and its words.
pub const MARGIN_MM: [f64; 2] = [5.0, 50.0];
/// Largest overlap \[mm\]: a third of what A4 draws with the widest margin.
pub const OVERLAP_MM: f64 = 30.0;
/// More pages than anyone cuts by hand.
pub const MOST_PAGES: usize = 200;

/// A tiling that cannot be.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs)] // Each message names its fields.
pub enum TileError {
    #[error("a margin of {mm} mm: {low} to {high} mm is possible (the cut marks stand in it), e.g. 10", low = MARGIN_MM[0], high = MARGIN_MM[1])]
    Margin { mm: f64 },
    #[error(
        "an overlap of {mm} mm: 0 to {OVERLAP_MM} mm is possible, e.g. 10; 0 = pages are put edge to edge"
    )]
    Overlap { mm: f64 },
    #[error(
        "{size_mm:.0?} mm would be {pages} pages of {paper}, at most {MOST_PAGES} are written: take larger paper, or have the .svg plotted whole"
    )]
    Pages {
        size_mm: [f64; 2],
        pages: usize,
        paper: &'static str,
    },
}

/// A rectangle: lower left and upper right.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Window {
    /// Lower left \[mm\].
    pub low_mm: [f64; 2],
    /// Upper right \[mm\].
    pub high_mm: [f64; 2],
}

impl Window {
    /// Width and height \[mm\].
    pub fn size_mm(&self) -> [f64; 2] {
        [0, 1].map(|k| self.high_mm[k] - self.low_mm[k])
    }
}

/// One page.
#[derive(Debug, Clone, PartialEq)]
pub struct Page {
    /// Width and height of the paper as it is printed \[mm\].
    pub size_mm: [f64; 2],
    /// Row from the top and column from the left, from 1.
    pub place: [usize; 2],
    /// Part of the sheet between the cuts.
    pub cell: Window,
    /// Part of the sheet that is drawn.
    pub drawn: Window,
    /// From the sheet to the page \[mm\].
    pub shift_mm: [f64; 2],
    /// Cut marks, 100 mm line and words, on the page.
    pub marks: Vec<Shape>,
}

impl Page {
    /// A page as large as the sheet.
    pub fn whole(sheet: &Sheet) -> Self {
        let all = Window {
            low_mm: [0.0; 2],
            high_mm: sheet.size_mm,
        };
        Self {
            size_mm: sheet.size_mm,
            place: [1, 1],
            cell: all,
            drawn: all,
            shift_mm: [0.0; 2],
            marks: Vec::new(),
        }
    }
}

/// The sheet's pages, row by row from the upper left; the paper lies as it takes fewer of them.
///
/// # Errors
/// [`TileError`] for a margin, an overlap or a number of pages out of range.
pub fn pages(sheet: &Sheet, tiling: &Tiling) -> Result<Vec<Page>, TileError> {
    let Tiling {
        margin_mm,
        overlap_mm,
        ..
    } = *tiling;
    if !(MARGIN_MM[0]..=MARGIN_MM[1]).contains(&margin_mm) {
        return Err(TileError::Margin { mm: margin_mm });
    }
    if !(0.0..=OVERLAP_MM).contains(&overlap_mm) {
        return Err(TileError::Overlap { mm: overlap_mm });
    }
    let part = part(sheet);
    let upright = tiling.paper.upright_mm();
    let layouts = [upright, [upright[1], upright[0]]].map(|size| Layout::of(part, size, tiling));
    let [upright, across] = layouts;
    let layout = if across.count() < upright.count() {
        across
    } else {
        upright
    };
    if layout.count() > MOST_PAGES {
        return Err(TileError::Pages {
            size_mm: part.size_mm(),
            pages: layout.count(),
            paper: tiling.paper.name(),
        });
    }
    let [columns, rows] = layout.cells;
    let places = (0..rows).flat_map(|row| (0..columns).map(move |column| [row, column]));
    Ok(places
        .map(|place| layout.page(place, &sheet.title))
        .collect())
}

/// Extent of the part to be made, without notes; the whole sheet where there is nothing else.
fn part(sheet: &Sheet) -> Window {
    let mut all = Window {
        low_mm: [f64::INFINITY; 2],
        high_mm: [f64::NEG_INFINITY; 2],
    };
    let mut take = |p: [f64; 2], around: f64| {
        all.low_mm = [0, 1].map(|k| all.low_mm[k].min(p[k] - around));
        all.high_mm = [0, 1].map(|k| all.high_mm[k].max(p[k] + around));
    };
    for shape in &sheet.shapes {
        match shape {
            Shape::Polygon(layer, points) if *layer != Layer::Note => {
                points.iter().for_each(|p| take(*p, 0.0));
            }
            Shape::Circle(layer, at, diameter) if *layer != Layer::Note => {
                take(*at, 0.5 * diameter);
            }
            Shape::Line(layer, a, b) if *layer != Layer::Note => {
                take(*a, 0.0);
                take(*b, 0.0);
            }
            _ => {}
        }
    }
    if all.low_mm[0] < all.high_mm[0] && all.low_mm[1] < all.high_mm[1] {
        all
    } else {
        Page::whole(sheet).drawn
    }
}

#[cfg(test)]
mod tests;
