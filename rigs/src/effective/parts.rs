//! Targets, boards and plans written out, on their own or inside a rig.

use super::writer::Writer;
use crate::{Board, BoardPattern, Plan, Shape, SlabOutline, StepLoad, Target};

pub(super) fn target(w: &mut Writer, t: &Target, entry: &str) {
    let [x, y, heading] = t.origin;
    w.text("name", &t.name);
    w.numbers("origin_m", &[x, y]);
    w.number("heading_rad", heading);
    for slab in &t.slabs {
        w.entry(entry);
        w.text("name", &slab.name);
        match &slab.outline {
            SlabOutline::Rectangle {
                x0_m,
                x1_m,
                width_m,
            } => {
                w.text("shape", "rectangle");
                w.number("x0_m", *x0_m);
                w.number("x1_m", *x1_m);
                w.number("width_m", *width_m);
            }
            SlabOutline::HexagonChain {
                x0_m,
                side_m,
                count,
            } => {
                w.text("shape", "hexagon_chain");
                w.number("x0_m", *x0_m);
                w.number("side_m", *side_m);
                w.raw("count", count);
            }
            SlabOutline::Polygon { points_m } => {
                w.text("shape", "polygon");
                w.pairs("points_m", points_m);
            }
        }
        w.number("top_m", slab.top_m);
        w.number("albedo", slab.albedo);
    }
}

pub(super) fn board(w: &mut Writer, b: &Board, entry: &str) {
    w.text("name", &b.name);
    match b.pattern {
        BoardPattern::Lines { line_m } => {
            w.text("pattern", "lines");
            w.number("line_m", line_m);
        }
        BoardPattern::Dots { diameter_m } => {
            w.text("pattern", "dots");
            w.number("diameter_m", diameter_m);
        }
        BoardPattern::Chessboard => w.text("pattern", "chessboard"),
    }
    w.raw("columns", b.columns);
    w.raw("rows", b.rows);
    w.number("pitch_m", b.pitch_m);
    w.number("margin_m", b.margin_m);
    w.number("thickness_m", b.thickness_m);
    for block in &b.blocks {
        w.entry(entry);
        w.numbers("centre_m", &block.centre_m);
        w.numbers("size_m", &block.size_m);
        w.number("height_m", block.height_m);
    }
}

/// A target file.
pub(crate) fn target_file(t: &Target) -> String {
    let mut w = Writer::default();
    target(&mut w, t, "slab");
    w.finish()
}

/// A board file.
pub(crate) fn board_file(b: &Board) -> String {
    let mut w = Writer::default();
    board(&mut w, b, "block");
    w.finish()
}

/// A plan file.
pub(crate) fn plan(plan: &Plan) -> String {
    let mut w = Writer::default();
    w.text("name", &plan.name);
    for step in &plan.steps {
        w.entry("step");
        w.number("for_s", step.for_s);
        match step.shape {
            Shape::Hold => w.text("shape", "hold"),
            Shape::Ramp => w.text("shape", "ramp"),
            Shape::Sine {
                period_s,
                phase_rad,
            } => {
                w.text("shape", "sine");
                w.number("period_s", period_s);
                w.number("phase_rad", phase_rad);
            }
            Shape::Chirp { f0_hz, f1_hz } => {
                w.text("shape", "chirp");
                w.number("f0_hz", f0_hz);
                w.number("f1_hz", f1_hz);
            }
        }
        match &step.load {
            StepLoad::Wrench(wrench) => {
                let named = crate::Wrench::KEYS.into_iter().zip(wrench.to_array());
                w.inline("wrench", named.filter(|(_, value)| *value != 0.0));
            }
            StepLoad::ThrustN(thrusts) => {
                w.inline(
                    "thrust_n",
                    thrusts.iter().map(|(name, value)| (name.as_str(), *value)),
                );
            }
        }
    }
    w.finish()
}
