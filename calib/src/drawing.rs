//! Drawings of boards and targets at true scale, from the same types the software reads.
//!
//! A [`Sheet`] holds shapes in millimetres with the origin at the lower left; `svg`, `pdf` and
//! `dxf` write it. Filled shapes are what is printed or engraved dark, outlines what is cut
//! or milled, thin lines are dimensions. Every sheet carries a line of 100 mm: measure it on
//! the print before the board is trusted.

pub mod dxf;
pub mod pdf;
pub mod svg;
pub mod tile;

use hydroline_rigs::{Board, BoardPattern, SlabOutline, Target};

use crate::board;
use crate::charuco::{Markers, square_is_dark};

/// Layer of a shape.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Layer {
    /// Outer shapes: cut or mill.
    Cut,
    /// Dark marks: print, engrave or paint.
    Mark,
    /// Left light inside a dark mark.
    Light,
    /// Gauge blocks: glue on.
    Block,
    /// Dimensions, notes, the 100 mm line.
    Note,
}

impl Layer {
    /// Name in the files.
    pub fn name(self) -> &'static str {
        match self {
            Layer::Cut => "CUT",
            Layer::Mark => "MARK",
            Layer::Light => "LIGHT",
            Layer::Block => "BLOCK",
            Layer::Note => "NOTE",
        }
    }
}

/// A shape, millimetres, y up.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// Closed polygon; filled on the layer of marks.
    Polygon(Layer, Vec<[f64; 2]>),
    /// Circle: centre and diameter; filled on the layer of marks.
    Circle(Layer, [f64; 2], f64),
    /// Straight line.
    Line(Layer, [f64; 2], [f64; 2]),
    /// Text from its lower left: place, height, words.
    Text([f64; 2], f64, String),
}

/// A drawing.
#[derive(Debug, Clone, PartialEq)]
pub struct Sheet {
    /// Title, for a file's metadata and the foot of its pages.
    pub title: String,
    /// Width and height \[mm\].
    pub size_mm: [f64; 2],
    /// Shapes in drawing order.
    pub shapes: Vec<Shape>,
}

/// Room around the part for dimensions \[mm\].
const ROOM_MM: f64 = 40.0;
const TEXT_MM: f64 = 5.0;

impl Sheet {
    fn new(title: String, part_mm: [f64; 2]) -> Self {
        // Wide enough for the 100 mm line and the longest note.
        let width = part_mm[0].max(180.0) + 2.0 * ROOM_MM;
        let mut sheet = Sheet {
            title: title.clone(),
            size_mm: [width, part_mm[1] + 2.0 * ROOM_MM + 20.0],
            shapes: Vec::new(),
        };
        sheet.text([ROOM_MM, sheet.size_mm[1] - 14.0], TEXT_MM, title);
        let y = 8.0;
        sheet.note_line([ROOM_MM, y], [ROOM_MM + 100.0, y]);
        for x in [0.0, 100.0] {
            sheet.note_line([ROOM_MM + x, y - 2.0], [ROOM_MM + x, y + 2.0]);
        }
        sheet.text(
            [ROOM_MM + 104.0, y - 1.5],
            0.8 * TEXT_MM,
            "100 mm: measure before use".to_owned(),
        );
        sheet
    }

    fn text(&mut self, at: [f64; 2], height: f64, words: String) {
        self.shapes.push(Shape::Text(at, height, words));
    }

    fn note_line(&mut self, a: [f64; 2], b: [f64; 2]) {
        self.shapes.push(Shape::Line(Layer::Note, a, b));
    }

    fn rectangle(&mut self, layer: Layer, low: [f64; 2], high: [f64; 2]) {
        self.shapes.push(Shape::Polygon(
            layer,
            vec![low, [high[0], low[1]], high, [low[0], high[1]]],
        ));
    }

    /// Marker of the square whose lower left corner is `corner`: dark, with its light bits, neighbours in a row as one.
    fn marker(&mut self, markers: &Markers, square: [i32; 2], corner: [f64; 2], pitch_mm: f64) {
        let Some(bits) = markers.bits(square) else {
            return;
        };
        let side = markers.dictionary.side;
        let size = markers.share * pitch_mm;
        let cell = size / f64::from(side + 2);
        let [left, low] = corner.map(|v| v + 0.5 * (pitch_mm - size));
        self.rectangle(Layer::Mark, [left, low], [left + size, low + size]);
        let light = |row: u32, column: u32| {
            column < side && bits >> (side * side - 1 - row * side - column) & 1 == 1
        };
        for row in 0..side {
            let y = low + f64::from(side - row) * cell;
            let mut from = None;
            for column in 0..=side {
                match (light(row, column), from) {
                    (true, None) => from = Some(column),
                    (false, Some(first)) => {
                        let x = [first, column].map(|c| left + f64::from(c + 1) * cell);
                        self.rectangle(Layer::Light, [x[0], y], [x[1], y + cell]);
                        from = None;
                    }
                    _ => {}
                }
            }
        }
    }

    /// Dimension along x at height y, ends marked, the length in mm written over it.
    fn across(&mut self, from: f64, to: f64, y: f64) {
        self.note_line([from, y], [to, y]);
        for x in [from, to] {
            self.note_line([x, y - 2.0], [x, y + 2.0]);
        }
        self.text(
            [0.5 * (from + to) - 8.0, y + 1.5],
            TEXT_MM,
            number(to - from),
        );
    }

    /// Dimension along y at x.
    fn upright(&mut self, from: f64, to: f64, x: f64) {
        self.note_line([x, from], [x, to]);
        for y in [from, to] {
            self.note_line([x - 2.0, y], [x + 2.0, y]);
        }
        self.text([x - 22.0, 0.5 * (from + to)], TEXT_MM, number(to - from));
    }
}

/// Millimetres without trailing zeros, to a hundredth.
fn number(mm: f64) -> String {
    let text = format!("{mm:.2}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// A board as the camera sees it: ξ runs to port, which is to the LEFT of the drawing.
pub fn board_sheet(b: &Board) -> Sheet {
    let half = board::half_size_m(b).map(|v| 1e3 * v);
    let kind = match b.pattern {
        BoardPattern::Lines { line_m } => format!("lines {} mm wide", number(1e3 * line_m)),
        BoardPattern::Dots { diameter_m } => {
            format!("dots {} mm in diameter", number(1e3 * diameter_m))
        }
        BoardPattern::Chessboard => "chessboard".to_owned(),
        BoardPattern::Charuco {
            dictionary,
            marker_m,
        } => format!(
            "ChArUco, {} x {} squares, {} markers of {} mm",
            b.columns + 1,
            b.rows + 1,
            dictionary.name(),
            number(1e3 * marker_m)
        ),
    };
    let mut sheet = Sheet::new(
        format!(
            "{}: {} x {} nodes, pitch {} mm, {kind}, plate {} mm thick; front (laser side)",
            b.name,
            b.columns,
            b.rows,
            number(1e3 * b.pitch_m),
            number(1e3 * b.thickness_m)
        ),
        [2.0 * half[0], 2.0 * half[1]],
    );
    let (cx, cy) = (ROOM_MM + half[0], ROOM_MM + 20.0 + half[1]);
    // ξ to port = left as seen from the camera.
    let place = |p: [f64; 2]| [cx - 1e3 * p[0], cy + 1e3 * p[1]];
    sheet.rectangle(
        Layer::Cut,
        [cx - half[0], cy - half[1]],
        [cx + half[0], cy + half[1]],
    );
    let last = [b.columns.saturating_sub(1), b.rows.saturating_sub(1)];
    match b.pattern {
        BoardPattern::Lines { line_m } => {
            let w = 0.5e3 * line_m;
            let (low, high) = (
                place(board::node_m(b, last[0], 0)),
                place(board::node_m(b, 0, last[1])),
            );
            for i in 0..b.columns {
                let x = place(board::node_m(b, i, 0))[0];
                sheet.rectangle(Layer::Mark, [x - w, low[1] - w], [x + w, high[1] + w]);
            }
            for j in 0..b.rows {
                let y = place(board::node_m(b, 0, j))[1];
                sheet.rectangle(Layer::Mark, [low[0] - w, y - w], [high[0] + w, y + w]);
            }
        }
        BoardPattern::Dots { diameter_m } => {
            for j in 0..b.rows {
                for i in 0..b.columns {
                    let at = place(board::node_m(b, i, j));
                    sheet
                        .shapes
                        .push(Shape::Circle(Layer::Mark, at, 1e3 * diameter_m));
                }
            }
        }
        BoardPattern::Chessboard | BoardPattern::Charuco { .. } => {
            let [x, y] = place(board::node_m(b, 0, 0));
            let p = 1e3 * b.pitch_m;
            let markers = Markers::of(b);
            // Square (i, j) has node (i, j) at its lowest corner; −1 is the outer row.
            for j in -1..=last[1] as i32 {
                for i in -1..=last[0] as i32 {
                    let (right, low) = (x - f64::from(i) * p, y + f64::from(j) * p);
                    if !square_is_dark(b, [i, j]) {
                        if let Some(markers) = &markers {
                            sheet.marker(markers, [i, j], [right - p, low], p);
                        }
                        continue;
                    }
                    // The outer squares end with the plate.
                    let a = [(right - p).max(cx - half[0]), low.max(cy - half[1])];
                    let c = [right.min(cx + half[0]), (low + p).min(cy + half[1])];
                    sheet.rectangle(Layer::Mark, a, c);
                }
            }
        }
    }
    if let Some(key) = board::key(b) {
        for cell in key.cells {
            let at = place(board::cell_m(b, cell));
            // On a chessboard the disc takes the other colour of its square.
            let light = matches!(b.pattern, BoardPattern::Chessboard)
                && (cell[0] + cell[1]).is_multiple_of(2);
            let layer = if light { Layer::Light } else { Layer::Mark };
            sheet
                .shapes
                .push(Shape::Circle(layer, at, 1e3 * key.diameter_m));
        }
        let at = place(board::cell_m(b, key.cells[0]));
        sheet.text([cx + half[0] + 3.0, at[1]], 0.6 * TEXT_MM, "key".to_owned());
    }
    for block in &b.blocks {
        let at = place(block.centre_m);
        let (w, h) = (0.5e3 * block.size_m[0], 0.5e3 * block.size_m[1]);
        sheet.rectangle(Layer::Block, [at[0] - w, at[1] - h], [at[0] + w, at[1] + h]);
        sheet.text(
            [at[0] - w + 1.0, at[1] - 2.0],
            0.7 * TEXT_MM,
            format!("h {} mm", number(1e3 * block.height_m)),
        );
    }
    sheet.across(cx - half[0], cx + half[0], cy + half[1] + 8.0);
    sheet.upright(cy - half[1], cy + half[1], cx - half[0] - 8.0);
    let (a, c) = (place(board::node_m(b, 1, 0)), place(board::node_m(b, 0, 0)));
    sheet.across(a[0], c[0], cy - half[1] - 9.0);
    sheet
}

/// A target from above: X to the right, Y (starboard) DOWN the drawing.
pub fn target_sheet(target: &Target) -> Sheet {
    let outlines: Vec<Vec<[f64; 2]>> = target
        .slabs
        .iter()
        .map(|s| corners_mm(&s.outline))
        .collect();
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for p in outlines.iter().flatten() {
        for k in 0..2 {
            low[k] = low[k].min(p[k]);
            high[k] = high[k].max(p[k]);
        }
    }
    if !low[0].is_finite() {
        (low, high) = ([0.0; 2], [0.0; 2]);
    }
    let mut sheet = Sheet::new(
        format!("{}: from above, X to the right", target.name),
        [high[0] - low[0], high[1] - low[1]],
    );
    let shift = [ROOM_MM - low[0], ROOM_MM + 20.0 - low[1]];
    for (slab, outline) in target.slabs.iter().zip(outlines) {
        let placed: Vec<[f64; 2]> = outline
            .iter()
            .map(|p| [p[0] + shift[0], p[1] + shift[1]])
            .collect();
        let (left, right) = placed
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |m, p| {
                (m.0.min(p[0]), m.1.max(p[0]))
            });
        let (bottom, top) = placed
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |m, p| {
                (m.0.min(p[1]), m.1.max(p[1]))
            });
        let n = sheet.shapes.len() as f64;
        sheet.shapes.push(Shape::Polygon(Layer::Cut, placed));
        sheet.text(
            [left + 4.0, 0.5 * (bottom + top) - 3.0 * (n % 7.0)],
            TEXT_MM,
            format!(
                "{}: top {} mm above the floor",
                slab.name,
                number(1e3 * slab.top_m)
            ),
        );
        sheet.across(left, right, shift[1] + high[1] + 8.0);
        sheet.upright(bottom, top, left - 8.0);
        if let SlabOutline::HexagonChain { side_m, .. } = slab.outline {
            let pitch = 3f64.sqrt() * 1e3 * side_m;
            sheet.across(left, left + pitch, shift[1] + low[1] - 9.0);
            sheet.upright(
                shift[1] - 500.0 * side_m,
                shift[1] + 500.0 * side_m,
                right + 26.0,
            );
        }
    }
    sheet
}

/// Corners \[mm\]; Y to starboard is down in the drawing.
fn corners_mm(outline: &SlabOutline) -> Vec<[f64; 2]> {
    let metres: Vec<[f64; 2]> = match outline {
        SlabOutline::Rectangle {
            x0_m,
            x1_m,
            width_m,
        } => {
            let w = 0.5 * width_m;
            vec![[*x0_m, w], [*x1_m, w], [*x1_m, -w], [*x0_m, -w]]
        }
        SlabOutline::HexagonChain {
            x0_m,
            side_m,
            count,
        } => {
            // Joints one side wide, widest (two sides) half way: both flanks in turn.
            let step = 3f64.sqrt() * side_m / 2.0;
            let half = |k: u32| {
                if k.is_multiple_of(2) {
                    0.5 * side_m
                } else {
                    *side_m
                }
            };
            let steps = 2 * count;
            let x = |k: u32| x0_m + f64::from(k) * step;
            (0..=steps)
                .map(|k| [x(k), half(k)])
                .chain((0..=steps).rev().map(|k| [x(k), -half(k)]))
                .collect()
        }
        SlabOutline::Polygon { points_m } => points_m.clone(),
    };
    metres.iter().map(|p| [1e3 * p[0], -1e3 * p[1]]).collect()
}

#[cfg(test)]
mod tests;
