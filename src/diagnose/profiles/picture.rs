//! Mean residual over the image and over the laser plane, without and with what was left out.

use super::fit::{Fitted, Left};
use super::model::Kind;
use crate::verdict::Effect;
use hydroline_calib::IdealMap;
use hydroline_report::{Axis, Body, Colour, Figure, Panel};
use hydroline_rigs::Rig;

/// Parts of the image across and down.
const CELLS: [usize; 2] = [24, 24];
/// Half of the laser plane that is drawn \[mm\]: as wide as the sheet is in the tank.
const HALF_SHEET_MM: f64 = 320.0;
/// Points of the laser plane drawn at most.
const POINTS: usize = 4000;
/// Height of the panel of the laser plane \[px\].
const PLANE_PX: f64 = 110.0;

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

fn image_panel(fit: &Fitted, rig: &Rig, title: &str, scale_px: f64) -> Panel {
    let cells = cells(fit, rig)
        .into_iter()
        .map(|c| hydroline_report::Cell {
            from: c.from_px,
            to: c.to_px,
            value: c.mean_px,
            hint: format!("{:+.4} px, sd {:.4}, {} bins", c.mean_px, c.sd_px, c.count),
        })
        .collect();
    Panel::new(
        title,
        Axis::new("column [px]").limits([0.0, f64::from(rig.camera.width_px)]),
        Axis::new("row [px]")
            .limits([0.0, f64::from(rig.camera.height_px)])
            .reversed(),
    )
    .equal_scale()
    .cells(cells, scale_px, "px")
}

/// Residuals in the laser plane: ξ, and η measured − predicted \[mm\].
fn in_plane(fit: &Fitted, rig: &Rig) -> Vec<[f64; 2]> {
    let map = IdealMap::of(rig);
    rows(fit)
        .step_by(1 + fit.left.len() / POINTS)
        .filter_map(|l| {
            let at = |row: f64| map.unlimited(l.at_px[0], row);
            let (xi_m, eta_m) = at(l.at_px[1])?;
            let (_, predicted_m) = at(l.at_px[1] - l.off_px)?;
            Some([1e3 * xi_m, 1e3 * (eta_m - predicted_m)])
        })
        .collect()
}

fn plane_panel(points: Vec<[f64; 2]>, scale_mm: f64) -> Panel {
    Panel::new(
        "the same point by point in the laser plane",
        Axis::new("\u{3be} [mm], port at the left")
            .limits([-HALF_SHEET_MM, HALF_SHEET_MM])
            .reversed(),
        Axis::new("\u{3b7} off [mm]").limits([-scale_mm, scale_mm]),
    )
    .height(PLANE_PX)
    .dots("", Colour::BLUE, points)
}

/// The pictures and the numbers of the image level, for the report.
pub fn section(rig: &Rig, nothing: &Fitted, best: &Fitted, effects: &[Effect]) -> Body {
    let scale_px = cells(nothing, rig)
        .iter()
        .map(|c| c.mean_px.abs())
        .fold(0.01, f64::max);
    let scale_mm = in_plane(nothing, rig)
        .iter()
        .map(|p| p[1].abs())
        .fold(0.02, f64::max);
    let names: Vec<&str> = effects.iter().map(|e| e.effect.as_str()).collect();
    let after = if names.is_empty() {
        "with nothing left out".to_owned()
    } else {
        format!("with {}", names.join(", "))
    };
    let figure = [(nothing, "without effects"), (best, after.as_str())]
        .into_iter()
        .fold(
            Figure::new("mean residual of the stripe over the image, before and after"),
            |figure, (fit, title)| {
                figure.column(vec![
                    image_panel(fit, rig, title, scale_px),
                    plane_panel(in_plane(fit, rig), scale_mm),
                ])
            },
        );
    let mut body = Body::default();
    body.section("Image level");
    body.paragraph(format!(
        "Mean of measured − predicted rows of the stripe by part of the image, over all frames looked at, poses fitted anew on either side; below, the same point by point in the laser plane. rms {:.4} px before, {:.4} px after; edges {:.3} and {:.3} px.",
        nothing.rms_px(Kind::Row),
        best.rms_px(Kind::Row),
        nothing.rms_px(Kind::End),
        best.rms_px(Kind::End)
    ));
    body.figure(&figure, "");
    body
}
