//! SVG 1.1: sizes in mm and one user unit per mm, so that printers keep the scale.

use std::fmt::Write;

use super::{Layer, Shape, Sheet};

/// The sheet as SVG.
pub fn write(sheet: &Sheet) -> String {
    let [w, h] = sheet.size_mm;
    let mut out = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<svg xmlns=\"http://www.w3.org/2000/svg\" \
         width=\"{w}mm\" height=\"{h}mm\" viewBox=\"0 0 {w} {h}\">\n<title>{}</title>\n",
        escape(&sheet.title)
    );
    // SVG's y runs down.
    let y = |v: f64| round(h - v);
    for shape in &sheet.shapes {
        let _ = match shape {
            Shape::Polygon(layer, points) => {
                let list: Vec<String> = points
                    .iter()
                    .map(|p| format!("{},{}", round(p[0]), y(p[1])))
                    .collect();
                writeln!(
                    out,
                    "<polygon class=\"{}\" points=\"{}\" {}/>",
                    layer.name(),
                    list.join(" "),
                    style(*layer)
                )
            }
            Shape::Circle(layer, at, diameter) => writeln!(
                out,
                "<circle class=\"{}\" cx=\"{}\" cy=\"{}\" r=\"{}\" {}/>",
                layer.name(),
                round(at[0]),
                y(at[1]),
                round(0.5 * diameter),
                style(*layer)
            ),
            Shape::Line(layer, a, b) => writeln!(
                out,
                "<line class=\"{}\" x1=\"{}\" y1=\"{}\" x2=\"{}\" y2=\"{}\" {}/>",
                layer.name(),
                round(a[0]),
                y(a[1]),
                round(b[0]),
                y(b[1]),
                style(*layer)
            ),
            Shape::Text(at, height, words) => writeln!(
                out,
                "<text class=\"NOTE\" x=\"{}\" y=\"{}\" font-size=\"{height}\" font-family=\"sans-serif\" fill=\"#c00\">{}</text>",
                round(at[0]),
                y(at[1]),
                escape(words)
            ),
        };
    }
    out.push_str("</svg>\n");
    out
}

fn style(layer: Layer) -> &'static str {
    match layer {
        Layer::Cut => "fill=\"none\" stroke=\"black\" stroke-width=\"0.2\"",
        Layer::Mark => "fill=\"black\" stroke=\"none\"",
        Layer::Light => "fill=\"white\" stroke=\"none\"",
        Layer::Block => "fill=\"none\" stroke=\"blue\" stroke-width=\"0.2\"",
        Layer::Note => "stroke=\"#c00\" stroke-width=\"0.2\"",
    }
}

/// To a micrometre: shorter files, and no 1e-14 left over.
fn round(mm: f64) -> f64 {
    (mm * 1e3).round() / 1e3
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}
