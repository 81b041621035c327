//! A sheet on pages of paper: what is larger than a page is cut into cells that lie side by side.
//!
//! The cells part the drawn part (plate or slabs) exactly; dimensions and title stay on the whole drawing. A page draws
//! its cell, the overlap beyond the cuts to the right and below, and a little beyond the part's own edge, so that its
//! line is whole. Cut marks stand outside of what is drawn.

use super::{Layer, Shape, Sheet};

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

/// How a sheet goes on paper.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tiling {
    /// The paper.
    pub paper: Paper,
    /// What stays white around \[mm\]; holds the cut marks.
    pub margin_mm: f64,
    /// How far the drawing goes on beyond the cuts to the right and below \[mm\].
    pub overlap_mm: f64,
}

/// Smallest and largest margin \[mm\]: printers leave 3 to 5 mm white, and the cut marks take five; above 50 an A4 page
/// has no room for the 100 mm line and its words.
pub const MARGIN_MM: [f64; 2] = [5.0, 50.0];
/// Largest overlap \[mm\]: a third of what A4 draws with the widest margin.
pub const OVERLAP_MM: f64 = 30.0;
/// More pages than anyone cuts by hand.
pub const MOST_PAGES: usize = 200;

/// Below the drawing, for the 100 mm line and the page's words \[mm\].
const FOOT_MM: f64 = 18.0;
/// Drawn beyond the part's edge \[mm\], so that its line is whole.
const EDGE_MM: f64 = 1.0;
/// From the drawing to a cut mark, and the mark's length \[mm\].
const MARK_MM: [f64; 2] = [1.0, 4.0];
const TEXT_MM: f64 = 3.0;
/// Characters of a foot line: what an A4 page upright holds at this height.
const FOOT_CHARACTERS: usize = 120;

/// A tiling that cannot be.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TileError {
    /// Margin outside of its range.
    #[error("a margin of {mm} mm: {low} to {high} mm is possible (the cut marks stand in it), e.g. 10", low = MARGIN_MM[0], high = MARGIN_MM[1])]
    Margin {
        /// As given.
        mm: f64,
    },
    /// Overlap outside of its range.
    #[error(
        "an overlap of {mm} mm: 0 to {OVERLAP_MM} mm is possible, e.g. 10; 0 = pages are put edge to edge"
    )]
    Overlap {
        /// As given.
        mm: f64,
    },
    /// Too large for paper.
    #[error(
        "{size_mm:.0?} mm would be {pages} pages of {paper}, at most {MOST_PAGES} are written: take larger paper, or have the .svg plotted whole"
    )]
    Pages {
        /// Width and height of the part.
        size_mm: [f64; 2],
        /// How many pages.
        pages: usize,
        /// The paper's name.
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
    /// What lies between the cuts, on the sheet.
    pub cell: Window,
    /// What of the sheet is drawn.
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

/// What is made: the extent of all but notes; the whole sheet where there is nothing else.
fn part(sheet: &Sheet) -> Window {
    let mut all = Window {
        low_mm: [f64::INFINITY; 2],
        high_mm: [f64::NEG_INFINITY; 2],
    };
    let mut take = |p: [f64; 2], around: f64| {
        for k in 0..2 {
            all.low_mm[k] = all.low_mm[k].min(p[k] - around);
            all.high_mm[k] = all.high_mm[k].max(p[k] + around);
        }
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

/// How the part lies on pages of one size.
struct Layout {
    part: Window,
    size_mm: [f64; 2],
    tiling: Tiling,
    /// Columns and rows.
    cells: [usize; 2],
    /// From page to page \[mm\].
    pitch_mm: [f64; 2],
}

impl Layout {
    fn of(part: Window, size_mm: [f64; 2], tiling: &Tiling) -> Self {
        let room = [
            size_mm[0] - 2.0 * tiling.margin_mm,
            size_mm[1] - 2.0 * tiling.margin_mm - FOOT_MM,
        ];
        let overlap = tiling.overlap_mm;
        let extent = part.size_mm().map(|size| size + 2.0 * EDGE_MM);
        let cells = [0, 1].map(|k| {
            // A hair of rounding must not make a page.
            let n = ((extent[k] - overlap) / (room[k] - overlap) - 1e-9).ceil();
            (n.max(1.0)) as usize
        });
        // All pages draw the same width: none is a sliver.
        let pitch_mm = [0, 1].map(|k| match cells[k] {
            1 => extent[k],
            n => (extent[k] - overlap) / n as f64,
        });
        Self {
            part,
            size_mm,
            tiling: *tiling,
            cells,
            pitch_mm,
        }
    }

    fn count(&self) -> usize {
        self.cells[0].saturating_mul(self.cells[1])
    }

    /// The page of a row and column, from 0.
    fn page(&self, [row, column]: [usize; 2], title: &str) -> Page {
        let (part, overlap) = (self.part, self.tiling.overlap_mm);
        let [columns, rows] = self.cells;
        // The cut before the k-th cell, counted from the edge; the part's own edges are the outermost.
        let cut = |axis: usize, k: usize| -> f64 {
            let (low, high) = (part.low_mm[axis], part.high_mm[axis]);
            let inner = k as f64 * self.pitch_mm[axis] - EDGE_MM;
            match (axis, k) {
                (0, 0) => low,
                (0, k) if k == columns => high,
                (0, _) => low + inner,
                (_, 0) => high,
                (_, k) if k == rows => low,
                (_, _) => high - inner,
            }
        };
        let cell = Window {
            low_mm: [cut(0, column), cut(1, row + 1)],
            high_mm: [cut(0, column + 1), cut(1, row)],
        };
        let beyond = |inner: bool, overlap: f64| if inner { overlap } else { EDGE_MM };
        let drawn = Window {
            low_mm: [
                cell.low_mm[0] - beyond(column > 0, 0.0),
                cell.low_mm[1] - beyond(row + 1 < rows, overlap),
            ],
            high_mm: [
                cell.high_mm[0] + beyond(column + 1 < columns, overlap),
                cell.high_mm[1] + beyond(row > 0, 0.0),
            ],
        };
        let margin = self.tiling.margin_mm;
        let shift_mm = [margin - drawn.low_mm[0], margin + FOOT_MM - drawn.low_mm[1]];
        let mut page = Page {
            size_mm: self.size_mm,
            place: [row + 1, column + 1],
            cell,
            drawn,
            shift_mm,
            marks: Vec::new(),
        };
        page.marks = cut_marks(&page);
        self.foot(&mut page, title);
        page
    }

    /// The 100 mm line and the page's words.
    fn foot(&self, page: &mut Page, title: &str) {
        let [row, column] = page.place;
        let [columns, rows] = self.cells;
        let (x, y) = (self.tiling.margin_mm, self.tiling.margin_mm);
        let note = |a, b| Shape::Line(Layer::Note, a, b);
        page.marks.push(note([x, y + 1.5], [x + 100.0, y + 1.5]));
        for end in [x, x + 100.0] {
            page.marks.push(note([end, y], [end, y + 3.0]));
        }
        let place = format!(
            "Page {} of {}: row {row} of {rows} from the top, column {column} of {columns} from the left ({}).",
            (row - 1) * columns + column,
            rows * columns,
            self.tiling.paper.name().to_uppercase()
        );
        let joint = match self.tiling.overlap_mm {
            mm if mm > 0.0 && rows * columns > 1 => {
                format!(" Glue right and lower neighbours over {mm} mm.")
            }
            _ => String::new(),
        };
        let words = [
            (
                x + 103.0,
                y + 0.5,
                "100 mm; print at 100 % (actual size)".to_owned(),
            ),
            (x, y + 5.0, place + &joint),
            (x, y + 9.0, title.to_owned()),
        ];
        for (x, y, words) in words {
            let words = words.chars().take(FOOT_CHARACTERS).collect();
            page.marks.push(Shape::Text([x, y], TEXT_MM, words));
        }
    }
}

/// Short lines outside of what is drawn, where the cuts lie.
fn cut_marks(page: &Page) -> Vec<Shape> {
    let on_page = |p: [f64; 2]| [0, 1].map(|k| p[k] + page.shift_mm[k]);
    let (low, high) = (page.drawn.low_mm, page.drawn.high_mm);
    let [gap, length] = MARK_MM;
    let mut marks = Vec::new();
    for axis in 0..2 {
        let other = 1 - axis;
        let ends = [
            (low[other] - gap, low[other] - gap - length),
            (high[other] + gap, high[other] + gap + length),
        ];
        for cut in [page.cell.low_mm[axis], page.cell.high_mm[axis]] {
            for (from, to) in ends {
                let (mut a, mut b) = ([cut; 2], [cut; 2]);
                a[other] = from;
                b[other] = to;
                marks.push(Shape::Line(Layer::Cut, on_page(a), on_page(b)));
            }
        }
    }
    marks
}

#[cfg(test)]
mod tests;
