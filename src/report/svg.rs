//! SVG 1.1: shapes, text, and a whole file.
//!
//! Coordinates are in user units, y down. For figures a unit is a pixel; for drawings at true
//! scale [`root`] is given `"mm"`, and one unit is one millimetre on paper.

use crate::colour::Colour;
use crate::markup::{Element, rounded};
use std::fmt::{Display, Write as _};

/// Namespace of an SVG file; inside an HTML page it is implied.
const NAMESPACE: &str = "http://www.w3.org/2000/svg";

/// The outermost element: `size` in `unit` (`"mm"`, or `""` for pixels), one user unit each.
pub fn root(size: [f64; 2], unit: &str) -> Element {
    let [width, height] = size.map(rounded);
    Element::new("svg")
        .with("width", format_args!("{width}{unit}"))
        .with("height", format_args!("{height}{unit}"))
        .with("viewBox", format_args!("0 0 {width} {height}"))
}

/// A file of its own from what [`root`] made.
pub fn file(root: Element) -> String {
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n{}\n",
        root.with("xmlns", NAMESPACE)
    )
}

/// A straight line.
pub fn line(from: [f64; 2], to: [f64; 2]) -> Element {
    Element::closed("line")
        .number("x1", from[0])
        .number("y1", from[1])
        .number("x2", to[0])
        .number("y2", to[1])
}

/// A rectangle from its upper left corner.
pub fn rect(corner: [f64; 2], size: [f64; 2]) -> Element {
    Element::closed("rect")
        .number("x", corner[0])
        .number("y", corner[1])
        .number("width", size[0])
        .number("height", size[1])
}

/// A circle.
pub fn circle(centre: [f64; 2], radius: f64) -> Element {
    Element::closed("circle")
        .number("cx", centre[0])
        .number("cy", centre[1])
        .number("r", radius)
}

/// A closed polygon; left out where a corner is not finite.
pub fn polygon(corners: &[[f64; 2]]) -> Element {
    let list: Vec<String> = corners
        .iter()
        .map(|[x, y]| format!("{},{}", rounded(*x), rounded(*y)))
        .collect();
    let whole = corners.iter().flatten().all(|v| v.is_finite());
    let polygon = Element::closed("polygon").with("points", list.join(" "));
    // One number that cannot be drawn takes the polygon out, as it does every other shape.
    if whole {
        polygon
    } else {
        polygon.number("x", f64::NAN)
    }
}

/// Words from the left end of their base line.
pub fn text(at: [f64; 2], size: f64, words: &str) -> Element {
    Element::new("text")
        .number("x", at[0])
        .number("y", at[1])
        .number("font-size", size)
        .text(words)
}

impl Element {
    /// Fills with a colour of CSS; `"none"` for outlines.
    #[must_use]
    pub fn fill(self, colour: impl Display) -> Self {
        self.with("fill", colour)
    }

    /// Draws the outline in a colour of CSS, `width` user units wide.
    #[must_use]
    pub fn stroke(self, colour: impl Display, width: f64) -> Self {
        self.with("stroke", colour).number("stroke-width", width)
    }

    /// Fills with a colour of the reports, which follows the reader's screen.
    #[must_use]
    pub(crate) fn filled(self, colour: Colour) -> Self {
        let filled = self.fill(colour);
        match colour.class() {
            Some(class) => filled.with("class", format_args!("f-{class}")),
            None => filled,
        }
    }

    /// Draws the outline in a colour of the reports, which follows the reader's screen.
    #[must_use]
    pub(crate) fn stroked(self, colour: Colour, width: f64) -> Self {
        let stroked = self.stroke(colour, width);
        match colour.class() {
            Some(class) => stroked.with("class", format_args!("s-{class}")),
            None => stroked,
        }
    }

    /// Words that the pointer shows over this shape.
    #[must_use]
    pub fn hint(self, words: &str) -> Self {
        self.child(Element::new("title").text(words))
    }
}

/// Where text stands against its point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Anchor {
    /// Begins there.
    Start,
    /// Is centred there.
    Middle,
    /// Ends there.
    End,
}

impl Element {
    /// Sets where text stands against its point.
    #[must_use]
    pub fn anchor(self, anchor: Anchor) -> Self {
        match anchor {
            Anchor::Start => self,
            Anchor::Middle => self.with("text-anchor", "middle"),
            Anchor::End => self.with("text-anchor", "end"),
        }
    }
}

/// A path of straight parts, coordinates to a tenth of a unit. A point that is not finite lifts the pen.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Path {
    data: String,
    /// A part is being drawn.
    down: bool,
    /// It has one point so far.
    lone: bool,
}

impl Path {
    /// A path without a point.
    pub fn new() -> Self {
        Path::default()
    }

    /// Draws on to a point, or begins there after [`Path::lift`].
    pub fn to(&mut self, [x, y]: [f64; 2]) {
        if !(x.is_finite() && y.is_finite()) {
            self.lift();
            return;
        }
        let pen = if self.down { 'L' } else { 'M' };
        // Writing to a String cannot fail.
        let _ = write!(self.data, "{pen}{} {}", tenth(x), tenth(y));
        self.lone = !self.down;
        self.down = true;
    }

    /// Ends the part; one of a single point becomes a dot under a round line cap.
    pub fn lift(&mut self) {
        if self.lone {
            self.data.push_str("h0");
        }
        (self.lone, self.down) = (false, false);
    }

    /// A dot under a round line cap.
    pub fn dot(&mut self, at: [f64; 2]) {
        self.lift();
        self.to(at);
        self.lift();
    }

    /// Closes the part to an area.
    pub fn close(&mut self) {
        if self.down {
            self.data.push('z');
        }
        (self.lone, self.down) = (false, false);
    }

    /// No point was drawn.
    pub fn is_empty(&self) -> bool {
        self.data.is_empty()
    }

    /// The path as an element, neither filled nor stroked yet.
    pub fn element(mut self) -> Element {
        self.lift();
        Element::closed("path").with("d", self.data)
    }
}

fn tenth(value: f64) -> f64 {
    (value * 10.0).round() / 10.0 + 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_keeps_the_unit_of_its_size() {
        let svg = file(root([12.5, 0.1 + 0.2], "mm").child_line(line([0.0; 2], [1.0, 2.0])));
        assert_eq!(
            svg,
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<svg width=\"12.5mm\" height=\"0.3mm\" viewBox=\"0 0 12.5 0.3\" \
             xmlns=\"http://www.w3.org/2000/svg\">\n<line x1=\"0\" y1=\"0\" x2=\"1\" y2=\"2\"/>\n</svg>\n"
        );
    }

    #[test]
    fn a_path_breaks_at_what_is_not_finite_and_a_lone_point_is_a_dot() {
        let mut path = Path::new();
        for p in [
            [0.0, 0.0],
            [1.04, -0.01],
            [f64::NAN, 1.0],
            [2.0, 2.0],
            [3.0, f64::INFINITY],
            [4.0, 4.0],
            [5.0, 5.0],
        ] {
            path.to(p);
        }
        assert_eq!(
            path.element().to_string(),
            "<path d=\"M0 0L1 0M2 2h0M4 4L5 5\"/>"
        );
    }

    #[test]
    fn a_shape_with_a_corner_that_is_not_finite_is_not_drawn() {
        let corners = [[0.0, 0.0], [1.0, f64::NAN], [1.0, 1.0]];
        let drawn = |shape: Element| Element::new("g").child(shape).to_string() != "<g></g>";
        assert!(!drawn(polygon(&corners)));
        assert!(drawn(polygon(&corners[..1])));
        assert!(!drawn(rect([0.0; 2], [f64::INFINITY, 1.0])));
    }
}
