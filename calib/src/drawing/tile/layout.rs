//! Layout of a part on pages of one size: cells, cut marks, and the foot below the drawing.

use super::{Page, Tiling, Window};
use crate::drawing::{Layer, Shape};

/// Below the drawing, for the 100 mm line and the page's words \[mm\].
const FOOT_MM: f64 = 18.0;
/// Drawn beyond the part's edge \[mm\], so that its line is whole.
const EDGE_MM: f64 = 1.0;
/// From the drawing to a cut mark, and the mark's length \[mm\].
const MARK_MM: [f64; 2] = [1.0, 4.0];
const TEXT_MM: f64 = 3.0;
/// Characters of a foot line: what an A4 page upright holds at this height.
const FOOT_CHARACTERS: usize = 120;

/// Layout of the part on pages of one size.
pub(super) struct Layout {
    part: Window,
    size_mm: [f64; 2],
    tiling: Tiling,
    /// Columns and rows.
    pub cells: [usize; 2],
    /// From page to page \[mm\].
    pitch_mm: [f64; 2],
}

impl Layout {
    pub fn of(part: Window, size_mm: [f64; 2], tiling: &Tiling) -> Self {
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

    /// Number of pages.
    pub fn count(&self) -> usize {
        self.cells[0].saturating_mul(self.cells[1])
    }

    /// The page of a row and column, from 0.
    pub fn page(&self, [row, column]: [usize; 2], title: &str) -> Page {
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
