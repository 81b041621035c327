//! Calibrations as `record` and `replay` take them.

use super::{CliError, calibrate, inputs};
use crate::print::errln;
use hydroline_calib::calibration::board_map::Placement;
use hydroline_calib::map::Method;
use hydroline_calib::map::refractive::Known;
use hydroline_calib::{Calibration, ImageSize, Medium};
use hydroline_core::session::Conditions;
use hydroline_daemon::calibrate::{Setup, medium};
use hydroline_rigs::{Board, Rig};
use std::path::{Path, PathBuf};

/// Choice of the calibration.
#[derive(Debug, clap::Args)]
pub struct UseArgs {
    /// Calibration for the plane coordinates, as `calibrate` or `record --calibrate` wrote it
    #[arg(long, value_name = "CALIB.toml")]
    pub calibration: Option<PathBuf>,
    /// Uses the calibration although it was made in another medium than the run's
    #[arg(long)]
    pub force_calibration: bool,
    /// Medium that the light goes through: air, fresh or salt; default: what water and rig say
    #[arg(long, value_parser = medium::from_name, value_name = "MEDIUM")]
    pub medium: Option<Medium>,
}

impl UseArgs {
    /// The calibration, if one is named.
    pub fn load(&self) -> Result<Option<Calibration>, CliError> {
        let Some(path) = self.calibration.as_deref() else {
            return Ok(None);
        };
        let calibration = Calibration::load(path)?;
        if let Some(words) = calibration.caveat() {
            errln!("hydroline: {}: {words}", path.display());
        }
        Ok(Some(calibration))
    }

    /// The calibration as this run needs it, and what must be said of that: refused for images of
    /// another size; for another medium a map that knows its port is given the run's index, any other
    /// is refused unless forced.
    pub fn fit_to_run(
        &self,
        calibration: Calibration,
        run: Medium,
        index: Known,
        image: Option<ImageSize>,
    ) -> Result<(Calibration, Option<String>), CliError> {
        if let Some(image) = image {
            calibration.check_image(image)?;
        }
        if calibration.medium != run
            && let Some(found) = calibration.in_medium(run, index)
        {
            let words = format!(
                "the calibration was made in {}; its port being known, it is used in {} with the index {:.4} +- {:.4}",
                calibration.medium.name(),
                run.name(),
                index.value,
                index.sd
            );
            return Ok((found, Some(words)));
        }
        let warning = medium::check(&calibration, run, self.force_calibration)
            .map_err(|e| CliError::Config(format!("{e} (--force-calibration)")))?;
        Ok((calibration, warning))
    }
}

/// Making one while recording.
#[derive(Debug, clap::Args)]
pub struct MakeArgs {
    /// Searches every frame for the board that stands in the sheet, until a calibration is accepted; with neither
    /// --for nor --plan the recording ends then. On a simulated camera the board is put into the sheet
    #[arg(long)]
    calibrate: bool,
    /// Board file or built-in name; default: the rig's
    #[arg(long, value_name = "BOARD", requires = "calibrate")]
    board: Option<String>,
    /// Map to fit
    #[arg(long, default_value = "homography", value_parser = calibrate::method, value_name = "METHOD")]
    method: Method,
    /// Where the board's middle stands in the sheet [m], turned by [deg]; default: from the rig's mounts
    #[arg(long, value_parser = calibrate::placement, allow_hyphen_values = true, value_name = "XI,ETA[,DEG]", requires = "calibrate")]
    at: Option<Placement>,
    /// Accepts a board without gauge blocks; the claim stays withdrawn
    #[arg(long, requires = "calibrate")]
    accept_unknown_gap: bool,
    /// File for the accepted calibration; default: LOG.calibration.toml
    #[arg(long, value_name = "CALIB.toml", requires = "calibrate")]
    calibration_out: Option<PathBuf>,
}

impl MakeArgs {
    /// Setup of the search; `None` without `--calibrate`.
    pub fn setup(&self, rig: &Rig, conditions: &Conditions) -> Result<Option<Setup>, CliError> {
        if !self.calibrate {
            return Ok(None);
        }
        let board = match (&self.board, &rig.board) {
            (Some(name), _) => Board::load_or_builtin(name)?,
            (None, Some(board)) => board.clone(),
            (None, None) => {
                return Err(CliError::Config(format!(
                    "--calibrate: rig '{}' names no [board]; name one with --board, e.g. --board dots-50",
                    rig.name
                )));
            }
        };
        Ok(Some(Setup {
            method: self.method,
            at: self.at,
            accept_unknown_gap: self.accept_unknown_gap,
            ..Setup::new(board, medium::of_run(rig, conditions), Some(rig.clone()))
        }))
    }

    /// Where the accepted calibration goes; refused when something is there.
    pub fn file(&self, log: &Path) -> Result<PathBuf, CliError> {
        let file = self
            .calibration_out
            .clone()
            .unwrap_or_else(|| log.with_extension("calibration.toml"));
        inputs::new_file("--calibration-out", &file)?;
        Ok(file)
    }
}
