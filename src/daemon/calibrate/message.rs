//! Calibrations as the log holds them.

use super::Setup;
use hydroline_calib::Calibration;
use hydroline_calib::online::Status;
use hydroline_log::messages::{pb, timestamp};

/// `state` of a message: the plane coordinates of this log come from it.
pub const IN_FORCE: &str = "in_force";
/// `state` of a message: a calibration in the making.
pub const MEASURING: &str = "measuring";
/// `state` of a message: finished; its file is in `toml`.
pub const ACCEPTED: &str = "accepted";

/// The calibration that a log's plane coordinates come from.
pub fn in_force(calibration: &Calibration, unix_ns: u64) -> pb::PlaneCalibration {
    let residuals = calibration.residuals;
    pb::PlaneCalibration {
        timestamp: Some(timestamp(unix_ns)),
        method: calibration.map.method().to_owned(),
        medium: calibration.medium.name().to_owned(),
        toml: calibration.to_toml().unwrap_or_default(),
        state: IN_FORCE.to_owned(),
        board: calibration.board.clone().unwrap_or_default(),
        nodes: residuals.map_or(0, |r| r.nodes),
        residual_xi_m: residuals.map(|r| r.rms_xi_m),
        residual_eta_m: residuals.map(|r| r.rms_eta_m),
        residual_max_m: residuals.map(|r| r.max_m),
        ..pb::PlaneCalibration::default()
    }
}

/// Where a calibration in the making stands; `accepted` = the finished one.
pub fn progress(
    setup: &Setup,
    status: &Status,
    accepted: Option<&Calibration>,
    unix_ns: u64,
) -> pb::PlaneCalibration {
    pb::PlaneCalibration {
        timestamp: Some(timestamp(unix_ns)),
        method: setup.method.name().to_owned(),
        medium: setup.medium.name().to_owned(),
        toml: accepted.and_then(|c| c.to_toml().ok()).unwrap_or_default(),
        state: if accepted.is_some() {
            ACCEPTED
        } else {
            MEASURING
        }
        .to_owned(),
        board: setup.board.name.clone(),
        frames: status.frames,
        nodes: status.nodes as u32,
        coverage: Some(status.coverage.share()),
        covered: status.coverage.parts.iter().flatten().copied().collect(),
        residual_xi_m: status.residuals.map(|r| r.rms_xi_m),
        residual_eta_m: status.residuals.map(|r| r.rms_eta_m),
        residual_max_m: status.residuals.map(|r| r.max_m),
        worst_sd_m: status.worst_sd_m,
        gap: status.gap.clone().unwrap_or_default(),
        missing: status.missing.clone(),
    }
}

/// The status in one line.
pub fn line(status: &Status) -> String {
    let parts = status
        .coverage
        .parts
        .iter()
        .flatten()
        .filter(|&&p| p >= 0.5)
        .count();
    let sd = status
        .worst_sd_m
        .map_or_else(String::new, |sd| format!(", map ± {:.2} mm", 1e3 * sd));
    let missing = match status.missing.first() {
        Some(first) if !status.accepted => format!("; missing: {first}"),
        _ => String::new(),
    };
    format!(
        "board in {} frames, {} nodes, {parts}/9 parts{sd}{missing}",
        status.frames, status.nodes
    )
}
