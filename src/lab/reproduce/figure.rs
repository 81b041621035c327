//! Figures as data, CSV and SVG.

use hydroline_report::{Axis, Colour, Panel};
use serde::Serialize;
use std::fmt::Write;

/// One curve or cloud.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Series {
    /// Name in the legend.
    pub name: String,
    /// x, y.
    pub points: Vec<[f64; 2]>,
    /// Dots instead of a line.
    pub dots: bool,
}

/// A diagram.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Figure {
    /// Title of the diagram.
    pub title: String,
    /// Axes with units.
    pub axes: [String; 2],
    /// Curves and clouds.
    pub series: Vec<Series>,
    /// Numbers to be read beside it.
    pub notes: Vec<String>,
}

/// Height between the axes' ends \[px\].
const HEIGHT_PX: f64 = 440.0;

impl Figure {
    /// `series,x,y`, one line per point.
    pub fn csv(&self) -> String {
        let quoted = |text: &str| format!("\"{}\"", text.replace('"', "\"\""));
        let mut out = format!(
            "series,{},{}\n",
            quoted(&self.axes[0]),
            quoted(&self.axes[1])
        );
        for s in &self.series {
            for [x, y] in &s.points {
                // Writing to a String cannot fail.
                let _ = writeln!(out, "{},{x},{y}", quoted(&s.name));
            }
        }
        out
    }

    /// A drawing of its own, no other file needed.
    pub fn svg(&self) -> String {
        let [x, y] = self.axes.each_ref().map(Axis::new);
        let empty = Panel::new(&self.title, x, y).height(HEIGHT_PX);
        let panel = self.series.iter().enumerate().fold(empty, |panel, (k, s)| {
            let (colour, points) = (Colour::series(k), s.points.clone());
            if s.dots {
                panel.dots(&s.name, colour, points)
            } else {
                panel.line(&s.name, colour, points)
            }
        });
        hydroline_report::Figure::stack(&self.title, vec![panel]).file()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_series_is_in_the_drawing_and_every_point_in_the_csv() {
        let series = |name: &str, points: &[[f64; 2]], dots| Series {
            name: name.to_owned(),
            points: points.to_vec(),
            dots,
        };
        let figure = Figure {
            title: "a < b".to_owned(),
            axes: ["x [mm]".to_owned(), "y \"up\"".to_owned()],
            series: vec![
                series("line", &[[-3.0, 0.02], [7.0, -0.4]], false),
                series("cloud", &[[1.0, 0.3]], true),
            ],
            notes: Vec::new(),
        };
        let svg = figure.svg();
        for words in ["a &lt; b", ">line<", ">cloud<", ">x [mm]<"] {
            assert!(svg.contains(words), "{words}");
        }
        assert_eq!(figure.csv().lines().count(), 4);
        assert!(
            figure
                .csv()
                .starts_with("series,\"x [mm]\",\"y \"\"up\"\"\"\n")
        );
    }

    #[test]
    fn nothing_to_draw_is_no_panic() {
        let figure = Figure {
            title: String::new(),
            axes: [String::new(), String::new()],
            series: Vec::new(),
            notes: Vec::new(),
        };
        assert!(figure.svg().ends_with("</svg>\n"));
    }
}
