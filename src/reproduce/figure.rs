//! Figures as data, CSV and SVG.

use serde::Serialize;
use std::fmt::Write;

/// One curve or cloud.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Series {
    /// What it is.
    pub name: String,
    /// x, y.
    pub points: Vec<[f64; 2]>,
    /// Dots instead of a line.
    pub dots: bool,
}

/// A diagram.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Figure {
    /// Title.
    pub title: String,
    /// Axes with units.
    pub axes: [String; 2],
    /// Contents.
    pub series: Vec<Series>,
    /// Numbers to be read beside it.
    pub notes: Vec<String>,
}

/// Size and margins of the drawing.
const SIZE: [f64; 2] = [760.0, 520.0];
const MARGIN: [f64; 4] = [70.0, 40.0, 20.0, 60.0];
const COLOURS: [&str; 4] = ["#1f5fa8", "#2c8a3d", "#c0392b", "#7d3c98"];

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
        let x = Axis::over(self.points().map(|p| p[0]), MARGIN[0], SIZE[0] - MARGIN[2]);
        let y = Axis::over(self.points().map(|p| p[1]), SIZE[1] - MARGIN[3], MARGIN[1]);
        let mut out = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {}\" font-family=\"sans-serif\" font-size=\"13\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n",
            SIZE[0], SIZE[1]
        );
        let middle = 0.5 * (MARGIN[0] + SIZE[0] - MARGIN[2]);
        let _ = writeln!(
            out,
            "<text x=\"{middle}\" y=\"22\" text-anchor=\"middle\" font-size=\"15\">{}</text>",
            escaped(&self.title)
        );
        for at in x.ticks() {
            let px = x.at(at);
            let _ = writeln!(
                out,
                "<path d=\"M{px:.1} {:.1}V{:.1}\" stroke=\"#ddd\"/><text x=\"{px:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
                MARGIN[1],
                SIZE[1] - MARGIN[3],
                SIZE[1] - MARGIN[3] + 18.0,
                x.label(at)
            );
        }
        for at in y.ticks() {
            let py = y.at(at);
            let _ = writeln!(
                out,
                "<path d=\"M{:.1} {py:.1}H{:.1}\" stroke=\"#ddd\"/><text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
                MARGIN[0],
                SIZE[0] - MARGIN[2],
                MARGIN[0] - 6.0,
                py + 4.0,
                y.label(at)
            );
        }
        for (k, s) in self.series.iter().enumerate() {
            let colour = COLOURS[k % COLOURS.len()];
            if s.dots {
                for p in &s.points {
                    let _ = writeln!(
                        out,
                        "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"1.6\" fill=\"{colour}\"/>",
                        x.at(p[0]),
                        y.at(p[1])
                    );
                }
            } else {
                let path: Vec<String> = s
                    .points
                    .iter()
                    .map(|p| format!("{:.1},{:.1}", x.at(p[0]), y.at(p[1])))
                    .collect();
                let _ = writeln!(
                    out,
                    "<polyline points=\"{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.5\"/>",
                    path.join(" ")
                );
            }
            let _ = writeln!(
                out,
                "<text x=\"{:.1}\" y=\"{:.1}\" fill=\"{colour}\">{}</text>",
                MARGIN[0] + 10.0,
                MARGIN[1] + 16.0 * (k as f64 + 1.0),
                escaped(&s.name)
            );
        }
        let _ = writeln!(
            out,
            "<text x=\"{middle}\" y=\"{}\" text-anchor=\"middle\">{}</text>\n<text transform=\"translate(18 {}) rotate(-90)\" text-anchor=\"middle\">{}</text>\n</svg>",
            SIZE[1] - 14.0,
            escaped(&self.axes[0]),
            0.5 * SIZE[1],
            escaped(&self.axes[1])
        );
        out
    }

    fn points(&self) -> impl Iterator<Item = &[f64; 2]> {
        self.series.iter().flat_map(|s| &s.points)
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;")
}

/// From numbers to places on the drawing.
struct Axis {
    low: f64,
    high: f64,
    step: f64,
    from_px: f64,
    to_px: f64,
}

impl Axis {
    fn over(values: impl Iterator<Item = f64>, from_px: f64, to_px: f64) -> Self {
        let (low, high) = values
            .filter(|v| v.is_finite())
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
                (l.min(v), h.max(v))
            });
        let (low, high) = if low < high {
            (low, high)
        } else if low.is_finite() {
            (low - 0.5, low + 0.5)
        } else {
            (0.0, 1.0)
        };
        // 1, 2 or 5 times a power of ten, five to ten of them.
        let rough = (high - low) / 7.0;
        let power = 10f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0]
            .map(|k| k * power)
            .into_iter()
            .find(|s| *s >= rough)
            .unwrap_or(10.0 * power);
        Axis {
            low: (low / step).floor() * step,
            high: (high / step).ceil() * step,
            step,
            from_px,
            to_px,
        }
    }

    fn at(&self, value: f64) -> f64 {
        self.from_px + (value - self.low) / (self.high - self.low) * (self.to_px - self.from_px)
    }

    fn ticks(&self) -> impl Iterator<Item = f64> + '_ {
        let count = ((self.high - self.low) / self.step).round() as usize;
        (0..=count).map(|k| self.low + self.step * k as f64)
    }

    fn label(&self, value: f64) -> String {
        let digits = (-self.step.log10().floor()).max(0.0) as usize;
        let text = format!("{value:.digits$}");
        if text
            .trim_start_matches('-')
            .chars()
            .all(|c| "0.".contains(c))
        {
            return "0".to_owned();
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_point_lies_inside_the_drawing_and_in_the_csv() {
        let figure = Figure {
            title: "a < b".to_owned(),
            axes: ["x, mm".to_owned(), "y".to_owned()],
            series: vec![
                Series {
                    name: "line".to_owned(),
                    points: vec![[-3.0, 0.02], [7.0, -0.4]],
                    dots: false,
                },
                Series {
                    name: "dots".to_owned(),
                    points: vec![[1.0, 0.3]],
                    dots: true,
                },
            ],
            notes: Vec::new(),
        };
        let svg = figure.svg();
        assert!(svg.contains("a &lt; b") && svg.contains("<circle") && svg.contains("<polyline"));
        let x = Axis::over([-3.0, 7.0].into_iter(), 70.0, 740.0);
        assert!(x.at(-3.0) >= 70.0 && x.at(7.0) <= 740.0);
        assert!(x.ticks().count() >= 4);
        assert_eq!(figure.csv().lines().count(), 4);
        assert!(figure.csv().starts_with("series,\"x, mm\",\"y\""));
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
