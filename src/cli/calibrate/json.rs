//! Output of `calibrate --json`.

use super::report::{Against, Report};
use hydroline_calib::board::coplanarity::{self, Coplanarity};
use hydroline_calib::calibration::Residuals;
use hydroline_calib::calibration::board_map::Placement;
use hydroline_calib::calibration::compare::Comparison;
use hydroline_calib::detect::Orientation;
use hydroline_daemon::calibrate::Sheet;
use schemars::JsonSchema;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// Output of `--json`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Printed<'a> {
    /// The calibration file.
    calibration: &'a Path,
    /// Method of the map.
    method: &'static str,
    /// Medium that the camera looked through.
    medium: &'static str,
    /// When the images were taken, RFC 3339; `None` = not known.
    date: Option<&'a str>,
    /// Name of the board.
    board: Option<&'a str>,
    /// Numbers of images, by their use.
    images: Images<'a>,
    /// Poses that the board was seen in; the calibration is of one of them.
    poses: usize,
    /// Whether the board's key was seen, so that it is certain which node is which.
    key_seen: bool,
    /// Nodes used.
    nodes: usize,
    /// Nodes that the board has.
    nodes_of_board: u32,
    /// Share of the board's nodes that were seen.
    coverage: f64,
    /// The same for nine parts of the board: rows by η, columns by ξ, ascending.
    coverage_parts: [[f64; 3]; 3],
    /// Share of the lit part of the image that gets coordinates; `None` = without a rig.
    sheet_share: Option<f64>,
    /// The same for nine parts of the sheet; `None` = without a rig.
    sheet_parts: Option<[[f64; 3]; 3]>,
    /// Residuals of the nodes under the map.
    residuals: Option<Residuals>,
    /// Largest standard deviation of a plane coordinate over the board, the gap between board and sheet included \[m\].
    worst_sd_m: Option<f64>,
    /// The same without a gap that nobody measured: what the tolerance is held against \[m\].
    own_sd_m: Option<f64>,
    /// Largest standard deviation that the rig allows a map \[m\].
    tolerance_m: f64,
    /// Part of the board of which no node is known, as the camera sees it; `None` = of none.
    missing_part: Option<&'a str>,
    /// Exponent γ of the camera's response as the board's image shows it; `None` = it does not.
    camera_gamma: Option<f64>,
    /// Residuals over the nodes' own noise: near 1 where the map's model holds.
    residual_ratio: Option<f64>,
    /// Largest residual, in its own standard deviations.
    residual_worst_sds: Option<f64>,
    /// The same in words.
    residual_words: Option<String>,
    /// Gap between board and laser sheet; `None` for a map that follows from the rig alone.
    coplanarity: Option<Gap<'a>>,
    /// The same in words.
    coplanarity_words: Option<String>,
    /// Where the board's middle stood in the sheet; `None` = not known.
    placement: Option<Placement>,
    /// Where that is from, in words.
    placement_words: String,
    /// Accuracy that the calibration claims, in words.
    claim: String,
    /// Things that are missing for an accepted calibration, in words; empty when accepted.
    missing: &'a [String],
    /// Whether the calibration meets the tolerance and is apart from none that it was compared with.
    accepted: bool,
    /// Names of the calibrations in `against` from which it is off by more than the tolerance allows and the uncertainties
    /// explain; empty = of none.
    apart: Vec<&'a str>,
    /// Comparisons with other calibrations, and with the other poses of these images.
    against: Vec<PrintedAgainst<'a>>,
}

/// Numbers of images, by their use.
#[derive(Debug, Serialize, JsonSchema)]
struct Images<'a> {
    /// Images looked at.
    looked_at: u64,
    /// Images in which the board was found.
    with_board: u64,
    /// Images that the calibration is made of.
    used: u32,
    /// Images that were refused, by reason.
    refused: &'a BTreeMap<String, u64>,
}

/// Gap between board and laser sheet.
#[derive(Debug, Serialize, JsonSchema)]
#[serde(tag = "state", rename_all = "lowercase")]
enum Gap<'a> {
    /// Measured on gauge blocks.
    Measured {
        /// Sheet over the board's face at its middle, towards the camera \[m\].
        offset_m: f64,
        /// Its standard deviation \[m\].
        offset_sd_m: f64,
        /// Tilt along ξ \[rad\].
        tilt_xi_rad: f64,
        /// Tilt along η \[rad\].
        tilt_eta_rad: f64,
        /// Standard deviation of the tilt along ξ \[rad\].
        tilt_xi_sd_rad: f64,
        /// Standard deviation of the tilt along η \[rad\].
        tilt_eta_sd_rad: f64,
        /// Blocks used.
        blocks: u32,
    },
    /// Not measured.
    Unknown {
        /// Why it is not measured.
        why: &'a str,
    },
}

/// A comparison.
#[derive(Debug, Serialize, JsonSchema)]
struct PrintedAgainst<'a> {
    /// Name of the other: a file, or another pose.
    with: &'a str,
    /// Method, board, medium and date of the other; empty for a pose of these images.
    made: &'a str,
    /// Coordinates as they are; `None` = there is nothing to compare.
    as_is: Option<Compared>,
    /// After the best rigid motion was taken out.
    aligned: Option<Compared>,
}

/// Difference between two maps.
#[derive(Debug, Serialize, JsonSchema)]
struct Compared {
    /// Points compared.
    points: usize,
    /// Mean difference in ξ and η \[m\].
    mean_m: [f64; 2],
    /// Root mean square difference in ξ and η \[m\].
    rms_m: [f64; 2],
    /// Largest difference \[m\].
    max_m: f64,
    /// Where that is, ξ and η \[m\].
    worst_at_m: [f64; 2],
    /// Standard deviation that is expected of a difference in ξ and η \[m\].
    expected_m: [f64; 2],
    /// Root mean square difference over the one expected: near 1 for two calibrations of the same thing.
    ratio: f64,
    /// Rigid motion that was taken out; `None` = none.
    removed: Option<Removed>,
    /// Whether more has changed than the uncertainty of both explains.
    drifted: bool,
    /// Whether the largest difference is within the tolerance.
    within_tolerance: bool,
    /// The same in words.
    words: String,
}

/// A rigid motion within the plane.
#[derive(Debug, Serialize, JsonSchema)]
struct Removed {
    /// Along ξ \[m\].
    xi_m: f64,
    /// Along η \[m\].
    eta_m: f64,
    /// Turn from ξ towards η \[rad\].
    turn_rad: f64,
}

impl Compared {
    fn of(c: &Comparison, tolerance_m: f64) -> Self {
        Compared {
            points: c.points,
            mean_m: c.mean_m,
            rms_m: c.rms_m,
            max_m: c.max_m,
            worst_at_m: c.worst_m,
            expected_m: c.expected_m,
            ratio: c.ratio,
            removed: c.removed.map(|[xi_m, eta_m, turn_rad]| Removed {
                xi_m,
                eta_m,
                turn_rad,
            }),
            drifted: c.drifted(),
            within_tolerance: c.max_m <= tolerance_m,
            words: c.words(),
        }
    }
}

fn gap(c: &Coplanarity) -> Gap<'_> {
    let sd = |g: &coplanarity::Gap, k: usize| g.covariance[(k, k)].max(0.0).sqrt();
    match c {
        Coplanarity::Measured(g) => Gap::Measured {
            offset_m: g.offset_m,
            offset_sd_m: g.offset_sd_m(),
            tilt_xi_rad: g.tilt_xi_rad,
            tilt_eta_rad: g.tilt_eta_rad,
            tilt_xi_sd_rad: sd(g, 1),
            tilt_eta_sd_rad: sd(g, 2),
            blocks: g.blocks,
        },
        Coplanarity::Unknown(u) => Gap::Unknown { why: &u.why },
    }
}

impl<'a> Printed<'a> {
    pub fn of(report: &Report<'a>) -> Self {
        let (c, status, setup) = (report.calibration, report.status, report.setup);
        let tolerance_m = setup.tolerance_m();
        let sheet = Sheet::of(setup, c);
        let against = |a: &'a Against| PrintedAgainst {
            with: &a.name,
            made: &a.made,
            as_is: a.as_is.as_ref().map(|c| Compared::of(c, tolerance_m)),
            aligned: a.aligned.as_ref().map(|c| Compared::of(c, tolerance_m)),
        };
        Printed {
            calibration: report.out,
            method: c.map.method(),
            medium: c.medium.name(),
            date: c.date.as_deref(),
            board: c.board.as_deref(),
            images: Images {
                looked_at: report.collected.looked,
                with_board: report.collected.found,
                used: status.frames,
                refused: &report.collected.refused,
            },
            poses: report.collected.poses.poses.len(),
            key_seen: report.orientation() == Some(Orientation::KeySeen),
            nodes: status.nodes,
            nodes_of_board: setup.board.columns * setup.board.rows,
            coverage: status.coverage.share(),
            coverage_parts: status.coverage.parts,
            sheet_share: sheet.as_ref().map(|s| s.share),
            sheet_parts: sheet.as_ref().map(|s| s.parts),
            residuals: c.residuals,
            worst_sd_m: status.worst_sd_m,
            own_sd_m: status.own_sd_m,
            tolerance_m,
            missing_part: status.missing_part.as_deref(),
            camera_gamma: report.gamma(),
            residual_ratio: status.misfit.map(|m| m.ratio),
            residual_worst_sds: status.misfit.map(|m| m.worst_sds),
            residual_words: status.misfit.map(|m| m.words()),
            coplanarity: c.gap().map(gap),
            coplanarity_words: c.gap().map(Coplanarity::words),
            placement: c.placement,
            placement_words: report.placed_by.words().to_owned(),
            claim: c.claim(),
            missing: &status.missing,
            accepted: report.is_accepted(),
            apart: report.apart(),
            against: report.against.iter().map(against).collect(),
        }
    }
}
