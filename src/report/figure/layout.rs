//! Where everything stands: cells of a grid, margins as wide as the numbers in them, headers as high as title and legend.

use super::legend::{self, Header};
use super::scale::{self, Scale, Tick};
use super::trace::Area;
use super::words::{width_px, wrap};
use super::{Figure, Kind, Panel, draw};
use crate::colour::Colour;
use crate::markup::Element;
use crate::svg;

/// Width of a figure \[px\]: that of a page's column.
pub(super) const WIDTH_PX: f64 = 860.0;
/// Width of a figure on a phone \[px\]: the commonest is 390 wide, less the page's margins.
pub(super) const NARROW_PX: f64 = 358.0;
/// Between two columns \[px\].
const GAP_PX: f64 = 22.0;
/// Size of all letters but titles \[px\].
pub(super) const LETTER_PX: f64 = 11.0;
/// Height of a line of letters \[px\].
pub(super) const LINE_PX: f64 = 14.0;
/// From an axis to its numbers \[px\].
pub(super) const TO_NUMBERS_PX: f64 = 6.0;
/// Least room right of the axes \[px\].
const RIGHT_PX: f64 = 10.0;
/// Below the lowest letters of a panel \[px\].
const BELOW_PX: f64 = 8.0;
/// A number on the abscissa for each so many pixels, at most.
const PER_NUMBER_ACROSS_PX: f64 = 80.0;
/// A number on the ordinate for each so many pixels, at most; where that would be too few, one for each line of letters.
const PER_NUMBER_UP_PX: f64 = 26.0;

pub(super) struct Placed<'a> {
    pub panel: &'a Panel,
    /// Between the axes' ends.
    pub area: Area,
    /// Left end of the panel's cell \[px\].
    pub cell_left_px: f64,
    /// `None` where no finite value sets both axes.
    pub scales: Option<[Scale; 2]>,
    pub x_ticks: Vec<Tick>,
    pub y_ticks: Vec<Tick>,
    /// Whether the abscissa's numbers and name are written below.
    pub x_written: bool,
    pub x_label: String,
    pub y_label: Vec<String>,
    pub header: Header,
    /// Where the header's first line begins \[px\].
    pub top_px: f64,
}

/// Measures of a panel before the margins are known.
struct Measured<'a> {
    panel: &'a Panel,
    ranges: Option<[[f64; 2]; 2]>,
    /// Numbers that the ordinate should carry, and may at most.
    wanted_up: [f64; 2],
    y_label: Vec<String>,
    left_px: f64,
    right_px: f64,
    x_written: bool,
    /// Name of the abscissa, and how much of its own unit one of the written unit is.
    x_unit: (String, f64),
}

impl<'a> Measured<'a> {
    fn new(panel: &'a Panel, shared: Option<[f64; 2]>, cell_px: f64, x_written: bool) -> Self {
        let x = shared.or_else(|| scale::range(&panel.x, panel.shown(0), false));
        // Cells fill their axes to the edge.
        let filled = panel
            .layers
            .iter()
            .any(|l| matches!(l.kind, Kind::Cells { .. }));
        let y = scale::range(&panel.y, panel.shown(1), !filled);
        let ranges = x.zip(y).map(|(x, y)| [x, y]);
        let height_px = height_px(panel, ranges, cell_px);
        let wanted_up = [PER_NUMBER_UP_PX, LINE_PX].map(|each_px| height_px / each_px);
        let numbers = ranges.map_or(Vec::new(), |[_, y]| {
            Scale::new(y, height_px, 0.0, false).ticks(wanted_up[0], wanted_up[1])
        });
        let widest = |ticks: &[Tick]| {
            ticks
                .iter()
                .map(|t| width_px(&t.label, LETTER_PX))
                .fold(0.0, f64::max)
        };
        let y_label = if panel.y.label.is_empty() {
            Vec::new()
        } else {
            wrap(&panel.y.label, LETTER_PX, height_px)
        };
        let left_px = widest(&numbers) + TO_NUMBERS_PX + 2.0 + LINE_PX * y_label.len() as f64;
        let x_unit = panel.x.unit(x);
        // The last number of the abscissa may stand half beyond its end.
        let across = ranges.map_or(Vec::new(), |[x, _]| {
            let wanted = cell_px / PER_NUMBER_ACROSS_PX;
            Scale::new(x, 0.0, cell_px, false).ticks_in(x_unit.1, wanted, wanted)
        });
        Measured {
            panel,
            ranges,
            wanted_up,
            y_label,
            left_px,
            right_px: (0.5 * widest(&across) + 2.0).max(RIGHT_PX),
            x_written,
            x_unit,
        }
    }
}

/// Height between the axes' ends of a panel so wide \[px\].
fn height_px(panel: &Panel, ranges: Option<[[f64; 2]; 2]>, width_px: f64) -> f64 {
    match ranges {
        // No axis is drawn higher than twice its width.
        Some([x, y]) if panel.equal_scale => {
            width_px * ((y[1] - y[0]) / (x[1] - x[0])).clamp(0.05, 2.0)
        }
        _ => panel.height_px.max(LINE_PX),
    }
}

/// One range for all panels of a column.
fn shared_range(column: &[Panel]) -> Option<[f64; 2]> {
    column
        .iter()
        .filter_map(|p| scale::range(&p.x, p.shown(0), false))
        .reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
}

pub(super) fn drawing(figure: &Figure, width_px: f64) -> Element {
    let (placed, height_px) = place(figure, width_px);
    let mut root = svg::root([width_px, height_px], "")
        .with("role", "img")
        .with("aria-label", &figure.label)
        .with("font-family", "sans-serif")
        .filled(Colour::BLACK)
        .child_line(svg::rect([0.0; 2], [width_px, height_px]).filled(Colour::PAPER));
    for panel in &placed {
        draw::panel(&mut root, panel);
    }
    root
}

/// All panels, and the height of the figure \[px\].
pub(super) fn place(figure: &Figure, width_px: f64) -> (Vec<Placed<'_>>, f64) {
    // Where columns do not fit beside each other, they stand one below the other.
    let beside = if width_px < WIDTH_PX {
        1
    } else {
        figure.columns.len().max(1)
    };
    let (mut placed, mut top_px) = (Vec::new(), 0.0);
    for columns in figure.columns.chunks(beside) {
        top_px = place_columns(&mut placed, columns, figure.shared_x, width_px, top_px);
    }
    (placed, top_px)
}

/// Places columns beside each other from `top_px` on; returns where they end \[px\].
fn place_columns<'a>(
    placed: &mut Vec<Placed<'a>>,
    columns: &'a [Vec<Panel>],
    shared_x: bool,
    width_px: f64,
    mut top_px: f64,
) -> f64 {
    let count = columns.len() as f64;
    let cell_px = (width_px - GAP_PX * (count - 1.0)) / count;
    let mut grid: Vec<Vec<(Measured<'_>, Header, f64)>> = Vec::new();
    for column in columns {
        let shared = shared_x.then(|| shared_range(column)).flatten();
        let measured: Vec<Measured<'_>> = (0..)
            .zip(column)
            .map(|(row, panel)| {
                let x_written = !shared_x || row + 1 == column.len();
                Measured::new(panel, shared, cell_px, x_written)
            })
            .collect();
        let widest = |of: fn(&Measured<'_>) -> f64| measured.iter().map(of).fold(0.0, f64::max);
        let (left_px, right_px) = (widest(|m| m.left_px), widest(|m| m.right_px));
        let width_px = (cell_px - left_px - right_px).max(0.3 * cell_px);
        let mut cells = Vec::with_capacity(measured.len());
        for mut m in measured {
            (m.left_px, m.right_px) = (left_px, right_px);
            let header = legend::header(m.panel, width_px);
            cells.push((m, header, width_px));
        }
        grid.push(cells);
    }
    let rows = grid.iter().map(Vec::len).max().unwrap_or(0);
    for row in 0..rows {
        // Axes of one row of panels begin and end at the same height.
        let cells = || grid.iter().filter_map(|column| column.get(row));
        let header_px = cells().map(|(_, h, _)| h.height_px).fold(0.0, f64::max);
        let plot_px = cells()
            .map(|(m, _, w)| height_px(m.panel, m.ranges, *w))
            .fold(0.0, f64::max);
        let footer_px = cells()
            .map(|(m, ..)| match (m.x_written, m.x_unit.0.is_empty()) {
                (false, _) => 0.0,
                (true, true) => LINE_PX + TO_NUMBERS_PX,
                (true, false) => 2.0 * LINE_PX + TO_NUMBERS_PX,
            })
            .fold(0.0, f64::max);
        let plot_top_px = top_px + header_px;
        for (index, column) in grid.iter().enumerate() {
            let Some((m, header, width_px)) = column.get(row) else {
                continue;
            };
            let cell_left_px = (cell_px + GAP_PX) * index as f64;
            let left_px = cell_left_px + m.left_px;
            let height_px = height_px(m.panel, m.ranges, *width_px);
            let area = [
                [left_px, plot_top_px],
                [left_px + width_px, plot_top_px + height_px],
            ];
            let scales = m.ranges.map(|[x, y]| {
                [
                    Scale::new(x, area[0][0], area[1][0], m.panel.x.reversed),
                    Scale::new(y, area[1][1], area[0][1], m.panel.y.reversed),
                ]
            });
            let ticks = |axis: usize, unit: f64, [wanted, most]: [f64; 2]| {
                scales.map_or(Vec::new(), |s: [Scale; 2]| {
                    s[axis].ticks_in(unit, wanted, most)
                })
            };
            let across = width_px / PER_NUMBER_ACROSS_PX;
            placed.push(Placed {
                panel: m.panel,
                area,
                cell_left_px,
                scales,
                x_ticks: ticks(0, m.x_unit.1, [across, across]),
                y_ticks: ticks(1, 1.0, m.wanted_up),
                x_written: m.x_written,
                x_label: m.x_unit.0.clone(),
                y_label: m.y_label.clone(),
                top_px: plot_top_px - header.height_px,
                header: header.clone(),
            });
        }
        top_px = plot_top_px + plot_px + footer_px + BELOW_PX;
    }
    top_px
}
