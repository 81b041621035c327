//! Title and legend above a panel: beside each other where there is room, else the legend below the title.

use super::form::Form;
use super::layout::{LETTER_PX, LINE_PX};
use super::words::{BOLD, width_px, wrap};
use super::{Kind, Layer, Panel};
use crate::colour::Colour;
use crate::markup::Element;
use crate::svg::{self, Path};

/// Size of a title's letters \[px\].
const TITLE_PX: f64 = 12.0;
const TITLE_LINE_PX: f64 = 16.0;
/// Width of the sample before a name \[px\]: two dashes of any line.
const SAMPLE_PX: f64 = 26.0;
/// Width of a scale of colours \[px\].
const SCALE_PX: f64 = 72.0;
/// Size of the dot that stands for a series \[px\].
const DOT_PX: f64 = 5.0;
/// Between sample and name \[px\].
const TO_NAME_PX: f64 = 4.0;
/// Between two entries, and between title and legend \[px\].
const APART_PX: f64 = 16.0;
/// Between the header and the axes \[px\].
const TO_AXES_PX: f64 = 5.0;
/// Shades of a scale of colours.
const SHADES: i32 = 21;

#[derive(Debug, Clone)]
pub(super) struct Entry {
    layer: Layer,
    /// Its name; several lines where one is wider than the axes, as on a phone.
    lines: Vec<String>,
    /// Left end of the sample, from the left of the axes \[px\].
    pub left_px: f64,
    /// Width of sample and name \[px\].
    pub width_px: f64,
    /// First line of the name, its base line from the header's top \[px\].
    pub base_px: f64,
}

/// Title and legend above the axes.
#[derive(Debug, Clone)]
pub(super) struct Header {
    /// Lines of the title, with their base lines from the header's top \[px\].
    pub title: Vec<(String, f64)>,
    pub entries: Vec<Entry>,
    pub height_px: f64,
}

/// Width of the last line of a title \[px\].
pub(super) fn title_px(line: &str) -> f64 {
    BOLD * width_px(line, TITLE_PX)
}

/// Lays title and legend into a width \[px\].
pub(super) fn header(panel: &Panel, room_px: f64) -> Header {
    let mut title = Vec::new();
    let mut base_px = 2.0;
    if !panel.title.is_empty() {
        for line in wrap(&panel.title, BOLD * TITLE_PX, room_px) {
            base_px += TITLE_LINE_PX;
            title.push((line, base_px - 4.0));
        }
    }
    let mut entries: Vec<Entry> = panel
        .layers
        .iter()
        .filter(|l| !name(l).is_empty() && !l.kind.is_empty())
        .map(|layer| entry(layer, room_px))
        .collect();
    let all_px = entries.iter().map(|e| e.width_px + APART_PX).sum::<f64>() - APART_PX;
    let beside = title.last().map(|(line, at)| (title_px(line), *at));
    match beside {
        _ if entries.is_empty() => {}
        Some((used_px, at)) if used_px + APART_PX + all_px <= room_px => {
            let mut left_px = room_px - all_px;
            for e in &mut entries {
                (e.left_px, e.base_px) = (left_px, at);
                left_px += e.width_px + APART_PX;
            }
        }
        _ => {
            base_px += LINE_PX;
            let mut left_px = 0.0;
            for e in &mut entries {
                if left_px > 0.0 && left_px + e.width_px > room_px {
                    left_px = 0.0;
                    base_px += LINE_PX;
                }
                (e.left_px, e.base_px) = (left_px, base_px - 3.0);
                left_px += e.width_px + APART_PX;
                base_px += LINE_PX * (e.lines.len() as f64 - 1.0);
            }
        }
    }
    Header {
        title,
        entries,
        height_px: base_px + TO_AXES_PX,
    }
}

/// An entry that has no place yet, at most as wide as the room.
fn entry(layer: &Layer, room_px: f64) -> Entry {
    let before_px = sample_px(layer) + TO_NAME_PX;
    let name = name(layer);
    let lines = if before_px + width_px(&name, LETTER_PX) > room_px {
        wrap(&name, LETTER_PX, room_px - before_px)
    } else {
        vec![name]
    };
    let widest = lines.iter().map(|line| width_px(line, LETTER_PX));
    Entry {
        width_px: before_px + widest.fold(0.0, f64::max),
        layer: layer.clone(),
        lines,
        left_px: 0.0,
        base_px: 0.0,
    }
}

/// Legend of a layer; of cells, the value at the upper end of their colours.
fn name(layer: &Layer) -> String {
    match &layer.kind {
        Kind::Cells { full, unit, .. } => format!("+{} {unit}", full_label(*full)),
        _ => layer.name.clone(),
    }
}

fn full_label(full: f64) -> String {
    crate::number::short(full)
}

/// Value at the left end of a scale of colours; `None` where the layer has none.
fn lower(layer: &Layer) -> Option<String> {
    match &layer.kind {
        Kind::Cells { full, .. } => Some(format!("-{}", full_label(*full))),
        _ => None,
    }
}

fn sample_px(layer: &Layer) -> f64 {
    lower(layer).map_or(SAMPLE_PX, |low| {
        width_px(&low, LETTER_PX) + TO_NAME_PX + SCALE_PX
    })
}

pub(super) fn draw(root: &mut Element, header: &Header, left_px: f64, top_px: f64) {
    for (line, base_px) in &header.title {
        root.push_line(
            svg::text([left_px, top_px + base_px], TITLE_PX, line).with("font-weight", "bold"),
        );
    }
    for entry in &header.entries {
        let at = [left_px + entry.left_px, top_px + entry.base_px];
        sample(root, &entry.layer, at);
        let to_name = sample_px(&entry.layer) + TO_NAME_PX;
        for (row, line) in (0..).zip(&entry.lines) {
            let down_px = LINE_PX * f64::from(row);
            let at = [at[0] + to_name, at[1] + down_px];
            root.push_line(svg::text(at, LETTER_PX, line));
        }
    }
}

/// A piece of the layer, as it looks in the panel, from the left end of its base line.
fn sample(root: &mut Element, layer: &Layer, [x, base]: [f64; 2]) {
    let colour = layer.colour;
    let middle = base - 0.35 * LETTER_PX;
    let (from, to) = ([x, middle], [x + SAMPLE_PX, middle]);
    let patch = |width: f64| svg::rect([x, base - 9.0], [width, 10.0]);
    match &layer.kind {
        Kind::Line(_) => root.push_line(Form::of(colour).line(svg::line(from, to), colour)),
        Kind::Dots { .. } => {
            let (mut dot, form) = (Path::new(), Form::of(colour));
            form.dot(&mut dot, [x + 0.5 * SAMPLE_PX, middle], DOT_PX);
            root.push_line(form.dots(dot, colour, DOT_PX));
        }
        Kind::Ribbon(_) | Kind::Band(_) | Kind::Windows(_) => {
            root.push_line(
                patch(SAMPLE_PX)
                    .filled(colour)
                    .with("fill-opacity", super::draw::SHADE),
            );
        }
        Kind::Marks(_) => {
            root.push_line(super::draw::dashed(
                [x + 0.5 * SAMPLE_PX, base - 10.0],
                base + 1.0,
            ));
        }
        Kind::Cells { .. } => {
            let low = lower(layer).unwrap_or_default();
            root.push_line(svg::text([x, base], LETTER_PX, &low));
            let left = x + width_px(&low, LETTER_PX) + TO_NAME_PX;
            let part = SCALE_PX / f64::from(SHADES);
            for k in 0..SHADES {
                let share = 2.0 * f64::from(k) / f64::from(SHADES - 1) - 1.0;
                let (tint, opacity) = Colour::diverging(share);
                root.push_line(
                    svg::rect([left + part * f64::from(k), base - 9.0], [part, 10.0])
                        .filled(tint)
                        .number("fill-opacity", opacity),
                );
            }
        }
    }
}
