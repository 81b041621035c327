//! Quality of a calibration, in words and as JSON.

use super::collect::Collected;
use hydroline_calib::calibration::compare::Comparison;
use hydroline_calib::detect::Orientation;
use hydroline_calib::online::Status;
use hydroline_calib::{CalibError, Calibration};
use hydroline_daemon::calibrate::{PlacedBy, Setup, Sheet};
use std::fmt;
use std::path::Path;

/// Name of the other: a file, or another pose.
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

/// The one verdict on a calibration; `apart` = the others from which it is further off than is allowed.
fn closing(accepted: bool, missing: &[String], apart: &[&str]) -> String {
    match accepted {
        false => format!("not accepted, missing: {}", missing.join("; ")),
        true if apart.is_empty() => "accepted: nothing is missing".to_owned(),
        true => format!(
            "by itself nothing is missing, but it is off from {} by more than is allowed: find out which of them holds before a run \
             uses either",
            apart.join(", ")
        ),
    }
}

impl<'a> Report<'a> {
    /// A comparison in words, and whether it is more than the rig allows a map.
    fn judged(&self, found: &Comparison) -> String {
        let allowed_mm = 1e3 * self.setup.tolerance_m();
        let size = if 1e3 * found.max_m <= allowed_mm {
            "no more than"
        } else {
            "MORE than"
        };
        format!("{} ({size} the {allowed_mm:.2} mm allowed)", found.words())
    }

    /// Names of the calibrations that it differs from by more than the rig allows a map and the uncertainties explain: by the
    /// shape alone, where another place of the board was taken out.
    pub fn apart(&self) -> Vec<&'a str> {
        let apart = |found: &Comparison| found.drifted() && found.max_m > self.setup.tolerance_m();
        let of = |a: &&Against| a.aligned.as_ref().or(a.as_is.as_ref()).is_some_and(apart);
        let found = self.against.iter().filter(of);
        found.map(|a| a.name.as_str()).collect()
    }

    /// Whether nothing is missing, and nothing that it was compared with speaks against it.
    pub fn is_accepted(&self) -> bool {
        self.status.accepted && self.apart().is_empty()
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

    pub fn orientation(&self) -> Option<Orientation> {
        let pose = self.collected.poses.poses.get(self.best)?;
        pose.last().map(|d| d.orientation)
    }

    pub fn gamma(&self) -> Option<f64> {
        let pose = self.collected.poses.poses.get(self.best)?;
        pose.last().and_then(|d| d.gamma)
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
        writeln!(f, "{}", closing(s.accepted, &s.missing, &self.apart()))?;
        writeln!(f, "{}", self.out.display())
    }
}

#[cfg(test)]
mod tests {
    use super::closing;

    #[test]
    fn what_disagrees_with_another_is_not_called_accepted() {
        let words = closing(true, &[], &["old.toml"]);
        assert!(
            words.contains("old.toml") && !words.contains("accepted"),
            "{words}"
        );
        assert_eq!(closing(true, &[], &[]), "accepted: nothing is missing");
        let missing = ["corners".to_owned()];
        assert_eq!(
            closing(false, &missing, &["old.toml"]),
            "not accepted, missing: corners"
        );
    }
}
