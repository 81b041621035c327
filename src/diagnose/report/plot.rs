//! Line plots with what a diagnosis must show on them: shaded windows, marks, a noise band, points left out.
//!
//! Own SVG writer, as for `identify`: the page must hold no script and fetch nothing.

use std::fmt::Write as _;

use hydroline_identify::report::escape;

/// Width of every plot \[px\].
pub const WIDTH: f64 = 860.0;
const LEFT: f64 = 64.0;
const RIGHT: f64 = 12.0;
const TOP: f64 = 24.0;
const BOTTOM: f64 = 34.0;
/// Points per line at most: more than the plot is wide are not seen.
const POINTS: usize = 1200;

/// One line.
#[derive(Debug, Clone)]
pub struct Line<'a> {
    /// CSS colour.
    pub colour: &'a str,
    /// Legend.
    pub name: &'a str,
    /// Values in the plot's unit; NaN breaks the line.
    pub values: Vec<f64>,
}

/// One plot: lines over a common abscissa.
#[derive(Debug, Clone, Default)]
pub struct Plot<'a> {
    /// Height \[px\].
    pub height: f64,
    /// Over the plot.
    pub title: String,
    /// Abscissa.
    pub x: &'a [f64],
    /// Its name and unit.
    pub x_label: &'a str,
    /// Unit of the ordinate.
    pub y_label: &'a str,
    /// Lines.
    pub lines: Vec<Line<'a>>,
    /// Shaded ranges of the abscissa, with their colour.
    pub shaded: Vec<([f64; 2], &'a str)>,
    /// Vertical marks.
    pub marks: Vec<f64>,
    /// A grey band about 0: the noise floor, in the ordinate's unit.
    pub band: Option<f64>,
    /// Points that stand alone: (x, y).
    pub dots: Vec<(f64, f64)>,
}

/// A step of 1, 2 or 5 times a power of ten that cuts a span into four to nine parts.
fn step(span: f64) -> f64 {
    let raw = span / 5.0;
    let power = 10f64.powf(raw.log10().floor());
    let share = raw / power;
    power
        * if share < 1.5 {
            1.0
        } else if share < 3.5 {
            2.0
        } else if share < 7.5 {
            5.0
        } else {
            10.0
        }
}

fn ticks(low: f64, high: f64) -> Vec<(f64, String)> {
    let step = step(high - low);
    let places = (-step.log10().floor()).clamp(0.0, 9.0) as usize;
    let first = (low / step).ceil() as i64;
    let last = (high / step).floor() as i64;
    (first..=last.min(first + 20))
        .map(|k| (k as f64 * step, format!("{:.places$}", k as f64 * step)))
        .collect()
}

fn span(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    let (low, high) = values
        .filter(|v| v.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
            (l.min(v), h.max(v))
        });
    if high > low {
        Some((low, high))
    } else if high == low {
        Some((low - 1.0, high + 1.0))
    } else {
        None
    }
}

impl Plot<'_> {
    /// The plot as SVG elements `top` px below the origin; empty where there is nothing finite to draw.
    pub fn elements(&self, top: f64) -> String {
        let Some((x0, x1)) = span(self.x.iter().copied()) else {
            return String::new();
        };
        let own = self.lines.iter().flat_map(|l| l.values.iter().copied());
        let band = self.band.into_iter().flat_map(|b| [-1.5 * b, 1.5 * b]);
        let Some((low, high)) = span(own.chain(band)) else {
            return String::new();
        };
        let pad = 0.06 * (high - low);
        let (low, high) = (low - pad, high + pad);
        let x = |v: f64| LEFT + (WIDTH - LEFT - RIGHT) * (v - x0) / (x1 - x0);
        let y = |v: f64| top + TOP + (self.height - TOP - BOTTOM) * (high - v) / (high - low);
        let (floor, ceiling) = (top + self.height - BOTTOM, top + TOP);
        let mut svg = String::new();
        for ([from, to], colour) in &self.shaded {
            let (a, b) = (x(from.max(x0)), x(to.min(x1)));
            if b > a {
                let _ = write!(
                    svg,
                    "<rect x=\"{a:.1}\" width=\"{:.1}\" y=\"{ceiling:.1}\" height=\"{:.1}\" fill=\"{colour}\" fill-opacity=\"0.16\"/>",
                    b - a,
                    floor - ceiling
                );
            }
        }
        if let Some(b) = self.band {
            let _ = write!(
                svg,
                "<rect x=\"{LEFT}\" width=\"{:.1}\" y=\"{:.1}\" height=\"{:.1}\" fill=\"#888\" fill-opacity=\"0.22\"/>",
                WIDTH - LEFT - RIGHT,
                y(b),
                y(-b) - y(b)
            );
        }
        for (v, text) in ticks(low, high) {
            let _ = write!(
                svg,
                "<line x1=\"{LEFT}\" x2=\"{0}\" y1=\"{1:.1}\" y2=\"{1:.1}\" stroke=\"#e4e4e4\"/><text x=\"{2}\" y=\"{3:.1}\" text-anchor=\"end\">{text}</text>",
                WIDTH - RIGHT,
                y(v),
                LEFT - 6.0,
                y(v) + 4.0
            );
        }
        for (v, text) in ticks(x0, x1) {
            let _ = write!(
                svg,
                "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{text}</text>",
                x(v),
                floor + 14.0
            );
        }
        for mark in self.marks.iter().filter(|m| (x0..=x1).contains(*m)) {
            let _ = write!(
                svg,
                "<line x1=\"{0:.1}\" x2=\"{0:.1}\" y1=\"{ceiling:.1}\" y2=\"{floor:.1}\" stroke=\"#777\" stroke-dasharray=\"3 3\"/>",
                x(*mark)
            );
        }
        for line in &self.lines {
            let stride = line.values.len().div_ceil(POINTS).max(1);
            let (mut path, mut pen) = (String::new(), 'M');
            for (a, b) in self.x.iter().zip(&line.values).step_by(stride) {
                if a.is_finite() && b.is_finite() {
                    let _ = write!(path, "{pen}{:.1} {:.1}", x(*a), y(*b));
                    pen = 'L';
                } else {
                    pen = 'M';
                }
            }
            let _ = write!(
                svg,
                "<path d=\"{path}\" fill=\"none\" stroke=\"{}\" stroke-width=\"1.4\"/>",
                line.colour
            );
        }
        for (a, b) in &self.dots {
            if a.is_finite() && b.is_finite() && (low..=high).contains(b) {
                let _ = write!(
                    svg,
                    "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"2\" fill=\"#a0a\"/>",
                    x(*a),
                    y(*b)
                );
            }
        }
        let _ = write!(
            svg,
            "<text x=\"{LEFT}\" y=\"{0:.1}\" font-weight=\"bold\">{1}</text><text x=\"{2}\" y=\"{3:.1}\" text-anchor=\"end\">{4}</text><text x=\"4\" y=\"{5:.1}\">{6}</text>",
            top + 15.0,
            escape(&self.title),
            WIDTH - RIGHT,
            floor + 29.0,
            escape(self.x_label),
            floor + 29.0,
            escape(self.y_label)
        );
        let mut right = WIDTH - RIGHT;
        for line in self.lines.iter().rev().filter(|l| !l.name.is_empty()) {
            let _ = write!(
                svg,
                "<text x=\"{right:.1}\" y=\"{:.1}\" text-anchor=\"end\" fill=\"{}\">{}</text>",
                top + 15.0,
                line.colour,
                escape(line.name)
            );
            right -= 6.6 * line.name.chars().count() as f64 + 14.0;
        }
        svg
    }
}

/// Plots one under the other, as a whole SVG file (it also stands inside a page).
pub fn stack(plots: &[Plot<'_>]) -> String {
    let height: f64 = plots.iter().map(|p| p.height).sum();
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{WIDTH}\" height=\"{height}\" viewBox=\"0 0 {WIDTH} {height}\" font-size=\"11\" font-family=\"sans-serif\"><rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>"
    );
    let mut top = 0.0;
    for plot in plots {
        svg += &plot.elements(top);
        top += plot.height;
    }
    svg += "</svg>";
    svg
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        let labels: Vec<String> = ticks(-0.013, 0.041).into_iter().map(|t| t.1).collect();
        assert_eq!(labels, ["-0.01", "0.00", "0.01", "0.02", "0.03", "0.04"]);
        assert!(ticks(0.0, 24.0).len() >= 4);
    }

    #[test]
    fn a_plot_holds_its_lines_windows_and_band_and_no_nan() {
        let x = [0.0, 1.0, 2.0, 3.0];
        let svg = stack(&[Plot {
            height: 200.0,
            title: "a<b".to_owned(),
            x: &x,
            x_label: "s",
            y_label: "mm",
            lines: vec![Line {
                colour: "#c30",
                name: "before",
                values: vec![0.0, f64::NAN, 2.0, 3.0],
            }],
            shaded: vec![([0.5, 9.0], "#c00"), ([5.0, 6.0], "#c00")],
            marks: vec![1.0, 7.0],
            band: Some(0.2),
            dots: vec![(1.0, 1.0), (1.0, 1e9)],
        }]);
        assert!(svg.starts_with("<svg") && svg.ends_with("</svg>") && svg.contains("a&lt;b"));
        assert_eq!(svg.matches("fill-opacity=\"0.16\"").count(), 1);
        assert_eq!(svg.matches("stroke-dasharray").count(), 1);
        assert_eq!(svg.matches("<circle").count(), 1);
        assert_eq!(svg.matches('M').count(), 2);
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
    }

    #[test]
    fn nothing_finite_draws_nothing() {
        let plot = Plot {
            height: 100.0,
            x: &[0.0, 1.0],
            lines: vec![Line {
                colour: "#000",
                name: "",
                values: vec![f64::NAN; 2],
            }],
            ..Plot::default()
        };
        assert_eq!(plot.elements(0.0), "");
    }
}
