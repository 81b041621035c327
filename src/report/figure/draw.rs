//! A placed panel as shapes: what lies behind first, what is read last.

use super::form::Form;
use super::layout::{LETTER_PX, LINE_PX, Placed, TO_NUMBERS_PX};
use super::scale::Scale;
use super::{Cell, Kind, Layer, legend, trace};
use crate::colour::Colour;
use crate::markup::Element;
use crate::svg::{self, Anchor, Path};

/// Opacity of areas: lines and the grid show through.
pub(super) const SHADE: f64 = 0.18;
const DOT_PX: f64 = 3.2;
/// Half width and height of the arrow that stands for a dot beyond the axis \[px\].
const ARROW_PX: [f64; 2] = [3.5, 6.0];

pub(super) fn panel(root: &mut Element, placed: &Placed<'_>) {
    let [[left, top], [right, bottom]] = placed.area;
    legend::draw(root, &placed.header, left, placed.top_px);
    if let Some(scales) = &placed.scales {
        let layers = &placed.panel.layers;
        let cells = |l: &Layer| matches!(l.kind, Kind::Cells { .. });
        // White is a value of zero: where there is no cell, there is no white. A grid would hide small cells.
        if layers.iter().any(cells) {
            let size = [right - left, bottom - top];
            root.push_line(svg::rect([left, top], size).filled(Colour::NO_CELL));
        }
        for layer in layers {
            areas(root, layer, placed, scales);
        }
        if !layers.iter().any(cells) {
            grid(root, placed, scales);
        }
        for layer in layers {
            curves(root, layer, placed, scales);
        }
    } else {
        let middle = [0.5 * (left + right), 0.5 * (top + bottom)];
        root.push_line(
            svg::text(middle, LETTER_PX, "no finite value to draw")
                .anchor(Anchor::Middle)
                .filled(Colour::GREY),
        );
    }
    root.push_line(
        svg::rect([left, top], [right - left, bottom - top])
            .fill("none")
            .stroked(Colour::FRAME, 1.0),
    );
    numbers(root, placed);
}

/// Draws the parts of a layer that lie behind the grid.
fn areas(root: &mut Element, layer: &Layer, placed: &Placed<'_>, [x, y]: &[Scale; 2]) {
    let [[left, top], [right, bottom]] = placed.area;
    // Between two places, in whatever order the axis has them.
    let mut shade = |a: [f64; 2], b: [f64; 2]| {
        let corner = [a[0].min(b[0]), a[1].min(b[1])];
        let size = [(a[0] - b[0]).abs(), (a[1] - b[1]).abs()];
        root.push_line(
            svg::rect(corner, size)
                .filled(layer.colour)
                .with("fill-opacity", SHADE),
        );
    };
    match &layer.kind {
        Kind::Windows(ranges) => {
            for [from, to] in ranges {
                let (a, b) = (x.within(*from), x.within(*to));
                // A window of one sample is drawn; one beyond the axis is not.
                if b > a || (a == *from && b == *to) {
                    shade([x.px(a), top], [x.px(b), bottom]);
                }
            }
        }
        Kind::Band([low, high]) => {
            let (a, b) = (y.within(*low), y.within(*high));
            if b > a {
                shade([left, y.px(a)], [right, y.px(b)]);
            }
        }
        Kind::Ribbon(points) => {
            let finite: Vec<&[f64; 3]> = points
                .iter()
                .filter(|p| p.iter().all(|v| v.is_finite()) && x.holds(p[0]))
                .collect();
            let mut path = Path::new();
            for p in &finite {
                path.to([x.px(p[0]), y.px(y.within(p[1]))]);
            }
            for p in finite.iter().rev() {
                path.to([x.px(p[0]), y.px(y.within(p[2]))]);
            }
            path.close();
            root.push_line(
                path.element()
                    .filled(layer.colour)
                    .with("fill-opacity", SHADE),
            );
        }
        Kind::Cells { cells, full, .. } => {
            cell_paper(root, cells, x, y);
            for c in cells {
                cell(root, c, *full, x, y);
            }
        }
        Kind::Line(_) | Kind::Dots { .. } | Kind::Marks(_) => {}
    }
}

/// Upper left corner and size of a cell \[px\]; `None` where it cannot be drawn.
fn cell_px(cell: &Cell, x: &Scale, y: &Scale) -> Option<[[f64; 2]; 2]> {
    let a = [x.px(x.within(cell.from[0])), y.px(y.within(cell.from[1]))];
    let b = [x.px(x.within(cell.to[0])), y.px(y.within(cell.to[1]))];
    let corner = [a[0].min(b[0]), a[1].min(b[1])];
    let size = [(a[0] - b[0]).abs(), (a[1] - b[1]).abs()];
    (cell.value.is_finite() && !size.contains(&0.0)).then_some([corner, size])
}

/// The paper under all cells, on which their tints lie.
fn cell_paper(root: &mut Element, cells: &[Cell], x: &Scale, y: &Scale) {
    let mut path = Path::new();
    for [[left, top], [width, height]] in cells.iter().filter_map(|c| cell_px(c, x, y)) {
        let (right, bottom) = (left + width, top + height);
        path.lift();
        for corner in [[left, top], [right, top], [right, bottom], [left, bottom]] {
            path.to(corner);
        }
        path.close();
    }
    if !path.is_empty() {
        root.push_line(path.element().filled(Colour::PAPER));
    }
}

fn cell(root: &mut Element, cell: &Cell, full: f64, x: &Scale, y: &Scale) {
    let Some([corner, size]) = cell_px(cell, x, y) else {
        return;
    };
    let (tint, opacity) = Colour::diverging(if full > 0.0 { cell.value / full } else { 0.0 });
    let mut shape = svg::rect(corner, size)
        .filled(tint)
        .number("fill-opacity", opacity);
    if !cell.hint.is_empty() {
        shape = shape.hint(&cell.hint);
    }
    root.push_line(shape);
}

/// Lines of the grid under the curves; zero stands out.
fn grid(root: &mut Element, placed: &Placed<'_>, [x, y]: &[Scale; 2]) {
    let [[left, top], [right, bottom]] = placed.area;
    let colour = |value: f64| {
        if value == 0.0 {
            Colour::ZERO
        } else {
            Colour::GRID
        }
    };
    for tick in &placed.y_ticks {
        let at = y.px(tick.value);
        root.push_line(svg::line([left, at], [right, at]).stroked(colour(tick.value), 1.0));
    }
    for tick in &placed.x_ticks {
        let at = x.px(tick.value);
        root.push_line(svg::line([at, top], [at, bottom]).stroked(Colour::GRID, 1.0));
    }
}

/// Marks, lines and dots.
fn curves(root: &mut Element, layer: &Layer, placed: &Placed<'_>, [x, y]: &[Scale; 2]) {
    let [[_, top], [_, bottom]] = placed.area;
    match &layer.kind {
        Kind::Marks(places) => {
            for at in places.iter().filter(|v| x.holds(**v)) {
                root.push_line(dashed([x.px(*at), top], bottom));
            }
        }
        Kind::Line(points) => {
            let placed_px = points.iter().map(|p| [x.px(p[0]), y.px(p[1])]);
            let path = trace::path(placed_px, placed.area);
            if !path.is_empty() {
                root.push_line(Form::of(layer.colour).line(path.element(), layer.colour));
            }
        }
        Kind::Dots { points, .. } => {
            let form = Form::of(layer.colour);
            let (mut inside, mut beyond) = (Path::new(), Path::new());
            for [a, b] in points {
                if !(a.is_finite() && b.is_finite()) {
                    continue;
                }
                let at = [x.px(x.within(*a)), y.px(y.within(*b))];
                if x.holds(*a) && y.holds(*b) {
                    form.dot(&mut inside, at, DOT_PX);
                } else {
                    let far = [x.px(*a), y.px(*b)];
                    arrow(&mut beyond, at, [far[0] - at[0], far[1] - at[1]]);
                }
            }
            if !inside.is_empty() {
                root.push_line(form.dots(inside, layer.colour, DOT_PX));
            }
            if !beyond.is_empty() {
                root.push_line(beyond.element().filled(layer.colour));
            }
        }
        Kind::Ribbon(_) | Kind::Band(_) | Kind::Windows(_) | Kind::Cells { .. } => {}
    }
}

/// A triangle inside the axes whose tip touches the edge and points where the dot lies.
fn arrow(path: &mut Path, tip: [f64; 2], out: [f64; 2]) {
    let length = out[0].hypot(out[1]);
    if length == 0.0 {
        path.dot(tip);
        return;
    }
    let [u, v] = [out[0] / length, out[1] / length];
    let [half, long] = ARROW_PX;
    path.lift();
    path.to(tip);
    path.to([tip[0] - long * u - half * v, tip[1] - long * v + half * u]);
    path.to([tip[0] - long * u + half * v, tip[1] - long * v - half * u]);
    path.close();
}

/// A dashed upright line.
pub(super) fn dashed(from: [f64; 2], to_y: f64) -> Element {
    svg::line(from, [from[0], to_y])
        .stroked(Colour::GREY, 1.0)
        .with("stroke-dasharray", "3 3")
}

/// Numbers and names of the axes.
fn numbers(root: &mut Element, placed: &Placed<'_>) {
    let [[left, top], [right, bottom]] = placed.area;
    if let Some([x, y]) = &placed.scales {
        for tick in &placed.y_ticks {
            let at = [left - TO_NUMBERS_PX, y.px(tick.value) + 0.35 * LETTER_PX];
            root.push_line(svg::text(at, LETTER_PX, &tick.label).anchor(Anchor::End));
        }
        for tick in placed.x_ticks.iter().filter(|_| placed.x_written) {
            let at = [x.px(tick.value), bottom + LINE_PX];
            root.push_line(svg::text(at, LETTER_PX, &tick.label).anchor(Anchor::Middle));
        }
    }
    if placed.x_written && !placed.x_label.is_empty() {
        let at = [0.5 * (left + right), bottom + 2.0 * LINE_PX];
        root.push_line(svg::text(at, LETTER_PX, &placed.x_label).anchor(Anchor::Middle));
    }
    let middle = 0.5 * (top + bottom);
    for (line, words) in (1..).zip(&placed.y_label) {
        let at = placed.cell_left_px + LINE_PX * f64::from(line) - 3.0;
        root.push_line(
            svg::text([0.0; 2], LETTER_PX, words)
                .anchor(Anchor::Middle)
                .with(
                    "transform",
                    format_args!("translate({at:.1} {middle:.1}) rotate(-90)"),
                ),
        );
    }
}
