//! Mean residual over the image and over the laser plane, without and with what was left out.

use super::fit::{Fitted, Left};
use super::model::Kind;
use crate::verdict::Effect;
use hydroline_calib::IdealMap;
use hydroline_identify::report::escape;
use hydroline_rigs::Rig;
use std::fmt::Write as _;

/// Parts of the image across and down.
const CELLS: [usize; 2] = [24, 24];
/// Size of a panel \[px\].
const PANEL: [f64; 2] = [410.0, 328.0];

/// A part of the image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cell {
    /// Upper left \[px\].
    pub from_px: [f64; 2],
    /// Lower right \[px\].
    pub to_px: [f64; 2],
    /// Mean of measured − predicted rows there \[px\].
    pub mean_px: f64,
    /// Its standard deviation \[px\].
    pub sd_px: f64,
    /// Bins of columns in it.
    pub count: usize,
}

/// Mean residuals of the rows by part of the image; parts without a stripe are left out.
pub fn cells(fit: &Fitted, rig: &Rig) -> Vec<Cell> {
    let size = [
        f64::from(rig.camera.width_px) / CELLS[0] as f64,
        f64::from(rig.camera.height_px) / CELLS[1] as f64,
    ];
    let mut sums = vec![(0.0, 0.0, 0usize); CELLS[0] * CELLS[1]];
    for left in rows(fit) {
        let at: [usize; 2] = std::array::from_fn(|i| {
            ((left.at_px[i] / size[i]).max(0.0) as usize).min(CELLS[i] - 1)
        });
        let weight = left.sd_px.powi(-2);
        let sum = &mut sums[at[1] * CELLS[0] + at[0]];
        sum.0 += weight * left.off_px;
        sum.1 += weight;
        sum.2 += 1;
    }
    sums.iter()
        .enumerate()
        .filter(|(_, s)| s.2 > 0)
        .map(|(k, (sum, weight, count))| {
            let at = [(k % CELLS[0]) as f64, (k / CELLS[0]) as f64];
            Cell {
                from_px: [at[0] * size[0], at[1] * size[1]],
                to_px: [(at[0] + 1.0) * size[0], (at[1] + 1.0) * size[1]],
                mean_px: sum / weight,
                sd_px: weight.powf(-0.5),
                count: *count,
            }
        })
        .collect()
}

fn rows(fit: &Fitted) -> impl Iterator<Item = &Left> {
    // Strays belong to no mean.
    fit.left
        .iter()
        .filter(|l| l.kind == Kind::Row && l.off_px.abs() < 6.0 * l.sd_px)
}

/// Blue below, white at, red above zero.
fn colour(share: f64) -> String {
    let s = share.clamp(-1.0, 1.0);
    let fade = |v: f64| (255.0 * (1.0 - v)) as u8;
    if s >= 0.0 {
        format!("rgb(255,{0},{0})", fade(s))
    } else {
        format!("rgb({0},{0},255)", fade(-s))
    }
}

fn image_panel(svg: &mut String, fit: &Fitted, rig: &Rig, left: f64, title: &str, scale_px: f64) {
    let per = PANEL[0] / f64::from(rig.camera.width_px);
    let _ = write!(
        svg,
        "<text x=\"{left}\" y=\"14\">{}</text><rect x=\"{left}\" y=\"20\" width=\"{}\" height=\"{}\" fill=\"#f4f4f4\" stroke=\"#999\"/>",
        escape(title),
        PANEL[0],
        PANEL[1]
    );
    for c in cells(fit, rig) {
        let (w, h) = (
            per * (c.to_px[0] - c.from_px[0]),
            per * (c.to_px[1] - c.from_px[1]),
        );
        let _ = write!(
            svg,
            "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{w:.1}\" height=\"{h:.1}\" fill=\"{}\" stroke=\"#ccc\" stroke-width=\".4\"><title>{:+.4} px, sd {:.4}, {} bins</title></rect>",
            left + per * c.from_px[0],
            20.0 + per * c.from_px[1],
            colour(c.mean_px / scale_px),
            c.mean_px,
            c.sd_px,
            c.count
        );
    }
}

/// Residuals in the laser plane: η measured − predicted \[mm\] over ξ.
fn plane_panel(svg: &mut String, fit: &Fitted, rig: &Rig, left: f64, scale_mm: f64) {
    let map = IdealMap::of(rig);
    let top = 30.0 + PANEL[1];
    let height = 130.0;
    let _ = write!(
        svg,
        "<rect x=\"{left}\" y=\"{top}\" width=\"{}\" height=\"{height}\" fill=\"none\" stroke=\"#999\"/><line x1=\"{left}\" x2=\"{}\" y1=\"{1}\" y2=\"{1}\" stroke=\"#ccc\"/>",
        PANEL[0],
        left + PANEL[0],
    )
    .and_then(|()| {
        write!(
            svg,
            "<text x=\"{}\" y=\"{}\">laser plane: η off by ±{scale_mm:.3} mm over ξ, port at the left</text>",
            left + 4.0,
            top + 12.0
        )
    });
    let half = 0.32;
    for l in rows(fit).step_by(1 + fit.left.len() / 4000) {
        let at = |row: f64| map.unlimited(l.at_px[0], row);
        let (Some((xi, eta)), Some((_, above))) = (at(l.at_px[1]), at(l.at_px[1] - l.off_px))
        else {
            continue;
        };
        // What the row's residual is in η: measured minus predicted.
        let off_mm = 1e3 * (eta - above);
        let x = left + PANEL[0] * (0.5 - 0.5 * xi / half).clamp(0.0, 1.0);
        let y = top + 0.5 * height * (1.0 - (off_mm / scale_mm).clamp(-1.0, 1.0));
        let _ = write!(
            svg,
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"1\" fill=\"#06a\" fill-opacity=\".5\"/>"
        );
    }
}

/// The pictures and the numbers of the image level, for the report.
pub fn section(rig: &Rig, nothing: &Fitted, best: &Fitted, effects: &[Effect]) -> String {
    let largest = |fit: &Fitted| {
        cells(fit, rig)
            .iter()
            .map(|c| c.mean_px.abs())
            .fold(0.0, f64::max)
    };
    let scale_px = largest(nothing).max(0.01);
    let names: Vec<&str> = effects.iter().map(|e| e.effect.as_str()).collect();
    let after = if names.is_empty() {
        "nothing left out".to_owned()
    } else {
        names.join(", ")
    };
    let width = 2.0 * PANEL[0] + 20.0;
    let mut svg = format!(
        "<svg viewBox=\"0 0 {width} {}\" width=\"{width}\" font-size=\"12\" font-family=\"sans-serif\" xmlns=\"http://www.w3.org/2000/svg\">",
        170.0 + PANEL[1]
    );
    let scale_mm = rows(nothing)
        .map(|l| l.off_px.abs())
        .fold(0.0, f64::max)
        .max(0.02);
    for (fit, left, title) in [
        (
            nothing,
            0.0,
            format!("without effects (colour: ±{scale_px:.3} px)"),
        ),
        (
            best,
            PANEL[0] + 20.0,
            format!("with {after} (same colours)"),
        ),
    ] {
        image_panel(&mut svg, fit, rig, left, &title, scale_px);
        plane_panel(&mut svg, fit, rig, left, scale_mm);
    }
    svg += "</svg>";
    format!(
        "<h2>Image level</h2><p>Mean of measured − predicted rows of the stripe by part of the image, over all frames looked at, poses fitted anew on either side; below, the same point by point in the laser plane. rms {:.4} px before, {:.4} px after; edges {:.3} and {:.3} px.</p>{svg}\n",
        nothing.rms_px(Kind::Row),
        best.rms_px(Kind::Row),
        nothing.rms_px(Kind::End),
        best.rms_px(Kind::End)
    )
}
