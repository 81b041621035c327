//! PDF: pages at true scale. One unit of the drawing is a millimetre; viewers are instructed not to scale for the printer.

use super::tile::Page;
use super::{Layer, Shape, Sheet};
use pdf_writer::{Content, Finish, Name, Pdf, Rect, Ref, Str, TextStr};

/// Points of a millimetre: PDF's unit is 1/72 inch.
const PT_PER_MM: f64 = 72.0 / 25.4;
/// Width of lines \[mm\], as in the SVG.
const LINE_MM: f32 = 0.2;
/// Length of a Bézier's handle for a quarter circle of radius 1: off the circle by 0.03 % at most.
const QUARTER: f64 = 0.552_284_749_831;
const FONT: Name<'static> = Name(b"F");
const BLUE: [f32; 3] = [0.0, 0.0, 1.0];
const NOTE_RED: [f32; 3] = [0.8, 0.0, 0.0];

/// The sheet on these pages.
pub fn write(sheet: &Sheet, pages: &[Page]) -> Vec<u8> {
    let mut pdf = Pdf::new();
    let [catalog, tree, font, info] = [1, 2, 3, 4].map(Ref::new);
    let refs = |k: usize| {
        let first = 5 + 2 * k as i32;
        (Ref::new(first), Ref::new(first + 1))
    };
    let mut root = pdf.catalog(catalog);
    root.pages(tree);
    root.viewer_preferences()
        .pair(Name(b"PrintScaling"), Name(b"None"));
    root.finish();
    pdf.document_info(info).title(TextStr(&sheet.title));
    pdf.pages(tree)
        .kids((0..pages.len()).map(|k| refs(k).0))
        .count(pages.len() as i32);
    pdf.type1_font(font)
        .base_font(Name(b"Helvetica"))
        .encoding_predefined(Name(b"WinAnsiEncoding"));
    for (k, page) in pages.iter().enumerate() {
        let (page_ref, content_ref) = refs(k);
        let [width, height] = page.size_mm.map(|mm| (mm * PT_PER_MM) as f32);
        let mut written = pdf.page(page_ref);
        written.media_box(Rect::new(0.0, 0.0, width, height));
        written.parent(tree);
        written.contents(content_ref);
        written.resources().fonts().pair(FONT, font);
        written.finish();
        pdf.stream(content_ref, &content(sheet, page));
    }
    pdf.finish()
}

/// Content stream of one page.
fn content(sheet: &Sheet, page: &Page) -> Vec<u8> {
    let mut out = Content::new();
    let scale = PT_PER_MM as f32;
    out.transform([scale, 0.0, 0.0, scale, 0.0, 0.0]);
    out.set_line_width(LINE_MM);
    out.save_state();
    let low = [0, 1].map(|k| (page.drawn.low_mm[k] + page.shift_mm[k]) as f32);
    let size = page.drawn.size_mm().map(|mm| mm as f32);
    out.rect(low[0], low[1], size[0], size[1])
        .clip_nonzero()
        .end_path();
    for shape in sheet.shapes.iter().filter(|shape| touches(shape, page)) {
        draw(&mut out, shape, page.shift_mm);
    }
    out.restore_state();
    for mark in &page.marks {
        draw(&mut out, mark, [0.0; 2]);
    }
    out.finish().into_vec()
}

/// Whether anything of a shape lies in the page's window; of a text that is not known.
fn touches(shape: &Shape, page: &Page) -> bool {
    let inside = |low: [f64; 2], high: [f64; 2]| {
        let half_line = 0.5 * f64::from(LINE_MM);
        (0..2).all(|k| {
            low[k] - half_line <= page.drawn.high_mm[k]
                && high[k] + half_line >= page.drawn.low_mm[k]
        })
    };
    match shape {
        Shape::Polygon(_, points) => {
            let extreme = |k: usize, start: f64, pick: fn(f64, f64) -> f64| {
                points.iter().map(|p| p[k]).fold(start, pick)
            };
            inside(
                [0, 1].map(|k| extreme(k, f64::INFINITY, f64::min)),
                [0, 1].map(|k| extreme(k, f64::NEG_INFINITY, f64::max)),
            )
        }
        Shape::Circle(_, at, diameter) => inside(
            at.map(|v| v - 0.5 * diameter),
            at.map(|v| v + 0.5 * diameter),
        ),
        Shape::Line(_, a, b) => inside(
            [0, 1].map(|k| a[k].min(b[k])),
            [0, 1].map(|k| a[k].max(b[k])),
        ),
        Shape::Text(..) => true,
    }
}

fn draw(out: &mut Content, shape: &Shape, shift_mm: [f64; 2]) {
    let place = |p: [f64; 2]| [0, 1].map(|k| (p[k] + shift_mm[k]) as f32);
    match shape {
        Shape::Polygon(layer, points) => {
            for (k, p) in points.iter().enumerate() {
                let [x, y] = place(*p);
                if k == 0 {
                    out.move_to(x, y);
                } else {
                    out.line_to(x, y);
                }
            }
            out.close_path();
            paint(out, *layer);
        }
        Shape::Circle(layer, at, diameter) => {
            circle(out, place, *at, 0.5 * diameter);
            paint(out, *layer);
        }
        Shape::Line(layer, a, b) => {
            let ([ax, ay], [bx, by]) = (place(*a), place(*b));
            out.move_to(ax, ay).line_to(bx, by);
            paint(out, *layer);
        }
        Shape::Text(at, height_mm, words) => {
            let [x, y] = place(*at);
            let [r, g, b] = NOTE_RED;
            out.set_fill_rgb(r, g, b)
                .begin_text()
                .set_font(FONT, *height_mm as f32)
                .set_text_matrix([1.0, 0.0, 0.0, 1.0, x, y])
                .show(Str(&win_ansi(words)))
                .end_text();
        }
    }
}

/// A closed path of four Béziers.
fn circle(out: &mut Content, place: impl Fn([f64; 2]) -> [f32; 2], at: [f64; 2], radius: f64) {
    let point = |x: f64, y: f64| place([at[0] + radius * x, at[1] + radius * y]);
    let [x, y] = point(1.0, 0.0);
    out.move_to(x, y);
    let corners = [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0), (1.0, 0.0)];
    for pair in corners.windows(2) {
        let ((ax, ay), (bx, by)) = (pair[0], pair[1]);
        // A quarter turn to the left of each end's radius.
        let [x1, y1] = point(ax - QUARTER * ay, ay + QUARTER * ax);
        let [x2, y2] = point(bx + QUARTER * by, by - QUARTER * bx);
        let [x3, y3] = point(bx, by);
        out.cubic_to(x1, y1, x2, y2, x3, y3);
    }
    out.close_path();
}

/// Fills or strokes the path as the layer asks.
fn paint(out: &mut Content, layer: Layer) {
    let mut line = |[r, g, b]: [f32; 3]| {
        out.set_stroke_rgb(r, g, b).stroke();
    };
    match layer {
        Layer::Mark => {
            out.set_fill_gray(0.0).fill_nonzero();
        }
        Layer::Light => {
            out.set_fill_gray(1.0).fill_nonzero();
        }
        Layer::Cut => {
            out.set_stroke_gray(0.0).stroke();
        }
        Layer::Block => line(BLUE),
        Layer::Note => line(NOTE_RED),
    }
}

/// In the encoding of PDF's own fonts; what it lacks is a question mark.
fn win_ansi(words: &str) -> Vec<u8> {
    words
        .chars()
        .map(|c| match u32::from(c) {
            code @ (0x20..=0x7e | 0xa0..=0xff) => code as u8,
            _ => b'?',
        })
        .collect()
}
