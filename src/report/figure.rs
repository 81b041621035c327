//! Figures: panels with axes in columns, and on them lines, dots, bands, windows, marks and cells.
//!
//! Data go in as `[x, y]` in the unit that the axis names; the figure chooses ranges, ticks, margins and
//! the place of the legend, so that nothing overlaps and nothing is off the drawing.

mod draw;
mod form;
mod layout;
mod legend;
mod scale;
#[cfg(test)]
mod tests;
mod trace;
mod words;

use crate::colour::{self, Colour};
use crate::markup::Element;
use crate::svg;

/// One or more columns of panels. Each column is drawn from top to bottom.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    label: String,
    columns: Vec<Vec<Panel>>,
    shared_x: bool,
}

/// One pair of axes and what is drawn on them.
#[derive(Debug, Clone, PartialEq)]
pub struct Panel {
    title: String,
    height_px: f64,
    equal_scale: bool,
    x: Axis,
    y: Axis,
    layers: Vec<Layer>,
}

/// An axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    label: String,
    /// Values are seconds, written in the unit that suits their span.
    time: bool,
    limits: Option<[f64; 2]>,
    reversed: bool,
}

/// A part of a plane with a value, for heat maps.
#[derive(Debug, Clone, PartialEq)]
pub struct Cell {
    /// Least x and y.
    pub from: [f64; 2],
    /// Greatest x and y.
    pub to: [f64; 2],
    /// Value, in the unit that the heat map names.
    pub value: f64,
    /// Text that the pointer shows over it; empty for none.
    pub hint: String,
}

#[derive(Debug, Clone, PartialEq)]
struct Layer {
    /// Legend; empty for none.
    name: String,
    colour: Colour,
    kind: Kind,
}

#[derive(Debug, Clone, PartialEq)]
enum Kind {
    Line(Vec<[f64; 2]>),
    Dots {
        points: Vec<[f64; 2]>,
        /// Whether the axes are stretched to show them all.
        stretch: bool,
    },
    /// x, least y, greatest y.
    Ribbon(Vec<[f64; 3]>),
    /// Between two values of y over the whole width.
    Band([f64; 2]),
    /// Ranges of x over the whole height.
    Windows(Vec<[f64; 2]>),
    /// Places on x.
    Marks(Vec<f64>),
    Cells {
        cells: Vec<Cell>,
        /// Value at which the colours end.
        full: f64,
        unit: String,
    },
}

/// `[x, y]` of two columns of equal length.
pub fn points(x: &[f64], y: &[f64]) -> Vec<[f64; 2]> {
    x.iter().zip(y).map(|(x, y)| [*x, *y]).collect()
}

impl Figure {
    /// A figure without a panel; `label` says what it shows to those who cannot see it.
    pub fn new(label: impl Into<String>) -> Self {
        Figure {
            label: label.into(),
            columns: Vec::new(),
            shared_x: false,
        }
    }

    /// Panels one below the other.
    pub fn stack(label: impl Into<String>, panels: Vec<Panel>) -> Self {
        Figure::new(label).column(panels)
    }

    /// Adds a column to the right.
    #[must_use]
    pub fn column(mut self, panels: Vec<Panel>) -> Self {
        self.columns.push(panels);
        self
    }

    /// One abscissa for all panels of a column: the widest of their ranges, its numbers under the lowest alone.
    #[must_use]
    pub fn shared_x(mut self) -> Self {
        self.shared_x = true;
        self
    }

    /// The drawing, as wide as a page's column.
    pub fn element(&self) -> Element {
        layout::drawing(self, layout::WIDTH_PX)
    }

    /// The same drawn as wide as a phone, columns one below the other: letters keep their size.
    pub fn narrow(&self) -> Element {
        layout::drawing(self, layout::NARROW_PX)
    }

    /// The drawing as a file of its own, which follows a dark screen where its viewer reads CSS.
    pub fn file(&self) -> String {
        let rules = Element::new("style").text(&colour::dark_rules());
        svg::file(self.element().child_line(rules))
    }
}

impl Axis {
    /// An axis with its name and unit, `"time [s]"`, from the least to the greatest of the data.
    pub fn new(label: impl Into<String>) -> Self {
        Axis {
            label: label.into(),
            time: false,
            limits: None,
            reversed: false,
        }
    }

    /// Time in seconds; written in minutes where it spans ten of them or more.
    pub fn time() -> Self {
        Axis {
            time: true,
            ..Axis::new("time")
        }
    }

    /// Sets the ends, least first; lines are cut there, dots beyond become arrows at the edge.
    #[must_use]
    pub fn limits(mut self, limits: [f64; 2]) -> Self {
        self.limits = Some(limits);
        self
    }

    /// Runs the other way: leftwards, or downwards as the rows of an image do.
    #[must_use]
    pub fn reversed(mut self) -> Self {
        self.reversed = true;
        self
    }
}

impl Panel {
    /// Height between the axes' ends unless [`Panel::height`] says otherwise \[px\].
    pub const HEIGHT_PX: f64 = 150.0;

    /// A panel without data.
    pub fn new(title: impl Into<String>, x: Axis, y: Axis) -> Self {
        Panel {
            title: title.into(),
            height_px: Panel::HEIGHT_PX,
            equal_scale: false,
            x,
            y,
            layers: Vec::new(),
        }
    }

    /// Sets the height between the axes' ends \[px\].
    #[must_use]
    pub fn height(mut self, height_px: f64) -> Self {
        self.height_px = height_px;
        self
    }

    /// Draws a unit of x as long as a unit of y; the height follows from the width.
    #[must_use]
    pub fn equal_scale(mut self) -> Self {
        self.equal_scale = true;
        self
    }

    /// A line through points in their order; one that is not finite breaks it.
    #[must_use]
    pub fn line(self, name: &str, colour: Colour, points: Vec<[f64; 2]>) -> Self {
        self.layer(name, colour, Kind::Line(points))
    }

    /// Dots; the axes are stretched to show them.
    #[must_use]
    pub fn dots(self, name: &str, colour: Colour, points: Vec<[f64; 2]>) -> Self {
        let stretch = true;
        self.layer(name, colour, Kind::Dots { points, stretch })
    }

    /// Dots that stretch no axis, as outliers are: those beyond it become arrows at the edge.
    #[must_use]
    pub fn outliers(self, name: &str, colour: Colour, points: Vec<[f64; 2]>) -> Self {
        let stretch = false;
        self.layer(name, colour, Kind::Dots { points, stretch })
    }

    /// The area between two curves, as `[x, least y, greatest y]`.
    #[must_use]
    pub fn ribbon(self, name: &str, colour: Colour, points: Vec<[f64; 3]>) -> Self {
        self.layer(name, colour, Kind::Ribbon(points))
    }

    /// The area between two values of y.
    #[must_use]
    pub fn band(self, name: &str, colour: Colour, range: [f64; 2]) -> Self {
        self.layer(name, colour, Kind::Band(range))
    }

    /// Ranges of x, shaded; the axes are not stretched to show them.
    #[must_use]
    pub fn windows(self, name: &str, colour: Colour, ranges: Vec<[f64; 2]>) -> Self {
        self.layer(name, colour, Kind::Windows(ranges))
    }

    /// Dashed lines at places on x; the axes are not stretched to show them.
    #[must_use]
    pub fn marks(self, name: &str, places: Vec<f64>) -> Self {
        self.layer(name, Colour::GREY, Kind::Marks(places))
    }

    /// A heat map: blue at `-full`, white at 0, red at `full`, both in `unit`.
    #[must_use]
    pub fn cells(self, cells: Vec<Cell>, full: f64, unit: &str) -> Self {
        let unit = unit.to_owned();
        let kind = Kind::Cells { cells, full, unit };
        self.layer("", Colour::GREY, kind)
    }

    fn layer(mut self, name: &str, colour: Colour, kind: Kind) -> Self {
        self.layers.push(Layer {
            name: name.to_owned(),
            colour,
            kind,
        });
        self
    }

    /// Values that the axis of x (0) or y (1) must show.
    fn shown(&self, axis: usize) -> impl Iterator<Item = f64> + '_ {
        self.layers.iter().flat_map(move |l| l.kind.shown(axis))
    }
}

impl Kind {
    fn shown(&self, axis: usize) -> Vec<f64> {
        match self {
            Kind::Line(points)
            | Kind::Dots {
                points,
                stretch: true,
            } => points.iter().map(|p| p[axis]).collect(),
            Kind::Ribbon(points) if axis == 0 => points.iter().map(|p| p[0]).collect(),
            Kind::Ribbon(points) => points.iter().flat_map(|p| [p[1], p[2]]).collect(),
            Kind::Band(range) if axis == 1 => range.to_vec(),
            Kind::Cells { cells, .. } => cells
                .iter()
                .flat_map(|c| [c.from[axis], c.to[axis]])
                .collect(),
            Kind::Dots { .. } | Kind::Band(_) | Kind::Windows(_) | Kind::Marks(_) => Vec::new(),
        }
    }

    /// Nothing of it can be drawn.
    fn is_empty(&self) -> bool {
        let finite = |p: &[f64]| p.iter().all(|v| v.is_finite());
        !match self {
            Kind::Line(points) | Kind::Dots { points, .. } => points.iter().any(|p| finite(p)),
            Kind::Ribbon(points) => points.iter().any(|p| finite(p)),
            Kind::Band(range) => finite(range),
            Kind::Windows(ranges) => ranges.iter().any(|r| finite(r)),
            Kind::Marks(places) => places.iter().any(|v| v.is_finite()),
            Kind::Cells { cells, .. } => cells.iter().any(|c| c.value.is_finite()),
        }
    }
}
