//! Look of a series besides its colour: width and dashes of its line, shape of its dots. So a figure reads in
//! grey, and to eyes that see few hues.

use crate::colour::Colour;
use crate::markup::Element;
use crate::svg::Path;

/// Line and dots of a series.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Form {
    width_px: f64,
    opacity: f64,
    /// Lengths of dashes and gaps under round caps; empty for none.
    dashes: &'static str,
    marker: Marker,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Marker {
    Round,
    Square,
    Triangle,
    Diamond,
    Cross,
    Plus,
}

/// Width of a line \[px\].
const LINE_PX: f64 = 1.5;
/// Width of a line that others are laid on \[px\]: a thin one leaves it visible on both sides.
const BROAD_PX: f64 = 3.4;
/// Opacity of such a line.
const PALE: f64 = 0.45;
/// Stroke of markers that are two lines \[px\].
const STROKE_PX: f64 = 1.2;

impl Form {
    pub fn of(colour: Colour) -> Self {
        let (dashes, marker) = match colour {
            Colour::VERMILLION => ("6 4", Marker::Square),
            Colour::GREEN => ("0.5 3.5", Marker::Triangle),
            Colour::PURPLE => ("9 4 0.5 4", Marker::Diamond),
            Colour::ORANGE => ("13 5", Marker::Cross),
            Colour::SKY => ("5 4 0.5 4 0.5 4", Marker::Plus),
            _ => ("", Marker::Round),
        };
        // Measurements lie broad and pale behind the models.
        let measured = colour == Colour::GREY;
        Form {
            width_px: if measured { BROAD_PX } else { LINE_PX },
            opacity: if measured { PALE } else { 1.0 },
            dashes,
            marker,
        }
    }

    /// Draws a path as a series' line.
    pub fn line(self, shape: Element, colour: Colour) -> Element {
        let mut line = shape.fill("none").stroked(colour, self.width_px);
        if self.opacity < 1.0 {
            line = line.with("stroke-opacity", self.opacity);
        }
        if !self.dashes.is_empty() {
            line = line.with("stroke-dasharray", self.dashes);
        }
        line.with("stroke-linejoin", "round")
            .with("stroke-linecap", "round")
    }

    /// Adds a dot to a path that [`Form::dots`] draws, `size_px` across.
    pub fn dot(self, path: &mut Path, [x, y]: [f64; 2], size_px: f64) {
        let half = 0.5 * size_px;
        match self.marker {
            Marker::Round | Marker::Square => path.dot([x, y]),
            Marker::Triangle => corners(
                path,
                &[[x, y - half], [x + half, y + half], [x - half, y + half]],
            ),
            Marker::Diamond => corners(
                path,
                &[[x, y - half], [x + half, y], [x, y + half], [x - half, y]],
            ),
            Marker::Cross => {
                stroke(path, [x - half, y - half], [x + half, y + half]);
                stroke(path, [x - half, y + half], [x + half, y - half]);
            }
            Marker::Plus => {
                stroke(path, [x - half, y], [x + half, y]);
                stroke(path, [x, y - half], [x, y + half]);
            }
        }
    }

    /// Dots of one series: one path, a tenth of the size of as many shapes.
    pub fn dots(self, path: Path, colour: Colour, size_px: f64) -> Element {
        let shape = path.element();
        let capped = |cap: &str, width_px: f64| {
            let stroked = shape.clone().fill("none").stroked(colour, width_px);
            stroked.with("stroke-linecap", cap)
        };
        match self.marker {
            Marker::Round => capped("round", size_px),
            Marker::Square => capped("square", size_px),
            Marker::Triangle | Marker::Diamond => shape.filled(colour),
            Marker::Cross | Marker::Plus => capped("round", STROKE_PX),
        }
    }
}

fn corners(path: &mut Path, corners: &[[f64; 2]]) {
    path.lift();
    for at in corners {
        path.to(*at);
    }
    path.close();
}

fn stroke(path: &mut Path, from: [f64; 2], to: [f64; 2]) {
    path.lift();
    path.to(from);
    path.to(to);
    path.lift();
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_two_series_are_distinguished_by_colour_alone() {
        let mut forms: Vec<Form> = (0..6).map(|k| Form::of(Colour::series(k))).collect();
        forms.push(Form::of(Colour::GREY));
        for (k, a) in forms.iter().enumerate() {
            for b in &forms[..k] {
                assert_ne!((a.dashes, a.width_px), (b.dashes, b.width_px));
            }
        }
        let markers: Vec<Marker> = forms[..6].iter().map(|f| f.marker).collect();
        assert!((1..6).all(|k| !markers[..k].contains(&markers[k])));
    }

    #[test]
    fn a_marker_is_drawn_about_its_point() {
        let mut path = Path::new();
        Form::of(Colour::PURPLE).dot(&mut path, [10.0, 20.0], 4.0);
        let drawn = Form::of(Colour::PURPLE).dots(path, Colour::PURPLE, 4.0);
        assert_eq!(
            drawn.to_string(),
            "<path d=\"M10 18L12 20L10 22L8 20z\" fill=\"#cc79a7\" class=\"f-purple\"/>"
        );
    }
}
