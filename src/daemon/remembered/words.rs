//! A remembered calibration in words: what it is of, how well it fits, how old it is.

use hydroline_calib::Calibration;
use std::time::SystemTime;

const DAY_S: u64 = 86_400;

pub fn made(calibration: &Calibration) -> Option<SystemTime> {
    humantime::parse_rfc3339_weak(calibration.date.as_deref()?).ok()
}

/// Board, medium and method.
pub fn circumstances(c: &Calibration) -> String {
    format!(
        "board {}, in {}, {}",
        c.board.as_deref().unwrap_or("none"),
        c.medium.name(),
        c.map.method()
    )
}

/// The residual at the nodes, both axes together.
pub fn fit(c: &Calibration) -> String {
    c.residuals.map_or_else(
        || "of unknown fit".to_owned(),
        |r| {
            format!(
                "rms {:.3} mm at {} nodes",
                1e3 * r.rms_xi_m.hypot(r.rms_eta_m),
                r.nodes
            )
        },
    )
}

/// When it was made and how long ago that is.
pub fn age(c: &Calibration, now: SystemTime) -> String {
    let date = c.date.as_deref().unwrap_or("an unknown time");
    let Some(age) = made(c).and_then(|made| now.duration_since(made).ok()) else {
        return date.to_owned();
    };
    let age = match age.as_secs() {
        s if s < 3600 => format!("{} min", s / 60),
        s if s < 2 * DAY_S => format!("{} h", s / 3600),
        s => format!("{} days", s / DAY_S),
    };
    format!("{date} ({age} old)")
}
