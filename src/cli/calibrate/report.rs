//! What a calibration is worth, in words and as JSON.

use super::collect::Collected;
use hydroline_calib::board::coplanarity::Coplanarity;
use hydroline_calib::calibration::compare::Comparison;
use hydroline_calib::detect::Orientation;
use hydroline_calib::online::Status;
use hydroline_calib::{CalibError, Calibration};
use hydroline_daemon::calibrate::{PlacedBy, Setup, Sheet};
use serde_json::{Value, json};
use std::fmt;
use std::path::Path;

/// A comparison with another calibration or pose.
pub struct Against {
    /// With what.
    pub name: String,
    /// Medium, date, board and method of the other; empty for a pose of this run.
    pub made: String,
    /// Coordinates as they are.
    pub as_is: Option<Comparison>,
    /// After the best rigid motion was taken out.
    pub aligned: Option<Comparison>,
}

/// Everything to tell.
pub struct Report<'a> {
    pub out: &'a Path,
    pub setup: &'a Setup,
    pub collected: &'a Collected,
    /// Index of the pose calibrated with.
    pub best: usize,
    pub calibration: &'a Calibration,
    pub placed_by: PlacedBy,
    pub status: &'a Status,
    pub against: &'a [Against],
}

/// Where a calibration comes from.
pub fn provenance(c: &Calibration) -> String {
    format!(
        "{}, board {}, in {}, of {}",
        c.map.method(),
        c.board.as_deref().unwrap_or("none"),
        c.medium.name(),
        c.date.as_deref().unwrap_or("no date")
    )
}

impl Report<'_> {
    /// What a comparison found, and whether it is more than the rig allows a map.
    fn judged(&self, found: &Comparison) -> String {
        let allowed_mm = 1e3 * self.setup.tolerance_m();
        let size = if 1e3 * found.max_m <= allowed_mm {
            "no more than"
        } else {
            "MORE than"
        };
        format!("{} ({size} the {allowed_mm:.2} mm allowed)", found.words())
    }

    /// The file: what it claims as a comment, then the calibration.
    pub fn file(&self) -> Result<String, CalibError> {
        Ok(format!(
            "# hydroline calibration: {}\n# {}\n{}",
            provenance(self.calibration),
            self.calibration.claim(),
            self.calibration.to_toml()?
        ))
    }

    fn orientation(&self) -> Option<Orientation> {
        let pose = self.collected.poses.poses.get(self.best)?;
        pose.last().map(|d| d.orientation)
    }

    fn gamma(&self) -> Option<f64> {
        let pose = self.collected.poses.poses.get(self.best)?;
        pose.last().and_then(|d| d.gamma)
    }

    pub fn json(&self) -> Value {
        let c = self.calibration;
        let comparison = |c: &Comparison| {
            json!({
                "points": c.points, "mean_m": c.mean_m, "rms_m": c.rms_m, "max_m": c.max_m,
                "worst_at_m": c.worst_m, "expected_m": c.expected_m, "ratio": c.ratio,
                "removed": c.removed.map(|[xi, eta, turn]| json!({ "xi_m": xi, "eta_m": eta, "turn_rad": turn })),
                "drifted": c.drifted(), "within_tolerance": c.max_m <= self.setup.tolerance_m(), "words": c.words(),
            })
        };
        let against: Vec<Value> = self
            .against
            .iter()
            .map(|a| {
                json!({
                    "with": a.name, "made": a.made,
                    "as_is": a.as_is.as_ref().map(comparison),
                    "aligned": a.aligned.as_ref().map(comparison),
                })
            })
            .collect();
        let gap = match c.gap() {
            Some(Coplanarity::Measured(g)) => json!({
                "state": "measured", "offset_m": g.offset_m, "offset_sd_m": g.offset_sd_m(),
                "tilt_xi_rad": g.tilt_xi_rad, "tilt_eta_rad": g.tilt_eta_rad,
                "tilt_xi_sd_rad": g.covariance[(1, 1)].max(0.0).sqrt(),
                "tilt_eta_sd_rad": g.covariance[(2, 2)].max(0.0).sqrt(),
                "blocks": g.blocks,
            }),
            Some(Coplanarity::Unknown(u)) => json!({ "state": "unknown", "why": u.why }),
            None => Value::Null,
        };
        let sheet = Sheet::of(self.setup, c);
        json!({
            "calibration": self.out, "method": c.map.method(), "medium": c.medium.name(),
            "date": c.date, "board": c.board,
            "images": {
                "looked_at": self.collected.looked, "with_board": self.collected.found,
                "used": self.status.frames, "refused": self.collected.refused,
            },
            "poses": self.collected.poses.poses.len(),
            "key_seen": self.orientation() == Some(Orientation::KeySeen),
            "nodes": self.status.nodes,
            "nodes_of_board": self.setup.board.columns * self.setup.board.rows,
            "coverage": self.status.coverage.share(), "coverage_parts": self.status.coverage.parts,
            "sheet_share": sheet.map(|s| s.share), "sheet_parts": sheet.map(|s| s.parts),
            "residuals": c.residuals, "worst_sd_m": self.status.worst_sd_m, "own_sd_m": self.status.own_sd_m,
            "tolerance_m": self.setup.tolerance_m(),
            "missing_part": self.status.missing_part, "camera_gamma": self.gamma(),
            "residual_ratio": self.status.misfit.map(|m| m.ratio), "residual_worst_sds": self.status.misfit.map(|m| m.worst_sds),
            "residual_words": self.status.misfit.map(|m| m.words()),
            "coplanarity": gap, "coplanarity_words": c.gap().map(Coplanarity::words),
            "placement": c.placement, "placement_words": self.placed_by.words(),
            "claim": c.claim(), "missing": self.status.missing, "accepted": self.status.accepted,
            "against": against,
        })
    }
}

impl fmt::Display for Report<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (c, s) = (self.calibration, self.status);
        let board = &self.setup.board;
        writeln!(
            f,
            "board {}: in {} of {} images{}{}",
            board.name,
            self.collected.found,
            self.collected.looked,
            match self.collected.poses.poses.len() {
                1 => String::new(),
                n => format!(
                    ", in {n} poses; calibrated with pose {} ({} images)",
                    self.best + 1,
                    s.frames
                ),
            },
            if self.collected.refused.is_empty() {
                String::new()
            } else {
                format!("; without{}", self.collected.reasons())
            }
        )?;
        writeln!(
            f,
            "nodes: {} of {}{}, {}",
            s.nodes,
            board.columns * board.rows,
            s.missing_part
                .as_ref()
                .map_or_else(String::new, |part| format!(
                    ", the {part} of the board is missing: the map holds for the rest"
                )),
            match self.orientation() {
                Some(Orientation::KeySeen) => "which is which is certain: the key was seen",
                _ =>
                    "no key seen: the board is taken to stand upright, and the image not to be mirrored, which it cannot show",
            }
        )?;
        let parts = s.coverage.parts;
        let percent = |v: f64| format!("{:.0}", 100.0 * v);
        writeln!(
            f,
            "coverage [%], as the camera sees the board: {}",
            [2, 1, 0]
                .map(|row: usize| [2, 1, 0]
                    .map(|col: usize| percent(parts[row][col]))
                    .join(" "))
                .join(" | ")
        )?;
        if let Some(sheet) = Sheet::of(self.setup, c) {
            writeln!(f, "map holds for {}", sheet.words())?;
        }
        writeln!(f, "map: {}", provenance(c))?;
        if let Some(r) = &c.residuals {
            writeln!(
                f,
                "residuals at the nodes: xi {:.3} mm rms, eta {:.3} mm rms, {:.3} mm at most",
                1e3 * r.rms_xi_m,
                1e3 * r.rms_eta_m,
                1e3 * r.max_m
            )?;
        }
        if let Some(misfit) = s.misfit {
            writeln!(f, "residuals are {}", misfit.words())?;
        }
        if let Some(gamma) = self.gamma() {
            writeln!(
                f,
                "camera: its levels go as light to the power of about {gamma:.2} (a tone curve), taken into account"
            )?;
        }
        if let (Some(own), Some(all)) = (s.own_sd_m, s.worst_sd_m) {
            writeln!(
                f,
                "map's own uncertainty: {:.3} mm where it is worst, {:.2} mm allowed; with the board's distance from the sheet {:.3} mm",
                1e3 * own,
                1e3 * self.setup.tolerance_m(),
                1e3 * all
            )?;
        }
        if let Some(gap) = c.gap() {
            writeln!(f, "sheet: {}", gap.words())?;
        }
        if let Some(p) = c.placement {
            writeln!(
                f,
                "place: board's middle at xi {:+.4} m, eta {:+.4} m, turned {:+.2} deg; {}",
                p.xi_m,
                p.eta_m,
                p.turn_rad.to_degrees(),
                self.placed_by.words()
            )?;
        }
        for a in self.against {
            let made = if a.made.is_empty() {
                String::new()
            } else {
                format!(" ({})", a.made)
            };
            match (&a.as_is, &a.aligned) {
                (None, None) => writeln!(
                    f,
                    "against {}{made}: nothing to compare, they share fewer than 10 points",
                    a.name
                )?,
                (as_is, aligned) => {
                    if let Some(found) = as_is {
                        writeln!(f, "against {}{made}: {}", a.name, self.judged(found))?;
                    }
                    if let Some(found) = aligned {
                        let [xi, eta, turn] = found.removed.unwrap_or_default();
                        writeln!(
                            f,
                            "against {}{made}, shifted by {:+.2}, {:+.2} mm and turned by {:+.3} deg: {}",
                            a.name,
                            1e3 * xi,
                            1e3 * eta,
                            turn.to_degrees(),
                            self.judged(found)
                        )?;
                    }
                }
            }
        }
        writeln!(f, "claim: {}", c.claim())?;
        if s.accepted {
            writeln!(f, "accepted: nothing is missing")?;
        } else {
            writeln!(f, "not accepted, missing: {}", s.missing.join("; "))?;
        }
        writeln!(f, "{}", self.out.display())
    }
}
