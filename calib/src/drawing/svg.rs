//! SVG 1.1: sizes in mm and one user unit per mm, so that printers keep the scale.

use super::{Layer, Shape, Sheet};
use hydroline_report::markup::Element;
use hydroline_report::svg;

/// Width of lines that are cut or only read \[mm\]: what a laser cutter takes for a cut.
const LINE_MM: f64 = 0.2;
const NOTE_COLOUR: &str = "#c00";

/// The sheet as SVG. Places are written to a micrometre.
pub fn write(sheet: &Sheet) -> String {
    // SVG's y runs down.
    let down = |p: [f64; 2]| [p[0], sheet.size_mm[1] - p[1]];
    let mut root =
        svg::root(sheet.size_mm, "mm").child_line(Element::new("title").text(&sheet.title));
    for shape in &sheet.shapes {
        root.push_line(match shape {
            Shape::Polygon(layer, points) => {
                let corners: Vec<[f64; 2]> = points.iter().map(|p| down(*p)).collect();
                styled(svg::polygon(&corners), *layer)
            }
            Shape::Circle(layer, at, diameter) => {
                styled(svg::circle(down(*at), 0.5 * diameter), *layer)
            }
            Shape::Line(layer, a, b) => styled(svg::line(down(*a), down(*b)), *layer),
            Shape::Text(at, height, words) => svg::text(down(*at), *height, words)
                .class(Layer::Note.name())
                .with("font-family", "sans-serif")
                .fill(NOTE_COLOUR),
        });
    }
    svg::file(root)
}

fn styled(shape: Element, layer: Layer) -> Element {
    let shape = shape.class(layer.name());
    match layer {
        Layer::Cut => shape.fill("none").stroke("black", LINE_MM),
        Layer::Mark => shape.fill("black"),
        Layer::Light => shape.fill("white"),
        Layer::Block => shape.fill("none").stroke("blue", LINE_MM),
        Layer::Note => shape.fill("none").stroke(NOTE_COLOUR, LINE_MM),
    }
}
